# SPDX-License-Identifier: BSD-3-Clause
"""The rules of the executive's own way to stop the robot, on a manual clock: what it does when, to the period."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, TwistStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.qos import qos_profile_action_status_default

from flexbt_common.middleware.received_messages import UNKNOWN_WRITER
from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_onboard.runs import motion_stop
from flexbt_onboard.runs.motion_stop import MotionParameters, MotionStop

SERVERS = ('spin', 'navigate_to_pose', 'drill', 'follow_path', 'dock_robot', 'bt_executor', 'backup')
PERIOD, REST_SECONDS, FRONT_SECONDS, HELD_FRONT_SECONDS = 1 / 16, 1 / 4, 3 / 16, 2 / 16
"""Other than those of the product, for sums without rounding."""

FRONT, MIDDLE, REST = ['bt_executor'], ['dock_robot', 'navigate_to_pose'], ['follow_path', 'spin', 'backup']


class Surroundings:
    """The node, the clock, the robot and the servers of a stop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, is_stamped: bool = False, peers: Any = None) -> None:
        self.steady = ManualClock()
        self.clock = SimpleNamespace(stamp=lambda: Time(sec=7))
        self.node = self
        self.pose = PoseStamped()
        self.problem = ''
        self.servers: tuple[str, ...] = SERVERS
        self.writers: dict[str, list[bytes]] = {}
        self.zeros: list[float] = []
        self.messages: list[Any] = []
        self.cancels: list[str] = []
        self.answers: dict[str, Callable[[], None]] = {}
        self.given_up: list[str] = []
        self.links: list[str] = []
        self.tell: dict[str, Callable[[Any], None]] = {}
        monkeypatch.setattr(motion_stop, '_PERIOD', PERIOD)
        monkeypatch.setattr(motion_stop, '_REST_SECONDS', REST_SECONDS)
        monkeypatch.setattr(motion_stop, '_FRONT_SECONDS', FRONT_SECONDS)
        monkeypatch.setattr(motion_stop, '_HELD_FRONT_SECONDS', HELD_FRONT_SECONDS)
        monkeypatch.setattr(motion_stop, 'ServiceCall', self._ask)
        monkeypatch.setattr(motion_stop, 'ReceivedMessages', self._subscribe)
        this: Any = self
        pose: Any = SimpleNamespace(latest=lambda: self.pose, problem=lambda: self.problem)
        parameters = MotionParameters(stamped_cmd_vel=is_stamped, cmd_vel_topic='wheels')
        self.stop = MotionStop(this, this, pose, parameters, peers)

    # -- of the runtime and the node ----------------------------------------------------------------------------------

    def post_in(self, seconds: float, fn: Callable[[], object]) -> Timer:
        return self.steady.call_at(self.steady.now() + seconds, lambda: (fn(), None)[1])

    def on_close(self, fn: Callable[[], None]) -> None:
        self.close = fn

    def call(self, fn: Callable[[], None]) -> None:
        fn()

    def create_publisher(self, message_type: Any, topic: str, depth: int) -> Any:
        self.published = (message_type, topic, depth)
        return self

    def publish(self, message: Any) -> None:
        self.zeros.append(self.steady.now())
        self.messages.append(message)

    def count_services(self, service: str) -> int:
        return sum(service == f'/robot/{name}/_action/cancel_goal' for name in self.servers)

    def resolve_service_name(self, name: str) -> str:
        return f'/robot/{name}'

    resolve_topic_name = resolve_service_name

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        action = topic.removeprefix('/robot/').removesuffix('/_action/status')
        return [
            SimpleNamespace(endpoint_gid=[*writer], node_name=f'node_{writer.decode()}', node_namespace='/')
            for writer in self.writers.get(action, [])
        ]

    # -- of services and topics ---------------------------------------------------------------------------------------

    def link(self, service_type: Any, name: str) -> Any:
        assert service_type is CancelGoal
        action = name.removesuffix('/_action/cancel_goal')
        return SimpleNamespace(action=action, is_ready=lambda: self.links.append(action))

    def _ask(self, link: Any, request: Any, on_done: Callable[[Any], None]) -> Any:
        assert request == CancelGoal.Request(), 'all goals'
        self.cancels.append(link.action)
        self.answers[link.action] = lambda: on_done(Mock())
        return SimpleNamespace(cancel=lambda: self.given_up.append(link.action))

    def _subscribe(self, node: Any, kind: Any, topic: str, qos: Any, told: Callable[[Any], None], limit: int) -> None:
        assert (node, kind, qos) == (self, GoalStatusArray, qos_profile_action_status_default)
        assert limit > 100_000
        action = topic.removesuffix('/_action/status')
        assert action not in self.tell, 'one subscription for each action'
        self.tell[action] = told

    def report(self, action: str, writer: bytes, *statuses: int) -> None:
        """Let a server tell its goals."""
        goals = GoalStatusArray(status_list=[GoalStatus(status=status) for status in statuses])
        self.tell[action](SimpleNamespace(writer=writer, unpack=lambda _: goals))

    def holds(self) -> bool:
        """Return whether the robot is held."""
        return self.stop.is_holding

    def take_cancels(self) -> list[str]:
        """Return the cancels since the last call."""
        taken, self.cancels = self.cancels, []
        return taken

    def answer(self, *actions: str) -> None:
        """Let servers answer a cancel."""
        for action in actions:
            self.answers.pop(action)()


