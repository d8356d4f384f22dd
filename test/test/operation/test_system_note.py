# SPDX-License-Identifier: BSD-3-Clause
"""A note of one operator: in the log of every console, in the event log, in the report of the run, in a recording."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rclpy.serialization import deserialize_message

from flexbt_common.names import EXECUTIVE_LOG
from flexbt_console.recording.run_file import read_run
from flexbt_msgs.msg import ExecutiveLog
from flexbt_testing.system.processes import Stack, executable
from flexbt_testing.system.python_processes import console_answer, run_console, start_console
from flexbt_testing.waiting import DEADLINE, wait_until

NOTE = 'the floor is wet \x1b[2J'


class Watching:
    """A console of an operator that follows what happens, a process; ``log`` are the lines of the log that it got."""

    def __init__(self, operator: str) -> None:
        self.process = start_console('watch', '--json', '--operator', operator)
        self.log: list[str] = []
        self.output: list[str] = []
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            event = json.loads(line)
            with self._changed:
                self.output.append(line)
                self.log += [event['line']['text']] if event['event'] == 'log' else []
                self._changed.notify_all()

    def wait_for(self, event: str) -> None:
        """Wait until there was an event of that name."""
        name = f'"event": "{event}"'
        with self._changed:
            assert self._changed.wait_for(lambda: any(name in line for line in self.output), DEADLINE), self.output

    def end(self) -> None:
        """Kill it."""
        with self.process:
            self.process.kill()
            self._thread.join()

    def noted(self) -> str:
        """Wait for a note in the log."""
        with self._changed:
            assert self._changed.wait_for(lambda: any('notes:' in text for text in self.log), DEADLINE), self.log
            return next(text for text in self.log if 'notes:' in text)


@pytest.fixture
def watching() -> Iterator[tuple[Watching, Watching]]:
    consoles = Watching('ann'), Watching('bob')
    yield consoles
    for console in consoles:
        console.end()


def console(*words: str, exit_code: int = 0) -> Any:
    """Return what a command of ann's console answers."""
    return console_answer(*words, '--operator', 'ann', exit_code=exit_code)


def test_a_note_reaches_every_console_and_what_is_kept(tmp_path: Path, watching: tuple[Watching, Watching]) -> None:
    file = tmp_path / 'run.mcap'
    with Stack(tmp_path) as stack:
        stack.start('onboard_executive', {'use_sim_time': 'false', 'journal_directory': str(tmp_path)})
        stack.start('recorder', {'use_sim_time': 'false', 'file': str(file)})
        for one in watching:
            one.wait_for('behaviors')
        wait_until(file.exists, 'recorder that has begun, and heeds signals')
        console('start', 'Inspect Site', 'duration=1000', '--input', 'site=string:"gate"', '--autonomy', 'high')
        assert 'the limit is 1000' in console('note', 'x' * 1001, exit_code=2)['reason']
        console('note', NOTE)
        texts = {one.noted() for one in watching}
        assert len(texts) == 1 and 'ann notes: the floor is wet' in texts.pop()
        for one in watching:
            assert all(line.isascii() and '\x1b' not in line for line in one.output)
        shown = run_console('log').stdout
        assert 'the floor is wet \\e[2J' in shown and '\x1b' not in shown
        console('stop', '--wait', '--wait-timeout', '30')
        assert stack.end('recorder', signal.SIGINT, DEADLINE).exit_code == 0
    (event_log,) = tmp_path.glob('*.jsonl')
    events = [json.loads(line) for line in event_log.read_text().splitlines()]
    noted = [event for event in events if event['event'] == 'command' and event['command'] == 'NOTE']
    assert [(event['operator'], event['text'], event['effect']) for event in noted] == [('ann', NOTE, 'applied')]
    report = subprocess.run(
        [executable('run_report'), str(event_log)], capture_output=True, timeout=DEADLINE, check=True
    ).stdout
    assert b'the floor is wet' in report and b'\x1b' not in report
    said = [deserialize_message(one.data, ExecutiveLog).text for one in read_run(file) if one.topic == EXECUTIVE_LOG]
    assert any('the floor is wet' in text for text in said)
