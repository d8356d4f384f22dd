# SPDX-License-Identifier: BSD-3-Clause
"""The line mode as scripts use it: processes, their output, their exit codes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest

from flexbt_common import discovery
from flexbt_common.command_line import restored_signals
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import parse
from flexbt_console.errors import ExitCode, NoLinkError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    CommandResult,
    ExecutiveSnapshot,
    ExecutiveState,
    OperatorCommand,
    ResultCode,
)
from flexbt_console.ui.console import _mirror_maker, main, operator_name
from flexbt_console.ui.line.line_mode import LineMode
from flexbt_console.ui.station import Attention, Station
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.nodes.scripted_executive import Faults, ScriptedExecutive
from flexbt_testing.system.python_processes import COMMAND, run_console
from flexbt_testing.system.python_processes import start_console as start
from flexbt_testing.waiting import DEADLINE, wait_until

NAMESPACE = 'lines'


def console(*words: str, namespace: str = NAMESPACE, timeout: str = '15') -> subprocess.CompletedProcess[str]:
    return run_console(*words, '--namespace', namespace, '--operator', 'ann', '--timeout', timeout)


def test_an_output_that_does_not_fit_onto_its_disk_is_told(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with open('/dev/full', 'w') as full:  # noqa: PTH123
        monkeypatch.setattr(sys, 'stdout', full)
        assert main(['--help']) == ExitCode.FAULT
    assert capfd.readouterr().err == 'console: the output is not whole: No space left on device\n'


def test_consoles_of_the_same_person_have_names_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def names_at(terminal: str | None, *lines: str) -> list[str]:
        def ttyname(_descriptor: int) -> str:
            if terminal is None:
                raise OSError
            return terminal

        monkeypatch.setattr(os, 'ttyname', ttyname)
        return [operator_name(parse(line.split())) for line in lines]

    monkeypatch.delenv('FLEXBT_OPERATOR', raising=False)
    (script,) = names_at(None, 'start Drive')
    assert '@' in script
    # What is typed in a terminal one after the other is of one operator.
    assert names_at('/dev/pts/3', 'screen', 'claim', 'start Drive') == [f'{script}/pts3'] * 3
    assert names_at('/dev/pts/12', 'screen') == [f'{script}/pts12']
    assert names_at('/dev/pts/3', 'web', 'web --port 8466') == [f'{script}/page', f'{script}/page8466']
    assert names_at('/dev/pts/3', 'web --operator ann', 'screen --operator bob') == ['ann', 'bob']


def test_what_lost_its_lock_to_a_signal_was_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(line: Any) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            raise RuntimeError('cannot release un-acquired lock')

    monkeypatch.setattr('flexbt_console.ui.console._run', run)
    with restored_signals():
        assert (main(['watch']), main(['status'])) == (ExitCode.OK, ExitCode.INTERRUPTED)


def test_a_file_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / ('x' * 300)
    with restored_signals():
        assert main(['users', str(file)]) == main(['users', str(file), '--add', 'ann']) == ExitCode.USAGE
    told = f'users: {file}: cannot be used: File name too long\n'
    assert capsys.readouterr().err == 2 * told


@pytest.fixture
def executive(executives: Any) -> ScriptedExecutive:
    started = executives(NAMESPACE)
    assert isinstance(started, ScriptedExecutive)
    return started


def test_a_whole_mission_by_script(executive: ScriptedExecutive, tmp_path: Path) -> None:
    places = tmp_path / 'places.yaml'
    places.write_text('kitchen: {x: 1.0, y: 2.0, yaw: 0.5}\n')
    listed = console('behaviors')
    assert listed.returncode == 0 and 'Drive' in listed.stdout and 'no such tree' in listed.stdout
    # Whoever waits for the end is told how it ended, while others command.
    waiting: list[subprocess.CompletedProcess[str]] = []
    waiter = threading.Thread(
        target=lambda: waiting.append(
            console('start', 'Drive', '--autonomy', 'low', '--wait', '--wait-timeout', '60', '--json')
        )
    )
    waiter.start()
    executive_running(executive)
    status = json.loads(console('status', '--json').stdout)
    assert (status['link'], status['state'], status['autonomy']) == ('live', 'running', 1)
    assert status['age'] < DEADLINE and status['decisions'][0]['input_type'] == 'geometry_msgs/msg/PoseStamped'
    assert console('input', 'kitchen', '--places', str(places)).returncode == 0
    assert executive.values[-1].pose.position.y == 2.0
    confirmed = json.loads(console('confirm', '--json', '--reason', 'looks good').stdout)
    assert (confirmed['command'], confirmed['result'], confirmed['exit_code']) == ('confirm', 'applied', 0)
    assert (executive.applied[-1].operator_id, executive.applied[-1].reason) == ('ann', 'looks good')
    assert console('force', 'done').returncode == 0
    waiter.join(60)
    assert waiting[0].returncode == 0, waiting[0]
    assert json.loads(waiting[0].stdout)['outcome'] == 'finished'


def executive_running(executive: ScriptedExecutive) -> None:
    """Wait until the scripted executive runs something."""
    wait_until(lambda: executive.do(lambda: executive.status.run_id), 'a run')


def test_exit_code_0_and_3_and_what_is_said(executive: ScriptedExecutive) -> None:
    refused = console('stop')
    assert refused.returncode == 3 and 'nothing runs' in refused.stdout
    local = console('start', 'Dive', '--json')
    assert local.returncode == 3
    assert json.loads(local.stdout) == {
        'command': 'start', 'result': 'refused', 'exit_code': 3,
        'reason': "there is no behavior 'Dive'; did you mean 'Drive'?",
    }  # fmt: skip
    assert console('autonomy', 'full').returncode == 0
    assert executive.status.autonomy == 3


def test_a_reason_of_several_lines_is_shown_as_such_and_harmless(
    executive: ScriptedExecutive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executive, '_apply', lambda _: 'it is wrong:\n- here\n- there\x1b[2J')
    assert console('stop').stdout == 'stop: refused: it is wrong:\n    - here\n    - there\\e[2J\n'


def test_exit_code_3_when_a_run_that_is_waited_for_is_stopped(executive: ScriptedExecutive) -> None:
    with start('start', 'Drive', '--wait', '--namespace', NAMESPACE, '--timeout', '15') as waiting:
        executive_running(executive)
        assert console('stop').returncode == 0
        output, _ = waiting.communicate(timeout=60)
    assert waiting.returncode == 3 and 'preempted' in output


class Scripted(RobotLink):
    """A link to a robot that applies a command, and of which then one thing after the other is seen."""

    then: tuple[Callable[[], object], ...] = ()

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self._snapshot = ExecutiveSnapshot('e', 0, state=ExecutiveState.RUNNING, run_id='r')
        self.says()

    def says(self, **parts: Any) -> None:
        self._snapshot = replace(self._snapshot, sequence=self._snapshot.sequence + 1, **parts)
        self._mirror.receive_snapshot(self._snapshot)

    def send(self, command: OperatorCommand, timeout: float, label: str) -> None:
        self._mirror.give(command, timeout)
        self.says(results=(CommandResult(command.id, ResultCode.APPLIED),))

    def settled(self, command_id: str, timeout: float) -> object:
        return self._mirror.command(command_id)

    def wait_for(self, inspect: Callable[[Any], Any], timeout: float | None, every: float) -> Any:
        for then in self.then:
            then()
            if found := inspect(self._mirror.view()):
                return found
        raise AssertionError('it waits on')


def test_who_waits_for_the_end_of_a_run_may_stand_still_meanwhile() -> None:
    """As a computer that sleeps, or a process that is suspended: the link is not lost for that."""
    clock = ManualClock()
    mirror = Mirror(clock)
    link = Scripted(mirror)
    station = Station(mirror, link, CommandBuilder('ann'), 5.0, Attention(clock), '')

    def ends(*then: Callable[[], object]) -> ExitCode:
        link.then = then
        return LineMode(parse(['stop', '--wait']), station, cast('Any', link), clock).run()

    stood_still = partial(clock.advance, 60.0)
    assert ends(stood_still, link.says, stood_still, lambda: link.says(state=ExecutiveState.IDLE)) == ExitCode.OK
    link.says(state=ExecutiveState.RUNNING)
    with pytest.raises(NoLinkError, match='was lost 66'):
        ends(stood_still, partial(clock.advance, 1.0), partial(clock.advance, 5.0))


def test_exit_code_2_needs_no_executive() -> None:
    for words in (['statsu'], ['start'], ['autonomy', '7'], []):
        done = subprocess.run(
            [sys.executable, *COMMAND, *words],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=60,
            check=False,
        )
        assert done.returncode == 2, done
        assert done.stdout == '' and done.stderr


def test_exit_code_4_when_nobody_answers(executives: Any) -> None:
    executives('deaf', faults=Faults(swallow_commands=True))
    done = console('autonomy', '1', namespace='deaf', timeout='2')
    assert done.returncode == 4 and 'may have been applied' in done.stdout


def test_exit_code_5_without_an_executive() -> None:
    done = console('status', '--json', namespace='nobody', timeout='0.5')
    assert done.returncode == 5 and done.stderr == ''
    assert json.loads(done.stdout)['result'] == 'no_link'


@pytest.mark.parametrize(
    ('words', 'wanted'),
    [
        (['status', '--json'], 'an executive (none was heard yet)'),
        (['robots'], 'the status of /nobody'),
        (['stop'], 'the answer of the executive or the stop guard'),
    ],
)
def test_what_takes_long_is_said_beside_the_answer(executives: Any, words: list[str], wanted: str) -> None:
    namespace = 'nobody'
    if words == ['stop']:
        namespace = 'dumb'
        executives(namespace, faults=Faults(swallow_commands=True))
    done = console(*words, namespace=namespace, timeout='1.2')
    assert done.returncode in (ExitCode.NO_LINK, ExitCode.TIMEOUT)
    assert f'waiting for {wanted}, 1.2 s at most ...' in done.stderr.splitlines()
    assert 'waiting' not in done.stdout


@pytest.mark.parametrize(('words', 'state'), [([], LinkState.LOST), (['--lost-after', '10000'], LinkState.STALE)])
def test_the_age_at_which_a_link_is_lost_is_an_option(words: list[str], state: LinkState) -> None:
    with NodeRuntime.open('console') as runtime:
        mirror = _mirror_maker(parse(['status', *words]), runtime)()
        mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(sent=0.0, received=5000.0))
        assert mirror.view().link is state


def test_what_the_middleware_prints_is_no_part_of_an_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fast DDS writes its errors to standard output: here, that it does not know an element of its profile."""
    profile = tmp_path / 'profile.xml'
    profile.write_text('<dds><profiles><participant profile_name="x"><unknown/></participant></profiles></dds>')
    monkeypatch.setenv(discovery.PROFILE, str(profile))
    done = console('status', '--json', namespace='nobody', timeout='0.5')
    assert json.loads(done.stdout)['exit_code'] == done.returncode == ExitCode.NO_LINK
    assert 'Error' in done.stderr or os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp') != 'rmw_fastrtps_cpp'


