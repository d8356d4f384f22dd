# SPDX-License-Identifier: BSD-3-Clause
"""Angles, arcs, and what is in bounds."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from flexbt_sim.world import Circle, Polygon, Pose, Shape, box, drive, gap, wrap
from flexbt_sim.world.plane.geometry import contains, distance, touches_box

ANGLE = st.floats(-math.pi, math.pi)
SPEED = st.floats(-20.0, 20.0) | st.floats(-1e-6, 1e-6)
DURATION = st.floats(0.0, 10.0)


@given(st.floats(-1e6, 1e6))
@example(math.pi)
@example(-math.pi)
@example(math.nextafter(math.pi, 4.0))
@example(math.nextafter(-math.pi, -4.0))
@example(3.0 * math.pi)
def test_a_wrapped_angle_is_the_same_direction_within_its_bounds(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert abs(cmath.rect(1.0, wrapped) - cmath.rect(1.0, angle)) < 1e-9


def test_no_number_stays_no_number() -> None:
    """Whoever checks a pose that came over the network wraps its heading first."""
    assert math.isnan(wrap(math.nan))


@given(ANGLE, ANGLE, st.floats(0.01, 100.0))
def test_the_bearing_of_a_point_is_seen_from_the_heading(yaw: float, bearing: float, distance: float) -> None:
    pose = Pose(3.0, -2.0, yaw)
    x, y = pose.x + distance * math.cos(yaw + bearing), pose.y + distance * math.sin(yaw + bearing)
    assert abs(wrap(pose.bearing(x, y) - bearing)) < 1e-6
    assert pose.distance(Pose(x, y, 0.0)) == pytest.approx(distance)


@given(ANGLE, SPEED, SPEED, DURATION)
def test_an_arc_solves_the_equations_of_motion(yaw: float, linear: float, angular: float, duration: float) -> None:
    """Against the midpoint rule; its error is of the third order in the turn of one step."""
    steps = 2000
    x, y, heading, interval = 1.0, 2.0, yaw, duration / steps
    for _ in range(steps):
        x += linear * interval * math.cos(heading + angular * interval / 2.0)
        y += linear * interval * math.sin(heading + angular * interval / 2.0)
        heading += angular * interval
    reached = drive(Pose(1.0, 2.0, yaw), linear, angular, duration)
    error = abs(linear) * duration * (angular * interval) ** 2 / 20.0 + 1e-9 * (1.0 + abs(linear) * duration)
    assert math.dist(reached[:2], (x, y)) <= error
    assert abs(wrap(reached.yaw - heading)) < 1e-9


@given(ANGLE, SPEED, SPEED, DURATION, st.floats(0.0, 1.0))
def test_an_arc_is_the_sum_of_its_parts(
    yaw: float, linear: float, angular: float, duration: float, part: float
) -> None:
    start = Pose(1.0, 2.0, yaw)
    whole = drive(start, linear, angular, duration)
    parts = drive(drive(start, linear, angular, duration * part), linear, angular, duration * (1.0 - part))
    assert whole.distance(parts) < 1e-9
    assert abs(wrap(whole.yaw - parts.yaw)) < 1e-9


@given(ANGLE, SPEED, SPEED, DURATION)
def test_driving_back_the_same_arc_leads_back(yaw: float, linear: float, angular: float, duration: float) -> None:
    start = Pose(1.0, 2.0, yaw)
    back = drive(drive(start, linear, angular, duration), -linear, -angular, duration)
    assert back.distance(start) < 1e-9
    assert abs(wrap(back.yaw - start.yaw)) < 1e-9


PLACE = st.floats(-5.0, 5.0)
SHAPE = st.sampled_from([Circle(1.5), box(3.0, 1.0), Polygon(((2.0, 0.0), (-2.0, 2.0), (-1.0, 0.0), (-2.0, -2.0)))])


@given(SHAPE, PLACE, PLACE, ANGLE, PLACE, PLACE, st.floats(0.01, 4.0), st.floats(0.01, 4.0))
def test_what_touches_bounds_has_no_gap_to_them(
    shape: Shape, x: float, y: float, yaw: float, left: float, bottom: float, width: float, height: float
) -> None:
    pose, middle = Pose(x, y, yaw), Pose(left + width / 2.0, bottom + height / 2.0, 0.0)
    apart = gap(shape, pose, box(width, height), middle)
    assume(abs(apart) > 1e-6)
    assert touches_box(shape, pose, (left, bottom), (left + width, bottom + height)) == (apart < 0.0)
    apart = gap(shape, pose, Circle(width), middle)
    assert (distance(shape, pose, middle.x, middle.y) <= width) == (apart <= 0.0)


@given(SHAPE, PLACE, PLACE, ANGLE)
def test_bounds_may_be_large_or_a_point(shape: Shape, x: float, y: float, yaw: float) -> None:
    assert touches_box(shape, Pose(1.0, 2.0, yaw), (-1e9, -1e300), (1e300, 1e9))
    assert not touches_box(shape, Pose(1.0, 2.0, yaw), (10.0, -1e9), (1e9, 1e9))
    assert touches_box(shape, Pose(0.0, 0.0, yaw), (x, y), (x, y)) == contains(shape, Pose(0.0, 0.0, yaw), x, y)
