# SPDX-License-Identifier: BSD-3-Clause
"""Access to ROS for the states of a run: services, the goals that they have sent, and the run of a thread."""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, TypeVar

from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.middleware.default_context import offline_default_context, undiscovered
from flexbt_common.runtime.node_runtime import NodeRuntime, Runtime
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.values.text import short_repr
from flexbt_onboard.errors import OnboardError

_MOST_REMEMBERED: Final = 256
"""Number of latest lines that are remembered as reported to the operator. An older line is reported again if it
recurs."""


def _goes_on() -> Sequence[str]:
    return ('an action has no pause',)


@dataclass(frozen=True)
class _Sent:
    state: EventState | None
    topic: str
    call: ActionCall
    not_paused: Callable[[], Sequence[str]]


class RunGoals:
    """The action goals that the states of a run have sent. From any thread.

    A stop cancels all of them on the calling thread. So even if a callback of a state does not return, its goals and
    those of concurrent states are canceled.
    """

    def __init__(self) -> None:
        self._sent: list[_Sent] = []
        self._told: deque[tuple[str, str]] = deque(maxlen=_MOST_REMEMBERED)
        self._is_stopped = False
        self._lock = threading.Lock()

    def add(
        self, state: EventState | None, topic: str, call: ActionCall, not_paused: Callable[[], Sequence[str]] = _goes_on
    ) -> None:
        """Add a goal that a state has sent.

        ``not_paused`` returns the parts of the goal that continue while the state is paused, or the reasons why it
        continues; an empty sequence if it pauses.
        """
        with self._lock:
            self._sent = [sent for sent in self._sent if not sent.call.done]
            self._sent.append(_Sent(state, topic, call, not_paused))
            is_stopped = self._is_stopped
        if is_stopped:
            call.cancel(None)

    def stop(self) -> None:
        """Cancel all goals, and each goal that is sent from now on."""
        with self._lock:
            self._is_stopped = True
        for sent in self._going_on():
            sent.call.cancel(None)

    def __bool__(self) -> bool:
        """Return whether any goal is not known to have ended."""
        return bool(self._going_on())

    def halting(self, state: EventState) -> str | None:
        """Return a text with the goals of a state whose cancel is not confirmed yet; None for no such goal."""
        waiting = [sent.topic for sent in self._going_on(state) if sent.call.cancel_requested]
        return f'goal of {", ".join(waiting)} not confirmed canceled' if waiting else None

    def not_paused(self, state: EventState) -> list[str]:
        """Return a line "goal of TOPIC: why" for each reason why a goal continues while its state is paused."""
        return [f'goal of {sent.topic}: {why}' for sent in self._going_on(state) for why in sent.not_paused()]

    def untold(self, topic: str, lines: Sequence[str]) -> list[str]:
        """Return the ``lines`` from an action server that were not returned before in this run, in their order.

        So the operator gets each line once, no matter which states receive it and how often.
        """
        with self._lock:
            new = [line for line in dict.fromkeys(lines) if (topic, line) not in self._told]
            self._told += [(topic, line) for line in new]
        return new

    def _going_on(self, state: EventState | None = None) -> list[_Sent]:
        with self._lock:
            sent = list(self._sent)
        return [one for one in sent if not one.call.done and (state is None or one.state is state)]


# The services with which the states of a machine access ROS.

READY_SECONDS: Final = 15.0
"""Time that a live node may take to become ready, s of wall time. Starting takes seconds, and several times as long
on a busy computer."""


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class StateServices:
    """The services of a run. A state gets them with :func:`state_services`.

    - ``runtime`` owns the node, and the thread on which all calls of rclpy happen.
    - ``actions`` and ``services`` are the shared clients.
    - ``node_name`` is the fully qualified name of the node that runs the states. Activities on its behalf in other
      nodes end when it dies.
    - ``changed`` notifies the host that the activity of a state, which operators see, has changed. From any thread.
    - ``unready`` returns the names of nodes that are alive but not ready: they are starting, or late.
    - ``starting`` returns those of them that are starting. The server that a state needs may be one of theirs.
    - ``goals`` are the goals that the states of the run have sent.
    """

    runtime: Runtime
    actions: ActionLinks
    services: ServiceLinks
    node_name: str
    changed: Callable[[], None] = field(default=_nothing)
    unready: Callable[[], Sequence[str]] = field(default=tuple)
    starting: Callable[[], Sequence[str]] = field(default=tuple)
    goals: RunGoals = field(default_factory=RunGoals)

    @classmethod
    def of(cls, runtime: Runtime) -> StateServices:
        """Return the services of a node that does not watch other nodes."""
        return runtime.call(
            lambda: cls(runtime, ActionLinks(runtime), ServiceLinks(runtime), runtime.node.get_fully_qualified_name())
        )


