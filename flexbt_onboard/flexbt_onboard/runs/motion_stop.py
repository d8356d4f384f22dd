# SPDX-License-Identifier: BSD-3-Clause
"""A stop of the robot that bypasses the nodes that drive it, for stops whose cancel no server confirms.

It asks the servers that move the robot to cancel all of their goals (action_msgs/srv/CancelGoal with neither an id nor
a time means all goals), and commands zero velocity until the robot stands still.

A server may ignore the cancel. The status topic of its goals shows if one continues, as long as the server is alive; a
restarted server publishes nothing before its first goal. The response to a cancel of all goals is not sufficient, since
it lists neither goals whose cancel is refused nor goals that are already being canceled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Pose, Twist, TwistStamped
from rclpy.qos import qos_profile_action_status_default

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received, ReceivedMessages, writer_name
from flexbt_common.names import BT_EXECUTOR
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.message_fields import yaw_of_quaternion
from flexbt_core.clock.clock import Timer
from flexbt_core.values.parameter_fields import parameter
from flexbt_onboard.link.peers import PeersWatch
from flexbt_onboard.link.robot_state import RobotPose

MOTION_ACTIONS: Final = (
    BT_EXECUTOR,
    'navigate_to_pose',
    'navigate_through_poses',
    'follow_path',
    'follow_waypoints',
    'spin',
    'backup',
    'drive_on_heading',
    'assisted_teleop',
    'dock_robot',
    'undock_robot',
)
"""Actions that move the robot, by their default names: the one of the BT server, and those of Nav2."""

_FRONT: Final = {
    BT_EXECUTOR: 0,
    'dock_robot': 1,
    'undock_robot': 1,
    'follow_waypoints': 2,
    'navigate_to_pose': 3,
    'navigate_through_poses': 3,
}
"""Actions that move the robot through other actions, with their rank. They are canceled in the order of the ranks,
before all other actions. An action whose subordinate goal is canceled first fails instead of being canceled, and
opennav_docking then sends that goal again."""

_REST: Final = max(_FRONT.values()) + 1

_STATUS_BYTES: Final = 1_000_000
"""Maximum size of the status of a server's goals, bytes: 35,000 goals."""

_PERIOD: Final = 0.05
"""Time between two commands of zero velocity, s; as in Nav2's controller server."""

_CANCEL_PERIODS: Final = 10
"""Number of these periods between two cancels of all goals."""

_FRONT_SECONDS: Final = 0.2
_HELD_FRONT_SECONDS: Final = 0.1
"""Maximum total time that actions of later ranks wait for the answers of earlier ones, s; less while the robot is held:
then each goal that is sent again is canceled, too."""

_LEAST_SECONDS: Final = 1.0
"""Minimum time for which zero velocity is commanded, s. It is commanded again if the robot moves later, and all the
time while nobody knows where it is."""

_BEGINS: Final = frozenset((GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING))
_GOES_ON: Final = _BEGINS | {GoalStatus.STATUS_CANCELING}

_REST_SECONDS: Final = 0.3
_REST_METRES: Final = 0.01
_REST_RADIANS: Final = 0.02
"""The robot stands still if its pose has changed by less than this in ``_REST_SECONDS``. Localized poses are noisy."""


@dataclass(frozen=True)
class MotionParameters:
    """The parameters for stopping the robot without the nodes that drive it."""

    pose_topic: str = parameter('pose_topic', names.POSE, 'topic of the robot pose (geometry_msgs/msg/PoseStamped)')
    global_frame: str = parameter('global_frame', 'map', 'frame of the pose, when no node publishes it')
    robot_base_frame: str = parameter('robot_base_frame', 'base_link', 'frame of the robot')
    motion_actions: tuple[str, ...] = parameter(
        'motion_actions',
        MOTION_ACTIONS,
        'actions that move the robot: all of their goals are canceled when a stop is not confirmed in time',
    )
    cmd_vel_topic: str = parameter(
        'cmd_vel_topic',
        names.CMD_VEL,
        'topic of the velocity commands, for zero velocity when a stop is not confirmed in time',
    )
    stamped_cmd_vel: bool = parameter(
        'enable_stamped_cmd_vel', False, 'velocity commands are TwistStamped instead of Twist'
    )

    @property
    def frames(self) -> tuple[str, str]:
        """The frames between which the transform is the pose of the robot."""
        return self.global_frame, self.robot_base_frame


