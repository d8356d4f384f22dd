# SPDX-License-Identifier: BSD-3-Clause
"""Machines and containers as they are written. :func:`define` makes a checked definition of one.

There are two forms of the same: FlexBE's context manager with ``add``, and ``children`` that are given at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from types import MappingProxyType, TracebackType
from typing import Any, ClassVar, TypeVar

from flexbt_core.state_machine.checks.data_flow import problems_of_reads
from flexbt_core.state_machine.checks.machine_check import problems_of
from flexbt_core.state_machine.model.autonomy import UNDECLARED
from flexbt_core.state_machine.model.definition import (
    ROOT_PATH,
    Condition,
    MachineDefinition,
    StateDefinition,
    StateKind,
    Transition,
    child_path,
)
from flexbt_core.state_machine.model.errors import MachineError, StateMachineError
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import DefaultUserData

# Which machines are open, innermost last; per thread and task, so that several can be built at the same time.
_open_machines: ContextVar[tuple[OperatableStateMachine, ...]] = ContextVar('open_machines', default=())

_Key = TypeVar('_Key')
_Value = TypeVar('_Value')


@dataclass(frozen=True)
class Child:
    """A state or machine in a machine.

    ``transitions`` leads each outcome of it to the label of another child, or to an outcome of the machine;
    ``autonomy`` gives the level that each outcome requires; ``remapping`` maps its keys to those of the machine.
    """

    label: str
    state: EventState | OperatableStateMachine
    transitions: Mapping[str, str] = field(default_factory=dict)
    autonomy: Mapping[str, int] = field(default_factory=dict)
    remapping: Mapping[str, str] = field(default_factory=dict)


class OperatableStateMachine:
    """A state machine, or a state that is one. Its first child is the initial one.

    Either as in FlexBE::

        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('Wait', WaitState(2.0), transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Low})

    or all at once::

        machine = OperatableStateMachine(outcomes=['finished'], children=[
            Child('Wait', WaitState(2.0), {'done': 'finished'}, autonomy={'done': Autonomy.Low})])

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
            self._add(child)

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
        transitions: Mapping[str, str] | None = None,
        autonomy: Mapping[str, int] | None = None,
        remapping: Mapping[str, str] | None = None,
    ) -> EventState | OperatableStateMachine:
        """Add a state to the machine whose ``with`` block this is; the arguments are those of :class:`Child`."""
        machines = _open_machines.get()
        if not machines:
            raise StateMachineError(f"cannot add '{label}': no machine is open; use 'with machine:'")
        machines[-1]._add(Child(label, state, transitions or {}, autonomy or {}, remapping or {}))
        return state

    def _add(self, child: Child) -> None:
        given: Any = child.state
        if not isinstance(given, EventState | OperatableStateMachine):
            raise StateMachineError(
                f"cannot add '{child.label}': {given!r:.80} is neither a state object nor a machine"
            )
        own = dict(child.transitions), dict(child.autonomy), dict(child.remapping)
        self.children.append(Child(child.label, child.state, *own))


class ConcurrencyContainer(OperatableStateMachine):
    """A machine all children of which are active at once.

    ``conditions`` are pairs of an outcome of the container and a list of pairs, label of a child and an outcome of it:
    as soon as all of those have ended so, what is still active is left, and the container ends by the outcome. Of
    several conditions that hold the first one counts. A child that has ended stays so until the container is entered
    again. ``transitions`` of a child may name outcomes of the container; they are only drawn.

    The children share the userdata of the container. What one writes the others read from then on; where several write
    the same key, the last one counts.
    """

    kind = StateKind.CONCURRENCY

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
        conditions: Iterable[tuple[str, Iterable[tuple[str, str]]]] = (),
        *,
        children: Iterable[Child] = (),
        userdata: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(outcomes, input_keys, output_keys, io_keys, children=children, userdata=userdata)
        self.conditions = tuple(
            Condition(outcome, tuple((label, wanted) for label, wanted in ended)) for outcome, ended in conditions
        )


class PriorityContainer(OperatableStateMachine):
    """A machine during which everything stands still that is active in other children of the containers around it.

    That is told by on_pause, and by on_resume when the container was left and is at rest. A priority container in it
    has priority over the rest of it; one elsewhere is entered when this one is over.
    """

    kind = StateKind.PRIORITY


def define(machine: OperatableStateMachine) -> MachineDefinition:
    """Check a machine as a whole and make its definition.

    Raises:
        MachineError: with every problem of it.
    """
    problems = list(problems_of(machine))
    if problems:
        raise MachineError(problems)
    definition = _define(machine, ROOT_PATH, '', {}, {})
    problems = list(problems_of_reads(definition))
    if problems:
        raise MachineError(problems)
    return definition


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
        ways = {outcome: _transition(machine, labels, child, outcome) for outcome in child.state.outcomes}
        if isinstance(child.state, OperatableStateMachine):
            children[child.label] = _define(child.state, own, child.label, ways, child.remapping)
        else:
            children[child.label] = StateDefinition(
                own, child.label, child.state, _fixed(ways), _fixed(child.remapping)
            )
    return MachineDefinition(
        path=path,
        label=label,
        outcomes=machine.outcomes,
        input_keys=machine.input_keys,
        output_keys=machine.output_keys,
        defaults=_fixed(machine.userdata.values()),
        children=_fixed(children),
        initial=machine.children[0].label,
        transitions=_fixed(transitions),
        remap=_fixed(remap),
        type_name=type(machine).__name__,
        kind=machine.kind,
        conditions=machine.conditions,
    )


def _transition(machine: OperatableStateMachine, labels: set[str], child: Child, outcome: str) -> Transition:
    target = child.transitions.get(outcome)
    if machine.kind is StateKind.CONCURRENCY and target is None:  # drawn to what it contributes to
        ended = child.label, outcome
        target = next((one.outcome for one in machine.conditions if ended in one.children), None)
    level = child.autonomy.get(outcome, UNDECLARED)
    return Transition(target, None, level) if target in labels else Transition(None, target, level)


def _fixed(mapping: Mapping[_Key, _Value]) -> Mapping[_Key, _Value]:
    return MappingProxyType(dict(mapping))
