# SPDX-License-Identifier: BSD-3-Clause
"""Maps that come late, come again, change or are wrong; clearing costmaps; is_path_valid."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import numpy
import pytest
from geometry_msgs.msg import PolygonStamped
from nav2_msgs.action import ComputePathToPose, FollowPath
from nav2_msgs.msg import Costmap
from nav2_msgs.srv import ClearCostmapAroundRobot, ClearEntireCostmap, IsPathValid
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.message_fields import time_message
from flexbt_sim.messages import grid_message
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap, load_map
from flexbt_testing.nodes.sim_world import (
    DOCK,
    FAST,
    OFFICE,
    RobotProbe,
    aborted,
    line,
    open_navigation,
    open_simulator,
)
from flexbt_testing.waiting import DEADLINE, wait_until

Plan = ComputePathToPose.Result
EAST = (11.2, 4.45)
ROOMS = load_map(built_in_map())
TOPIC = 'surveyed_map'


class Surveyor:
    """Publishes maps that the simulator does not know."""

    def __init__(self, probe: RobotProbe) -> None:
        self.probe = probe
        node = probe.runtime.node
        self._maps = probe.runtime.call(
            lambda: node.create_publisher(OccupancyGrid, TOPIC, names.transient_local_qos())
        )

    def publish(self, change: Callable[[NDArray[numpy.int8]], None] = lambda cells: None) -> None:
        """Return the rooms, changed."""
        cells = ROOMS.cells.copy()
        change(cells)
        self.publish_grid(grid_message(OccupancyMap(cells, ROOMS.resolution, ROOMS.origin), 'map', time_message(0.0)))

    def publish_grid(self, grid: OccupancyGrid) -> None:
        """Anything."""
        self._maps.publish(grid)

    def wait_for_plan(self, goal: tuple[float, ...], code: int) -> None:
        """Until planning ends with this code: a new map takes a moment to arrive."""
        deadline = time.monotonic() + DEADLINE
        while self.probe.plan(goal).result.error_code != code:
            assert time.monotonic() < deadline, f'no plan to {goal} ended with {code}'


def wall_across_the_corridor(cells: NDArray[numpy.int8]) -> None:
    """At x = 6 m."""
    cells[:, 120:124] = OCCUPIED


@pytest.fixture(scope='module')
def surveyor() -> Iterator[Surveyor]:
    with open_simulator(**FAST) as probe, open_navigation(map_topic=TOPIC):
        yield Surveyor(probe)


def test_without_a_map_requests_wait_and_then_say_what_is_missing(surveyor: Surveyor) -> None:
    """The first test of this module: nobody has published a map yet."""
    probe = surveyor.probe
    plan, path = probe.plan(OFFICE), probe.follow(line(DOCK, EAST))
    assert TOPIC in aborted(plan, Plan.UNKNOWN).error_msg
    assert TOPIC in aborted(path, FollowPath.Result.UNKNOWN).error_msg
    waiting = [probe.plan(OFFICE), probe.follow(line(DOCK, (1.0, 4.45)))]
    assert all(goal.accepted.wait() for goal in waiting)
    surveyor.publish()
    assert {goal.wait().status for goal in waiting} == {GoalStatus.SUCCEEDED}


def test_the_newest_map_counts_for_plans(surveyor: Surveyor) -> None:
    surveyor.publish()
    surveyor.probe.place(DOCK)
    surveyor.wait_for_plan(EAST, Plan.NONE)
    surveyor.publish(wall_across_the_corridor)
    surveyor.wait_for_plan(EAST, Plan.NO_VALID_PATH)
    surveyor.publish()
    surveyor.wait_for_plan(EAST, Plan.NONE)


def test_a_wall_that_appears_ahead_stops_the_robot_that_follows_a_path(surveyor: Surveyor) -> None:
    surveyor.publish()
    probe = surveyor.probe
    probe.place((4.0, 3.95, 0.0))
    surveyor.wait_for_plan(EAST, Plan.NONE)
    goal = probe.follow(line((4.0, 3.95), (11.2, 3.95)))
    probe.wait_driving()
    surveyor.publish(wall_across_the_corridor)
    aborted(goal, FollowPath.Result.PATIENCE_EXCEEDED)
    assert probe.wait_at_rest().x < 6.0 - 0.22
    surveyor.publish()


def test_the_same_map_again_and_cleared_costmaps_do_not_disturb_a_robot_that_drives(surveyor: Surveyor) -> None:
    surveyor.publish()
    probe = surveyor.probe
    probe.place(DOCK)
    surveyor.wait_for_plan(EAST, Plan.NONE)
    probe.set_speed_factor(2.0)
    goal = probe.follow(line(DOCK, (3.0, 4.45)))
    probe.wait_driving(0.25)
    before = len(probe.commands)
    request = ClearEntireCostmap.Request()
    for name in (names.CLEAR_GLOBAL_COSTMAP, names.CLEAR_LOCAL_COSTMAP) * 2:
        surveyor.publish()
        probe.ask(ClearEntireCostmap, name, request)
    probe.later(1.0)
    assert min(linear for linear, _ in probe.commands[before:]) > 0.24
    probe.set_speed_factor(0.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED


def test_unknown_space_is_free(surveyor: Surveyor) -> None:
    def forget(cells: NDArray[numpy.int8]) -> None:
        cells[20:30, 60:70] = UNKNOWN

    surveyor.probe.place(DOCK)
    surveyor.publish(forget)
    surveyor.wait_for_plan((3.25, 1.25), Plan.NONE)


def forget_the_walls(cells: NDArray[numpy.int8]) -> None:
    """Check that the lidar sees them all the same."""
    cells[:] = FREE


def test_what_only_the_lidar_sees_is_on_the_costmaps_and_comes_back_after_clearing(surveyor: Surveyor) -> None:
    probe = surveyor.probe
    probe.place((0.8, 6.0, 0.0))
    through_wall = line((0.8, 6.0), (0.8, 4.0))
    surveyor.publish(forget_the_walls)
    wait_until(lambda: valid(surveyor, through_wall)[0] is False, deadline=DEADLINE)
    shown: list[OccupancyGrid] = []
    raw: list[Costmap] = []
    footprints: list[PolygonStamped] = []
    node = probe.runtime.node
    topics = names.costmap_topics(names.COSTMAPS[1])
    subscriptions = probe.runtime.call(
        lambda: [
            node.create_subscription(message, topic, got.append, names.transient_local_qos() if latched else 1)
            for message, topic, got, latched in (
                (OccupancyGrid, topics[0], shown, True),
                (Costmap, topics[1], raw, True),
                (PolygonStamped, topics[2], footprints, False),
            )
        ]
    )
    wait_until(lambda: shown and raw and footprints, deadline=DEADLINE)
    info = shown[-1].info
    assert info.height * info.resolution == pytest.approx(3.0, abs=0.06)
    assert info.width * info.resolution == pytest.approx(0.8 + 1.5, abs=0.06)  # the map ends at 0
    assert info.origin.position.y == pytest.approx(6.0 - 1.5, abs=0.06)
    assert {99, 100} < set(shown[-1].data)
    assert {0, 253, 254} < set(raw[-1].data)
    assert raw[-1].metadata.size_x * raw[-1].metadata.size_y == len(raw[-1].data)
    assert max(math.dist((point.x, point.y), (0.8, 6.0)) for point in footprints[-1].polygon.points) < 0.25
    # The local costmap, on which the robot drives, has what was seen last at once again.
    for around in (names.costmap_services(names.COSTMAPS[1])[1], names.COMMANDER_CLEARS[1]):
        before = len(raw)
        probe.ask(ClearCostmapAroundRobot, around, ClearCostmapAroundRobot.Request(reset_distance=10.0))
        wait_until(lambda before=before: len(raw) > before + 3, deadline=DEADLINE)  # type: ignore[misc]
        assert all(254 in message.data for message in raw[before:])
    probe.ask(ClearEntireCostmap, names.CLEAR_GLOBAL_COSTMAP, ClearEntireCostmap.Request())
    wait_until(lambda: valid(surveyor, through_wall)[0] is False, deadline=DEADLINE)
    probe.runtime.call(lambda: [node.destroy_subscription(one) for one in subscriptions])
    surveyor.publish()


def test_a_plan_leads_round_what_only_the_lidar_sees(surveyor: Surveyor) -> None:
    probe = surveyor.probe
    probe.place((0.8, 6.0, 0.0))
    surveyor.publish(forget_the_walls)
    wait_until(lambda: valid(surveyor, line((0.8, 6.0), (0.8, 4.0)))[0] is False, deadline=DEADLINE)
    poses = probe.plan((0.8, 4.0, 0.0)).result.path.poses
    assert all(
        ROOMS.clearance(stamped.pose.position.x, stamped.pose.position.y) > 0.1
        for stamped in poses
        if math.dist((stamped.pose.position.x, stamped.pose.position.y), (0.8, 6.0)) < 1.0
    )
    surveyor.publish()


def _grid(**fields: object) -> OccupancyGrid:
    grid = grid_message(ROOMS, 'map', time_message(0.0))
    for name, value in fields.items():
        setattr(grid.header if name == 'frame_id' else grid.info, name, value)
    return grid


@pytest.mark.parametrize(
    'wrong',
    [
        OccupancyGrid(),
        _grid(width=17),
        _grid(height=0),
        _grid(resolution=0.0),
        _grid(resolution=math.nan),
        _grid(frame_id='odom'),
    ],
    ids=['empty', 'width', 'height', 'resolution', 'nan', 'frame'],
)
def test_a_map_that_cannot_be_used_leaves_the_one_before(surveyor: Surveyor, wrong: OccupancyGrid) -> None:
    surveyor.probe.place(DOCK)
    surveyor.publish(wall_across_the_corridor)
    surveyor.wait_for_plan(EAST, Plan.NO_VALID_PATH)
    surveyor.publish_grid(wrong)
    for _ in range(5):
        aborted(surveyor.probe.plan(EAST), Plan.NO_VALID_PATH)
    surveyor.publish()
    surveyor.wait_for_plan(EAST, Plan.NONE)


def valid(surveyor: Surveyor, path: Path) -> tuple[bool, list[int]]:
    """Return whether a path is valid, and which of its poses are not."""
    request = IsPathValid.Request(path=path)
    response = surveyor.probe.ask(IsPathValid, names.IS_PATH_VALID, request)
    return response.is_valid, list(response.invalid_pose_indices)


def test_is_path_valid_looks_from_the_robot_onward(surveyor: Surveyor) -> None:
    surveyor.publish()
    through_wall = line((0.8, 6.0), (0.8, 4.0))
    surveyor.probe.place((0.8, 4.0, 0.0))
    surveyor.wait_for_plan(EAST, Plan.NONE)
    assert valid(surveyor, through_wall) == (True, [])
    surveyor.probe.place((0.8, 6.0, 0.0))
    assert surveyor.probe.plan(EAST).result.path.poses[0].pose.position.y == pytest.approx(6.0)  # it knows the pose
    is_valid, blocked = valid(surveyor, through_wall)
    assert not is_valid
    ys = [through_wall.poses[index].pose.position.y for index in blocked]
    assert (max(ys), min(ys)) == pytest.approx((5.55 + 0.22, 5.4 - 0.22), abs=0.08)  # the wall, the robot, a cell
    assert valid(surveyor, line((0.8, 6.0), (0.8, 7.0))) == (True, [])


def _nan_path() -> Path:
    path = line(DOCK, EAST)
    path.poses[3].pose.position.x = math.nan
    return path


@pytest.mark.parametrize('path', [Path(), line(DOCK, EAST, 'moon'), _nan_path()], ids=['empty', 'frame', 'nan'])
def test_what_is_no_path_is_not_valid(surveyor: Surveyor, path: Path) -> None:
    assert valid(surveyor, path) == (False, [])
