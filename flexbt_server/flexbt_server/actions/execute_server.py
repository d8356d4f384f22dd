# SPDX-License-Identifier: BSD-3-Clause
"""The action ``BtExecute`` with its feedback and results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime.clock_watch import ClockHealth, clock_health
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.entries import Encoding
from flexbt_common.values.message_fields import duration_message
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.action import BtExecute
from flexbt_server.runs.run_events import RunOutcome
from flexbt_server.trees.blackboards import Blackboards, Value, entries_of
from flexbt_server.trees.ros_ports import POSE_STAMPED, POSES

from .progress import MOST_COUNTED, Speed, distance_along, recoveries, seconds_left
from .tree_goals import MESSAGE_LIMIT, RunningTree, TreeGoal, TreeGoals

ExecuteResult = BtExecute.Result

MOST_RUNS: Final = 200
"""Maximum number of active goals: each running tree has a thread."""


class ExecuteServer:
    """The server of BtExecute. A goal that names no tree runs ``default_tree``."""

    def __init__(
        self,
        runtime: Runtime,
        default_tree: str,
        goals: TreeGoals,
        boards: Blackboards,
        admission: GoalAdmission,
    ) -> None:
        def serve(served: ServedGoal) -> None:
            goals.serve(_ExecuteGoal(served, runtime.clock.now(), default_tree, boards, clock_health(runtime)))

        GoalServer(
            runtime,
            BtExecute,
            names.BT_EXECUTOR,
            serve,
            goals.cancel,
            refused=_refused,
            most=MOST_RUNS,
            admission=admission,
        )


class _ExecuteGoal(TreeGoal):
    def __init__(
        self, served: ServedGoal, accepted: float, default_tree: str, boards: Blackboards, clock: ClockHealth
    ) -> None:
        request = served.request
        tree = request.behavior_tree or default_tree
        super().__init__(
            served, accepted, names.BT_EXECUTOR, tree, request.blackboard, request.owner, request.owner_process
        )
        self._boards = boards
        self._clock = clock
        self._speed = Speed()

    def read(self) -> list[Value]:
        if not self.tree:
            raise FlexbtError("the goal names no behavior tree, and the parameter 'default_tree' is not set")
        request = self.served.request
        values = self._boards.receive(request.blackboard, request.inputs)
        if len(request.goals) == 1:
            values.append(('goal', request.goals[0], POSE_STAMPED))
        elif request.goals:
            values.append(('goals', list(request.goals), POSES))
        return values

    def feedback(self, running: RunningTree, tree: Tree, pose: PoseStamped, seconds: float) -> Any:
        run, speed, request = running.run, self._speed.at(pose), self.served.request
        problem = self._clock.problem
        return feedback_of(request, running.id, tree, run.board, pose, speed, seconds, run.not_ended, problem)

    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        run = None if self.running is None else self.running.run
        board, not_ended = (self._boards.find(self.blackboard), ()) if run is None else (run.board, run.not_ended)
        notice = '; '.join(filter(None, [self.notice, self._clock.problem]))
        result = result_of(self.served.request, outcome, board, notice, seconds, not_ended)
        return result.code, result

    def fault_result(self, why: str) -> Any:
        return _refused(why)


def _refused(why: str) -> Any:
    return ExecuteResult(code=ExecuteResult.ERROR, message=why)


# Messages about a run to clients of ``bt_executor``: feedback during the run, the result at its end.

REASON_LIMIT: Final = 1000
"""Maximum number of characters of a reason: a leaf may give any text."""


def feedback_of(
    request: Any,
    run_id: str,
    tree: Tree,
    board: Blackboard,
    pose: Any,
    speed: float,
    seconds: float,
    not_ended: Sequence[str],
    clock_problem: str,
) -> Any:
    """Return the feedback message of a run. ``pose``: latest pose of the robot, a PoseStamped; ``speed`` in m/s;
    ``seconds`` since the acceptance; ``not_ended``: canceled goals that continue; ``clock_problem``: problem of the
    node's time, or ''.
    """
    distance = distance_along(board.get_or('path', None), pose)
    poses = _poses_ahead(request, board)
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


def _poses_ahead(request: Any, board: Blackboard) -> list[PoseStamped]:
    """Return the remaining poses of the robot, from the blackboard keys that Nav2 uses. The key ``goals`` of a request
    with one goal is of an earlier run."""
    goal, goals = board.get_or('goal', None), board.get_or('goals', None)
    poses = goals if isinstance(goals, list) and len(request.goals) != 1 else [goal]
    return [pose for pose in poses if isinstance(pose, PoseStamped)]


def result_of(
    request: Any, outcome: RunOutcome, board: Blackboard, notice: str, seconds: float, not_ended: Sequence[str]
) -> Any:
    """Return the result message for a goal. If an output cannot be sent, the result is an ERROR.

    ``notice`` is added if the run did not succeed; ``seconds`` since the acceptance; ``not_ended``: canceled goals
    that continue.
    """
    encoding = Encoding.BINARY if request.output_encoding == BtExecute.Goal.BINARY else Encoding.TEXT
    entries, missing, problems = entries_of(board, request.outputs, encoding)
    code = ExecuteResult.ERROR if problems else outcome.code
    remarks = [outcome.message, *problems, '' if code == ExecuteResult.SUCCESS else notice]
    return ExecuteResult(
        code=code,
        message=sanitize_for_message('; '.join(filter(None, remarks)), MESSAGE_LIMIT),
        failed_node=sanitize_for_message(outcome.failed_node, MESSAGE_LIMIT),
        reasons=[sanitize_for_message(reason, REASON_LIMIT) for reason in outcome.reasons],
        error_code=outcome.error_code,
        outputs=entries,
        missing_outputs=missing,
        execution_time=duration_message(max(0.0, seconds)),
        not_ended=not_ended,
    )
