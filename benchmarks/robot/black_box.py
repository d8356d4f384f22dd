# SPDX-License-Identifier: BSD-3-Clause
"""Processor time of the black box beside a robot at rest, in per cent of a core, and its memory: alone, and with a
lidar, a camera and a costmap at their full rates as further topics.

Prints the median of several windows, the resident memory at the first and at the last of them, and the bytes of the
ring.

Usage: python3 benchmarks black_box [--windows N] [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from _figures import processor_time, write_figures
from domain_coordinator import domain_id

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

START_SECONDS = 10.0
"""What discovery and the start have left to do."""

END_SECONDS = 20.0
OTHERS = ('lidar', 'camera', 'costmap')


def main() -> int:
    """Measure, and print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--windows', type=int, default=7)
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--output', type=Path)
    parser.add_argument('--publish', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        publish()
    figures = {}
    for case in ('at rest', 'full topics'):
        figures[case] = found = measure(case != 'at rest', options.windows, options.seconds)
        used, memory = found['percent'], found['MB']
        print(
            f'{case:12} {statistics.median(used):5.2f} % of a core (median; {min(used):.2f} to {max(used):.2f}), '
            f'{memory[0]:.0f} MB at first, {memory[-1]:.0f} MB at last, ring {found["ring MB"][0]:.1f} MB'
        )
    if options.output is not None:
        write_figures(options.output, figures)
    return 0


def measure(has_others: bool, windows: int, seconds: float) -> dict[str, list[float]]:
    """Per cent of a core in each window, memory and bytes of the ring, MB."""
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        ring = Path(directory) / 'ring'
        settings = {'use_sim_time': 'false', 'incidents': directory, 'ring': str(ring)}
        if has_others:
            settings['others'] = f'[{", ".join(OTHERS)}]'
        with Stack(Path(directory), forked=False) as stack:
            stack.start_all()
            with NodeRuntime.open('probe') as runtime:
                Probe(runtime).wait_ready()
            sensors = subprocess.Popen([sys.executable, *sys.orig_argv[1:], '--publish']) if has_others else None
            stack.start('black_box', settings)
            time.sleep(START_SECONDS)
            process = stack.process_id('black_box')
            used, memory = [], []
            for _ in range(windows):
                before, begin = processor_time(process), time.monotonic()
                time.sleep(seconds)
                used.append(round(100.0 * (processor_time(process) - before) / (time.monotonic() - begin), 2))
                status = Path(f'/proc/{process}/status').read_text()
                memory.append(int(status.partition('VmRSS:')[2].split()[0]) / 1000.0)
            size = sum(file.stat().st_size for file in ring.rglob('*.mcap')) / 1e6
            if sensors is not None:
                sensors.kill()
                sensors.wait()
            stack.end('black_box', signal.SIGTERM, END_SECONDS)
    return {'percent': used, 'MB': memory, 'ring MB': [size]}


def publish() -> None:
    """Publish as real sensors do, until killed: 40 scans, 30 images of 0.9 MB and 5 costmaps of 0.16 MB a second."""
    from nav_msgs.msg import OccupancyGrid
    from sensor_msgs.msg import Image, LaserScan

    noise = np.random.default_rng(1)
    scan = LaserScan(ranges=noise.random(1440, dtype=np.float32))
    image = Image(height=480, width=640, encoding='rgb8', step=1920, data=noise.bytes(480 * 1920))
    grid = OccupancyGrid(data=noise.integers(-1, 100, 160_000, dtype=np.int8).tolist())
    grid.info.width = grid.info.height = 400
    with NodeRuntime.open('sensors') as runtime:
        node = runtime.node
        kinds = ((scan, 'lidar', 40.0), (image, 'camera', 30.0), (grid, 'costmap', 5.0))
        begin = time.monotonic()
        due = {
            topic: [begin, 1.0 / rate, runtime.call(partial(node.create_publisher, type(message), topic, 5)), message]
            for message, topic, rate in kinds
        }
        while True:
            topic = min(due, key=lambda one: due[one][0])
            at, period, publisher, message = due[topic]
            time.sleep(max(0.0, at - time.monotonic()))
            publisher.publish(message)
            due[topic][0] = at + period


if __name__ == '__main__':
    sys.exit(main())
