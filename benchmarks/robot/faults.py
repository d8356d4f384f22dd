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

Usage: python3 benchmarks faults [--kills N] [--stops N] [--hangs N] [--of NAME ...] [--seconds S] [--stop-after S]
                                 [--floods [TEXT ...]] [--seed N] [--output FILE.json]
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
from functools import partial
from pathlib import Path
from typing import Any, Final, TextIO

from _consoles import CONSOLES, OPERATOR, ConsoleEndedError
from _figures import write_figures
from domain_coordinator import domain_id
from geometry_msgs.msg import PoseStamped

from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
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

BEGIN_SECONDS: Final = 30.0
"""For so long a flood may take to begin."""

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
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    if options.stop_after is not None and not 0.0 <= options.stop_after < options.seconds:
        parser.error(f'--stop-after {options.stop_after:g}: give less than the {options.seconds:g} s of the fault')
    chance = random.Random(options.seed)
    drive = partial(trial, chance=chance, seconds=options.seconds, stop_after=options.stop_after)
    trials = [
        (how == 'hang', partial(drive, how=how, name=name, thread=thread))
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
                stack.start_all(onboard_executive={'authority_timeout': str(AUTHORITY_SECONDS)})
                probe = Probe(runtime)
                probe.wait_ready()
                rows.append(measure(stack, probe))
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
    """Whether the executive shows what a command of a console brings about."""
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
    """The row of a trial in which nothing was flooded to the end, which so has failed; with what the flooder said."""
    said.seek(0)
    run = f'the flood {why}: {said.read().strip()[-1000:]}'
    return {'fault': 'flood', 'process': name, 'metres': 0.0, 'seconds': FLOOD_SECONDS, 'run': run}


def distance(one: PoseStamped, other: PoseStamped) -> float:
    """m, to the millimetre."""
    a, b = one.pose.position, other.pose.position
    return round(math.dist((a.x, a.y), (b.x, b.y)), 3)


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    return f'{row["fault"]:5} {row["process"]:26} {row["metres"]:6.3f} m {row["seconds"]:5.2f} s  {row["run"]}'


if __name__ == '__main__':
    sys.exit(main())
