# SPDX-License-Identifier: BSD-3-Clause
"""The black box: a ring that always has the last minutes, and incidents that are whole or not there, whatever dies."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given, settings
from hypothesis import strategies as st
from nav2_msgs.action import Wait
from nav_msgs.msg import Path as PathMessage
from rclpy.action import ActionServer
from rclpy.duration import Duration
from rclpy.qos import qos_profile_action_status_default
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger
from unique_identifier_msgs.msg import UUID

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.middleware.received_messages import Received
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.errors import UsageError
from flexbt_console.recording import black_box
from flexbt_console.recording.black_box import COMES_SECONDS, MOST_TOLD, SAME_SECONDS, BlackBox, Detector, Settings
from flexbt_console.recording.incidents import (
    FACTS,
    PAGE,
    Occurrence,
    Request,
    incident_named,
    incidents_in,
    make,
    merge,
)
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.ring import Ring
from flexbt_console.recording.run_file import RECORDING, read_run
from flexbt_console.recording.topics import TOPICS, full_definition
from flexbt_console.ui.console import main as console
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveEvent, ExecutiveEvents, ExecutiveLog, ExecutiveStatus, PeerStatus
from flexbt_testing.system.fork_server import ForkedProcess
from flexbt_testing.system.python_processes import logged_python_process
from flexbt_testing.waiting import DEADLINE, wait_until

SECOND = 10**9
HEARTBEAT = 0.2
"""Time between two statuses of the robot, s: the black box records each."""
BLACK_BOX = 'flexbt_console.recording.black_box'
LOG, TEXT = names.EXECUTIVE_STATUS, 'chatter'


def filled_ring(directory: Path, now: list[int], seconds: float = 8.0, size: int = 10**7) -> Ring:
    ring = Ring(directory, seconds, size, lambda: now[0])
    ring.add_topic(LOG, f'/{LOG}', TOPICS[LOG].type, full_definition(TOPICS[LOG].type))
    ring.add_topic(TEXT, f'/{TEXT}', 'std_msgs/msg/String', full_definition('std_msgs/msg/String'))
    return ring


@settings(deadline=None, max_examples=30)
@given(data=st.data())
def test_the_ring_has_all_of_the_last_seconds_and_what_was_latched(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Also if it is killed, without the end of its last file, and while files are held."""
    now, directory = [10**18], tmp_path_factory.mktemp('ring') / 'robot'
    ring, sent = filled_ring(directory, now), []
    for number in range(data.draw(st.integers(1, 60))):
        now[0] += data.draw(st.integers(1, 2 * SECOND))
        topic = data.draw(st.sampled_from([LOG, TEXT]))
        ring.add(topic, serialize_message(String(data=str(number))), now[0], now[0])
        sent.append((topic, number, now[0]))
        if data.draw(st.booleans()):
            ring.hold('one', frozenset(map(str, ring.files()[:1])))
    files = ring.files()
    ring.roll()  # a kill loses what was not compressed yet; the rest is the same
    whole = directory / 'whole.mcap'
    assert merge(files, whole) == []
    merged = list(read_run(whole))
    got = [(one.topic, one.time) for one in merged]
    window = [one for one in sent if one[2] >= now[0] - 8 * SECOND]
    for topic, _, at in window:
        assert (topic, at) in got, 'what is within the time of the ring is there'
    latched = [one for one in sent if one[0] == LOG]
    if latched:
        known = [one.data for one in merged if one.topic == LOG]
        assert known[-1] == serialize_message(String(data=str(latched[-1][1]))), 'a late subscriber would have got it'
    assert len(files) <= 8 + 3 + 1, 'and not much more than that'
    assert len(got) == len(set(got)), 'nothing twice'


def test_what_is_held_for_an_earlier_incident_is_not_in_a_later_one(tmp_path: Path) -> None:
    """It may be of another version, and held until its own incident can be made."""
    now = [10**18]
    ring = filled_ring(tmp_path / 'robot', now)
    for number in range(3):
        ring.add(TEXT, serialize_message(String(data=str(number))), now[0], now[0])
        ring.hold(str(number), frozenset(map(str, ring.files())))
        now[0] += 100 * SECOND
        ring.roll()
    assert len(ring.files()) == 4
    assert [int(one.stem) for one in ring.files(now[0] / 1e9 - 8.0)] == [now[0] - 100 * SECOND, now[0]]


