# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's leaves that work on poses, paths and goals of the blackboard, tick by tick, with a robot that is anywhere."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav2_msgs.msg import Route, RouteNode
from nav_msgs.msg import Odometry, Path

from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.errors import TransformError
from flexbt_common.values.message_fields import time_message
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_server.leaves import error_code_of
from flexbt_server.leaves.path_tracking import PathTracker, yaw_of
from flexbt_server.nav2.branches import concluded, pending
from flexbt_server.node_types import node_registry
from flexbt_testing.nodes.server_world import pose_stamped

REGISTRY = node_registry(lambda _source, _error: None)
SUCCESS, FAILURE, RUNNING = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING

PENDING, COMPLETED, FAILED = 0, 1, 3


class Robot:
    """What leaves know of the robot; lost without a position."""

    def __init__(self, *position: float) -> None:
        self.position = position
        self.global_frame = 'map'

    def robot_pose(self, frame: str = '', base: str = '') -> PoseStamped:
        if not self.position or frame not in ('', 'map'):
            raise TransformError(f'no transform to {frame!r}')
        x, y = self.position
        return pose_stamped(x, y)


class Ticked:
    """A tree with its blackboard, clock and robot."""

    def __init__(
        self, body: str, robot: Robot | None = None, services: Mapping[str, Any] = MappingProxyType({}), **entries: Any
    ) -> None:
        self.board = Blackboard()
        for key, value in entries.items():
            self.board.set(key, value)
        self.robot = Robot(0.0, 0.0) if robot is None else robot
        self.clock = ManualClock()
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
        self.tree = Tree(
            TreeLibrary([load_xml(text, 'f', REGISTRY)]), 'T', blackboard=self.board, clock=self.clock,
            services=SimpleNamespace(frames=self.robot, goal_reached_tol=0.25, **services),
        )  # fmt: skip

    def tick(self) -> NodeStatus:
        return self.tree.tick_exactly_once()


def ticked(body: str, robot: Robot | None = None, **entries: Any) -> tuple[NodeStatus, Blackboard]:
    tree = Ticked(body, robot, **entries)
    return tree.tick(), tree.board


def path_of(*points: tuple[float, float], frame: str = 'map') -> Path:
    path = Path(poses=[pose_stamped(*point, frame) for point in points])
    path.header.frame_id = frame
    return path


def points_of(path: Path) -> list[tuple[float, float]]:
    return [(one.pose.position.x, one.pose.position.y) for one in path.poses]


class Driven(Ticked):
    """CheckStopStatus of a robot with odometry, at a ROS time, which may jump."""

    def __init__(self) -> None:
        self.odometry = Odometry()
        self.ros_time = 0.0
        cache = SimpleNamespace(latest=self.odometry, on_message=lambda tree: None)
        services = {
            'topics': SimpleNamespace(cache=lambda topic: cache),
            'runtime': SimpleNamespace(clock=SimpleNamespace(stamp=lambda: time_message(self.ros_time))),
        }
        super().__init__('<CheckStopStatus duration_stopped="1000"/>', services=services)


@pytest.mark.parametrize(('x', 'y', 'z', 'w', 'yaw'), [
    (0.0, 0.0, 1.0, 1.0, math.pi / 2.0),  # as a person writes it, not normalized
    (0.0, 0.0, -3.0, 0.0, math.pi),
    (2.0, 0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0, 0.0),
])  # fmt: skip
def test_the_direction_of_a_pose(x: float, y: float, z: float, w: float, yaw: float) -> None:
    pose = pose_stamped(0.0)
    pose.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
    assert abs(yaw_of(pose)) == pytest.approx(yaw)


@pytest.mark.parametrize(('ros_time', 'stamp', 'left'), [
    (1000.0, 999.5, 0.5),
    (1000.0, 998.0, 0.0),
    (5.0, 4.75, 0.75),  # simulated time was reset, which the clock of the tree does not show
    (5.0, 1000.0, 1.0),
    (5.0, 0.0, 1.0),
])  # fmt: skip
def test_a_robot_stands_since_the_stamp_of_its_odometry(ros_time: float, stamp: float, left: float) -> None:
    robot = Driven()
    robot.clock.advance(1000.0)
    robot.ros_time, robot.odometry.header.stamp = ros_time, time_message(stamp)
    if left:
        assert robot.tick() is RUNNING
        robot.clock.advance(left - 0.1)
        assert robot.tick() is RUNNING
        robot.clock.advance(0.1)
    assert robot.tick() is SUCCESS


