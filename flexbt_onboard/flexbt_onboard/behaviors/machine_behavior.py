# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that are data: a state machine as YAML, of states that are installed. It holds no code, and names no
module.

A package makes its states known to such machines by an entry point in its ``setup.py``, which names a module::

    entry_points={'flexbt.states': ['my_states = my_package.states']}
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Final

from flexbt_core.state_machine import EventState, MachineDefinition, read_machine
from flexbt_core.values import one_line
from flexbt_msgs.msg import BehaviorManifest as BehaviorManifestMessage
from flexbt_onboard.errors import BrokenBehaviorError

from .behavior import Behavior, BehaviorManifest
from .behavior_library import BehaviorEntry

STATES_GROUP: Final = 'flexbt.states'
"""Entry point group under which packages list modules of states that machines in YAML may have."""


def state_modules() -> list[str]:
    """The names of the modules that packages list, sorted."""
    return sorted({point.value for point in entry_points(group=STATES_GROUP)})


def states_of(modules: Iterable[str]) -> dict[str, type[EventState]]:
    """The states of modules by their names; those of the last module count.

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
        """The machine. Raises MachineError with every problem of the text, BrokenBehaviorError for missing states."""
        return read_machine(self._text, states_of(state_modules()), self.name)


def machine_entry(name: str, text: str) -> BehaviorEntry:
    """What the library has of a machine; its description is the comment with which the text begins."""
    first = text.partition('\n')[0]
    manifest = BehaviorManifest(name, one_line(first.removeprefix('#').strip()) if first.startswith('#') else '')
    make = functools.partial(MachineBehavior, manifest, text)
    return BehaviorEntry(name, BehaviorManifestMessage.SYNTHESIZED, manifest, (), make, machine=text)