def test_what_late_subscribers_get_is_known_also_behind_a_gap_in_the_ring(tmp_path: Path) -> None:
    """A file is held while the next ones had to go, since there was too much."""
    now = [10**18]
    ring, chance = filled_ring(tmp_path / 'robot', now, seconds=100.0, size=1_000_000), random.Random(1)
    for number in range(100):
        now[0] += SECOND
        if number in (0, 20):
            ring.add(LOG, serialize_message(String(data=str(number))), now[0], now[0])
        ring.add(TEXT, serialize_message(String(data=chance.randbytes(20_000).hex())), now[0], now[0])
        if number == 10:
            ring.hold('earlier', frozenset(map(str, ring.files()[:1])))
    ring.roll()
    files = ring.files()[:-1]
    merge(files, tmp_path / 'whole.mcap')
    known = [one for one in read_run(tmp_path / 'whole.mcap') if one.topic == LOG]
    assert [one.data for one in known] == [serialize_message(String(data=text)) for text in ('0', '20')]
    assert known[-1].time == int(files[1].stem)


def test_a_clock_that_is_set_back_leaves_the_ring_whole_and_in_its_order(tmp_path: Path) -> None:
    now = [10**18]
    ring = filled_ring(tmp_path / 'robot', now)

    def goes_on(ring: Ring) -> list[int]:
        times = []
        for _ in range(20):
            now[0] += SECOND // 2
            ring.add(TEXT, serialize_message(String(data='x')), now[0], now[0])
            times.append(now[0])
        return times

    def has_the_last_seconds(ring: Ring, times: list[int], name: str) -> None:
        ring.roll()
        assert len(ring.files()) <= 8 + 3
        merge(ring.files(), tmp_path / name)
        recorded = list(read_run(tmp_path / name))
        window = [one for one in times if one >= now[0] - 8 * SECOND]
        assert [one.time for one in recorded if one.topic == TEXT][-len(window) :] == window
        assert max(one.time for one in recorded) == now[0]
        assert [one.topic for one in recorded].count(LOG) == (name == 'one.mcap')

    ring.add(LOG, serialize_message(String(data='latched')), now[0], now[0])
    goes_on(ring)
    now[0] -= 3600 * SECOND
    ring.add(TEXT, serialize_message(String(data='it waited')), now[0] + 3600 * SECOND, now[0])
    has_the_last_seconds(ring, goes_on(ring), 'one.mcap')
    killed(ring)
    now[0] -= 3600 * SECOND
    ring = filled_ring(tmp_path / 'robot', now)
    has_the_last_seconds(ring, goes_on(ring), 'other.mcap')
    ring.close(keep=False)


def test_the_ring_is_bounded_and_one_for_each_robot(tmp_path: Path) -> None:
    now = [10**18]
    ring = filled_ring(tmp_path / 'robot', now, seconds=3600.0, size=2_000_000)
    chance = random.Random(1)
    for _ in range(200):
        now[0] += SECOND
        ring.add(TEXT, serialize_message(String(data=chance.randbytes(40_000).hex())), now[0], now[0])
    assert sum(file.stat().st_size for file in ring.files()) < 2 * 2_000_000
    with pytest.raises(UsageError, match='another black box of this robot uses it'):
        Ring(tmp_path / 'robot', 1.0, 10**6)
    ring.close(keep=False)
    ring.add(TEXT, serialize_message(String(data='late')), now[0], now[0])
    assert ring.files() == []
    (tmp_path / 'open').mkdir()
    (tmp_path / 'open').chmod(0o777)
    with pytest.raises(UsageError, match='can be changed by other users'):
        Ring(tmp_path / 'open' / 'robot', 1.0, 10**6)


def test_a_ring_whose_files_begin_with_much_turns_no_more_often(tmp_path: Path) -> None:
    """Else each message would begin a file, and the ring would have the last moment alone."""
    now = [10**18]
    ring = filled_ring(tmp_path / 'robot', now, seconds=3600.0, size=1_000_000)
    ring.add(LOG, serialize_message(String(data=random.Random(1).randbytes(200_000).hex())), now[0], now[0])
    begin = now[0]
    for _ in range(100):
        now[0] += SECOND
        ring.add(TEXT, serialize_message(String(data='x')), now[0], now[0])
    assert len(ring.files()) == 2 and int(ring.files()[0].stem) == begin
    ring.close(keep=False)


