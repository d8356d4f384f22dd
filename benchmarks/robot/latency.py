# SPDX-License-Identifier: BSD-3-Clause
"""How fast the system reacts, with every part a process of its own.

1. From the leaf's result to the transition of the state machine: the time from the moment at which the action server of
   a leaf ends its goal to the entry of the next HFSM state (leaf, tree, BtExecute result, executive).
2. From an operator's command to its effect: the time from publishing a FORCE command to the entry of the state that
   it leads to.

Both ends are stamped on the system clock. FlexBE 2.3.3 at its default rate of 10 Hz needs 54 ms on average and
99 ms at the 95th percentile for the second (engine alone, measured on the same kind of machine).

Usage: python3 benchmarks latency [--samples N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

from _figures import install_behavior, write_figures
from domain_coordinator import domain_id
from nav2_msgs.action import Wait

from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.discovery import only_this_computer
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.action import BtLoad
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.processes import executable
from flexbt_testing.waiting import wait_until

HERE: Final = Path(__file__).resolve().parent
DEADLINE = 20.0
FLEXBE_MEAN_MS = 54.0
LEAF_SECONDS = 0.15  # long enough for the status, which comes at 20 Hz at most, to show the state of the tree


class Probe(Operator):
    """The leaf's action server and the operator, in this process."""

    def __init__(self, runtime: NodeRuntime) -> None:
        super().__init__(runtime, 'benchmark')
        self.entered: dict[str, float] = {}
        self.result_sent = 0.0
        self.links = ActionLinks(runtime)
        runtime.call(lambda: GoalServer(runtime, Wait, 'latency_probe/wait', self._serve))

    def _serve(self, goal: ServedGoal) -> None:
        steady = self.console.steady
        steady.call_at(steady.now() + LEAF_SECONDS, lambda: self.console.post(lambda: self._end(goal)))

    def _end(self, goal: ServedGoal) -> None:
        self.result_sent = time.time()
        goal.succeed(Wait.Result())

    def _on_status(self, status: ExecutiveStatus) -> None:
        for active in status.active_states:
            self.entered[active.path] = active.entered.sec + active.entered.nanosec / 1e9
        super()._on_status(status)

    def entered_after(self, path: str, before: float) -> bool:
        """Return whether a state was entered after a time."""
        return self.entered.get(path, 0.0) > before

    def command(self, kind: int, **fields: Any) -> float:
        """Publish a command; the time when."""
        now = time.time()
        self.send(kind, **fields)
        return now

    def load(self, xml: str) -> None:
        """Load the tree."""
        ended: list[Any] = []
        done = threading.Event()

        def on_done(outcome: Any) -> None:
            ended.append(outcome)
            done.set()

        ActionCall(
            self.links.link(BtLoad, 'bt_loader'),
            BtLoad.Goal(xml=xml),
            on_done=on_done,
            server_timeout=DEADLINE,
        )
        if not done.wait(DEADLINE) or ended[0].status.name != 'SUCCEEDED':
            raise RuntimeError(f'the tree was not loaded: {ended}')


def measure(samples: int) -> dict[str, list[float]]:
    """Latencies in ms."""
    from _latency_probe import TREE_XML

    result_to_transition, command_to_effect = [], []
    with NodeRuntime.open('latency_probe') as runtime:
        probe = Probe(runtime)
        probe.wait_connected()
        probe.load(TREE_XML)
        probe.command(ExecutiveCommand.START, behavior='Latency probe', autonomy=3)
        for _ in range(samples):

            def asked() -> Any:
                return next((d for d in probe.status.decisions if d.path == '/Decide'), None)

            decision = wait_until(asked, 'the decision')
            result_to_transition.append((probe.entered['/Decide'] - probe.result_sent) * 1e3)
            before = probe.entered.get('/Tree', 0.0)
            sent = probe.command(ExecutiveCommand.FORCE, decision_id=decision.id, path='/Decide', outcome='again')
            wait_until(partial(probe.entered_after, '/Tree', before), 'the effect')
            command_to_effect.append((probe.entered['/Tree'] - sent) * 1e3)
        probe.command(ExecutiveCommand.STOP)
        probe.wait_idle()
    return {'leaf result to transition': result_to_transition, 'command to effect': command_to_effect}


def summary(values: list[float]) -> dict[str, float]:
    """Median, 90th and 99th percentile and maximum, ms."""
    cuts = statistics.quantiles(values, n=100)
    return {'median': statistics.median(values), 'p90': cuts[89], 'p99': cuts[98], 'max': max(values)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--samples', type=int, default=200)
    parser.add_argument('--output', type=Path, default=Path('out/latency.json'))
    arguments = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        install_behavior(Path(directory), HERE / '_latency_probe.py', 'LatencyProbe')
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_LOG_DIR=directory)
        only_this_computer()
        processes = [
            subprocess.Popen([executable(name), '--ros-args', '--log-level', 'warn'])
            for name in ('bt_server', 'onboard_executive')
        ]
        try:
            figures = {what: summary(values) for what, values in measure(arguments.samples).items()}
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                process.wait(5)
    figures['command to effect']['FlexBE mean / median'] = FLEXBE_MEAN_MS / figures['command to effect']['median']
    print(f'{"ms":28}{"median":>9}{"p90":>9}{"p99":>9}{"max":>9}')
    for what, row in figures.items():
        print(f'{what:28}' + ''.join(f'{row[column]:9.2f}' for column in ('median', 'p90', 'p99', 'max')))
    write_figures(arguments.output, {'samples': arguments.samples, 'ms': figures})
    return 0


if __name__ == '__main__':
    sys.exit(main())
