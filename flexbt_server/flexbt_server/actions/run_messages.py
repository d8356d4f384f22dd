# SPDX-License-Identifier: BSD-3-Clause
"""What clients of ``bt_executor`` are told of a run: feedback while it goes on, the result at its end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.values import Encoding, duration_message
from flexbt_core.behavior_tree import Blackboard, Tree
from flexbt_core.values import sendable
from flexbt_msgs.action import BtExecute
from flexbt_server.goals import MESSAGE_LIMIT, MOST_COUNTED, distance_along, recoveries, seconds_left
from flexbt_server.runs import RunOutcome
from flexbt_server.trees import entries_of

Result = BtExecute.Result

REASON_LIMIT: Final = 1000
"""Characters of a reason for people: a leaf may give any text."""


def feedback_of(
    run_id: str,
    tree: Tree,
    board: Blackboard,
    pose: Any,
    speed: float,
    seconds: float,
    not_ended: Sequence[str],
    clock_problem: str,
) -> Any:
    """The feedback message of a run. ``pose``: the latest of the robot, a PoseStamped; ``speed`` in m/s; ``seconds``
    since the acceptance; ``not_ended``: canceled goals that go on; ``clock_problem``: what is wrong with the time.
    """
    distance = distance_along(board.get_or('path', None), pose)
    poses = _poses_ahead(board)
    return BtExecute.Feedback(
        active_nodes=tree.active_nodes(),
        current_location=pose,
        execution_time=duration_message(max(0.0, seconds)),
        number_of_recoveries=recoveries(board),
        distance_remaining=distance,
        time_remaining=seconds_left(distance, speed) or -1.0,
        poses_remaining=min(len(poses), MOST_COUNTED) if poses else -1,
        goal=poses[-1] if poses else PoseStamped(),
        run_id=run_id,
        not_ended=not_ended,
        clock_problem=clock_problem,
    )


def _poses_ahead(board: Blackboard) -> list[PoseStamped]:
    """Where the robot has still to go, by Nav2's names of the keys."""
    goal, goals = board.get_or('goal', None), board.get_or('goals', None)
    poses = goals if isinstance(goals, list) else [goal]
    return [pose for pose in poses if isinstance(pose, PoseStamped)]


def result_of(
    request: Any, outcome: RunOutcome, board: Blackboard, notice: str, seconds: float, not_ended: Sequence[str]
) -> Any:
    """The result message for a goal. An output that cannot be sent makes it an ERROR.

    ``notice`` is for the case that the run did not succeed; ``seconds`` since the acceptance; ``not_ended``: canceled
    goals that go on.
    """
    encoding = Encoding.BINARY if request.output_encoding == BtExecute.Goal.BINARY else Encoding.TEXT
    entries, missing, problems = entries_of(board, request.outputs, encoding)
    code = Result.ERROR if problems else outcome.code
    remarks = [outcome.message, *problems, '' if code == Result.SUCCESS else notice]
    return Result(
        code=code,
        message=sendable('; '.join(filter(None, remarks)), MESSAGE_LIMIT),
        failed_node=sendable(outcome.failed_node, MESSAGE_LIMIT),
        reasons=[sendable(reason, REASON_LIMIT) for reason in outcome.reasons],
        error_code=outcome.error_code,
        outputs=entries,
        missing_outputs=missing,
        execution_time=duration_message(max(0.0, seconds)),
        not_ended=not_ended,
    )
