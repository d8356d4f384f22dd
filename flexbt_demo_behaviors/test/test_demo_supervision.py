# SPDX-License-Identifier: BSD-3-Clause
"""Child processes of a demonstration: none survives, and one that dies is named with its last words."""

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.command_line import restored_signals
from flexbt_demo_behaviors.demonstration import process_group
from flexbt_demo_behaviors.demonstration.process_group import EndedProcess, ProcessGroup
from flexbt_demo_behaviors.demonstration.report import DemoError, Timeline
from flexbt_demo_behaviors.demonstration.running import RunOptions, run_console, run_demonstration, tell_ended

DEADLINE = 60.0
"""Seconds of wall time, on a busy machine too."""

# Whoever is started in the background inherits that SIGINT is ignored.
SLEEPER = [
    sys.executable,
    '-c',
    'import signal; signal.signal(signal.SIGINT, signal.SIG_DFL)\nprint("up", flush=True)\nsignal.pause()',
]
STUBBORN = [
    sys.executable,
    '-c',
    'import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)\nprint("up", flush=True)\nwhile True: signal.pause()',
]


def wait_for_text(file: Path, text: str, timeout: float = 60.0) -> None:
    deadline = time.monotonic() + timeout
    while not (file.exists() and text in file.read_text()):
        assert time.monotonic() < deadline, f'{text!r} never came in {file}'
        time.sleep(0.01)


def is_running(pid: int) -> bool:
    status = Path(f'/proc/{pid}/stat')
    return status.exists() and status.read_text().rsplit(')', 1)[1].split()[0] not in 'ZX'


def test_every_process_is_ended_soon_also_one_that_ignores_the_signal(tmp_path: Path) -> None:
    ended: list[EndedProcess] = []
    with ProcessGroup(tmp_path) as group:
        group.watch(ended.append)
        group.start('sleeper', SLEEPER)
        group.start('stubborn', STUBBORN)
        for name in ('sleeper', 'stubborn'):
            wait_for_text(tmp_path / f'{name}.log', 'up')
        pids = [group.pid('sleeper'), group.pid('stubborn')]
        before = time.monotonic()
        assert group.end() == ['stubborn']
        assert time.monotonic() - before < DEADLINE  # they would last for ever
    assert not any(is_running(pid) for pid in pids)
    assert ended == []


def test_logs_that_cannot_be_written_are_told_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / 'out').touch()
    with pytest.raises(DemoError, match=r'out/logs: Not a directory; name another directory: make demo OUTPUT=DIR'):
        ProcessGroup(tmp_path / 'out' / 'logs').__enter__()


def test_processes_are_ended_when_the_body_raises(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), ProcessGroup(tmp_path) as group:
        group.start('sleeper', SLEEPER)
        pid = group.pid('sleeper')
        raise KeyboardInterrupt
    assert not is_running(pid)


