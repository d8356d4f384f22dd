# SPDX-License-Identifier: BSD-3-Clause
"""Which terminals are asked for a protocol for images, and what becomes of their answers."""

import fcntl
import os
import struct
import subprocess
import sys
import termios

import pytest

from flexbt_console.ui.screen import textual_app

pytest.importorskip('textual_image', reason='pip install textual-image')

# The file alone: the screen around it takes a second to be imported. The library waits 0.1 s for an answer; here
# it waits as long as a busy machine takes for that to DA1, which every terminal gives.
PROGRAM = """
import runpy, sys
from textual_image import _terminal
asked = _terminal.capture_terminal_response
def patient(start_marker, end_marker, timeout):
    return asked(start_marker, end_marker, 60.0 if end_marker == 'c' else timeout)
_terminal.capture_terminal_response = patient
print(runpy.run_path(sys.argv[1])['image_widget'](), flush=True)
"""
KNOWN = ('KITTY_WINDOW_ID', 'WEZTERM_PANE', 'KONSOLE_VERSION', 'ITERM_SESSION_ID', 'WT_SESSION', 'FLEXBT_IMAGES')


def written(attributes: bytes, environment: dict[str, str], columns: int = 80) -> bytes:
    """Return what a program that looks for images writes to a terminal that answers DA1 with these attributes."""
    terminal, other = os.openpty()
    fcntl.ioctl(other, termios.TIOCSWINSZ, struct.pack('HHHH', 24, columns, 10 * columns, 480))
    given = {name: value for name, value in os.environ.items() if name not in KNOWN} | environment
    command = [sys.executable, '-c', PROGRAM, textual_app.__file__]
    process = subprocess.Popen(command, stdin=other, stdout=other, stderr=other, env=given)
    os.close(other)
    text = b''
    try:
        while data := os.read(terminal, 4096):
            text += data
            if data.endswith(b'\x1b[c'):
                os.write(terminal, attributes)
    except OSError:  # the process has ended
        pass
    finally:
        process.wait()
        os.close(terminal)
    return text


def test_a_terminal_with_sixel_shows_images() -> None:
    assert b'sixel' in written(b'\x1b[?62;4;22c', {'TERM': 'foot'})


def test_a_terminal_without_columns_shows_none() -> None:
    assert written(b'\x1b[?62;4;22c', {'TERM': 'foot'}, 0).endswith(b'None\r\n')


def test_a_terminal_without_a_protocol_shows_none() -> None:
    assert written(b'\x1b[?62;22c', {'TERM': 'xterm-256color', 'FLEXBT_IMAGES': '1'}).endswith(b'None\r\n')


@pytest.mark.parametrize('environment', [{'TERM': 'xterm-256color'}, {'TERM': 'foot', 'FLEXBT_IMAGES': '0'}])
def test_nothing_is_asked_of_a_terminal_that_is_not_known_for_it(environment: dict[str, str]) -> None:
    assert written(b'\x1b[?62;4;22c', environment) == b'None\r\n'
