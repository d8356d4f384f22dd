# SPDX-License-Identifier: BSD-3-Clause
"""How goals of the navigation actions end, and what their results say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from rclpy.action.server import ServerGoalHandle

RESULT_TIMEOUT: Final = 15
"""How long the result of a finished goal can be asked for again, s."""


@dataclass(frozen=True)
class GoalEnd:
    """How a goal ended: succeeded, canceled, or failed with the name of an error code."""

    succeeded: bool = False
    canceled: bool = False
    code: str = 'NONE'
    message: str = ''


SUCCEEDED: Final = GoalEnd(succeeded=True)
CANCELED: Final = GoalEnd(canceled=True, message='canceled by the client')


def finish(handle: ServerGoalHandle, result: Any, end: GoalEnd) -> Any:
    """End the goal, fill in error code and message, and give the result.

    Not every action has every code: one that it lacks becomes its UNKNOWN. (Wait has none at all, only the message.)
    """
    result.error_code = int(getattr(result, end.code, getattr(result, 'UNKNOWN', 0)))
    result.error_msg = end.message
    if end.succeeded:
        handle.succeed()
    elif end.canceled and handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
    return result
