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
from flexbt_core.state_machine.model.definition import Child, EndCondition, Machine, StateKind
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import StateMachineError

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