class Robot:
    """A robot that says what the test wants, and a black box in a process of its own."""

    def __init__(self, runtime: NodeRuntime, folder: Path) -> None:
        self.runtime, self.incidents = runtime, folder / 'incidents'
        self._ring = folder / 'ring'
        self._sequence = 0
        node = runtime.node
        self._events, self._log, self._status = runtime.call(
            lambda: (
                node.create_publisher(ExecutiveEvents, names.EXECUTIVE_EVENTS, names.transient_local_qos(20)),
                node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, names.transient_local_qos(names.LOG_DEPTH)),
                node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, names.transient_local_qos()),
            )
        )
        self.peers: list[PeerStatus] = []
        self.processes: list[ForkedProcess | subprocess.Popen[bytes]] = []
        self.process = self.start_box()

    def start_box(self) -> ForkedProcess | subprocess.Popen[bytes]:
        """Return a black box that has begun to record."""
        parameters = [
            f'incidents:={self.incidents}',
            f'ring:={self._ring}',
            f'records:=["{self._ring.parent}"]',
            'after:=0.5',
        ]
        words = [word for one in parameters for word in ('-p', one)]
        space = ['-r', f'__ns:={self.runtime.node.get_namespace()}']
        self.said = self._ring.parent / f'said_{len(self.processes)}.log'
        with self.said.open('wb') as output:
            arguments = ['-m', BLACK_BOX, '--ros-args', *space, *words]
            self.process = logged_python_process(arguments, output.fileno(), [BLACK_BOX])
        self.processes.append(self.process)
        node = self.runtime.node
        wait_until(lambda: node.count_subscribers(f'{node.get_namespace()}/{names.MAP}') > 0, 'the black box')
        return self.process

    def says(self) -> None:
        """Send a status, as a heartbeat."""
        self._sequence += 1
        now = self.runtime.clock.stamp()
        self.runtime.call(
            lambda: self._status.publish(
                ExecutiveStatus(
                    stamp=now,
                    executive_id='e',
                    sequence=self._sequence,
                    heartbeat_period=0.5,
                    state=ExecutiveStatus.IDLE,
                    peers=self.peers,
                )
            )
        )

    def tells(self, text: str, severity: int = ExecutiveLog.ERROR) -> None:
        self._sequence += 1
        line = ExecutiveLog(executive_id='e', sequence=self._sequence, severity=severity, text=text)
        self.runtime.call(lambda: self._log.publish(line))

    def did(self, **event: Any) -> None:
        self._sequence += 1
        message = ExecutiveEvents(executive_id='e', first=self._sequence, events=[ExecutiveEvent(**event)])
        self.runtime.call(lambda: self._events.publish(message))

    def has(self, kind: str, *texts: str) -> bool:
        """Return whether there is an incident of a kind with these texts on its page."""
        for one in incidents_in(self.incidents):
            page = (one.folder / PAGE).read_text()
            if any(found.kind == kind for found in one.occurrences) and all(text in page for text in texts):
                return True
        return False

    def end(self) -> None:
        for one in self.processes:
            one.kill()
            one.wait()


@pytest.fixture
def robot(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Robot]:
    with NodeRuntime.open('robot', namespace=f'box{os.getpid()}_{abs(hash(request.node.name)) % 10**6}') as runtime:
        made = Robot(runtime, tmp_path)
        try:
            yield made
        finally:
            made.end()


def settled(robot: Robot) -> None:
    """Wait until what is said counts as of now."""
    wait_until(lambda: 'begins to find incidents' in robot.said.read_text(), robot.said.read_text, 2 * DEADLINE)


def until_incident(robot: Robot, kind: str, *texts: str, doing: Callable[[], object] = lambda: None) -> None:
    def look() -> bool:
        robot.says()
        doing()
        return robot.has(kind, *texts)

    wait_until(look, f'an incident {kind} with {texts}', 2 * DEADLINE, HEARTBEAT)


