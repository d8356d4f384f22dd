# SPDX-License-Identifier: BSD-3-Clause
"""Recorded runs: what a console saw of a robot it sees again in the replay; files that were cut off are of use."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import SeekingReader, make_reader
from mcap.writer import CompressionType, Writer
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import Log
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan

from flexbt_common import names
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.middleware.received_messages import Received
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import ExitCode, RefusedError, UsageError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.link.scan_link import MESSAGE_BYTES
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.lanes import Lane, LaneEntry, Lanes
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.present.rendering import behavior_line
from flexbt_console.recording import replay
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.recorder import Recorder
from flexbt_console.recording.run_file import (
    RELATIVE_NAME,
    Recorded,
    RunWriter,
    going_on,
    read_run,
    write_recording,
)
from flexbt_console.recording.topics import TOPICS, full_definition
from flexbt_msgs.msg import ExecutiveLog, ExecutiveStatus, PlaceList
from flexbt_testing.system.fork_server import ForkedProcess
from flexbt_testing.system.python_processes import logged_python_process
from flexbt_testing.waiting import DEADLINE, wait_until


class Station:
    """A console without a user interface."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.mirror = Mirror(runtime.steady)
        self.link = ExecutiveLink(runtime, self.mirror)
        self.requests = CommandBuilder('ann')

    def wait(self, condition: Any) -> Any:
        view = self.link.wait_for(lambda view: view if condition(view) else None, DEADLINE)
        assert view is not None, self.mirror.view()
        return view


@contextmanager
def station(namespace: str) -> Iterator[Station]:
    with NodeRuntime.open('console', namespace=namespace) as runtime:
        yield Station(runtime)


@contextmanager
def recording(file: Path, namespace: str) -> Iterator[ForkedProcess | subprocess.Popen[bytes]]:
    """Provide a recorder, a process, that hears what is said in a namespace."""
    words = ['--ros-args', '-r', f'__ns:=/{namespace}', '-p', f'file:={file}']
    arguments = ['-m', 'flexbt_console.recording.recorder', *words]
    loaded = (
        'flexbt_console.recording.topics',
        'flexbt_console.recording.run_file',
        'flexbt_console.recording.topics',
    )
    process = logged_python_process(arguments, 1, loaded)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def ready_recorder(
    at: Station, file: Path, namespace: str
) -> Iterator[tuple[ForkedProcess | subprocess.Popen[bytes], LivelinessWatch]]:
    """Provide a recorder that has said that it is ready."""
    token = LivelinessWatch(at.runtime, 'recorder', lambda _alive: None)
    wait_until(lambda: not token.ready, 'end of the recorder before')
    with recording(file, namespace) as process:
        wait_until(lambda: token.ready, 'recorder ready')
        yield process, token
        token.close()


def written(file: Path) -> list[Recorded]:
    """Return what a recorder has written so far."""
    return list(read_run(file)) if file.stat().st_size else []


def has_command(id: str, messages: Iterable[Recorded]) -> bool:
    """Return whether a command is among what was recorded."""
    return any(one.topic == 'executive/command' and id.encode() in one.data for one in messages)


def run_recorded(executives: Any, file: Path, namespace: str, end: int) -> Any:
    """Return a run of the scripted executive with a decision and its answer; gives the last picture of the console."""
    executives(namespace, heartbeat=0.1)
    with station(namespace) as at, ready_recorder(at, file, namespace) as (process, _):
        lanes = Lanes(at.mirror)
        view = at.wait(lambda view: view.live and view.behaviors)
        command = at.requests.start(view, 'Drive')
        at.link.send(command, DEADLINE)
        settled = at.link.settled(command.id, DEADLINE)
        assert settled is not None and settled.state is CommandState.APPLIED
        view = at.wait(lambda view: view.structure and view.decisions and at.mirror.log())
        logs = at.mirror.log()
        sequence = view.snapshot.sequence + 15
        view = at.wait(lambda view: view.snapshot.sequence >= sequence)
        at.wait(lambda view: view.snapshot.sequence >= sequence + 10)  # that the recorder has heard it, too
        assert at.link.wait_for(lambda _: written(file) or None, DEADLINE, every=0.1), 'nothing is written'
        process.send_signal(end)
        code = process.wait(DEADLINE)
        assert code == (0 if end == signal.SIGINT else -end)
    return view, logs, lanes.since()


