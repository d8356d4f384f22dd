# SPDX-License-Identifier: BSD-3-Clause
"""A machine as it is written, in whatever form: not checked yet, and no part of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from flexbt_core.values import shown

from .definition import Condition, StateKind
from .errors import StateMachineError
from .event_state import EventState
from .userdata import DefaultUserData


@dataclass(frozen=True)
class Child:
    """A state or machine in a machine.

    ``transitions`` leads each outcome of it to the label of another child, or to an outcome of the machine;
    ``autonomy`` gives the level that each outcome requires; ``remapping`` maps its keys to those of the machine.
    """

    label: str
    state: EventState | Machine
    transitions: Mapping[str, str] = field(default_factory=dict)
    autonomy: Mapping[str, int] = field(default_factory=dict)
    remapping: Mapping[str, str] = field(default_factory=dict)


class Machine:
    """A state machine, or a state that is one. Its first child is the initial one.

    ``userdata`` has defaults, by their keys; more are given as ``machine.userdata.key = value``.
    """

    kind: ClassVar[StateKind] = StateKind.MACHINE

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
        *,
        children: Iterable[Child] = (),
        userdata: Mapping[str, Any] | None = None,
    ) -> None:
        both = tuple(io_keys)
        self.outcomes: tuple[str, ...] = tuple(dict.fromkeys(outcomes))
        self.input_keys: tuple[str, ...] = tuple(dict.fromkeys((*input_keys, *both)))
        self.output_keys: tuple[str, ...] = tuple(dict.fromkeys((*output_keys, *both)))
        self.userdata = DefaultUserData()
        self.children: list[Child] = []
        self.conditions: tuple[Condition, ...] = ()
        for key, value in (userdata or {}).items():
            self.userdata[key] = value
        for child in children:
            self.add_child(child)

    def add_child(self, child: Child) -> None:
        """Add a state or machine.

        Raises:
            StateMachineError: it is neither.
        """
        given: Any = child.state
        if not isinstance(given, EventState | Machine):
            raise StateMachineError(
                f"cannot add '{child.label}': {shown(given)} is neither a state object nor a machine"
            )
        own = dict(child.transitions), dict(child.autonomy), dict(child.remapping)
        self.children.append(Child(child.label, child.state, *own))
