# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of worlds, and the command that makes them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from PIL import Image, ImageChops

from flexbt_sim import world_tool
from flexbt_sim.errors import SimulationError
from flexbt_sim.world import MODELS, Circle, ObstacleModel, Pose, Trace, World, ZoneModel, box, draw_world
from flexbt_sim.world_tool import main
from flexbt_testing.worlds import drawn

WORLD = """\
plan: {rooms: [{from: [0, 0], to: [4, 2]}]}
robots: {alpha: {model: burger, pose: [1, 1, 0]}}
obstacles: {person: {pose: [3, 1, 0], route: {waypoints: [[3, 1.5], [3, 0.5]]}}}
places: {corner: [1.6, 0.5, 0]}
"""


def colour(picture: Image.Image, x: float, y: float, scale: float) -> tuple[int, ...]:
    """Of a point, m from the lower left corner."""
    found = picture.getpixel((round(x * scale), picture.height - 1 - round(y * scale)))
    assert isinstance(found, tuple)
    return found


@pytest.mark.parametrize('yaw', [0.0, 0.5])
def test_everything_is_where_it_is(yaw: float) -> None:
    """A map may be turned: what is drawn of it is where its cells are."""
    grid = drawn(*['.' * 60] * 30, *['#' * 20 + '.' * 40] * 10, origin=Pose(0.0, 0.0, yaw))
    world = World(grid)
    points = [grid.point(row, column) for row in (-0.5, 39.5) for column in (-0.5, 59.5)]
    left, bottom = min(x for x, _ in points), min(y for _, y in points)
    width = max(x for x, _ in points) - left
    place = {name: grid.point(row, column) for name, (row, column) in {'robot': (20, 40), 'box': (30, 45)}.items()}
    world.add('alpha', MODELS['waffle'], Pose(*place['robot'], yaw))
    world.add('crate', ObstacleModel(pose=Pose(*place['box'], 0.0), shape=box(0.3, 0.3)))
    world.add('lawn', ZoneModel(kind='no_go', pose=Pose(*grid.point(30, 10), 0.0), area=box(0.3, 0.3)))
    picture = draw_world(world, pixels=600)
    scale = max(picture.size) / max(width, max(y for _, y in points) - bottom)
    seen = {
        what: colour(picture, x - left, y - bottom, scale)
        for what, (x, y) in {
            'wall': grid.point(5, 5), 'free': grid.point(15, 10), 'robot': grid.point(22, 40), 'box': place['box'],
            'zone': grid.point(30, 10),
        }.items()
    }  # fmt: skip
    assert max(seen['wall']) < 60
    assert min(seen['free']) > 240
    assert seen['robot'] == (0, 122, 135)
    assert seen['box'] == (150, 130, 110)
    assert seen['zone'][0] > seen['zone'][1] + 20


def test_the_name_of_a_place_is_beside_the_robot_that_stands_there() -> None:
    grid = drawn(*['.' * 60] * 40)
    pictures = []
    for places in ({}, {'dock': Pose(1.5, 1.0, 0.0)}):
        world = World(grid, places=places)
        world.add('alpha', MODELS['waffle'], Pose(1.5, 1.0, 0.0))
        pictures.append(draw_world(world, pixels=600))
    changed = ImageChops.difference(*pictures).getbbox()
    assert changed is not None
    assert changed[1] > 200 + 0.22 * 200  # below the robot, of which all is seen
    assert changed[0] < 300 < changed[2]


def test_names_are_within_the_picture() -> None:
    grid = drawn(*['.' * 60] * 40)
    bare = draw_world(World(grid), pixels=600)
    for x, y in ((0.02, 0.02), (2.98, 0.02), (2.98, 1.98)):
        picture = draw_world(World(grid, places={'the_dock': Pose(x, y, 0.0)}), pixels=600)
        changed = ImageChops.difference(bare, picture).getbbox()
        assert changed is not None
        assert changed[2] - changed[0] > 30  # the whole name


def test_paths_driven_and_planned_are_drawn() -> None:
    world = World()
    robot = world.add('alpha', MODELS['burger'], Pose(0.0, 0.0, 0.0))
    trace = Trace(world)
    for _ in range(60):
        robot.command(0.22, 0.0, world.time)
        world.step(0.1)
        trace.record()
    assert trace.driven('alpha')[0] == (0.0, 0.0)
    assert trace.driven('alpha', until=3.0)[-1][0] == pytest.approx(trace.driven('alpha')[30][0])
    bare = draw_world(world).tobytes()
    assert draw_world(world, trace).tobytes() != bare
    assert draw_world(world, paths={'alpha': [(0.0, 0.0), (1.0, 1.0), (1.0, -1.0)]}).tobytes() != bare


