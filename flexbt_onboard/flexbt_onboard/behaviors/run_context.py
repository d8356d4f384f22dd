# SPDX-License-Identifier: BSD-3-Clause
"""The things that the host of a run gives to its states: services to reach ROS, the goals it tracks, and the run of a
thread."""

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
"""Maximum number of lines, the latest, that are remembered as reported to the operator. An older line that recurs is
reported again."""


def _goes_on() -> Sequence[str]:
    return ('an action has no pause',)


@dataclass(frozen=True)
class _Sent:
    state: EventState | None
    topic: str
    call: ActionCall
    not_paused: Callable[[], Sequence[str]]


class RunGoals:
    """The goals that the states of a run have sent. From any thread.

    A stop cancels them all on the thread that tells it: even if a state does not return from a callback, its goals and
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
        """Add a goal that a state has sent. ``not_paused`` says why it goes on while the state is paused, or what of it
        does; nothing if it does not."""
        with self._lock:
            self._sent = [sent for sent in self._sent if not sent.call.done]
            self._sent.append(_Sent(state, topic, call, not_paused))
            is_stopped = self._is_stopped
        if is_stopped:
            call.cancel(None)

    def stop(self) -> None:
        """Cancel all goals, and each that is sent from now on."""
        with self._lock:
            self._is_stopped = True
        for sent in self._going_on():
            sent.call.cancel(None)

    def __bool__(self) -> bool:
        """Return whether a goal is not known to have ended."""
        return bool(self._going_on())

    def halting(self, state: EventState) -> str | None:
        """Return which goals of a state were canceled, and are not confirmed to have ended; None when there is none."""
        waiting = [sent.topic for sent in self._going_on(state) if sent.call.cancel_requested]
        return f'goal of {", ".join(waiting)} not confirmed canceled' if waiting else None

    def not_paused(self, state: EventState) -> list[str]:
        """Return which goals of a state go on while it is paused, as "goal of TOPIC: why"; a line for each reason."""
        return [f'goal of {sent.topic}: {why}' for sent in self._going_on(state) for why in sent.not_paused()]

    def untold(self, topic: str, lines: Sequence[str]) -> list[str]:
        """Return those of ``lines`` from the server of an action that no state of the run was given yet, in their
        order: the operator gets each once, whichever states receive it, and however often."""
        with self._lock:
            new = [line for line in dict.fromkeys(lines) if (topic, line) not in self._told]
            self._told += [(topic, line) for line in new]
        return new

    def _going_on(self, state: EventState | None = None) -> list[_Sent]:
        with self._lock:
            sent = list(self._sent)
        return [one for one in sent if not one.call.done and (state is None or one.state is state)]


# What the host of a state machine gives to its states: their way to ROS.

READY_SECONDS: Final = 15.0
"""Time for which a node that is alive may take to become ready, s of wall time. Starting takes seconds, and several
times as long on a busy machine."""


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class StateServices:
    """The services of a run; a state gets it with :func:`state_services`.

    ``runtime`` owns the node and the thread on which everything of rclpy happens, ``actions`` and ``services`` are
    the shared clients, and ``node_name`` is the fully qualified name of the node that runs the states: what
    happens on its behalf elsewhere ends when it dies. ``changed`` tells the host, from any thread, that something
    that the operator is shown has changed: the state's activity. ``unready`` names the nodes that are alive but not
    ready yet: the servers that a state wants may be among them. ``goals`` are those that the states of the run have
    sent.
    """

    runtime: Runtime
    actions: ActionLinks
    services: ServiceLinks
    node_name: str
    changed: Callable[[], None] = field(default=_nothing)
    unready: Callable[[], Sequence[str]] = field(default=tuple)
    goals: RunGoals = field(default_factory=RunGoals)

    @classmethod
    def of(cls, runtime: Runtime) -> StateServices:
        """Return those of a node that knows nothing of others."""
        return runtime.call(
            lambda: cls(runtime, ActionLinks(runtime), ServiceLinks(runtime), runtime.node.get_fully_qualified_name())
        )


def state_services(state: EventState) -> StateServices:
    """Return the services that a state was given by its host.

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


# The run on whose thread some code is, for code of behaviors that is handed neither a state nor services.
#
# A behavior is built and run on one thread, so that what is set there holds for its constructors and callbacks, and for
# no other run. The thread that spins the node belongs to the same run, for callbacks of topics and timers. FlexBE's
# interfaces need it: they find their node by themselves.

T = TypeVar('T')


class RunContext:
    """One run, as seen by what its behavior is made of.

    ``log`` takes severity, path of a state ('' for none) and text.
    """

    def __init__(self, services: Callable[[], StateServices], log: Callable[[Severity, str, str], None]) -> None:
        """``services`` is called when the services of the states are asked for first."""
        self.log = log
        self._make_services = services
        self._shared: dict[Any, Any] = {}
        self._at_end: list[Callable[[], object]] = []

    @cached_property
    def services(self) -> StateServices:
        """The services of the states."""
        services = self._make_services()
        runtime = services.runtime
        runtime.post(lambda: _current.set(self))
        self._at_end.append(lambda: runtime.post(self._leave_thread))
        return services

    def shared(self, make: Callable[[RunContext], T]) -> T:
        """Return what ``make`` gave when it was asked for first: one for the whole run."""
        if make not in self._shared:
            self._shared[make] = make(self)
        made: T = self._shared[make]
        return made

    def at_end(self, close: Callable[[], object]) -> None:
        """Have something closed when the run is over, in reverse order."""
        self._at_end.append(close)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """For the length of the block, :func:`current_run` gives this run on this thread; then it is over."""
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
        """Close one, and log what it raises, so that the others are closed as well."""
        try:
            close()
        except BaseException:  # code of the behavior; the run has ended
            self.log(Severity.ERROR, '', f'closing what the run had raised:\n{traceback.format_exc()}')


_current: ContextVar[RunContext | None] = ContextVar('run', default=None)


_entered: Final[list[RunContext]] = []
"""Contexts whose block has not ended, for threads that users' code has started."""


def current_run() -> RunContext:
    """Return the run on whose thread this is; on a thread of nobody's, the only run of the process.

    Raises:
        OnboardError: the thread belongs to no run, and there is none or there are several.
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


# Behaviors that are built and never run: for tools that inspect their state machines.


@contextmanager
def building() -> Iterator[None]:
    """For the length of the block behaviors can be built whose constructors want ROS, as FlexBE's do.

    They get a node when they ask for one, and rclpy's default context. Their nodes discover nobody and are discovered
    by nobody.
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
    """Ignore what states log in their constructors: it is for the operator of a run."""