def test_each_kind_of_thing_that_goes_wrong_is_in_an_incident(robot: Robot) -> None:
    node = robot.runtime.node
    robot.says()
    robot.tells('an old error that a late subscriber gets')
    settled(robot)
    robot.peers = [PeerStatus(name='/arm', alive=True, ready=True, expected=True)]
    robot.says()
    robot.tells('state Grasp raised ValueError: no grip')
    robot.tells('the gripper is gone')
    robot.did(
        kind=ExecutiveEvent.COMMAND, command='FORCE', path='/Drive', outcome='failed', operator_id='ann', applied=True
    )
    robot.peers = [PeerStatus(name='/arm', alive=False, expected=True, problem='it crashed')]
    robot.says()
    stops = robot.runtime.call(lambda: node.create_publisher(ExecutiveCommand, names.EXECUTIVE_STOP, names.stop_qos()))
    wait_until(lambda: stops.get_subscription_count() > 0, 'who hears STOP')
    stops.publish(ExecutiveCommand(id='1', kind=ExecutiveCommand.STOP, operator_id='bob'))
    battery = robot.runtime.call(lambda: node.create_publisher(BatteryState, names.BATTERY_STATE, 1))
    until_incident(robot, 'fault', 'no grip', 'fault     the gripper is gone')
    until_incident(robot, 'forced', 'ann: force failed', '/Drive')
    until_incident(robot, 'node', '/arm is gone: it crashed')
    until_incident(robot, 'stop', 'STOP by bob')
    low = BatteryState(percentage=0.09)
    until_incident(robot, 'battery', 'the battery is at 9 %', doing=lambda: battery.publish(low))
    assert not robot.has('fault', '  fault     an old error')
    newest = incident_named(robot.incidents, '')
    player = RunPlayer(newest.folder / RECORDING)
    player.go_to(player.duration)
    assert any('no grip' in line.text for line in player.mirror.log())
    assert (newest.folder / 'timeline.svg').exists() and (newest.folder / 'incident.html').exists()
    assert newest.folder.stat().st_mode & 0o077 == 0


def test_an_incident_has_the_parameters_of_the_nodes_that_answer(robot: Robot) -> None:
    node = robot.runtime.node
    own = node.get_fully_qualified_name()
    robot.peers = [PeerStatus(name=own, alive=True), PeerStatus(name='/nobody', alive=True)]
    robot.says()
    settled(robot)
    client = robot.runtime.call(lambda: node.create_client(Trigger, names.WRITE_INCIDENT))
    wait_until(client.service_is_ready, 'the black box')

    asked = 0

    def has_them() -> bool:  # an incident that ends soon may not have them all
        nonlocal asked
        robot.says()
        found = [json.loads((one.folder / 'parameters.json').read_text()) for one in incidents_in(robot.incidents)]
        if len(found) == asked:
            robot.runtime.call(lambda: client.call_async(Trigger.Request()))
            asked += 1
        assert all(one.keys() <= {own} for one in found)
        return any(one.get(own, {}).get('use_sim_time') is False for one in found)

    wait_until(has_them, 'the parameters', 2 * DEADLINE, HEARTBEAT)


def test_an_aborted_goal_and_a_silent_executive(robot: Robot) -> None:
    node = robot.runtime.node
    robot.says()
    settled(robot)
    server = robot.runtime.call(lambda: ActionServer(node, Wait, 'wait', lambda goal: goal.abort()))
    other = robot.runtime.call(
        lambda: node.create_publisher(GoalStatusArray, 'wait/_action/status', qos_profile_action_status_default)
    )
    wait_until(lambda: other.get_subscription_count() > 0, 'who hears of the action')

    def abort() -> None:
        info = GoalInfo(goal_id=UUID(uuid=list(os.urandom(16))))
        other.publish(GoalStatusArray(status_list=[GoalStatus(goal_info=info, status=GoalStatus.STATUS_ABORTED)]))

    until_incident(robot, 'goal', '/wait has aborted a goal', doing=abort)
    wait_until(lambda: robot.has('link', 'the executive is silent or gone'), 'the silence', 2 * DEADLINE, HEARTBEAT)
    robot.runtime.call(server.destroy)


def test_a_black_box_that_is_killed_loses_neither_the_incident_nor_the_recording(robot: Robot) -> None:
    robot.says()
    settled(robot)
    robot.tells('first words')
    robot.tells('it burns')
    ring = robot._ring / robot.runtime.node.get_namespace().strip('/')

    def is_noted() -> bool:
        return any('it burns' in file.read_text() for file in ring.glob('*.request.json'))

    wait_until(is_noted, 'the incident noted')
    robot.process.kill()
    robot.process.wait()
    robot.start_box()
    until_incident(robot, 'fault', 'it burns')
    robot.process.kill()
    robot.process.wait()
    robot.start_box()
    until_incident(robot, 'black_box', 'the black box itself was killed')