@pytest.mark.parametrize(('part', 'axis'), [('linear', 'x'), ('linear', 'y'), ('angular', 'z')])
def test_a_robot_does_not_stand_while_a_speed_is_not_a_number(part: str, axis: str) -> None:
    robot = Driven()
    setattr(getattr(robot.odometry.twist.twist, part), axis, math.nan)
    assert robot.tick() is FAILURE


LINE = [(float(x), 0.0) for x in range(11)]


@pytest.mark.parametrize(('x', 'ports', 'first', 'last'), [
    (5.0, '', 1, 10),
    (5.2, 'distance_forward="2" distance_backward="2"', 3, 7),
    (5.2, 'distance_forward="2.5" distance_backward="0"', 5, 7),
    (0.0, 'distance_forward="-1" distance_backward="0.0"', 0, 10),
    (4.0, 'distance_forward="-1" distance_backward="0.0"', 4, 10),
    (99.0, 'distance_forward="0" distance_backward="0"', 10, 10),
    (9.0, 'pose="0;map;2;0;0;0;0;0;1" distance_forward="1" distance_backward="1"', 1, 3),
])  # fmt: skip
def test_the_part_of_a_path_around_the_robot(x: float, ports: str, first: int, last: int) -> None:
    leaf = f'<TruncatePathLocal input_path="{{path}}" output_path="{{part}}" {ports}/>'
    status, board = ticked(leaf, Robot(x, 0.5), path=path_of(*LINE))
    assert status is SUCCESS
    assert points_of(board.get('part')) == LINE[first : last + 1]
    assert board.get('part').header == path_of().header


def test_a_path_without_poses_is_one_unless_it_has_no_frame_either() -> None:
    leaf = '<TruncatePathLocal input_path="{path}" output_path="{part}"/>'
    assert ticked(leaf, path=path_of())[0] is SUCCESS
    assert ticked(leaf, Robot(), path=path_of())[0] is FAILURE
    assert ticked(leaf, path=path_of(frame='nowhere'))[0] is FAILURE


def test_with_a_window_the_robot_is_looked_for_from_where_it_was_on_the_same_path() -> None:
    """The path comes by the same place twice: without a window the robot is where it was the last time."""
    there_and_back = [*LINE, *((x, 0.25) for x, _ in reversed(LINE))]
    leaf = (
        '<TruncatePathLocal input_path="{path}" output_path="{part}" distance_forward="-1" distance_backward="0" '
        'max_robot_pose_search_dist="2"/>'
    )
    tree = Ticked(leaf, Robot(0.0, 0.2), path=path_of(*there_and_back))
    for x in range(0, 11, 2):
        tree.robot.position = (float(x), 0.2)  # nearer to the way back
        assert tree.tick() is SUCCESS
        assert points_of(tree.board.get('part'))[0][1] == 0.0 or x == 10
    tree.board.set('path', path_of(*reversed(LINE)))  # another path: from its beginning
    tree.robot.position = (10.0, 0.0)
    assert tree.tick() is SUCCESS
    assert points_of(tree.board.get('part')) == LINE[::-1]


COORDINATES = st.integers(-40, 40).map(lambda eighths: eighths / 8.0)
"""m. Their squares are exact, so that of points that are as near it is the same one however distances are compared."""


@given(
    st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=30),
    st.floats(0, 10), st.floats(0, 10), COORDINATES, COORDINATES,
)  # fmt: skip
def test_the_part_is_as_long_as_asked_for(
    points: list[tuple[float, float]], forward: float, backward: float, x: float, y: float
) -> None:
    leaf = (
        f'<TruncatePathLocal input_path="{{path}}" output_path="{{part}}" distance_forward="{forward}" '
        f'distance_backward="{backward}"/>'
    )
    status, board = ticked(leaf, Robot(x, y), path=path_of(*points))
    assert status is SUCCESS
    part = points_of(board.get('part'))
    nearest = min(reversed(range(len(points))), key=lambda index: math.dist((x, y), points[index]))
    begins = [start for start in range(nearest + 1) if length(points[start : nearest + 1]) <= backward]
    ends = [end for end in range(nearest, len(points)) if length(points[nearest : end + 1]) <= forward]
    assert part == points[begins[0] : ends[-1] + 1]


