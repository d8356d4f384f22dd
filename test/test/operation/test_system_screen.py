# SPDX-License-Identifier: BSD-3-Clause
"""The operator's screen in a real terminal, with two real executives: found, gone to, commanded; and left."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_testing.system.processes import Stack, executable
from flexbt_testing.system.python_processes import console_answer
from flexbt_testing.waiting import wait_until

DEADLINE = 120.0

pytestmark = pytest.mark.skipif(shutil.which('tmux') is None, reason='needs tmux')


class Terminal:
    """A terminal of 100 by 30 in a tmux of its own, in which a command runs."""

    def __init__(self, directory: Path, *command: str) -> None:
        self._tmux = ['tmux', '-S', str(directory / 'tmux'), '-f', '/dev/null']
        self._run('new-session', '-d', '-x', '100', '-y', '30', *command)

    def _run(self, *words: str) -> str:
        return subprocess.run([*self._tmux, *words], check=True, capture_output=True, text=True).stdout

    def keys(self, *keys: str) -> None:
        """Press keys, by their names in tmux."""
        self._run('send-keys', *keys)

    def shows(self, pattern: str) -> None:
        """Wait until the terminal shows what matches."""
        wait_until(
            lambda: re.search(pattern, self._run('capture-pane', '-p')),
            lambda: f'{pattern!r} in\n{self._run("capture-pane", "-p")}',
            DEADLINE,
        )

    @property
    def is_there(self) -> bool:
        """Whether the command still runs."""
        return subprocess.run([*self._tmux, 'has-session'], capture_output=True, check=False).returncode == 0

    def close(self) -> None:
        """End it, if it has not ended."""
        if self.is_there:
            self._run('kill-server')


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    """Yield the console without a command, at the first of two robots."""
    shown = Terminal(tmp_path, executable('console'), '--namespace', 'robot1', '--operator', 'ann')
    yield shown
    shown.close()


def robots() -> set[tuple[str, str]]:
    """Return those that are heard, without one that a busy machine holds up, each with the outcome of its last run."""
    heard = console_answer('robots', '--operator', 'ann')
    return {(one['robot'], one['outcome']) for one in heard}


def test_the_robot_that_waits_is_found_stopped_and_left(tmp_path: Path, terminal: Terminal) -> None:
    with Stack(tmp_path) as stack:
        for robot in ('robot1', 'robot2'):
            stack.start(f'{robot}/onboard_executive', {'use_sim_time': 'false'})
        terminal.shows('/robot1  LIVE  IDLE')
        words = ('--autonomy', 'off', '--namespace', 'robot2', '--operator', 'ann')
        assert console_answer('start', 'Navigate', *words)['result'] == 'applied'
        terminal.shows('1 other needs you: o')
        terminal.keys('o')
        terminal.shows('robots: 2  need you: 1')
        terminal.shows(r'/robot2 +waits +\d.*\n> /robot1')
        terminal.keys('Up', 'Enter')
        terminal.shows(r'^ /robot2  LIVE  RUNNING')
        terminal.keys('!')
        terminal.shows(r'stop: applied')
        terminal.shows(r'^ /robot2  LIVE  IDLE')
        wait_until(lambda: robots() == {('/robot1', ''), ('/robot2', 'preempted')}, robots, DEADLINE)
        terminal.keys('q')
        wait_until(lambda: not terminal.is_there, 'end of the console', DEADLINE)