def lanes_of(entries: Iterable[LaneEntry]) -> list[tuple[object, ...]]:
    """Return what is in lanes, without the times of arrival, which differ from one receiver to another."""
    return sorted((one.lane, one.key, one.label, one.word, one.tone, one.text, one.end is None) for one in entries)


def run_replay(*words: str) -> tuple[int, str]:
    err = io.StringIO()
    with contextlib.redirect_stderr(err):
        return replay.main(list(words)), err.getvalue()


def test_the_console_sees_in_a_replay_what_it_saw_of_the_robot(executives: Any, tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    view, logs, _ = run_recorded(executives, file, 'real', signal.SIGINT)
    topics = {one.topic for one in read_run(file)}
    assert topics >= {'executive/status', 'executive/structure', 'executive/behaviors', 'executive/command'}
    with station('again') as at:
        assert run_replay(str(file), '--namespace', 'again', '--rate', '20') == (0, '')
        seen = at.wait(lambda seen: seen.snapshot and seen.snapshot.sequence >= view.snapshot.sequence)
        assert seen.decisions == view.decisions and seen.active_paths == view.active_paths
        assert seen.structure == view.structure and seen.behaviors == view.behaviors
        assert at.mirror.log()[: len(logs)] == logs
        assert 'replay of run.mcap' in behavior_line(seen)


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        ('--start nan', "'nan' is not a time from 0 on, s"),
        ('--start -5', "'-5' is not a time from 0 on, s"),
        ('--rate x', "'x' is not a factor above 0"),
        ('--rate 0', "'0' is not a factor above 0"),
    ],
)
def test_a_replay_has_a_rate_and_a_start(capsys: pytest.CaptureFixture[str], words: str, told: str) -> None:
    with pytest.raises(SystemExit):
        replay.main(['run.mcap', *words.split()])
    assert told in capsys.readouterr().err


def test_what_is_searched_for_is_found_in_any_case_of_its_letters(tmp_path: Path) -> None:
    topic, type = names.EXECUTIVE_LOG, TOPICS[names.EXECUTIVE_LOG].type
    with contextlib.closing(RunWriter(tmp_path / 'run.mcap')) as writer:
        writer.add_topic(topic, f'/{topic}', type, full_definition(type))
        for second, text in enumerate(('f\u00e4hrt', 'der Motor ist \u00dcBERHITZT', 'steht')):
            line = ExecutiveLog(executive_id='e', sequence=second, text=text)
            writer.add(topic, serialize_message(line), second * 10**9, second * 10**9)
    player = RunPlayer(tmp_path / 'run.mcap')
    player.go_to(player.find('motor ist \u00fcberhitzt'))
    assert player.time == pytest.approx(1.0, abs=0.1)


def replayed(file: Path, *messages: tuple[str, float]) -> list[tuple[str, float]]:
    """Record messages of topics at times, s, in this order; return what is read of it, by the time."""
    types = {names.EXECUTIVE_LOG: ExecutiveLog, names.EXECUTIVE_STATUS: ExecutiveStatus, names.PLACES: PlaceList}
    write_recording(file, [(int(time * 1e9), topic, types[topic]()) for topic, time in messages])
    known = sorted(going_on(read_run(file)), key=lambda one: one.time)
    return [(one.topic, one.time / 1e9) for one in known]


@given(back=st.floats(13.0, 1e6), between=st.sampled_from([(), (names.PLACES,), (names.PLACES, names.EXECUTIVE_LOG)]))
def test_what_was_recorded_after_the_clock_was_set_back_comes_later(back: float, between: tuple[str, ...]) -> None:
    status, begin = names.EXECUTIVE_STATUS, 1.7e9
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'run.mcap'
        before = [(names.EXECUTIVE_LOG, begin), (status, begin + 1.0), (status, begin + 2.0)]
        after = [*((topic, 3.0) for topic in between), *((status, 4.0 + number) for number in range(3))]
        read = replayed(file, *before, *((topic, begin + time - back) for topic, time in after))
    assert [topic for topic, _ in read[:3]] == [topic for topic, _ in before]
    assert [topic for topic, _ in read if topic == status] == [status] * 5
    assert sorted(topic for topic, _ in read[3:]) == sorted(topic for topic, _ in after)
    assert 0.0 <= read[-1][1] - read[2][1] < 5.0


