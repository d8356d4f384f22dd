# SPDX-License-Identifier: BSD-3-Clause
"""The process table: every executable is installed, and parameters arrive as what they are."""

import sys
from pathlib import Path

import pytest
import yaml

from flexbt_console.errors import UsageError
from flexbt_demo_behaviors.demonstration.demo_processes import (
    DemoSettings,
    Process,
    built_in_places,
    console_command,
    demo_processes,
    first_place,
    page_command,
)
from flexbt_testing.launch_files import nodes_of


def parameters(command: list[str]) -> dict[str, object]:
    assert command[1] == '--ros-args'
    pairs = [word.partition(':=') for word in command[3::2]]
    return {name: yaml.safe_load(text) for name, _, text in pairs}


def test_every_process_is_installed_and_follows_the_clock_of_the_simulator() -> None:
    processes = demo_processes(DemoSettings(speed=10.0))
    followers = {'navigation', 'bt_server', 'onboard_executive'}  # the stop guard needs no time but the wall's
    assert {process.name for process in processes} == {'simulator', 'stop_guard', *followers}
    for process in processes:
        assert Path(process.command()[0]).is_file()
        assert parameters(process.command()).get('use_sim_time', False) == (process.name in followers)


@pytest.mark.parametrize('value', [True, False, 3, -2.5, "it's", 'true', '5', '', 'a: b', (1.0, -2.0, 0.5)])
def test_parameters_keep_value_and_type(value: bool | int | float | str | tuple[float, ...]) -> None:
    text = parameters(Process('flexbt_sim', 'simulator', {'some': value}).command())['some']
    expected = list(value) if isinstance(value, tuple) else value
    assert (text, type(text)) == (expected, type(expected))


def test_a_map_of_ones_own_has_the_robot_start_at_its_first_place(tmp_path: Path) -> None:
    places = tmp_path / 'places.yaml'
    places.write_text('door: {x: 1.0, y: 2.0, yaw: 0.5}\nwindow: {x: 3.0, y: 0.0}\n')
    settings = DemoSettings(map='/maps/mine.yaml', start=first_place(str(places)), places=str(places))
    simulator = parameters(demo_processes(settings)[0].command())
    assert simulator['map'] == '/maps/mine.yaml'
    assert simulator['initial_pose'] == [1.0, 2.0, 0.5]
    assert parameters(demo_processes(settings)[-1].command())['places'] == str(places)


def test_a_launched_robot_starts_on_a_map_as_one_of_the_demonstration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, 'flexbt_demo_behaviors.demonstration.launching', raising=False)
    nodes = nodes_of(Path(__file__).parents[1] / 'launch' / 'demo.launch.py', monkeypatch)
    monkeypatch.delitem(sys.modules, 'flexbt_demo_behaviors.demonstration.launching')
    places = tmp_path / 'places.yaml'
    places.write_text('door: {x: 1.0, y: 2.0, yaw: 0.5}\n')
    for map, named, start in (('mine.yaml', str(places), (1.0, 2.0, 0.5)), ('mine.yaml', '', None), ('', '', None)):
        simulator = nodes({'map': map, 'places': named, 'speed': '2.0', 'autostart': 'true'})[0]
        assert simulator['parameters'][0].get('initial_pose') == start


def test_leaving_the_console_is_told_to_end_the_demonstration() -> None:
    file, *words = console_command()
    assert Path(file).is_file()
    assert words[:3] == ['screen', '--leaving', 'the demonstration ends']
    folder = str(Path(__file__).parents[1] / 'flexbt_demo_behaviors')
    assert page_command(8465)[1:6] == ['web', '--port', '8465', '--studio', folder]


def test_a_places_file_without_places_is_refused(tmp_path: Path) -> None:
    places = tmp_path / 'places.yaml'
    places.write_text('')
    with pytest.raises(UsageError, match='no place'):
        first_place(str(places))


def test_the_places_of_the_map_that_comes_along_are_there() -> None:
    assert len(first_place(built_in_places())) == 3


def test_an_executable_that_is_missing_is_named() -> None:
    with pytest.raises(FileNotFoundError, match=r'flexbt_sim has no executable teleport'):
        Process('flexbt_sim', 'teleport').command()
