# SPDX-License-Identifier: BSD-3-Clause
"""The beginning of a process: a signal that comes before it handles signals itself ends it without a word."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

PLACES = {
    'import': 'stay()',
    'main': 'def main(): stay()',
    'callback': """
class Let:
    def __del__(self): stay()

def main(): Let()
""",
    'own handler': """
def main():
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        stay()
    except KeyboardInterrupt:
        return 7
""",
    'interrupted main': """
def main():
    try:
        stay()
    except KeyboardInterrupt:
        return 8
""",
}
"""Modules of an executable that stay at some place. What a callback raises goes no further."""
STAY = """
import signal
import time

def stay():
    print('there', flush=True)
    time.sleep(60.0)

"""
START = "import sys; from flexbt_common.executables import run_main; sys.exit(run_main('slow', raises_interrupt={}))"


@pytest.mark.parametrize(
    ('place', 'raises_interrupt', 'number', 'code'),
    [
        ('import', False, signal.SIGINT, -signal.SIGINT),
        ('import', True, signal.SIGINT, -signal.SIGINT),
        ('import', False, signal.SIGTERM, -signal.SIGTERM),
        ('main', False, signal.SIGINT, -signal.SIGINT),
        ('callback', False, signal.SIGINT, -signal.SIGINT),
        ('own handler', False, signal.SIGINT, 7),
        ('interrupted main', True, signal.SIGINT, 8),
    ],
)
def test_a_signal_ends_a_process_until_it_handles_it_itself(
    tmp_path: Path, place: str, raises_interrupt: bool, number: signal.Signals, code: int
) -> None:
    (tmp_path / 'slow.py').write_text(STAY + PLACES[place])
    with subprocess.Popen(
        [sys.executable, '-c', START.format(raises_interrupt)],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == 'there\n'
        process.send_signal(number)
        assert process.wait(60.0) == code
        assert process.stderr.read() == ''


def test_a_signal_that_is_ignored_stays_so(tmp_path: Path) -> None:
    (tmp_path / 'slow.py').write_text(
        'import signal\n\ndef main(): return int(signal.getsignal(2) != signal.SIG_IGN)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', START.format(True)],
        cwd=tmp_path,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    assert done.returncode == 0


def test_loading_leaves_out_what_generates_message_code(tmp_path: Path) -> None:
    (tmp_path / 'slow.py').write_text(
        'import gc, sys\nfrom std_msgs.msg import String\n\n'
        'def main():\n'
        '    String.__class__.__import_type_support__()\n'
        '    return int(not gc.isenabled() or gc.get_freeze_count() == 0 or "rosidl_parser.parser" in sys.modules)\n'
    )
    assert subprocess.run([sys.executable, '-c', START.format(False)], cwd=tmp_path, check=False).returncode == 0


def test_a_stream_that_was_closed_before_the_start_is_that_of_the_null_device(tmp_path: Path) -> None:
    (tmp_path / 'slow.py').write_text("""
import os
import sys

def main():
    streams = sys.stdin, sys.stdout, sys.stderr
    print('lost')
    with open('seen', 'w') as seen:
        print([stream.isatty() for stream in streams], [stream.fileno() for stream in streams],
              repr(sys.stdin.read()), file=seen)
    return 0
""")
    shell = 'exec "$0" -c "$1" <&- >&- 2>&-'
    subprocess.run(['/bin/sh', '-c', shell, sys.executable, START.format(False)], cwd=tmp_path, check=True)
    assert (tmp_path / 'seen').read_text() == "[False, False, False] [0, 1, 2] ''\n"
