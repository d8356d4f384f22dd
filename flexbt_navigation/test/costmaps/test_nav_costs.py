# SPDX-License-Identifier: BSD-3-Clause
"""get_cost of both costmaps, and is_path_valid."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from nav2_msgs.srv import GetCost, IsPathValid
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, line, open_sim_world
from flexbt_testing.waiting import wait_until

GLOBAL, LOCAL = (names.costmap_services(costmap)[-1] for costmap in names.COSTMAPS)
WALL = (1.0, 3.45)


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world() as probe:
        probe.place(DOCK)
        wait_until(lambda: cost(probe, GLOBAL, *DOCK[:2]) >= 0.0, 'the map at navigation')
        yield probe


def cost(world: RobotProbe, service: str, x: float, y: float, *, use_footprint: bool = False) -> float:
    request = GetCost.Request(x=x, y=y, use_footprint=use_footprint)
    return float(world.ask(GetCost, service, request).cost)


def test_the_cost_of_a_place_is_that_of_its_cell(world: RobotProbe) -> None:
    for service in (GLOBAL, LOCAL):
        assert cost(world, service, *WALL) == 254.0
        assert cost(world, service, 1.0, 3.68) == 253.0
        assert 0.0 < cost(world, service, 1.0, 3.95) < 253.0
    assert cost(world, GLOBAL, 8.0, 4.45) == 0.0


def test_beside_the_costmap_there_is_no_cost(world: RobotProbe) -> None:
    for place in ((100.0, 4.0), (math.nan, 4.0), (1.0, -math.inf), (3e38, 1.0)):
        assert cost(world, GLOBAL, *place) == -1.0
    # The local one is a window of 3 m round the robot.
    assert cost(world, LOCAL, 8.0, 4.45) == -1.0


def test_a_footprint_costs_what_the_dearest_cell_on_its_outline_does(world: RobotProbe) -> None:
    assert cost(world, GLOBAL, 1.0, 3.65) == 253.0
    assert cost(world, GLOBAL, 1.0, 3.65, use_footprint=True) == 254.0
    assert cost(world, GLOBAL, 8.0, 4.45, use_footprint=True) < 253.0
    assert cost(world, GLOBAL, 100.0, 4.0, use_footprint=True) == 254.0


def test_an_obstacle_between_the_corners_of_a_footprint_counts() -> None:
    across = (1.0, 3.45, math.pi / 2.0)  # the wall; both ends of the robot are free
    with open_sim_world(navigation={'footprint': '[[0.5, 0.1], [-0.5, 0.1], [-0.5, -0.1], [0.5, -0.1]]'}) as probe:
        wait_until(lambda: cost(probe, GLOBAL, *DOCK[:2]) >= 0.0, 'the map at navigation')
        request = GetCost.Request(x=across[0], y=across[1], theta=across[2], use_footprint=True)
        assert probe.ask(GetCost, GLOBAL, request).cost == 254.0
        request.y += 1.0
        assert probe.ask(GetCost, GLOBAL, request).cost < 253.0


def is_valid(world: RobotProbe, path: Path) -> tuple[bool, list[int]]:
    response = world.ask(IsPathValid, names.IS_PATH_VALID, IsPathValid.Request(path=path))
    return response.is_valid, list(response.invalid_pose_indices)


def test_a_path_is_valid_when_nothing_is_in_its_way_from_the_robot_on(world: RobotProbe) -> None:
    world.place(DOCK)
    assert is_valid(world, line(DOCK, (3.0, 4.45))) == (True, [])
    assert is_valid(world, Path()) == (False, [])
    through = line((0.8, 3.2), (0.8, 5.3))
    valid, invalid = is_valid(world, through)
    # It begins in a wall and ends near the other one; the robot is in the middle; what is ahead of it counts.
    assert not valid
    assert min(invalid) > 25
    assert max(invalid) == len(through.poses) - 1
    assert is_valid(world, line((0.8, 3.2), (0.8, 4.6))) == (True, [])
    assert is_valid(world, line(DOCK, (3.0, 4.45), 'moon')) == (False, [])