def test_a_black_box_that_ends_in_order_was_not_killed(robot: Robot) -> None:
    """Though what is left of its ring is needed for an incident that is not made yet."""
    robot.says()
    settled(robot)
    robot.tells('it burns')
    ring = robot._ring / robot.runtime.node.get_namespace().strip('/')
    wait_until(lambda: list(ring.glob('*.request.json')), 'the incident noted')
    node, plan = robot.runtime.node, PathMessage(header=Header(frame_id='the last map'))
    paths = robot.runtime.call(lambda: node.create_publisher(PathMessage, names.PLAN, TOPICS[names.PLAN].qos))
    wait_until(lambda: paths.get_subscription_count() > 0, 'the black box')
    paths.publish(plan)
    assert paths.wait_for_all_acked(Duration(seconds=DEADLINE))
    robot.process.send_signal(signal.SIGTERM)
    assert robot.process.wait() == 0
    until_incident(robot, 'fault', 'it burns')
    recorded = next(robot.incidents.glob(f'*/{RECORDING}'))
    assert any(b'the last map' in one.data for one in read_run(recorded)), 'what arrives in bundles is there, too'
    wait_until(lambda: not list(ring.glob('*.request.json')), 'the end of what made it')
    assert list(ring.glob('*.mcap'))
    robot.start_box()
    settled(robot)
    robot.tells('it burns again')
    until_incident(robot, 'fault', 'it burns again')
    assert not robot.has('black_box') and not robot.has('link')


class Watched:
    """A detector on a clock of the test, and what it has told."""

    def __init__(self, ring: Ring, killed_for: float) -> None:
        self.clock, self.told, self._sequence = ManualClock(), list[tuple[str, str]](), 0
        runtime = SimpleNamespace(
            steady=self.clock,
            post_in=lambda seconds, fn: self.clock.call_at(self.clock.now() + seconds, fn),
            node=SimpleNamespace(get_logger=lambda: logging.getLogger(__name__)),
        )
        self._detector = Detector(
            cast('NodeRuntime', runtime),
            cast('Settings', SimpleNamespace(goals=False)),
            lambda kind, text, _: self.told.append((kind, text)),
            ring,
            killed_for,
        )

    def passes(self, seconds: float, executive: str = '') -> None:
        """Let time pass, in which an executive sends its status."""
        for _ in range(int(2 * seconds)):
            self.clock.advance(0.5)
            if executive:
                self._sequence += 1
                status = ExecutiveStatus(executive_id=executive, sequence=self._sequence, heartbeat_period=0.5)
                data = serialize_message(status)
                self._detector.take(names.EXECUTIVE_STATUS, Received(data, len(data), b'', 0.0, 0))

    def stands_still(self, seconds: float) -> None:
        """Let the process be held up, which looks before it hears anything."""
        self.clock._now += seconds
        self.clock.advance(0.0)


def killed(ring: Ring) -> None:
    """Release a ring as a process that is killed does."""
    os.close(ring._lock_file)


def test_an_executive_that_comes_later_than_the_black_box_is_not_lost(tmp_path: Path) -> None:
    """One that was there before a kill, and is not heard any more, is; one that was started again meanwhile, too."""
    gone, again = 'the executive is silent or gone', 'the executive has ended or crashed, and was started again at once'
    ring = Ring(tmp_path, 60.0, 10**7)
    first = Watched(ring, 0.0)
    first.passes(60.0)
    killed(ring)
    ring = Ring(tmp_path, 60.0, 10**7)
    none_yet = Watched(ring, 5.0)
    none_yet.passes(60.0)
    none_yet.passes(10.0, 'a')
    assert first.told == none_yet.told == []
    killed(ring)
    ring = Ring(tmp_path, 60.0, 10**7)
    late = Watched(ring, 5.0)
    late.passes(COMES_SECONDS - 2.0)
    late.passes(10.0, 'a')
    assert late.told == []
    killed(ring)
    ring = Ring(tmp_path, 60.0, 10**7)
    other = Watched(ring, 5.0)
    other.passes(COMES_SECONDS - 2.0)
    other.passes(10.0, 'b')
    assert other.told == [('link', again)]
    killed(ring)
    ring = Ring(tmp_path, 60.0, 10**7)
    lost = Watched(ring, 5.0)
    lost.passes(60.0)
    lost.passes(10.0, 'c')
    assert lost.told == [('link', gone)]
    ring.close(keep=False)
    assert Ring(tmp_path, 60.0, 10**7).noted == '', 'the executive may end, too, while no black box is there on purpose'


