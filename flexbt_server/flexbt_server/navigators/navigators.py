# SPDX-License-Identifier: BSD-3-Clause
"""The navigators of a server: what Nav2's clients find as the node ``bt_navigator``, and the topic ``goal_pose``.

One navigator at a time drives the robot. A goal that comes while it drives

- takes the run over when it is for the same navigator and the same tree: the tree is neither halted nor begun again,
  and finds another goal on its blackboard;
- is aborted otherwise, with the reason, and the robot drives on; but when all that is in its way was told to stop, it
  waits until that is over.

Goals begin in the order in which they were accepted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose

from flexbt_common import names
from flexbt_common.calls import ActionCall, GoalAdmission, GoalOutcome, GoalStatus, ServedGoal
from flexbt_common.lifecycle import ManagedPart
from flexbt_common.runtime import COMPLAINT_SECONDS, NodeRuntime
from flexbt_common.transforms import TransformListener
from flexbt_core.clock import Timer
from flexbt_msgs.action import BtExecute
from flexbt_server.goals import TreeGoals
from flexbt_server.leaves import LeafServices, called_servers
from flexbt_server.runs import RunOutcome
from flexbt_server.trees import Blackboards, FoundTree

from .activation import Activation
from .navigator import ACTIONS, Navigator, NavigatorGoal
from .parameters import NavigatorParameters
from .waypoint_follower import WaypointFollower
from .waypoint_tasks import InputAtWaypoint, WaitAtWaypoint, WaypointTask

Code = BtExecute.Result

LOOK_SECONDS: Final = 0.05
"""How often a goal that waits is looked at, s of wall time."""


class Navigators:
    """What the parameter ``navigators`` asks for. Made and used on the executor thread."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: NavigatorParameters,
        goals: TreeGoals,
        boards: Blackboards,
        services: LeafServices,
        default_trees: Sequence[FoundTree],
        refusal: str,
    ) -> None:
        """``services`` are those of leaves. ``refusal``: why goals are refused until :meth:`activate`."""
        self._runtime = runtime
        self._goals = goals
        self._services = services
        self._default_trees = default_trees
        self._activation: Activation | None = None
        self._admission = GoalAdmission('bt_navigator', refusal)
        self._at_work: list[NavigatorGoal] = []
        self._waiting: deque[tuple[NavigatorGoal, Callable[[], None], float]] = deque()
        self._look: Timer | None = None
        self._parts: list[ManagedPart] = []
        self._navigators = [
            Navigator(runtime, name, parameters, goals, boards, self._admission, self._enqueue, self._cancel)
            for name in parameters.navigators
            if name in ACTIONS
        ]
        if names.NAVIGATE_TO_POSE in parameters.navigators:
            # Of many poses only the last counts.
            runtime.node.create_subscription(PoseStamped, names.GOAL_POSE, self._on_goal_pose, 1)
        self._follower: WaypointFollower | None = None
        if names.FOLLOW_WAYPOINTS in parameters.navigators:
            self._follower = WaypointFollower(
                runtime,
                services.actions.link(NavigateToPose, names.NAVIGATE_TO_POSE),
                stop_on_failure=parameters.stop_on_failure,
                task=_waypoint_task(runtime, parameters),
                server_timeout=self._server_timeout,
                cancel_timeout=services.cancel_timeout,
                refusal=refusal,
            )

    def activate(self) -> None:
        """Let goals in, and tell so to those who ask for the lifecycle state of Nav2's nodes."""
        if self._navigators:
            TransformListener.of(self._runtime)  # the first goal in another frame may be stamped before it comes
            self._admission.open()
            self._wait_for_servers(patient=True)
            self._parts.append(ManagedPart(self._runtime, names.BT_NAVIGATOR, self._on_change, self._has_its_servers))
        follower = self._follower
        if follower is not None:
            follower.admit('')
            self._parts.append(
                ManagedPart(
                    self._runtime,
                    names.WAYPOINT_FOLLOWER,
                    lambda on: follower.admit('' if on else 'is inactive'),
                )
            )

    def deactivate(self, refusal: str) -> None:
        """Refuse goals. Waypoints end here, the trees of navigators by :meth:`TreeGoals.stop_all`."""
        for part in self._parts:
            part.close()
        self._parts.clear()
        self._wait_no_longer()
        self._admission.close(refusal)
        if self._follower is not None:
            self._follower.admit(refusal)

    def _on_change(self, is_active: bool) -> None:
        """A lifecycle manager has changed the state of bt_navigator."""
        if is_active:
            self._wait_for_servers(patient=False)  # Nav2's manager, once answered, demands that it is active
            self._admission.open()
            return
        self._wait_no_longer()
        self._admission.close('is inactive')
        for goal in [*self._at_work, *(goal for goal, *_ in self._waiting)]:
            self._goals.stop(goal, 'bt_navigator was deactivated')

    def _server_timeout(self) -> float:
        """How long a server, or the pose of the robot, is waited for, s of wall time."""
        return self._services.appear_timeout(self._services.server_timeout)

    def _wait_for_servers(self, *, patient: bool) -> None:
        nodes = (node for tree in self._default_trees for node in tree.nodes())
        self._activation = Activation(self._runtime, called_servers(nodes), patient=patient)

    def _wait_no_longer(self) -> None:
        if self._activation is not None:
            self._activation.cancel()

    def _has_its_servers(self) -> bool:
        return self._activation is not None and self._activation.is_over

    # -- whose turn it is --------------------------------------------------------------------------------------------

    def _enqueue(self, goal: NavigatorGoal, go_on: Callable[[], None]) -> None:
        deadline = self._runtime.steady.now() + self._server_timeout()
        self._waiting.append((goal, go_on, deadline))
        self._proceed()

    def _cancel(self, served: ServedGoal) -> None:
        self._goals.cancel(served)
        self._proceed()

    def _proceed(self) -> None:
        """Begin, or end, the goals that wait, in their order, as far as that is decided."""
        if self._look is not None:
            self._look.cancel()
            self._look = None
        while self._waiting:
            goal, go_on, deadline = self._waiting[0]
            if goal.served.active and self._has_to_wait(goal, deadline):
                self._look = self._runtime.post_in(LOOK_SECONDS, self._proceed)
                return
            self._waiting.popleft()
            if goal.served.active:
                self._begin(goal, go_on)

    def _has_to_wait(self, goal: NavigatorGoal, deadline: float) -> bool:
        if goal.poses is None:
            return True  # until they are transformed, or the goal has ended for want of that
        if self._goals.pose is None:
            return self._runtime.steady.now() < deadline
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
        if self._goals.pose is None:
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
        self._goals.end(goal, RunOutcome(Code.ERROR, why))

    # -- goal_pose ---------------------------------------------------------------------------------------------------

    def _on_goal_pose(self, pose: PoseStamped) -> None:
        ActionCall(
            self._services.actions.link(NavigateToPose, names.NAVIGATE_TO_POSE),
            NavigateToPose.Goal(pose=pose),
            on_done=self._goal_pose_ended,
            server_timeout=self._server_timeout(),
        )

    def _goal_pose_ended(self, outcome: GoalOutcome) -> None:
        if outcome.status is not GoalStatus.SUCCEEDED:
            self._runtime.node.get_logger().warning(
                f'{names.GOAL_POSE}: {outcome.reason}', throttle_duration_sec=COMPLAINT_SECONDS
            )


def _waypoint_task(runtime: NodeRuntime, parameters: NavigatorParameters) -> WaypointTask:
    if parameters.waypoint_input is not None:
        return InputAtWaypoint(runtime, parameters.waypoint_input)
    return WaitAtWaypoint(runtime, parameters.waypoint_pause)
