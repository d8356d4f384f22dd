# SPDX-License-Identifier: BSD-3-Clause
"""The action ``bt_executor``: a tree, its inputs and its outputs are what the goal names."""

from __future__ import annotations

from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import ClockHealth, NodeRuntime, clock_health
from flexbt_core.behavior_tree import Tree
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import BtExecute
from flexbt_server.goals import RunningTree, Speed, TreeGoal, TreeGoals
from flexbt_server.runs import RunOutcome
from flexbt_server.trees import POSE_STAMPED, POSES, Blackboards, Value

from .run_messages import feedback_of, result_of

Result = BtExecute.Result

MOST_RUNS: Final = 200
"""Goals that are worked on at a time: each tree that runs has a thread."""


class ExecuteServer:
    """Serves BtExecute. ``default_tree`` is that of a goal which names none."""

    def __init__(
        self,
        runtime: NodeRuntime,
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
        super().__init__(served, accepted, names.BT_EXECUTOR, tree, request.blackboard, request.owner)
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
        run, speed = running.run, self._speed.at(pose)
        return feedback_of(running.id, tree, run.board, pose, speed, seconds, run.not_ended, self._clock.problem)

    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        run = None if self.running is None else self.running.run
        board, not_ended = (self._boards.find(self.blackboard), ()) if run is None else (run.board, run.not_ended)
        notice = '; '.join(filter(None, [self.notice, self._clock.problem]))
        result = result_of(self.served.request, outcome, board, notice, seconds, not_ended)
        return result.code, result

    def fault_result(self, why: str) -> Any:
        return _refused(why)


def _refused(why: str) -> Any:
    return Result(code=Result.ERROR, message=why)