def test_without_a_map_all_that_is_and_was_there_is_in_the_picture(tmp_path: Path) -> None:
    world = World(places={'far': Pose(0.0, 12.0, 0.0)})
    world.add('alpha', MODELS['burger'], Pose(-30.0, 0.0, 0.0))
    trace = Trace(world)
    world.move('alpha', Pose(20.0, 0.0, 0.0))
    trace.record()
    world.move('alpha', Pose(0.0, 0.0, 0.0))
    world.add('lawn', ZoneModel(kind='no_go', pose=Pose(0.0, -10.0, 0.0), area=Circle(5.0)))
    wide, high = 50.0 + 2 * 1.105, 13.0 + 16.0  # with a margin of 1 m
    trace.animate(tmp_path / 'run.png', pixels=1000)
    with Image.open(tmp_path / 'run.png') as moving:
        for size in (draw_world(world, trace, pixels=1000).size, moving.size):
            assert size[0] / size[1] == pytest.approx(wide / high, rel=0.01)


def test_places_are_drawn_however_far_apart_they_are() -> None:
    picture = draw_world(World(places={'near': Pose(0.0, 0.0, 0.0), 'far': Pose(0.0, 60_000.0, 0.0)}), pixels=100)
    assert picture.height == 100


@pytest.mark.parametrize('suffix', ['gif', 'png'])
def test_a_run_moves(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / 'world.yaml'
    file.write_text(WORLD)
    world = World.load(file)
    trace = Trace(world)
    for _ in range(5):
        world.step(0.5)
        trace.record()
    trace.animate(tmp_path / f'run.{suffix}', pixels=100)
    with Image.open(tmp_path / f'run.{suffix}') as picture:
        assert getattr(picture, 'n_frames', 1) == 6
        assert max(picture.size) == 100


def test_what_cannot_be_drawn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r'a moving picture is a \.gif or a \.png'):
        Trace(World()).animate(tmp_path / 'run.mp4')
    with pytest.raises(SimulationError, match='a picture of 3 pixels'):
        draw_world(World(), pixels=3)


@pytest.mark.parametrize(
    ('picture', 'told'), [('run', 'give it the suffix'), ('run.mp4', 'give it the suffix'), ('a/run.png', 'directory')]
)
def test_a_picture_that_cannot_be_written_is_refused_before_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], picture: str, told: str
) -> None:
    (tmp_path / 'world.yaml').write_text(WORLD)
    with pytest.raises(SystemExit):
        main(['run', str(tmp_path / 'world.yaml'), str(tmp_path / picture), '--seconds', '86400'])
    assert told in capsys.readouterr().err


def test_an_output_without_a_reader_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / 'world.yaml').write_text(WORLD)
    with subprocess.Popen(
        ['world_tool', 'check', str(tmp_path / 'world.yaml')], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as program:
        assert program.stdout is not None and program.stderr is not None
        program.stdout.close()
        assert (program.stderr.read(), program.wait()) == (b'', 0)


def test_the_command_checks_draws_and_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / 'world.yaml'
    file.write_text(WORLD)
    assert main(['check', str(file)]) == 0
    assert '1 robot, 1 obstacle,' in capsys.readouterr().out
    assert main(['draw', str(file), str(tmp_path / 'world.png'), '--pixels', '120']) == 0
    drive = ['--drive', 'alpha=0.2,0.0', '--seconds', '3', '--pixels', '120']
    assert main(['run', str(file), str(tmp_path / 'run.png'), *drive]) == 0
    assert 'after 3 s; contacts: none' in capsys.readouterr().out
    with Image.open(tmp_path / 'run.png') as picture:
        assert picture.size[0] == 120
    assert main(['run', str(file), str(tmp_path / 'run.png'), '--drive', 'beta=1,1']) == 1
    assert 'robots: alpha' in capsys.readouterr().err
    assert main(['run', str(file), str(tmp_path / 'run.png'), '--drive', 'alpha=nan,0']) == 1
    monkeypatch.setattr(world_tool, 'NAVIGATORS', 'flexbt.nothing')
    goals = ['--goal', 'alpha=corner', '--seconds', '40', '--pixels', '120']
    assert main(['run', str(file), str(tmp_path / 'run.png'), *goals]) == 1
    assert 'install the package flexbt_navigation' in capsys.readouterr().err
    file.write_text('sede: 3')
    assert main(['check', str(file)]) == 1
    assert capsys.readouterr().err == f"{file}:1:1: sede: there is no such key; did you mean 'seed'?\n"
