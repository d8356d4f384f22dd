# SPDX-License-Identifier: BSD-3-Clause
"""Processes that tests start as forks: none is left behind, and each is where the test is."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from flexbt_testing.system import fork_server, processes, python_processes
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import wait_until

SLEEPER = """
import os, signal

def main():
    print(os.getcwd(), os.getppid(), flush=True)
    signal.pause()
"""
NAMES = ('recorder', 'run_report')
TALKER = """
import os, signal

SETTING = os.environ.get('FLEXBT_SETTING')

def main():
    child = os.fork()
    if child:
        print(SETTING, child, flush=True)
    else:
        signal.alarm(60)
        signal.pause()
"""

pytestmark = pytest.mark.skipif(not fork_server.AVAILABLE, reason='forks of a server are on Linux')


def module_of(text: str, directory: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a module that the servers that begin from now on find."""
    module = f'module_{directory.name}'
    (directory / f'{module}.py').write_text(text)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join((str(directory), os.environ.get('PYTHONPATH', ''))))
    return module


@pytest.fixture
def sleeper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the module that the executables NAMES are here."""
    module = module_of(SLEEPER, tmp_path, monkeypatch)
    monkeypatch.setattr(processes, 'LOADED', (module,))
    monkeypatch.setattr(processes, 'MODULES', dict.fromkeys(NAMES, module))
    return module


def words(stack: Stack, name: str) -> list[str]:
    """Return what a process has said, when it has said a line."""
    wait_until(lambda: stack.output(name).endswith('\n'), name)
    return stack.output(name).split()


def test_forks_are_ended_though_their_server_is_gone(
    sleeper: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    elsewhere = tmp_path / 'elsewhere'
    elsewhere.mkdir()
    with Stack(tmp_path) as stack:
        stack.start(NAMES[0])
        monkeypatch.chdir(elsewhere)
        stack.start(NAMES[1])
        server = int(words(stack, NAMES[0])[1])
        assert words(stack, NAMES[1]) == [str(elsewhere), str(server)]
        assert os.getsid(server) == server  # no Ctrl-C of the terminal is for it
        ends = [os.pidfd_open(stack.process_id(name)) for name in NAMES]
        os.kill(server, signal.SIGKILL)
        os.kill(stack.process_id(NAMES[0]), signal.SIGKILL)
        assert select.select([ends[0]], [], [], 60.0)[0]
    for end in ends:
        assert select.select([end], [], [], 60.0)[0]
        os.close(end)
    said = capsys.readouterr().out
    assert said.count(f'the fork server of {sleeper} has ended, exit code -9') == 2


def test_forks_end_with_whoever_had_them_started(sleeper: str, tmp_path: Path) -> None:
    server = fork_server.ForkServer(sleeper)
    with (tmp_path / 'log').open('wb') as log:
        end = os.pidfd_open(server.start(['sleeper'], log.fileno(), os.environ))
    server.close()
    assert select.select([end], [], [], 60.0)[0]
    os.close(end)


def test_a_fork_that_nobody_has_waited_for_ends_too(
    sleeper: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ask(server: fork_server.ForkServer, request: object, files: list[int]) -> int:
        return socket.send_fds(server._socket, [json.dumps(request).encode()], files)

    monkeypatch.setattr(fork_server.ForkServer, '_ask', ask)
    server = fork_server.ForkServer(sleeper)
    reader, writer = os.pipe()
    server.start(['sleeper'], writer, os.environ)
    os.close(writer)
    server.close()
    while select.select([reader], [], [], 60.0)[0] and os.read(reader, 1000):
        pass
    assert select.select([reader], [], [], 0.0)[0], 'no process has the other end any more'
    os.close(reader)


def test_programs_have_modules_of_their_environment_and_are_waited_for_in_bounded_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(python_processes, 'PROGRAM', module_of(TALKER, tmp_path, monkeypatch))
    for setting in ('one', 'other'):
        monkeypatch.setenv('FLEXBT_SETTING', setting)
        with pytest.raises(subprocess.TimeoutExpired), python_processes.python_process([]) as process:
            assert process.stdout is not None
            said, child = process.stdout.readline().split()
            process.communicate(timeout=0.1)  # it ends, and its child can still say something
        os.kill(int(child), signal.SIGKILL)
        assert said == setting
        assert process.communicate(timeout=60.0) == ('', '')