def test_an_executive_is_not_lost_because_the_black_box_was_held_up(tmp_path: Path) -> None:
    watched = Watched(Ring(tmp_path, 60.0, 10**7), 0.0)
    watched.passes(10.0, 'a')
    watched.stands_still(60.0)
    watched.passes(10.0, 'a')
    assert watched.told == []
    watched.passes(10.0)
    assert watched.told == [('link', 'the executive is silent or gone')]


def test_an_executive_that_was_silent_before_is_missed_when_it_is_started_again(tmp_path: Path) -> None:
    gone, again = 'the executive is silent or gone', 'the executive has ended or crashed, and was started again at once'
    watched = Watched(Ring(tmp_path, 60.0, 10**7), 0.0)
    watched.passes(10.0, 'a')
    watched.passes(10.0)
    watched.passes(10.0, 'a')  # it was busy
    watched.passes(10.0, 'b')
    assert watched.told == [('link', gone), ('link', again)]


def requested(folder: Path) -> Request:
    """Return a request with a ring of two files."""
    now = [time.time_ns() - 10 * SECOND]
    ring = filled_ring(folder / 'ring' / 'robot', now)
    for number in range(200):
        now[0] += SECOND // 20
        text = random.Random(number).randbytes(2000).hex()
        ring.add(TEXT, serialize_message(String(data=text)), now[0], now[0])
        status = ExecutiveStatus(executive_id='e', sequence=number, heartbeat_period=1.0, state=ExecutiveStatus.IDLE)
        ring.add(LOG, serialize_message(status), now[0], now[0])
    ring.close(keep=True)
    (folder / 'records').mkdir()
    (folder / 'records' / 'executive.jsonl').write_text('{"event": "fault"}\n')
    return Request(
        robot='r2',
        occurrences=(Occurrence(now[0] * 1e-9 - 2.0, 'stop', 'STOP by `ann` <b>&amp;</b>'),),
        segments=tuple(map(str, ring.files())),
        target=str(folder / 'incidents'),
        since=0.0,
        records=(str(folder / 'records'),),
        keep=3,
    )


def _has_begun(part: Path, process: subprocess.Popen[bytes]) -> bool:
    return part.exists() or process.poll() is not None


def test_an_incident_is_whole_or_not_there(tmp_path: Path) -> None:
    """However often its maker is killed, and while the disk takes no more than so many bytes."""
    request, file = requested(tmp_path), tmp_path / 'a.request.json'
    request.write(file)
    assert Request.read(file) == request
    command = [sys.executable, '-m', 'flexbt_console.recording.incidents', str(file)]
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))  # noqa: E731
    full = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)
    assert full.returncode == 1 and 'File too large' in full.stderr and file.exists()
    target = Path(request.target)
    assert list(target.iterdir()) == [], 'nothing of it stays'
    chance, parts = random.Random(0), 0
    for _ in range(8):
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        part = target / f'.part_{request.name}'
        wait_until(partial(_has_begun, part, process), 'it has begun')
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(chance.random() * 0.2)
        process.kill()
        process.wait()
        assert [one.folder.name for one in incidents_in(target)] in ([], [request.name])
        parts += part.exists()
    assert parts, 'some were killed in the middle'
    (target / '.part_20260101_000000_stop').mkdir()  # the power failed, and with the ring its request is gone
    assert subprocess.run(command, check=False).returncode == 0 or not file.exists()
    (found,) = incidents_in(target)
    assert sorted(one.name for one in target.iterdir()) == [request.name]
    assert json.loads((found.folder / FACTS).read_text())['robot'] == 'r2'
    page = (found.folder / 'incident.html').read_text()
    assert 'STOP by `ann` &lt;b&gt;&amp;amp;&lt;/b&gt;' in page and '<b>' not in page
    assert (found.folder / 'records' / 'executive.jsonl').exists()
    assert make(request) == found.folder, 'one that is there stays as it is'


@contextlib.contextmanager
def box(folder: Path) -> Iterator[tuple[NodeRuntime, BlackBox]]:
    """Yield a black box in this process, and its runtime."""
    with NodeRuntime.open('black_box', namespace=f'box{os.getpid()}') as runtime:
        known = replace(Settings(), after=0.1, goals=False, ring=folder / 'ring', incidents=folder / 'incidents')
        ring = Ring(known.ring, known.seconds, known.ring_size)
        made = runtime.call(lambda: BlackBox(runtime, known, ring, lambda is_ready: None))
        try:
            yield runtime, made
        finally:
            made.close()


