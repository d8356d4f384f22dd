# SPDX-License-Identifier: BSD-3-Clause
"""What becomes of a robot that drives when a process is killed or stopped, a thread hangs, or something is flooded.

Each trial drives the robot (behavior Navigate, real processes, the simulator at speed 1), waits for a random moment,
and kills (kill -9) one process, or stops it (SIGSTOP) and lets it go on after 3 s, or has one of its threads hang for
3 s (or for --seconds), as by a callback that does not return, while all others go on. For each the table has the metres
driven and the seconds of the robot's clock until rest after the fault, and the state of the executive's run two seconds
after the process is back (a killed one is started again, as a launched system does). With --stop-after, the operator
stops the run so long after each fault, and the table has what has moved until these two seconds are over.

With --floods, another process sends 5,000 messages or requests a second for 10 s, of one kind that the processes of the
robot take: each topic, service and action with TEXT in its name. After 4 s the operator stops the run; the table has
metres and seconds from that stop on, how much the processes have grown, s from the end of the flood until all is ready
again and a command is answered, and what the operator was told.

With --attacks, the operator stops a robot that is attacked (:mod:`_attack`; ``none`` is no attack) from each console,
while the executive is alive, hangs (SIGSTOP) or is dead, and while a run drives the robot or another program of Nav2's.
The table has metres and seconds from the key, or from when the STOP of the line mode has left it, until rest; after how
long it has left; who has confirmed it; and how much the processes have grown. STOP has to act within 1.0 s and 0.3 m.

Usage: python3 benchmarks faults [--kills N] [--stops N] [--hangs N] [--of NAME ...] [--seconds S] [--stop-after S]
                                 [--floods [TEXT ...]] [--seed N] [--output FILE.json]
       python3 benchmarks faults --attacks [NAME ...] [--consoles TEXT ...] [--executives alive|hung|dead ...]
                                 [--drivers run|program ...] [--attack-seconds S] [--output FILE.json]
       (so many of each process, hangs of each thread; --of: only processes whose name contains one of NAME)
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import math
import os
import random
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final, TextIO

from _attack import NAMES as ATTACKS
from _consoles import CONSOLES, OPERATOR, ConsoleEndedError
from _figures import write_figures
from domain_coordinator import domain_id
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, StopGuardStatus
from flexbt_testing.system.hold_up import THREADS
from flexbt_testing.system.probe import Probe, stamp
from flexbt_testing.system.processes import Stack

PLACES: Final = ((10.0, 2.3), (3.8, 1.2))
STOPPED_SECONDS: Final = 3.0
REST_SECONDS: Final = 1.0
"""A fault may let the robot move so long, s."""

FLOOD_RATE: Final = 5000.0
FLOOD_SECONDS: Final = 10.0
FLOOD_STOP_SECONDS: Final = 4.0
"""Messages a second, for so long, and when the operator stops the run meanwhile."""

BEGIN_SECONDS: Final = 120.0
"""For so long a flood, or an attack, may take to begin."""

NO_ATTACK: Final = 'none'
ATTACK_SECONDS: Final = 5.0
EXECUTIVES: Final = ('alive', 'hung', 'dead')
DRIVERS: Final = ('run', 'program')
LINE_MODE: Final = 'console (line mode)'

STOP_SECONDS: Final = 6.0
"""For so long after a STOP it is looked where the robot has got to."""

STOP_METRES: Final = 0.3
"""A STOP may let the robot move so far, m, and for REST_SECONDS."""

AUTHORITY_SECONDS: Final = 10.0
"""After which an operator without a console loses the authority."""

STATES: Final = {
    getattr(ExecutiveStatus, name): name
    for name in ('UNKNOWN', 'IDLE', 'STARTING', 'RUNNING', 'PAUSED', 'STOPPING', 'INTERRUPTED')
}


def main() -> int:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--kills', type=int, default=5, help='of each process')
    parser.add_argument('--stops', type=int, default=1, help='of each process')
    parser.add_argument('--hangs', type=int, default=1, help='of each thread')
    parser.add_argument('--of', nargs='+', metavar='NAME', default=[''])
    parser.add_argument('--seconds', type=float, default=STOPPED_SECONDS, help='that a process is stopped, or hangs')
    parser.add_argument('--stop-after', type=float, metavar='S', help='the operator stops the run then')
    parser.add_argument(
        '--floods',
        nargs='*',
        metavar='TEXT',
        help='flood topics, services and actions whose name contains one of TEXT; without TEXT, all',
    )
    parser.add_argument('--attacks', nargs='*', metavar='NAME', choices=(NO_ATTACK, *ATTACKS))
    parser.add_argument('--consoles', nargs='+', metavar='TEXT', default=[''], help='whose name contains one of TEXT')
    parser.add_argument('--executives', nargs='+', choices=EXECUTIVES, default=EXECUTIVES)
    parser.add_argument('--drivers', nargs='+', choices=DRIVERS, default=DRIVERS)
    parser.add_argument('--attack-seconds', type=float, default=ATTACK_SECONDS, help='of the attack before the STOP')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    if options.stop_after is not None and not 0.0 <= options.stop_after < options.seconds:
        parser.error(f'--stop-after {options.stop_after:g}: give less than the {options.seconds:g} s of the fault')
    chance = random.Random(options.seed)
    one_trial = partial(trial, chance=chance, seconds=options.seconds, stop_after=options.stop_after)
    trials: list[tuple[bool, Callable[[Stack, Probe], dict[str, Any]]]] = [
        (how == 'hang', partial(one_trial, how=how, name=name, thread=thread))
        for how, count in (('kill', options.kills), ('stop', options.stops), ('hang', options.hangs))
        for name, threads in THREADS.items()
        if any(text in name for text in options.of)
        for thread in (threads if how == 'hang' else ('',))
        for _ in range(count)
    ] + [
        (False, partial(console_trial, how=how, name=name, chance=chance))
        for how, count in (('kill', options.kills), ('stop', options.stops))
        for name in CONSOLES
        if any(text in name for text in options.of)
        for _ in range(count)
    ]
    if options.attacks is not None:
        trials = [
            (
                False,
                partial(
                    attacked,
                    attack=attack,
                    name=name,
                    executive=executive,
                    driver=driver,
                    seconds=options.attack_seconds,
                ),
            )
            for attack in options.attacks or (NO_ATTACK, *ATTACKS)
            for name in CONSOLES
            if any(text in name for text in options.consoles)
            for executive in options.executives
            for driver in options.drivers
        ]
    rows = []
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        if options.floods is not None:
            trials += [(False, partial(flood, name=name, kind=kind)) for name, kind in flooded(options.floods or [''])]
        for number, (can_be_held_up, measure) in enumerate(trials):
            logs = Path(directory) / str(number)
            logs.mkdir()
            # The stack shows what its processes have said.
            with (
                contextlib.redirect_stdout(io.StringIO()),
                Stack(logs, can_be_held_up=can_be_held_up, forked=False) as stack,
                NodeRuntime.open('probe') as runtime,
            ):
                stack.start_all(
                    bt_server={'navigators': f'["{names.NAVIGATE_TO_POSE}"]'},
                    onboard_executive={'authority_timeout': str(AUTHORITY_SECONDS)},
                )
                probe = Probe(runtime)
                try:
                    probe.wait_ready()
                    rows.append(measure(stack, probe))
                except AssertionError as error:  # the others are measured all the same
                    rows.append(failed(measure, error))
            print(line(rows[-1]), flush=True)
    if options.output is not None:
        write_figures(options.output, {'faults': rows})
    return 0 if all(row['seconds'] < REST_SECONDS and not row.get('wrong') for row in rows) else 1


def trial(
    stack: Stack,
    probe: Probe,
    how: str,
    name: str,
    thread: str,
    chance: random.Random,
    seconds: float,
    stop_after: float | None,
) -> dict[str, Any]:
    """One drive with one fault: of a process, or of a thread of it; the operator stops it meanwhile, or does not."""
    probe.drive_to(*chance.choice(PLACES))
    time.sleep(chance.uniform(0.0, 3.0))
    there = probe.pose
    if how == 'kill':
        stack.kill(name)
    elif how == 'hang':
        stack.hold_up(name, THREADS[name][thread], seconds)
    else:
        stack.send_signal(name, signal.SIGSTOP)
    if stop_after is not None:
        time.sleep(stop_after)
        probe.stop()
    time.sleep(seconds - (stop_after or 0.0))
    rest, moved = probe.pose, probe.moved_stamp
    if how == 'kill':
        stack.start(name)
        probe.wait(lambda: probe.peer_alive(name) is not False, f'{name} alive again')
    elif how == 'stop':
        stack.send_signal(name, signal.SIGCONT)
    time.sleep(2.0)
    if stop_after is not None:
        rest, moved = probe.pose, probe.moved_stamp
    assert there is not None and rest is not None
    return {
        'fault': how,
        'process': f'{name} {thread}'.rstrip(),
        'metres': distance(there, rest),
        'seconds': round(max(0.0, moved - stamp(there)), 2),
        'run': f'{STATES[probe.status.state]} {probe.status.outcome} {probe.status.message}'.strip(),
    }


def console_trial(stack: Stack, probe: Probe, how: str, name: str, chance: random.Random) -> dict[str, Any]:
    """One drive with one fault of a console that pauses and resumes it again and again."""
    probe.drive_to(*chance.choice(PLACES))
    given, told = ['claim'], ['claim']
    seen: list[tuple[int, PoseStamped | None, float]] = []
    is_over = threading.Event()

    def fault() -> None:
        time.sleep(chance.uniform(0.0, 6.0))
        console.send_signal(signal.SIGKILL if how == 'kill' else signal.SIGSTOP)
        for _ in range(2):
            time.sleep(STOPPED_SECONDS / 2.0)
            seen.append((probe.status.state, probe.pose, probe.moved_stamp))
        if how == 'stop':
            console.send_signal(signal.SIGCONT)
        is_over.set()

    with CONSOLES[name]() as console:
        console.do('claim', partial(has_effect, probe, 'claim'))
        thread = threading.Thread(target=fault)
        thread.start()
        with contextlib.suppress(ConsoleEndedError):
            for command in itertools.cycle(('pause', 'resume')):
                last = is_over.is_set()
                given.append(command)
                console.do(command, partial(has_effect, probe, command))
                told.append(command)
                if last:
                    break
        thread.join()
    (log,) = stack.directory.glob('*.jsonl')
    events = [json.loads(line) for line in log.read_text(encoding='utf-8').splitlines()]
    applied = [
        one['command'].lower().removesuffix('_authority')
        for one in events
        if one['event'] == 'command' and one['operator'] == OPERATOR and one['effect'] == 'applied'
    ]
    (first, there, _), (second, rest, moved) = seen
    assert there is not None and rest is not None
    stood = first == second == ExecutiveStatus.PAUSED
    wrong = [] if len(told) <= len(applied) and applied == given[: len(applied)] else [f'{given=} {told=} {applied=}']
    holder, began = probe.status.authority, time.monotonic()
    if holder != OPERATOR and (holder or how == 'stop'):
        wrong.append(f'the authority is with {holder!r}')
    state = STATES[probe.status.state]
    probe.wait(lambda: probe.status.authority == '', 'authority that is free')
    free = time.monotonic() - began
    probe.applied(ExecutiveCommand.CLAIM_AUTHORITY)
    probe.applied(ExecutiveCommand.STOP)
    probe.wait_state(ExecutiveStatus.IDLE)
    return {
        'fault': how,
        'process': name,
        'metres': distance(there, rest) if stood else 0.0,
        'seconds': round(max(0.0, moved - stamp(there)), 2) if stood else 0.0,
        'run': f'{state}; of {len(given)} commands {len(told)} told as applied, {len(applied)} applied; authority free '
        f'{free:.1f} s after the console; {"; ".join(wrong) or "all right"}',
        'wrong': wrong,
    }


def has_effect(probe: Probe, command: str) -> bool:
    """Return whether the executive shows what a command of a console brings about."""
    if command == 'claim':
        return bool(probe.status.authority == OPERATOR)
    state = ExecutiveStatus.PAUSED if command == 'pause' else ExecutiveStatus.RUNNING
    return bool(probe.status.state == state)


def flooded(texts: list[str]) -> list[tuple[str, str]]:
    """Topics, services and parts of actions with one of these texts in the name, of a robot; and what each is, with its
    type."""
    found: set[tuple[str, str]] = set()
    with (
        tempfile.TemporaryDirectory() as directory,
        contextlib.redirect_stdout(io.StringIO()),
        Stack(Path(directory)) as stack,
        NodeRuntime.open('probe') as runtime,
    ):
        stack.start_all()
        Probe(runtime).wait_ready()
        node = runtime.node
        asked = {
            'topic': node.get_subscriber_names_and_types_by_node,
            'service': node.get_service_names_and_types_by_node,
        }
        for what, ask in asked.items():
            for process in THREADS:
                found |= {(name, f'{what} {types[0]}') for name, types in runtime.call(partial(ask, process, '/'))}
    return sorted((name, kind) for name, kind in found if any(text in name for text in texts))


def memory(stack: Stack) -> dict[str, int]:
    """Resident MB of each process."""
    return {
        name: int(Path(f'/proc/{stack.process_id(name)}/statm').read_text().split()[1])
        * os.sysconf('SC_PAGE_SIZE')
        // 10**6
        for name in stack.running()
    }


def flood(stack: Stack, probe: Probe, name: str, kind: str) -> dict[str, Any]:
    """One drive that is stopped while something is flooded; ``kind`` says what that is, and has its type."""
    probe.drive_to(*PLACES[0])
    before, told = memory(stack), len(probe.logs)
    what, type_name = kind.split()
    script = str(Path(__file__).with_name('_flood.py'))
    words = [sys.executable, script, what, name, type_name, str(FLOOD_RATE), str(os.getpid())]
    with (
        tempfile.TemporaryFile('w+') as said,
        subprocess.Popen(words, stdout=subprocess.PIPE, stderr=said) as flooder,
    ):
        try:
            assert flooder.stdout is not None
            if not (select.select([flooder.stdout], [], [], BEGIN_SECONDS)[0] and flooder.stdout.readline()):
                return unflooded(name, f'has not begun within {BEGIN_SECONDS:g} s', said)
            time.sleep(FLOOD_STOP_SECONDS)
            there, state = probe.pose, STATES[probe.status.state]
            probe.send(ExecutiveCommand.STOP)
            time.sleep(FLOOD_SECONDS - FLOOD_STOP_SECONDS)
            rest, moved, after = probe.pose, probe.moved_stamp, memory(stack)
            if flooder.poll() is not None:
                return unflooded(name, f'has ended with {flooder.returncode}', said)
        finally:
            flooder.kill()
    assert there is not None and rest is not None
    began = time.monotonic()
    probe.wait_ready()
    probe.applied(ExecutiveCommand.NOTE, text='after the flood')
    grown = {process: after.get(process, 0) - megabytes for process, megabytes in before.items()}
    ready = time.monotonic() - began
    texts = [log.text for log in probe.logs[told:]]
    return {
        'fault': 'flood',
        'process': name,
        'metres': distance(there, rest),
        'seconds': round(max(0.0, moved - stamp(there)), 2),
        'run': f'{state}, {STATES[probe.status.state]} {probe.status.outcome}; {grown} MB; ready after {ready:.1f} s; '
        f'{texts}',
    }


def unflooded(name: str, why: str, said: TextIO) -> dict[str, Any]:
    """Return the row of a trial in which nothing was flooded to the end, which so has failed; with what the flooder
    said."""
    said.seek(0)
    run = f'the flood {why}: {said.read().strip()[-1000:]}'
    return {'fault': 'flood', 'process': name, 'metres': 0.0, 'seconds': FLOOD_SECONDS, 'run': run}


@contextlib.contextmanager
def stalled_log(stack: Stack, probe: Probe, attack: str) -> Iterator[None]:
    """Nobody reads the log of the executive, which is started again for that; nothing for other attacks."""
    if attack != 'log':
        yield
        return
    before = probe.status.executive_id
    stack.kill('onboard_executive')
    file = stack.directory / 'onboard_executive.log'
    file.unlink()
    os.mkfifo(file)
    reader = os.open(file, os.O_RDWR)
    try:
        stack.start('onboard_executive')
        probe.wait(lambda: probe.status.executive_id != before, 'another executive')
        probe.wait_ready()
        yield
    finally:
        os.close(reader)
        file.unlink()


@contextlib.contextmanager
def attacking(attack: str) -> Iterator[Callable[[], object]]:
    """Somebody is ready to attack the robot, which may take long to join; what is given has them do it."""
    if attack == NO_ATTACK:
        yield lambda: None
        return
    words = [sys.executable, str(Path(__file__).with_name('_attack.py')), attack]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as attacker:
        try:
            assert attacker.stdout is not None
            began = select.select([attacker.stdout], [], [], BEGIN_SECONDS)[0] and attacker.stdout.readline()
            assert began, f'{attack} has not begun within {BEGIN_SECONDS:g} s'
            attacker.send_signal(signal.SIGSTOP)
            yield partial(attacker.send_signal, signal.SIGCONT)
        finally:
            attacker.kill()


class Answers:
    """When a STOP of the operator has left the console, where the robot was then, and who has confirmed it."""

    def __init__(self, probe: Probe) -> None:
        self.left: float | None = None
        self.there: PoseStamped | None = None
        self._stop_id = ''
        self._guard: set[str] = set()
        self._probe = probe
        probe.console.call(self._open)

    def _open(self) -> None:
        node = self._probe.console.node
        ReceivedMessages(node, ExecutiveCommand, names.EXECUTIVE_STOP, names.stop_qos(), self._on_stop, 10_000)
        node.create_subscription(StopGuardStatus, names.STOP_GUARD_STATUS, self._on_guard, names.transient_local_qos())

    def _on_stop(self, received: Received) -> None:
        if self.left is None and received.data is not None and OPERATOR.encode() in received.data:
            self._stop_id = received.unpack(ExecutiveCommand).id
            self.left, self.there = time.monotonic(), self._probe.pose

    def _on_guard(self, status: StopGuardStatus) -> None:
        self._guard |= {result.command_id for result in status.results}

    @property
    def confirmed(self) -> str:
        """By whom."""
        answers = (result.command_id for status in self._probe.statuses[-500:] for result in status.results)
        by = [('executive', self._stop_id in answers), ('stop guard', self._stop_id in self._guard)]
        return ' and '.join(who for who, has_confirmed in by if has_confirmed) or 'nobody'


def drive(probe: Probe, driver: str) -> None:
    """Have the robot driven to the first place, and wait until it drives."""
    if driver == 'run':
        probe.drive_to(*PLACES[0])
        return
    assert probe.pose is not None
    began = probe.pose
    pose = PoseStamped(header=Header(frame_id='map'))
    pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = *PLACES[0], 1.0
    link = ActionLinks(probe.console).link(NavigateToPose, names.NAVIGATE_TO_POSE)
    ActionCall(link, NavigateToPose.Goal(pose=pose), on_done=lambda _: None)
    probe.wait(lambda: probe.pose is not None and distance(began, probe.pose) > 0.5, 'the robot drives')


def attacked(
    stack: Stack, probe: Probe, attack: str, name: str, executive: str, driver: str, seconds: float
) -> dict[str, Any]:
    """One drive that is stopped from a console, while something attacks the robot."""
    with stalled_log(stack, probe, attack), attacking(attack) as attack_now:
        drive(probe, driver)
        answers, before = Answers(probe), memory(stack)
        with CONSOLES[name]() as console:
            attack_now()
            console.go_on(seconds)
            if executive == 'hung':
                stack.send_signal('onboard_executive', signal.SIGSTOP)
            elif executive == 'dead':
                stack.kill('onboard_executive')
            there, pressed = probe.pose, time.monotonic()
            console.stop()
            console.go_on(STOP_SECONDS)
            if name == LINE_MODE and answers.there is not None:
                there = answers.there
            rest, moved, after = probe.pose, probe.moved_stamp, memory(stack)
    assert there is not None and rest is not None
    metres, took = distance(there, rest), round(max(0.0, moved - stamp(there)), 2)
    left = 'never' if answers.left is None else f'after {answers.left - pressed:.2f} s'
    is_wrong = metres > STOP_METRES or took > REST_SECONDS or answers.left is None
    grown = {process: after[process] - megabytes for process, megabytes in before.items() if process in after}
    return {
        'fault': attack,
        'process': f'{name.partition("(")[2].rstrip(")")}, executive {executive}, {driver}',
        'metres': metres,
        'seconds': took,
        'run': f'left {left}; confirmed by {answers.confirmed}; {grown} MB{"; TOO LATE" if is_wrong else ""}',
        'wrong': is_wrong,
    }


def failed(measure: Any, error: AssertionError) -> dict[str, Any]:
    """Return the row of a trial that came to no end."""
    given = ', '.join(str(value) for value in measure.keywords.values())
    row = {'fault': 'failed', 'process': given, 'metres': 0.0, 'seconds': 0.0, 'run': str(error)[:300]}
    return {**row, 'wrong': True}


def distance(one: PoseStamped, other: PoseStamped) -> float:
    """m, to the millimetre."""
    a, b = one.pose.position, other.pose.position
    return round(math.dist((a.x, a.y), (b.x, b.y)), 3)


def line(row: dict[str, Any]) -> str:
    """Return a row of the table."""
    return f'{row["fault"]:12} {row["process"]:34} {row["metres"]:6.3f} m {row["seconds"]:5.2f} s  {row["run"]}'


if __name__ == '__main__':
    sys.exit(main())
