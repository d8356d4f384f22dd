# SPDX-License-Identifier: BSD-3-Clause
"""The base of all states, and the skill of a state.

A state is entered, executed whenever something has happened that concerns it, and left: ``on_exit`` is called exactly
once for each ``on_enter``, in every case, and ``exit_reason`` says why.

What a callback raises is shown to the operator with its trace, and the callback is not repeated: a state that raises
in on_enter, in execute, or in on_exit on its way out by an outcome of its own, is left by ``failed``; when it has no
such outcome, the run ends by ``error``, as it does when on_start raises. If the state is left by another
decision, that stands.
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
from .userdata import StateError, UserData

DEFAULT_RATE: Final = 10.0
"""Rate at which a state is executed while nothing wakes it, Hz (as in FlexBE)."""

EXIT_TIMEOUT: Final = 3.0
"""Time that a state that was left may take to halt, s."""


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
    """The base of your own states: derive from it, declare outcomes and keys, and implement callbacks.

    ``outcomes`` are the labels by which the state can be left. ``input_keys`` are read from userdata, ``output_keys``
    written, ``io_keys`` both. ``desired_rate`` is the rate in Hz at which ``execute`` is called while nothing wakes the
    state; None for a state that calls :meth:`wake` when something has happened, and costs nothing meanwhile.
    """

    is_instant: ClassVar[bool] = False
    """True if the state always leaves when it is first executed, so that a loop of such states never waits."""

    skill: Skill = Skill()
    """Needs and effects of the state, beyond those shown by its keys and outcomes; see ``flexbt_core.skills``.

    A class declares it; a state that was made for one object binds it: ``self.skill = self.skill.bound(door=door)``."""

    runs_while_blocked: ClassVar[bool] = False
    """True if it is still executed while its outcome waits for the operator, or while a lock keeps it.

    By default a state is frozen then. One that is not may change its outcome: the last one that it returns counts,
    and None withdraws the outcome.
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
        if desired_rate is not None and not desired_rate > 0:
            raise StateError(f'{type(self).__name__}: desired_rate has to be positive, or None, not {desired_rate}')
        self.desired_rate = desired_rate
        self.exit_reason: ExitReason | None = None
        self.is_resumed = False
        """True in and after on_enter if an interrupted run continues in this state."""
        self._host: StateHost | None = None

    # -- callbacks ---------------------------------------------------------------------------------------------------

    def on_start(self) -> None:
        """Prepare the state; called once before the run begins, for every state."""

    def on_enter(self, userdata: UserData) -> None:
        """Begin the work of the state, which becomes active."""

    def execute(self, userdata: UserData) -> str | None:
        """Return the outcome by which to leave, or None to stay. Must not block."""
        return None

    def on_exit(self, userdata: UserData) -> None:
        """End the work of the state, which is left; ``self.exit_reason`` says why."""

    def on_pause(self) -> None:
        """Pause the work of the state: the run is, or something else has priority. It is not executed until it is
        resumed.

        Its ``clock`` stands still meanwhile, so that its timeouts do. A state may be left while it is paused, and is
        not resumed then.
        """

    def on_resume(self, userdata: UserData) -> None:
        """Go on with the work of the state, which is executed soon."""

    def on_stop(self) -> None:
        """Clean up; called once after the run has ended, for every state."""

    def halting(self) -> str | None:
        """After ``on_exit``: what has not halted yet, such as a goal that is being canceled; None when everything has.

        The engine waits for it before it goes on. Call :meth:`wake` when it changes.
        """
        return None

    def activity(self) -> Sequence[str]:
        """Return what the state is doing, one line each, for the operator.

        Called between the other callbacks, with each status of the run: it must not block.
        """
        return ()

    def progress(self) -> Progress | None:
        """Return how far it has come, for the operator; None when it cannot tell. Called as :meth:`activity` is."""
        return None

    def not_paused(self) -> Sequence[str]:
        """Return what goes on although the state is paused, as "what: why", one line each; empty when all of it stands
        still.

        Called between the other callbacks while the state is paused: it must not block.
        """
        return ()

    # -- services of the engine --------------------------------------------------------------------------------------

    @property
    def unwrapped(self) -> EventState:
        """The state itself, or the one that this state is a time-out or further attempts around."""
        return self

    @property
    def bound_to(self) -> StateHost | None:
        """Place of the state in a run; None while it is part of none."""
        return self._host

    def bind(self, host: StateHost | None) -> None:
        """Be part of a run, at this place; None: of none any more. For the host of the state."""
        self._host = host

    @property
    def type_name(self) -> str:
        """Name of this kind of state for people."""
        return type(self).__name__

    @property
    def made_with(self) -> Mapping[str, str]:
        """Values that requirements can refer to: texts, numbers, booleans among its attributes, and in dataclasses."""
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
        """The clock of the run, which stands still while the state is paused."""
        return self._bound().clock

    @property
    def services(self) -> Any:
        """Services that the host provides to the states."""
        return self._bound().services

    def wake(self) -> None:
        """Have the state executed, or asked whether it is halting, as soon as possible. From any thread."""
        host = self.bound_to  # the run may end on its thread meanwhile
        if host is not None:
            host.wake()

    def wake_at(self, time: float) -> None:
        """Have the state executed at a time of the clock, too: each requested time holds until it has come.

        Call it in on_enter or execute.
        """
        self._bound().wake_at(time)

    def ask(self, prompt: str, suggestion: str | None = None) -> None:
        """Let the operator choose the outcome; the state is not executed meanwhile. Call it in on_enter or execute.

        A ``suggestion`` is taken without asking when the autonomy allows that outcome.
        """
        if suggestion is not None and suggestion not in self.outcomes:
            raise StateError(f'{self.path}: suggests {suggestion!r}, which is none of {", ".join(self.outcomes)}')
        self._bound().ask(prompt, suggestion)

    def log(self, severity: Severity, text: str) -> None:
        """Tell the operator something."""
        self._bound().log(severity, text)

    def log_info(self, text: str) -> None:
        """Tell the operator something."""
        self.log(Severity.INFO, text)

    def log_hint(self, text: str) -> None:
        """Advise the operator."""
        self.log(Severity.HINT, text)

    def log_warn(self, text: str) -> None:
        """Warn the operator."""
        self.log(Severity.WARN, text)

    def log_error(self, text: str) -> None:
        """Tell the operator that something went wrong."""
        self.log(Severity.ERROR, text)

    def _bound(self) -> StateHost:
        host = self.bound_to
        if host is None:
            raise StateError(f'{type(self).__name__}: is not part of a run; this works only in its callbacks')
        return host


_called: ContextVar[EventState | None] = ContextVar('called_state', default=None)


def called_state() -> EventState | None:
    """Return the state whose callback is being called on this thread, or was called last; None before the first one."""
    return _called.get()


set_called_state = _called.set


# The skill of a state: what it declares, completed by its keys and outcomes.


def state_skill(state: EventState) -> Skill:
    """Return the skill of a state as it was made: of the class, or its own where it has bound what it was made with.

    It reads and writes its keys, and ends by its outcomes, which mean what is declared, or what their names say.
    """
    inner = state.unwrapped
    # The attribute of a user's state may be something else.
    declared = inner.skill if isinstance(inner.skill, Skill) else Skill()
    skill = declared.completed_by(
        type(inner).__name__, {name: Outcome() for name in state.outcomes}, state.input_keys, state.output_keys
    )
    return skill.lasting(0.0, 0.0) if inner.is_instant else skill
