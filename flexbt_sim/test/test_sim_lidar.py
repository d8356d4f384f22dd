# SPDX-License-Identifier: BSD-3-Clause
"""The lidar against a slow ray caster."""

from __future__ import annotations

import math
import random

import numpy
import pytest
from sim_maps import cluttered, drawn, free_pose

from flexbt_sim.geometry import Pose
from flexbt_sim.lidar import Lidar, LidarModel
from flexbt_sim.occupancy_map import OccupancyMap

EXACT = LidarModel(beams=90, noise=0.0)


def cast(world: OccupancyMap, pose: Pose, angle: float, model: LidarModel) -> float:
    """Distance to the first obstacle cell, by tiny steps."""
    step = world.resolution / 40.0
    for number in range(int(model.range_max / step)):
        row, column = world.cell(
            pose.x + number * step * math.cos(pose.yaw + angle), pose.y + number * step * math.sin(pose.yaw + angle)
        )
        if not world.contains(row, column):
            return math.inf
        if world.obstacles[row, column]:
            return number * step
    return math.inf


@pytest.mark.parametrize('seed', range(8))
def test_ranges_are_those_of_a_ray_caster(seed: int) -> None:
    world = cluttered(seed, border=seed % 2 == 0)
    pose = free_pose(world, random.Random(seed), 0.2)
    assert pose is not None
    ranges = Lidar(world, EXACT, seed=0).scan(pose)
    wrong = 0
    for beam, measured in enumerate(ranges):
        expected = cast(world, pose, beam * EXACT.angle_increment, EXACT)
        close = measured == expected or abs(measured - expected) <= 0.75 * world.resolution
        if not close and expected <= EXACT.range_max - 0.1:
            wrong += 1  # a beam that just touches a corner
    assert wrong <= 2


def test_ranges_out_of_bounds_are_infinite() -> None:
    world = drawn(*['.' * 200] * 100, '#' * 200)
    near = Lidar(world, EXACT, seed=0).scan(Pose(5.0, 0.1, 0.0))
    assert not numpy.isfinite(near[67])  # straight down, closer than range_min
    far = Lidar(world, EXACT, seed=0).scan(Pose(5.0, 4.9, 0.0))
    assert not numpy.isfinite(far).any()


def test_noise_depends_on_the_seed_only() -> None:
    world = cluttered(3)
    pose = free_pose(world, random.Random(3), 0.3)
    assert pose is not None
    noisy = LidarModel(beams=360, noise=0.02)

    def scans(seed: int) -> list[list[float]]:
        lidar = Lidar(world, noisy, seed)
        return [lidar.scan(pose).tolist() for _ in range(3)]

    assert scans(1) == scans(1)
    assert scans(1) != scans(2)
    exact = Lidar(world, LidarModel(beams=360, noise=0.0), 0).scan(pose)
    seen = numpy.array(scans(1)[0])
    both = numpy.isfinite(seen) & numpy.isfinite(exact)
    assert 0.01 < float(numpy.std(seen[both] - exact[both])) < 0.03
