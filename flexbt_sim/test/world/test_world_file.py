# SPDX-License-Identifier: BSD-3-Clause
"""World files: what they say is in the world, and what is wrong with them is told with its place."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy
import pytest
import scipy
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import WorldError
from flexbt_sim.world import Circle, Pose, World, WorldFile
from flexbt_sim.world.world_file import FloorPlan

WORLD = """\
plan:
  rooms:
    - {from: [0, 0], to: [6, 4]}
    - {from: [6, 0], to: [10, 4]}
  openings:
    - {at: [6, 2], width: 1.0}
seed: 3
models:
  courier: {based_on: burger, drive: {slip: 0.05}, odometry: {linear_noise: 0.01, drift: 0.01}}
robots:
  alpha: {model: burger, pose: [1, 1, 0], lidar: {beams: 180}}
  beta: {model: courier, pose: [1, 2, 0], battery: null}
obstacles:
  box: {pose: [3, 3, 0.3], shape: [0.5, 0.4]}
  person: {pose: [4, 1, 0], shape: 0.25, route: {waypoints: [[4, 3], [4, 1]], speed: 0.8}}
  cart: {pose: [8, 2, 0], random_walk: {speed: 0.6}}
doors:
  gate: {from: [6, 1.5], to: [6, 2.5], automatic: true}
stations:
  dock: {pose: [1, 1, 0]}
zones:
  mud: {kind: slow, pose: [3, 1, 0], area: 0.5, speed: 0.05}
places:
  kitchen: [8, 1, 0]
faults:
  - {entity: alpha, fault: stuck_wheel, parameters: {side: left}, after: 2, duration: 3}
