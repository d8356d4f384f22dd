# SPDX-License-Identifier: BSD-3-Clause
"""The prompt in a real terminal of 80 by 24."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import sys
import termios
import time
from typing import Any

from flexbt_console.ui.prompt import REACTION_SECONDS
from flexbt_testing.nodes.scripted_executive import ScriptedExecutive

DEADLINE = 20.0
COLOUR = re.compile(rb'\x1b\[[0-9;]*(3[0-7]|9[0-7]|38;[0-9;]*)m')


class Terminal:
    """A console in a pseudo terminal that answers the question for the place of its cursor."""

    def __init__(self, *words: str, **environment: str) -> None:
        self.output = b''
        self._answered = 0
        self.pid, self._fd = pty.fork()
        if self.pid == 0:
            os.environ.update({'TERM': 'xterm-256color', **environment})
            os.execv(sys.executable, [sys.executable, '-m', 'flexbt_console', *words])
        fcntl.ioctl(self._fd, termios.TIOCSWINSZ, struct.pack('HHHH', 24, 80, 0, 0))

    def read_until(self, text: bytes) -> None:
        """Wait until the text was printed after everything that was waited for before."""
        deadline = time.monotonic() + DEADLINE
        while text not in self.output[self._answered :]:
            assert time.monotonic() < deadline, (text, self.output[-2000:])
            self._read()
        self._answered = self.output.index(text, self._answered) + len(text)

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self._fd, text.encode())

    def exit_code(self) -> int:
        """Wait for the end."""
        deadline = time.monotonic() + DEADLINE
        while time.monotonic() < deadline:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                os.close(self._fd)
                return os.waitstatus_to_exitcode(status)
            self._read()
        os.kill(self.pid, signal.SIGKILL)
        raise AssertionError('the console did not end')

    def _read(self) -> None:
        if not select.select([self._fd], [], [], 0.05)[0]:
            return
        try:
            data = os.read(self._fd, 65536)
        except OSError:  # the other side has closed
            time.sleep(0.01)
            return
        self.output += data
        for _ in range(data.count(b'\x1b[6n')):
            os.write(self._fd, b'\x1b[1;1R')


def test_a_mission_at_the_prompt(executives: Any) -> None:
    executive: ScriptedExecutive = executives('terminal')
    terminal = Terminal('--namespace', 'terminal', '--operator', 'ann')
    terminal.read_until(b'LIVE')
    terminal.type('start Drive --autonomy low\r')
    terminal.read_until(b'/AskGoal asks for a value')
    terminal.read_until(b'start Drive: applied')
    terminal.type('1 2 0.5\r')
    terminal.read_until(b'/Accept wants done')
    terminal.read_until(b'1 2 0.5: applied')
    executive.do(lambda: executive.log('\x1b]0;title\x07harmless'))
    terminal.read_until(b'\\e]0;title\\x07harmless')
    time.sleep(REACTION_SECONDS + 0.1)  # a person who reads the decision first
    terminal.type('done\r')
    terminal.read_until(b'confirm done: applied')
    assert executive.values[0].pose.position.x == 1.0
    terminal.type('\x03')
    assert terminal.exit_code() == 0
    assert b'Traceback' not in terminal.output
    assert executive.do(lambda: executive.status.state) == executive.status.RUNNING
    assert COLOUR.search(terminal.output)


def test_no_color_and_sigterm() -> None:
    terminal = Terminal('--namespace', 'quiet', NO_COLOR='1')
    terminal.read_until(b'NO EXECUTIVE')
    os.kill(terminal.pid, signal.SIGTERM)
    assert terminal.exit_code() == 0
    assert not COLOUR.search(terminal.output)
    assert b'Traceback' not in terminal.output
