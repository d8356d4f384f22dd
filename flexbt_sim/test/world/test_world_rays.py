# SPDX-License-Identifier: BSD-3-Clause
"""Beams, compiled, interpreted and as whole-array operations, against a look at every cell and every side."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Sequence
from itertools import pairwise, product
from pathlib import Path

import numpy
import pytest
from array_rays import cast_at_once
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from flexbt_sim.world import Circle, ObstacleModel, OccupancyMap, Polygon, Pose, Shape, World, box, gap
from flexbt_sim.world.plane import loops
from flexbt_sim.world.plane.ray_casting import Beams, Floats, Outlines, RayCaster, outlines
from flexbt_testing.worlds import places, worlds

EDGE = 1e-5
"""Beams this near, rad, to an edge may meet it or not."""

ON_OUTLINE = 1e-6
"""What is no farther, m, from a body, is on its outline."""

NOT_CONVEX = Polygon(((0.0, 0.0), (0.5, -0.4), (0.0, 0.8), (-0.5, -0.4)))

shapes: st.SearchStrategy[Shape] = st.one_of(
    st.floats(0.05, 1.0).map(Circle),
    st.builds(box, st.floats(0.05, 2.0), st.floats(0.05, 2.0)),
    st.just(NOT_CONVEX),
)


Cast = Callable[[OccupancyMap | None, Sequence[Beams], Outlines], list[Floats]]


def cast_compiled(world: OccupancyMap | None, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
    return RayCaster(world).cast(sensors, bodies)


def cast_interpreted(world: OccupancyMap | None, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
    with pytest.MonkeyPatch.context() as patch:
        for loop in (loops.cast, loops.covers):
            patch.setattr(loop, 'compiled', None)
        return RayCaster(world).cast(sensors, bodies)


CASTS: dict[str, Cast] = {
    'compiled': cast_compiled,
    'interpreted': cast_interpreted,
    'whole arrays': cast_at_once,
}

NEAR_EDGE = 1e-5
"""A beam that is in a cell for no longer than this, in cells, may miss it."""


def cast_on_map(world: OccupancyMap, pose: Pose, angle: float, least: float) -> float:
    """Distance to the nearest of the squares that are obstacles and in which the beam is for that long, in cells."""
    rows, columns = numpy.nonzero(world.cells > 50)
    turned = pose.yaw + angle - world.origin.yaw
    row, column = world.grid_position(pose.x, pose.y)
    enters, leaves = numpy.zeros(rows.size), numpy.full(rows.size, math.inf)
    for cells, start, component in ((columns, column, math.cos(turned)), (rows, row, math.sin(turned))):
        speed = component if abs(component) > 1e-30 else 1e-30
        ends = numpy.stack([(cells - start) / speed, (cells + 1 - start) / speed])
        enters, leaves = numpy.maximum(enters, ends.min(axis=0)), numpy.minimum(leaves, ends.max(axis=0))
    return float(enters[enters + least <= leaves].min(initial=math.inf)) * world.resolution


def room_beside(shape: Shape, at: Pose, pose: Pose) -> float:
    """Distance from a pose to a body, m; negative in it."""
    return gap(Circle(0.01), pose, shape, at) + 0.01


def cast_on_body(shape: Circle | Polygon, at: Pose, pose: Pose, angle: float) -> float:
    """Distance to a body, in complex numbers along the beam."""
    if room_beside(shape, at, pose) <= ON_OUTLINE:
        return 0.0
    along = complex(math.cos(pose.yaw + angle), -math.sin(pose.yaw + angle))
    if isinstance(shape, Circle):
        middle = complex(at.x - pose.x, at.y - pose.y) * along
        chord = shape.radius**2 - middle.imag**2
        return middle.real - math.sqrt(chord) if chord >= 0.0 and middle.real >= 0.0 else math.inf
    corners = [complex(x - pose.x, y - pose.y) * along for x, y in shape.points(at)]
    meets = [
        a.real + (b.real - a.real) * a.imag / (a.imag - b.imag)
        for a, b in pairwise([*corners, corners[0]])
        if (a.imag > 0.0) != (b.imag > 0.0)
    ]
    return min((one for one in meets if one >= 0.0), default=math.inf)


@pytest.mark.parametrize('path', CASTS)
@settings(deadline=None, max_examples=25)
@given(st.data())
def test_ranges_are_exact(path: str, data: st.DataObject) -> None:
    grid = data.draw(worlds() | st.none())
    world = World(grid)
    somewhere = places(grid, beside=5.0) if grid else st.builds(Pose, *[st.floats(-3.0, 3.0)] * 3)
    for i in range(data.draw(st.integers(0, 3))):
        world.add(f'body{i}', ObstacleModel(pose=data.draw(somewhere), shape=data.draw(shapes)))
    made = st.builds(
        Beams,
        somewhere,
        angle_min=st.floats(-3.2, 3.2),
        angle_increment=st.floats(0.0, 0.2),
        beams=st.integers(1, 8),
        range_max=st.floats(0.5, 30.0),
        owner=st.integers(-1, 2),
    )
    sensors = data.draw(st.lists(made, min_size=1, max_size=3))
    bodies = list(world.obstacles.values())
    for place, body in product(sensors, bodies):  # just beside an outline, rounding turns beams by more than EDGE
        assume(not 0.9 * ON_OUTLINE < room_beside(body.shape, body.pose, place.pose) < 0.001)
    for sensor, ranges in zip(sensors, CASTS[path](grid, sensors, outlines(bodies)), strict=True):
        assert ranges.shape == (sensor.beams,)
        for beam, measured in enumerate(ranges):
            angle = sensor.angle_min + beam * sensor.angle_increment
            others = [one for number, one in enumerate(bodies) if number != sensor.owner]
            near = [
                min(
                    cast_on_map(grid, sensor.pose, angle + turn, least) if grid else math.inf,
                    *(cast_on_body(one.shape, one.pose, sensor.pose, angle + turn) for one in others),
                    math.inf,
                )
                for turn, least in product((-EDGE, 0.0, EDGE), (0.0, NEAR_EDGE))
            ]
            low, high = min(near), max(near)
            if math.isinf(measured):
                assert high > sensor.range_max - 1e-3
            else:
                assert low - 1e-3 <= measured <= high + 1e-3
                assert measured <= sensor.range_max


@settings(deadline=None, max_examples=25)
@given(st.data(), worlds(border=True))
def test_all_ways_give_the_same_ranges(data: st.DataObject, grid: OccupancyMap) -> None:
    poses = data.draw(st.lists(places(grid), min_size=1, max_size=4))
    sensors = [Beams(pose, 0.0, math.tau / 90, 90, 30.0, -1) for pose in poses]
    world = World(grid)
    for i in range(data.draw(st.integers(0, 4))):
        world.add(f'body{i}', ObstacleModel(pose=data.draw(places(grid)), shape=data.draw(shapes)))
    bodies = outlines(world.obstacles.values())
    interpreted = cast_interpreted(grid, sensors, bodies)
    for one, other in zip(cast_compiled(grid, sensors, bodies), interpreted, strict=True):
        assert one == pytest.approx(other, abs=1e-9)
    for one, other in zip(interpreted, cast_at_once(grid, sensors, bodies), strict=True):
        both = numpy.isfinite(one) & numpy.isfinite(other)
        differs = (numpy.isfinite(one) != numpy.isfinite(other)).sum()
        differs += (numpy.abs(one[both] - other[both]) > 1e-6).sum()
        assert differs <= 2  # a beam along an edge, or just past a corner, may go either way by the last bit


def cast_one(path: str, shape: Shape, at: Pose, sensor: Beams) -> list[float]:
    """Ranges beside one body."""
    world = World()
    world.add('body', ObstacleModel(pose=at, shape=shape))
    found: list[float] = CASTS[path](None, [sensor], outlines(world.obstacles.values()))[0].tolist()
    return found


@pytest.mark.parametrize('path', CASTS)
def test_no_beam_slips_between_two_sides(path: str) -> None:
    """From beside a polygon, straight at each of its corners."""
    at = Pose(0.3, -0.7, 0.1)
    for corners in range(3, 40):
        angles = [math.tau * i / corners for i in range(corners)]
        shape = Polygon(tuple((math.cos(angle), math.sin(angle)) for angle in angles))
        for angle in angles:
            x, y = at.x + 2.0 * math.cos(angle + at.yaw), at.y + 2.0 * math.sin(angle + at.yaw)
            sensor = Beams(Pose(x, y, angle + at.yaw), math.pi, 0.0, 1, 5.0, -1)
            assert cast_one(path, shape, at, sensor) == pytest.approx([1.0], abs=1e-6)


@pytest.mark.parametrize('path', CASTS)
@settings(deadline=None, max_examples=25)
@given(shapes, st.builds(Pose, *[st.floats(-9.0, 9.0)] * 3), st.floats(0.0, math.tau), st.floats(0.0, 1.0))
@example(NOT_CONVEX, Pose(0.02, 0.02, 0.0), 0.0, 0.0)
def test_a_body_is_solid(path: str, shape: Shape, at: Pose, angle: float, part: float) -> None:
    """On its outline, a corner of it too, and within it nothing is seen but it: 0 m off, whatever the direction."""
    if isinstance(shape, Circle):
        out = complex(shape.radius * math.cos(angle), shape.radius * math.sin(angle))
        inside = [complex(at.x, at.y) + out, complex(at.x, at.y) + part * out]
    else:
        inside = [complex(x0 + part * (x1 - x0), y0 + part * (y1 - y0)) for x0, y0, x1, y1 in shape.sides(at)]
        inside += [complex(x, y) for x, y in shape.points(at)]
        inside += [
            one
            for one in (a + part * (b - a) for a, b in product(inside, inside))
            if room_beside(shape, at, Pose(one.real, one.imag, 0.0)) <= 0.0
        ]
    for one in inside:
        sensor = Beams(Pose(one.real, one.imag, angle), 0.0, math.tau / 12, 12, 5.0, -1)
        assert cast_one(path, shape, at, sensor) == [0.0] * 12
        assert cast_one(path, shape, at, sensor._replace(owner=0)) == [math.inf] * 12


@pytest.mark.parametrize('path', CASTS)
@pytest.mark.filterwarnings('error')
def test_a_beam_may_be_all_but_parallel_to_a_side(path: str) -> None:
    """So that it would meet the side farther away than a number can say."""
    sensor = Beams(Pose(-3.0, 0.2, 5e-324), 0.0, 0.0, 1, 5.0, -1)
    assert cast_one(path, box(2.0, 1.0), Pose(0.0, 0.0, 0.0), sensor) == [2.0]


# -- the files that numba keeps ----------------------------------------------------------------------------------------


def test_what_numba_keeps_may_be_damaged_or_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    numba = pytest.importorskip('numba')
    monkeypatch.setenv('FLEXBT_ACCELERATION', '1')
    monkeypatch.setattr(numba.config, 'CACHE_DIR', str(tmp_path))

    def half(number: float) -> float:
        return number / 2.0

    assert loops.Loop(half)(3.0) == 1.5
    kept = [file for file in tmp_path.rglob('*') if file.is_file()]
    assert len(kept) == 2
    for file in kept:
        file.write_bytes(b'')
        assert loops.Loop(half)(3.0) == 1.5
        assert file.stat().st_size
    loop = loops.Loop(half)
    assert loop.compiled is not None
    shutil.rmtree(kept[0].parent)
    kept[0].parent.touch()  # no directory
    assert loop(3.0) == 1.5
    assert 'numba compiles half anew in each process, as it cannot keep it' in caplog.text