"""


def load(directory: Path, text: str) -> World:
    file = directory / 'world.yaml'
    file.write_text(text)
    return World.load(file)


def problems(directory: Path, text: str) -> list[str]:
    """Return what is wrong with a file, without its name."""
    with pytest.raises(WorldError) as caught:
        load(directory, text)
    prefix = f'{directory / "world.yaml"}:'
    assert all(one.startswith(prefix) for one in caught.value.problems)
    return [one.removeprefix(prefix) for one in caught.value.problems]


def test_everything_that_a_file_says_is_in_the_world(tmp_path: Path) -> None:
    world = load(tmp_path, WORLD)
    assert list(world.robots) == ['alpha', 'beta']
    assert list(world.obstacles) == ['box', 'person', 'cart']
    assert (list(world.doors), list(world.stations), list(world.zones)) == (['gate'], ['dock'], ['mud'])
    assert world.places == {'kitchen': Pose(8.0, 1.0, 0.0)}
    assert world.seed == 3
    alpha, beta = world.robots.values()
    assert alpha.model.footprint == Circle(0.105)
    assert alpha.model.lidar is not None
    assert (alpha.model.lidar.beams, alpha.model.lidar.range_max) == (180, 3.5)
    assert (beta.model.drive.slip, beta.model.drive.linear_speed, beta.battery) == (0.05, 0.22, None)
    assert [(one.entity, one.name, one.begins, one.ends) for one in world.faults] == [
        ('alpha', 'stuck_wheel', 2.0, 5.0)
    ]
    assert world.map is not None
    cells = [world.map.cells[world.map.cell(x, 2.0)] for x in (0.0, 3.0, 6.0, 10.0)]
    assert cells == [100, 0, 0, 100]


@pytest.mark.parametrize(
    ('old', 'new', 'at', 'message'),
    [
        ('seed: 3', 'sed: 3', 'sed', "sed: there is no such key; did you mean 'seed'?"),
        ('beams: 180', 'beams: 0', 'beams', 'robots.alpha.lidar.beams: 0 is not within 1 to 100000'),
        ('beams: 180', 'beam: 180', 'beam:', "robots.alpha.lidar.beam: there is no such key; did you mean 'beams'?"),
        (
            '{model: burger',
            '{modle: burger',
            'modle',
            "robots.alpha.modle: there is no such key; did you mean 'model'?",
        ),
        ('burger, pose', 'burger, poes', 'poes', "robots.alpha.poes: there is no such key; did you mean 'pose'?"),
        ('based_on', 'base_on', 'base_on', "models.courier.base_on: there is no such key; did you mean 'based_on'?"),
        ('{based_on', '{pose: [1, 1, 0], based_on', 'pose: [1, 1, 0], b', 'models.courier.pose: there is no such key'),
        ('parameters', 'paramters', 'param', "faults.0.paramters: there is no such key; did you mean 'parameters'?"),
        (
            '{model: burger',
            '{model: berger',
            'model: berger',
            "there is no model 'berger' before this; did you mean 'burger'?",
        ),
        (
            '{model: burger',
            '{model: [burger]',
            'model: [',
            "robots.alpha.model: there is no model ['burger'] before this",
        ),
        ('seed: 3', '"\\e[2J": 3', '"', '\\e[2J: there is no such key'),
        ('seed: 3', f'seed: {"9" * 400}', 'seed', '9 is not within 0 to 9.0072e+15'),
        ('slip: 0.05', 'slip: much', 'slip', "models.courier.drive.slip: expected a number, got 'much'"),
        ('pose: [1, 2, 0]', 'pose: [1, 2]', 'pose: [1, 2]', 'robots.beta.pose: expected a list of 3 numbers'),
        ('pose: [1, 2, 0], ', '', 'beta', "robots.beta: 'pose' is missing"),
        ('pose: [1, 2, 0]', 'pose: [0, 2, 0]', 'beta', 'from an obstacle'),
        ('pose: [1, 2, 0]', 'pose: [1, 1.1, 0]', 'beta', "would overlap 'alpha'"),
        ('shape: [0.5, 0.4]', 'shape: [[0, 0], [1, 1], [1, 0], [0, 1]]', 'shape', 'sides that cross'),
        ('shape: [0.5, 0.4]', 'shape: [-0.5, -0.4]', 'shape', 'a box of -0.5 x -0.4 m; give positive sides'),
        ('shape: [0.5, 0.4]', 'shape: [200, 0.4]', 'shape', 'corner (100, 0.2) is more than 50 m from the origin'),
        ('kind: slow', 'kind: slo', 'kind', "zones.mud.kind: 'slo' is none of no_go, slow, sensor_shadow"),
        ('  kitchen:', '  kit chen:', 'kit chen', 'places.kit chen: cannot be a name'),
        ('fault: stuck_wheel', 'fault: stuck', 'fault: stuck', "faults.0.fault: 'stuck' is none of stuck_wheel, local"),
        ('side: left', 'side: front', 'side', "faults.0.parameters.side: 'front' is none of left, right, both"),
        ('entity: alpha', 'entity: gate', '{entity: gate', "'gate' is a door; a robot can have it"),
        ('  cart:', '  person:', 'person: {pose: [8', 'obstacles.person: is there twice'),
        ('to: [6, 2.5]', 'to: [6, 1.5]', 'gate', 'a door of 0 m'),
        (
            'pose: [3, 1, 0], area',
            'pose: [30, 1, 0], area',
            'mud',
            'zones.mud: (30, 1, 0) is outside of the map of 11.1 x',
        ),
        ('dock: {pose: [1', 'dock: {pose: [-0.6', 'dock', 'stations.dock: (-0.6, 1, 0) is outside of the map'),
        ('kitchen: [8', 'kitchen: [80', 'kitchen', 'places.kitchen: (80, 1, 0) is outside of the map'),
    ],
)
def test_what_is_wrong_is_told_with_place_and_remedy(tmp_path: Path, old: str, new: str, at: str, message: str) -> None:
    assert WORLD.count(old) == 1
    text = WORLD.replace(old, new)
    found = problems(tmp_path, text)
    line, column = next(one for one in found if message in one).split(':', 2)[:2]
    assert text.splitlines()[int(line) - 1][int(column) - 1 :].startswith(at), found


ALIASES = """\
plan:
  rooms:
    - {from: [0, 0], to: &corner [6, 4]}
    - {from: [0, 4], to: [6, 8]}
robots:
  alpha: &robot {model: burger, pose: [1, 1, 0], lidar: &lidar {beams: 180}}
  beta:
    <<: *robot
    pose: [1, 2, 0]
  gamma: {model: waffle, pose: [1, 3, 0], lidar: *lidar}
obstacles:
  box: &box {pose: [3, 3, 0.3], shape: [0.5, 0.4]}
  other: {<<: [*box, {kind: cart}], pose: [3, 1, 0]}
