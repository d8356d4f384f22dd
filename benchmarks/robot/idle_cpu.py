# SPDX-License-Identifier: BSD-3-Clause
"""Processor time of each process of a robot at rest, in per cent of a core, under simulated time: alone, and while an
operator's screen shows it, with that of the screen and the bytes that it writes to its terminal.

Usage: python3 benchmarks idle_cpu [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from _figures import processor_time, write_figures
from _terminal import Terminal
from domain_coordinator import domain_id

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack, executable

PROCESSES = ('simulator', 'navigation', 'bt_server', 'stop_guard', 'onboard_executive')
SCREEN = 'screen'
ROWS, COLUMNS = 40, 130

ROBOT_SECONDS = 3.0
SCREEN_SECONDS = 15.0
"""What discovery and the start have left to do; a screen listens to transforms until the robot has stood for 5 s."""


def main() -> int:
    """Measure, and print a line for each process."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=30.0)
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with Stack(Path(directory), forked=False) as stack:
            stack.start_all()
            with NodeRuntime.open('probe') as runtime:
                Probe(runtime).wait_ready()
            ids = {name: stack.process_id(name) for name in PROCESSES}
            time.sleep(ROBOT_SECONDS)
            alone = measure(ids, options.seconds)
            with screen() as (process, terminal):
                time.sleep(SCREEN_SECONDS)
                before = len(terminal.written)
                watched = measure({**ids, SCREEN: process}, options.seconds)
                written = len(terminal.written) - before
    print(f'{"":18} {"alone":>7} {"watched":>9}')
    for name, percent in watched.items():
        shown = f'{alone[name]:5.2f} %' if name in alone else ''
        print(f'{name:18} {shown:>7} {percent:7.2f} %')
    print(f'written by the screen: {written} bytes')
    if options.output is not None:
        figures = {'alone': alone, 'watched': watched}
        write_figures(options.output, {'idle_cpu_percent': figures, 'bytes written by the screen': written})
    return 0


def measure(ids: Mapping[str, int], seconds: float) -> dict[str, float]:
    """Per cent of a core, by the names of the processes."""
    before = {name: processor_time(process) for name, process in ids.items()}
    time.sleep(seconds)
    return {name: round(100.0 * (processor_time(process) - before[name]) / seconds, 2) for name, process in ids.items()}


@contextlib.contextmanager
def screen() -> Iterator[tuple[int, Terminal]]:
    """Provide a screen in a terminal of its own: its process, and the terminal."""
    terminal = Terminal(ROWS, COLUMNS)
    process = subprocess.Popen([executable('console')], **terminal.streams)
    terminal.begin()
    try:
        yield process.pid, terminal
    finally:
        process.kill()
        process.wait()
        terminal.close()


if __name__ == '__main__':
    sys.exit(main())
