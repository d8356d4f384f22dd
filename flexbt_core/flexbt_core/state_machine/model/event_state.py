# SPDX-License-Identifier: BSD-3-Clause
"""The base of all states, and the skill of a state.

A state is entered, executed when an event concerns it, and left. ``on_exit`` is always called exactly once for each
``on_enter``, and ``exit_reason`` is the reason.

If a callback raises, the operator sees the trace, and the callback is not repeated. A state that raises in on_enter or
execute, or in on_exit while it is left by its own outcome, is left by ``failed``. If it has no such outcome, the run
ends by ``error``, as it does if on_start raises. If the state is left for another reason, an exception in on_exit
does not change the transition.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, ClassVar, Final

from flexbt_core.clock.clock import Clock
from flexbt_core.skills.skill import Outcome, Skill

from .state_host import Progress, Severity, StateHost
from .userdata import StateError, UserData, check_names

DEFAULT_RATE: Final = 10.0
"""Rate at which a state is executed without wake-ups, Hz (as in FlexBE)."""

EXIT_TIMEOUT: Final = 3.0
"""Maximum time for a state to halt after it was left, s."""


class ExitReason(Enum):
    """The reason why a state is being left."""

    OUTCOME = 'the state returned an outcome'
    FORCED = 'the operator forced an outcome'
    PARENT_LEFT = 'a machine around the state was left'
    PREEMPTED = 'the run was stopped'
    FAULT = 'the state, or another one, raised an exception'
    REPEATED = 'the state is entered again'
    TIMED_OUT = 'the time of the state was over'

    @property
    def is_of_the_run(self) -> bool:
        """True if it applies to all states that are left at that moment: the whole run ends."""
        return self in (ExitReason.PREEMPTED, ExitReason.FAULT)


class EventState:
    """The base class of states: derive from it, declare outcomes and keys, and implement callbacks.

    ``outcomes`` are the labels by which the state can be left. The state reads ``input_keys`` from userdata, writes
    ``output_keys``, and does both with ``io_keys``. ``desired_rate`` is the rate in Hz at which ``execute`` is called
    without wake-ups. None is for a state that calls :meth:`wake` on events and uses no processor time between them.
    """

    is_instant: ClassVar[bool] = False
    """True if the state always returns an outcome at its first execution, so that a loop of such states never waits."""

    skill: Skill = Skill()
    """Needs and effects of the state, beyond those shown by its keys and outcomes; see ``flexbt_core.skills``.

    A class declares it; a state created for one object binds it: ``self.skill = self.skill.bound(door=door)``."""

    runs_while_blocked: ClassVar[bool] = False
    """True if the state is still executed while its outcome waits for the operator or a lock.

    By default the state is frozen meanwhile. If it is executed, it may change its outcome: the last returned one
    counts, and None withdraws it.
    """

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
        desired_rate: float | None = DEFAULT_RATE,
    ) -> None:
        both = tuple(io_keys)
        self.outcomes: tuple[str, ...] = tuple(dict.fromkeys(outcomes))
        self.input_keys: tuple[str, ...] = tuple(dict.fromkeys((*input_keys, *both)))
        self.output_keys: tuple[str, ...] = tuple(dict.fromkeys((*output_keys, *both)))
        check_names(self, self.outcomes, (*self.input_keys, *self.output_keys))
        if desired_rate is not None and not desired_rate > 0:
            raise StateError(f'{type(self).__name__}: desired_rate has to be positive, or None, not {desired_rate}')
        self.desired_rate = desired_rate
        self.exit_reason: ExitReason | None = None
        self.is_resumed = False
        """True in and after on_enter if an interrupted run continues in this state."""
        self.__host: StateHost | None = None  # a state of a user may have a _host of its own

    # -- callbacks ---------------------------------------------------------------------------------------------------

    def on_start(self) -> None:
        """Prepare the state. Called once for every state, before the run begins."""

    def on_enter(self, userdata: UserData) -> None:
        """Begin the work of the state. Called when it becomes active."""

    def execute(self, userdata: UserData) -> str | None:
        """Return the outcome by which to leave, or None to stay. Must not block."""
        return None

    def on_exit(self, userdata: UserData) -> None:
        """End the work of the state. Called when it is left; ``self.exit_reason`` is the reason."""

    def on_pause(self) -> None:
        """Pause the work of the state. Called when the run is paused or a priority container is active elsewhere.

        Until it is resumed, the state is not executed, and its ``clock`` and so its timeouts stop. A state that is left
        while it is paused is not resumed.
        """

    def on_resume(self, userdata: UserData) -> None:
        """Resume the work of the state. It is executed soon afterwards."""

    def on_stop(self) -> None:
        """Clean up. Called once for every state, after the run has ended."""

    def halting(self) -> str | None:
        """Return what has not halted yet, such as a goal that is being canceled; None if everything has halted.

        Called after ``on_exit``: the engine waits for None before it continues. Call :meth:`wake` on a change.
        """
        return None

    def activity(self) -> Sequence[str]:
        """Return the current activities of the state, one line each, for the operator.

        Called between the other callbacks, for each status message of the run: it must not block.
        """
        return ()

    def progress(self) -> Progress | None:
        """Return the progress of the work, for the operator; None if unknown. Called like :meth:`activity`."""
        return None

    def not_paused(self) -> Sequence[str]:
        """Return the work that continues while the state is paused, as "what: why", one line each; empty if all of it
        is paused.

        Called between the other callbacks while the state is paused: it must not block.
        """
        return ()

    # -- services of the engine --------------------------------------------------------------------------------------

    @property
    def unwrapped(self) -> EventState:
        """The innermost state if this is a time-out or retry wrapper, else the state itself."""
        return self

    @property
    def bound_to(self) -> StateHost | None:
        """The host of the state in a run; None if it is not part of a run."""
        return self.__host

    def bind(self, host: StateHost | None) -> None:
        """Bind the state to its host in a run, or unbind it with None. For the host of the state."""
        self.__host = host

    @property
    def type_name(self) -> str:
        """Name of this kind of state for people."""
        return type(self).__name__

    @property
    def made_with(self) -> Mapping[str, str]:
        """Values that requirements can refer to: texts, numbers, booleans in its attributes and their dataclasses."""
        found: dict[str, Any] = {}
        for value in vars(self).values():
            if is_dataclass(value) and not isinstance(value, type):
                found |= {one.name: getattr(value, one.name, None) for one in fields(value)}
        found |= {name.lstrip('_'): value for name, value in vars(self).items() if name != 'is_resumed'}
        return {name: str(value) for name, value in found.items() if isinstance(value, str | int | float)}

    @property
    def name(self) -> str:
        """Label of the state in its machine."""
        return self.path.rpartition('/')[2]

    @property
    def path(self) -> str:
        """Path of the state in its run, as in ``/Outer/Inner``."""
        host = self.bound_to
        return host.path if host is not None else type(self).__name__

    @property
    def clock(self) -> Clock:
        """The clock of the run, which stops while the state is paused."""
        return self._bound().clock

    @property
    def services(self) -> Any:
        """Services of the host for the states."""
        return self._bound().services

    def wake(self) -> None:
        """Request a call of ``execute``, or of ``halting``, as soon as possible. Callable from any thread."""
        host = self.bound_to  # read it once: the run may end on its thread meanwhile
        if host is not None:
            host.wake()

    def wake_at(self, time: float) -> None:
        """Request a call of ``execute`` also at ``time`` on the state's clock, in s. Each request holds until its time.

        Call it in on_enter or execute.
        """
        self._bound().wake_at(time)

    def ask(self, prompt: str, suggestion: str | None = None) -> None:
        """Ask the operator for the outcome; the state is not executed meanwhile. Call it in on_enter or execute.

        If the autonomy level allows the ``suggestion``, it is used without asking.
        """
        if suggestion is not None and suggestion not in self.outcomes:
            raise StateError(f'{self.path}: suggests {suggestion!r}, which is none of {", ".join(self.outcomes)}')
        self._bound().ask(str(prompt), suggestion)

    def log(self, severity: Severity, text: str) -> None:
        """Log a line for the operator."""
        self._bound().log(severity, str(text))

    def log_info(self, text: str) -> None:
        """Log information for the operator."""
        self.log(Severity.INFO, text)

    def log_hint(self, text: str) -> None:
        """Log advice for the operator."""
        self.log(Severity.HINT, text)

    def log_warn(self, text: str) -> None:
        """Log a warning for the operator."""
        self.log(Severity.WARN, text)

    def log_error(self, text: str) -> None:
        """Log an error for the operator."""
        self.log(Severity.ERROR, text)

    def _bound(self) -> StateHost:
        host = self.bound_to
        if host is None:
            raise StateError(f'{type(self).__name__}: is not part of a run; this works only in its callbacks')
        return host


_called: ContextVar[EventState | None] = ContextVar('called_state', default=None)


def called_state() -> EventState | None:
    """Return the state whose callback runs, or ran last, on this thread; None before the first callback."""
    return _called.get()


set_called_state = _called.set


# The skill of a state: its declared skill, completed with its keys and outcomes.


def state_skill(state: EventState) -> Skill:
    """Return the skill of a state: that of its class, or its own if it has bound its parameters.

    The skill reads and writes the keys of the state and has its outcomes. The class of an outcome is the declared one,
    or follows from its name.
    """
    inner = state.unwrapped
    # A user's state may use the attribute for another value.
    declared = inner.skill if isinstance(inner.skill, Skill) else Skill()
    skill = declared.completed_by(
        type(inner).__name__, {name: Outcome() for name in state.outcomes}, state.input_keys, state.output_keys
    )
    return skill.lasting(0.0, 0.0) if inner.is_instant else skill
