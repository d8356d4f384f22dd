# SPDX-License-Identifier: BSD-3-Clause
"""What clients of ``bt_executor`` are told of a run: feedback while it goes on, the result at its end."""

from __future__ import annotations

from typing import Any, Final

from flexbt_common.values import Encoding, duration_message
from flexbt_core.behavior_tree import Blackboard, Tree
from flexbt_core.values import sendable
from flexbt_msgs.action import BtExecute
from flexbt_server.goals import MESSAGE_LIMIT, distance_along
from flexbt_server.runs import RunOutcome
from flexbt_server.trees import RECOVERIES_KEY, entries_of

Result = BtExecute.Result

REASON_LIMIT: Final = 1000
"""Characters of a reason for people: a leaf may give any text."""


def feedback_of(tree: Tree, board: Blackboard, pose: Any, seconds: float) -> Any:
    """The feedback message. ``pose``: the latest of the robot, a PoseStamped; ``seconds`` since the acceptance."""
    recoveries = board.get_or(RECOVERIES_KEY, 0)
    return BtExecute.Feedback(
        active_nodes=tree.active_nodes(),
        current_location=pose,
        execution_time=duration_message(max(0.0, seconds)),
        number_of_recoveries=int(recoveries) if isinstance(recoveries, int | float) else 0,
        distance_remaining=float(distance_along(board.get_or('path', None), pose)),
    )


def result_of(request: Any, outcome: RunOutcome, board: Blackboard, notice: str, seconds: float) -> Any:
    """The result message for a goal. An output that cannot be sent makes it an ERROR.

    ``notice`` is for the case that the run did not succeed; ``seconds`` since the acceptance.
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
    )