class MotionStop:
    """The stop of the robot with direct cancels and zero velocity. Used on the executor thread only.

    It ignores configured actions that have no server. ``peers`` knows at once when the process of a server has ended,
    which the middleware reports only after the lease.
    """

    def __init__(
        self,
        runtime: Runtime,
        services: ServiceLinks,
        pose: RobotPose,
        parameters: MotionParameters,
        peers: PeersWatch | None = None,
    ) -> None:
        self._runtime = runtime
        self._services = services
        self._pose = pose
        self._parameters = parameters
        self._peers = peers
        message_type: Any = TwistStamped if parameters.stamped_cmd_vel else Twist
        self._commands = runtime.node.create_publisher(message_type, parameters.cmd_vel_topic, 1)
        runtime.on_close(lambda: runtime.call(self.release))
        self._asked: dict[str, ServiceCall] = {}
        self._busy: dict[str, set[bytes]] = {}  # by action: writers with an active goal
        self._timer: Timer | None = None
        self._unasked: list[str] = []  # in the order of their ranks
        self._patience: Timer | None = None
        self._seen = Pose()
        self._seen_at = -math.inf

    @property
    def is_holding(self) -> bool:
        """True while it holds the robot."""
        return self._timer is not None

    def prepare(self) -> None:
        """Discover the servers in advance, so that a later cancel need not wait for that."""
        for name in self.servers():
            self._services.link(CancelGoal, f'{name}/_action/cancel_goal').is_ready()  # or its discovery begins
            self._listen(name)

    @property
    def going_on(self) -> Mapping[tuple[str, bytes], str]:
        """Actions with a goal that has not ended, by action and writer, as texts with the node of the server.

        They are based on reports of live servers since :meth:`prepare` or :meth:`hold`. A killed server is included
        until its lease expires, unless it is known to have ended.
        """
        node = self._runtime.node
        return {
            (name, writer): f'{name} (of {writer_name(node, _status_topic(name), writer) or "a node that is gone"})'
            for name, busy in self._busy.items()
            for writer in busy and busy & self._writers(name)
            if self._peers is None or not self._peers.has_ended(writer)
        }

    def hold(self) -> None:
        """Hold the robot from now on, until :meth:`release`."""
        if self._timer is None:
            self._act(0, self._runtime.steady.now() + _LEAST_SECONDS)

    def cancel_others(self) -> None:
        """Cancel once the goals with which other programs move the robot."""
        if not self._unasked:
            self._cancel_all_of([name for name in self.servers() if name in _FRONT])

    def drop_cancels(self) -> None:
        """Drop the cancels that still wait for their servers, since they would cancel the goals of the next run."""
        self._unasked.clear()
        for call in self._asked.values():
            call.cancel()

    def release(self) -> None:
        """Stop holding the robot, so that it can move again."""
        self._unasked.clear()
        for timer in (self._timer, self._patience):
            if timer is not None:
                timer.cancel()
        self._timer = self._patience = None

    def _act(self, periods: int, zero_until: float) -> None:
        self._timer = self._runtime.post_in(_PERIOD, lambda: self._act(periods + 1, zero_until))
        if self._may_move() or self._runtime.steady.now() < zero_until:
            self._command_zero()
        if periods % _CANCEL_PERIODS == 0:
            self._cancel_all_of(self.servers())

    def servers(self) -> list[str]:
        """Return the actions that move the robot and currently have a server."""
        node = self._runtime.node
        return [
            name
            for name in self._parameters.motion_actions
            if node.count_services(node.resolve_service_name(f'{name}/_action/cancel_goal'))
        ]

    def _listen(self, name: str) -> None:
        if name in self._busy:
            return
        busy = self._busy[name] = set()

        def told(received: Received) -> None:
            try:
                goals = received.unpack(GoalStatusArray).status_list
            except ValueError:
                return  # not a status of an action server
            writers = self._writers(name) if received.writer == UNKNOWN_WRITER else {received.writer}
            statuses = {goal.status for goal in goals}
            if not _BEGINS.isdisjoint(statuses) and self.is_holding:
                self._cancel_all(name)  # a new goal must not move the robot until the next round of cancels
            if not _GOES_ON.isdisjoint(statuses):
                busy.update(writers)
            else:
                busy.difference_update(writers)

        qos = qos_profile_action_status_default
        ReceivedMessages(self._runtime.node, GoalStatusArray, _status_topic(name), qos, told, _STATUS_BYTES)

    def _writers(self, name: str) -> set[bytes]:
        """Return the ids of the writers that report the goals of an action, in the form of :class:`Received`."""
        node = self._runtime.node
        endpoints = node.get_publishers_info_by_topic(node.resolve_topic_name(_status_topic(name)))
        return {bytes(endpoint.endpoint_gid) for endpoint in endpoints}

    def _cancel_all_of(self, actions: Sequence[str]) -> None:
        """Cancel all goals of actions, rank by rank: when the earlier ranks have answered, or after a short time."""
        self._unasked = sorted(actions, key=_rank)
        if self._patience is not None:
            self._patience.cancel()
        patience = _HELD_FRONT_SECONDS if self.is_holding else _FRONT_SECONDS
        self._patience = self._runtime.post_in(patience, self._ask_all)
        self._ask_answered()

    def _ask_all(self) -> None:
        while self._unasked:
            self._cancel_all(self._unasked.pop(0))

    def _ask_answered(self) -> None:
        while self._unasked and all(_rank(name) >= _rank(self._unasked[0]) for name in self._asked):
            self._cancel_all(self._unasked.pop(0))

    def _cancel_all(self, name: str) -> None:
        self._listen(name)
        if name in self._asked:
            return  # its last answer is still pending
        service = f'{name}/_action/cancel_goal'

        def answered(_outcome: ServiceOutcome) -> None:
            del self._asked[name]
            self._ask_answered()

        self._asked[name] = ServiceCall(
            self._services.link(CancelGoal, service), CancelGoal.Request(), on_done=answered
        )

    def _may_move(self) -> bool:
        """Return whether the robot moves, or nobody knows where it is."""
        pose, now = self._pose.latest().pose, self._runtime.steady.now()
        if self._pose.problem() or _differ(self._seen, pose):
            self._seen, self._seen_at = pose, now
        return now - self._seen_at < _REST_SECONDS

    def _command_zero(self) -> None:
        if self._parameters.stamped_cmd_vel:
            message = TwistStamped()
            message.header.stamp = self._runtime.clock.stamp()
            self._commands.publish(message)
        else:
            self._commands.publish(Twist())


def _rank(action: str) -> int:
    return _FRONT.get(action, _REST)


def _status_topic(action: str) -> str:
    return f'{action}/_action/status'


def _differ(one: Pose, other: Pose) -> bool:
    """Return whether two poses differ by more than noise, or one is not a number."""
    a, b = one.position, other.position
    turned = abs(math.remainder(yaw_of_quaternion(one.orientation) - yaw_of_quaternion(other.orientation), math.tau))
    return not (math.dist((a.x, a.y, a.z), (b.x, b.y, b.z)) <= _REST_METRES and turned <= _REST_RADIANS)
