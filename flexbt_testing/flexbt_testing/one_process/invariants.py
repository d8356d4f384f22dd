# SPDX-License-Identifier: BSD-3-Clause
"""What must hold in every world, whatever happens to it: checked at each message, or ten times a second.

The observer looks at the world itself: the true pose of the robot, all published messages, and the files of the
executive. No fault of the world reaches it.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from flexbt_common import names
from flexbt_console.mirror.mirror import Mirror
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_states import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, OperatorInputState

from .graph import DOMAIN
from .scheduler import BOOT, SCHEDULER, SECOND, Process
from .services import Client, _ServiceEnd
from .topics import Sample, Subscription
from .world import World

STOP_SECONDS: Final = 0.8
"""Time from the arrival of a STOP at the robot until it is at rest, s."""

OWNER_SECONDS: Final = 2.0
"""Time from the death of a process that moves the robot until it is at rest, s."""

HANG_SECONDS: Final = 3.0
"""The same for a process that hangs, s."""

MIRROR_SECONDS: Final = 1.5
"""Age of what a live mirror shows, without the delay of the link, s."""

PEER_SECONDS: Final = 3.0
"""Time after which the executive shows that a node has ended, or is there again, s."""

ORPHAN_SECONDS: Final = 6.0
"""Time after the death of a client until its goals have ended, s."""

OWNERLESS_SECONDS: Final = 1.5
"""Time after which the robot is at rest once no run is active, or the run is paused, s."""

_MOVERS: Final = ('bt_server', 'navigation', 'onboard_executive')
_NODES: Final = ('bt_server', 'navigation', 'simulator')
_ENDED: Final = (4, 5, 6)  # states of a goal (action_msgs/msg/GoalStatus)
_FREE: Final = ('STOP', 'CLAIM_AUTHORITY', 'RELEASE_AUTHORITY', 'NOTE')
"""Commands that need no authority."""

_FAULTS: Final = ('raised; the node goes on', 'fault in the executive', 'Traceback (most recent call last)')
"""Parts of lines of the log that tell of a fault of the product."""

NAMES: Final = {
    1: 'an accepted goal ends once, with one result',
    2: 'the robot is at rest after a STOP, until the next start',
    3: 'the robot is at rest after the death or the hang of who moves it',
    4: 'one node moves the robot, on behalf of a run that is active',
    5: 'states are left as often as they are entered, all of them at the end of a run',
    6: 'a live mirror shows what the executive has shown',
    7: 'a command has one effect or one refusal',
    8: 'what was shown is known after a crash',
    9: 'no task dies, no callback raises, and processes end in order',
    10: 'after the faults a mission can be started, and stopped',
    11: 'event log and status tell the same runs',
    13: 'the executive knows which nodes are there',
    14: 'who does not have the authority has no effect',
}
"""The invariants by number. 12, the same run for the same seed, is checked by the nemesis."""


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


class Observer:
    """The checks of one world, from :meth:`begin` on. ``directory`` has the event log of the executive."""

    def __init__(self, world: World, directory: Path, record: Callable[[str, Any], object]) -> None:
        self.violations: list[Violation] = []
        self._world = world
        self._directory = directory
        self._record = record
        self._statuses: list[tuple[int, ExecutiveStatus]] = []
        self._by_sequence: dict[tuple[str, int], tuple[int, ExecutiveStatus]] = {}
        self._results: dict[str, int] = {}
        self._goals: dict[bytes, _Goal] = {}
        self._asked: dict[tuple[int, int], bytes] = {}
        self._stop_at: int | None = None  # the robot has to be at rest from then on
        self._rest_by: list[tuple[int, int, str]] = []  # at rest once between two times, and after what
        self._since: dict[str, tuple[bool, int]] = {}
        self._mirrors: list[Mirror] = []
        self._told: set[tuple[int, str]] = set()
        self._crashed_with: ExecutiveStatus | None = None
        self._faulted_at = 0
        self._is_over = False
        self._frozen_until = 0  # the simulator hangs until then
        self._leaving: set[Process] = set()
        self._died: dict[Process, int] = {}
        self._entered: dict[tuple[int, int], tuple[str, int]] = {}  # by process and state: class, and whether it is in

    def begin(self, mirrors: list[Mirror]) -> None:
        """Check from now on."""
        self._mirrors = mirrors
        observer, arrive, send = self, Subscription.arrive, _ServiceEnd.send

        def arrive_observed(subscription: Subscription, sample: Any) -> None:
            if subscription.name in _COMMANDS and subscription.process.is_alive:
                observer._command_arrives(subscription, sample.message())
            arrive(subscription, sample)

        def send_observed(end: _ServiceEnd, target: _ServiceEnd, message: Any, request_id: Any) -> None:
            if '/_action/' in end.service:
                observer._service(end, message, request_id)
            send(end, target, message, request_id)

        Subscription.arrive = arrive_observed  # type: ignore[method-assign, assignment]
        _ServiceEnd.send = send_observed  # type: ignore[method-assign, assignment]
        DOMAIN.on_message = self._message
        for kind in _STATES:
            self._watch(kind)
        self._since = dict.fromkeys(_NODES, (True, SCHEDULER.now))
        SCHEDULER.spawn(self._look_often, 'the observer', SCHEDULER.main.process)

    def _watch(self, kind: Any) -> None:
        """Observe how states of a class are entered and left."""
        enter, leave = kind.on_enter, kind.on_exit

        def count(state: Any, change: int) -> None:
            key = (SCHEDULER.current.process.pid, id(state))
            depth = self._entered.get(key, ('', 0))[1] + change
            self._entered[key] = (kind.__name__, depth)
            if depth not in (0, 1):
                self.say(5, f'a {kind.__name__} is {"entered twice" if depth > 0 else "left twice"}')

        def on_enter(state: Any, userdata: Any) -> Any:
            count(state, 1)
            return enter(state, userdata)

        def on_exit(state: Any, userdata: Any) -> Any:
            count(state, -1)
            return leave(state, userdata)

        kind.on_enter, kind.on_exit = on_enter, on_exit

    def say(self, number: int, text: str, key: str = '') -> None:
        """Note a violation, each only once."""
        if (number, key or text) not in self._told:
            self._told.add((number, key or text))
            self.violations.append(Violation(number, self._world.now, text))

    # -- what the faults announce

    def killed(self, name: str) -> None:
        """Note that a process is killed or told to end."""
        self._faulted_at = SCHEDULER.now
        self._leaving.add(self._world.processes[name])
        self._died[self._world.processes[name]] = SCHEDULER.now
        if name in _MOVERS:
            self._rest_by.append((SCHEDULER.now, SCHEDULER.after(OWNER_SECONDS), f'{name} was killed'))
        if name == 'onboard_executive' and self._statuses:
            self._crashed_with = self._statuses[-1][1]

    def hangs(self, name: str, seconds: float) -> None:
        """Note that a process is stopped for a time, s."""
        self._faulted_at = SCHEDULER.after(seconds)
        if name in _MOVERS and seconds > HANG_SECONDS:
            self._rest_by.append((SCHEDULER.now, SCHEDULER.after(HANG_SECONDS), f'{name} hangs'))
        if name == 'simulator':
            self._delay_checks(seconds)

    def _delay_checks(self, seconds: float) -> None:
        """Count no time during which the simulator does not run."""
        more = int(seconds * SECOND)
        self._frozen_until = SCHEDULER.now + more
        self._stop_at = None if self._stop_at is None else self._stop_at + more
        self._rest_by = [(begin, end + more, text) for begin, end, text in self._rest_by]

    # -- what is published

    def _message(self, process: Process, topic: str, sample: Any) -> None:
        name = topic.lstrip('/')
        if self._is_over or not isinstance(sample, Sample):  # the request of a service
            return
        if name == names.EXECUTIVE_STATUS and process.name == 'onboard_executive':
            self._status(sample.message())
        elif name == names.CMD_VEL:
            twist = sample.message()
            if twist.linear.x or twist.linear.y or twist.angular.z:
                self._velocity(process)
        elif topic.endswith('/_action/status'):
            for one in sample.message().status_list:
                self._goal_has(bytes(one.goal_info.goal_id.uuid), one.status)
        self._record(name, sample)

    def _status(self, status: ExecutiveStatus) -> None:
        before = self._statuses[-1][1] if self._statuses else None
        self._statuses.append((SCHEDULER.now, status))
        self._by_sequence[status.executive_id, status.sequence] = SCHEDULER.now, status
        crashed, self._crashed_with = self._crashed_with, None
        if crashed is not None and crashed.executive_id == status.executive_id:
            self._crashed_with = crashed
        elif crashed is not None:
            self._after_crash(crashed, status)
        if before is not None and before.executive_id == status.executive_id and before.sequence >= status.sequence:
            self.say(6, f'status {status.sequence} follows {before.sequence}')
        for result in status.results:
            known = self._results.setdefault(result.command_id, result.code)
            if known != result.code:
                self.say(7, f'command {result.command_id[:8]} had the result {known}, and has {result.code} now')
        alive = {peer.name.lstrip('/'): peer.alive for peer in status.peers}
        self._see_processes()
        for name in _NODES:
            is_there, since = self._since[name]
            since = max(since, self._world.processes['onboard_executive'].began)
            if SCHEDULER.now - since > PEER_SECONDS * SECOND and name in alive and alive[name] != is_there:
                self.say(13, f'{name} is {"there" if is_there else "dead"} and shown {alive[name]}', name)

    def _after_crash(self, crashed: ExecutiveStatus, status: ExecutiveStatus) -> None:
        """Compare what was shown last with what the next executive shows first."""
        was_running = crashed.state in (ExecutiveStatus.RUNNING, ExecutiveStatus.PAUSED)
        is_interrupted, is_same = status.state == ExecutiveStatus.INTERRUPTED, status.run_id == crashed.run_id
        if was_running and not (is_interrupted and is_same) and crashed.run_id not in self._ended_runs():
            self.say(8, f'run {crashed.run_id} was shown as active, and after the crash {_told(status)}')
        if crashed.state == ExecutiveStatus.IDLE and crashed.run_id and is_same and is_interrupted:
            self.say(8, f'run {crashed.run_id} was shown as ended, and after the crash as interrupted')
        if was_running and is_interrupted:
            shown = {one.path for one in crashed.active_states}
            known = {one.path for one in status.active_states} | {
                one['path'] for one in self.events() if one['event'] == 'left' and one['run'] == crashed.run_id
            }
            if lost := shown - known:
                self.say(8, f'{", ".join(sorted(lost))} was shown as active, and is unknown after the crash')

    def _ended_runs(self) -> set[str]:
        return {one['run'] for one in self.events() if one['event'] == 'ended'}

    def _command_arrives(self, subscription: Subscription, command: ExecutiveCommand) -> None:
        process = subscription.process
        if process.held_up is not None or process.name not in ('onboard_executive', 'stop_guard'):
            return
        if command.kind == ExecutiveCommand.STOP:
            if self._stop_at is None and command.id not in self._results:
                self._stop_at = max(SCHEDULER.now, self._frozen_until) + int(STOP_SECONDS * SECOND)
        elif command.kind in (ExecutiveCommand.START, ExecutiveCommand.RESUME_RUN, ExecutiveCommand.QUEUE_ADD):
            self._stop_at = None

    def _velocity(self, process: Process) -> None:
        if process.name != 'navigation':
            self.say(4, f'{process} moves the robot', process.name)
        if self._statuses:
            since, status = self._statuses[-1]
            begin = next((when for when, one in reversed(self._statuses) if one.state != status.state), BOOT)
            is_free = status.state in (ExecutiveStatus.IDLE, ExecutiveStatus.INTERRUPTED, ExecutiveStatus.PAUSED)
            executive = self._world.processes['onboard_executive']
            is_well = executive.is_alive and SCHEDULER.now - self._faulted_at > 6 * SECOND
            first = next((when for when, one in self._statuses if when > begin), since)
            if is_free and is_well and SCHEDULER.now - first > OWNERLESS_SECONDS * SECOND:
                self.say(4, f'the robot is moved, and {_told(status)}', str(status.state))

    # -- goals

    def _service(self, end: _ServiceEnd, message: Any, request_id: Any) -> None:
        """Read a request or a response of an action."""
        name: str = end.service
        if name.endswith(('/send_goal', '/get_result')):
            key = (id(request_id.client), request_id.sequence_number)
            if isinstance(end, Client):
                self._asked[key] = bytes(message.goal_id.uuid)
            elif goal := self._asked.pop(key, None):
                if name.endswith('/send_goal') and message.accepted:
                    action, client = name.removesuffix('/_action/send_goal'), request_id.client.process
                    self._goals[goal] = _Goal(action, end.process, client)
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
        while not self._is_over:
            self._look()
            SCHEDULER.sleep(0.1)

    def _look(self) -> None:
        now, robot = SCHEDULER.now, self._world.robot
        simulator = self._world.processes['simulator']
        sees = simulator.is_alive and simulator.held_up is None
        self._see_processes()
        if not sees:
            return
        if self._stop_at is not None and now >= self._stop_at and not robot.at_rest:
            self.say(2, f'it moves {(now - self._stop_at) / SECOND:.2f} s after it had to be at rest', 'stop')
        if robot.at_rest:
            self._rest_by = [one for one in self._rest_by if now < one[0]]
        if any(process.name == 'navigation' and process.is_alive for process in self._restarted()):
            # A tree may have sent its goal again, to the new process.
            self._rest_by = [one for one in self._rest_by if one[2] != _NAVIGATION_DIED]
        for one in [one for one in self._rest_by if now > one[1]]:
            self._rest_by.remove(one)
            self.say(3, f'it has not been at rest since {one[2]} at {(one[0] - BOOT) / SECOND:.3f} s', one[2])
        self._check_goals()
        for mirror in self._mirrors:
            self._check_mirror(mirror)

    def _restarted(self) -> list[Process]:
        """Return the processes that have taken the place of dead ones."""
        names = {process.name for process in self._died}
        return [self._world.processes[name] for name in names if self._world.processes[name] not in self._died]

    def _check_goals(self) -> None:
        """Check that no goal outlives the process that has sent it."""
        for goal in self._goals.values():
            died = self._died.get(goal.client)
            if died is None or goal.status in _ENDED or not goal.server.is_alive or goal.server.held_up is not None:
                continue
            if SCHEDULER.now - max(died, self._faulted_at) > ORPHAN_SECONDS * SECOND:
                self.say(1, f'a goal of {goal.action} goes on after {goal.client} has died', goal.action)

    def _see_processes(self) -> None:
        """Note since when each node has been there, or has not."""
        for name in _NODES:
            process = self._world.processes[name]
            is_there = process.is_alive and process.held_up is None and process not in self._leaving
            if self._since[name][0] is not is_there or process.held_up is not None:
                self._since[name] = (
                    is_there,
                    SCHEDULER.now if process.held_up is None else SCHEDULER.now + 10 * SECOND,
                )

    def _check_mirror(self, mirror: Mirror) -> None:
        view = mirror.view()
        shown = view.snapshot
        if not view.live or shown is None:
            return
        sent, status = self._by_sequence.get((shown.executive_id, shown.sequence), (0, None))
        if status is None:
            if self._statuses and self._statuses[0][0] < SCHEDULER.now - 3 * SECOND:
                self.say(6, f'it shows status {shown.sequence}, which the executive has not sent', 'unknown')
            return
        paths = tuple(one.path for one in status.active_states)
        if (int(shown.state), shown.run_id, tuple(one.path for one in shown.active_states)) != (
            status.state,
            status.run_id,
            paths,
        ):
            self.say(6, f'it shows {shown.state.name} in {shown.active_states}, and {_told(status)}', 'other')
        slack = MIRROR_SECONDS + 20.0 * self._world.network.link().delay + 10.0 * self._world.network.link().loss
        newest = next((one for one in reversed(self._statuses) if one[0] < SCHEDULER.now - slack * SECOND), None)
        if newest is None or newest[0] <= sent:
            return
        if (newest[1].state, {one.path for one in newest[1].active_states}) != (status.state, set(paths)):
            self.say(6, f'it is live, and shows {_told(status)}; {slack:.1f} s ago {_told(newest[1])}', 'old')

    # -- the files

    def events(self) -> Iterator[dict[str, Any]]:
        """Yield the events of the event log, oldest first."""
        files = sorted(self._directory.glob('*.jsonl'), key=lambda file: file.name.count('.') == 1)
        for file in files:
            for line in file.read_text(errors='replace').splitlines():
                try:
                    yield json.loads(line)
                except ValueError:
                    continue  # cut off by a crash

    def end(self) -> None:
        """End the checks: what follows is the end of the world."""
        self._is_over = True

    def finish(self, commands: dict[str, Any]) -> None:
        """Check the files and the log. ``commands``: results that operators have seen, by id."""
        status = self._statuses[-1][1] if self._statuses else None
        is_idle = status is not None and status.state == ExecutiveStatus.IDLE
        for (pid, _), (name, depth) in self._entered.items():
            if depth and SCHEDULER.processes[pid].is_alive and is_idle:
                self.say(5, f'a {name} is not left')
        active: set[str] = set()
        decided: Counter[str] = Counter()
        holder, applied_starts, runs = '', 0, 0
        last: dict[str, Any] | None = None
        for one in self.events():
            run = one.get('run', '')
            match one['event']:
                case 'executive' if one['state'] == 'started':
                    active.clear()
                    holder = ''
                case 'started' | 'resumed':
                    runs += one['event'] == 'started'
                    if active:
                        self.say(11, f'run {run} begins while {", ".join(sorted(active))} is active')
                    active.add(run)
                case 'ended':
                    last = one
                    active.discard(run)
                case 'authority':
                    if holder not in ('', one['holder']) and 'claimed it' in one['text']:
                        self.say(14, f'{one["holder"]} takes the authority, and {holder} has it')
                    holder = one.get('holder', '')
                case 'command' if one.get('effect') in ('applied', 'refused'):
                    decided[one.get('id', '')] += 1
                    applied_starts += one['effect'] == 'applied' and one['command'] == 'START'
                    operator = one.get('operator', '')
                    if one['effect'] == 'applied' and holder not in ('', operator) and one['command'] not in _FREE:
                        self.say(14, f'{one["command"]} of {operator} is applied, and {holder} has the authority')
        has_crashed = any(process.name == 'onboard_executive' for process in self._died)
        if runs > applied_starts or (runs < applied_starts and not has_crashed):
            self.say(7, f'{runs} runs began, and {applied_starts} STARTs were applied')
        for command, number in decided.items():
            if number > 1 and command:
                self.say(7, f'command {command[:8]} was decided {number} times')
        if status is not None and is_idle:
            if active:
                self.say(11, f'{", ".join(sorted(active))} has no end in the event log, and the executive is idle')
            elif last is not None and status.run_id == last['run'] and status.outcome != last['outcome']:
                self.say(11, f'run {status.run_id}: {status.outcome!r} is shown, {last["outcome"]!r} is logged')
        for tracked, code in commands.items():
            if code is not None and self._results.get(tracked, code) != code:
                self.say(7, f'command {tracked[:8]} is shown as {code}, and has the result {self._results[tracked]}')
        for goal in self._goals.values() if is_idle else ():
            if goal.status not in _ENDED and goal.server.is_alive:
                self.say(1, f'a goal of {goal.action} has not ended', goal.action)
        for when, process, _severity, logger, text in DOMAIN.log:
            if fault := next((fault for fault in _FAULTS if fault in text), None):
                self.say(9, f'{process} {logger} at {(when - BOOT) / SECOND:.3f} s: {text[:400]}', fault)


_NAVIGATION_DIED: Final = 'navigation was killed'
_STATES: Final = (BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, OperatorInputState)
_COMMANDS: Final = (f'/{names.EXECUTIVE_COMMAND}', f'/{names.EXECUTIVE_STOP}')


def _told(status: ExecutiveStatus) -> str:
    name = next(
        key
        for key in ('UNKNOWN', 'IDLE', 'STARTING', 'RUNNING', 'PAUSED', 'STOPPING', 'INTERRUPTED')
        if getattr(ExecutiveStatus, key) == status.state
    )
    paths = ', '.join(one.path for one in status.active_states)
    return f'the executive is {name} {paths} ({status.run_id or "no run"})'