def state_services(state: EventState) -> StateServices:
    """Return the services that a state got from its host.

    Raises:
        TypeError: the state machine runs without ROS.
    """
    services = state.services
    if not isinstance(services, StateServices):
        raise TypeError(
            f'{type(state).__name__} {state.path}: needs ROS; run its machine with StateServices as services, '
            f'not {short_repr(services)}'
        )
    return services


# The run that a thread belongs to, for code of behaviors that gets neither a state nor services.
#
# A behavior is built and run on one thread. A value that is set there is valid for its constructors and callbacks, and
# for no other run. The thread that spins the node belongs to the same run, because of callbacks of topics and timers.
# FlexBE's interfaces need this, since they look up their node themselves.

T = TypeVar('T')


class RunContext:
    """The context of one run for the code of its behavior.

    ``log`` takes severity, path of a state ('' for none) and text.
    """

    def __init__(self, services: Callable[[], StateServices], log: Callable[[Severity, str, str], None]) -> None:
        """``services`` is called on first use of :attr:`services`."""
        self.log = log
        self._make_services = services
        self._shared: dict[Any, Any] = {}
        self._at_end: list[Callable[[], object]] = []

    @cached_property
    def services(self) -> StateServices:
        """Services of the states."""
        services = self._make_services()
        runtime = services.runtime
        runtime.post(lambda: _current.set(self))
        self._at_end.append(lambda: runtime.post(self._leave_thread))
        return services

    def shared(self, make: Callable[[RunContext], T]) -> T:
        """Return the object that ``make`` creates on first use. The whole run shares it."""
        if make not in self._shared:
            self._shared[make] = make(self)
        made: T = self._shared[make]
        return made

    def at_end(self, close: Callable[[], object]) -> None:
        """Register a function to call at the end of the run. The last one registered is called first."""
        self._at_end.append(close)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Make :func:`current_run` return this run on this thread within the block. The run is over at its end."""
        token = _current.set(self)
        _entered.append(self)
        try:
            yield
        finally:
            try:
                while self._at_end:
                    self._close(self._at_end.pop())
            finally:
                _entered.remove(self)
                _current.reset(token)

    def _leave_thread(self) -> None:
        if _current.get() is self:
            _current.set(None)

    def _close(self, close: Callable[[], object]) -> None:
        """Call one of the closing functions, and log its exception, so that the others are still called."""
        try:
            close()
        except BaseException:  # code of the behavior; the run has ended
            self.log(Severity.ERROR, '', f'closing what the run had raised:\n{traceback.format_exc()}')


_current: ContextVar[RunContext | None] = ContextVar('run', default=None)


_entered: Final[list[RunContext]] = []
"""Contexts whose block has not ended, for threads that the code of users has started."""


def current_run() -> RunContext:
    """Return the run of the calling thread. If the thread belongs to no run, return the only run of the process.

    Raises:
        OnboardError: the thread belongs to no run, and the process has no run or several.
    """
    run = _current.get()
    if run is not None:
        return run
    if len(_entered) == 1:
        return _entered[0]
    raise OnboardError(
        'this works only where a behavior is built or run: in its create(), in constructors and callbacks of states, '
        f'and on threads of a process with one run; it has {len(_entered) or "none"}'
    )


# Behaviors that are built and not run, for tools that inspect their state machines.


@contextmanager
def building() -> Iterator[None]:
    """Within the block, allow building behaviors whose constructors need ROS, as those of FlexBE do.

    They get a node when they ask for one, and rclpy's default context. Their nodes neither discover other nodes nor
    are discovered.
    """
    run = RunContext(lambda: _services(run), _say_nothing)
    with offline_default_context(), run.entered():
        yield


def _services(run: RunContext) -> StateServices:
    with undiscovered():
        runtime = NodeRuntime('building', args=())
    run.at_end(runtime.close)
    return StateServices.of(runtime)


def _say_nothing(severity: Severity, path: str, text: str) -> None:
    """Ignore messages that states log in their constructors, since no operator is there to read them."""
