# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``black_box``: keeps the last minutes of a robot, and writes an incident when something goes wrong.

It records like ``recorder``, into a ring of files in memory (tmpfs), which outlives the process. :class:`Detector` says
what makes an incident. Another process makes its folder (:mod:`.incidents`) from files of the ring, which stay until
then: neither a slow disk nor a full one holds up the recording.
"""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from action_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.action import get_action_names_and_types
from rclpy.action.server import RCLError
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_action_status_default
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.errors import UnfitParameterError
from flexbt_common.files import INCIDENTS, USER_DIRECTORY, home_path
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_common.values.limits import MESSAGE
from flexbt_console.mirror.freshness import LOST_SECONDS, LinkState
from flexbt_console.mirror.lanes import Lane, LaneEntry, Lanes
from flexbt_console.mirror.mirror import Mirror
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import TokenBucket
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import one_line, short_repr
from flexbt_msgs.msg import ExecutiveCommand

from .incidents import ROSOUT, Incident, Occurrence, Request, incidents_in
from .player import MirrorFeed
from .recorder import BUNDLE_SECONDS, Recorder
from .ring import SEGMENTS, Ring
from .topics import full_definition

QUIET_SECONDS: Final = 2.0
"""Time after the first message for which what arrives is of the past: messages that late subscribers get."""

LONGEST_SECONDS: Final = 30.0
"""Time after which further occurrences are another incident, s."""

SAME_SECONDS: Final = 60.0
"""Time within which the same occurrence makes no second incident, s."""

COMES_SECONDS: Final = 10.0
"""Time in which an executive that lives is heard by a black box that begins, s."""

KILLED_SECONDS: Final = 600.0
"""Age up to which a ring that was left behind is an incident, s."""

TOLD_SECONDS: Final = 86_400.0
MOST_TOLD: Final = 10
"""Age up to which an incident is told, s, and how many are told: the newest."""

MOST_REQUESTS: Final = 100
MOST_HELD: Final = 2.0
"""Incidents that wait for the disk, at most, and how many times the bytes of the ring the files may have that are kept
for them."""

_MOST_OCCURRENCES: Final = 50
_LOOK_SECONDS: Final = 1.0
_RETRY_SECONDS: Final = 10.0
_OTHER_BYTES: Final = 4_000_000
_BATTERY_MARGIN: Final = 0.05
_ABORTED: Final = GoalStatus.STATUS_ABORTED
_REQUEST: Final = '*.request.json'
_COMMANDS: Final = (names.EXECUTIVE_COMMAND, names.EXECUTIVE_STOP)
_TELLING: Final = (names.EXECUTIVE_STATUS, names.EXECUTIVE_LOG, names.EXECUTIVE_EVENTS, names.STOP_GUARD_STATUS)


@dataclass(frozen=True)
class Settings:
    """The parameters of the node."""

    seconds: float = parameter('seconds', 120.0, 'time that the ring covers, s', 10.0, 3600.0)
    after: float = parameter('after', 5.0, 'time that an incident records after what belongs to it, s', 0.1, 600.0)
    ring_size: int = parameter('ring_size', 64_000_000, 'bytes of the ring, at most', 1_000_000, 10**10)
    keep: int = parameter('keep', 50, 'incidents that stay; the oldest ones are removed', 1, 10_000)
    size: int = parameter('size', 1_000_000_000, 'bytes of all incidents that stay', 1_000_000, 10**13)
    others: tuple[str, ...] = parameter('others', (ROSOUT,), 'further topics of any type, such as camera and costmap')
    other_period: float = parameter('other_period', 0.25, 'time between two kept messages of one of them, s', 0.0, 60.0)
    battery: float = parameter(
        'battery', 0.15, 'share of charge below which the battery is an incident; 0: none', 0.0, 1.0
    )
    goals: bool = parameter('goals', True, 'an aborted goal of any action is an incident')
    ring: Path = Path()
    incidents: Path = Path()
    records: tuple[Path, ...] = ()


def declare_parameters(node: Node) -> Settings:
    """Declare the parameters, and return their values."""
    declare = ParameterDeclarer(node).fixed
    domain = f'domain_{node.context.get_domain_id()}'
    memory = Path('/dev/shm')  # noqa: S108 - the directory below it has to be the user's own
    ring = declare.text('ring', '', 'directory of the ring; empty for one in memory (/dev/shm)') or (
        str(memory / f'flexbt_{os.getuid()}' / domain) if memory.is_dir() else f'{USER_DIRECTORY}/{domain}/ring'
    )
    space = node.get_namespace().strip('/').replace('/', '.') or 'robot'
    records = 'directories of event log, journal and btlogs; what changed in them lately is copied'
    settings = declare.fields(Settings())
    for name in settings.others:
        try:
            node.resolve_topic_name(name)
        except RCLError:
            raise UnfitParameterError('others', f'{short_repr(name)} is not the name of a topic') from None
    return replace(
        settings,
        ring=home_path(ring) / space,
        incidents=home_path(declare.text('incidents', INCIDENTS, 'directory in which each incident gets a folder')),
        records=declare.directories('records', (f'{USER_DIRECTORY}/{domain}',), records),
    )


class Detector:
    """Finds what makes an incident, and calls ``report`` with its kind and a text. Executor thread only.

    - stop: an operator's STOP, or the stop guard that holds the robot
    - forced: an outcome that an operator has forced
    - fault: an error in the executive's log: of a state, of a leaf, of a monitor; a run that failed
    - node: a node that the executive needs is gone, or hangs
    - link: the executive is gone, or hangs
    - goal: an action server has aborted a goal
    - battery: the battery is low

    What was before counts as known, but for the time, s, in which no black box was there, because it was killed.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        settings: Settings,
        report: Callable[[str, str, float], None],
        ring: Ring,
        killed_for: float,
    ) -> None:
        self._runtime, self._settings, self._report, self._ring = runtime, settings, report, ring
        self.mirror = Mirror(runtime.steady)
        self._feed, self._lanes = MirrorFeed(self.mirror), Lanes(self.mirror)
        self._revision = self._numbers = 0
        self._since = runtime.steady.now() - killed_for
        self._quiet_until, self._is_new = -math.inf if killed_for else math.inf, True
        self._executive = ring.noted if killed_for else ''  # which was heard last
        self._gone = ''  # which is told to be gone
        self._was_live, self._was_held = bool(self._executive), False
        self._looked_at, self._listened = runtime.steady.now(), 0.0  # and for how long since a look found it live
        self._comes_until = runtime.steady.now() + COMES_SECONDS
        self._late: frozenset[str] = frozenset()
        self._is_low = False
        self._goals: dict[str, set[bytes]] = {}
        """Of each action the aborted goals that are known."""
        runtime.post_in(_LOOK_SECONDS, self._look)

    def take(self, topic: str, message: Received) -> None:
        """Take a message that is recorded."""
        if self._is_new:  # with the first one comes what late subscribers get
            self._is_new, told = False, 'begins to find incidents'
            self._quiet_until = min(self._quiet_until, self._runtime.steady.now() + QUIET_SECONDS)
            self._runtime.post_in(QUIET_SECONDS, lambda: self._runtime.node.get_logger().info(told))
        if topic in _COMMANDS:
            with contextlib.suppress(ValueError):
                command = message.checked(ExecutiveCommand)
                if command.kind == ExecutiveCommand.STOP:  # there may be no executive to tell of it
                    self._tell('stop', f'STOP by {command.operator_id[:200]}')
        elif topic in _TELLING:
            self._feed.take(topic, message)
            self._read()

    def _read(self) -> None:
        entries, self._revision = self._lanes.since(self._revision), self._lanes.revision
        is_quiet = self._runtime.steady.now() < self._quiet_until
        for one in entries:
            if one.number > self._numbers and not is_quiet and (found := _occurrence(one)) is not None:
                is_dated = found[0] in ('fault', 'forced')
                if one.begin >= self._since or not is_dated:
                    self._report(*found, one.begin if is_dated else self._runtime.steady.now())
        self._numbers = max((self._numbers, *(one.number for one in entries)))
        view = self.mirror.view()
        is_held, self._was_held = self._was_held, view.guard.holding
        if view.guard.holding and not is_held and not is_quiet:
            self._tell('stop', view.guard.told)
        if view.snapshot is not None and view.snapshot.executive_id != self._executive:
            if self._executive not in ('', self._gone):
                self._tell('link', 'the executive has ended or crashed, and was started again at once')
            self._executive = view.snapshot.executive_id
            self._ring.note(self._executive)
        peers = view.snapshot.peers if view.snapshot is not None else ()
        late = {one.name: one.problem for one in peers if one.late}
        for name in late.keys() - self._late:
            self._tell('node', f'{name} hangs: {late[name] or "no sign of life"}')
        self._late = frozenset(late)

    def _look(self) -> None:
        """Look for what no message tells: an executive that is silent, and new actions."""
        self._runtime.post_in(_LOOK_SECONDS, self._look)
        view, now = self.mirror.view(), self._runtime.steady.now()
        passed, self._looked_at = min(now - self._looked_at, 2.0 * _LOOK_SECONDS), now  # this process may be held up
        self._listened, self._gone = (0.0, '') if view.live else (self._listened + passed, self._gone)
        comes = view.snapshot is None and now < self._comes_until
        is_lost = view.link is LinkState.LOST and self._listened >= LOST_SECONDS and not comes
        if self._was_live and is_lost:
            self._gone = self._executive
            self._tell('link', 'the executive is silent or gone')
        self._was_live = view.live or (self._was_live and not is_lost)
        if self._settings.goals:
            node = self._runtime.node
            inside = node.get_namespace().rstrip('/') + '/'
            for name, _ in get_action_names_and_types(node):
                if name.startswith(inside) and name not in self._goals:
                    self._goals[name] = set()
                    topic, qos = f'{name}/_action/status', qos_profile_action_status_default
                    with contextlib.suppress(RCLError):  # a security policy may not let this node hear it
                        ReceivedMessages(node, GoalStatusArray, topic, qos, partial(self._statuses, name), MESSAGE)

    def _statuses(self, action: str, received: Received) -> None:
        with contextlib.suppress(ValueError):
            message = received.checked(GoalStatusArray)
            aborted = {bytes(one.goal_info.goal_id.uuid) for one in message.status_list if one.status == _ABORTED}
            known, self._goals[action] = self._goals[action], aborted
            age = received.arrived * 1e-9 - received.sent if received.sent else 0.0
            if aborted - known and self._runtime.steady.now() - age >= self._since:  # before: goals of the past
                self._tell('goal', f'{action} has aborted a goal')

    def take_battery(self, received: Received) -> None:
        """Take a sensor_msgs/BatteryState."""
        try:
            message = received.checked(BatteryState)
        except ValueError:
            return
        level, least = message.percentage, self._settings.battery
        if level < least and not self._is_low:
            self._tell('battery', f'the battery is at {100 * level:.0f} %')
        self._is_low = level < least + (_BATTERY_MARGIN if self._is_low else 0.0)

    def _tell(self, kind: str, text: str) -> None:
        self._report(kind, text, self._runtime.steady.now())


