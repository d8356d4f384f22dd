# SPDX-License-Identifier: BSD-3-Clause
"""`make demo` as a user without a terminal has it: real processes, the scripted operator, an exit code to rely on.

Demonstration 1 is complete on real processes, and 3 and 5 begin and end there. All are complete in one process.
"""

import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import pytest
from ament_index_python.packages import get_package_prefix
from PIL import Image

from flexbt_common.command_line import restored_signals
from flexbt_demo_behaviors.demonstration import process_group
from flexbt_demo_behaviors.goals import main as goals
from flexbt_demo_behaviors.nav2_robot import main as nav2_robot
from flexbt_demo_behaviors.navigate import main as navigate
from flexbt_demo_behaviors.night_watch import watch
from flexbt_testing.system import processes
from flexbt_testing.waiting import uncontended_time

MARK = 'FLEXBT_TEST_MARK'
SETTINGS = ('DEMO', 'SPEED')
"""Variables of the environment that stand for options."""
DEMO_SECONDS = 60.0  # of uncontended time, for each demonstration at speed factor 10
END_SECONDS = 2.0

DEMO = 'flexbt_demo_behaviors/demo'
NIGHT_WATCH = 'flexbt_demo_behaviors/night_watch'
GOALS = 'flexbt_demo_behaviors/goals'


@pytest.fixture
def mark() -> Iterator[str]:
    """Yield a word in the environment of everything that a test starts; whatever still runs afterwards is ended."""
    word = uuid.uuid4().hex
    yield word
    for pid in marked(word):
        os.kill(pid, signal.SIGKILL)


def marked(word: str) -> dict[int, str]:
    """Return the running processes with that word in their environment, with their command lines."""
    found = {}
    for directory in Path('/proc').glob('[0-9]*'):
        try:
            if f'{MARK}={word}'.encode() in (directory / 'environ').read_bytes():
                found[int(directory.name)] = (directory / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
        except OSError:
            continue  # it has ended, or is somebody else's
    return found


def start(mark: str, output: Path, *arguments: str, program: str = DEMO) -> subprocess.Popen[str]:
    environment = {key: value for key, value in os.environ.items() if key not in ('ROS_DOMAIN_ID', *SETTINGS)}
    package, _, executable = program.partition('/')
    file = Path(get_package_prefix(package)) / 'lib' / package / executable
    return subprocess.Popen(
        [str(file), '--output', str(output), *arguments],
        env=environment | {MARK: mark},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def ending(returncode: int | None, output: str) -> str:
    """Return what a demonstration told, for a failure: what came of it first, since a report may show a few lines
    only."""
    lines = output.splitlines()
    problems = [line.strip() for line in lines if line.strip().startswith('problem ')]
    missed = [line.strip() for line in lines if 'NOT TAKEN' in line]
    first = '; '.join([f'exit code {returncode}', *problems, *missed])
    return '\n'.join([first, *lines[-10:], '', 'from its beginning:', *lines])


def wait_for_line(process: subprocess.Popen[str], text: str) -> list[str]:
    """Read what the demonstration prints up to the line with this text."""
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if text in line:
            return lines
    raise AssertionError(f'the demonstration ended without {text!r}; {ending(process.wait(), "".join(lines))}')


def check(numbers: list[int], returncode: int, output: str, pictures: Path) -> None:
    """Check that demonstrations have reached their goals and taken every branch."""
    told = ending(returncode, output)
    assert returncode == 0, told
    assert 'NOT TAKEN' not in output, told
    for number in numbers:
        assert f'Demonstration {number}' in output, told
        file = pictures / f'demo{number}.png'
        assert str(file) in output, told
        with Image.open(file) as image:
            assert image.format == 'PNG'


def test_a_demonstration_reaches_its_goals_and_takes_every_branch(mark: str, tmp_path: Path) -> None:
    before = uncontended_time()
    process = start(mark, tmp_path, '--demo', '1')
    output, _ = process.communicate(timeout=900)
    taken = uncontended_time() - before
    check([1], process.returncode, output, tmp_path)
    assert taken < DEMO_SECONDS, f'{taken:.1f} s: {ending(process.returncode, output)}'
    assert marked(mark) == {}


@pytest.mark.one_process
@pytest.mark.parametrize(
    ('numbers', 'program', 'seconds'),
    [
        ([1, 2], navigate, 2 * DEMO_SECONDS),
        ([3], watch, 3 * DEMO_SECONDS),  # twice as many processes
        ([4], nav2_robot, 2 * DEMO_SECONDS),  # partly in real time
        ([5], goals, DEMO_SECONDS),
    ],
)
def test_further_demonstrations_reach_their_goals_and_take_every_branch(
    numbers: list[int],
    program: ModuleType,
    seconds: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def start(words: list[str], log: int, environment: Mapping[str, str] | None) -> object:
        return processes._start(words, log, environment, None, None)

    monkeypatch.setenv('OMP_NUM_THREADS', '1')  # which it would set
    for name in SETTINGS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, 'argv', ['demo', '--script', '--output', str(tmp_path)])
    monkeypatch.setattr(process_group, '_start', start)
    monkeypatch.setattr(process_group, '_signal', lambda process, number: process.send_signal(number))
    before = uncontended_time()
    with restored_signals(signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        exit_code = program.main()
    taken, output = uncontended_time() - before, capsys.readouterr().out
    check(numbers, exit_code, output, tmp_path)
    assert taken < seconds, f'{taken:.1f} s, more than {seconds:g} s: {ending(exit_code, output)}'


def test_a_signal_ends_every_process_and_is_no_success(mark: str, tmp_path: Path) -> None:
    process = start(mark, tmp_path, program=NIGHT_WATCH)
    wait_for_line(process, '/Watch/Round/')
    assert len(marked(mark)) == 10
    sent = uncontended_time()
    process.send_signal(signal.SIGTERM)
    output, _ = process.communicate(timeout=60)
    taken = uncontended_time() - sent
    assert taken < END_SECONDS
    assert process.returncode == 128 + signal.SIGTERM, ending(process.returncode, output)
    assert marked(mark) == {}
    logs = ''.join(log.read_text() for log in (tmp_path / 'logs').iterdir())
    before, _, fault = (output + logs).partition('Traceback')
    assert not fault, f'{before[-500:]}Traceback{fault[:4000]}'


def test_a_process_that_dies_fails_the_demonstration_and_is_named(mark: str, tmp_path: Path) -> None:
    process = start(mark, tmp_path, program=GOALS)
    wait_for_line(process, 'state     /')
    (victim,) = (pid for pid, command in marked(mark).items() if 'lib/flexbt_navigation/simulation' in command)
    os.kill(victim, signal.SIGKILL)
    output, _ = process.communicate(timeout=60)
    told = ending(process.returncode, output)
    assert process.returncode == 1, told
    assert 'process simulation ended with signal 9' in output, told
    assert '[navigation]: ready' in output, told  # its last lines
    assert marked(mark) == {}
