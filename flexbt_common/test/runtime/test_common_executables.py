# SPDX-License-Identifier: BSD-3-Clause
"""The beginning of a process: a signal that comes while it is loaded ends it without a word."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

SLOW = """
import signal
import time

print('loading', flush=True)
time.sleep(LOADING)

def main():
    try:
        print('runs', flush=True)
        time.sleep(60.0)
    except KeyboardInterrupt:
        return 7
"""
START = "import sys; from flexbt_common.executables import run_main; sys.exit(run_main('slow'))"


@pytest.mark.parametrize(
    ('loading', 'last', 'number', 'code'),
    [
        (60.0, 'loading', signal.SIGINT, -signal.SIGINT),
        (60.0, 'loading', signal.SIGTERM, -signal.SIGTERM),
        (0.0, 'runs', signal.SIGINT, 7),
    ],
)
def test_a_signal_ends_a_process_that_is_being_loaded(
    tmp_path: Path, loading: float, last: str, number: signal.Signals, code: int
) -> None:
    (tmp_path / 'slow.py').write_text(SLOW.replace('LOADING', str(loading)))
    with subprocess.Popen(
        [sys.executable, '-c', START],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        while process.stdout.readline().strip() != last:
            assert process.poll() is None
        process.send_signal(number)
        assert process.wait(60.0) == code
        assert process.stderr.read() == ''


def test_a_signal_that_is_ignored_stays_so(tmp_path: Path) -> None:
    (tmp_path / 'slow.py').write_text(
        'import signal\n\ndef main(): return int(signal.getsignal(2) != signal.SIG_IGN)\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', START],
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
    assert subprocess.run([sys.executable, '-c', START], cwd=tmp_path, check=False).returncode == 0