def test_watch_prints_json_lines_and_ends_cleanly(executive: ScriptedExecutive) -> None:
    with start('watch', '--json', '--namespace', NAMESPACE) as watching:
        assert watching.stdout is not None and watching.stderr is not None
        deadline = threading.Timer(DEADLINE, watching.kill)
        deadline.start()
        first = json.loads(watching.stdout.readline())
        # An executive is there, so no earlier link is told; on a busy machine its heartbeat may be late.
        assert first['event'] == 'link'
        assert first['link'] in ('live', 'stale')
        hostile = '\x1b]0;title\x07two\nlines'
        executive.do(lambda: executive.log(hostile))
        for line in watching.stdout:
            assert line.isascii()
            event = json.loads(line)
            if event['event'] == 'log':
                break
        assert event['line']['text'] == hostile
        watching.send_signal(signal.SIGINT)
        assert watching.wait(timeout=60) == 0
        assert watching.stderr.read() == ''
        deadline.cancel()


def test_watch_tells_people_what_is_latched_in_its_order(executive: ScriptedExecutive) -> None:
    executive.do(lambda: executive.log('behavior started'))
    told = console('watch', timeout='6').stdout
    assert told.index('log: behavior started') < told.index('behavior: IDLE'), told


def test_watch_survives_that_nobody_reads(executive: ScriptedExecutive) -> None:
    with start('watch', '--namespace', NAMESPACE) as watching:
        assert watching.stdout is not None and watching.stderr is not None
        watching.stdout.readline()
        watching.stdout.close()
        for number in range(400):
            executive.do(lambda n=number: executive.log(f'line {n}'))  # type: ignore[misc]
            if watching.poll() is not None:
                break
            threading.Event().wait(0.05)
        assert watching.returncode == 0
        assert watching.stderr.read() == ''


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_interrupted_does_not_say_applied(executives: Any, number: signal.Signals) -> None:
    executive = executives(f'wait{number}', faults=Faults(swallow_commands=True))
    with start('stop', '--namespace', f'wait{number}', '--timeout', '60') as waiting:
        assert waiting.stderr is not None
        wait_until(lambda: executive.do(lambda: len(executive.received)), 'the command')
        waiting.send_signal(number)
        assert waiting.wait(timeout=60) == 130
        told = waiting.stderr.read().splitlines()
        assert all(line.startswith('waiting for ') for line in told), told


