# SPDX-License-Identifier: BSD-3-Clause
"""Machines as they are written: FlexBE's context-manager form. :func:`define` makes a checked definition of one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from .definition import ROOT_PATH, MachineDefinition, StateDefinition, Transition, child_path
from .errors import MachineError, StateMachineError
from .event_state import EventState
from .machine_check import problems_of
from .userdata import DefaultUserData

# Which machines are open, innermost last; per thread and task, so that several can be built at the same time.
_open_machines: ContextVar[tuple[OperatableStateMachine, ...]] = ContextVar('open_machines', default=())


@dataclass(frozen=True)
class Child:
    """A state or machine as it was added, not checked yet."""

    label: str
    state: EventState | OperatableStateMachine
    transitions: Mapping[str, str]
    autonomy: Mapping[str, int]
    remapping: Mapping[str, str]


class OperatableStateMachine:
    """A state machine, or a state that is one.

    The first state that is added is the initial one::

        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('Wait', WaitState(2.0), transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Low})
    """

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
    ) -> None:
        both = tuple(io_keys)
        self.outcomes: tuple[str, ...] = tuple(dict.fromkeys(outcomes))
        self.input_keys: tuple[str, ...] = tuple(dict.fromkeys((*input_keys, *both)))
        self.output_keys: tuple[str, ...] = tuple(dict.fromkeys((*output_keys, *both)))
        self.userdata = DefaultUserData()
        self.children: list[Child] = []

    def __enter__(self) -> OperatableStateMachine:
        _open_machines.set((*_open_machines.get(), self))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        _open_machines.set(_open_machines.get()[:-1])

    @staticmethod
    def add(
        label: str,
        state: EventState | OperatableStateMachine,
        transitions: Mapping[str, str],
        autonomy: Mapping[str, int] | None = None,
        remapping: Mapping[str, str] | None = None,
    ) -> EventState | OperatableStateMachine:
        """Add a state to the machine whose ``with`` block this is.

        ``transitions`` leads each outcome of the state to the label of another state, or to an outcome of the machine;
        ``autonomy`` gives the level that each outcome requires; ``remapping`` maps keys of the state to the machine's.
        """
        machines = _open_machines.get()
        if not machines:
            raise StateMachineError(f"cannot add '{label}': no machine is open; use 'with machine:'")
        given: Any = state
        if not isinstance(given, EventState | OperatableStateMachine):
            raise StateMachineError(f"cannot add '{label}': {given!r:.80} is neither a state object nor a machine")
        machines[-1].children.append(
            Child(label, state, dict(transitions), dict(autonomy or {}), dict(remapping or {}))
        )
        return state


def define(machine: OperatableStateMachine) -> MachineDefinition:
    """Check a machine as a whole and make its definition.

    Raises:
        MachineError: with every problem of it.
    """
    problems = list(problems_of(machine))
    if problems:
        raise MachineError(problems)
    return _define(machine, ROOT_PATH, '', {}, {})


def _define(
    machine: OperatableStateMachine,
    path: str,
    label: str,
    transitions: Mapping[str, Transition],
    remap: Mapping[str, str],
) -> MachineDefinition:
    children: dict[str, StateDefinition | MachineDefinition] = {}
    labels = {child.label for child in machine.children}
    for child in machine.children:
        own = child_path(path, child.label)
        ways = {
            outcome: Transition(
                target if target in labels else None,
                None if target in labels else target,
                child.autonomy.get(outcome, -1),
            )
            for outcome, target in child.transitions.items()
        }
        if isinstance(child.state, OperatableStateMachine):
            children[child.label] = _define(child.state, own, child.label, ways, child.remapping)
        else:
            children[child.label] = StateDefinition(own, child.label, child.state, ways, child.remapping)
    return MachineDefinition(
        path=path,
        label=label,
        outcomes=machine.outcomes,
        input_keys=machine.input_keys,
        output_keys=machine.output_keys,
        defaults=machine.userdata.values(),
        children=children,
        initial=machine.children[0].label,
        transitions=transitions,
        remap=remap,
        type_name=type(machine).__name__,
    )
