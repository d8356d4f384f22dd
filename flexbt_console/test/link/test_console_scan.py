# SPDX-License-Identifier: BSD-3-Clause
"""What the lidar meets, on real topics: where it is on the map, what is the same as before, and what is none."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.link import scan_link
from flexbt_console.link.scan_link import SCAN_SECONDS, ScanLink
from flexbt_console.link.surroundings_link import SurroundingsFeed, SurroundingsLink
from flexbt_console.mirror.mirror import Change, Mirror
from flexbt_console.mirror.records import ExecutiveSnapshot, FramedPose, GridMap, Points
from flexbt_console.present.style import ASCII
from flexbt_console.ui.screen.robot_panes import MapPane
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.msg import RobotPlan, TreeNode, TreeStatus, TreeStructure
from flexbt_testing.waiting import wait_until


class Lidar:
    """A robot that tells its transforms and scans; the lidar is 1 m ahead of its middle, and turned to the left."""

    def __init__(self, runtime: NodeRuntime) -> None:
        node = runtime.node
        self.time = 10.0
        self._tf = node.create_publisher(TFMessage, '/robot/tf', 100)
        self._scans = node.create_publisher(LaserScan, '/robot/scan', qos_profile_sensor_data)
        self._static = node.create_publisher(TFMessage, '/robot/tf_static', names.transient_local_qos())
        self.tell_static('lidar')

    @property
    def is_heard(self) -> bool:
        return bool(self._tf.get_subscription_count() and self._scans.get_subscription_count())

    def tell_static(self, frame: str) -> None:
        """Put the lidar into this frame."""
        self._static.publish(TFMessage(transforms=[self._transform('base_link', frame, 1.0, math.pi / 2.0)]))

    def _transform(self, parent: str, frame: str, x: float, yaw: float) -> TransformStamped:
        one = TransformStamped(child_frame_id=frame)
        one.header.frame_id, one.header.stamp = parent, self.stamp
        one.transform.translation.x = x
        one.transform.rotation.z, one.transform.rotation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
        return one

    @property
    def stamp(self) -> Time:
        return Time(sec=int(self.time), nanosec=int(self.time % 1.0 * 1e9))

    def move_to(self, x: float) -> None:
        """Put the robot there."""
        self.time += 0.125
        self._tf.publish(TFMessage(transforms=[self._transform('map', 'base_link', x, 0.0)]))

    def scan(self, *ranges: float, **fields: Any) -> None:
        message = LaserScan(angle_increment=math.pi / 2.0, range_min=0.1, range_max=8.0, ranges=list(ranges))
        message.header.frame_id, message.header.stamp = 'lidar', self.stamp
        for name, value in fields.items():
            setattr(message, name, value)
        self._scans.publish(message)


class CountingMirror(Mirror):
    scans = 0
    received: tuple[Points, ...] = ()
    held = 0.0

    def receive_scan(self, scan: Points, seconds: float) -> None:
        super().receive_scan(scan, seconds)
        self.scans += 1
        self.received += (scan,)
        self.held = seconds


@dataclasses.dataclass
class Console:
    clock: ManualClock
    mirror: CountingMirror
    changes: list[Change]

    @property
    def scan(self) -> Points:
        return self.mirror.view().surroundings.scan


@pytest.fixture
def robot_and_console() -> Iterator[tuple[Lidar, Console]]:
    clock = ManualClock()
    console = Console(clock, CountingMirror(clock), [])
    console.mirror.add_listener(console.changes.append)
    with NodeRuntime.open('robot') as far, NodeRuntime.open('console') as near:
        lidar = far.call(lambda: Lidar(far))
        link = SurroundingsLink(near, console.mirror, '/robot', 1e-6)
        wait_until(lambda: lidar.is_heard, 'the console')
        yield lidar, console
        link.close()
        wait_until(lambda: not lidar.is_heard, 'the end of the link')


def until_shown(lidar: Lidar, console: Console, x: float, *ranges: float) -> Points:
    """Have it seen from there, again and again as a lidar does, until the mirror has something else than before."""
    before = console.scan

    def is_new() -> bool:
        lidar.move_to(x)
        lidar.scan(*ranges)
        return console.scan != before

    wait_until(is_new, 'another scan')
    return console.scan


def see_again(lidar: Lidar, console: Console, x: float, *ranges: float) -> None:
    """Have it seen from there until the mirror has got it."""
    heard = console.mirror.scans

    def is_heard() -> bool:
        lidar.move_to(x)
        lidar.scan(*ranges)
        return console.mirror.scans >= heard + 2  # the first may be one of before

    wait_until(is_heard, 'the scan')


def test_points_are_where_the_lidar_was_when_it_met_them(robot_and_console: tuple[Lidar, Console]) -> None:
    lidar, console = robot_and_console
    scan = until_shown(lidar, console, 5.0, 2.0, math.inf, 3.0, math.nan, 0.05)
    assert [(round(x, 3), round(y, 3)) for x, y in scan] == [(6.0, 2.0), (6.0, -3.0)]
    console.changes.clear()
    for noise in (0.02, -0.02, 0.02, -0.02, 0.02):  # while time goes on: nothing is drawn again, and nothing is old
        console.clock.set(console.clock.now() + 0.6 * SCAN_SECONDS)
        see_again(lidar, console, 5.0, 2.0 + noise, math.inf, 3.0, math.nan, 0.05)
    assert console.changes == [] and console.scan is scan
    assert until_shown(lidar, console, 5.0, 1.5, math.inf, 3.0) != scan
    drawn = MapPane(ASCII).draw(console.mirror.view(), 40, 12).plain
    assert drawn.count('*') == 2
    console.clock.set(console.clock.now() + SCAN_SECONDS + 1.0)  # the lidar is silent
    assert console.scan == () and '*' not in MapPane(ASCII).draw(console.mirror.view(), 40, 12).plain


@pytest.mark.parametrize(
    'fields',
    [
        {'angle_increment': math.nan},
        {'angle_min': math.inf},
        {'range_max': math.inf, 'ranges': [1e30, math.inf, -5.0]},
        {'ranges': []},
        {'range_min': math.nan, 'ranges': [2.0]},
    ],
)
def test_a_scan_that_is_none_is_left_aside(robot_and_console: tuple[Lidar, Console], fields: dict[str, Any]) -> None:
    lidar, console = robot_and_console
    for _ in range(10):
        lidar.move_to(5.0)
        lidar.scan(**fields)
    assert until_shown(lidar, console, 5.0, 2.0) != ()
    assert all(math.isfinite(part) for scan in console.mirror.received for point in scan for part in point)


def test_a_scan_that_stays_the_same_is_shown_until_the_next_one_is_looked_at() -> None:
    mirror, period = CountingMirror(ManualClock()), 100.0
    with NodeRuntime.open('robot') as far, NodeRuntime.open('console') as near:
        lidar = far.call(lambda: Lidar(far))
        link = near.call(lambda: ScanLink(near, mirror, '/robot', period, lambda: 'map'))
        wait_until(lambda: lidar.is_heard, 'the console')

        def is_received() -> bool:
            lidar.move_to(5.0)
            lidar.scan(2.0)
            return bool(mirror.held)

        for at_least in (period, 4.0 * period):
            wait_until(is_received, 'the scan')
            assert mirror.held > at_least
            mirror.held = 0.0
            near.call(lambda: setattr(link, '_looked_at', -math.inf))
        near.call(link.close)


def test_transforms_of_a_robot_that_stands_are_not_heard_until_something_changes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scan_link, 'STAND_SECONDS', 0.1)
    with NodeRuntime.open('robot') as far, NodeRuntime.open('console') as near:
        lidar, mirror = far.call(lambda: Lidar(far)), Mirror(near.steady)
        link = near.call(lambda: ScanLink(near, mirror, '/robot', 1e-6, lambda: 'map'))
        wait_until(lambda: lidar.is_heard, 'the console')
        x, told_at, reach, sequence = 5.0, 5.0, 2.0, 0

        def shows(is_heard: bool) -> bool:
            """Return whether the scan is where it belongs, and whether transforms are heard, too."""
            nonlocal sequence
            sequence += 1
            mirror.receive_snapshot(
                ExecutiveSnapshot('e', sequence, robot_pose=FramedPose(told_at, 0.0), heartbeat_period=10.0)
            )
            lidar.move_to(x)
            lidar.scan(reach)
            points = [(round(a, 3), round(b, 3)) for a, b in mirror.view().surroundings.scan]
            return points == [(x + 1.0, reach)] and lidar.is_heard is is_heard

        wait_until(lambda: shows(is_heard=False), 'rest')
        assert near.call(lambda: link._pause) == 4e-6
        mirror.receive_snapshot(
            ExecutiveSnapshot('e', sequence + 1, robot_pose=FramedPose(5.1, 0.0), heartbeat_period=10.0)
        )
        assert near.call(lambda: link._pause) == 1e-6  # somebody moves it
        before = sequence = sequence + 1
        wait_until(lambda: shows(is_heard=False) and sequence > before + 20, 'more of the same')
        reach = 1.0  # somebody comes
        wait_until(lambda: shows(is_heard=True), 'the new scan')
        wait_until(lambda: shows(is_heard=False), 'rest')
        x = told_at = 7.0  # between walls all is as it was
        wait_until(lambda: shows(is_heard=True), 'the new place')
        wait_until(lambda: shows(is_heard=False), 'rest')
        told_at = 9.0  # odd, and all that is known is that it may have moved
        wait_until(lambda: shows(is_heard=True), 'transforms')
        near.call(link.close)
        wait_until(lambda: not lidar.is_heard, 'the end of the link')


@pytest.mark.parametrize('field', ['transforms[0].child_frame_id', 'header.frame_id'])
def test_names_of_any_length_are_refused_in_a_short_line(
    robot_and_console: tuple[Lidar, Console], field: str, capfd: pytest.CaptureFixture[str]
) -> None:
    lidar, _ = robot_and_console
    told = ''

    def is_told() -> bool:
        nonlocal told
        if field.startswith('transforms'):
            lidar.tell_static('\N{SNOWMAN}' * 100_000)
        lidar.scan(2.0, header=Header(frame_id='x' * 100_000))
        told += capfd.readouterr().err
        return f'{field} has 100000 characters' in told

    wait_until(is_told, lambda: told[-2000:])
    assert max(map(len, told.splitlines())) < 1000


def test_the_name_of_a_place_at_the_edge_is_read() -> None:
    known = Mirror(
        ManualClock(), {'corridor': FramedPose(9.9, 0.5), 'dock': FramedPose(0.1, 0.5), 'a' * 60: FramedPose(5.0, 5.0)}
    )
    known.receive_map(GridMap(100, 60, 0.1, 0.0, 0.0, bytes(6000)))
    shown = MapPane(ASCII).draw(known.view(), 40, 12).plain
    assert 'corridor@' in shown and '@dock' in shown
    assert all(len(line) <= 40 for line in shown.splitlines())


@pytest.mark.parametrize(
    ('topic', 'message', 'field'),
    [
        (names.TREE_STRUCTURE, TreeStructure(run_id='x' * 2_000), 'run_id'),
        (names.TREE_STRUCTURE, TreeStructure(nodes=[TreeNode(uid=1, name='\N{SNOWMAN}' * 100_000)]), 'nodes[0].name'),
        (names.TREE_STATUS, TreeStatus(statuses=[0] * 200_000), 'statuses'),
        (names.MAP, OccupancyGrid(header=Header(frame_id='x' * 2_000)), 'frame_id'),
        (names.EXECUTIVE_PLAN, RobotPlan(x=[0.0] * 30_000, y=[0.0] * 30_000), 'x has 30000'),
    ],
)
def test_what_has_too_much_in_it_is_left_aside(topic: str, message: Any, field: str) -> None:
    mirror = Mirror(ManualClock())
    with pytest.raises(LimitExceededError) as raised:
        SurroundingsFeed(mirror).receivers[topic](message)
    assert field in str(raised.value) and len(str(raised.value)) < 500
    assert mirror.view() == Mirror(ManualClock()).view()


def test_a_tree_with_parents_in_a_ring_is_left_aside() -> None:
    mirror = Mirror(ManualClock())
    nodes = [TreeNode(uid=uid, parent=parent) for uid, parent in ((1, 2), (2, 1), (3, 1))]
    with pytest.raises(ValueError, match=r'node 1 of tree .Drive. has the parent 2'):
        SurroundingsFeed(mirror).receivers[names.TREE_STRUCTURE](TreeStructure(behavior_tree='Drive', nodes=nodes))
    assert mirror.view().trees == ()
