# SPDX-License-Identifier: BSD-3-Clause
"""The prompt in a real terminal of 80 by 24."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any

import pytest

from flexbt_console.ui.answers import REACTION_SECONDS
from flexbt_testing.nodes.scripted_executive import ScriptedExecutive
from flexbt_testing.waiting import DEADLINE

COLOUR = re.compile(rb'\x1b\[[0-9;]*(3[0-7]|9[0-7]|38;[0-9;]*)m')


class Terminal:
    """A console in a pseudo terminal that answers the question for the place of its cursor."""

    def __init__(self, *words: str, mode: str = 'prompt', **environment: str) -> None:
        self.output = b''
        self.makes_signals = False
        """Whether a key could have been a signal since the greeting."""
        self._answered = 0
        self._is_full = False
        self.pid, self._fd = pty.fork()
        if self.pid == 0:
            os.environ.update({'TERM': 'xterm-256color', **environment})
            os.execv(sys.executable, [sys.executable, '-m', 'flexbt_console', mode, *words])
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

    def hang_up(self) -> None:
        """Go away, as a window or a connection does."""
        os.close(self._fd)
        self._fd = -1

    def threads(self) -> int:
        """Return how many threads the console has, those of the middleware left out, which have names."""
        process = Path('/proc', str(self.pid))
        names = [(thread / 'comm').read_text() for thread in process.glob('task/*')]
        return names.count((process / 'comm').read_text())

    def fill(self) -> None:
        """Take nothing any more, and be full."""
        other = os.open(f'/proc/{self.pid}/fd/0', os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        while select.select([], [other], [], 0.5)[1]:  # the kernel takes it on a moment later
            with contextlib.suppress(BlockingIOError):
                os.write(other, bytes(4096))
        os.close(other)
        self._is_full = True

    def exit_code(self) -> int:
        """Wait for the end."""
        deadline = time.monotonic() + DEADLINE
        while time.monotonic() < deadline:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                if self._fd >= 0:
                    os.close(self._fd)
                return os.waitstatus_to_exitcode(status)
            self._read()
        os.kill(self.pid, signal.SIGKILL)
        raise AssertionError('the console did not end')

    def _read(self) -> None:
        if self._fd < 0 or self._is_full:
            time.sleep(0.01)
            return
        if not select.select([self._fd], [], [], 0.05)[0]:
            return
        try:
            data = os.read(self._fd, 65536)
        except OSError:  # the other side has closed
            time.sleep(0.01)
            return
        self.output += data
        if b'lists the commands' in self.output:
            self.makes_signals |= bool(termios.tcgetattr(self._fd)[3] & termios.ISIG)
        for _ in range(data.count(b'\x1b[6n')):
            os.write(self._fd, b'\x1b[1;1R')


def test_what_others_write_to_the_terminal_stands_above_the_line_that_is_typed(executives: Any) -> None:
    executive: ScriptedExecutive = executives('terminal')
    terminal = Terminal('--namespace', 'terminal', '--operator', 'ann')
    terminal.read_until(b'active: none')
    terminal.type('pau')
    terminal.read_until(b'pau')
    executive.do(lambda: executive._log.publish(b'no line'))
    terminal.read_until(b'executive/log: ignored')
    terminal.read_until(b'> pau')  # once more, whole
    terminal.type('\x03\x04')
    assert terminal.exit_code() == 0


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
    terminal.type('force can\x03')
    terminal.type('\x03')
    terminal.read_until(b'Ctrl-C clears the line. "quit" leaves: the robot continues.')
    assert not terminal.makes_signals  # a Ctrl-C that becomes a signal ends whatever has started the console
    terminal.type('quit\r')
    assert terminal.exit_code() == 0
    assert b'Traceback' not in terminal.output
    assert executive.do(lambda: executive.status.state) == executive.status.RUNNING
    assert COLOUR.search(terminal.output)


@pytest.mark.parametrize('ignores_hangup', [False, True])
def test_it_ends_when_its_terminal_goes_away(ignores_hangup: bool) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignores_hangup else signal.SIG_DFL)
    try:
        terminal = Terminal('--namespace', 'gone')
        terminal.read_until(b'NO EXECUTIVE')
        if ignores_hangup:
            os.kill(terminal.pid, signal.SIGSTOP)  # what the end of the terminal leaves to read, write and signal is
            terminal.hang_up()  # there at once
            os.kill(terminal.pid, signal.SIGCONT)
        else:
            terminal.hang_up()
    finally:
        signal.signal(signal.SIGHUP, before)
    assert terminal.exit_code() == 0


def test_the_screen_is_drawn_again_after_a_stop_and_ends_when_its_terminal_goes_away() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        terminal = Terminal('--namespace', 'hangup', mode='screen')
        terminal.read_until(b'quit')  # in its last line
        terminal.type('\x03')  # a key, no signal: that would end the screen and whatever has started it
        terminal.read_until(b'Ctrl-C clears')
        threads = terminal.threads()
        for number in (signal.SIGSTOP, signal.SIGCONT):  # this one comes with the end of the terminal, too
            os.kill(terminal.pid, number)
        terminal.read_until(b'\x1b[?1049h')  # the screen of its own
        terminal.read_until(b'quit')
        assert terminal.threads() == threads  # none that nobody ends
        terminal.hang_up()
    finally:
        signal.signal(signal.SIGHUP, before)
    assert terminal.exit_code() == 0


def test_it_ends_on_a_hangup_signal() -> None:
    terminal = Terminal('--namespace', 'hangup')
    terminal.read_until(b'NO EXECUTIVE')
    os.kill(terminal.pid, signal.SIGHUP)
    assert terminal.exit_code() in {0, 128 + signal.SIGHUP}  # ended by the watch, where a busy machine took long
    assert b'Traceback' not in terminal.output


@pytest.mark.parametrize('mode', ['screen', 'prompt'])
def test_a_signal_ends_it_whatever_its_terminal_does(mode: str) -> None:
    terminal = Terminal('--namespace', 'full', mode=mode)
    terminal.read_until(b'NO EXECUTIVE')
    terminal.fill()
    os.kill(terminal.pid, signal.SIGTERM)
    assert terminal.exit_code() in {0, 128 + signal.SIGTERM}  # a busy kernel may have taken its last words


def test_what_goes_on_though_it_was_told_to_end_is_ended() -> None:
    program = """
import time
from flexbt_console.ui import terminal
terminal.END_SECONDS = 0.1
terminal.TerminalWatch(lambda: print('signed off', flush=True)).signaled(15)
time.sleep(600)"""
    ended = subprocess.run([sys.executable, '-c', program], stdout=subprocess.PIPE, timeout=DEADLINE)
    assert (ended.returncode, ended.stdout) == (128 + signal.SIGTERM, b'signed off\n')


def test_no_color_and_sigterm() -> None:
    terminal = Terminal('--namespace', 'quiet', NO_COLOR='1')
    terminal.read_until(b'NO EXECUTIVE')
    os.kill(terminal.pid, signal.SIGTERM)
    assert terminal.exit_code() == 0
    assert not COLOUR.search(terminal.output)
    assert b'Traceback' not in terminal.output
