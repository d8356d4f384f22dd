# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's EventState and containers: the engine's, with the names that FlexBE's states and behaviors use.

FlexBE keeps its node in class attributes, so that a process can have one. Here the same attributes are looked up when
they are read, in the run on whose thread that happens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from flexbt_core.state_machine.authoring import machine
from flexbt_core.state_machine.model import event_state
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.userdata import StateError
from flexbt_onboard.behaviors.run_context import current_run

from .topic_proxies import ProxyPublisher, ProxySubscriberCached, lacks_of


class _RunNode:
    """A class attribute that is the node of the current run: ``self._node`` and ``MyState._node``."""

    def __get__(self, instance: object, owner: type[Any]) -> Any:
        return current_run().services.runtime.node


class RosAccess:
    """Base of what FlexBE initializes with a node."""

    _node = _RunNode()

    @staticmethod
    def initialize_ros(node: Any) -> None:
        """Do nothing, since the node is that of the run; behaviors written by FlexBE's editor call it."""


# FlexBE's EventState: the engine's, with the names that FlexBE's states use.


class _Provided:
    """An attribute that every state has, and that a state may set to its own value."""

    def __init__(self, value_of: Callable[[Any], Any]) -> None:
        self._value_of = value_of

    def __get__(self, state: Any, owner: type[Any]) -> Any:
        return self if state is None else self._value_of(state)


class EventState(RosAccess, event_state.EventState):
    """Base of FlexBE's states.

    It is executed at its rate (10 Hz, or ``desired_rate``), as in FlexBE, and besides whenever something arrives that
    it has asked a proxy about: a result, feedback, a message.

    As in FlexBE it is executed on while its outcome waits for the operator: it may take the outcome back by giving
    None, and may have to go on, for instance with commands that keep a robot where it is.
    """

    runs_while_blocked = True

    # FlexBE has nothing of these names, so that its states may have something else under them.
    clock = _Provided(lambda state: state._bound().clock)
    services = _Provided(lambda state: state._bound().services)

    _name = _Provided(lambda state: state.name)
    _outcomes = _Provided(lambda state: list(state.outcomes))
    _input_keys = _Provided(lambda state: list(state.input_keys))
    _output_keys = _Provided(lambda state: list(state.output_keys))
    _pub = _Provided(lambda state: ProxyPublisher())
    _sub = _Provided(lambda state: ProxySubscriberCached())
    _manual_transition_requested = _Provided(
        lambda state: state._bound().outcome if state.exit_reason is ExitReason.FORCED else None
    )

    def set_rate(self, desired_rate: float) -> None:
        """How often the state is executed while nothing wakes it, Hz.

        Raises:
            StateError: it is not positive.
        """
        if not desired_rate > 0:
            raise StateError(f'{self.path}: the rate has to be positive, not {desired_rate} Hz')
        self.desired_rate = desired_rate

    def activity(self) -> Sequence[str]:
        """Topics that the state waits for and that cannot reach it."""
        return lacks_of(self)

    def halting(self) -> str | None:
        """Goals that the state has canceled are waited for; when the run ends, none is left behind."""
        goals = current_run().services.goals
        if self.exit_reason is not None and self.exit_reason.is_of_the_run:
            goals.stop()
        return goals.halting(self)


# FlexBE's containers: the engine's, with what behaviors written by FlexBE's editor call.


class OperatableStateMachine(RosAccess, machine.OperatableStateMachine):
    """A state machine; see :class:`OperatableStateMachine`."""


class ConcurrencyContainer(RosAccess, machine.ConcurrencyContainer):
    """Its children run at the same time; see :class:`ConcurrencyContainer`."""


class PriorityContainer(RosAccess, machine.PriorityContainer):
    """Everything else is paused meanwhile; see :class:`PriorityContainer`."""