def test_what_waited_while_the_recorder_stood_still_is_in_its_place(tmp_path: Path) -> None:
    """It takes the messages of one topic after those of another."""
    topics = names.EXECUTIVE_STATUS, names.EXECUTIVE_LOG, names.PLACES
    backlog = [(topic, 100.0 + second) for topic in topics for second in range(60)]
    for first in ([], [(topic, 99.0) for topic in topics]):
        messages = [*first, *backlog, (names.EXECUTIVE_STATUS, 161.0)]
        read = replayed(tmp_path / f'{len(first)}.mcap', *messages)
        assert read == sorted(messages, key=lambda one: one[1])


def test_in_memory_messages_are_as_large_as_in_the_file(tmp_path: Path) -> None:
    """The definition of a type is some kilobytes, more than most of its messages."""
    lines = [(number, names.EXECUTIVE_LOG, ExecutiveLog(sequence=number, text='drives')) for number in range(1000)]
    write_recording(tmp_path / 'run.mcap', lines)
    messages = list(read_run(tmp_path / 'run.mcap'))
    held = {id(part): sys.getsizeof(part) for one in messages for part in (one.definition, one.data, one.topic)}
    assert sum(held.values()) < 2 * sum(len(one.data) + sys.getsizeof(b'') for one in messages)


def test_a_recording_of_another_version_is_read_as_long_as_the_fields_are_the_same(tmp_path: Path) -> None:
    topic, type = names.EXECUTIVE_LOG, TOPICS[names.EXECUTIVE_LOG].type
    now = full_definition(type)
    others = (
        now.replace('#', '# once:') + '\nuint8 DEBUG = 99  # a constant',
        now + '\nuint8 kind',
        now.replace('text', 'line'),
    )
    for number, definition in enumerate(others):
        file = tmp_path / f'{number}.mcap'
        with contextlib.closing(RunWriter(file)) as writer:
            writer.add_topic(topic, f'/{topic}', type, definition)
            writer.add(topic, serialize_message(ExecutiveLog(executive_id='e', sequence=1, text='drives')), 0, 0)
        with pytest.raises(UsageError, match='other fields') if number else contextlib.nullcontext():
            assert [line.text for line in RunPlayer(file).mirror.log()] == ['drives']


