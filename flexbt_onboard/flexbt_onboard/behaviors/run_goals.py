# SPDX-License-Identifier: BSD-3-Clause
"""The goals that the states of a run have sent, until it is known that they have ended."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from flexbt_common.calls import ActionCall
from flexbt_core.state_machine import EventState

_MOST_REMEMBERED: Final = 256
"""Lines that the operator was told. Of these, the latest: one that comes back after so many others is told again."""


def _goes_on() -> Sequence[str]:
    return ('an action has no pause',)


@dataclass(frozen=True)
class _Sent:
    state: EventState | None
    topic: str
    call: ActionCall
    not_paused: Callable[[], Sequence[str]]


class RunGoals:
    """Who has sent which goal. From any thread.

    A stop cancels them all on the thread that tells it: a state that does not return from a callback keeps nobody from
    canceling its goals, nor those of the states beside it.
    """

    def __init__(self) -> None:
        self._sent: list[_Sent] = []
        self._told: deque[tuple[str, str]] = deque(maxlen=_MOST_REMEMBERED)
        self._is_stopped = False
        self._lock = threading.Lock()

    def add(
        self, state: EventState | None, topic: str, call: ActionCall, not_paused: Callable[[], Sequence[str]] = _goes_on
    ) -> None:
        """A goal was sent by a state. ``not_paused`` says why it goes on while the state is paused, or what of it does;
        nothing if it does not."""
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
        """Whether a goal is not known to have ended."""
        return bool(self._going_on())

    def halting(self, state: EventState) -> str | None:
        """Which goals of a state were canceled, and are not confirmed to have ended; None when there is none."""
        waiting = [sent.topic for sent in self._going_on(state) if sent.call.cancel_requested]
        return f'goal of {", ".join(waiting)} not confirmed canceled' if waiting else None

    def not_paused(self, state: EventState) -> list[str]:
        """Which goals of a state go on while it is paused, as "goal of TOPIC: why"; a line for each reason."""
        return [f'goal of {sent.topic}: {why}' for sent in self._going_on(state) for why in sent.not_paused()]

    def untold(self, topic: str, lines: Sequence[str]) -> list[str]:
        """Of ``lines`` from the server of an action, those that no state of the run was given yet, in their order: the
        operator is told each once, whichever states hear of it, and how often."""
        with self._lock:
            new = [line for line in dict.fromkeys(lines) if (topic, line) not in self._told]
            self._told += [(topic, line) for line in new]
        return new

    def _going_on(self, state: EventState | None = None) -> list[_Sent]:
        with self._lock:
            sent = list(self._sent)
        return [one for one in sent if not one.call.done and (state is None or one.state is state)]