def length(points: list[tuple[float, float]]) -> float:
    """In the order in which the leaf adds, away from the robot, a sum may differ in its last digit."""
    return round(sum(map(math.dist, points, points[1:])), 9) if len(points) > 1 else 0.0


def test_paths_behind_each_other() -> None:
    leaf = '<ConcatenatePaths input_path1="{a}" input_path2="{b}" output_path="{both}"/>'
    one, other = path_of((0, 0), (1, 0)), path_of((2, 0))
    status, board = ticked(leaf, a=one, b=other)
    assert status is SUCCESS
    assert points_of(board.get('both')) == [(0, 0), (1, 0), (2, 0)]
    status, board = ticked(leaf, a=Path(), b=other)
    assert (status, board.get('both').header.frame_id) == (SUCCESS, 'map')
    status, board = ticked(leaf, b=other)
    assert status is SUCCESS
    assert ticked(leaf, a=path_of(), b=Path())[0] is FAILURE
    assert points_of(one) == [(0, 0), (1, 0)]  # what was there is as it was


@pytest.mark.parametrize(('index', 'x'), [(0, 0.0), (2, 2.0), (-1, 2.0), (-3, 0.0), (3, None), (-4, None)])
def test_a_pose_of_a_path(index: int, x: float | None) -> None:
    path = path_of((0, 0), (1, 0), (2, 0))
    for one in path.poses:
        one.header.frame_id = ''
    status, board = ticked(f'<GetPoseFromPath path="{{path}}" index="{index}" pose="{{pose}}"/>', path=path)
    assert status is (FAILURE if x is None else SUCCESS)
    if x is not None:
        assert board.get('pose') == pose_stamped(x)
        assert path.poses[index].header.frame_id == ''


def test_no_pose_of_an_empty_path() -> None:
    assert ticked('<GetPoseFromPath path="{path}" pose="{pose}"/>', path=path_of())[0] is FAILURE


REMOVE = '<RemovePassedGoals input_goals="{goals}" output_goals="{goals}" radius="1.1" {}/>'
STATUSES = 'input_waypoint_statuses="{statuses}" output_waypoint_statuses="{statuses}"'


def test_goals_that_are_passed_are_removed_but_never_the_last() -> None:
    goals = [pose_stamped(0), pose_stamped(1), pose_stamped(2), pose_stamped(0)]
    status, board = ticked(REMOVE.replace('{}', ''), goals=list(goals))
    assert (status, board.get('goals')) == (SUCCESS, goals[2:])
    assert ticked(REMOVE.replace('{}', ''), goals=[pose_stamped(0)])[1].get('goals') == [pose_stamped(0)]
    assert ticked(REMOVE.replace('{}', ''), goals=[])[1].get('goals') == []
    assert ticked(REMOVE.replace('{}', ''), Robot(), goals=list(goals))[0] is FAILURE


def test_passed_goals_are_completed_waypoints_once_each() -> None:
    goals = [pose_stamped(0), pose_stamped(0), pose_stamped(2)]
    tree = Ticked(REMOVE.replace('{}', STATUSES), goals=list(goals), statuses=pending(goals))
    assert tree.tick() is SUCCESS
    assert told(tree) == [COMPLETED, COMPLETED, PENDING]
    tree.board.set('goals', [pose_stamped(0), pose_stamped(2)])  # none is pending of the first any more
    assert tree.tick() is FAILURE
    assert tree.board.get('goals') == [pose_stamped(0), pose_stamped(2)]
    assert [one.waypoint_index for one in tree.board.get('statuses')] == [0, 1, 2]
    for succeeded, last in ((True, COMPLETED), (False, FAILED)):
        ended = concluded(tree.board.get('statuses'), succeeded=succeeded)
        assert [one.waypoint_status for one in ended] == [COMPLETED, COMPLETED, last]
    assert told(tree) == [COMPLETED, COMPLETED, PENDING]


def told(tree: Ticked) -> list[int]:
    return [one.waypoint_status for one in tree.board.get('statuses')]


def test_waypoint_statuses_that_are_not_on_the_blackboard_are_left_alone() -> None:
    status, board = ticked(REMOVE.replace('{}', STATUSES), goals=[pose_stamped(0), pose_stamped(2)])
    assert status is SUCCESS
    assert board.get_or('statuses', None) is None


