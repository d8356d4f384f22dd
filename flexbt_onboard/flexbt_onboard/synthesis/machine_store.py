# SPDX-License-Identifier: BSD-3-Clause
"""The machines that were synthesized, as files: what an operator had made is there after a restart, too."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import Final

from flexbt_core.values import shown, write_text
from flexbt_onboard.behaviors import BehaviorEntry, machine_entry
from flexbt_onboard.errors import BehaviorError

MOST_MACHINES: Final = 100
"""Machines that are kept; the oldest gives way."""

MACHINE_LENGTH: Final = 1_000_000
"""Characters of a machine, at most."""

_MACHINE: Final = re.compile(r'^(machine|concurrency|priority):', re.MULTILINE)
"""What the text of a machine has, and other YAML, such as a file of capabilities, has not."""

_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_ -]{0,79}')


def check_name(name: str) -> None:
    """Whether a machine may be called so. Raises BehaviorError."""
    if not _NAME.fullmatch(name) or name != name.strip():
        raise BehaviorError(
            f'{shown(name)} is no name of a behavior: a letter, then letters, digits, blanks, _ and -, 80 in all'
        )


class MachineStore:
    """The files ``NAME.yaml`` of a directory; with None nothing outlasts the process. For one thread at a time."""

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory

    def entries(self) -> tuple[list[BehaviorEntry], list[str]]:
        """Those that are there, and why other files are none. Raises OSError when the directory cannot be read."""
        machines, problems = self._machines()
        return [machine_entry(file.stem, text) for file, text in sorted(machines[:MOST_MACHINES])], problems[
            :MOST_MACHINES
        ]

    def keep(self, name: str, text: str, in_use: Collection[str]) -> list[str]:
        """Write a machine, in place of one of its name; the names of those that gave way, none of which is in use.

        Only machines give way, and no other files that somebody has put there.

        Raises:
            OSError: it cannot be written.
        """
        if self._directory is None:
            return []
        self._directory.mkdir(parents=True, exist_ok=True)
        write_text(self._directory / f'{name}.yaml', text)
        gone = []
        if len(list(self._directory.glob('*.yaml'))) > MOST_MACHINES:
            old = self._machines()[0][MOST_MACHINES:]
            gone = [file for file, _text in old if file.stem not in {name, *in_use}]
        for file in gone:
            file.unlink(missing_ok=True)
        return [file.stem for file in gone]

    def _machines(self) -> tuple[list[tuple[Path, str]], list[str]]:
        """Files and texts, the newest first; and why other files are none."""
        if self._directory is None or not self._directory.is_dir():
            return [], []
        found: list[tuple[Path, str]] = []
        problems: list[str] = []
        for file in sorted(self._directory.glob('*.yaml'), key=lambda file: -file.lstat().st_mtime_ns):
            try:
                found.append((file, _text_of(file)))
            except (BehaviorError, OSError, ValueError) as error:
                problems.append(f'{file} is no synthesized behavior: {error}')
        return found, problems


def _text_of(file: Path) -> str:
    """The text of a machine. Raises BehaviorError, OSError and ValueError where a file is none."""
    check_name(file.stem)
    if not file.is_file():
        raise ValueError('it is no file')
    if file.stat().st_size > 4 * MACHINE_LENGTH:
        raise ValueError('it is too large')
    text = file.read_text(encoding='utf-8')
    if not _MACHINE.search(text):
        raise ValueError('there is no machine in it')
    return text