"""


def test_parts_that_repeat_are_aliases_and_merged(tmp_path: Path) -> None:
    text = ALIASES.replace(', {kind: cart}]', ']')
    world = load(tmp_path, text)
    same = load(tmp_path, json.dumps(yaml.safe_load(text)))  # JSON is YAML, and has no aliases
    for name in ('alpha', 'beta', 'gamma'):
        assert world.robots[name].pose == same.robots[name].pose
        assert world.robots[name].model == same.robots[name].model
    assert world.robots['beta'].pose == Pose(1.0, 2.0, 0.0)


def test_what_is_wrong_in_a_part_that_is_merged_has_its_place(tmp_path: Path) -> None:
    (found,) = problems(tmp_path, ALIASES)
    line, column, text = found.split(':', 2)
    assert ALIASES.splitlines()[int(line) - 1][int(column) - 1 :].startswith('kind: cart')
    assert 'obstacles.other.kind: there is no such key' in text


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('seed: &a [*a]', 'is in what it stands for'),
        ('seed: *nothing', 'undefined alias'),
        ('places: {<<: 3}', 'expected a mapping'),
        (
            'places: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\nrobots: &b [*a, *a, *a, *a, *a, *a, *a, *a, *a, *a]\n'
            'doors: &c [*b, *b, *b, *b, *b, *b, *b, *b, *b, *b]\nzones: &d [*c, *c, *c, *c, *c, *c, *c, *c, *c, *c]\n'
            'faults: [*d, *d, *d, *d, *d, *d, *d, *d, *d, *d]\n',
            'makes it more than 100000 values',
        ),
    ],
)
def test_aliases_that_cannot_be_are_refused(tmp_path: Path, text: str, words: str) -> None:
    assert any(words in one for one in problems(tmp_path, text))


def keys(node: yaml.Node | None, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], yaml.ScalarNode]]:
    """Yield all keys of a document with their paths, except the names that entities, models and places are given."""
    if isinstance(node, yaml.MappingNode):
        for one, value in node.value:
            if len(path) != 1 or path[0] == 'plan':
                yield (*path, one.value), one
            yield from keys(value, (*path, one.value))
    elif isinstance(node, yaml.SequenceNode):
        for number, value in enumerate(node.value):
            yield from keys(value, (*path, str(number)))


def test_a_typing_error_in_any_key_is_told_with_its_place_and_the_key_that_is_meant(tmp_path: Path) -> None:
    document = list(keys(yaml.compose(WORLD)))
    assert len(document) > 50
    for path, node in document:
        wrong = node.value[:-1] + 'x' + node.value[-1]
        begin, end = node.start_mark, node.end_mark
        found = problems(tmp_path, WORLD[: begin.index] + wrong + WORLD[end.index :])
        where = f'{begin.line + 1}:{begin.column + 1}: {".".join([*path[:-1], wrong])}: there is no such key'
        assert f"{where}; did you mean '{node.value}'?" in found


def parts(node: yaml.Node | None) -> Iterator[tuple[int, int]]:
    """From where to where each part of a document is: its keys, values, lists and mappings."""
    if node is not None:
        yield node.start_mark.index, node.end_mark.index
    if isinstance(node, yaml.MappingNode | yaml.SequenceNode):
        for child in node.value:
            for one in child if isinstance(child, tuple) else (child,):
                yield from parts(one)


PARTS = list(parts(yaml.compose(WORLD)))[1:]
WORDS = r"""
null ~ true -1 0 1e-9 1e308 1e999 .nan -.inf 123456789012345678901234567890 0x10 1_000 x 2026-01-01
"\e[31m" "\ud800" [] {} [1] [[]] [.nan,0,0] [1,1,1e300] [1,2,3,4] [[0,0],[1,1],[2,2]] {x:1} {pose:1} {<<:{x:1}}
!!python/object:os.system [*a] *a ? - [ } ' " % @ : # | > !!binary
"""
TEXTS = ('', '&a [*a]', '{x: 1}', '{<<: {x: 1}}', '!!timestamp x', '\t', '\0', '[' * 3000, '{a: ' * 3000)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.sampled_from(PARTS), st.sampled_from([*WORDS.split(), *TEXTS])), min_size=1, max_size=3))
def test_whatever_is_written_is_a_world_or_is_told_with_its_line(
    tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[tuple[int, int], str]]
) -> None:
    text = WORLD
    for (begin, end), wrong in sorted(changes, reverse=True):
        text = text[:begin] + wrong + text[end:]
    file = tmp_path_factory.mktemp('wrong') / 'world.yaml'
    file.write_text(text)
    try:
        World.load(file).step()
    except WorldError as error:
        for one in error.problems:
            place, message = one.removeprefix(f'{file}:').split(': ', 1)
            line, column = map(int, place.split(':'))
            assert 1 <= line <= text.count('\n') + 2
            assert column >= 1
            assert message.isprintable()
            assert len(message) < 2000


def test_a_file_that_is_too_long_or_no_text_is_told(tmp_path: Path) -> None:
    file = tmp_path / 'world.yaml'
    for content, said in ((b'#' * 10_000_000, 'longer than 2000000 bytes'), (b'seed: \xff\xfe', 'UTF-8')):
        file.write_bytes(content)
        with pytest.raises(WorldError) as caught:
            World.load(file)
        (problem,) = caught.value.problems
        assert problem.startswith(f'{file}: cannot be read: ')
        assert said in problem


def test_what_is_based_on_a_wrong_model_is_not_wrong_for_that(tmp_path: Path) -> None:
    assert len(problems(tmp_path, WORLD.replace('slip: 0.05', 'slip: much'))) == 1


def test_all_that_is_wrong_is_told_at_once(tmp_path: Path) -> None:
    text = WORLD.replace('beams: 180', 'beams: 0').replace('kind: slow', 'kind: slo').replace('seed: 3', 'seed: -1')
    assert len(problems(tmp_path, text)) == 3


@pytest.mark.parametrize(
    'text', ['- 1', '3', 'robots: [1]', 'robots: {a: 1}', 'faults: 7', 'plan: 3', 'a: {', 'map: 3']
)
def test_what_is_no_world_is_told(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text)


def test_an_empty_file_is_an_empty_world(tmp_path: Path) -> None:
    world = load(tmp_path, '')
    world.step(1.0)
    assert (world.time, dict(world.entities)) == (1.0, {})


def test_a_map_is_found_beside_the_file(tmp_path: Path) -> None:
    assert 'cannot be read' in problems(tmp_path, 'map: nowhere.yaml')[0]


END = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))


@settings(deadline=None, max_examples=30)
@given(END, END, st.sampled_from([0.03, 0.2, 1.0]))
def test_a_wall_has_its_thickness_in_any_direction_and_is_longer_by_half_of_it_at_both_ends(
    start: tuple[float, float], end: tuple[float, float], thickness: float
) -> None:
    grid = FloorPlan(walls=((start, end),), thickness=thickness, resolution=0.05).drawn()
    rows, columns = numpy.mgrid[: grid.height, : grid.width]
    x, y = grid.origin.x + (columns + 0.5) * 0.05, grid.origin.y + (rows + 0.5) * 0.05
    way = complex(*end) - complex(*start)
    seen = (x + 1j * y - complex(*start)) * (way.conjugate() / abs(way) if way else 1.0)  # from its start, along it
    away = numpy.maximum(numpy.abs(seen.imag), numpy.maximum(-seen.real, seen.real - abs(way)))
    half = max(thickness, 0.05) / 2.0
    clear = numpy.abs(away - half) > 1e-6  # not on its edge
    assert numpy.array_equal(grid.obstacles[clear], (away <= half)[clear])


@settings(deadline=None, max_examples=30)
@given(st.lists(END, min_size=3, max_size=3), st.sampled_from([0.01, 0.05]))
def test_a_wall_has_no_holes_however_thin_it_is(corners: list[tuple[float, float]], thickness: float) -> None:
    """Else robots would see and drive through it."""
    grid = FloorPlan(walls=((*corners, corners[0]),), thickness=thickness, resolution=0.05).drawn()
    (a, b), (c, d), (e, f) = corners
    longest = max(map(math.dist, corners, [*corners[1:], corners[0]]))
    assume(abs((c - a) * (f - b) - (e - a) * (d - b)) > longest)  # 1 m across
    middle = grid.cell((a + c + e) / 3.0, (b + d + f) / 3.0)
    regions, _ = scipy.ndimage.label(~grid.obstacles)
    assert 0 != regions[middle] != regions[0, 0] != 0


def test_a_map_is_read_only_for_who_wants_it(tmp_path: Path) -> None:
    text = 'map: nowhere.yaml\nrobots: {alpha: {pose: [1, 1, 0]}}'
    assert [name for _, name, *_ in WorldFile(tmp_path / 'world.yaml', text).entities] == ['alpha']
    assert 'nowhere.yaml' in problems(tmp_path, text)[0]
