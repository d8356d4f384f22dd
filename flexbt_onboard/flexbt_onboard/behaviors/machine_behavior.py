# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors as data: state machines in YAML, and the directory that stores the synthesized ones.

A package registers states for these machines with an entry point in its ``setup.py`` that names a module::

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
"""Entry point group under which packages list modules of states for machines in YAML."""


def state_modules() -> list[str]:
    """Return the names of the modules that packages list as modules of states, sorted."""
    return sorted({point.value for point in entry_points(group=STATES_GROUP)})


def states_of(modules: Iterable[str]) -> dict[str, type[EventState]]:
    """Return the state classes of modules by name. If several modules have the same name, the last one counts.

    Raises:
        BrokenBehaviorError: a module cannot be imported.
    """
    found: dict[str, type[EventState]] = {}
    for module in modules:
        try:
            values = vars(importlib.import_module(module))
        except Exception as error:  # the module may raise anything
            raise BrokenBehaviorError(
                f'the states of module {module!r} cannot be had: {type(error).__name__}: {error}'
            ) from error
        for name, value in values.items():
            if isinstance(value, type) and issubclass(value, EventState) and value is not EventState:
                found[name] = value
    return found


class MachineBehavior(Behavior):
    """A behavior made from the YAML text of a machine."""

    def __init__(self, manifest: BehaviorManifest, text: str) -> None:
        self.manifest = manifest
        self._text = text
        super().__init__()

    def create(self) -> MachineDefinition:
        """Return the machine.

        Raises:
            MachineError: the text has problems; the error lists all of them.
            BrokenBehaviorError: a module of states cannot be imported.
        """
        return read_machine(self._text, states_of(state_modules()), self.name)


def machine_entry(name: str, text: str) -> BehaviorEntry:
    """Return the library entry of a machine. A comment on the first line of the text becomes the description."""
    first = text.partition('\n')[0]
    manifest = BehaviorManifest(name, one_line(first.removeprefix('#').strip()) if first.startswith('#') else '')
    make = functools.partial(MachineBehavior, manifest, text)
    return BehaviorEntry(name, BehaviorManifestMessage.SYNTHESIZED, manifest, (), make, machine=text)


# Synthesized machines are stored as files, so that they survive a restart.

MOST_MACHINES: Final = 100
"""Maximum number of stored machines. Beyond it, the oldest is removed."""

MACHINE_LENGTH: Final = 1_000_000
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
        return [machine_entry(file.stem, text) for file, text in sorted(machines[:MOST_MACHINES])], problems[
            :MOST_MACHINES
        ]

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
