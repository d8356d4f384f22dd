# SPDX-License-Identifier: BSD-3-Clause
"""The directory that stores synthesized machines as files, so that they survive a restart."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import Final

from flexbt_core.state_machine.authoring.yaml_form import MAX_CHARACTERS
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import write_text
from flexbt_onboard.errors import BehaviorError

from .behavior_library import BehaviorEntry, machine_entry

MOST_MACHINES: Final = 100
"""Maximum number of stored machines. Beyond it, the oldest is removed."""

MACHINE_LENGTH: Final = MAX_CHARACTERS
"""Maximum characters of a machine."""

_MACHINE: Final = re.compile(r'^(machine|concurrency|priority):', re.MULTILINE)
"""Pattern of a key that only machines have, and other YAML, such as a capability file, has not."""

_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_ -]{0,79}')


def check_name(name: str) -> None:
    """Check that a machine may have this name. Raise BehaviorError if not."""
    if not _NAME.fullmatch(name) or name != name.strip():
        raise BehaviorError(
            f'{short_repr(name)} is not a behavior name: a letter, then letters, digits, blanks, _ and -, 80 in all'
        )


class MachineStore:
    """A store of machines in the files ``NAME.yaml`` of a directory. With None it stores nothing.

    Use it from one thread at a time.
    """

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory

    def entries(self) -> tuple[list[BehaviorEntry], list[str]]:
        """Return the stored machines, and the reasons why other files in the directory are not machines.

        Raises:
            OSError: the directory cannot be read.
        """
        machines, problems = self._machines()
        entries = []
        for file, text in sorted(machines):  # maybe more than MOST_MACHINES, since some were in use
            try:
                entries.append(machine_entry(file.stem, text))
            except MachineError as error:
                problems.append(f'{file} is not a synthesized behavior: {error}')
        return entries, problems[:MOST_MACHINES]

    def keep(self, name: str, text: str, in_use: Collection[str]) -> list[str]:
        """Store a machine, replacing one of the same name. Return the names of the machines removed to make room.

        It removes neither machines ``in_use`` nor other files in the directory.

        Raises:
            OSError: the machine cannot be written.
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
        """Return files and texts, newest first, and the reasons why other files are not machines."""
        if self._directory is None or not self._directory.is_dir():
            return [], []
        found: list[tuple[Path, str]] = []
        problems: list[str] = []
        for file in sorted(self._directory.glob('*.yaml'), key=lambda file: -file.lstat().st_mtime_ns):
            try:
                found.append((file, _text_of(file)))
            except (BehaviorError, OSError, ValueError) as error:
                problems.append(f'{file} is not a synthesized behavior: {error}')
        return found, problems


def _text_of(file: Path) -> str:
    """Return the text of a machine. Raise BehaviorError, OSError or ValueError if the file is not one."""
    check_name(file.stem)
    if not file.is_file():
        raise ValueError('it is not a file')
    if file.stat().st_size > 4 * MACHINE_LENGTH:
        raise ValueError('it is too large')
    text = file.read_text(encoding='utf-8')
    if not _MACHINE.search(text):
        raise ValueError('there is no machine in it')
    return text
