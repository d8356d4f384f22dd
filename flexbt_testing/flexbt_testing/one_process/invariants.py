# SPDX-License-Identifier: BSD-3-Clause
"""What must hold in every world, whatever happens to it: checked at each message, or ten times a second.

The observer looks at the world itself: the true poses of the robots, all published messages, and the files of the
executives. No fault of the world reaches it.
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall
from flexbt_common.lifecycle.liveliness import LEASE_SECONDS, START_SECONDS
from flexbt_common.runtime.health import OUT_OF_REACH_SECONDS
from flexbt_console.mirror.command_tracker import LONGEST_RESEND
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import CommandKind
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus
from flexbt_states import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, OperatorInputState

from .graph import DOMAIN
from .programs import named
from .scheduler import BOOT, SCHEDULER, SECOND, Process
from .services import Client, _ServiceEnd
from .topics import Sample, Subscription
from .world import Mission, World

STOP_SECONDS: Final = 1.0
"""Time from the arrival of a STOP at the robot until it is at rest, s."""

OWNER_SECONDS: Final = 2.0
"""Time from the death of a process that moves the robot until it is at rest, s."""

HANG_SECONDS: Final = 3.0
"""The same for a process that hangs, s."""

MIRROR_SECONDS: Final = 1.5
"""Age of what a live mirror shows, without the delay of the link, s."""

LIVE_SECONDS: Final = 6.0
"""Time after the last fault until a mirror is live again, s."""

SHOWN_SECONDS: Final = 0.4
"""Time from the begin of a run until the executive shows it, s."""

PEER_SECONDS: Final = 3.0
"""Time after which the executive shows that a node has ended, or is there again, s."""

HUNG_SECONDS: Final = 7.0
"""Time after which the executive shows that a node that hangs is gone, s."""

SEEN_SECONDS: Final = 0.5
"""Time within which an abstract robot may have been at rest without telling it, s."""

HEARD_SECONDS: Final = 0.2
"""Time within which a node hears another one that it begins to watch, s: a node asserts its token each 0.15 s."""

ORPHAN_SECONDS: Final = 6.0
"""Time after the death of a client until its goals have ended, s."""

GIVEN_UP_SECONDS: Final = 4.0
"""Time until a goal has ended that nobody waits for any more, s."""

LONG_SECONDS: Final = 6.0
"""Length of a hang of a BT server after which nobody waits for its goals any more, s."""

DECIDED_SECONDS: Final = 0.15
"""Time from the arrival of a command until the executive shows its result, s."""

OWNERLESS_SECONDS: Final = 1.5
"""Time after which the robot is at rest once no active state drives it, s."""

FAULT_SECONDS: Final = 6.0
"""Time after the last fault from which nothing is excused by it, s."""

_MOVERS: Final = ('bt_server', 'navigation', 'onboard_executive')
_NODES: Final = ('bt_server', 'navigation', 'simulator')
_BODIES: Final = ('simulator', 'simulation', 'abstract_robot')
_EXECUTIVE: Final = 'onboard_executive'
_OPERATORS: Final = ('engineer', 'pilot')
_ENDED: Final = (4, 5, 6)  # states of a goal (action_msgs/msg/GoalStatus)
_FREE: Final = ('STOP', 'CLAIM_AUTHORITY', 'RELEASE_AUTHORITY', 'NOTE')
"""Commands that need no authority."""

_FAULTS: Final = ('; the node continues', 'fault in the executive', 'Traceback (most recent call last)')
"""Parts of lines of the log that tell of a fault of the product."""

NAMES: Final = {
    1: 'an accepted goal ends once, with one result',
    2: 'the robot is at rest after a STOP, until the next start',
    3: 'the robot is at rest after the death or the hang of who moves it',
    4: 'one node moves the robot, on behalf of an active state that drives',
    5: 'states are left as often as they are entered, all of them at the end of a run',
    6: 'a live mirror shows what the executive has shown',
    7: 'a command has one effect or one refusal',
    8: 'what was shown is known after a crash',
    9: 'no task dies, no callback raises, and processes end in order',
    10: 'after the faults a mission can be started, and stopped',
    11: 'event log and status tell the same runs',
    12: 'the same seed gives the same run',
    13: 'the executive knows which nodes are there',
    14: 'who does not have the authority has no effect',
}
"""The invariants by number. 12 is checked by the nemesis, which runs a seed twice."""


@dataclass(frozen=True)
class Violation:
    """An invariant that did not hold: its number, when (s), and what was seen."""

    number: int
    time: float
    text: str

    def __str__(self) -> str:
        return f'{self.time:.3f} s: {self.number} ({NAMES[self.number]}): {self.text}'


@dataclass
class _Goal:
    action: str
    server: Process
    client: Process
    status: int = 1


def body_of(processes: Container[str], name: str) -> str:
    """Return the process that stands in for a simulator or a navigation, of the same robot or of all."""
    robot = name.rpartition('/')[0]
    return next(one for one in [*(named(robot, body) for body in _BODIES), *_BODIES] if one in processes)


class Observer:
    """The checks of one world, from :meth:`begin` on. ``directory`` has the event logs of the executives.

    ``has_program``: a program moves the robot, too, and starts behaviors.
    """

    def __init__(
        self, world: World, directory: Path, record: Callable[[str, Any], object], has_program: bool = False
    ) -> None:
        self.violations: list[Violation] = []
        self.faulted_at = 0
        self.failed_disk_at = 0
        self.has_whole_log = True
        """False if the disk has not kept all events."""
        self.cut_since = SCHEDULER.now
        self.linked_at = 0  # the last time at which the link of the operators was bad
        self.hung: dict[str, tuple[int, int]] = {}  # begin and end of the last hang of each process
        self.entered: dict[tuple[int, int], tuple[str, int]] = {}  # by process and state: class, and whether it is in
        self.died: dict[Process, int] = {}  # or told to end
        self.met: dict[tuple[Process, Process], int] = {}  # server and client of trees: since when
        self.has_program = has_program
        self.directory = directory
        self._world = world
        self._record = record
        self._goals: dict[bytes, _Goal] = {}
        self._asked: dict[tuple[int, int], bytes] = {}
        self._given_up: dict[bytes, tuple[int, str]] = {}  # goals: since when nobody waits for their end, and why
        self._told: set[tuple[int, str]] = set()
        self.awaited: defaultdict[str, list[Callable[[], object]]] = defaultdict(list)
        """What is done at moments; see :class:`~.nemesis_run.Step`."""
        self._passed = Counter[str]()
        self._is_over = False
        self._robots = {name: _Robot(self, world, mission) for name, mission in world.robots.items()}

    def begin(self, mirrors: Sequence[Mirror]) -> None:
        """Check from now on; the mirrors are of the robots in order, the last one another one of the first robot."""
        for robot, mirror in zip([*self._robots.values(), self._robots[self._world.namespace]], mirrors, strict=True):
            robot.mirrors.append(mirror)
            mirror.add_listener(lambda _change, robot=robot, mirror=mirror: robot.sees(mirror))  # type: ignore[misc]
        _observe(Subscription, 'arrive', self._arrives)
        _observe(_ServiceEnd, 'send', self._service)
        _observe(ActionCall, '_finish', self._gives_up)
        for kind in _STATES:
            _observe(kind, 'on_enter', partial(self._counts, kind.__name__, 1))
            _observe(kind, 'on_exit', partial(self._counts, kind.__name__, -1))
        DOMAIN.on_message = self._message
        SCHEDULER.spawn(self._look_often, 'the observer', SCHEDULER.main.process)

    def _counts(self, name: str, change: int, state: Any, _userdata: Any) -> None:
        """Count how often a state is entered and left."""
        key = (SCHEDULER.current.process.pid, id(state))
        depth = self.entered.get(key, ('', 0))[1] + change
        self.entered[key] = (name, depth)
        if depth not in (0, 1):
            self.say(5, f'a {name} is {"entered twice" if depth > 0 else "left twice"}')

    def say(self, number: int, text: str, key: str = '') -> None:
        """Note a violation, each only once."""
        if (number, key or text) not in self._told:
            self._told.add((number, key or text))
            self.violations.append(Violation(number, self._world.now, text))

    @property
    def is_calm(self) -> bool:
        """True if no fault excuses anything."""
        return SCHEDULER.now - self.faulted_at > FAULT_SECONDS * SECOND

    def passes(self, moment: str) -> None:
        """Do what awaits this moment."""
        self._passed[moment] += 1
        for act in self.awaited.pop(f'{moment} {self._passed[moment]}', ()):
            act()

    def _robot(self, process: Process) -> _Robot:
        return self._robots.get(process.name.rpartition('/')[0]) or next(iter(self._robots.values()))

    def disk_fails(self, seconds: float) -> None:
        """Note that the disk is full, slow, or does not answer, for a time, s."""
        self.failed_disk_at = max(self.failed_disk_at, SCHEDULER.after(seconds))
        self.faulted_at = max(self.faulted_at, self.failed_disk_at)
        self.has_whole_log = False

    def _affected(self, name: str) -> list[_Robot]:
        """Return the robots of a process: all of them for a simulator that they share."""
        robot = name.rpartition('/')[0]
        return [self._robots[robot]] if robot in self._robots else list(self._robots.values())

    # -- what the faults announce

    def killed(self, name: str) -> None:
        """Note that a process is killed or told to end."""
        self.faulted_at = max(self.faulted_at, SCHEDULER.now)
        self.died[self._world.processes[name]] = SCHEDULER.now
        for robot in self._affected(name):
            robot.killed(name)

    def hangs(self, name: str, seconds: float) -> None:
        """Note that a process is stopped for a time, s."""
        process, end = self._world.processes[name], SCHEDULER.after(seconds)
        self.faulted_at = max(self.faulted_at, end)
        self.hung[name] = SCHEDULER.now, end
        if name.endswith('bt_server') and seconds > LONG_SECONDS:
            for key in [key for key, goal in self._goals.items() if goal.server is process]:
                self._given_up.setdefault(key, (end, f'{process} was out of reach for long'))
        for robot in self._affected(name):
            robot.hangs(name, seconds)

    def awake_at(self, name: str) -> int:
        """Return when the last hang of a process ends."""
        return self.hung.get(name, (0, 0))[1]

    # -- what is published

    def _message(self, process: Process, topic: str, sample: Any) -> None:
        if self._is_over or not isinstance(sample, Sample):  # the request of a service
            return
        robot = self._robot(process)
        name = topic.removeprefix(f'/{robot.namespace}').lstrip('/')
        if name == names.EXECUTIVE_STATUS and process.name.endswith(_EXECUTIVE):
            robot.status(sample.message())
        elif name == names.EXECUTIVE_STRUCTURE:
            robot.types = {one.path: one.type for one in sample.message().states}
        elif name == names.CMD_VEL:
            twist = sample.message()
            is_body = process.name.endswith((*_BODIES, 'navigation'))
            if (twist.linear.x or twist.linear.y or twist.angular.z) and not is_body:
                self.say(4, f'{process} moves the robot', process.name)
            if not is_body:
                robot.is_held(process)
        elif topic.endswith('/_action/status'):
            for one in sample.message().status_list:
                self._goal_has(bytes(one.goal_info.goal_id.uuid), one.status)
        self._record(name, sample)

    def _arrives(self, subscription: Subscription, sample: Any) -> None:
        if subscription.name.endswith(_COMMANDS) and subscription.process.is_alive and not sample.is_dead:
            self._robot(subscription.process).command_arrives(subscription.process, sample.message())
            self.passes('command')

    def _gives_up(self, call: ActionCall, *_outcome: Any) -> None:
        self._given_up.setdefault(call.goal_id, (SCHEDULER.now, 'its call has ended'))

    def _service(self, end: _ServiceEnd, _target: _ServiceEnd, message: Any, request_id: Any) -> None:
        """Read a request or a response of an action."""
        name: str = end.service
        if '/_action/' not in name:
            return
        if isinstance(end, Client) and name.endswith(('/send_goal', '/cancel_goal')):
            self.passes('goal' if name.endswith('/send_goal') else 'cancel')
        if name.endswith(('/send_goal', '/get_result')):
            key = (id(request_id.client), request_id.sequence_number)
            if isinstance(end, Client):
                self._asked[key] = bytes(message.goal_id.uuid)
            elif goal := self._asked.pop(key, None):
                if name.endswith('/send_goal') and message.accepted:
                    action, client = name.removesuffix('/_action/send_goal'), request_id.client.process
                    self._goals[goal] = _Goal(action, end.process, client)
                    if action.endswith(names.BT_EXECUTOR):  # from the first one on the server watches its owner
                        self.met.setdefault((end.process, client), SCHEDULER.now)
                    if self.has_program and (client is end.process or not client.name.endswith(_MOVERS)):
                        self._robot(end.process).goes_on()
                elif name.endswith('/get_result') and message.status in _ENDED:
                    self._goal_has(goal, message.status)

    def _goal_has(self, goal: bytes, status: int) -> None:
        known = self._goals.get(goal)
        if known is not None and known.status in _ENDED and known.status != status:
            self.say(1, f'a goal of {known.action} has ended as {known.status}, and has the status {status}')
        elif known is not None:
            known.status = status

    # -- regular checks

    def _look_often(self) -> None:
        network = self._world.network
        while not self._is_over:
            if not network.is_good:
                self.linked_at = SCHEDULER.now
            if not network.is_cut:
                self.cut_since = SCHEDULER.now
            for robot in self._robots.values():
                robot.look()
            self._check_goals()
            SCHEDULER.sleep(0.1)

    def _check_goals(self) -> None:
        """Check that no goal goes on after its client, a process of the robot, has died, or has given it up."""
        for key, goal in self._goals.items():
            if goal.status in _ENDED or not goal.server.works:
                continue
            died = self.died.get(goal.client) if goal.client.name.endswith(_MOVERS) else None
            if died is not None and SCHEDULER.now - max(died, self.faulted_at) > ORPHAN_SECONDS * SECOND:
                self.say(1, f'a goal of {goal.action} goes on after {goal.client} has died', goal.action)
            since, why = self._given_up.get(key, (SCHEDULER.now, ''))
            awake = (self.awake_at(one.name) for one in (goal.server, goal.client))
            if SCHEDULER.now - max(since, self.failed_disk_at, *awake) > GIVEN_UP_SECONDS * SECOND:
                self.say(1, f'a goal of {goal.action} goes on, and {why}', f'{goal.action} {why}')

    def finish(self, results: Sequence[Mapping[str, int | None]]) -> None:
        """Check the files, and look no more: what follows is the end of the world.

        ``results``: those of commands that operators have seen, by id, in the order of the mirrors.
        """
        self._is_over = True
        for robot, known in zip([*self._robots.values(), self._robots[self._world.namespace]], results, strict=True):
            robot.check_results(known)
        for robot in self._robots.values():
            robot.finish()
        are_idle = all(robot.is_idle for robot in self._robots.values())
        for (pid, _), (name, depth) in self.entered.items():
            if depth > 0 and SCHEDULER.processes[pid].is_alive and are_idle:
                self.say(5, f'a {name} is not left')
        for goal in self._goals.values() if are_idle else ():
            if goal.status not in _ENDED and goal.server.is_alive:
                self.say(1, f'a goal of {goal.action} has not ended', goal.action)

    def check_log(self) -> None:
        """Check what the programs have logged."""
        for when, process, _severity, logger, text in DOMAIN.log:
            if 'UserDataError' in text:
                continue  # a state that is entered since an outcome was forced may lack its input
            if fault := next((fault for fault in _FAULTS if fault in text), None):
                self.say(9, f'{process} {logger} at {(when - BOOT) / SECOND:.3f} s: {text[:400]}', fault)


class _Robot:
    """The checks of one robot."""

    def __init__(self, observer: Observer, world: World, mission: Mission) -> None:
        self.namespace = mission.namespace
        self.mirrors: list[Mirror] = []
        self.types: dict[str, str] = {}
        """Classes of the states of the behavior, by path."""
        self._observer, self._world, self._mission = observer, world, mission
        self._statuses: list[tuple[int, ExecutiveStatus]] = []
        self._by_sequence: dict[tuple[str, int], tuple[int, ExecutiveStatus]] = {}
        self._results: dict[str, int] = {}
        self._shown_at: dict[str, float] = {}  # when each result was shown first, s
        self._open: dict[str, tuple[int, ExecutiveCommand]] = {}  # commands without a result, and when they arrived
        self._arrived: dict[str, tuple[Process, float]] = {}  # commands: who has received them first, and when, s
        self._alone_until = 0  # the run stops by itself until then
        self._last_stop = '', 0  # the STOP that the executive has received last, and when
        self._stop_at: int | None = None  # the robot has to be at rest from then on
        self._rest_by: list[tuple[int, int, str]] = []  # at rest once between two times, and after what
        self._crashed_with: ExecutiveStatus | None = None
        self._journal: list[str] = []
        """Lines of the journal at the latest crash: it may have the end of a run that was not told yet."""
        self._shown: dict[Mirror, list[str]] = {}  # the executives that a mirror has shown
        self._crashes = 0
        self._awake_by_run: dict[str, int] = {}  # when the executive had last hung, when it first showed the run
        self._wanted_at = -1  # an operator has decided something, or a program has sent a goal
        self._driven_at = 0
        """The last time at which the robot was at rest, an active state could drive it, or that was not known, ns."""
        self._executive = named(self.namespace, _EXECUTIVE)
        own = {node: named(self.namespace, node) for node in _NODES}
        self._nodes = {
            node: name if name in world.processes else body_of(world.processes, name) for node, name in own.items()
        }
        self._movers = _MOVERS[: 2 if observer.has_program else 3]  # a program drives without the executive
        self._is_abstract = self._nodes['simulator'].endswith('abstract_robot')
        self._since = dict.fromkeys(_NODES[: 2 if self._is_abstract else 3], (True, SCHEDULER.now))

    @property
    def is_idle(self) -> bool:
        """True if the executive has shown last that it is idle."""
        return bool(self._statuses) and self._statuses[-1][1].state == ExecutiveStatus.IDLE

    def _due(self, seconds: float, who: str = '') -> int:
        """Return the time some seconds after now, or after the end of the hang of those who have to act on it.

        A BT server that hangs stops the trees of its owner, the executive, later.
        """
        nodes = ('simulator', 'bt_server') if who == self._executive else ('simulator',)
        return max(SCHEDULER.now, *(self._observer.awake_at(self._nodes[one]) for one in nodes)) + int(seconds * SECOND)

    def _unmissed_until(self, name: str) -> int:
        """Return until when a BT server that has just started waits for the first word of an executive that hangs now,
        unless it had time to hear it since its first goal."""
        server = self._world.processes[self._nodes['bt_server']]
        met = self._observer.met.get((server, self._world.processes[name]), SCHEDULER.now)
        is_unheard = name == self._executive and SCHEDULER.now - met < HEARD_SECONDS * SECOND
        return server.began + int(START_SECONDS * SECOND) if is_unheard else 0

    @property
    def _awake_at(self) -> int:
        """When the last hang of the executive ends."""
        return self._observer.awake_at(self._executive)

    # -- what the faults announce

    def killed(self, name: str) -> None:
        if name.rpartition('/')[2] in self._movers:
            self._rest_by.append((SCHEDULER.now, self._due(OWNER_SECONDS, name), f'{name} was killed'))
        if name == self._executive:
            self._open.clear()
            self._crashes += 1
            file = self._observer.directory / f'{name.replace("/", ".")}.journal'
            self._journal = file.read_text(errors='replace').splitlines() if file.exists() else []
            if self._statuses:
                self._crashed_with = self._statuses[-1][1]
        if name == self._nodes['simulator']:  # the next one begins elsewhere
            self._mission.robot.pose, self._mission.robot.at_rest = None, True

    def hangs(self, name: str, seconds: float) -> None:
        node = name.rpartition('/')[2]
        if node in self._movers and seconds > HANG_SECONDS and not (self._is_abstract and node == 'bt_server'):
            due = max(self._due(HANG_SECONDS, name), self._unmissed_until(name) + int(HANG_SECONDS * SECOND))
            self._rest_by.append((SCHEDULER.now, due, f'{name} hangs'))
        if name == self._executive:
            for command in self._open if seconds > LONGEST_RESEND else ():  # too old when it continues
                self._arrived.pop(command)
            self._open.clear()
        more = int(seconds * SECOND)
        if name == self._nodes['simulator']:  # count no time during which it does not run
            self._stop_at = None if self._stop_at is None else self._stop_at + more
            self._rest_by = [(begin, end + more, text) for begin, end, text in self._rest_by]
        elif node == 'bt_server':
            of_owner = f'{self._executive} '
            self._rest_by = [(a, b + more * text.startswith(of_owner), text) for a, b, text in self._rest_by]

    # -- what is published

    def status(self, status: ExecutiveStatus) -> None:
        before = self._statuses[-1][1] if self._statuses else None
        self._statuses.append((SCHEDULER.now, status))
        self._awake_by_run.setdefault(status.run_id, self._awake_at)
        self._by_sequence[status.executive_id, status.sequence] = SCHEDULER.now, status
        crashed, self._crashed_with = self._crashed_with, None
        if crashed is not None and crashed.executive_id == status.executive_id:
            self._crashed_with = crashed
        elif crashed is not None:
            self._after_crash(crashed, status)
        if before is not None and before.executive_id == status.executive_id and before.sequence >= status.sequence:
            self._say(6, f'status {status.sequence} follows {before.sequence}')
        # A container that waits to be left has a decision, and no state.
        if before is not None and not any(one.active_states or one.decisions for one in (before, status)):
            is_same = before.state == status.state == ExecutiveStatus.RUNNING and before.run_id == status.run_id
            since = max(self._statuses[-2][0], self._awake_at, self._observer.failed_disk_at)
            if is_same and SCHEDULER.now - since > SHOWN_SECONDS * SECOND:
                self._say(11, f'run {status.run_id} is shown as running, without a state')
        ran = before is not None and before.state in (ExecutiveStatus.RUNNING, ExecutiveStatus.PAUSED)
        if status.state == ExecutiveStatus.RUNNING and not ran:
            self._stop_at = None  # its START was decided after a STOP that came at the same time
            self.goes_on()
        applied = set()
        for result in status.results:
            known = self._results.setdefault(result.command_id, result.code)
            self._shown_at.setdefault(result.command_id, SCHEDULER.now / SECOND)
            if known != result.code:
                self._say(7, f'command {result.command_id[:8]} had the result {known}, and has {result.code} now')
            if result.command_id in self._open:
                self._check_open(result.command_id)
                _, command = self._open.pop(result.command_id)
                if result.code == CommandResult.APPLIED and command.run_id in ('', status.run_id):
                    applied.add(command.kind)
        waiting = {command.kind for _, command in self._open.values()}
        resumes = ExecutiveCommand.RESUME in applied | waiting
        if ExecutiveCommand.PAUSE in applied and status.state == ExecutiveStatus.RUNNING and not resumes:
            self._say(7, f'a PAUSE is shown as applied, and {_told(status)}', 'PAUSE')
        alive = {peer.name.rpartition('/')[2]: peer.alive for peer in status.peers}
        ready = {peer.name.rpartition('/')[2] for peer in status.peers if peer.ready}
        self._see_processes()
        for name, (is_there, since) in self._since.items():
            began = self._world.processes[self._executive].began + 2 * SECOND  # a young one waits longer for the others
            since = max(since, self._awake_at, began, self._world.processes[self._nodes[name]].began)
            past = SCHEDULER.now - since
            hangs = self._world.processes[self._nodes[name]].held_up is not None and alive.get(name)
            hung_at, _ = self._observer.hung.get(self._nodes[name], (0, 0))
            hung = (SCHEDULER.now - max(hung_at, self._awake_at, began)) / SECOND
            if hangs and hung > HUNG_SECONDS:
                self._say(13, f'{name} hangs for {hung:.1f} s, and is shown as alive', f'{name} hangs')
            if past > PEER_SECONDS * SECOND and name in alive and alive[name] != is_there:
                self._say(13, f'{name} is {"there" if is_there else "dead"} and shown {alive[name]}', name)
            if past > PEER_SECONDS * SECOND and not is_there and name == 'bt_server':
                self._check_trees(status, since)
            has_clock, clocked_at = self._since.get('simulator', (True, 0))  # without it no node is ready
            unready = SCHEDULER.now - max(since, clocked_at) > 2.0 * PEER_SECONDS * SECOND and name not in ready
            if unready and has_clock and is_there and alive.get(name):
                self._say(13, f'{name} is there, and not shown as ready', f'{name} ready')

    def _check_trees(self, status: ExecutiveStatus, since: int) -> None:
        """Check that each state whose tree has ended with its server wants to be left, or asks a person."""
        asked = {one.path for one in status.decisions}
        waiting = {one.path for one in status.active_states if not one.paused} - asked
        for when, earlier in reversed(self._statuses):
            if earlier.state != ExecutiveStatus.RUNNING or earlier.run_id != status.run_id:
                return
            waiting &= {one.path for one in earlier.active_states if not one.paused}
            waiting -= {one.path for one in earlier.decisions}
            if when < since:
                break
        for path in waiting:
            if self.types.get(path) in _WITH_TREE:
                self._say(1, f'{path} waits for a tree whose server has died', 'no server')

    def _after_crash(self, crashed: ExecutiveStatus, status: ExecutiveStatus) -> None:
        """Compare what was shown last with what the next executive shows first."""
        was_running = crashed.state in (ExecutiveStatus.RUNNING, ExecutiveStatus.PAUSED)
        is_interrupted, is_same = status.state == ExecutiveStatus.INTERRUPTED, status.run_id == crashed.run_id
        of_run = [one for one in self.events() if one.get('run') == crashed.run_id]
        by = next((one['by'] for one in of_run if one['event'] == 'started'), None)
        is_unknown = by is None and self._observer.has_program  # the log comes after the status
        if is_unknown or (by is not None and by not in _OPERATORS):
            return  # a run that a program has started does not resume
        if self._statuses[-2][0] - self._observer.failed_disk_at < LIVE_SECONDS * SECOND:
            return  # operators were told that a crash would lose the run
        who = f'{self._mission.label}executive'
        told = [one.what for one in self._world.events if one.who == who]  # the event log may have been lost
        has_ended = any(one['event'] in ('stopping', 'ended') for one in of_run) or any(
            '"end"' in line and crashed.run_id in line for line in self._journal
        )
        if was_running and not (is_interrupted and is_same) and not has_ended:
            self._say(8, f'run {crashed.run_id} was shown as active, and after the crash {_told(status)}')
        if crashed.state == ExecutiveStatus.IDLE and crashed.run_id and is_same and is_interrupted:
            self._say(8, f'run {crashed.run_id} was shown as ended, and after the crash as interrupted')
        if was_running and is_interrupted:
            shown = {one.path for one in crashed.active_states}
            left = {what.removeprefix('leaves ').partition(' by ')[0] for what in told if what.startswith('leaves ')}
            known = left.union(one.path for one in status.active_states)
            position = next((line for line in reversed(self._journal) if '"position"' in line), '')
            over = [f'{path}/' for path in known if f'"wanted":{{"{path}":' in position]
            known |= {path for path in shown if path.startswith(tuple(over))}  # it leaves a container
            if lost := shown - known:
                self._say(8, f'{", ".join(sorted(lost))} was shown as active, and is unknown after the crash')

    def command_arrives(self, process: Process, command: ExecutiveCommand) -> None:
        if command.kind in (ExecutiveCommand.START, ExecutiveCommand.RESUME_RUN, ExecutiveCommand.QUEUE_ADD):
            self._stop_at = None  # also if the executive hangs now, and takes it afterwards
        if process.held_up is not None or not process.name.endswith((_EXECUTIVE, 'stop_guard')):
            return
        is_own = process.name == self._executive
        hung_at, awake_at = self._observer.hung.get(self._executive, (0, 0))
        is_dropped = awake_at - hung_at >= OUT_OF_REACH_SECONDS * SECOND and SCHEDULER.now < awake_at + SECOND // 2
        if is_own and is_dropped and command.kind != ExecutiveCommand.STOP:
            return  # it may have waited
        if is_own and command.decision_id:
            self._wanted_at = SCHEDULER.now
        if is_own and process not in self._observer.died and command.id not in self._results:
            self._open.setdefault(command.id, (SCHEDULER.now, command))
        if is_own or command.kind == ExecutiveCommand.STOP:
            self._arrived.setdefault(command.id, (process, SCHEDULER.now / SECOND))
        if command.kind != ExecutiveCommand.STOP or command.id in self._results:
            return
        last, when = self._last_stop
        if is_own and command.id != last and not self._observer.has_program:
            is_running = self._statuses and self._statuses[-1][1].state == ExecutiveStatus.RUNNING
            is_alone = is_running and self._open.keys() <= {command.id}  # another one may just have ended the run
            self._alone_until = self._due(1.0) if is_alone and SCHEDULER.now - when > 5 * SECOND else 0
            self._last_stop = command.id, SCHEDULER.now
        if self._observer.has_program:  # which may send its next goal
            self._rest_by.append((SCHEDULER.now, self._due(OWNER_SECONDS), 'a STOP has arrived'))
        elif self._stop_at is None and (is_own or command.id != last):
            self._stop_at = self._due(STOP_SECONDS)

    def is_held(self, process: Process) -> None:
        """Check that nobody has to stop the robot after a STOP of a run that no fault disturbs."""
        if SCHEDULER.now < self._alone_until and self._observer.is_calm:
            self._say(2, f'{process} has to hold the robot: the run has not stopped by itself', 'held')

    def goes_on(self) -> None:
        """Note that a program sends its next goal, or a run begins: the STOP is over."""
        self._wanted_at = SCHEDULER.now
        self._forget_stops()

    def _forget_stops(self) -> None:
        self._rest_by = [one for one in self._rest_by if 'STOP' not in one[2]]

    # -- regular checks

    def look(self) -> None:
        now, robot = SCHEDULER.now, self._mission.robot
        simulator = self._world.processes[self._nodes['simulator']]
        self._see_processes()
        executive = self._world.processes[self._executive]
        if not executive.works:
            self._observer.faulted_at = max(self._observer.faulted_at, now)
        if not simulator.is_alive:  # the next one begins elsewhere
            robot.pose, robot.at_rest = None, True
        if not simulator.works:
            self._driven_at = now
            return
        guard = self._world.processes[named(self.namespace, 'stop_guard')]
        if not (executive.works or guard.works):  # nobody is there to stop it
            self._stop_at = None
            self._forget_stops()
        if self._stop_at is not None and now >= self._stop_at and not robot.at_rest:
            self._say(2, f'it moves {(now - self._stop_at) / SECOND:.2f} s after it had to be at rest', 'stop')
        if robot.at_rest:
            self._rest_by = [one for one in self._rest_by if now < one[0]]
        # The tree may have sent its goal again to the new process, or the state, so soon that no rest was seen.
        replaced = {process.name for process in self._restarted() if process.is_alive}
        for node, soon in (('navigation', math.inf), ('bt_server', (LEASE_SECONDS + SEEN_SECONDS) * SECOND)):
            if self._nodes[node] in replaced:
                text = f'{self._nodes[node]} was killed'
                again = self._wanted_at if node == 'bt_server' else now
                seen = self._observer.awake_at(self._nodes['simulator'])  # its robot moves on as it continues
                self._rest_by = [
                    one for one in self._rest_by if one[2] != text or not one[0] <= again <= max(one[0], seen) + soon
                ]
        for one in [one for one in self._rest_by if now > one[1]]:
            self._rest_by.remove(one)
            number = 2 if 'STOP' in one[2] else 3
            self._say(number, f'it has not been at rest since {one[2]} at {(one[0] - BOOT) / SECOND:.3f} s', one[2])
        is_well = executive.is_alive and executive.held_up is None and self._observer.is_calm
        if robot.at_rest or not is_well or self._observer.has_program or self._may_drive():
            self._driven_at = now
        elif now - self._driven_at > OWNERLESS_SECONDS * SECOND:
            self._say(4, f'the robot is moved, and {_told(self._statuses[-1][1])}', 'moved')
        for mirror in self.mirrors:
            self._check_mirror(mirror)
        for command in self._open if executive.is_alive and executive.held_up is None else ():
            self._check_open(command)

    def _check_open(self, command_id: str) -> None:
        """Check that a command has not waited too long for its result, if it is for the present executive."""
        since, command = self._open[command_id]
        began = self._world.processes[self._executive].began + 2 * SECOND
        returned = self._awake_at + 4 * SECOND  # what was said meanwhile comes first
        synced = self._observer.failed_disk_at + SECOND  # by when a sync has ended that was slow
        late = (SCHEDULER.now - max(since, began, returned, synced)) / SECOND
        present = self._statuses[-1][1].executive_id if self._statuses else ''
        if late > DECIDED_SECONDS and command.executive_id in ('', present):
            kind = CommandKind(command.kind).name
            self._say(7, f'{kind} {command_id[:8]} has had no result for {late:.2f} s', command_id)

    def _may_drive(self) -> bool:
        """Return whether the run is active, in a state that may drive the robot, or in one that is unknown."""
        if not self._statuses or not self.types:
            return True
        status = self._statuses[-1][1]
        if status.state in (ExecutiveStatus.IDLE, ExecutiveStatus.INTERRUPTED, ExecutiveStatus.PAUSED):
            return False
        return (
            any(self.types.get(one.path) not in _STANDING for one in status.active_states) or not status.active_states
        )

    def _restarted(self) -> list[Process]:
        """Return the processes that have taken the place of dead ones."""
        names = {process.name for process in self._observer.died}
        return [self._world.processes[name] for name in names if self._world.processes[name] not in self._observer.died]

    def _see_processes(self) -> None:
        """Note since when each node has been there, or has not."""
        for name, (was_there, _) in self._since.items():
            process = self._world.processes[self._nodes[name]]
            is_there = process.works and process not in self._observer.died
            if process.held_up is not None:
                self._since[name] = is_there, SCHEDULER.now + 10 * SECOND
            elif was_there is not is_there:
                self._since[name] = is_there, SCHEDULER.now

    def sees(self, mirror: Mirror) -> None:
        """Check that a mirror whose picture has changed shows no executive again after another one."""
        shown, seen = mirror.view().snapshot, self._shown.setdefault(mirror, [])
        if shown is not None and seen[-1:] != [shown.executive_id]:
            if shown.executive_id in seen:
                self._say(6, f'it shows executive {shown.executive_id} again, after another one', 'again')
            seen.append(shown.executive_id)

    def _check_mirror(self, mirror: Mirror) -> None:
        view = mirror.view()
        shown = view.snapshot
        if not view.live or shown is None:
            if SCHEDULER.now - max(self._observer.faulted_at, self._observer.linked_at) > LIVE_SECONDS * SECOND:
                self._say(6, f'it is not live: {view.link.value}', 'not live')
            return
        slack = 20.0 * self._world.network.link().delay + 10.0 * self._world.network.link().loss
        if SCHEDULER.now - self._observer.cut_since > (2.0 * MIRROR_SECONDS) * SECOND:
            self._say(6, 'it is live, and its link is cut', 'cut')
        sent, status = self._by_sequence.get((shown.executive_id, shown.sequence), (0, None))
        if status is None:
            if self._statuses and self._statuses[0][0] < SCHEDULER.now - 3 * SECOND:
                self._say(6, f'it shows status {shown.sequence}, which the executive has not sent', 'unknown')
            return
        silence = SCHEDULER.now - self._statuses[-1][0]
        if (
            silence > (2.0 * MIRROR_SECONDS + slack) * SECOND and not SCHEDULER.jumped
        ):  # else an old message seems young
            self._say(6, f'it is live, and the executive has said nothing for {silence / SECOND:.1f} s', 'silent')
        paths = tuple(one.path for one in status.active_states)
        if (int(shown.state), shown.run_id, tuple(one.path for one in shown.active_states)) != (
            status.state,
            status.run_id,
            paths,
        ):
            self._say(6, f'it shows {shown.state.name} in {shown.active_states}, and {_told(status)}', 'other')
        slack += MIRROR_SECONDS
        newest = next((one for one in reversed(self._statuses) if one[0] < SCHEDULER.now - slack * SECOND), None)
        if newest is None or newest[0] <= sent:
            return
        if (newest[1].state, {one.path for one in newest[1].active_states}) != (status.state, set(paths)):
            self._say(6, f'it is live, and shows {_told(status)}; {slack:.1f} s ago {_told(newest[1])}', 'old')

    def _say(self, number: int, text: str, key: str = '') -> None:
        self._observer.say(number, f'{self._mission.label}{text}', f'{self._mission.label}{key}' if key else '')

    # -- the files

    def events(self) -> Iterator[dict[str, Any]]:
        """Yield the events of the event log, oldest first."""
        file = self._observer.directory / f'{self._executive.replace("/", ".")}.jsonl'
        for line in file.read_text(errors='replace').splitlines() if file.exists() else ():
            try:
                yield json.loads(line)
            except ValueError:
                continue  # cut off by a crash

    def check_results(self, results: Mapping[str, int | None]) -> None:
        """Compare the results that an operator has seen with those that the executive has shown."""
        for command, code in results.items():
            if code is not None and self._results.get(command, code) != code:
                self._say(7, f'command {command[:8]} is shown as {code}, and has the result {self._results[command]}')

    def finish(self) -> None:
        """Check the event log."""
        if not self._observer.has_whole_log:
            return
        active: set[str] = set()
        decided: Counter[str] = Counter()
        holder, held_since, applied_starts, runs = '', 0.0, 0, 0
        ignored: set[str] = set()
        shown = {status.run_id: when for when, status in reversed(self._statuses)}
        entered: set[str] = set()
        last: dict[str, Any] | None = None
        for one in self.events():
            run = one.get('run', '')
            match one['event']:
                case 'executive' if one['state'] == 'started':
                    active.clear()
                    holder = ''
                    for lost in [one_id for one_id in decided if self._shown_at.get(one_id, math.inf) > one['steady']]:
                        decided[lost] = 0  # again, unless the journal had it when the executive was killed
                case 'started' | 'resumed':
                    runs += one['event'] == 'started' and one['by'] in _OPERATORS
                    if active:
                        self._say(11, f'run {run} begins while {", ".join(sorted(active))} is active')
                    active.add(run)
                    entered.clear()
                    began = max(one['steady'], self._awake_by_run.get(run, 0) / SECOND)
                    late = shown.get(run, 0) / SECOND - began
                    if late > SHOWN_SECONDS and not self._crashes:
                        self._say(11, f'run {run} is shown {late:.1f} s after its begin')
                case 'entered':
                    if one['path'] in entered:
                        self._say(11, f'{one["path"]} is entered again, and was not left')
                    entered.add(one['path'])
                case 'left':
                    inside = one['path'] + '/'  # a container that is left ends all that is active in it
                    entered = {path for path in entered if not f'{path}/'.startswith(inside)}
                case 'ended':
                    last = one
                    active.discard(run)
                    if entered and one['outcome'] not in ('preempted', 'error'):
                        self._say(11, f'run {run} has ended, and {", ".join(sorted(entered))} was not left')
                case 'command' if one.get('effect') == 'ignored':
                    ignored.add(one.get('id', ''))
                case 'authority':
                    if holder not in ('', one['holder']) and 'claimed it' in one['text']:
                        self._say(14, f'{one["holder"]} takes the authority, and {holder} has it')
                    holder, held_since = one.get('holder', ''), one['steady']
                case 'command' if one.get('effect') in ('applied', 'refused'):
                    decided[one.get('id', '')] += 1
                    code = {'applied': 1, 'refused': 2}[one['effect']]
                    if self._results.get(one.get('id', ''), code) != code:
                        self._say(7, f'{one["command"]} is {one["effect"]}, and the status shows another result')
                    applied_starts += one['effect'] == 'applied' and one['command'] == 'START'
                    operator = one.get('operator', '')
                    _, arrived = self._arrived.get(one.get('id', ''), (None, 0.0))
                    is_free = one['command'] in _FREE or holder in ('', operator) or arrived <= held_since
                    if one['effect'] == 'applied' and not is_free:
                        self._say(14, f'{one["command"]} of {operator} is applied, and {holder} has the authority')
        # A crash may come between a run and its command in the event log.
        if runs > applied_starts + self._crashes or (runs < applied_starts and not self._crashes):
            self._say(7, f'{runs} runs began, and {applied_starts} STARTs were applied')
        of_guard = (one for one in self._arrived.items() if one[1][0].name.endswith('stop_guard'))
        guarded = max((when for command, (_, when) in of_guard if command in decided), default=0.0)
        for command, number in decided.items():
            if number > 1 and command:
                self._say(7, f'command {command[:8]} was decided {number} times')
        for command, (process, when) in self._arrived.items():
            if process.name.endswith('stop_guard') and when < guarded:  # the guard repeats its latest STOP
                continue
            is_decided = command in decided and (decided[command] or command in self._results)
            if process.is_alive and not is_decided and command not in ignored:
                self._say(7, f'command {command[:8]} has arrived, and was never decided')
        if self.is_idle:
            status = self._statuses[-1][1]
            if active:
                self._say(11, f'{", ".join(sorted(active))} has no end in the event log, and the executive is idle')
            elif last is not None and status.run_id == last['run'] and status.outcome != last['outcome']:
                self._say(11, f'run {status.run_id}: {status.outcome!r} is shown, {last["outcome"]!r} is logged')


_STATES: Final = (BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, OperatorInputState)
_WITH_TREE: Final = {'BtExecuteGoalState', 'BtExecuteState'}
_STANDING: Final = {'BtGetDataState', 'BtLoaderState', 'OperatorInputState'}
_COMMANDS: Final = (f'/{names.EXECUTIVE_COMMAND}', f'/{names.EXECUTIVE_STOP}')


def _observe(owner: type[Any], name: str, see: Callable[..., object]) -> None:
    """Call ``see`` with the arguments of each call of a method, before it."""
    method = getattr(owner, name)

    @wraps(method)
    def observed(*arguments: Any) -> Any:
        see(*arguments)
        return method(*arguments)

    setattr(owner, name, observed)


def _told(status: ExecutiveStatus) -> str:
    name = next(
        key
        for key in ('UNKNOWN', 'IDLE', 'STARTING', 'RUNNING', 'PAUSED', 'STOPPING', 'INTERRUPTED')
        if getattr(ExecutiveStatus, key) == status.state
    )
    paths = ', '.join(one.path for one in status.active_states)
    return f'the executive is {name} {paths} ({status.run_id or "no run"})'
