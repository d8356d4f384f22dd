# SPDX-License-Identifier: BSD-3-Clause
"""The interface of a run for its regions, containers and leaves, and the time-out for halting."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.clock.clock import Clock, Timer
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.state_machine.model.autonomy import Decision, DecisionKind
from flexbt_core.state_machine.model.definition import ERROR
from flexbt_core.state_machine.model.event_state import EXIT_TIMEOUT, ExitReason

from .controls import Controls, Pausing
from .events import Faulted, RunEvent, RunReader

STOP_TIMEOUT: Final = 30.0
"""Time that the end of a run waits for the confirmation that everything has halted, s."""

MAX_TRANSITIONS: Final = 1000
"""Number of transitions in one step, without waiting, that counts as a livelock."""

_LOOP_SHOWN: Final = 10


@dataclass(frozen=True, slots=True)
class RunLimits:
    """Limits of a run: seconds for a state to halt and for the whole run to end, and transitions per step.

    More transitions in one step are a livelock, which ends the run.
    """

    exit_timeout: float = EXIT_TIMEOUT
    stop_timeout: float = STOP_TIMEOUT
    transitions: int = MAX_TRANSITIONS


@dataclass(frozen=True, slots=True)
class RunEnd:
    """The end of a run, with the reason that its states get in on_exit."""

    outcome: str
    message: str
    reason: ExitReason


RunningCallback = tuple[str, str]
"""One call of a callback of a state: path and name. Compare it by identity: each call makes a new object. It is a
tuple because that takes an eighth of the time of a class, for each call."""


class Engine(ABC):
    """The interface of a run for its parts. Call everything except :meth:`wake` on the thread of the run."""

    def __init__(
        self,
        clock: Clock,
        steady: Clock,
        controls: Controls,
        services: Any,
        limits: RunLimits,
        wake_event: WakeEvent | None,
        readers: Iterable[RunReader],
    ) -> None:
        self.clock = clock
        self.services = services
        self.controls = controls
        self.pausing = Pausing()
        self.readings: defaultdict[type[RunEvent], list[Callable[[Any], None]]] = defaultdict(list)
        """Methods of the readers, by event type."""
        self.calling: RunningCallback | None = None
        """The running callback of a state; other threads may read it."""
        self.decision_count = 0
        """Number of decisions that the run has requested from the operator; the next one gets the next number as id."""
        self._steady = steady
        self._limits = limits
        self._wake_event = wake_event
        self._readers: list[RunReader] = []
        self._transitions = self._repetitions = 0
        self._recent: deque[str] = deque(maxlen=_LOOP_SHOWN)
        self._end: RunEnd | None = None
        for reader in readers:
            self.add_reader(reader)

    def wake(self) -> None:
        """Request a step from the host. Callable from any thread."""
        if self._wake_event is not None:
            self._wake_event.set()

    def tell(self, event: RunEvent) -> None:
        """Pass an event to its readers, in order."""
        for read in self.readings[type(event)]:
            read(event)

    def add_reader(self, reader: RunReader) -> None:
        """Pass future events of the run to a reader."""
        self._readers.append(reader)
        for kind, read in reader.methods().items():
            self.readings[kind].append(read)

    def fail(self, message: str) -> None:
        """End the run with the outcome 'error', since it cannot continue."""
        if self._end is None:
            self._end = RunEnd(ERROR, message, ExitReason.FAULT)

    def new_decision(
        self, kind: DecisionKind, path: str, outcome: str, outcomes: tuple[str, ...], required: int, prompt: str
    ) -> Decision:
        """Return a decision with a new id. The caller asks the operator."""
        self.decision_count += 1
        number = str(self.decision_count)
        return Decision(number, kind, path, outcome, outcomes, required, prompt, self.clock.now())

    def new_halt_wait(self) -> HaltTimeout:
        """Return a time-out for a child that is left to halt; it wakes the run when the time is up."""
        return HaltTimeout(self._steady, self._limits.exit_timeout, self.wake)

    def count_transition(self, path: str) -> None:
        """Count a transition, and end the run if it is in a livelock."""
        self._transitions += 1
        self._repetitions = 0
        self._recent.append(path)
        if self._transitions > self._limits.transitions:
            loop = ', '.join(dict.fromkeys(self._recent))
            text = f'{self._limits.transitions} transitions without waiting for anything'
            self.tell(Faulted(path, text))
            self.fail(f'livelock: {text}, the last of them from {loop}')

    def goes_on(self) -> bool:
        """Return whether the step may go on with another execution of a state that waits for nothing.

        After many of them without a transition the host gets its turn: they are no livelock, since a state counts them.
        """
        self._repetitions += 1
        return self._repetitions <= self._limits.transitions

    @abstractmethod
    def locked_inside(self, top: str) -> list[str]:
        """Return the active and locked nodes in a state or machine, itself included. A node that was active in an
        interrupted run is active before this run has entered it again."""


# A state that was left may need time to halt, such as to cancel a goal, but it must not block the run forever.


class HaltTimeout:
    """A time-out of ``timeout`` seconds for one halt at a time; calls ``wake`` when it expires."""

    def __init__(self, steady: Clock, timeout: float, wake: Callable[[], None]) -> None:
        self.timeout = timeout
        self._steady = steady
        self._wake = wake
        self._until: float | None = None
        self._timer: Timer | None = None

    def is_over(self, halting: str | None) -> bool:
        """Return whether to continue: nothing is ``halting``, or the time is up. The first False starts the time."""
        if halting is not None:
            if self._until is None:
                self._until = self._steady.now() + self.timeout
                self._timer = self._steady.call_at(self._until, self._wake)
            if self._steady.now() < self._until:
                return False
        if self._until is not None:
            self.cancel()
        return True

    def cancel(self) -> None:
        """Stop waiting; the next wait has its full time again."""
        self._until = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
