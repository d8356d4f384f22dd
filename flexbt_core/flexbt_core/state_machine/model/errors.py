# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the state-machine engine.

StateMachineError
├── MachineError     a machine that cannot be run; carries every problem that was found
├── UserDataError    userdata that is not declared, or that nobody has written
└── StateError       a state that is used against the rules
"""

from __future__ import annotations

from collections.abc import Iterable


class StateMachineError(Exception):
    """Base of the errors of the engine."""


class MachineError(StateMachineError):
    """A machine cannot be run. ``problems`` has everything that is wrong with it, in the order of its states."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems: tuple[str, ...] = tuple(problems)
        super().__init__('; '.join(self.problems))


class UserDataError(StateMachineError):
    """A userdata key was used that is not declared, or that nobody has written."""


class StateError(StateMachineError):
    """A state was used against the rules."""
