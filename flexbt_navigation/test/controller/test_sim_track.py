# SPDX-License-Identifier: BSD-3-Clause
"""Points along a path against a dense row of points."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_navigation.controller.path_follower import Track
from flexbt_sim.world import Pose, compose
from flexbt_testing.waiting import processor_time

poses = st.builds(Pose, st.integers(-20, 20).map(lambda n: n / 5), st.floats(-4.0, 4.0), st.just(0.0))
paths = st.lists(poses, min_size=1, max_size=8)
PARTS = numpy.linspace(0.0, 1.0, 4001)


def dense(path: list[Pose], begin: float, end: float) -> tuple[numpy.ndarray, numpy.ndarray]:
    """Distances from the beginning and the points there, between two distances."""
    steps = [a.distance(b) for a, b in pairwise(path)]
    at = begin + PARTS * (end - begin)
    points = []
    for distance in at:
        for (a, b), step in zip(pairwise(path), steps, strict=True):
            if distance <= step and step > 0.0:
                points.append((a.x + (b.x - a.x) * distance / step, a.y + (b.y - a.y) * distance / step))
                break
            distance -= step
        else:
            points.append(path[-1][:2])
    return at, numpy.array(points)


@settings(deadline=None)
@given(paths, poses, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_nearest_point_of_a_part(path: list[Pose], pose: Pose, one: float, other: float) -> None:
    track = Track(path)
    assert track.length == pytest.approx(sum(a.distance(b) for a, b in pairwise(path)))
    begin, end = sorted((one * track.length, other * track.length))
    nearest = track.nearest(pose, begin, end)
    assert begin - 1e-9 <= nearest <= end + 1e-9
    _, points = dense(path, begin, end)
    least = numpy.hypot(*(points - pose[:2]).T).min()
    assert abs(math.dist(track.point(nearest), pose[:2]) - least) <= track.length / 4000.0 + 1e-6


@settings(deadline=None)
@given(paths, poses, st.floats(0.0, 1.0), st.floats(0.01, 3.0))
def test_the_first_point_that_is_so_far_ahead(path: list[Pose], pose: Pose, part: float, reach: float) -> None:
    track = Track(path)
    begin = part * track.length
    carrot = track.ahead(pose, begin, reach)
    at, points = dense(path, begin, track.length)
    gaps = numpy.hypot(*(points - pose[:2]).T)
    spacing = track.length / 4000.0 + 1e-6
    outside = numpy.flatnonzero(gaps >= reach + spacing)
    if outside.size:  # just before it, or earlier where the path only touches the circle
        index = int(outside[0])
        inside = numpy.flatnonzero(gaps[:index] >= reach - spacing)
        assert math.dist(carrot, points[index]) <= at[index] - at[inside[0] if inside.size else index] + 2.0 * spacing
        assert gaps[0] >= reach - spacing or abs(math.dist(carrot, pose[:2]) - reach) <= spacing
    elif gaps.max() < reach - spacing:
        assert carrot == pytest.approx(path[-1][:2])


def test_a_path_of_one_pose_is_a_point() -> None:
    track = Track([Pose(1.0, 2.0, 0.5)])
    assert track.length == 0.0
    assert track.nearest(Pose(5.0, 5.0, 0.0), 0.0, 1.5) == 0.0
    assert track.ahead(Pose(5.0, 5.0, 0.0), 0.0, 0.25) == (1.0, 2.0)
    assert track.ahead(Pose(1.0, 2.0, 0.0), 0.0, 0.25) == (1.0, 2.0)


@given(paths, poses, st.builds(Pose, *[st.floats(-3.0, 3.0)] * 3), st.floats(0.0, 1.0))
def test_a_track_that_is_moved_is_the_same_seen_from_its_frame(
    path: list[Pose], pose: Pose, by: Pose, part: float
) -> None:
    track, seen = Track(path), compose(by, pose)
    moved, at = track.moved(by), part * track.length
    assert moved.length == track.length
    assert moved.point(at) == pytest.approx(compose(by, Pose(*track.point(at), 0.0))[:2], abs=1e-9)
    gaps = [
        math.dist(moved.point(one.nearest(there, 0.0, track.length)), seen[:2])
        for one, there in ((track, pose), (moved, seen))
    ]
    assert gaps[0] == pytest.approx(gaps[1], abs=1e-6)


def test_a_long_track_is_moved_with_its_frame_in_less_than_the_time_of_its_poses() -> None:
    """It is moved at each step of the robot: a pose for each of its corners would take a third of a processor."""
    path = [Pose(0.05 * number, 3.0, 0.0) for number in range(10_000)]
    track, by = Track(path), Pose(0.1, 0.2, 0.3)

    def seconds(work: Callable[[], object]) -> float:
        began = processor_time()
        for _ in range(20):
            work()
        return processor_time() - began

    assert seconds(lambda: track.moved(by)) < seconds(lambda: [compose(by, pose) for pose in path]) / 2.0
