# SPDX-License-Identifier: BSD-3-Clause
"""The goals that the states of a run have sent, until it is known that they have ended."""

from __future__ import annotations

from collections import defaultdict

from flexbt_common.calls import ActionCall
from flexbt_core.state_machine import EventState
from flexbt_onboard.behaviors import RunContext


class RunGoals:
    """Who has sent which goal. Used on the thread of the run."""

    def __init__(self, run: RunContext) -> None:
        self._calls: defaultdict[EventState | None, list[tuple[str, ActionCall]]] = defaultdict(list)
        run.at_end(self._close)

    def add(self, state: EventState | None, topic: str, call: ActionCall) -> None:
        """A goal was sent by a state."""
        self._drop_ended(state)
        self._calls[state].append((topic, call))

    def halting(self, state: EventState) -> str | None:
        """The goal that was canceled and has not ended yet, of a state that was left; None when there is none.

        When the run itself ends, all goals of the state are canceled: nobody is left to wait for their results.
        """
        self._drop_ended(state)
        if state.exit_reason is not None and state.exit_reason.is_of_the_run:
            for _, call in self._calls[state]:
                call.cancel()
        waiting = [topic for topic, call in self._calls[state] if call.cancel_requested]
        return f'canceling the goal of {", ".join(waiting)}' if waiting else None

    def _drop_ended(self, state: EventState | None) -> None:
        self._calls[state] = [(topic, call) for topic, call in self._calls[state] if not call.done]

    def _close(self) -> None:
        for calls in self._calls.values():
            for _, call in calls:
                if not call.done:
                    call.cancel()
