# SPDX-License-Identifier: BSD-3-Clause
"""The building of the night watch, its processes, and its picture."""

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flexbt_demo_behaviors.demonstration.process_group import ProcessGroup
from flexbt_demo_behaviors.demonstration.report import RobotTrack, draw_tracks, world_with_places
from flexbt_demo_behaviors.night_watch.watch import PLACES, ROBOTS, ROUNDS, WORLD, run_interactive, watch_processes
from flexbt_sim.world import Pose


def test_the_robots_stand_in_their_docks_and_every_place_is_free() -> None:
    world = world_with_places(WORLD, PLACES)
    places = world.places
    for name, robot in world.robots.items():
        home = places[ROUNDS[name]['home']]
        assert math.hypot(robot.pose.x - home.x, robot.pose.y - home.y) < 0.1
        assert world.stations[ROUNDS[name]['home']].pose == robot.pose
    world.remove('beta')
    for place in places.values():
        for obstacle in world.obstacles.values():
            assert math.hypot(obstacle.pose.x - place.x, obstacle.pose.y - place.y) > 1.0
        world.move('alpha', place)  # refused in a wall


def test_a_room_with_a_door_has_the_place_from_which_it_is_opened() -> None:
    world = world_with_places(WORLD, PLACES)
    places = world.places
    assert world.doors.keys() == {name for name in places if name.endswith('_door')}


def test_the_processes_of_a_robot_are_installed_and_in_its_namespace() -> None:
    simulator, *others = watch_processes(speed=10.0)
    assert Path(simulator.command()[0]).is_file()
    assert not simulator.namespace
    assert {process.namespace for process in others} == set(ROBOTS)
    for process in others:
        words = process.command()
        assert Path(words[0]).is_file()
        assert words[2:4] == ['-r', f'__ns:=/{process.namespace}']


def test_the_picture_shows_where_each_robot_has_driven() -> None:
    empty = draw_tracks(world_with_places(WORLD, PLACES), {name: RobotTrack() for name in ROBOTS})
    tracks = {name: RobotTrack() for name in ROBOTS}
    for step in range(100):
        tracks['alpha'].add_pose(Pose(1.0 + 0.05 * step, 4.6, 0.0), 0.1 * step)
    driven = draw_tracks(world_with_places(WORLD, PLACES), tracks)
    assert driven.size == empty.size
    assert driven.tobytes() != empty.tobytes()


def test_a_line_that_is_no_text_is_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('flexbt_demo_behaviors.night_watch.watch.serve_page', lambda _group: '')
    lines = [b'f\xc3', b'end']
    watch: Any = SimpleNamespace(start=lambda: None, group=ProcessGroup(tmp_path))
    run_interactive(watch, lambda _prompt: lines.pop(0).decode())
    assert lines == [] and "'?': expected alpha, beta" in capsys.readouterr().out