@pytest.fixture
def signals() -> Iterator[tuple[signal.Signals, ...]]:
    """By which a demonstration is ended; what they did before is put back."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    with restored_signals(*numbers):
        yield numbers


@pytest.mark.parametrize('interactive', [False, True])
def test_each_signal_ends_a_demonstration_with_its_processes_and_is_no_success_of_a_script(
    interactive: bool, signals: tuple[signal.Signals, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('OMP_NUM_THREADS', '1')  # which it would set
    pids: list[int] = []
    for number in signals:

        def run(_options: RunOptions, group: ProcessGroup, _timeline: Timeline, number: signal.Signals = number) -> int:
            group.start('sleeper', SLEEPER)
            wait_for_text(tmp_path / 'logs' / 'sleeper.log', 'up')
            pids.append(group.pid('sleeper'))
            signal.raise_signal(number)
            raise AssertionError('the signal has no effect')

        options = RunOptions(interactive, 1.0, tmp_path)
        assert run_demonstration('demo', options, run) == (0 if interactive else 128 + number)
    assert len(pids) == len(signals) and not any(map(is_running, pids))


def test_a_console_that_does_not_end_is_ended_also_when_its_terminal_is_gone(
    signals: tuple[signal.Signals, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('OMP_NUM_THREADS', '1')
    terminal, stdin = os.openpty()
    up, told = tmp_path / 'up', 'import os, pathlib, signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n'
    told += 'pathlib.Path(sys.argv[1]).write_text(f"{os.getpid()}\\n"); signal.pause()'

    def hang_up() -> None:
        wait_for_text(up, '\n')
        os.close(terminal)
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGHUP)

    def run(_options: RunOptions, group: ProcessGroup, _timeline: Timeline) -> int:
        threading.Thread(target=hang_up).start()
        return run_console(group, [sys.executable, '-c', told, str(up)])

    with os.fdopen(stdin) as shown:
        monkeypatch.setattr('sys.stdin', shown)
        assert run_demonstration('demo', RunOptions(True, 1.0, tmp_path), run) == 0
    assert not is_running(int(up.read_text()))


def test_a_process_that_dies_is_started_again_but_not_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_group, 'RESPAWN_DELAY_S', 0.01)
    ended: queue.Queue[EndedProcess] = queue.Queue()
    with ProcessGroup(tmp_path) as group:
        group.watch(ended.put)
        group.start('unlucky', [sys.executable, '-c', 'print("a life")'], respawn=True)
        lives = [ended.get(timeout=60) for _ in range(process_group.RESPAWNS + 1)]
    assert [life.is_respawned for life in lives] == [True] * process_group.RESPAWNS + [False]
    assert 'started again' in lives[0].report() and 'started again' not in lives[-1].report()
    assert (tmp_path / 'unlucky.log').read_text().count('a life') == len(lives)


def test_a_process_that_is_killed_on_purpose_is_not_started_again_nor_told(tmp_path: Path) -> None:
    ended: queue.Queue[EndedProcess] = queue.Queue()
    with ProcessGroup(tmp_path) as group:
        group.watch(ended.put)
        for name in ('lost', 'unlucky'):
            group.start(name, SLEEPER, respawn=True)
            wait_for_text(tmp_path / f'{name}.log', 'up')
        lost, unlucky = group.pid('lost'), group.pid('unlucky')
        group.kill('lost')
        os.kill(unlucky, signal.SIGKILL)
        assert ended.get(timeout=DEADLINE).name == 'unlucky'
        group.kill('unlucky')  # before its next life, or in it
        for watcher in group._watchers:
            watcher.join(DEADLINE)
            assert not watcher.is_alive()
        assert group.pid('lost') == lost and not any(map(is_running, (lost, group.pid('unlucky'))))
    assert ended.empty()


@pytest.mark.parametrize(
    ('command', 'said'),
    [
        ('print("the last word"); raise SystemExit(3)', 'exit code 3'),
        ('import os; print("the last word", flush=True); os.abort()', f'signal {signal.SIGABRT.value}'),
    ],
)
def test_a_process_that_dies_is_named_with_its_last_lines(tmp_path: Path, command: str, said: str) -> None:
    ended: queue.Queue[EndedProcess] = queue.Queue()
    with ProcessGroup(tmp_path) as group:
        group.watch(ended.put)
        group.start('unlucky', [sys.executable, '-c', command])
        report = ended.get(timeout=60).report()
    assert 'unlucky' in report
    assert said in report
    assert 'the last word' in report


def test_who_begins_to_watch_late_is_told_what_ended_before(tmp_path: Path) -> None:
    first: queue.Queue[EndedProcess] = queue.Queue()
    late: list[EndedProcess] = []
    with ProcessGroup(tmp_path) as group:
        group.watch(first.put)
        group.start('unlucky', [sys.executable, '-c', 'raise SystemExit(3)'])
        ended = first.get(timeout=60)
        group.watch(late.append)
        assert late == [ended]


def test_what_died_while_the_operator_was_at_the_console_is_told_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ended: queue.Queue[EndedProcess] = queue.Queue()
    with ProcessGroup(tmp_path) as group:
        group.watch(ended.put)
        group.start('unlucky', [sys.executable, '-c', 'raise SystemExit(3)'])
        group.start('program', [sys.executable, '-c', 'print("at its end")'])
        assert {ended.get(timeout=DEADLINE).name for _ in range(2)} == {'unlucky', 'program'}
        tell_ended(group)
        told = capsys.readouterr().err
        assert 'unlucky ended with exit code 3' in told and 'program' not in told
        tell_ended(group)
        assert capsys.readouterr().err == ''


@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='the kernel of Linux ends orphans')
def test_processes_do_not_outlive_a_demonstration_that_is_killed(tmp_path: Path) -> None:
    program = (
        'import signal, sys, pathlib; from flexbt_demo_behaviors.demonstration.process_group import ProcessGroup\n'
        'group = ProcessGroup(pathlib.Path(sys.argv[1])).__enter__()\n'
        f'group.start("sleeper", {SLEEPER!r})\n'
        'print(group.pid("sleeper"), flush=True); signal.pause()'
    )
    parent = subprocess.Popen([sys.executable, '-c', program, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    with parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        wait_for_text(tmp_path / 'sleeper.log', 'up')
        os.kill(parent.pid, signal.SIGKILL)
    deadline = time.monotonic() + 60
    while is_running(pid):
        assert time.monotonic() < deadline, 'the process outlived its demonstration'
        time.sleep(0.01)