def test_a_player_shows_each_moment_as_it_was_also_going_back(executives: Any, tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    view, logs, lanes = run_recorded(executives, file, 'played', signal.SIGINT)
    player = RunPlayer(file)
    assert lanes_of(player.lanes().since()) == lanes_of(lanes)  # as they were live
    assert {one.lane for one in lanes} >= {Lane.STATES, Lane.DECISIONS}
    player.go_to(player.duration)
    seen = player.mirror.view()
    assert seen.live and seen.decisions == view.decisions and seen.structure == view.structure
    assert player.mirror.log()[: len(logs)] == logs
    player.go_to(player.next_said(-1))
    before = player.mirror.view().snapshot
    assert before is not None and seen.snapshot is not None and before.sequence < seen.snapshot.sequence
    player.go_to(0.0)
    player.go_to(player.find('AskGoal'))
    found = player.time
    said = [*player.mirror.view().active_paths, *(line.text for line in player.mirror.log())]
    assert found > 0.0 and any('AskGoal' in text for text in said)
    with pytest.raises(RefusedError, match='nothing has'):
        player.find('what nobody has said')
    assert player.time == found


def indexed(file: Path) -> list[tuple[str, bytes]]:
    """Topics and messages as a reader finds them by the index."""
    with file.open('rb') as stream:
        reader = make_reader(stream)
        assert isinstance(reader, SeekingReader)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None and summary.chunk_indexes
        messages = [(channel.topic, message.data) for _, channel, message in reader.iter_messages()]
        assert len(messages) == summary.statistics.message_count
    return messages


FULL_DISK = """
import random, resource, sys
from pathlib import Path
from flexbt_console.recording import run_file
run_file.MOST_WAITING = 50_000
def limit(most):
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
def write(file, number):
    limit(5000)
    writer = run_file.RunWriter(file)
    writer.add_topic('topic', '/topic', 'std_msgs/msg/String', 'string data')
    try:
        for at in range(number):
            writer.add('topic', at.to_bytes(4, 'big') + random.randbytes(60), at, at)
    finally:
        assert writer.problem is not None
        limit(resource.RLIM_INFINITY)
        writer.close()
write(Path(sys.argv[1]), 300)
try:
    write(Path(sys.argv[2]), 3000)
except OSError:
    print('more than may wait')
"""


def test_what_a_full_disk_does_not_take_waits_up_to_a_bound(tmp_path: Path) -> None:
    room, full = tmp_path / 'room.mcap', tmp_path / 'full.mcap'
    command = [sys.executable, '-c', FULL_DISK, str(room), str(full)]
    told = subprocess.run(command, check=True, timeout=DEADLINE, env=os.environ, capture_output=True, text=True)
    assert told.stdout == 'more than may wait\n'
    assert [int.from_bytes(data[:4]) for _, data in indexed(room)] == list(range(300))
    kept = [int.from_bytes(one.data[:4]) for one in read_run(full)]
    assert kept == list(range(len(kept)))
    assert 300 < len(kept) < 3000


def test_a_disk_that_gets_full_is_waited_for_and_one_that_stays_so_ends_the_file_after_a_whole_record(
    executives: Any, tmp_path: Path
) -> None:
    executives('full', heartbeat=0.01)
    file, recovered = tmp_path / 'full.mcap', tmp_path / 'recovered.mcap'
    with station('full') as at, ready_recorder(at, file, 'full') as (process, token):
        wait_until(lambda: written(file), 'first messages')
        for is_last in (False, True):
            size = file.stat().st_size + 2000
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
            wait_until(lambda: not token.ready, 'recorder not ready')
            if not is_last:
                everything = resource.RLIM_INFINITY, resource.RLIM_INFINITY
                resource.prlimit(process.pid, resource.RLIMIT_FSIZE, everything)
                wait_until(lambda: token.ready, 'recorder ready again')
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE) == 1
    assert file.stat().st_size <= size
    assert run_replay(str(file), '--recover', str(recovered)) == (0, '')
    assert len(indexed(recovered)) == len(written(file)) > 0


def test_what_is_said_once_the_recorder_is_ready_is_recorded(executives: Any, tmp_path: Path) -> None:
    executives('early', heartbeat=1.0)
    with station('early') as at:
        view = at.wait(lambda view: view.live and view.behaviors)
        for number in range(3):
            file = tmp_path / f'{number}.mcap'
            with ready_recorder(at, file, 'early') as (process, _):
                command = at.requests.start(view, 'Drive')
                at.link.send(command, DEADLINE)
                assert at.link.settled(command.id, DEADLINE) is not None
                wait_until(lambda: has_command(command.id, written(file)), 'the command')  # noqa: B023  # at once
                process.send_signal(signal.SIGINT)
                process.wait(DEADLINE)
            assert has_command(command.id, read_run(file))


def test_what_has_arrived_when_the_recorder_is_told_to_end_is_recorded(tmp_path: Path) -> None:
    with station('planned') as at:
        topic, node, plan = TOPICS[names.PLAN], at.runtime.node, PathMessage()
        paths = at.runtime.call(lambda: node.create_publisher(PathMessage, names.PLAN, topic.qos))
        for number in range(3):
            file = tmp_path / f'{number}.mcap'
            with ready_recorder(at, file, 'planned') as (process, _):
                plan.header.frame_id = f'map {number}'
                paths.publish(plan)
                assert paths.wait_for_all_acked(Duration(seconds=DEADLINE))
                process.send_signal(signal.SIGINT)
                process.wait(DEADLINE)
            assert [one.topic for one in read_run(file) if f'map {number}'.encode() in one.data] == [names.PLAN]


