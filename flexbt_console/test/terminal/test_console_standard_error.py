# SPDX-License-Identifier: BSD-3-Clause
"""What others write to the terminal of the screen."""

from __future__ import annotations

import ctypes
import os
import pty
import sys

from flexbt_console.ui.terminal import standard_error_as_lines


def test_what_the_middleware_writes_becomes_lines_and_the_screen_keeps_its_terminal() -> None:
    control, terminal = pty.openpty()
    before = os.dup(2)
    flood = b'y' * 1_000_000
    told: list[str] = []
    os.dup2(terminal, 2)
    try:
        with standard_error_as_lines(told.append):
            os.write(2, b'[ERROR] one\n\x1b[2Jtwo\xff\n' + b'x' * 10_000)
            assert not os.get_blocking(2)
            ctypes.PyDLL(None).write(2, flood, len(flood))  # as the middleware does, with the interpreter's lock
            print('the screen', file=sys.__stderr__, flush=True)
        os.write(2, b'after\n')
    finally:
        os.dup2(before, 2)
        os.close(before)
    seen = b''
    while b'after' not in seen:
        seen += os.read(control, 10_000)
    assert seen.split() == [b'the', b'screen', b'after']
    assert told[0] == '[ERROR] one' and 'two' in told[1] and '\x1b' not in told[1]
    text = ''.join(told[2:])
    assert text.rstrip('y') == 'x' * 10_000 and len(text) < len(flood)  # of the flood, as much as there is room for
    for number in (control, terminal):
        os.close(number)


def test_what_is_drawn_on_a_terminal_that_is_gone_is_lost() -> None:
    control, terminal = pty.openpty()
    before = os.dup(2)
    os.dup2(terminal, 2)
    try:
        with standard_error_as_lines(lambda text: None):
            os.close(control)
            print('the screen', file=sys.__stderr__, flush=True)  # an error would end the thread that draws
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(terminal)
