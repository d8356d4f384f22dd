# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors as the tools see them: built with the values of their parameters, never run."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from flexbt_core.state_machine import MachineDefinition, MachineError
from flexbt_onboard.behaviors import BehaviorEntry, BehaviorLibrary, building, definition_of, machine_entry
from flexbt_onboard.errors import OnboardError
from flexbt_tools.errors import UsageError
from flexbt_tools.text_files import read_text

_MAX_BYTES: Final = 4_000_000
"""Of the file of a machine."""


@dataclass(frozen=True)
class BuiltBehavior:
    """A behavior and its state machine, which is None when there are ``problems``."""

    name: str
    machine: MachineDefinition | None
    problems: Sequence[str] = ()


def build(entry: BehaviorEntry, arguments: Sequence[tuple[str, str]]) -> BuiltBehavior:
    """Make the machine of an installed behavior, as the executive does at a start."""
    try:
        with building():
            behavior = entry.instantiate()
            behavior.set_arguments(arguments)
            return BuiltBehavior(entry.name, definition_of(behavior))
    except MachineError as error:
        return BuiltBehavior(entry.name, None, error.problems)
    except OnboardError as error:
        return BuiltBehavior(entry.name, None, [str(error)])
    except Exception as error:  # code of the behavior
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f'create() raised {type(error).__name__}: {error} ({frame.filename}:{frame.lineno})'
        return BuiltBehavior(entry.name, None, [text])


def machine_file(name: str) -> Path | None:
    """The file of a machine that is meant instead of an installed behavior."""
    file = Path(name)
    return file if file.suffix in ('.yaml', '.yml') else None


def behavior_entry(name: str) -> BehaviorEntry:
    """The installed behavior of this name, or the machine in this file. Raises UsageError."""
    file = machine_file(name)
    if file is None:
        (entry,) = installed([name])
        return entry
    return machine_entry(file.stem, read_text(name, _MAX_BYTES))


def installed(names: Sequence[str]) -> list[BehaviorEntry]:
    """The behaviors of these names, or all. Raises UsageError."""
    library = BehaviorLibrary.discover()
    try:
        return [library.find(name) for name in names] if names else list(library.entries.values())
    except OnboardError as error:
        raise UsageError(str(error)) from error
