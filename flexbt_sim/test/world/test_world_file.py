# SPDX-License-Identifier: BSD-3-Clause
"""World files: what they say is in the world, and what is wrong with them is told with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexbt_sim.errors import WorldError
from flexbt_sim.world import Circle, Pose, World

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
    """What is wrong with a file, without its name."""
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
        ('slip: 0.05', 'slip: much', 'slip', "models.courier.drive.slip: expected a number, got 'much'"),
        ('pose: [1, 2, 0]', 'pose: [1, 2]', 'pose: [1, 2]', 'robots.beta.pose: expected a list of 3 numbers'),
        ('pose: [1, 2, 0], ', '', 'beta', "robots.beta: 'pose' is missing"),
        ('pose: [1, 2, 0]', 'pose: [0, 2, 0]', 'beta', 'from an obstacle'),
        ('pose: [1, 2, 0]', 'pose: [1, 1.1, 0]', 'beta', "would overlap 'alpha'"),
        ('shape: [0.5, 0.4]', 'shape: [[0, 0], [1, 1], [1, 0], [0, 1]]', 'shape', 'sides that cross'),
        ('kind: slow', 'kind: slo', 'kind', "zones.mud.kind: 'slo' is none of no_go, slow, sensor_shadow"),
        ('  kitchen:', '  kit chen:', 'kit chen', 'places.kit chen: cannot be a name'),
        ('fault: stuck_wheel', 'fault: stuck', 'fault: stuck', "faults.0.fault: 'stuck' is none of stuck_wheel, local"),
        ('side: left', 'side: front', 'side', "faults.0.parameters.side: 'front' is none of left, right, both"),
        ('entity: alpha', 'entity: gate', '{entity: gate', "'gate' is a door; a robot can have it"),
        ('  cart:', '  person:', 'person: {pose: [8', 'obstacles.person: is there twice'),
        ('to: [6, 2.5]', 'to: [6, 1.5]', 'gate', 'a door of 0 m'),
    ],
)
def test_what_is_wrong_is_told_with_place_and_remedy(tmp_path: Path, old: str, new: str, at: str, message: str) -> None:
    assert WORLD.count(old) == 1
    text = WORLD.replace(old, new)
    found = problems(tmp_path, text)
    line, column = next(one for one in found if message in one).split(':', 2)[:2]
    assert text.splitlines()[int(line) - 1][int(column) - 1 :].startswith(at), found


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
