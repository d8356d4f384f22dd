# SPDX-License-Identifier: BSD-3-Clause
"""Many robots in one DDS domain, apart by namespace: each has an executive, a process, and a console of its own.

1. From the first start of an executive until every console shows its own one, live.
2. At rest, with a state active that waits for the operator: processor time of an executive, and what one console gets
   (serialized messages, without the headers of the middleware).
3. All operators command at the same time: from the command to the picture that shows its effect.

All consoles are nodes in this process, so that the third figure has their contention for one interpreter in it.

Each robot and each console is a DDS participant, and what they tell each other about themselves grows with the square
of their number. So the discovery is that of a fleet: by multicast, as across machines (on localhost alone Fast DDS
shows the first 32 participants of a domain to each other only), and with the announcements of the middleware's
defaults instead of those of tools/fastdds.xml, which come 15 times as often.

Usage: fleet.py [--robots N] [--rounds N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from _processes import executable, install_behavior
from domain_coordinator import domain_id

DEADLINE = 400.0
REST_SECONDS = 10.0
BETWEEN_ROUNDS = 0.3  # a picture is sent 20 times a second at most, on average
ROS_ARGUMENTS = ('--ros-args', '--log-level', 'error', '-p', 'peers:=[""]', '-p', 'record_directory:=""')


class Station:
    """The console of one robot; counts what it gets."""

    def __init__(self, runtime: Any) -> None:
        from rclpy.serialization import serialize_message

        from flexbt_common import names
        from flexbt_console.mirror import Mirror
        from flexbt_console.operator_link import OperatorLink
        from flexbt_console.requests import Requests
        from flexbt_msgs.msg import ExecutiveLog, ExecutiveStatus

        self.mirror = Mirror(runtime.steady)
        self.link = OperatorLink(runtime, self.mirror)
        self.requests = Requests('benchmark', {})
        self.bytes = 0

        def count(message: Any) -> None:
            self.bytes += len(serialize_message(message))

        def subscribe() -> None:
            for type, topic in ((ExecutiveStatus, names.EXECUTIVE_STATUS), (ExecutiveLog, names.EXECUTIVE_LOG)):
                runtime.node.create_subscription(type, topic, count, names.latched())

        runtime.call(subscribe)

    def wait_state(self, path: str) -> None:
        """Until a state is shown as active."""
        assert self.link.wait_for(lambda view: path in view.active_paths or None, DEADLINE), self.mirror.view()


def cpu_seconds(process: int) -> float:
    """Processor time that a process has used."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(stations: Sequence[Station], processes: Sequence[int], started: float, rounds: int) -> dict[str, Any]:
    """The figures; times in ms unless said otherwise."""
    for station in stations:
        station.link.live_view(DEADLINE)
    all_live = time.monotonic() - started
    for station in stations:
        view = station.link.wait_for(lambda view: view if view.behaviors else None, DEADLINE)
        assert view is not None, 'no list of behaviors'
        station.link.send(station.requests.start(view, 'Fleet probe'), DEADLINE)
    for station in stations:
        station.wait_state('/Here')
    cpu, before, begun = [cpu_seconds(one) for one in processes], [one.bytes for one in stations], time.monotonic()
    own = time.process_time()
    time.sleep(REST_SECONDS)  # a window to measure in, not a wait for something
    seconds = time.monotonic() - begun
    at_rest = [(cpu_seconds(one) - was) / seconds * 100.0 for one, was in zip(processes, cpu, strict=True)]
    consoles = (time.process_time() - own) / seconds * 100.0
    traffic = [(one.bytes - was) / seconds for one, was in zip(stations, before, strict=True)]
    effects = []
    for number in range(rounds):
        time.sleep(BETWEEN_ROUNDS)
        here, there = ('/Here', '/There') if number % 2 == 0 else ('/There', '/Here')
        sent = []
        for station in stations:
            sent.append(time.monotonic())
            station.link.send(station.requests.force(station.mirror.view(), here, 'go'), DEADLINE)
        for station, since in zip(stations, sent, strict=True):
            station.wait_state(there)
            effects.append((time.monotonic() - since) * 1e3)
    cuts = statistics.quantiles(effects, n=100)
    return {
        'robots': len(stations),
        'all live after (s)': all_live,
        'executive at rest (% of a core)': statistics.median(at_rest),
        'console at rest (% of a core)': consoles / len(stations),
        'link at rest (bytes/s)': statistics.median(traffic),
        'command to shown effect, all at once': {'median': statistics.median(effects), 'p99': cuts[98]},
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=10)
    parser.add_argument('--rounds', type=int, default=10)
    parser.add_argument('--output', type=Path, default=Path('out/fleet.json'))
    arguments = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        install_behavior(Path(directory), '_fleet_probe', 'FleetProbe')
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET', ROS_LOG_DIR=directory)
        os.environ.pop('FASTRTPS_DEFAULT_PROFILES_FILE', None)
        from flexbt_common.node_runtime import NodeRuntime

        started = time.monotonic()
        processes = [
            subprocess.Popen(
                [executable('flexbt_onboard', 'onboard_executive'), *ROS_ARGUMENTS, '-r', f'__ns:=/robot{number}']
            )
            for number in range(arguments.robots)
        ]
        try:
            stations = [
                Station(stack.enter_context(NodeRuntime.open('console', namespace=f'robot{number}')))
                for number in range(arguments.robots)
            ]
            figures = measure(stations, [process.pid for process in processes], started, arguments.rounds)
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                process.wait(30)
    print(json.dumps(figures, indent=2))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(figures, indent=2) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
