# SPDX-License-Identifier: BSD-3-Clause
"""An operator takes over a world, with a real console in a pseudo terminal, over the real middleware."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import signal
import sys
import time
from pathlib import Path
from typing import Self

from flexbt_testing.waiting import DEADLINE

MISSION = """
import pytest

@pytest.mark.world(motion='abstract')
def test_kitchen(world):
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run(600.0)
    raise AssertionError('nobody has taken over')
"""


class Terminal:
    """A program in a pseudo terminal, which answers the question for the place of its cursor.

    As a context manager it kills the program at the end: a world that goes on would be a second robot for other tests.
    """

    def __init__(self, folder: Path, *words: str) -> None:
        self.output = ''
        self._read = 0
        self.pid, self._fd = pty.fork()
        if self.pid == 0:
            os.environ.update(TERM='xterm-256color')
            os.environ.pop('PYTEST_PLUGINS', None)
            os.chdir(folder)
            os.execv(sys.executable, [sys.executable, *words])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):  # it has ended
            os.killpg(self.pid, signal.SIGKILL)

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait until something was printed after what was waited for before."""
        deadline = time.monotonic() + DEADLINE
        while (found := re.compile(pattern).search(self.output, self._read)) is None:
            goes_on = self._take(1.0) and time.monotonic() < deadline
            assert goes_on, f'no {pattern!r} in {" ".join(self.output[self._read :].split())[:2000]}'
        self._read = found.end()
        return found

    def type(self, text: str) -> None:
        os.write(self._fd, text.encode())

    def exit_code(self) -> int:
        """Wait for the end."""
        deadline = time.monotonic() + DEADLINE
        while self._take(1.0):
            assert time.monotonic() < deadline, self.output[-2000:]
        os.close(self._fd)
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])

    def _take(self, seconds: float) -> bool:
        if not select.select([self._fd], [], [], seconds)[0]:
            return True
        try:
            data = os.read(self._fd, 65536).decode(errors='replace')
        except OSError:  # the other side has closed
            return False
        if '\x1b[6n' in data:
            os.write(self._fd, b'\x1b[1;1R')
        self.output += re.sub(r'\x1b\[[0-9;?]*[A-Za-z]', '', data)
        return True


def test_an_operator_takes_over_at_a_marked_time(tmp_path: Path) -> None:
    (tmp_path / 'test_it.py').write_text(MISSION)
    words = ('-m', 'pytest', '-p', 'flexbt_testing.world', 'test_it.py', '--live', '10 prompt --operator ann')
    with Terminal(tmp_path, *words) as terminal:
        terminal.wait_for('engineer: answer Navigate "of a test": applied')
        terminal.wait_for('active: /Drive')
        terminal.type('force failed\r')
        terminal.wait_for('ann: force /Drive failed: applied')
        terminal.wait_for(r'waiting: \[input-2\] /AskGoal')
        begin = time.monotonic()
        terminal.type('office\r')
        terminal.wait_for('ann: answer Navigate: applied')
        terminal.wait_for(r'waiting: \[input-3\] /AskGoal')
        assert time.monotonic() - begin > 3.0, 'a robot of 0.3 m/s was faster than that'
        terminal.type('stop\r')
        terminal.wait_for('Navigate ended: preempted')
        terminal.wait_for('stopped by operator ann')
        terminal.type('quit\r')
        assert terminal.exit_code() == 0, terminal.output[-2000:]
        assert '1 passed' in terminal.output