def test_a_file_has_an_index_and_one_whose_recorder_was_killed_gets_it(executives: Any, tmp_path: Path) -> None:
    whole, cut = tmp_path / 'whole.mcap', tmp_path / 'cut.mcap'
    run_recorded(executives, whole, 'ended', signal.SIGINT)
    data = whole.read_bytes()
    messages = list(read_run(whole))
    assert sorted(indexed(whole)) == sorted((one.resolved, one.data) for one in messages)
    for size in (len(data) - 1, len(data) - 100, len(data) // 2, 100):
        cut.write_bytes(data[:size])
        left = list(read_run(cut))
        assert left == messages[: len(left)]
        assert (len(left) > len(messages) // 4) == (size > 100)
    killed, recovered = tmp_path / 'killed.mcap', tmp_path / 'recovered.mcap'
    run_recorded(executives, killed, 'killed', signal.SIGKILL)
    with killed.open('rb') as stream, pytest.raises(McapError):
        SeekingReader(stream).get_summary()
    assert run_replay(str(killed), '--recover', str(recovered)) == (0, '')
    assert written(killed) == list(read_run(recovered))
    assert sorted(indexed(recovered)) == sorted((one.resolved, one.data) for one in written(killed))
    code, text = run_replay(str(killed), '--recover', str(recovered))
    assert code == ExitCode.USAGE and str(recovered) in text


def test_a_replay_beside_a_real_executive_is_refused(executives: Any, tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    run_recorded(executives, file, 'taken', signal.SIGINT)
    code, text = run_replay(str(file), '--namespace', 'taken')
    assert code == ExitCode.NO_LINK and '/taken/executive/status' in text


def test_a_replay_leaves_out_the_further_topics_of_a_black_box(tmp_path: Path) -> None:
    file, type = tmp_path / 'run.mcap', 'rcl_interfaces/msg/Log'
    with contextlib.closing(RunWriter(file)) as writer:
        writer.add_topic('/rosout', '/rosout', type, full_definition(type))
        writer.add('/rosout', serialize_message(Log(msg='hello')), 0, 0)
        writer.add_topic(names.PLACES, '/places', TOPICS[names.PLACES].type, full_definition(TOPICS[names.PLACES].type))
        writer.add(names.PLACES, serialize_message(PlaceList()), 1, 1)
    assert run_replay(str(file), '--namespace', 'further') == (0, '')


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 60])
def test_a_replay_leaves_out_a_status_that_cannot_be_read(data: bytes, tmp_path: Path) -> None:
    file, status = tmp_path / 'run.mcap', names.EXECUTIVE_STATUS
    with contextlib.closing(RunWriter(file)) as writer:
        writer.add_topic(status, f'/{status}', TOPICS[status].type, full_definition(TOPICS[status].type))
        for at, one in enumerate((data, serialize_message(ExecutiveStatus()))):
            writer.add(status, one, at, at)
    assert replay.replay(file, namespace='unread') == 1


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
    from flexbt_common.values.value_types import resolve_type

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


def test_of_scans_some_are_recorded_and_none_that_is_huge(tmp_path: Path) -> None:
    with (
        contextlib.closing(RunWriter(tmp_path / 'run.mcap')) as writer,
        NodeRuntime.open('lidar', namespace='/scanned') as far,
        NodeRuntime.open('hears', namespace='/scanned') as near,
    ):
        topic = TOPICS[names.SCAN]
        scans = far.call(lambda: far.node.create_publisher(LaserScan, names.SCAN, topic.qos))
        recorder = near.call(lambda: Recorder(near, writer, lambda is_ready: None))
        wait_until(lambda: scans.get_subscription_count() > 0, 'the recorder')
        begin = far.steady.now()
        heard: list[str] = []
        add = writer.add

        def note(topic: str, data: bytes, *when: int) -> None:
            heard.append(topic)
            add(topic, data, *when)

        writer.add = note  # type: ignore[method-assign, assignment]
        huge = Received(bytes(MESSAGE_BYTES + 1), MESSAGE_BYTES + 1, b'', 0.0)
        near.call(lambda: recorder._callback_of(names.SCAN)(huge))
        assert heard == []
        sent = 0

        def are_heard() -> bool:
            nonlocal sent
            sent += 1
            scans.publish(LaserScan(ranges=[1.0]))
            return len(heard) >= 2

        wait_until(are_heard, 'two scans')
        most = 1 + (far.steady.now() - begin) / topic.period
    assert len(heard) <= most < sent
    assert [one.topic for one in read_run(tmp_path / 'run.mcap')] == heard


def compressed(file: Path, compression: CompressionType, messages: int, size: int) -> Path:
    """Return a file whose one chunk is small, and holds much."""
    with file.open('wb') as stream:
        writer = Writer(stream, chunk_size=10**10, compression=compression)
        writer.start(profile='ros2', library='test')
        topic = TOPICS[names.EXECUTIVE_LOG]
        schema = writer.register_schema(topic.type, 'ros2msg', full_definition(topic.type).encode())
        channel = writer.register_channel(
            names.EXECUTIVE_LOG, 'cdr', schema, {RELATIVE_NAME: names.EXECUTIVE_LOG, 'offered_qos_profiles': ''}
        )
        for number in range(messages):
            writer.add_message(channel, number, bytes(size), number)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


@pytest.mark.parametrize('compression', [CompressionType.ZSTD, CompressionType.LZ4])
def test_a_small_file_that_stands_for_a_huge_one_is_refused(compression: CompressionType, tmp_path: Path) -> None:
    file = compressed(tmp_path / 'bomb.mcap', compression, messages=70, size=1_000_000)
    assert file.stat().st_size < 1_000_000
    with pytest.raises(UsageError, match='more than 64 MB'):
        list(read_run(file))
    whole = compressed(tmp_path / 'large.mcap', compression, messages=50, size=1_000_000)
    assert sum(len(one.data) for one in read_run(whole)) == 50_000_000


def test_messages_that_take_too_much_memory_are_not_kept(tmp_path: Path) -> None:
    file = compressed(tmp_path / 'many.mcap', CompressionType.ZSTD, messages=10_000, size=0)
    with pytest.raises(UsageError, match='take more than 1 MB'):
        RunPlayer(file, 1_000_000)


def test_a_recording_is_for_the_user_alone_and_a_pipe_is_none(tmp_path: Path) -> None:
    with contextlib.closing(RunWriter(tmp_path / 'run.mcap')):
        assert (tmp_path / 'run.mcap').stat().st_mode & 0o777 == 0o600
    os.mkfifo(tmp_path / 'pipe.mcap')
    with pytest.raises(UsageError, match='regular file'):
        list(read_run(tmp_path / 'pipe.mcap'))


def test_a_flood_of_one_topic_costs_a_bounded_rate_and_the_others_are_recorded(tmp_path: Path) -> None:
    ready: list[bool] = []
    with (
        contextlib.closing(RunWriter(tmp_path / 'run.mcap')) as writer,
        NodeRuntime.open('sends', namespace='/flooded') as far,
        NodeRuntime.open('hears', namespace='/flooded') as near,
    ):
        log = TOPICS[names.EXECUTIVE_LOG]
        lines = far.call(lambda: far.node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, log.qos))
        places = far.call(lambda: far.node.create_publisher(PlaceList, names.PLACES, TOPICS[names.PLACES].qos))
        near.call(lambda: Recorder(near, writer, ready.append, max_size=20_000_000))
        wait_until(lambda: lines.get_subscription_count() and places.get_subscription_count(), 'the recorder')
        text = os.urandom(100_000).hex()  # which does not compress to nothing
        before = far.steady.now()
        for _ in range(100):
            lines.publish(ExecutiveLog(text=text))
        places.publish(PlaceList())
        size = writer.size
        wait_until(lambda: names.PLACES in {one.topic for one in read_run(tmp_path / 'run.mcap')}, 'the places')
        took = far.steady.now() - before
        assert size <= writer.size <= 5_200_000 + took * 500_000


def test_a_recording_that_has_its_size_ends_and_says_so(tmp_path: Path) -> None:
    ready: list[bool] = []
    with (
        contextlib.closing(RunWriter(tmp_path / 'run.mcap')) as writer,
        NodeRuntime.open('sends', namespace='/sized') as far,
        NodeRuntime.open('hears', namespace='/sized') as near,
    ):
        log = TOPICS[names.EXECUTIVE_LOG]
        lines = far.call(lambda: far.node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, log.qos))
        near.call(lambda: Recorder(near, writer, ready.append, max_size=100_000))
        wait_until(lines.get_subscription_count, 'the recorder')

        def has_ended() -> bool:
            lines.publish(ExecutiveLog(text=os.urandom(50_000).hex()))
            return near.has_failed

        wait_until(has_ended, 'the end')
        assert ready[-1] is False
        assert writer.size < 500_000
