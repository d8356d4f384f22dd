# SPDX-License-Identifier: BSD-3-Clause
"""The navigators, which Nav2's clients find as the node ``bt_navigator``: actions whose goals become runs of trees.

One navigator at a time drives the robot. A goal that arrives meanwhile

- takes the run over if it is for the same navigator and the same tree: the tree is neither halted nor restarted,
  and gets the new goal on its blackboard;
- otherwise waits, if all goals that block it are already stopping, until they have ended;
- otherwise is aborted with the reason, and the robot continues.

Goals start in the order of their acceptance.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, GoalOutcome, GoalStatus
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.errors import TransformError
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.transform_listener import TransformListener
from flexbt_common.values.message_fields import duration_message, poses_of
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.clock.clock import Timer
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.action import BtExecute
from flexbt_server.actions.progress import MOST_COUNTED, Speed, distance_left, recoveries, seconds_left
from flexbt_server.actions.tree_goals import MESSAGE_LIMIT, RunningTree, TreeGoal, TreeGoals
from flexbt_server.leaves.leaf_services import LeafServices
from flexbt_server.nav2.branches import concluded, pending
from flexbt_server.parameters import INPUT, WAIT, NavigatorParameters
from flexbt_server.runs.run_events import RunOutcome
from flexbt_server.trees.blackboards import Blackboards, Value
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, POSES, WAYPOINT_STATUSES, TrackingFeedback
from flexbt_server.trees.tree_store import FoundTree

from .activation import Activation, called_servers
from .waypoint_follower import InputAtWaypoint, WaitAtWaypoint, WaypointFollower, WaypointTask

ExecuteResult = BtExecute.Result

LOOK_SECONDS: Final = 0.05
"""Period of the check of a waiting goal, s of wall time."""


class Navigators:
    """The navigators that the parameter ``navigators`` enables. Made and used on the executor thread."""

    def __init__(
        self,
        runtime: Runtime,
        parameters: NavigatorParameters,
        goals: TreeGoals,
        boards: Blackboards,
        services: LeafServices,
        default_trees: Sequence[FoundTree],
        refusal: str,
    ) -> None:
        """``services``: the services of the leaves. ``refusal``: why goals are refused until :meth:`activate`."""
        self.runtime = runtime
        self.parameters = parameters
        self.goals = goals
        self._services = services
        self._default_trees = default_trees
        self._activation: Activation | None = None
        self.admission = GoalAdmission('bt_navigator', refusal)
        self._at_work: list[NavigatorGoal] = []
        self._waiting: deque[tuple[NavigatorGoal, Callable[[], None], float]] = deque()
        self._look: Timer | None = None
        self._parts: list[LifecycleSubnode] = []
        self._navigators = [
            TreeNavigator(self, name, boards.get(name)) for name in parameters.navigators if name in ACTIONS
        ]
        if names.NAVIGATE_TO_POSE in parameters.navigators:
            # Depth 1: of many poses only the last counts.
            runtime.node.create_subscription(PoseStamped, names.GOAL_POSE, self._on_goal_pose, 1)
        self._follower: WaypointFollower | None = None
        if names.FOLLOW_WAYPOINTS in parameters.navigators:
            self._follower = WaypointFollower(
                runtime, services, _waypoint_task(runtime, parameters), parameters.stop_on_failure, refusal
            )

    def activate(self) -> None:
        """Accept goals, and report the active lifecycle state of Nav2's nodes."""
        if self._navigators:
            TransformListener.of(self.runtime)  # the first goal in another frame may have an earlier stamp
            self.admission.open()
            self._wait_for_servers(patient=True)
            self._parts.append(
                LifecycleSubnode(self.runtime, names.BT_NAVIGATOR, self._on_change, self._has_its_servers)
            )
        follower = self._follower
        if follower is not None:
            follower.admit('')
            self._parts.append(
                LifecycleSubnode(
                    self.runtime,
                    names.WAYPOINT_FOLLOWER,
                    lambda on: follower.admit('' if on else 'is inactive'),
                )
            )

    def deactivate(self, refusal: str) -> None:
        """Refuse goals and end waypoints. :meth:`TreeGoals.stop_all` ends the trees of navigators."""
        for part in self._parts:
            part.close()
        self._parts.clear()
        self._wait_no_longer()
        self.admission.close(refusal)
        if self._follower is not None:
            self._follower.admit(refusal)

    def _on_change(self, is_active: bool) -> None:
        """Follow the state of bt_navigator, which a lifecycle manager has changed."""
        if is_active:
            self._wait_for_servers(patient=False)  # Nav2's manager expects the active state once it has an answer
            self.admission.open()
            return
        self._wait_no_longer()
        self.admission.close('is inactive')
        self.goals.stop_each('bt_navigator was deactivated', NavigatorGoal)

    def _wait_for_servers(self, *, patient: bool) -> None:
        nodes = (node for tree in self._default_trees for node in tree.nodes())
        self._activation = Activation(self.runtime, called_servers(nodes), patient=patient)

    def _wait_no_longer(self) -> None:
        if self._activation is not None:
            self._activation.cancel()

    def _has_its_servers(self) -> bool:
        return self._activation is not None and self._activation.is_over

    # -- the queue of goals ------------------------------------------------------------------------------------------

    def enqueue(self, goal: NavigatorGoal, go_on: Callable[[], None]) -> None:
        """Queue a goal. It starts when it is its turn and its poses are known."""
        deadline = self.runtime.steady.now() + self._services.first_timeout
        self._waiting.append((goal, go_on, deadline))
        self._proceed()

    def cancel(self, served: ServedGoal) -> None:
        """Stop a goal that its client has canceled."""
        self.goals.cancel(served)
        self._proceed()

    def _proceed(self) -> None:
        """Start or end the waiting goals, in order, up to the first undecided one."""
        if self._look is not None:
            self._look.cancel()
            self._look = None
        while self._waiting:
            goal, go_on, deadline = self._waiting[0]
            if goal.served.active and self._has_to_wait(goal, deadline):
                self._look = self.runtime.post_in(LOOK_SECONDS, self._proceed)
                return
            self._waiting.popleft()
            if goal.served.active:
                self._begin(goal, go_on)

    def _has_to_wait(self, goal: NavigatorGoal, deadline: float) -> bool:
        if goal.poses is None:
            return True  # until the poses are transformed, or that has failed and ended the goal
        if self.goals.pose is None:
            return self.runtime.steady.now() < deadline
        in_the_way = self._in_the_way(goal)
        return bool(in_the_way) and all(other.stop_reason is not None for other in in_the_way)

    def _in_the_way(self, goal: NavigatorGoal) -> list[NavigatorGoal]:
        assert goal.found is not None
        return [
            other
            for other in self._at_work
            if other.navigator is not goal.navigator or other.found is None or other.found.key != goal.found.key
        ]

    def _begin(self, goal: NavigatorGoal, go_on: Callable[[], None]) -> None:
        in_the_way = self._in_the_way(goal)
        if self.goals.pose is None:
            goal.problem = 'TF_ERROR'
            self._refuse(goal, 'the pose of the robot is not known: nothing is published on its topic')
            return
        if in_the_way:
            other = in_the_way[0]
            assert other.found is not None
            self._refuse(
                goal,
                f'{other.navigator.name} drives the robot, by tree {other.found.key.id!r} of '
                f'{other.found.key.file}; cancel it first, or let it end: only a goal for the same navigator and '
                'tree can take over',
            )
            return
        goal.begin()
        self._at_work.append(goal)
        goal.on_ended = lambda: self._ended(goal)
        go_on()

    def _ended(self, goal: NavigatorGoal) -> None:
        self._at_work.remove(goal)
        self._proceed()

    def _refuse(self, goal: NavigatorGoal, why: str) -> None:
        self.goals.end(goal, RunOutcome(ExecuteResult.ERROR, why))

    # -- goal_pose ---------------------------------------------------------------------------------------------------

    def _on_goal_pose(self, pose: PoseStamped) -> None:
        ActionCall(
            self._services.actions.link(NavigateToPose, names.NAVIGATE_TO_POSE),
            NavigateToPose.Goal(pose=pose),
            on_done=self._goal_pose_ended,
            server_timeout=self._services.first_timeout,
            accept_timeout=self._services.server_timeout,
        )

    def _goal_pose_ended(self, outcome: GoalOutcome) -> None:
        if outcome.status is not GoalStatus.SUCCEEDED:
            self.runtime.node.get_logger().warning(
                f'{names.GOAL_POSE}: {outcome.reason}', throttle_duration_sec=COMPLAINT_SECONDS
            )