def test_a_signal_while_ros_is_joined_ends_the_command_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    class Opening:
        is_closed = False

        def __init__(self, *words: Any, **options: Any) -> None:
            sender = threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT))
            sender.start()
            sender.join()
            threading.Event().wait(0)  # where the interpreter looks for signals

        def close(self) -> None:
            Opening.is_closed = True

    monkeypatch.setattr('flexbt_common.runtime.node_runtime.NodeRuntime', Opening)
    with restored_signals(signal.SIGINT, signal.SIGTERM):
        assert main(['status']) == ExitCode.INTERRUPTED
    assert Opening.is_closed


def test_terminal_injection_does_not_pass(executive: ScriptedExecutive) -> None:
    executive.do(lambda: executive.log('\x1b[2Jgone\x07', path='/\x1b[31m'))
    done = console('log')
    assert done.returncode == 0 and 'gone' in done.stdout
    assert '\x1b' not in done.stdout and '\x07' not in done.stdout


def test_output_that_is_not_utf_8(executive: ScriptedExecutive) -> None:
    executive.do(lambda: executive.log('Küche → Flur'))
    environment = {**os.environ, 'PYTHONIOENCODING': 'ascii', 'LC_ALL': 'C'}
    done = subprocess.run(
        [sys.executable, *COMMAND, 'log', '--namespace', NAMESPACE],
        capture_output=True,
        env=environment,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done
    assert b'K' in done.stdout
