# SPDX-License-Identifier: BSD-3-Clause
"""The lidar against a ray caster that checks every obstacle."""

from __future__ import annotations

import math

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.world import LidarModel, OccupancyMap, Pose
from flexbt_testing.worlds import Scanner, drawn, places, worlds

BOX = drawn('#' * 62, *['#' + '.' * 60 + '#'] * 60, '#' * 62)
"""3 m by 3 m within walls of 5 cm."""

CENTRE = Pose(1.55, 1.55, 0.0)


def cast(world: OccupancyMap, pose: Pose, angle: float) -> float:
    """Distance along a beam to the nearest of the squares that are obstacles, m: where it enters one on both axes."""
    rows, columns = numpy.nonzero(world.cells > 50)
    x, y = pose.x - world.origin.x, pose.y - world.origin.y
    heading = pose.yaw + angle
    turned = heading - world.origin.yaw
    place = complex(x, y) * complex(math.cos(world.origin.yaw), -math.sin(world.origin.yaw)) / world.resolution
    enters, leaves = numpy.zeros(rows.size), numpy.full(rows.size, math.inf)
    for cells, start, component in ((columns, place.real, math.cos(turned)), (rows, place.imag, math.sin(turned))):
        speed = component if abs(component) > 1e-30 else 1e-30
        ends = numpy.stack([(cells - start) / speed, (cells + 1 - start) / speed])
        enters, leaves = numpy.maximum(enters, ends.min(axis=0)), numpy.minimum(leaves, ends.max(axis=0))
    return float(enters[enters <= leaves].min(initial=math.inf)) * world.resolution


@settings(deadline=None)
@given(st.data(), worlds(), st.integers(1, 60), st.floats(0.0, 0.5), st.floats(0.6, 30.0))
def test_ranges_are_those_of_a_ray_caster(
    data: st.DataObject, world: OccupancyMap, beams: int, range_min: float, range_max: float
) -> None:
    model = LidarModel(beams, range_min, range_max, noise=0.0)
    pose = data.draw(places(world, beside=10.0))
    scan = Scanner(world, model, seed=0).scan(pose)
    assert scan.shape == (beams,)
    for beam, measured in enumerate(scan):
        # One that just touches a corner may see it or not.
        near_by = [cast(world, pose, beam * 2.0 * math.pi / beams + turn) for turn in (-1e-5, 0.0, 1e-5)]
        low, high = min(near_by) - 1e-3, max(near_by) + 1e-3
        if math.isfinite(measured):
            assert low <= measured <= high
            assert range_min - 1e-6 <= measured <= range_max + 1e-6
        elif measured > 0.0:
            assert high > range_max
        else:
            assert low < range_min


def test_beams_start_ahead_and_turn_to_the_left() -> None:
    scan = Scanner(BOX, LidarModel(beams=4, noise=0.0), seed=0).scan(Pose(0.55, 1.25, math.pi / 2))
    assert scan == pytest.approx([1.8, 0.5, 1.2, 2.5], abs=1e-4)


def test_too_near_is_minus_infinity_and_too_far_infinity() -> None:
    scan = Scanner(BOX, LidarModel(beams=4, range_min=0.2, range_max=2.5, noise=0.0), seed=0).scan(Pose(0.2, 1.0, 0.0))
    assert scan[0] == math.inf
    assert scan[2] == -math.inf
    assert numpy.isfinite(scan[[1, 3]]).all()


def test_noise_has_its_deviation_no_bias_and_depends_on_the_seed_only() -> None:
    model = LidarModel(noise=0.02)

    def scans(seed: int) -> list[list[float]]:
        lidar = Scanner(BOX, model, seed)
        return [lidar.scan(CENTRE).tolist() for _ in range(20)]

    assert scans(1) == scans(1)
    assert scans(1) != scans(2)
    assert scans(1)[0] != scans(1)[1]
    exact = Scanner(BOX, LidarModel(noise=0.0), 0).scan(CENTRE)
    errors = numpy.array(scans(1)) - exact
    assert abs(float(errors.mean())) < 4.0 * 0.02 / math.sqrt(errors.size)
    assert float(errors.std()) == pytest.approx(0.02, rel=0.05)


def test_noise_does_not_depend_on_what_was_seen() -> None:
    elsewhere = Pose(0.5, 2.5, 1.0)
    one, other = (Scanner(BOX, LidarModel(), seed=5) for _ in range(2))
    one.scan(CENTRE)
    other.scan(elsewhere)
    assert one.scan(CENTRE).tolist() == other.scan(CENTRE).tolist()
