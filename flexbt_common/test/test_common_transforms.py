# SPDX-License-Identifier: BSD-3-Clause
"""Transforms between frames: the buffer's rules, and what a node makes of tf and tf_static."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.node import Node
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.transform_buffer import HISTORY, Rigid, TransformBuffer
from flexbt_common.transform_listener import TransformListener, take_transforms
from flexbt_testing.waiting import wait_until

numbers = st.floats(-100.0, 100.0)
parts = st.floats(-1.0, 1.0)
rotations = st.tuples(parts, parts, parts, parts).filter(lambda q: math.hypot(*q) > 0.1)
transforms = st.builds(Rigid.of, st.tuples(numbers, numbers, numbers), rotations)


def matrix(transform: Rigid) -> list[list[float]]:
    """Return the first three rows of the 4 x 4 matrix, by the textbook."""
    (x, y, z, w), at = transform.rotation, transform.translation
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), at[0]],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), at[1]],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), at[2]],
    ]


def same(one: Rigid, other: Rigid) -> bool:
    return all(
        a == pytest.approx(b, abs=1e-6)
        for row, line in zip(matrix(one), matrix(other), strict=True)
        for a, b in zip(row, line, strict=True)
    )


@given(transforms, st.tuples(numbers, numbers, numbers))
def test_a_transform_is_its_matrix(transform: Rigid, point: tuple[float, float, float]) -> None:
    by_matrix = [sum(row[i] * point[i] for i in range(3)) + row[3] for row in matrix(transform)]
    assert transform.apply(point) == pytest.approx(by_matrix, abs=1e-6)


@given(transforms, transforms, st.tuples(numbers, numbers, numbers))
def test_composed_is_one_after_the_other(a: Rigid, b: Rigid, point: tuple[float, float, float]) -> None:
    assert (a @ b).apply(point) == pytest.approx(a.apply(b.apply(point)), abs=1e-6)
    assert same(a.inverse() @ a, Rigid())


@given(transforms, transforms)
def test_the_way_from_one_to_the_other_begins_and_ends_there(a: Rigid, b: Rigid) -> None:
    assert same(a.towards(b, 0.0), a) and same(a.towards(b, 1.0), b)


def test_half_a_turn_is_halved_evenly() -> None:
    half = Rigid.planar(0.0, 0.0, 0.0).towards(Rigid.planar(2.0, 4.0, 1.0), 0.25)
    assert same(half, Rigid.planar(0.5, 1.0, 0.25))


@pytest.fixture
def buffer() -> TransformBuffer:
    """map -> odom -> base_link -> base_scan, and base_link -> camera; at 1 and 2 s."""
    buffer = TransformBuffer()
    for time in (1.0, 2.0):
        buffer.set('map', 'odom', Rigid.planar(1.0, 0.0, 0.0), time)
        buffer.set('odom', 'base_link', Rigid.planar(time, 0.0, math.pi / 2.0), time)
    buffer.set('base_link', 'base_scan', Rigid((0.1, 0.0, 0.2)), is_static=True)
    buffer.set('base_link', 'camera', Rigid((0.0, 0.5, 0.0)), is_static=True)
    return buffer


def test_frames_are_found_up_down_and_across(buffer: TransformBuffer) -> None:
    assert buffer.lookup('map', 'base_scan', 1.0).translation == pytest.approx((2.0, 0.1, 0.2))
    assert same(buffer.lookup('base_scan', 'map', 1.0), buffer.lookup('map', 'base_scan', 1.0).inverse())
    assert buffer.lookup('camera', 'base_scan').translation == pytest.approx((0.1, -0.5, 0.2))
    assert same(buffer.lookup('camera', 'camera', 99.0), Rigid())


def test_between_two_times_it_is_interpolated_and_the_latest_is_common_to_all(buffer: TransformBuffer) -> None:
    assert buffer.lookup('map', 'base_link', 1.25).translation == pytest.approx((2.25, 0.0, 0.0))
    buffer.set('odom', 'base_link', Rigid.planar(9.0, 0.0, 0.0), 3.0)  # map to odom is known until 2 s
    assert buffer.lookup('map', 'base_link').translation == pytest.approx((3.0, 0.0, 0.0))
    assert buffer.latest('map', 'base_link') == 2.0
    assert buffer.latest('base_link', 'camera') == math.inf


def test_what_is_below_a_frame_moves_with_it(buffer: TransformBuffer) -> None:
    assert buffer.carries('base_link', 'camera') and buffer.carries('base_link', 'base_link')
    assert not buffer.carries('base_link', 'odom') and not buffer.carries('camera', 'base_scan')


@pytest.mark.parametrize(
    ('target', 'source', 'time', 'is_early', 'says'),
    [
        ('map', 'base_link', 0.5, False, 'past'),
        ('map', 'base_link', 2.5, True, 'future'),
        ('map', 'gripper', None, True, "'gripper' is not known; known: base_link"),
        ('mars', 'base_link', None, True, "'mars' is not known"),
        ('/map', 'base_link', None, False, 'slash'),
        ('', 'base_link', None, False, 'not a frame name'),
    ],
)
def test_what_is_not_known_is_said(
    buffer: TransformBuffer, target: str, source: str, time: float | None, is_early: bool, says: str
) -> None:
    with pytest.raises(TransformError, match=says) as raised:
        buffer.lookup(target, source, time)
    assert raised.value.is_early is is_early


def test_frames_that_are_not_connected_or_go_round(buffer: TransformBuffer) -> None:
    buffer.set('a', 'b', Rigid(), 1.0)
    with pytest.raises(TransformError, match='not connected'):
        buffer.lookup('map', 'b')
    buffer.set('b', 'a', Rigid((1.0, 0.0, 0.0)), 1.0)
    buffer.set('a', 'of_a', Rigid(), 1.0)
    buffer.set('b', 'of_b', Rigid(), 1.0)
    for target, source in (('map', 'b'), ('b', 'map'), ('of_a', 'of_b'), ('of_b', 'of_a')):
        with pytest.raises(TransformError, match=r"the frames '[ab]', '[ab]' form a ring"):
            buffer.lookup(target, source)
    assert same(buffer.lookup('a', 'b'), Rigid())
    assert same(buffer.lookup('of_b', 'b'), Rigid()) and same(buffer.lookup('b', 'of_b'), Rigid())


@pytest.mark.parametrize(
    ('parent', 'frame', 'transform', 'time'),
    [
        ('map', 'map', Rigid(), 1.0),
        ('', 'odom', Rigid(), 1.0),
        ('map', '/odom', Rigid(), 1.0),
        ('map', 'odom', Rigid((math.nan, 0.0, 0.0)), 1.0),
        ('map', 'odom', Rigid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)), 1.0),
        ('map', 'odom', Rigid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.1)), 1.0),
        ('map', 'odom', Rigid(), math.inf),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(
    buffer: TransformBuffer, parent: str, frame: str, transform: Rigid, time: float
) -> None:
    before = buffer.lookup('map', 'base_link')
    with pytest.raises(TransformError):
        buffer.set(parent, frame, transform, time)
    assert buffer.lookup('map', 'base_link') == before


def test_what_is_old_goes_and_memory_is_bounded(buffer: TransformBuffer) -> None:
    for tick in range(6_000):
        buffer.set('map', 'odom', Rigid(), 2.0 + tick / 100.0)
    with pytest.raises(TransformError, match='past'):
        buffer.lookup('map', 'odom', 62.0 - HISTORY - 1.0)
    buffer.set('map', 'odom', Rigid(), 62.0 - HISTORY - 1.0)  # too late to be of use
    assert len(buffer._tracks['odom'].times) < 1_010
    for tick in range(10_000):
        buffer.set('map', 'odom', Rigid(), 62.0 + tick / 10_000.0)
    assert len(buffer._tracks['odom'].times) <= 4_000
    with pytest.raises(TransformError, match='frames already'):
        for index in range(3_000):
            buffer.set('map', f'frame_{index}', Rigid(), 1.0)


def test_when_time_goes_back_what_is_static_stays(buffer: TransformBuffer) -> None:
    buffer.clear()
    assert buffer.lookup('camera', 'base_scan').translation == pytest.approx((0.1, -0.5, 0.2))
    with pytest.raises(TransformError):
        buffer.lookup('map', 'base_link')
    buffer.set('odom', 'base_link', Rigid.planar(1.0, 0.0, 0.0), 0.1)
    assert buffer.lookup('odom', 'base_scan', 0.1).translation == pytest.approx((1.1, 0.0, 0.2))


# -- on a node -------------------------------------------------------------------------------------------------------


class Broadcaster:
    """Publishes transforms, as a robot does."""

    def __init__(self, runtime: NodeRuntime) -> None:
        node: Node = runtime.node
        self._tf = node.create_publisher(TFMessage, names.TF, 100)
        self._static = node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos())

    def send(self, parent: str, frame: str, x: float, seconds: float, is_static: bool = False) -> None:
        one = TransformStamped(child_frame_id=frame)
        one.header.frame_id, one.header.stamp = parent, stamp(seconds)
        one.transform.translation.x = x
        (self._static if is_static else self._tf).publish(TFMessage(transforms=[one]))


def stamp(seconds: float) -> Time:
    return Time(sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))


def goal(frame: str, seconds: float = 0.0) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id, pose.header.stamp = frame, stamp(seconds)
    pose.pose.position.x = 1.0
    return pose


@pytest.fixture
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('transforms', namespace='/robot1') as runtime:
        yield runtime


def ask(runtime: NodeRuntime, pose: PoseStamped, timeout: float = 30.0) -> list[Any]:
    """Return what is called back, as it comes."""
    told: list[Any] = []
    runtime.call(lambda: TransformListener.of(runtime).transform_pose(pose, 'map', told.append, told.append, timeout))
    return told


def test_a_goal_in_another_frame_is_transformed_as_soon_as_that_is_known(runtime: NodeRuntime) -> None:
    robot = runtime.call(lambda: Broadcaster(runtime))
    robot.send('base_link', 'base_scan', 0.25, 0.0, is_static=True)
    latest, timed = ask(runtime, goal('base_scan')), ask(runtime, goal('base_scan', 5.5))
    node = runtime.node
    wait_until(lambda: node.count_subscribers(names.TF) == 1)
    assert latest == timed == []
    robot.send('map', 'base_link', 10.0, 5.0)
    wait_until(lambda: latest)
    assert latest[0].header.frame_id == 'map'
    assert latest[0].pose.position.x == pytest.approx(11.25)
    assert timed == []
    robot.send('map', 'base_link', 20.0, 6.0)
    wait_until(lambda: timed)
    assert timed[0].pose.position.x == pytest.approx(16.25)


def test_who_asks_again_when_a_transform_is_known_is_told_once(runtime: NodeRuntime) -> None:
    robot = runtime.call(lambda: Broadcaster(runtime))
    listener = runtime.call(lambda: TransformListener.of(runtime))
    told: list[bool] = []

    def known(_pose: PoseStamped) -> None:
        told.append('wheel' in listener.buffer.frames)

    def unknown(_error: TransformError) -> None:
        told.append(False)

    runtime.call(lambda: listener.transform_pose(goal('base_link'), 'map', known, unknown, 30.0))

    def send() -> None:  # of which none is handled before all have come
        robot.send('map', 'base_link', 1.0, 1.0)
        robot.send('base_link', 'wheel', 1.0, 1.0)

    runtime.call(send)
    wait_until(lambda: told)
    assert runtime.call(lambda: told) == [True]


def test_what_never_becomes_known_is_an_error_after_its_time(runtime: NodeRuntime) -> None:
    told = ask(runtime, goal('gripper'), 0.05)
    wait_until(lambda: told)
    assert isinstance(told[0], TransformError) and "'gripper' is not known" in str(told[0])


def test_a_wrong_transform_does_not_take_the_others_of_its_message_with_it() -> None:
    """A broadcaster of static transforms sends all of them in one message."""
    buffer = TransformBuffer()
    message = TFMessage(transforms=[TransformStamped(), TransformStamped(), TransformStamped()])
    for one, frame in zip(message.transforms, ('camera', 'laser', 'gripper'), strict=True):
        one.header.frame_id, one.child_frame_id = 'base_link', frame
    message.transforms[0].transform.rotation.w = 0.0  # of length 0, as of a tool that has filled in nothing
    message.transforms[1].transform.translation.x = 0.5
    with pytest.raises(TransformError, match='camera'):
        take_transforms(buffer, message, is_static=True)
    assert buffer.lookup('base_link', 'laser').translation[0] == 0.5
    assert buffer.frames == ('base_link', 'gripper', 'laser')


def test_a_broadcaster_that_sends_nonsense_does_no_harm(runtime: NodeRuntime) -> None:
    robot = runtime.call(lambda: Broadcaster(runtime))
    told = ask(runtime, goal('base_link'))
    robot.send('map', 'base_link', math.nan, 1.0)
    robot.send('base_link', 'base_link', 1.0, 1.0)
    robot.send('map', 'base_link', 2.0, 1.0)
    wait_until(lambda: told)
    assert told[0].pose.position.x == pytest.approx(3.0)
