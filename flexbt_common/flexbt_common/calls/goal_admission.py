# SPDX-License-Identifier: BSD-3-Clause
"""Admits goals, or refuses them with a reason: the goals of a node that is not active."""

from __future__ import annotations


class GoalAdmission:
    """One for all goals of ``subject``, such as 'the server'. ``refusal``: why none is admitted; '' when all are.

    A server that is given one rejects the goals that are not admitted, as the lifecycle servers of ROS do.
    """

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
