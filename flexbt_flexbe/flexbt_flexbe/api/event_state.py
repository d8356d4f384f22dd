# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's EventState and containers: those of the engine, with the names that FlexBE's states and behaviors use.

FlexBE stores its node in class attributes, which allows one node per process. Here a read of such an attribute returns
the node of the run on the current thread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from types import EllipsisType
from typing import Any

from flexbt_core.state_machine.authoring import machine
from flexbt_core.state_machine.model import event_state
from flexbt_core.state_machine.model.event_state import DEFAULT_RATE, ExitReason
from flexbt_core.state_machine.model.userdata import StateError
from flexbt_onboard.behaviors.run_context import RunContext, current_run
from flexbt_onboard.errors import OnboardError

from .topic_proxies import ProxyPublisher, ProxySubscriberCached, lacks_of


class _RunNode:
    """A class attribute that returns the node of the current run, for ``self._node`` and ``MyState._node``."""

    def __get__(self, instance: object, owner: type[Any]) -> Any:
        return current_run().services.runtime.node


class RosAccess:
    """The base of classes that FlexBE initializes with a node."""

    _node = _RunNode()

    @staticmethod
    def initialize_ros(node: Any) -> None:
        """Do nothing: the run provides the node. Behaviors from FlexBE's editor call this method."""


# FlexBE's EventState: that of the engine, with the names that FlexBE's states use.


class _Provided:
    """An attribute of every state, which a state may overwrite."""

    def __init__(self, value_of: Callable[[Any], Any]) -> None:
        self._value_of = value_of

    def __get__(self, state: Any, owner: type[Any]) -> Any:
        return self if state is None else self._value_of(state)


class _DefaultRate:
    """The rate of the states of a run that have no ``desired_rate``, Hz."""

    def __init__(self, run: RunContext) -> None:
        self.hz = DEFAULT_RATE


def _default_rate() -> float:
    try:
        return current_run().shared(_DefaultRate).hz
    except OnboardError:  # a state that is created outside of a run, as in a test
        return DEFAULT_RATE


def _checked_rate(owner: str, rate: float) -> float:
    if not rate > 0:
        raise StateError(f'{owner}: the rate has to be positive, not {rate} Hz')
    return rate


class EventState(RosAccess, event_state.EventState):
    """The base class of FlexBE's states.

    As in FlexBE, it is executed at its rate (10 Hz, or ``desired_rate``). It is also executed when data arrives that it
    has asked a proxy about: a result, feedback, a message.

    As in FlexBE, it is still executed while its outcome waits for the operator. It may withdraw the outcome by
    returning None, and can continue its work, for example to send commands that hold a robot in place.
    """

    runs_while_blocked = True

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
        desired_rate: float | EllipsisType | None = ...,
    ) -> None:
        """Without ``desired_rate`` the state has the default rate."""
        rate = _default_rate() if desired_rate is ... else desired_rate
        super().__init__(outcomes, input_keys, output_keys, io_keys, rate)

    # FlexBE does not use these names, so its states may use them for other values.
    clock = _Provided(lambda state: state._bound().clock)
    services = _Provided(lambda state: state._bound().services)

    _name = _Provided(lambda state: state.name)
    _outcomes = _Provided(lambda state: list(state.outcomes))
    _input_keys = _Provided(lambda state: list(state.input_keys))
    _output_keys = _Provided(lambda state: list(state.output_keys))
    _pub: cached_property[Any] = cached_property(lambda state: ProxyPublisher())
    _sub: cached_property[Any] = cached_property(lambda state: ProxySubscriberCached())
    _manual_transition_requested = _Provided(
        lambda state: state._bound().outcome if state.exit_reason is ExitReason.FORCED else None
    )

    @classmethod
    def set_default_rate(cls, desired_rate: float) -> None:
        """Set the rate in Hz of the states that the run creates from now on.

        Raises:
            StateError: the rate is not positive.
        """
        current_run().shared(_DefaultRate).hz = _checked_rate(cls.__name__, desired_rate)

    def set_rate(self, desired_rate: float) -> None:
        """Set the rate in Hz at which the state is executed without wake-ups.

        Raises:
            StateError: the rate is not positive.
        """
        self.desired_rate = _checked_rate(self.path, desired_rate)

    def activity(self) -> Sequence[str]:
        """Return the topics that the state waits for but cannot receive."""
        return lacks_of(self)

    def halting(self) -> str | None:
        """Return the canceled goals that have not ended. When the run ends, stop its goals."""
        goals = current_run().services.goals
        if self.exit_reason is not None and self.exit_reason.is_of_the_run:
            goals.stop()
        return goals.halting(self)


# FlexBE's containers: those of the engine, with the methods that behaviors from FlexBE's editor call.


class OperatableStateMachine(RosAccess, machine.OperatableStateMachine):
    """A state machine; see :class:`OperatableStateMachine`."""


class ConcurrencyContainer(RosAccess, machine.ConcurrencyContainer):
    """A container whose children run at the same time; see :class:`ConcurrencyContainer`."""


class PriorityContainer(RosAccess, machine.PriorityContainer):
    """A container that pauses everything else; see :class:`PriorityContainer`."""
