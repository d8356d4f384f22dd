# SPDX-License-Identifier: BSD-3-Clause
"""How goals of the navigation actions end, and what their results say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Protocol

from nav_msgs.msg import Path

from flexbt_common.calls import ServedGoal, set_error
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.navigation_errors import NavigationError


@dataclass(frozen=True)
class GoalEnd:
    """How a goal ended: succeeded, canceled, or failed with the name of an error code."""

    succeeded: bool = False
    canceled: bool = False
    code: str = 'NONE'
    message: str = ''


class OnPathEnd(Protocol):
    """Ends a goal, with a path when there is one."""

    def __call__(self, end: GoalEnd, path: Path | None = None) -> None: ...


SUCCEEDED: Final = GoalEnd(succeeded=True)
CANCELED: Final = GoalEnd(canceled=True, message='canceled by the client')


def end_by(runtime: NodeRuntime, error: Exception, what: str) -> GoalEnd:
    """The end of a goal that an error came in the way of; a fault of ours is reported as one of ``what``."""
    if isinstance(error, NavigationError):
        return GoalEnd(code=error.code, message=str(error))
    runtime.report_fault(error, what)
    return GoalEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}')


def finish(goal: ServedGoal, result: Any, end: GoalEnd) -> None:
    """Fill in error code and message, and end the goal.

    Not every action has every code: one that it lacks becomes its UNKNOWN. (Wait has none at all, only the message;
    the actions of routes have none.)
    """
    set_error(result, int(getattr(result, end.code, getattr(result, 'UNKNOWN', 0))), end.message)
    if end.succeeded:
        goal.succeed(result)
    elif end.canceled:
        goal.canceled(result)
    else:
        goal.abort(result)