def _waypoint_task(runtime: Runtime, parameters: NavigatorParameters) -> WaypointTask:
    if parameters.waypoint_task == INPUT and parameters.is_input_enabled:
        return InputAtWaypoint(runtime, parameters.input_topic, parameters.input_timeout)
    waits = parameters.waypoint_task == WAIT and parameters.is_wait_enabled
    return WaitAtWaypoint(runtime, parameters.wait_milliseconds * 1e-3 if waits else 0.0)


# A navigator: an action of Nav2 whose goals become runs of a tree, which reads the poses from its blackboard.

MOST_NAVIGATOR_GOALS: Final = 200
"""Maximum number of active goals of a navigator; in a flood, each goal replaces the one before."""

ACTIONS: Final = {names.NAVIGATE_TO_POSE: NavigateToPose, names.NAVIGATE_THROUGH_POSES: NavigateThroughPoses}
"""The action of each navigator."""

TRACKING_KEY: Final = 'tracking_feedback'
"""Blackboard key under which main's trees store the tracking feedback of the controller."""


class TreeNavigator:
    """The server of one of :data:`ACTIONS`. On the executor thread.

    Its trees run on a separate blackboard, which is named after the action and lives as long as the navigator.
    """

    def __init__(self, navigators: Navigators, name: str, board: Blackboard) -> None:
        self.name = name
        self.action_type: Any = ACTIONS[name]
        self.parameters = navigators.parameters
        self.speed = Speed()
        self.navigators = navigators
        self._board = board  # the reference keeps it
        GoalServer(
            navigators.runtime,
            self.action_type,
            name,
            self._serve,
            navigators.cancel,
            most=MOST_NAVIGATOR_GOALS,
            admission=navigators.admission,
        )

    def _serve(self, served: ServedGoal) -> None:
        self.navigators.goals.serve(NavigatorGoal(self, served, self.navigators.runtime.clock.now()))

    def statuses(self) -> list[Any]:
        """Return the statuses of the poses so far, if the trees record them."""
        statuses = self._board.get_or(self.parameters.statuses_key, [])
        return statuses if isinstance(statuses, list) else []

    def in_global_frame(self, goal: NavigatorGoal) -> None:
        """Transform the poses of a goal to the global frame. If one is not known in time, the goal ends."""
        frame = self.parameters.global_frame
        there: dict[int, PoseStamped] = {}

        def known(index: int, pose: PoseStamped) -> None:
            there[index] = pose
            if len(there) == len(goal.asked):
                goal.poses = [there[index] for index in range(len(there))]

        def unknown(error: TransformError) -> None:
            goal.problem = 'TF_ERROR'
            self.navigators.goals.end(
                goal, RunOutcome(ExecuteResult.ERROR, f'the goal cannot be transformed to {frame!r}: {error}')
            )

        goal.poses = None if goal.asked else []
        for index, pose in enumerate(goal.asked):
            if pose.header.frame_id in ('', frame):
                known(index, pose)
            else:
                TransformListener.of(self.navigators.runtime).transform_pose(
                    pose, frame, partial(known, index), unknown
                )


