# SPDX-License-Identifier: BSD-3-Clause
"""Where a robot can be put, and what is said about other places."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_maps import drawn, places, room, worlds

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import Circle, OccupancyMap, Pose, RobotModel, World


@settings(deadline=None)
@given(st.data(), worlds(), st.floats(0.01, 1.0))
def test_a_place_is_accepted_where_the_robot_fits_on_the_map(
    data: st.DataObject, world: OccupancyMap, radius: float
) -> None:
    pose = data.draw(places(world, beside=3.0))
    fits = world.contains(*world.cell(*pose[:2])) and room(world, *pose[:2]) >= radius
    try:
        World(world).add('alpha', RobotModel(footprint=Circle(radius), lidar=None), pose)
    except SimulationError as error:
        assert not fits
        assert f'({pose.x:g}, {pose.y:g}' in str(error)
    else:
        assert fits


@pytest.mark.parametrize(
    ('pose', 'said'),
    [
        (Pose(math.nan, 1.0, 0.0), 'finite'),
        (Pose(1.0, 1.0, math.inf), 'finite'),
        (Pose(5.0, 1.0, 0.0), 'outside of the map of 2 x 1.5 m with its corner at (0, 0)'),
        (Pose(0.15, 1.0, 0.0), "0.10 m from an obstacle, and 'alpha' has a radius of 0.22 m"),
    ],
)
def test_the_reason_is_said(pose: Pose, said: str) -> None:
    world = drawn(*['#' + '.' * 39] * 30)
    with pytest.raises(SimulationError) as raised:
        World(world).add('alpha', RobotModel(), pose)
    assert said in str(raised.value)
