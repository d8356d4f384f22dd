# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that are data: state machines as YAML, and the directory where synthesized ones are kept.

A package registers its states for these machines by an entry point in its ``setup.py``, which names a module::

    entry_points={'flexbt.states': ['my_states = my_package.states']}
"""

from __future__ import annotations

import functools
import importlib
import re
from collections.abc import Collection, Iterable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final

from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.values.text import one_line, short_repr
from flexbt_core.values.text_files import write_text
from flexbt_msgs.msg import BehaviorManifest as BehaviorManifestMessage
from flexbt_onboard.errors import BehaviorError, BrokenBehaviorError

from .behavior import Behavior, BehaviorManifest
from .behavior_library import BehaviorEntry

STATES_GROUP: Final = 'flexbt.states'
"""Entry point group under which packages list modules of states that machines in YAML may have."""


def state_modules() -> list[str]:
    """Return the names of the modules that packages list, sorted."""
    return sorted({point.value for point in entry_points(group=STATES_GROUP)})


def states_of(modules: Iterable[str]) -> dict[str, type[EventState]]:
    """Return the states of modules by their names; those of the last module count.

    Raises:
        BrokenBehaviorError: a module cannot be imported.
    """
    found: dict[str, type[EventState]] = {}
    for module in modules:
        try:
            values = vars(importlib.import_module(module))
        except Exception as error:  # code of the module
            raise BrokenBehaviorError(
                f'the states of module {module!r} cannot be had: {type(error).__name__}: {error}'
            ) from error
        for name, value in values.items():
            if isinstance(value, type) and issubclass(value, EventState) and value is not EventState:
                found[name] = value
    return found


class MachineBehavior(Behavior):
    """A behavior that is the text of a machine."""

    def __init__(self, manifest: BehaviorManifest, text: str) -> None:
        self.manifest = manifest
        self._text = text
        super().__init__()

    def create(self) -> MachineDefinition:
        """Return the machine. Raises MachineError with every problem of the text, BrokenBehaviorError for missing
        states."""
        return read_machine(self._text, states_of(state_modules()), self.name)


def machine_entry(name: str, text: str) -> BehaviorEntry:
    """Return what the library has of a machine; its description is the comment with which the text begins."""
    first = text.partition('\n')[0]
    manifest = BehaviorManifest(name, one_line(first.removeprefix('#').strip()) if first.startswith('#') else '')
    make = functools.partial(MachineBehavior, manifest, text)
    return BehaviorEntry(name, BehaviorManifestMessage.SYNTHESIZED, manifest, (), make, machine=text)


# The machines that were synthesized, as files: what an operator had made is there after a restart, too.

MOST_MACHINES: Final = 100
"""Machines that are kept; the oldest is removed."""

MACHINE_LENGTH: Final = 1_000_000
"""Maximum characters of a machine."""

_MACHINE: Final = re.compile(r'^(machine|concurrency|priority):', re.MULTILINE)
"""Pattern of a key that the text of a machine has and other YAML, such as a file of capabilities, does not."""

_NAME: Final = re.compile(r'[A-Za-z_][A-Za-z0-9_ -]{0,79}')


def check_name(name: str) -> None:
    """Check that a machine may have this name. Raises BehaviorError."""
    if not _NAME.fullmatch(name) or name != name.strip():
        raise BehaviorError(
            f'{short_repr(name)} is no name of a behavior: a letter, then letters, digits, blanks, _ and -, 80 in all'
        )


class MachineStore:
    """The files ``NAME.yaml`` of a directory; with None nothing outlasts the process. For one thread at a time."""

    def __init__(self, directory: Path | None) -> None:
        self._directory = directory

    def entries(self) -> tuple[list[BehaviorEntry], list[str]]:
        """Return those that are there, and why other files are none. Raises OSError when the directory cannot be
        read."""
        machines, problems = self._machines()
        return [machine_entry(file.stem, text) for file, text in sorted(machines[:MOST_MACHINES])], problems[
            :MOST_MACHINES
        ]

    def keep(self, name: str, text: str, in_use: Collection[str]) -> list[str]:
        """Write a machine, in place of one of its name; the names of those that gave way, none of which is in use.

        Only machines are removed, not other files in the directory.

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
    """Return the text of a machine. Raises BehaviorError, OSError and ValueError where a file is none."""
    check_name(file.stem)
    if not file.is_file():
        raise ValueError('it is no file')
    if file.stat().st_size > 4 * MACHINE_LENGTH:
        raise ValueError('it is too large')
    text = file.read_text(encoding='utf-8')
    if not _MACHINE.search(text):
        raise ValueError('there is no machine in it')
    return text