class NavigatorGoal(TreeGoal):
    """A goal of a navigator. ``poses`` are the requested poses in the global frame, once they are known.

    ``problem`` names the error code for a goal that ends before its tree has run, if the action has such a code.
    """

    def __init__(self, navigator: TreeNavigator, served: ServedGoal, accepted: float) -> None:
        request = served.request
        tree = request.behavior_tree or navigator.parameters.default_trees[navigator.name]
        super().__init__(served, accepted, navigator.name, tree, navigator.name)
        self.navigator = navigator
        self.asked: list[PoseStamped] = [request.pose] if hasattr(request, 'pose') else poses_of(request.poses)
        self.poses: list[PoseStamped] | None = None
        self.problem = 'FAILED_TO_LOAD_BEHAVIOR_TREE'

    def read(self) -> list[Value]:
        return []

    def fresh_values(self) -> list[Value]:
        # A new run must not drive the path of the previous goal. A run that is taken over continues on its path until
        # it plans again.
        return [(self.navigator.parameters.path_key, Path(), PATH)]

    def when_ready(self, go_on: Callable[[], None]) -> None:
        self.problem = 'UNKNOWN'
        self.navigator.in_global_frame(self)
        if self.served.active:
            self.navigator.navigators.enqueue(self, go_on)

    def begin(self) -> None:
        """Start the goal: its poses are known and it is its turn."""
        assert self.poses is not None
        parameters = self.navigator.parameters
        if self.navigator.action_type is NavigateToPose:
            self.values = [(parameters.goal_key, self.poses[0], POSE_STAMPED)]
        else:
            self.values = [
                (parameters.goals_key, self.poses, POSES),
                (parameters.statuses_key, pending(self.poses), WAYPOINT_STATUSES),
            ]

    def feedback(self, running: RunningTree, tree: Tree, pose: PoseStamped, seconds: float) -> Any:
        board, parameters = running.run.board, self.navigator.parameters
        distance = distance_left(board.get_or(parameters.path_key, None), pose)
        feedback = self.navigator.action_type.Feedback(
            current_pose=pose,
            navigation_time=duration_message(seconds),
            estimated_time_remaining=duration_message(seconds_left(distance, self.navigator.speed.at(pose))),
            number_of_recoveries=recoveries(board),
            distance_remaining=float(distance),
        )
        if hasattr(feedback, 'number_of_poses_remaining'):
            poses = board.get_or(parameters.goals_key, [])
            feedback.number_of_poses_remaining = min(len(poses) if isinstance(poses, list) else 0, MOST_COUNTED)
        if hasattr(feedback, 'position_tracking_error'):  # as in main
            tracked = board.get_or(TRACKING_KEY, TrackingFeedback())
            feedback.position_tracking_error = tracked.position_tracking_error
            feedback.heading_tracking_error = tracked.heading_tracking_error
        if hasattr(feedback, 'waypoint_statuses'):
            feedback.waypoint_statuses = self.navigator.statuses()
        return feedback

    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        result = self.navigator.action_type.Result()
        # The blackboard has the poses of the goal for which a tree runs.
        if hasattr(result, 'waypoint_statuses') and self.running is not None and self.running.goal is self:
            succeeded = outcome.code == ExecuteResult.SUCCESS
            result.waypoint_statuses = concluded(self.navigator.statuses(), succeeded=succeeded)
        if outcome.code != ExecuteResult.SUCCESS:
            code = outcome.error_code
            if outcome.code == ExecuteResult.ERROR and not code:
                code = getattr(result, self.problem, 0)  # Jazzy's actions have none of these
            result.error_code = code
            remarks = (outcome.message, self.notice)
            result.error_msg = sanitize_for_message('; '.join(filter(None, remarks)), MESSAGE_LIMIT)
        return outcome.code, result

    def fault_result(self, why: str) -> Any:
        result = self.navigator.action_type.Result()
        result.error_code, result.error_msg = getattr(result, 'UNKNOWN', 0), why
        return result
