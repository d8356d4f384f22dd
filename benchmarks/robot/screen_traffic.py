# SPDX-License-Identifier: BSD-3-Clause
"""What the operator's screen writes to its terminal (bytes a second, as they go over SSH), and what it takes of a core:
at rest, while a question waits, and while the robot drives; with the scan, at the default rate.

Usage: python3 benchmarks screen_traffic [--seconds S] [--sizes 80x24 200x60] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from _figures import processor_time, write_figures
from _terminal import Terminal
from domain_coordinator import domain_id

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack, executable
from flexbt_testing.system.python_processes import console_answer

GOAL = '10.0 2.3 0'
"""m, m, rad: far enough for a window of 20 s."""

SETTLING = 10.0
"""Seconds until a screen that has just begun is at rest."""


def measure(columns: int, rows: int, seconds: float) -> dict[str, dict[str, float]]:
    """Return the figures for a terminal of that size."""
    figures = {}
    with tempfile.TemporaryDirectory() as directory, Stack(Path(directory), forked=False) as stack:
        stack.start_all()
        with NodeRuntime.open('probe') as runtime:
            Probe(runtime).wait_ready()
        terminal = Terminal(rows, columns)
        with subprocess.Popen([executable('console')], **terminal.streams) as process:
            terminal.begin()

            def window() -> dict[str, float]:
                written, used = len(terminal.written), processor_time(process.pid)
                time.sleep(seconds)
                return {
                    'bytes/s': round((len(terminal.written) - written) / seconds),
                    '% of a core': round(100.0 * (processor_time(process.pid) - used) / seconds, 2),
                }

            time.sleep(SETTLING)
            figures['at rest'] = window()
            command('start', 'Navigate', '--autonomy', 'high')
            time.sleep(1.0)
            figures['a question waits'] = window()
            command('input', GOAL)
            time.sleep(1.0)
            figures['driving'] = window()
            process.kill()
        terminal.close()
    return figures


def command(*words: str) -> None:
    """Have it done by another console."""
    assert console_answer(*words, '--operator', 'ann')['result'] == 'applied'


def main() -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=15.0, help='length of each window')
    parser.add_argument('--sizes', nargs='+', default=['80x24', '200x60'], help='columns x rows')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    figures = {}
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        for size in options.sizes:
            columns, rows = map(int, size.split('x'))
            figures[size] = measure(columns, rows, options.seconds)
    for size, by_state in figures.items():
        for state, one in by_state.items():
            print(f'{size:8} {state:18} {one["bytes/s"]:6} bytes/s  {one["% of a core"]:5.2f} % of a core')
    if options.output is not None:
        write_figures(options.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
