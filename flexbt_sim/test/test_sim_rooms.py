# SPDX-License-Identifier: BSD-3-Clause
"""The map that the demonstrations use."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy
import pytest
import yaml
from PIL import Image
from test_sim_driving import arrives

from flexbt_sim.costmap import Costmap, Inflation
from flexbt_sim.geometry import Pose
from flexbt_sim.occupancy_map import load_map
from flexbt_sim.planner import GridPlanner

MAPS = Path(__file__).parents[1] / 'maps'
PLACES = {name: Pose(**pose) for name, pose in yaml.safe_load((MAPS / 'rooms_places.yaml').read_text()).items()}


def test_the_image_is_what_its_program_draws(tmp_path: Path) -> None:
    subprocess.run([sys.executable, MAPS / 'make_rooms.py', tmp_path], check=True)
    with Image.open(tmp_path / 'rooms.png') as drawn, Image.open(MAPS / 'rooms.png') as kept:
        assert numpy.array_equal(numpy.asarray(drawn), numpy.asarray(kept))


def test_every_place_is_free_and_reachable_from_every_other() -> None:
    world = load_map(MAPS / 'rooms.yaml')
    planner = GridPlanner(Costmap(world, Inflation()))
    for name, place in PLACES.items():
        assert world.clearance(place.x, place.y) > Inflation().robot_radius + 0.1, name
        for other in PLACES.values():
            assert planner.plan(place, other)


def test_the_passage_is_narrow() -> None:
    """The way into the store leaves the robot a hand's breadth on each side, not more."""
    world = load_map(MAPS / 'rooms.yaml')
    path = GridPlanner(Costmap(world, Inflation())).plan(PLACES['corridor'], PLACES['store'])
    least = min(world.clearance(pose.x, pose.y) for pose in path)
    assert Inflation().robot_radius < least < 2.0 * Inflation().robot_radius


@pytest.mark.parametrize(('start', 'goal'), list(pairwise([*PLACES, 'dock'])))
def test_the_robot_gets_from_place_to_place(start: str, goal: str) -> None:
    arrives(load_map(MAPS / 'rooms.yaml'), PLACES[start], PLACES[goal])