@pytest.fixture
def around(monkeypatch: pytest.MonkeyPatch) -> Surroundings:
    return Surroundings(monkeypatch)


def times(first: float, end: float) -> list[float]:
    """Return the periods from ``first`` to before ``end``."""
    return [first + number * PERIOD for number in range(int((end - first) / PERIOD))]


def test_zero_velocity_is_commanded_for_a_second_and_while_the_robot_moves(around: Surroundings) -> None:
    assert around.published == (Twist, 'wheels', 1)
    around.stop.hold()
    assert around.holds()
    around.steady.set(1.99)
    around.stop.hold()  # which it does already
    assert around.zeros == times(0.0, 1.0)
    around.pose = PoseStamped(pose=Pose(position=Point(x=1.0)))
    around.steady.set(3.99)
    assert around.zeros[16:] == times(2.0, 2.0 + REST_SECONDS)
    around.problem = 'nobody knows'
    around.steady.set(5.99)
    assert around.zeros[20:] == times(4.0, 6.0)
    around.problem = ''
    around.steady.set(7.99)
    assert around.zeros[52:] == times(6.0, 6.0 - PERIOD + REST_SECONDS)
    around.stop.release()
    assert not around.holds()
    around.problem = 'nobody knows'
    around.steady.advance(10.0)
    assert around.messages == [Twist()] * 55
    around.stop.hold()
    around.steady.advance(0.02)
    around.close()
    assert around.steady.next_timer() is None, 'the end of the node lets the robot go'


def test_the_velocities_are_stamped_where_that_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    around = Surroundings(monkeypatch, is_stamped=True)
    assert around.published == (TwistStamped, 'wheels', 1)
    around.stop.hold()
    expected = TwistStamped()
    expected.header.stamp = Time(sec=7)
    assert around.messages == [expected]


def test_all_goals_are_canceled_every_ten_periods_those_that_send_others_first(around: Surroundings) -> None:
    around.stop.hold()
    assert around.take_cancels() == FRONT
    around.answer(*FRONT)
    assert around.take_cancels() == MIDDLE[:1], 'a rank of its own'
    around.answer('dock_robot')
    assert around.take_cancels() == MIDDLE[1:]
    around.answer('navigate_to_pose')
    assert around.take_cancels() == REST
    around.answer(*REST)
    second, third = 10 * PERIOD, 20 * PERIOD
    around.steady.set(second - 0.01)
    assert around.take_cancels() == []
    around.steady.set(second)
    assert around.take_cancels() == FRONT, 'again'
    around.steady.set(second + HELD_FRONT_SECONDS - 0.01)
    assert around.take_cancels() == []
    around.steady.set(second + HELD_FRONT_SECONDS)
    assert around.take_cancels() == [*MIDDLE, *REST], 'whose turn comes although nobody answers'
    around.answer(*MIDDLE, *REST)
    around.servers = ('spin',)
    around.steady.set(third)
    assert around.take_cancels() == []
    around.steady.set(third + HELD_FRONT_SECONDS)
    assert around.take_cancels() == ['spin'], 'the others have no server any more'


def test_goals_of_others_are_canceled_where_they_are_sent_and_only_once(around: Surroundings) -> None:
    around.stop.cancel_others()
    around.stop.cancel_others()  # the first one goes on
    assert around.take_cancels() == FRONT
    around.steady.advance(FRONT_SECONDS - 0.01)
    assert around.take_cancels() == [], 'longer than where the robot is held'
    around.steady.advance(0.01)
    assert around.take_cancels() == MIDDLE
    around.stop.cancel_others()
    assert around.take_cancels() == [], 'the answers are pending'
    around.answer(*FRONT)
    around.steady.advance(10.0)
    assert around.take_cancels() == [] and not around.holds() and not around.zeros
    around.answer(*MIDDLE)
    around.stop.cancel_others()
    assert around.take_cancels() == FRONT


def test_what_waits_for_an_answer_is_dropped_for_the_next_run(around: Surroundings) -> None:
    around.stop.hold()
    around.stop.release()
    around.stop.drop_cancels()
    assert around.given_up == FRONT
    around.answer(*FRONT)
    around.steady.advance(10.0)
    assert around.take_cancels() == FRONT
    around.stop.cancel_others()
    around.stop.drop_cancels()
    around.steady.advance(10.0)
    assert around.take_cancels() == FRONT and around.steady.next_timer() is None