def test_further_topics_have_names_of_topics() -> None:
    """Else those that are not published yet would never be recorded."""
    told = "'others': 'camera image' is not the name of a topic"
    with (
        NodeRuntime.open('black_box', parameters={'others': ['/rosout', 'camera image']}) as runtime,
        pytest.raises(UnfitParameterError, match=told),
    ):
        runtime.call(lambda: black_box.declare_parameters(runtime.node))


def test_what_cannot_be_made_keeps_no_later_incident_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A request that another version wrote, a time at which no process can be started, and damaged facts."""
    monkeypatch.setattr(black_box, '_RETRY_SECONDS', 0.05)
    run, started = subprocess.run, list[bool]()

    def run_later(*arguments: Any, **options: Any) -> Any:
        started.append(True)
        if len(started) == 1:
            raise OSError(11, 'Resource temporarily unavailable')
        return run(*arguments, **options)

    monkeypatch.setattr(subprocess, 'run', run_later)
    (tmp_path / 'ring').mkdir()
    (tmp_path / 'ring' / '1.request.json').write_text('{"written": "by another version"}')
    wrong: list[dict[str, Any]] = [{'time': '?', 'kind': 'stop'}, {'time': None}, {'time': 1e300}]
    for number, damaged in enumerate(wrong):
        folder = tmp_path / 'incidents' / f'{number}'
        folder.mkdir(parents=True)
        one = {'kind': 'key', 'text': None, **damaged}
        (folder / FACTS).write_text(json.dumps({'robot': 'r', 'occurrences': [one]}))
    (tmp_path / 'incidents' / '9').mkdir()
    whole = {'robot': 'r', 'occurrences': [{'time': 1e9, 'kind': 'key', 'text': 'whole'}]}
    (tmp_path / 'incidents' / '9' / FACTS).write_text(json.dumps(whole))
    with box(tmp_path) as (runtime, made):
        runtime.call(lambda: made.report('key', 'this one', runtime.steady.now()))

        def is_there() -> bool:
            return 'this one' in [one.first.text for one in incidents_in(tmp_path / 'incidents')]

        wait_until(is_there, 'the incident')
        assert len(started) >= 2


def test_two_incidents_of_a_kind_within_a_second_are_two(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = time.time()
    monkeypatch.setattr(black_box, 'time', SimpleNamespace(time=lambda: now))
    with box(tmp_path) as (runtime, made):
        folders = []
        for _ in range(3):
            folders.append(runtime.call(lambda: made._asked(Trigger.Request(), Trigger.Response())).message)
            runtime.call(made._end)
        wait_until(lambda: len(incidents_in(tmp_path / 'incidents')) == 3, 'all of them')
    assert sorted(str(one.folder) for one in incidents_in(tmp_path / 'incidents')) == sorted(folders)


def test_black_boxes_that_share_a_directory_do_not_lose_each_others_incidents(tmp_path: Path) -> None:
    request = requested(tmp_path)
    first = request.occurrences[0]
    other = replace(request, occurrences=(replace(first, text='STOP by bob'),))
    (Path(request.target) / request.name).mkdir(parents=True)  # of something else
    folders = [make(one) for one in (request, other, request, other)]
    assert folders[:2] == folders[2:] and folders[0] != folders[1]
    assert {one.first.text for one in incidents_in(Path(request.target))} == {first.text, 'STOP by bob'}


def test_a_clock_that_was_set_back_hides_nothing(tmp_path: Path) -> None:
    ahead = 3600.0
    folder = tmp_path / 'incidents' / '1'
    folder.mkdir(parents=True)
    before = {'time': time.time() + ahead, 'kind': 'stop', 'text': 'STOP by bob'}
    with box(tmp_path) as (runtime, made):
        robot = runtime.node.get_namespace().strip('/')
    (folder / FACTS).write_text(json.dumps({'robot': robot, 'occurrences': [before]}))
    ring = filled_ring(tmp_path / 'ring', [time.time_ns()])
    ring.add(TEXT, serialize_message(String(data='before')), 0, 0)
    killed(ring)
    for file in ring.files():
        os.utime(file, (time.time() + ahead, time.time() + ahead))
    with box(tmp_path) as (runtime, made):
        assert made._detector._since <= runtime.steady.now()
        later = runtime.steady.now() + 2.0 * SAME_SECONDS
        runtime.call(lambda: made.report('stop', 'STOP by bob', later))
        wait_until(lambda: len(incidents_in(tmp_path / 'incidents')) == 2, 'another incident')
        for number in range(MOST_TOLD):
            folder = tmp_path / 'incidents' / f'ahead{number}'
            folder.mkdir()
            (folder / FACTS).write_text(json.dumps({'robot': robot, 'occurrences': [before]}))
        told: list[str] = []
        qos = names.transient_local_qos()

        def on_incidents(message: DiagnosticArray) -> None:
            told[:] = [one.message for one in message.status]

        runtime.call(lambda: runtime.node.create_subscription(DiagnosticArray, names.INCIDENTS, on_incidents, qos))
        runtime.call(lambda: made.report('stop', 'STOP by eve', runtime.steady.now()))
        wait_until(lambda: 'STOP by eve' in told, 'the report of the new one')
        assert told[0] == 'STOP by eve' and len(told) == MOST_TOLD


SLOW_MAKER = """
import sys
from flexbt_console.recording import incidents

