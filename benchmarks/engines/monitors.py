# SPDX-License-Identifier: BSD-3-Clause
"""What monitors cost: a transition and a tick with and without them, on the robot's nodes and of the engines alone.

The nodes are an executive that writes its event log, with states that end at once, each in a step of its own, and a BT
server that streams the statuses of a tree of 10 nodes, of which one leaf is RUNNING. With and without take turns; what
counts is the processor time of all threads of the process, by transition and by tick, and the least of the rounds: what
else the machine does only adds to it. The share is what the monitors add to the engine, of what the node takes in all:
it is told apart from noise, as the ratio of the nodes is not on a busy machine.

Usage: python3 benchmarks monitors [--rounds N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import gc
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import _monitored_nodes
from _figures import write_figures
from _hfsm_subjects import Subject

from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.monitors.tree_monitor import TreeMonitor
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.server_world import install_nodes, open_server_world

TARGET: Final = 0.03
"""Most of a transition, or of a tick, on the nodes."""
TRANSITIONS: Final = 5000
TICKS: Final = 10_000
BODY: Final = (
    '<ReactiveSequence><AlwaysSuccess/><Inverter><AlwaysFailure/></Inverter><Sequence><AlwaysSuccess/>'
    '<Fallback><AlwaysFailure/><Busy ticks="{ticks}"/></Fallback></Sequence></ReactiveSequence>'
)


class _Pass(EventState):
    """Ends in the step after the one in which it was entered; the last one tells that it is the last."""

    skill = Skill.of(resources=['base'])

    def __init__(self, done: threading.Event, count: list[int]) -> None:
        super().__init__(outcomes=['done', 'last'], desired_rate=None)
        self._done, self._count = done, count
        self._is_woken = False

    def on_enter(self, userdata: UserData) -> None:
        self._count[0] += 1
        self._is_woken = False

    def execute(self, userdata: UserData) -> str | None:
        if self._count[0] > TRANSITIONS:
            self._done.set()
            return 'last'
        if self._is_woken:
            return 'done'
        self._is_woken = True
        self.wake()
        return None


def transition_on_executive(is_on: bool) -> float:
    """Microseconds."""
    done, count = threading.Event(), [0]

    def ring() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['ended'])
        with machine:
            for label, following in (('One', 'Other'), ('Other', 'One')):
                OperatableStateMachine.add(label, _Pass(done, count), {'done': following, 'last': 'ended'})
        return machine

    with tempfile.TemporaryDirectory() as directory:
        parameters = ExecutiveParameters(peers=(), event_log_directory=directory, monitoring=Monitoring(is_on))
        bench = ExecutiveBench(behavior_of(ring), parameters=parameters)
        try:
            began = time.process_time()
            bench.start()
            assert done.wait(120.0)
            return (time.process_time() - began) / TRANSITIONS * 1e6
        finally:
            bench.close()


def tick_on_server(is_on: bool) -> float:
    """Microseconds."""
    with open_server_world(monitors=is_on) as world:
        world.client.load_tree(BODY.format(ticks=TICKS))
        began = time.process_time()
        assert not world.client.execute('Main').result.message
        return (time.process_time() - began) / TICKS * 1e6


def transition_of_engine(is_on: bool) -> float:
    """Microseconds."""
    return Subject('flat', 'woken', is_monitored=is_on).sample()


def tick_of_engine(is_on: bool) -> float:
    """Microseconds."""
    registry = builtin_registry()
    _monitored_nodes.register(registry)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{BODY.format(ticks=10**9)}</BehaviorTree></root>'
    monitor = TreeMonitor(_fail) if is_on else None
    log: list[int] = []
    tree = Tree(
        TreeLibrary([load_xml(text, 'main.xml', registry)]),
        'Main',
        clock=ManualClock(),
        substitute=None if monitor is None else monitor.watched,
    )
    tree.observe(StatusLog(log))
    if monitor is not None:
        monitor.begins(tree)
    began = time.thread_time()
    for _ in range(TICKS):
        status = tree.tick_once()
        if monitor is not None:
            monitor.ticked(status)
        log.clear()
    return (time.thread_time() - began) / TICKS * 1e6


def _fail(violation: Any) -> None:
    raise AssertionError(violation)


SUBJECTS: Final[dict[str, Callable[[bool], float]]] = {
    'transition on the executive': transition_on_executive,
    'tick on the BT server': tick_on_server,
    'transition of the engine alone': transition_of_engine,
    'tick of the engine alone': tick_of_engine,
}
PAIRS: Final = {
    'transition on the executive': 'transition of the engine alone',
    'tick on the BT server': 'tick of the engine alone',
}
"""What is measured on the nodes, and what of it is the engine."""


def measure(subject: Callable[[bool], float], rounds: int) -> dict[str, float]:
    """Return the least of both, and their ratio; who comes first takes turns."""
    subject(True), subject(False)
    samples: dict[bool, list[float]] = {True: [], False: []}
    for number in range(rounds):
        gc.collect()
        for is_on in (True, False) if number % 2 else (False, True):
            samples[is_on].append(subject(is_on))
    without, with_them = min(samples[False]), min(samples[True])
    return {'without, us': without, 'with, us': with_them, 'ratio': with_them / without}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=11)
    parser.add_argument('--output', type=Path, default=Path('out/monitors.json'))
    options = parser.parse_args()
    figures = {}
    with tempfile.TemporaryDirectory() as directory:
        install_nodes(Path(directory), _monitored_nodes.__name__)
        print(f'{"microseconds":34}{"without":>9}{"with":>9}{"ratio":>8}')
        for name, subject in SUBJECTS.items():
            found = figures[name] = measure(subject, options.rounds)
            print(f'{name:34}{found["without, us"]:9.2f}{found["with, us"]:9.2f}{found["ratio"]:8.3f}', flush=True)
    shares = {}
    for node, engine in PAIRS.items():
        added = figures[engine]['with, us'] - figures[engine]['without, us']
        shares[node] = added / figures[node]['without, us']
        print(f'share of a {node}: {shares[node]:.1%}')
    print(f'target: at most {TARGET:.0%}')
    write_figures(options.output, {**figures, 'shares': shares})
    return 0 if max(shares.values()) <= TARGET else 1


if __name__ == '__main__':
    sys.exit(main())
