# SPDX-License-Identifier: BSD-3-Clause
"""The map that the demonstrations use, and that of Nav2's tests."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy
import pytest
import yaml
from closed_loop import check_following
from PIL import Image

from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.planner.planners import GridPlanner
from flexbt_sim.world import Pose, load_map
from flexbt_testing.worlds import room

MAPS = Path(__file__).parents[3] / 'flexbt_sim' / 'maps'
SANDBOX = Path(__file__).parents[4] / 'shared' / 'data' / 'nav2' / 'maps' / 'tb3_sandbox.yaml'
ROOMS = load_map(MAPS / 'rooms.yaml')
PLACES = {name: Pose(**pose) for name, pose in yaml.safe_load((MAPS / 'rooms_places.yaml').read_text()).items()}


def test_the_image_is_what_its_program_draws(tmp_path: Path) -> None:
    subprocess.run([sys.executable, MAPS / 'make_rooms.py', tmp_path], check=True)
    with Image.open(tmp_path / 'rooms.png') as drawn, Image.open(MAPS / 'rooms.png') as kept:
        assert numpy.array_equal(numpy.asarray(drawn), numpy.asarray(kept))


def test_every_place_is_free_and_reachable_from_every_other() -> None:
    planner = GridPlanner(Costmap(ROOMS, Inflation()))
    for name, place in PLACES.items():
        assert room(ROOMS, *place[:2]) > Inflation().robot_radius + 0.1, name
        for other in PLACES.values():
            assert planner.plan(place, other)[-1] == other


def test_the_passage_into_the_store_is_narrow_and_passable() -> None:
    """It leaves the robot a hand's breadth on each side, and for a wider one there is no other way."""
    path = GridPlanner(Costmap(ROOMS, Inflation())).plan(PLACES['corridor'], PLACES['store'])
    spare = min(room(ROOMS, pose.x, pose.y) for pose in path) - Inflation().robot_radius
    assert 0.1 < spare < 0.2
    with pytest.raises(NavigationError) as raised:
        GridPlanner(Costmap(ROOMS, Inflation(robot_radius=0.41))).plan(PLACES['corridor'], PLACES['store'])
    assert raised.value.code == 'NO_VALID_PATH'


@pytest.mark.parametrize(('start', 'goal'), list(pairwise([*PLACES, 'dock'])))
def test_the_robot_gets_from_place_to_place(start: str, goal: str) -> None:
    check_following(ROOMS, PLACES[start], PLACES[goal], late=1)


@pytest.mark.skipif(not SANDBOX.exists(), reason="Nav2's map is not beside the project")
@pytest.mark.parametrize('goal', [(0.0, 2.0), (-0.52, -0.54), (0.58, -0.55), (1.78, -0.57)])
def test_the_robot_reaches_the_goals_of_nav2s_own_tests(goal: tuple[float, float]) -> None:
    check_following(load_map(SANDBOX), Pose(-2.0, -0.5, 0.0), Pose(*goal, 0.0), late=1)