def test_servers_are_discovered_in_advance_and_those_without_a_server_are_left_alone(around: Surroundings) -> None:
    around.stop.prepare()
    around.stop.prepare()
    assert set(around.links) == set(around.tell) == {*FRONT, *MIDDLE, *REST}
    assert 'drill' in around.servers


A, B = b'a', b'b'
GOES_ON = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)
OVER = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


def test_a_goal_goes_on_until_its_server_tells_its_end_or_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[bytes] = []
    around = Surroundings(monkeypatch, peers=SimpleNamespace(has_ended=ended.__contains__))
    around.writers = {'spin': [A, B], 'backup': [B]}
    around.stop.prepare()
    of_a, of_b, backup = ('spin', A), ('spin', B), ('backup', B)
    assert around.stop.going_on == {}
    for status in GOES_ON:
        around.report('spin', A, *OVER, status)
        around.report('backup', B, status)
        assert around.stop.going_on == {of_a: 'spin (of /node_a)', backup: 'backup (of /node_b)'}
        around.report('spin', B)
        around.report('spin', A, *OVER)
        assert around.stop.going_on.keys() == {backup}
    around.report('spin', UNKNOWN_WRITER, GoalStatus.STATUS_EXECUTING)
    assert around.stop.going_on.keys() == {of_a, of_b, backup}, 'any of the servers'
    ended.append(A)
    assert around.stop.going_on.keys() == {of_b, backup}
    around.writers = {'spin': [B]}
    assert around.stop.going_on.keys() == {of_b}
    broken = Mock(writer=B, unpack=Mock(side_effect=ValueError))
    around.tell['spin'](broken)
    broken.unpack.assert_called_once_with(GoalStatusArray)
    assert around.stop.going_on.keys() == {of_b}
    around.report('spin', UNKNOWN_WRITER)
    assert around.stop.going_on == {}
    assert around.take_cancels() == [], 'nothing is held'
    monkeypatch.setattr(motion_stop, 'writer_name', lambda *_: '')
    around.report('spin', B, GoalStatus.STATUS_EXECUTING)
    assert around.stop.going_on == {of_b: 'spin (of a node that is gone)'}


def test_a_goal_that_begins_while_the_robot_is_held_is_canceled_at_once(around: Surroundings) -> None:
    around.stop.hold()
    for actions in (FRONT, MIDDLE[:1], MIDDLE[1:], REST):
        around.answer(*actions)
    around.take_cancels()
    for status, canceled in (*((one, []) for one in (GOES_ON[2], *OVER)), *((one, ['spin']) for one in GOES_ON[:2])):
        around.report('spin', A, status)
        assert around.take_cancels() == canceled
        around.report('spin', A, status)
        assert around.take_cancels() == [], 'the answer is pending'
        around.answer(*canceled)


ANGLES = st.floats(-math.pi, math.pi)
LENGTHS = st.floats(-100.0, 100.0)


def turned(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return an orientation."""
    (a, b), (c, d), (e, f) = ((math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw))
    return Quaternion(
        w=a * c * e + b * d * f, x=b * c * e - a * d * f, y=a * d * e + b * c * f, z=a * c * f - b * d * e
    )


@given(LENGTHS, LENGTHS, LENGTHS, ANGLES, ANGLES, st.floats(-1.5, 1.5), st.floats(0.0, 0.04), st.floats(0.0, 0.02))
def test_a_pose_is_another_one_if_it_is_further_or_turned_further_than_noise(
    x: float, y: float, z: float, yaw: float, roll: float, pitch: float, angle: float, length: float
) -> None:
    one = Pose(position=Point(x=x, y=y, z=z), orientation=turned(roll, pitch, yaw))
    for dx, dy, dz in ((length, 0.0, 0.0), (0.0, -length, 0.0), (0.0, 0.0, length), (length * 0.6, length * 0.8, 0.0)):
        for by in (angle, -angle):
            position = Point(x=x + dx, y=y + dy, z=z + dz)
            other = Pose(position=position, orientation=turned(0.0, 0.0, yaw + by))
            if abs(angle - motion_stop._REST_RADIANS) > 1e-6 and abs(length - motion_stop._REST_METRES) > 1e-6:
                is_another = angle > motion_stop._REST_RADIANS or length > motion_stop._REST_METRES
                assert motion_stop._differ(one, other) is motion_stop._differ(other, one) is is_another
    assert motion_stop._differ(one, Pose(position=Point(x=math.nan)))
    assert not motion_stop._differ(Pose(), Pose(position=Point(x=motion_stop._REST_METRES)))


def test_a_turn_of_just_the_noise_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_stop, '_REST_RADIANS', math.pi)
    assert not motion_stop._differ(Pose(), Pose(orientation=Quaternion(z=1.0, w=0.0)))
