# SPDX-License-Identifier: BSD-3-Clause
"""Processor time of each process of a robot at rest, in per cent of a core, under simulated time.

Usage: python3 benchmarks idle_cpu [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from _figures import write_figures
from domain_coordinator import domain_id

from flexbt_common.runtime import NodeRuntime
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

PROCESSES = ('simulator', 'navigation', 'bt_server', 'onboard_executive')


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
            time.sleep(3.0)  # what discovery and the start have left to do
            before = {name: processor_time(stack.process_id(name)) for name in PROCESSES}
            time.sleep(options.seconds)
            after = {name: processor_time(stack.process_id(name)) for name in PROCESSES}
    figures = {name: round(100.0 * (after[name] - before[name]) / options.seconds, 2) for name in PROCESSES}
    for name, percent in figures.items():
        print(f'{name:18} {percent:5.2f} %')
    if options.output is not None:
        write_figures(options.output, {'idle_cpu_percent': figures})
    return 0


def processor_time(process: int) -> float:
    """User and system time of a process, s."""
    fields = Path('/proc', str(process), 'stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


if __name__ == '__main__':
    sys.exit(main())
