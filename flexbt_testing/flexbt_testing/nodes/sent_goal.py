# SPDX-License-Identifier: BSD-3-Clause
"""A goal that a test waits for: an :class:`~flexbt_common.calls.ActionCall` seen from another thread."""

from __future__ import annotations

import threading
from typing import Any

from flexbt_common.calls import ActionCall, ActionServerLink, GoalOutcome


class SentGoal:
    """A goal with its feedback and its end. Must not be waited for on the executor thread.

    ``accepted`` is set when the server has accepted the goal; ``call`` is the call.
    """

    def __init__(self, link: ActionServerLink, goal: Any, deadline: float = 20.0) -> None:
        """``deadline``: s of wall time for the server to appear, to accept, to cancel, and for each :meth:`wait`."""
        self._deadline = deadline
        self._ended = threading.Event()
        self.feedback: list[Any] = []
        self.accepted = threading.Event()
        self.outcomes: list[GoalOutcome] = []
        self.call = ActionCall(
            link,
            goal,
            on_done=self._done,
            on_feedback=self.feedback.append,
            on_accepted=self.accepted.set,
            server_timeout=deadline,
            accept_timeout=deadline,
        )

    def _done(self, outcome: GoalOutcome) -> None:
        self.outcomes.append(outcome)
        self._ended.set()

    @property
    def ended(self) -> bool:
        """Whether there is an outcome."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Ask the server to cancel the goal; see :meth:`ActionCall.cancel`."""
        self.call.cancel(self._deadline)

    def wait(self, timeout: float | None = None) -> GoalOutcome:
        """The outcome.

        Raises:
            TimeoutError: there is none in time.
        """
        timeout = self._deadline if timeout is None else timeout
        if not self._ended.wait(timeout):
            raise TimeoutError(f'a goal did not end within {timeout:g} s')
        (outcome,) = self.outcomes
        return outcome

    @property
    def result(self) -> Any:
        """The result message. Raises as :meth:`wait`, and RuntimeError when the goal ended without one."""
        outcome = self.wait()
        if outcome.result is None:
            raise RuntimeError(outcome.reason)
        return outcome.result