def _occurrence(entry: LaneEntry) -> tuple[str, str] | None:
    """Return the kind and the text of an entry that makes an incident."""
    if entry.lane is Lane.FAULTS and entry.tone == 'error' and entry.key != 'link':  # which is told when it is lost
        if not entry.word:  # all that was said, or has ended, has one
            return 'node', f'{entry.key} is gone{f": {entry.text}" if entry.text else ""}'
        return 'fault', entry.text or entry.label
    if entry.lane is Lane.COMMANDS and entry.word == 'applied' and entry.label.startswith('force '):
        return 'forced', f'{entry.key}: {" ".join(entry.text.removesuffix(entry.key).split())}'
    return None


@dataclass
class _Open:
    """An incident that still records."""

    request: Request
    file: Path
    began: float
    ends: Timer


class BlackBox:
    """The ring, its recorder, and the incidents that are being made. Executor thread, but for :meth:`_make_all`."""

    def __init__(
        self, runtime: NodeRuntime, settings: Settings, ring: Ring, tell_ready: Callable[[bool], None]
    ) -> None:
        self._runtime, self._settings, self._ring = runtime, settings, ring
        self._robot = runtime.node.get_namespace().strip('/')
        self._open: _Open | None = None
        self._told: OrderedDict[tuple[str, str], float] = OrderedDict()
        self._wake = threading.Condition()
        self._waiting: deque[Path] = deque(sorted(settings.ring.glob(_REQUEST)))
        self._is_closed = False
        self._others: dict[str, Any] = {}
        self._links = ServiceLinks(runtime)
        incidents = self._incidents()
        known = [one for incident in incidents for one in incident.occurrences]
        self._names = {one.folder.name for one in incidents} | {one.name.split('.request')[0] for one in self._waiting}
        """Names of the incidents so far: two of a kind may be within a second."""
        for file in self._waiting:
            with contextlib.suppress(OSError, ValueError):
                ring.hold(file.name, frozenset(Request.read(file).segments))
                known += Request.read(file).occurrences
        ahead = time.time() - runtime.steady.now()
        for one in sorted(known, key=lambda one: one.time):
            self._told[one.kind, one.text] = min(one.time - ahead, runtime.steady.now())  # the clock may have been set
        killed_for = abs(time.time() - ring.left[-1].stat().st_mtime) if ring.left else math.inf  # it may have been set
        was_killed = killed_for < KILLED_SECONDS
        self._detector = Detector(runtime, settings, self.report, ring, killed_for if was_killed else 0.0)
        self._recorder = Recorder(runtime, ring, tell_ready, sys.maxsize, self._detector.take)
        battery = 'sensor_msgs/msg/BatteryState'
        self._recorder.hear(battery, names.BATTERY_STATE, names.best_effort_qos(1), self._detector.take_battery, True)
        self._service = runtime.node.create_service(Trigger, names.WRITE_INCIDENT, self._asked)
        self._reports = runtime.node.create_publisher(DiagnosticArray, names.INCIDENTS, names.transient_local_qos())
        runtime.post_in(_LOOK_SECONDS, self._find_others)
        if was_killed and not self._waiting:
            text = 'the black box itself was killed; its recording of before is here'
            self.report('black_box', text, runtime.steady.now())
        threading.Thread(target=self._make_all, name='incidents', daemon=True).start()

    def report(self, kind: str, text: str, happened: float) -> None:
        """Note an occurrence at a time of the steady clock: it begins an incident, or belongs to the one that still
        records."""
        text, now = one_line(text, 500), self._runtime.steady.now()
        if kind != 'key' and happened < self._told.get((kind, text), -math.inf) + SAME_SECONDS:
            return
        self._told[kind, text] = happened
        while len(self._told) > 200:
            self._told.popitem(last=False)
        occurrence = Occurrence(time.time() - (now - happened), kind, text)
        self._runtime.node.get_logger().warning(f'incident: {kind}: {text}')
        if self._open is None:
            request = Request(
                robot=self._robot,
                occurrences=(occurrence,),
                segments=(),
                target=str(self._settings.incidents),
                since=occurrence.time - self._settings.seconds,
                records=tuple(map(str, self._settings.records)),
                keep=self._settings.keep,
                size=self._settings.size,
            ).unless(lambda one: one.name in self._names)
            self._names.add(request.name)
            file = self._settings.ring / f'{request.name}.request.json'
            self._open = _Open(request, file, now, self._runtime.post_in(self._settings.after, self._end))
            self._ask_parameters(request.parameters)
        else:
            before = self._open.request.occurrences
            if len(before) < _MOST_OCCURRENCES:
                self._open.request = replace(self._open.request, occurrences=(*before, occurrence))
            self._open.ends.cancel()
            due = min(now + self._settings.after, self._open.began + LONGEST_SECONDS)
            self._open.ends = self._runtime.post_at(due, self._end)
        self._write(self._open)

    def _write(self, one: _Open) -> None:
        """Write what is known now, so that the incident outlives this process."""
        files = tuple(map(str, self._ring.files(one.request.since)))  # those of an earlier incident may be held
        self._ring.hold(one.file.name, frozenset(files))
        one.request = replace(one.request, segments=files)
        try:
            one.request.write(one.file)
        except OSError as error:
            self._runtime.node.get_logger().error(f'the incident cannot be noted in {one.file}: {error}')

    def _incidents(self) -> list[Incident]:
        """Return the incidents of this robot, newest first: several may share the directory."""
        return [one for one in incidents_in(self._settings.incidents) if one.robot == self._robot]

    def _tell_incidents(self) -> None:
        """Publish the newest incidents of the last day. On the thread that makes them: the disk may be slow.

        Those that are nearest to now: some may be ahead of it, since the clock may have been set back.
        """
        now = time.time()
        ages = {one: abs(now - one.first.time) for one in self._incidents()}
        statuses = [
            DiagnosticStatus(
                level=DiagnosticStatus.ERROR,
                name=one.folder.name,
                message=one.first.text,
                hardware_id=one.robot,
                values=[KeyValue(key='folder', value=str(one.folder))],
            )
            for one in sorted(ages, key=ages.__getitem__)[:MOST_TOLD]
            if ages[one] < TOLD_SECONDS
        ]
        self._runtime.post(partial(self._reports.publish, DiagnosticArray(status=statuses)))

    def _end(self) -> None:
        """Let the incident that records be made."""
        one, self._open = self._open, None
        if one is None:
            return
        self._ring.roll()
        self._write(one)
        with self._wake:
            self._waiting.append(one.file)
            most = MOST_HELD * self._settings.ring_size
            while len(self._waiting) > MOST_REQUESTS or (len(self._waiting) > 1 and self._ring.held_size > most):
                given_up = self._waiting.popleft()
                given_up.unlink(missing_ok=True)
                self._ring.release(given_up.name)
                self._runtime.node.get_logger().error(
                    f'{given_up.stem} was given up: {len(self._waiting)} later incidents wait for the disk'
                )
            self._wake.notify()

    def close(self) -> None:
        """End the recording. What is not made yet is made by a process that goes on, or at the next start.

        That nodes were gone just before is no incident: the robot is shut down.
        """
        self._runtime.call(self._recorder.finish)
        if self._open is not None and {one.kind for one in self._open.request.occurrences} <= {'node', 'link'}:
            self._open.file.unlink(missing_ok=True)
            self._open = None
        self._end()
        with self._wake:
            self._is_closed = True
            self._wake.notify()
            left = list(self._waiting)
        self._ring.close(keep=bool(left))
        if left:
            subprocess.Popen([*_MAKE, *map(str, left)], start_new_session=True, **_SILENT)  # noqa: S603

    def _make_all(self) -> None:
        """Make the incidents one after another. A thread of its own."""
        logger = self._runtime.node.get_logger()
        while True:
            self._tell_incidents()
            with self._wake:
                self._wake.wait_for(lambda: self._waiting or self._is_closed, TOLD_SECONDS / 24.0)
                if self._is_closed:
                    return
                if not self._waiting:
                    continue
                file = self._waiting[0]
            made = _made(file)
            with self._wake:
                if made.returncode == 0 or not file.exists():  # or it was given up meanwhile
                    if made.returncode == 0:
                        logger.info(f'incident written: {made.stdout.strip()}')
                    self._ring.release(file.name)
                    with contextlib.suppress(ValueError):
                        self._waiting.remove(file)
                    continue
                logger.error(
                    f'the incident {file.stem} cannot be written, and is tried again: '
                    f'{one_line(made.stderr, 300) or f"exit code {made.returncode}"}',
                    throttle_duration_sec=60.0,
                )
                self._waiting.rotate(-1)  # one that never can be made keeps no other one waiting
                self._wake.wait_for(lambda: self._is_closed, _RETRY_SECONDS)

    # What is kept besides the topics of a recorder.

    def _asked(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.report('key', 'somebody has asked for it', self._runtime.steady.now())
        response.success = self._open is not None
        response.message = str(self._settings.incidents / self._open.request.name) if self._open else ''
        return response

    def _find_others(self) -> None:
        """Subscribe to the further topics as soon as somebody publishes them."""
        node, period = self._runtime.node, self._settings.other_period
        for name in [name for name in self._settings.others if name not in self._others]:
            full = node.resolve_topic_name(name)
            for offered in node.get_publishers_info_by_topic(full):
                with contextlib.suppress(LookupError, OSError, ValueError, RCLError):
                    is_latched = offered.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
                    in_bundles = name != ROSOUT and not is_latched and period >= BUNDLE_SECONDS
                    qos = QoSProfile(
                        depth=1 if in_bundles else 10,
                        reliability=offered.qos_profile.reliability or ReliabilityPolicy.BEST_EFFORT,
                        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE,
                    )
                    type = offered.topic_type
                    self._ring.add_topic(name, full, type, full_definition(type), 1 if is_latched else 0)
                    self._others[name] = self._recorder.hear(type, full, qos, self._keep(name), in_bundles)
                    break
        self._runtime.post_in(_LOOK_SECONDS, self._find_others)

    def _keep(self, name: str) -> Callable[[Received], None]:
        due, period = -math.inf, 0.0 if name == ROSOUT else self._settings.other_period
        share = self._settings.ring_size / 2 / len(self._settings.others)
        bucket = TokenBucket(share / self._settings.seconds, share / SEGMENTS, self._runtime.steady.now)

        def on_message(message: Received) -> None:
            nonlocal due
            now = self._runtime.steady.now()
            if now >= due and message.data is not None and message.size <= _OTHER_BYTES and bucket.left > 0.0:
                due = now + period
                bucket.take(message.size)
                self._ring.add(name, message.data, message.arrived, int(message.sent * 1e9))

        return on_message

    def _ask_parameters(self, found: dict[str, dict[str, Any]]) -> None:
        """Ask the nodes of the executive for their parameters; what does not answer is left out."""
        snapshot = self._detector.mirror.view().snapshot
        known = [names.ONBOARD_EXECUTIVE, *(one.name for one in snapshot.peers if one.alive)] if snapshot else []

        def ask(type: Any, service: str, request: Any, take: Callable[[Any], None]) -> None:
            def answered(outcome: ServiceOutcome) -> None:
                if outcome.response is not None:
                    take(outcome.response)

            with contextlib.suppress(ValueError):  # a security policy may not let this node ask
                ServiceCall(self._links.link(type, service), request, on_done=answered)

        def listed(name: str, response: Any) -> None:
            wanted = list(response.result.names)[:500]
            ask(
                GetParameters, f'{name}/get_parameters', GetParameters.Request(names=wanted), partial(got, name, wanted)
            )

        def got(name: str, wanted: list[str], response: Any) -> None:
            values = map(parameter_value_to_python, response.values)
            found[name] = {key: _shortened(value) for key, value in zip(wanted, values, strict=False)}

        for name in dict.fromkeys(known):
            ask(ListParameters, f'{name}/list_parameters', ListParameters.Request(), partial(listed, name))


def _shortened(value: Any) -> Any:
    if isinstance(value, (bool, int, float)):
        return value if not isinstance(value, float) or math.isfinite(value) else str(value)
    return one_line(value, 1000) if isinstance(value, str) else [_shortened(one) for one in list(value or [])[:200]]


def _made(file: Path) -> subprocess.CompletedProcess[str]:
    """Let a process make an incident. One that cannot be started now has failed."""
    try:
        return subprocess.run([*_MAKE, str(file)], capture_output=True, text=True)  # noqa: S603
    except OSError as error:
        return subprocess.CompletedProcess(_MAKE, 1, '', f'no process could be started: {error}')


_MAKE: Final = ['nice', sys.executable, '-P', '-m', 'flexbt_console.recording.incidents']
_SILENT: Final[dict[str, Any]] = dict.fromkeys(('stdin', 'stdout', 'stderr'), subprocess.DEVNULL)


def setup(runtime: NodeRuntime) -> None:
    """Begin to record."""
    settings = runtime.call(lambda: declare_parameters(runtime.node))
    ring = Ring(settings.ring, settings.seconds, settings.ring_size)
    token = LivelinessToken(runtime)
    box = runtime.call(lambda: BlackBox(runtime, settings, ring, token.set_ready))
    runtime.on_close(box.close)
    runtime.node.get_logger().info(
        f'keeps the last {settings.seconds:g} s in {settings.ring}; incidents go to {settings.incidents}'
    )


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, and return the exit code of the process."""
    return run_node(names.BLACK_BOX, setup, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