versions = incidents._versions

def slow_versions():
    print('in the middle', flush=True)
    sys.stdin.read()
    return versions()

incidents._versions = slow_versions
sys.exit(incidents.main())
"""


def test_an_incident_has_one_maker_at_a_time(tmp_path: Path) -> None:
    """The maker of a black box that was killed goes on, while the next black box begins with the same incident."""
    request, file = requested(tmp_path), tmp_path / 'a.request.json'
    request.write(file)
    pipes: Any = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE, 'stderr': subprocess.PIPE, 'text': True}
    with subprocess.Popen([sys.executable, '-c', SLOW_MAKER, str(file)], **pipes) as first:
        assert first.stdout is not None and first.stdout.readline() == 'in the middle\n'
        command = [sys.executable, '-m', 'flexbt_console.recording.incidents', str(file)]
        with subprocess.Popen(command, **pipes) as second:
            waits = re.compile(rf'-> FLOCK .* {second.pid} ')
            wait_until(
                lambda: waits.search(Path('/proc/locks').read_text()) or second.poll() is not None, 'another maker'
            )
            told = [(*one.communicate(), one.returncode) for one in (first, second)]
    (found,) = incidents_in(Path(request.target))
    assert told == [(f'{found.folder}\n', '', 0)] * 2
    assert (found.folder / 'versions.txt').exists() and not file.exists()


def test_only_the_newest_incidents_stay(tmp_path: Path) -> None:
    request = requested(tmp_path)
    for number in range(5):
        first = Occurrence(1e9 + number, 'key', f'number {number}')
        make(Request(**{**vars(request), 'occurrences': (first,)}))
    left = incidents_in(Path(request.target))
    assert [one.first.text for one in left] == ['number 4', 'number 3', 'number 2']
    assert incident_named(Path(request.target), '').first.text == 'number 4'
    with pytest.raises(UsageError, match="3 incidents begin with '2001'"):
        incident_named(Path(request.target), '2001')
    first = Occurrence(5e8, 'key', 'after the clock was set back')
    assert make(Request(**{**vars(request), 'occurrences': (first,)})).exists()
    left = incidents_in(Path(request.target))
    assert [one.first.text for one in left] == ['number 4', 'number 3', first.text]


def test_an_incident_is_found_by_its_name_though_that_of_another_begins_so(tmp_path: Path) -> None:
    """As when all robots of one computer are stopped in the same second."""
    stop = Occurrence(1e9, 'stop', 'STOP by ann')
    folders = [make(Request(robot, (stop,), (), str(tmp_path / 'incidents'), 0.0)) for robot in ('', 'r1', 'r10')]
    assert [incident_named(tmp_path / 'incidents', one.name).folder for one in folders] == folders


def test_a_page_that_is_damaged_is_printed_as_far_as_it_can_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = make(Request('', (Occurrence(1e9, 'stop', 'STOP by ann'),), (), str(tmp_path), 0.0))
    (folder / PAGE).write_bytes(b'# Incident: \xff stop')
    assert console(['incidents', 'latest', '--directory', str(tmp_path)]) == 0
    assert capsys.readouterr().out == f'{folder}\n\n# Incident: \ufffd stop\n'


def test_files_of_the_same_name_in_two_directories_are_both_in_an_incident(tmp_path: Path) -> None:
    for name in ('first', 'second'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'events.jsonl').write_text(name)
    records = tuple(str(tmp_path / name) for name in ('first', 'second'))
    stop = Occurrence(1e9, 'stop', 'STOP by ann')
    folder = make(Request('', (stop,), (), str(tmp_path / 'incidents'), 0.0, records))
    assert {file.read_text() for file in (folder / 'records').iterdir()} == {'first', 'second'}
