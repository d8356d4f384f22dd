# SPDX-License-Identifier: BSD-3-Clause
"""How soon the operator's screen is right, however it is started: seconds from its start, beside or without a robot, in
and outside of a run; and, for one that was there before, from the first status that another console has got.

Right is what the first line says of the link and the run, and, in a run, the question that waits.

Usage: python3 benchmarks screen_start [--rounds N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from _figures import write_figures
from _terminal import Terminal
from domain_coordinator import domain_id

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_testing.system.processes import Stack, executable
from flexbt_testing.system.python_processes import console_answer
from flexbt_testing.waiting import wait_until

EXECUTIVE = 'onboard_executive'
NO_ROBOT = 'LISTENING'
AT_REST = 'LIVE  IDLE'
IN_A_RUN = 'LIVE  RUNNING'
LOST = 'LOST'
QUESTION = 'Where shall the robot go?'
DEADLINE = 60.0


class Screen:
    """A screen in a terminal."""

    def __init__(self) -> None:
        self._terminal = Terminal()
        self.started = time.monotonic()
        self._process = subprocess.Popen([executable('console')], **self._terminal.streams)
        self._terminal.begin()

    def shows(self, *texts: str, since: float = 0.0) -> float:
        """Seconds after ``since``, by default its start, until it has written all of them."""
        since = since or self.started

        def all_shown() -> list[float] | None:
            found = [self._terminal.shown_at(text, since) for text in texts]
            return [one for one in found if one is not None] if None not in found else None

        times: list[float] = wait_until(all_shown, lambda: f'{texts} in {self._terminal.text[-3000:]}', DEADLINE)
        return max(times) - since

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._terminal.close()


@contextlib.contextmanager
def screen() -> Iterator[Screen]:
    """Provide a screen that has just been started."""
    one = Screen()
    try:
        yield one
    finally:
        one.close()


@contextlib.contextmanager
def first_status() -> Iterator[list[float]]:
    """Provide when another console, which has been there, gets the first status that is live; by the monotonic
    clock."""
    times: list[float] = []
    with NodeRuntime.open('observer') as runtime:
        mirror = Mirror(runtime.steady)
        mirror.add_listener(lambda _: times.append(time.monotonic()) if not times and mirror.view().live else None)
        ExecutiveLink(runtime, mirror, None)
        yield times


def measure(stack: Stack) -> dict[str, float]:
    """Seconds until it is right, by how it is started."""
    figures = {}
    with screen() as before, first_status() as heard:
        figures['without a robot'] = before.shows(NO_ROBOT)
        stack.start(EXECUTIVE, {'use_sim_time': 'false'})
        wait_until(lambda: heard, 'a status', DEADLINE)
        figures['before the robot, after its first status'] = before.shows(AT_REST, since=heard[0] - 1.0) - 1.0
    with screen() as after:
        figures['after the robot'] = after.shows(AT_REST)
        began = time.monotonic()
        assert console_answer('start', 'Navigate', '--autonomy', 'low', '--operator', 'ann')['result'] == 'applied'
        figures['there already, from the command on'] = after.shows(IN_A_RUN, QUESTION, since=began)
    with screen() as within:
        figures['during a run'] = within.shows(IN_A_RUN, QUESTION)
        stack.kill(EXECUTIVE)
        within.shows(LOST)
    with screen() as silent:
        figures['after a robot that is gone'] = silent.shows(NO_ROBOT)
    return figures


def main() -> int:
    """Measure, and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    rounds: list[dict[str, float]] = []
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        for _ in range(options.rounds):
            with tempfile.TemporaryDirectory() as directory, Stack(Path(directory), forked=False) as stack:
                stack.start('bt_server', {'use_sim_time': 'false'})
                wait_until(lambda: 'active' in stack.output('bt_server'), 'the BT server', DEADLINE)
                rounds.append(measure(stack))
    figures = {how: sorted(one[how] for one in rounds) for how in rounds[0]}
    for how, seconds in figures.items():
        print(f'{how:45} median {statistics.median(seconds):5.2f} s, {seconds[0]:.2f} to {seconds[-1]:.2f}')
    if options.output is not None:
        write_figures(options.output, {'seconds until the screen is right': figures})
    return 0


if __name__ == '__main__':
    sys.exit(main())