def test_lists_of_goals() -> None:
    append = '<AppendGoalPoseToGoals goal_pose="{last}" input_goals="{goals}" output_goals="{goals}"/>'
    assert ticked(append, last=pose_stamped(3), goals=[pose_stamped(1)])[1].get('goals') == [
        pose_stamped(1),
        pose_stamped(3),
    ]
    few = '<GetNextFewGoals input_goals="{goals}" num_goals="2" output_goals="{few}"/>'
    assert ticked(few, goals=[pose_stamped(1), pose_stamped(2), pose_stamped(3)])[1].get('few') == [
        pose_stamped(1),
        pose_stamped(2),
    ]
    assert ticked(few, goals=[pose_stamped(1)])[1].get('few') == [pose_stamped(1)]
    assert ticked(few, goals=[])[0] is FAILURE
    extract = '<ExtractRouteNodesAsGoals route="{route}" goals="{goals}"/>'
    route = Route(nodes=[RouteNode(nodeid=7, position=Point(x=1.0, y=2.0, z=3.0))])
    route.header.frame_id = 'map'
    assert ticked(extract, route=route)[1].get('goals') == [pose_stamped(1, 2)]
    assert ticked(extract, route=Route())[0] is FAILURE


@pytest.mark.parametrize(('x', 'ports', 'near'), [
    (0.0, '', False), (9.1, '', False), (9.6, '', True), (0.0, 'proximity_threshold="10.5"', True),
    (5.0, 'proximity_threshold="5"', False),
])  # fmt: skip
def test_the_goal_is_nearby(x: float, ports: str, near: bool) -> None:
    leaf = f'<IsGoalNearby path="{{path}}" {ports}/>'
    assert ticked(leaf, Robot(x, 0.0), path=path_of(*LINE))[0] is (SUCCESS if near else FAILURE)


def test_no_goal_is_nearby_without_a_path_or_a_robot() -> None:
    leaf = '<IsGoalNearby path="{path}"/>'
    assert ticked(leaf, path=path_of())[0] is FAILURE
    assert ticked(leaf)[0] is FAILURE
    assert ticked(leaf, Robot(), path=path_of(*LINE))[0] is FAILURE


def test_a_distance_counts_from_the_first_tick_and_then_from_the_last_success() -> None:
    tree = Ticked('<WhileDoElse><DistanceTraveled distance="2"/><AlwaysSuccess/><Sleep msec="100000"/></WhileDoElse>')
    given = []
    for x in (0.0, 1.9, 2.1, 3.9, 4.2):
        tree.robot.position = (x, 0.0)
        given.append(tree.tick())
    assert given == [RUNNING, RUNNING, SUCCESS, RUNNING, RUNNING]  # and it begins anew
    tree.robot.position = ()
    assert Ticked('<DistanceTraveled/>', Robot()).tick() is FAILURE


def test_time_counts_from_the_first_tick_and_a_reactive_node_begins_it_anew() -> None:
    """As in Nav2, where TimeExpired is of no use below a reactive node (its issue 4842)."""
    reactive = Ticked('<ReactiveFallback><TimeExpired seconds="1"/><Sleep msec="100000"/></ReactiveFallback>')
    plain = Ticked('<WhileDoElse><TimeExpired seconds="1"/><AlwaysSuccess/><Sleep msec="100000"/></WhileDoElse>')
    for tree, expected in ((reactive, [RUNNING] * 3), (plain, [RUNNING, RUNNING, SUCCESS])):
        given = []
        for _ in range(3):
            given.append(tree.tick())
            tree.clock.advance(0.6)
        assert given == expected


def test_a_path_expires_when_it_stays_the_same() -> None:
    tree = Ticked('<PathExpiringTimer seconds="10" path="{path}"/>', path=path_of(*LINE))

    def after(seconds: float, paths: Iterable[Path] = ()) -> NodeStatus:
        tree.clock.advance(seconds)
        for path in paths:
            tree.board.set('path', path)
        return tree.tick()

    assert after(0) is FAILURE
    assert after(9.9, [path_of(*LINE)]) is FAILURE  # equal
    assert after(0.2) is SUCCESS
    assert after(0.1) is FAILURE
    assert after(9.8, [path_of(*LINE[:3])]) is FAILURE  # another one
    assert after(9.9) is FAILURE
    assert after(0.2) is SUCCESS


