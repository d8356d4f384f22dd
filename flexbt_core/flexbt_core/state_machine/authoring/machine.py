# SPDX-License-Identifier: BSD-3-Clause
"""Machines and containers in Python, in two forms: FlexBE's context manager with ``add``, and a list of ``children``,
which a type checker understands.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextvars import ContextVar
from types import TracebackType
from typing import Any

from flexbt_core.state_machine.model.autonomy import UNDECLARED
from flexbt_core.state_machine.model.definition import Child, EndCondition, Machine, MachineDefinition, StateKind
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import DefaultUserData, StateMachineError

# Machines with an open ``with`` block, innermost last; per thread and task, so several can be built at the same time.
_open_machines: ContextVar[tuple[OperatableStateMachine, ...]] = ContextVar('open_machines', default=())


class OperatableStateMachine(Machine):
    """A state machine, nested or not. Its first child is the initial one.

    Written as in FlexBE::

        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('Wait', WaitState(2.0), transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Low})

    or all at once::

        machine = OperatableStateMachine(outcomes=['finished'], children=[
            Child('Wait', WaitState(2.0), {'done': 'finished'}, autonomy={'done': Autonomy.Low})])

    ``userdata`` holds the default of each key; ``machine.userdata.key = value`` adds more.
    """

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
        state: EventState | Machine,
        transitions: Mapping[str, str] | None = None,
        autonomy: Mapping[str, int] | None = None,
        remapping: Mapping[str, str] | None = None,
    ) -> EventState | Machine:
        """Add a state to the machine whose ``with`` block this is; the arguments are those of :class:`Child`."""
        machines = _open_machines.get()
        if not machines:
            raise StateMachineError(f"cannot add '{label}': no machine is open; use 'with machine:'")
        machines[-1].add_child(Child(label, state, transitions or {}, autonomy or {}, remapping or {}))
        return state


class ConcurrencyContainer(OperatableStateMachine):
    """A machine whose children are all active at once.

    Each of ``conditions`` pairs an outcome of the container with a list of (child label, child outcome) pairs. As soon
    as all these children have ended so, the container leaves its active children and ends by the outcome. If several
    conditions hold, the first one counts. A child that has ended stays ended until the container is entered again.
    ``transitions`` of a child may lead to outcomes of the container; they are only drawn.

    The children share the userdata of the container. They see each other's writes at once; if several write the same
    key, the last write counts.
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
        autonomy: int = UNDECLARED,
    ) -> None:
        super().__init__(
            outcomes, input_keys, output_keys, io_keys, children=children, userdata=userdata, autonomy=autonomy
        )
        self.conditions = tuple(
            EndCondition(outcome, tuple((label, wanted) for label, wanted in ended)) for outcome, ended in conditions
        )


class PriorityContainer(OperatableStateMachine):
    """A machine that pauses all active states in other children of the containers around it.

    Their on_pause is called, and on_resume when the container was left and has halted. A nested priority container
    has priority over the rest of this one; another one elsewhere is entered after this one has ended.
    """

    kind = StateKind.PRIORITY


# The machine of a behavior inside another one.


def embedded(machine: Machine | MachineDefinition, default_keys: Iterable[str] = ()) -> Machine:
    """Return the machine of another behavior, to be added like a state.

    The machine around it must supply its input keys, except ``default_keys``, which keep the behavior's own values.
    """
    made = _written(machine) if isinstance(machine, MachineDefinition) else machine
    kept = set(default_keys)
    made.input_keys = tuple(key for key in made.input_keys if key not in kept)
    defaults = DefaultUserData()
    for key, value in made.userdata.values().items():
        if key not in made.input_keys:
            defaults[key] = value
    made.userdata = defaults
    return made


def _written(definition: MachineDefinition) -> OperatableStateMachine:
    """Return a machine as it could have been written; it takes over the states of the definition."""
    made = {kind.kind: kind for kind in (OperatableStateMachine, ConcurrencyContainer, PriorityContainer)}[
        definition.kind
    ](definition.outcomes, definition.input_keys, definition.output_keys, userdata=definition.defaults)
    made.conditions = definition.conditions
    for label, child in definition.children.items():
        targets = {outcome: way.state or way.outcome for outcome, way in child.transitions.items()}
        levels = {outcome: way.autonomy for outcome, way in child.transitions.items() if way.autonomy != UNDECLARED}
        transitions = {outcome: target for outcome, target in targets.items() if target is not None}
        state = _written(child) if isinstance(child, MachineDefinition) else child.state
        made.add_child(Child(label, state, transitions, levels, child.remap))
    return made
