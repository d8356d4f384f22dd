# SPDX-License-Identifier: BSD-3-Clause
"""Recorded runs: what a console saw of a robot it sees again in the replay; files that were cut off are of use."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from flexbt_common.runtime import NodeRuntime
from flexbt_console.commands import CommandBuilder
from flexbt_console.errors import ExitCode
from flexbt_console.link import OperatorLink
from flexbt_console.mirror import CommandState, Mirror
from flexbt_console.present import behavior_line
from flexbt_console.recording import replay
from flexbt_console.recording.definitions import full_definition
from flexbt_console.recording.run_file import Recorded, read_run
from flexbt_console.recording.topics import TOPICS

DEADLINE = 60.0


class Station:
    """A console without a user interface."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.mirror = Mirror(runtime.steady)
        self.link = OperatorLink(runtime, self.mirror)
        self.requests = CommandBuilder('ann', {})

    def wait(self, condition: Any) -> Any:
        view = self.link.wait_for(lambda view: view if condition(view) else None, DEADLINE)
        assert view is not None, self.mirror.view()
        return view


@contextmanager
def station(namespace: str) -> Iterator[Station]:
    with NodeRuntime.open('console', namespace=namespace) as runtime:
        yield Station(runtime)


@contextmanager
def recording(file: Path, namespace: str) -> Iterator[subprocess.Popen[bytes]]:
    """A recorder, a process, that hears what is said in a namespace."""
    words = ['--ros-args', '-r', f'__ns:=/{namespace}', '-p', f'file:={file}']
    process = subprocess.Popen([sys.executable, '-m', 'flexbt_console.recording.recorder', *words])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def wait_heard(at: Station) -> None:
    """Until the recorder subscribes to what the console publishes, and so to everything."""
    count = at.link._commands.get_subscription_count
    assert at.link.wait_for(lambda _: count() >= 2 or None, DEADLINE, every=0.05), 'no recorder'


def written(file: Path) -> list[Recorded]:
    """What a recorder has written so far."""
    return list(read_run(file)) if file.stat().st_size else []


def run_recorded(executives: Any, file: Path, namespace: str, end: int) -> Any:
    """A run of the scripted executive with a decision and its answer; gives the last picture of the console."""
    executives(namespace, heartbeat=0.1)
    with recording(file, namespace) as process, station(namespace) as at:
        view = at.wait(lambda view: view.live and view.behaviors)
        wait_heard(at)
        command = at.requests.start(view, 'Drive')
        at.link.send(command, DEADLINE)
        settled = at.link.settled(command.id, DEADLINE)
        assert settled is not None and settled.state is CommandState.APPLIED
        view = at.wait(lambda view: view.structure and view.decisions and at.mirror.log())
        logs = at.mirror.log()
        sequence = view.snapshot.sequence + 15
        view = at.wait(lambda view: view.snapshot.sequence >= sequence)
        assert at.link.wait_for(lambda _: written(file) or None, DEADLINE, every=0.1), 'nothing is written'
        process.send_signal(end)
        code = process.wait(10)
        assert code == (0 if end == signal.SIGINT else -end)
    return view, logs


def run_replay(*words: str) -> tuple[int, str]:
    err = io.StringIO()
    with contextlib.redirect_stderr(err):
        return replay.main(list(words)), err.getvalue()


def test_the_console_sees_in_a_replay_what_it_saw_of_the_robot(executives: Any, tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    view, logs = run_recorded(executives, file, 'real', signal.SIGINT)
    topics = {one.topic for one in read_run(file)}
    assert topics >= {'executive/status', 'executive/structure', 'executive/behaviors', 'executive/command'}
    with station('again') as at:
        assert run_replay(str(file), '--namespace', 'again', '--rate', '20') == (0, '')
        seen = at.wait(lambda seen: seen.snapshot and seen.snapshot.sequence >= view.snapshot.sequence)
        assert seen.decisions == view.decisions and seen.active_paths == view.active_paths
        assert seen.structure == view.structure and seen.behaviors == view.behaviors
        assert at.mirror.log()[: len(logs)] == logs
        assert 'replay of run.mcap' in behavior_line(seen)


def test_a_recorder_that_is_killed_leaves_what_it_had_written(executives: Any, tmp_path: Path) -> None:
    whole, cut = tmp_path / 'whole.mcap', tmp_path / 'cut.mcap'
    run_recorded(executives, whole, 'killed', signal.SIGINT)
    data = whole.read_bytes()
    messages = list(read_run(whole))
    for size in (len(data) - 1, len(data) - 100, len(data) // 2, 100):
        cut.write_bytes(data[:size])
        left = list(read_run(cut))
        assert left == messages[: len(left)]
        assert (len(left) > len(messages) // 4) == (size > 100)
    other = tmp_path / 'killed.mcap'
    run_recorded(executives, other, 'killed_hard', signal.SIGKILL)
    assert written(other)


def test_a_replay_beside_a_real_executive_is_refused(executives: Any, tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    run_recorded(executives, file, 'taken', signal.SIGINT)
    code, text = run_replay(str(file), '--namespace', 'taken')
    assert code == ExitCode.NO_LINK and '/taken/executive/status' in text


@given(st.binary(max_size=300))
def test_files_that_are_no_recordings_are_refused(data: bytes) -> None:
    file = Path(os.environ.get('TMPDIR', '/tmp')) / f'flexbt_no_recording_{os.getpid()}.mcap'  # noqa: S108 of a test
    file.write_bytes(data)
    try:
        code, text = run_replay(str(file))
    finally:
        file.unlink()
    assert code == ExitCode.USAGE and str(file) in text
    assert run_replay('/nowhere/run.mcap')[0] == ExitCode.USAGE


def test_definitions_have_every_type_that_they_need() -> None:
    from flexbt_common.values import resolve_type

    def types_in(name: str) -> set[str]:
        message: Any = resolve_type(name).message
        inner = {field.split('[')[0].removeprefix('sequence<').split(',')[0].rstrip('>') for field in
                 message.get_fields_and_field_types().values()}  # fmt: skip
        names = {one.replace('/', '/msg/') for one in inner if '/' in one}
        return names.union(*(types_in(one) for one in names))

    for topic in TOPICS.values():
        lines = full_definition(topic.type).splitlines()
        listed = {line.removeprefix('MSG: ') for line in lines if line.startswith('MSG: ')}
        assert listed == {name.replace('/msg/', '/') for name in types_in(topic.type)}
