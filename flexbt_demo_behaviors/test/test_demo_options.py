# SPDX-License-Identifier: BSD-3-Clause
"""The command line of the demonstration."""

from pathlib import Path

import pytest

from flexbt_demo_behaviors.demonstration.running import parse_options


def test_without_a_terminal_the_script_runs_both_demonstrations_fast() -> None:
    options = parse_options([], {}, terminal=False)
    assert (options.interactive, options.demos, options.speed) == (False, (1, 2), 10.0)


def test_in_a_terminal_a_person_gets_the_first_demonstration_in_real_time() -> None:
    options = parse_options([], {}, terminal=True)
    assert (options.interactive, options.demos, options.speed) == (True, (1,), 1.0)
    assert not parse_options(['--script'], {}, terminal=True).interactive


def test_the_environment_chooses_and_the_command_line_has_the_last_word() -> None:
    environment = {'DEMO': '2', 'SPEED': '3.5', 'OUTPUT': '/elsewhere'}
    assert parse_options([], environment, terminal=False).demos == (2,)
    assert parse_options([], environment, terminal=False).speed == 3.5
    assert parse_options(['--demo', '1', '--speed', '2'], environment, terminal=False).demos == (1,)
    assert parse_options([], environment, terminal=False).output == Path('/elsewhere')
    nothing = parse_options([], {'DEMO': '', 'SPEED': '', 'OUTPUT': ''}, terminal=False)
    assert (nothing.demos, nothing.output) == ((1, 2), Path('out'))


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--demo', '3'], 'demonstrations 1 and 2'),
        (['--speed', 'fast'], 'number above 0'),
        (['--speed', '-1'], 'number above 0'),
        (['--speed', 'nan'], 'number above 0'),
        (['--speed', '0'], 'number above 0'),
        (['--places', '/nowhere.yaml'], 'no such file'),
        (['--map', '/nowhere.yaml'], '--places'),
    ],
)
def test_what_cannot_work_is_refused_with_a_reason(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as error:
        parse_options(arguments, {}, terminal=False)
    assert error.value.code == 2
    assert said in capsys.readouterr().err


def test_files_are_made_absolute_as_the_processes_may_run_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'map.yaml').touch()
    (tmp_path / 'places.yaml').touch()
    monkeypatch.chdir(tmp_path)
    options = parse_options(['--map', 'map.yaml', '--places', 'places.yaml'], {}, terminal=False)
    assert options.map == str(tmp_path / 'map.yaml')
    assert options.places == str(tmp_path / 'places.yaml')
