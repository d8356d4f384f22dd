# SPDX-License-Identifier: BSD-3-Clause
"""An operator and observer of the robot, directly on the topics: a test without the console uses it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalOutcome
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, PendingDecision
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.waiting import DEADLINE, MESSAGE_BYTES, uncontended_time, wait_until

T = TypeVar('T')

_LOST_SECONDS: Final = 5.0
"""Time after which a request to the simulator counts as lost, s."""


class Probe(Operator):
    """An operator that also sees the robot's pose, and sends goals to its servers."""

    def __init__(self, runtime: NodeRuntime) -> None:
        super().__init__(runtime, 'test')
        self._links = ActionLinks(runtime)
        self._services = ServiceLinks(runtime)
        self.pose: PoseStamped | None = None
        self.moved_at = 0.0
        """Uncontended time of the last observed movement, s."""
        self.moved_stamp = 0.0
        """Time stamp of the pose with the last movement, s on the robot's clock."""
        qos = QoSProfile(depth=100)
        # Process all waiting messages at once; otherwise observations would be seconds old on a busy machine.
        runtime.call(lambda: ReceivedMessages(runtime.node, PoseStamped, names.POSE, qos, self._on_pose, MESSAGE_BYTES))

    def _on_pose(self, received: Received) -> None:
        pose: PoseStamped = received.unpack(PoseStamped)
        if self.pose is not None and _differ(self.pose, pose):
            self.moved_at = uncontended_time()
            self.moved_stamp = stamp(pose)
        self.pose = pose

    def wait(self, condition: Callable[[], T], what: str, timeout: float = DEADLINE) -> T:
        """Return the first true value of the condition. Fail with ``what`` if it does not become true in time."""
        return cast(T, wait_until(condition, lambda: f'{what}; last status: {self.status}', timeout))

    def wait_ready(self, timeout: float = DEADLINE) -> None:
        """Wait until everything runs and is connected."""
        self.wait(lambda: self.pose and self._is_heard() and self._all_ready(), 'readiness', timeout)

    def _is_heard(self) -> bool:
        """Return whether the executive receives commands. Other nodes, such as a recorder, may do so earlier."""
        listeners = self.console.node.get_subscriptions_info_by_topic(names.EXECUTIVE_COMMAND)
        is_known = any(one.node_name == 'onboard_executive' for one in listeners)
        return is_known and bool(self._commands.get_subscription_count() >= len(listeners))

    def _all_ready(self) -> bool:
        return bool(self.statuses) and all(peer.ready for peer in self.status.peers)

    def peer_alive(self, name: str) -> bool | None:
        """Return whether the executive sees a node alive."""
        return next((bool(peer.alive) for peer in self.status.peers if peer.name.endswith(f'/{name}')), None)

    def wait_state(self, state: int) -> None:
        """Wait until the executive is in a state."""
        self.wait(lambda: self.status.state == state, f'executive in state {state}')

    def drive_to(self, x: float, y: float, driven: float = 0.5) -> None:
        """Start the first demonstration, send a goal, and wait until the robot has driven ``driven`` metres."""
        self.wait_state(ExecutiveStatus.IDLE)
        self.applied(ExecutiveCommand.START, behavior='Navigate', autonomy=2)

        def decision() -> PendingDecision | None:
            decisions = self.status.decisions
            asked = [one for one in decisions if one.kind == PendingDecision.INPUT]
            return asked[0] if asked and self.status.state == ExecutiveStatus.RUNNING else None

        asked = self.wait(decision, 'decision about a goal')
        assert asked is not None
        goal = PoseStamped()
        goal.header.frame_id = 'map'
        goal.pose.position.x, goal.pose.position.y, goal.pose.orientation.w = x, y, 1.0
        start = self.pose
        assert start is not None
        self.applied(ExecutiveCommand.ANSWER, decision_id=asked.id, inputs=[to_entry('goal', goal)])
        self.wait(lambda: self.pose is not None and _distance(start, self.pose) > driven, 'robot driving')

    def reset(self) -> None:
        """Put the robot back to its pose at the start of the simulation.

        The request is repeated, because a simulator that has not discovered this client yet loses the response.
        """
        link = self._services.link(Trigger, names.RESET)
        answer: Any = self.wait(lambda: service_outcome(link, Trigger.Request(), _LOST_SECONDS).response, 'reset')
        assert answer.success, answer.message
        before = self.pose
        self.wait(lambda: self.pose is not before, 'pose after the reset')

    def wait_at_rest(self, quiet: float = 1.5) -> None:
        """Wait until poses, not their absence, show the robot at rest for ``quiet`` s on the robot's clock."""
        began = self.pose

        def still() -> bool:
            assert began is not None and self.pose is not None
            return stamp(self.pose) - max(self.moved_stamp, stamp(began)) > quiet

        self.wait(still, 'robot at rest')

    def stop(self) -> float:
        """Send the operator's stop and return the uncontended time."""
        now = uncontended_time()
        self.send(ExecutiveCommand.STOP)
        return now

    def ask(self, service_type: Any, name: str, request: Any) -> Any:
        """Call a service and return the response."""
        outcome = service_outcome(self._services.link(service_type, name), request, DEADLINE)
        assert outcome.ok, outcome.reason
        return outcome.response

    def call(self, action_type: Any, name: str, goal: Any, timeout: float = DEADLINE) -> GoalOutcome:
        """Send a goal, wait for its end and return the outcome."""
        return SentGoal(self._links.link(action_type, name), goal, timeout).wait()

    def active_goals(self, action: str) -> int:
        """Return the number of active goals of an action, from the list on its server's status topic."""
        from action_msgs.msg import GoalStatus, GoalStatusArray

        seen: list[GoalStatusArray] = []
        topic = f'{action}/_action/status'
        subscription = self.console.call(
            lambda: self.console.node.create_subscription(
                GoalStatusArray, topic, seen.append, names.transient_local_qos()
            )
        )
        self.wait(lambda: bool(seen), f'list of goals of {action}')
        self.console.call(lambda: self.console.node.destroy_subscription(subscription))
        working = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
        return sum(status.status in working for status in seen[-1].status_list)


def stamp(pose: PoseStamped) -> float:
    """Return the time stamp of a pose, s on the robot's clock."""
    return float(pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec)


def _distance(one: PoseStamped, other: PoseStamped) -> float:
    a, b = one.pose.position, other.pose.position
    return math.dist((a.x, a.y), (b.x, b.y))


def _differ(one: PoseStamped, other: PoseStamped) -> bool:
    return _distance(one, other) > 1e-6 or abs(one.pose.orientation.z - other.pose.orientation.z) > 1e-6
