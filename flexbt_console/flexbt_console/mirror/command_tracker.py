# SPDX-License-Identifier: BSD-3-Clause
"""The result of each command that was sent: pending, then applied, refused, or unanswered."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from .records import CommandKind, ExecutiveSnapshot, OperatorCommand, ResultCode, StopGuard

FIRST_RESEND: Final = 0.15
"""Time until an unanswered command is sent again, s; doubled each time."""

LONGEST_RESEND: Final = 1.0
"""Maximum time between two sends of the same command, s."""

_DOUBLINGS: Final = 10
"""Number of doublings after which the time between two sends is the longest; a command may wait for its answer for
hours."""

ANSWER_SECONDS: Final = 3.0
"""Time within which an executive answers a STOP, s, whatever its behavior and its disk do (other commands wait for the
behavior). A later status without the answer is not from the executive that has received it."""


class Confirmation(Enum):
    """The source of the answer that a command has had its effect.

    The stop guard carries out a STOP that the executive has not answered.
    """

    EXECUTIVE = 'executive'
    STOP_GUARD = 'stop guard'


class CommandState(Enum):
    """The state of a command. TIMEOUT: no answer arrived; the command may have had its effect or not."""

    PENDING = 'pending'
    APPLIED = 'applied'
    REFUSED = 'refused'
    TIMEOUT = 'timeout'


@dataclass(frozen=True, slots=True)
class TrackedCommand:
    """A command and its result; ``label`` is what the operator calls it, times are in seconds on the tracker's clock.

    ``confirmed_by`` says who has applied it, ``run_id`` is the run that the status with the answer shows.
    """

    command: OperatorCommand
    label: str
    given: float
    deadline: float
    state: CommandState = CommandState.PENDING
    reason: str = ''
    sends: int = 0
    next_send: float = 0.0
    is_passed_over: bool = False
    confirmed_by: Confirmation | None = None
    settled: float | None = None
    run_id: str = ''

    @property
    def duration(self) -> float | None:
        """Seconds from the command to its answer, or None before that."""
        return None if self.settled is None else self.settled - self.given


class CommandTracker:
    """The commands of this operator: the latest ``remembered``, and all that wait. Not thread-safe by itself."""

    def __init__(self, remembered: int = 200) -> None:
        self._remembered = remembered
        self._commands: OrderedDict[str, TrackedCommand] = OrderedDict()
        self.stops = 0
        """Number of STOPs that were given."""

    def give(self, command: OperatorCommand, now: float, timeout: float, label: str = '') -> TrackedCommand:
        """Queue a command; :meth:`due` returns it. The default label is the kind of the command.

        A STOP ends what waits, since it might move the robot after it: those before it are not sent again, and one that
        was wanted before it is refused when it is given at last (see :class:`OperatorCommand`).
        """
        if command.kind is CommandKind.STOP:
            self.stops += 1
            for older in self.pending():
                if not _is_stop(older):
                    self._settle(older, CommandState.TIMEOUT, 'a STOP was given after it: it is not sent again', now)
        label = label or command.kind.name.lower()
        tracked = TrackedCommand(command, label, now, now + timeout, next_send=now)
        self._commands[command.id] = tracked
        waiting = {one.command.id for one in self._sent()}
        for known in list(self._commands)[: -self._remembered]:
            if known not in waiting:
                del self._commands[known]
        if command.kind is not CommandKind.STOP and command.stops is not None and command.stops < self.stops:
            reason = 'a STOP was given while this waited; nothing was sent'
            return self._settle(tracked, CommandState.REFUSED, reason, now)
        return tracked

    def get(self, command_id: str) -> TrackedCommand | None:
        """Return the command with this identifier; None if it is unknown or forgotten."""
        return self._commands.get(command_id)

    def latest(self) -> TrackedCommand | None:
        """Return the latest command."""
        return next(reversed(self._commands.values()), None)

    def pending(self) -> tuple[TrackedCommand, ...]:
        """Return the commands that wait for an answer, oldest first."""
        return tuple(c for c in self._commands.values() if c.state is CommandState.PENDING)

    def passed_over(self) -> frozenset[str]:
        """Return the identifiers of unanswered stops that the executive on display did not receive.

        Its status came ANSWER_SECONDS after they were given, without a result for them.
        """
        return frozenset(tracked.command.id for tracked in self.pending() if tracked.is_passed_over)

    def due(self, now: float, reachable: bool = True) -> list[OperatorCommand]:
        """Return the commands to send now, for the first time or again; end those whose time is over.

        With a command go those before it that wait for an answer: one that was lost is not to be applied after it.
        While the executive is not ``reachable``, only STOPs are handed out, which others may hear, and of other
        commands no time between sends is lost. A STOP that only the stop guard has confirmed is for the executive, too.
        """
        for tracked in self._sent():
            if now < tracked.deadline:
                continue
            if tracked.state is CommandState.PENDING:
                self._settle(tracked, CommandState.TIMEOUT, _unanswered(tracked), now)
            else:
                self._commands[tracked.command.id] = replace(tracked, next_send=math.inf)
        waiting = [one for one in self._sent() if reachable or _is_stop(one)]
        while waiting and now < waiting[-1].next_send:
            waiting.pop()
        for tracked in waiting:
            wait = min(FIRST_RESEND * 2.0 ** min(tracked.sends, _DOUBLINGS), LONGEST_RESEND)
            self._commands[tracked.command.id] = replace(tracked, sends=tracked.sends + 1, next_send=now + wait)
        return [one.command for one in waiting]

    def send_stops_again(self, now: float) -> None:
        """Send again the STOPs that wait for an answer: a new participant may not have received them."""
        for tracked in self._sent():
            if _is_stop(tracked):
                self._commands[tracked.command.id] = replace(tracked, next_send=now)

    def next_due(self, reachable: bool = True) -> float | None:
        """Return the time of the next call of :meth:`due` that has work, or None."""
        times = [min(c.next_send, c.deadline) if reachable or _is_stop(c) else c.deadline for c in self._sent()]
        return min(times, default=None)

    def _sent(self) -> list[TrackedCommand]:
        """Return the commands to repeat until the executive answers, or their time is over."""
        return [
            tracked
            for tracked in self._commands.values()
            if tracked.state is CommandState.PENDING
            or (tracked.confirmed_by is Confirmation.STOP_GUARD and tracked.next_send < math.inf)
        ]

    def answered(self, snapshot: ExecutiveSnapshot, now: float) -> list[TrackedCommand]:
        """Process the answers of a snapshot, and return the commands that it settled.

        An answer that comes after the deadline corrects the TIMEOUT. When another executive answers the link
        than the one that a command was for, the command is not sent again: the new one cannot know whether the
        old one applied it.
        """
        settled = []
        for answer in snapshot.results:
            tracked = self._commands.get(answer.command_id)
            if tracked is None:
                continue
            is_by_guard = tracked.confirmed_by is Confirmation.STOP_GUARD
            if tracked.state not in (CommandState.PENDING, CommandState.TIMEOUT) and not is_by_guard:
                continue
            if answer.code is ResultCode.APPLIED:
                applied = replace(tracked, run_id=snapshot.run_id)
                settled.append(self._settle(applied, CommandState.APPLIED, '', now, Confirmation.EXECUTIVE))
            elif is_by_guard:
                continue  # the robot stands still anyway
            elif answer.code is ResultCode.REFUSED:
                reason = answer.reason or 'no reason was given'
                settled.append(self._settle(tracked, CommandState.REFUSED, reason, now))
        for tracked in self.pending():
            if tracked.command.executive_id not in ('', snapshot.executive_id):
                reason = 'the executive was restarted before it answered; see "status" for what runs now'
                settled.append(self._settle(tracked, CommandState.TIMEOUT, reason, now))
            elif tracked.command.kind is CommandKind.STOP and tracked.sends and now - tracked.given > ANSWER_SECONDS:
                self._commands[tracked.command.id] = replace(tracked, is_passed_over=True)
        return settled

    def carried_out(self, guard: StopGuard, now: float) -> bool:
        """Process the STOPs that the stop guard reports as carried out; return whether that settled anything."""
        open_ones = (CommandState.PENDING, CommandState.TIMEOUT, CommandState.REFUSED)
        found = [self._commands.get(command_id) for command_id in guard.carried_out]
        stops = [one for one in found if one is not None and one.state in open_ones and _is_stop(one)]
        for tracked in stops:
            self._settle(tracked, CommandState.APPLIED, '', now, Confirmation.STOP_GUARD)
        return bool(stops)

    def _settle(
        self,
        tracked: TrackedCommand,
        state: CommandState,
        reason: str,
        now: float,
        by: Confirmation | None = None,
    ) -> TrackedCommand:
        settled = replace(tracked, state=state, reason=reason, settled=now, confirmed_by=by)
        self._commands[tracked.command.id] = settled
        return settled


def _is_stop(tracked: TrackedCommand) -> bool:
    return tracked.command.kind is CommandKind.STOP


def _unanswered(tracked: TrackedCommand) -> str:
    waited = f'within {tracked.deadline - tracked.given:g} s'
    if _is_stop(tracked):
        return f'neither the executive nor the stop guard has confirmed it {waited}: stop the robot by other means'
    if tracked.sends == 0:
        return f'the executive does not listen to commands {waited}; nothing was sent'
    return f'no answer {waited}; it may have been applied anyway: see "status"'