@pytest.mark.parametrize(('ports', 'entries', 'received'), [
    ('', {}, False), ('', {'initial_pose_received': True}, True), ('', {'initial_pose_received': False}, False),
    ('initial_pose_received="{mine}"', {'mine': True}, True), ('initial_pose_received="{mine}"', {}, False),
    ('initial_pose_received="true"', {}, True),
])  # fmt: skip
def test_an_initial_pose(ports: str, entries: dict[str, Any], received: bool) -> None:
    assert ticked(f'<InitialPoseReceived {ports}/>', **entries)[0] is (SUCCESS if received else FAILURE)


@pytest.mark.parametrize(('aside', 'turned', 'within'), [
    (0.4, 0.0, True), (0.6, 0.0, False), (-0.2, 0.0, True), (-0.4, 0.0, False), (0.0, -1.1, False), (0.0, 0.9, True),
])  # fmt: skip
def test_bounds_of_the_path_signs_of_bounds_do_not_count(aside: float, turned: float, within: bool) -> None:
    leaf = (
        '<IsWithinPathTrackingBounds max_error_left="-0.5" max_error_right="0.3" max_error_heading="1" '
        'tracking_feedback="{tracking}"/>'
    )
    assert ticked(leaf)[0] is SUCCESS  # nothing is known yet
    feedback = REGISTRY.get('FollowPath')
    assert feedback is not None
    kind = feedback.ports['tracking_feedback'].type
    assert kind is not None
    known = kind.python_type(position_tracking_error=aside, heading_tracking_error=turned)
    assert ticked(leaf, tracking=known)[0] is (SUCCESS if within else FAILURE)


def test_a_robot_that_nobody_has_looked_for_in_a_while_is_on_its_path_still() -> None:
    """Where time runs away from a busy machine, it drives farther than the path is searched for it."""
    path = Path(poses=[pose_stamped(x, 0.0) for x in range(5)] + [pose_stamped(4.0, y) for y in range(1, 5)])
    tracker = PathTracker(path)
    assert tracker.feedback(pose_stamped(0.5, 0.1), 0.5).position_tracking_error == pytest.approx(0.1)
    there = tracker.feedback(pose_stamped(4.1, 3.0), 0.5)
    assert (there.position_tracking_error, there.remaining_path_length) == (pytest.approx(-0.1), pytest.approx(1.0))
    # Never back: it came to the segment from (4, 2) on.
    assert tracker.feedback(pose_stamped(0.0, 2.0), 0.5).position_tracking_error == pytest.approx(4.0)


@pytest.mark.parametrize('leaf', [
    'TruncatePath input_path="{no}" output_path="{x}"', 'TruncatePathLocal input_path="{no}" output_path="{x}"',
    'GetPoseFromPath path="{no}" pose="{x}"', 'RemovePassedGoals input_goals="{no}" output_goals="{x}"',
    'AppendGoalPoseToGoals goal_pose="{no}" output_goals="{x}"', 'ArePosesNear ref_pose="{no}" target_pose="{no}"',
    'GetNextFewGoals input_goals="{no}" num_goals="1" output_goals="{x}"', 'GoalReached goal="{no}"',
    'ExtractRouteNodesAsGoals route="{no}" goals="{x}"',
])  # fmt: skip
def test_what_is_not_on_the_blackboard_is_a_failure_with_the_reason(leaf: str) -> None:
    """Trees ask before anything was planned: that is no error."""
    tree = Ticked(f'<{leaf}/>')
    assert tree.tick() is FAILURE
    assert tree.tree.failure is not None
    assert '[no]' in tree.tree.failure.reason
    assert 'never written' in tree.tree.failure.reason


@pytest.mark.parametrize(('status', 'code'), [
    (GoalStatus.REJECTED, 1), (GoalStatus.NO_SERVER, 2), (GoalStatus.TIMEOUT, 2), (GoalStatus.LOST, 200),
    (GoalStatus.CANCELED, 0),
])  # fmt: skip
def test_goals_that_never_ran_have_the_codes_of_main_where_there_are_such(status: GoalStatus, code: int) -> None:
    outcome = GoalOutcome(status, None, '')
    of_main = SimpleNamespace(GOAL_REJECTED=1, SEND_GOAL_FAILURE=2, UNKNOWN=200)
    assert error_code_of(of_main, outcome) == code
    assert error_code_of(SimpleNamespace(UNKNOWN=200), outcome) == (200 if code else 0)
    assert error_code_of(SimpleNamespace(), outcome) == 0
