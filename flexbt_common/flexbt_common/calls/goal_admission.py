# SPDX-License-Identifier: BSD-3-Clause
"""Admits goals, or refuses them with a reason: the goals of a node that is not active."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .goal_server import ServedGoal

Serve = Callable[[ServedGoal], None]


class GoalAdmission:
    """One for all goals of ``subject``, such as 'the server'. ``refusal``: why none is admitted; '' when all are."""

    def __init__(self, subject: str, why: str = '') -> None:
        """Closed if ``why``, which follows the subject, is given."""
        self._subject = subject
        self.refusal = ''
        if why:
            self.close(why)

    def open(self) -> None:
        """Admit goals."""
        self.refusal = ''

    def close(self, why: str) -> None:
        """Refuse goals from now on."""
        self.refusal = f'{self._subject} {why}'

    def guard(self, serve: Serve, result_of: Callable[[str], Any]) -> Serve:
        """``serve``, for the goals that are admitted. The others are aborted with the result for the reason."""

        def admit(goal: ServedGoal) -> None:
            if self.refusal:
                goal.abort(result_of(self.refusal))
            else:
                serve(goal)

        return admit
