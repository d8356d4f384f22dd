# SPDX-License-Identifier: BSD-3-Clause
"""Many robots in one DDS domain, apart by namespace: each has an executive, a process, and a console of its own.

1. From the first start of an executive until every console shows its own one, live. They are started some at a time:
   all at once, 100 nodes would have to start on the cores of one machine.
2. At rest, with a state active that waits for the operator: processor time of an executive, and what one console gets
   (serialized messages, without the headers of the middleware).
3. All operators command at the same time: from the command to the picture that shows its effect.

All consoles are nodes in this process, so that the third figure has their contention for one interpreter in it.

Each robot and each console is a DDS participant. By simple discovery, each tells each of all that it has; on two cores
the time until all are live grows with the cube of their number (20 robots: 37 s, 30: 155 s, 35: 286 s), and on
localhost alone Fast DDS shows no more than 32 participants of a domain to each other. So there is a discovery server of
Fast DDS, as a fleet would have, through which each hears of what it shares topics with; --simple does without it.

Usage: fleet.py [--robots N] [--rounds N] [--simple] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import _figures
from _processes import executable, install_behavior
from domain_coordinator import domain_id

DEADLINE = 400.0
REST_SECONDS = 10.0
AT_A_TIME = 5
BETWEEN_ROUNDS = 0.3  # a picture is sent 20 times a second at most, on average
ROS_ARGUMENTS = ('--ros-args', '--log-level', 'error', '-p', 'peers:=[""]', '-p', 'event_log_directory:=""')


class Station:
    """The console of one robot; counts what it gets."""

    def __init__(self, runtime: Any) -> None:
        from rclpy.serialization import serialize_message

        from flexbt_common import names
        from flexbt_console.commands import CommandBuilder
        from flexbt_console.link import OperatorLink
        from flexbt_console.mirror import Mirror
        from flexbt_msgs.msg import ExecutiveLog, ExecutiveStatus

        self.mirror = Mirror(runtime.steady)
        self.link = OperatorLink(runtime, self.mirror)
        self.make = CommandBuilder('benchmark')
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


def measure(stations: Sequence[Station], processes: Sequence[int], rounds: int) -> dict[str, Any]:
    """The figures; times in ms unless said otherwise."""
    for station in stations:
        view = station.link.wait_for(lambda view: view if view.behaviors else None, DEADLINE)
        assert view is not None, 'no list of behaviors'
        station.link.send(station.make.start(view, 'Fleet probe'), DEADLINE)
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
            station.link.send(station.make.force(station.mirror.view(), here, 'go'), DEADLINE)
        for station, since in zip(stations, sent, strict=True):
            station.wait_state(there)
            effects.append((time.monotonic() - since) * 1e3)
    cuts = statistics.quantiles(effects, n=100)
    return {
        'executive at rest (% of a core)': statistics.median(at_rest),
        'console at rest (% of a core)': consoles / len(stations),
        'link at rest (bytes/s)': statistics.median(traffic),
        'command to shown effect, all at once': {'median': statistics.median(effects), 'p99': cuts[98]},
    }


@contextmanager
def discovery_server() -> Iterator[str]:
    """A discovery server of Fast DDS on this machine; gives its address."""
    program = shutil.which('fast-discovery-server')
    if program is None:
        raise SystemExit('fast-discovery-server is not there (a part of Fast DDS); --simple does without it')
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    address = '127.0.0.1'
    command = [program, '-i', '0', '-l', address, '-p', str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield f'{address}:{port}'
        finally:
            process.terminate()


def stop(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End the executives."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        process.wait(60)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=10)
    parser.add_argument('--rounds', type=int, default=10)
    parser.add_argument('--simple', action='store_true', help='without a discovery server')
    parser.add_argument('--output', type=Path, default=Path('out/fleet.json'))
    arguments = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        install_behavior(Path(directory), '_fleet_probe', 'FleetProbe')
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET', ROS_LOG_DIR=directory)
        # Its announcements come 15 times as often as the middleware's default.
        os.environ.pop('FASTRTPS_DEFAULT_PROFILES_FILE', None)
        if not arguments.simple:
            os.environ['ROS_DISCOVERY_SERVER'] = stack.enter_context(discovery_server())
        from flexbt_common.runtime import NodeRuntime

        started = time.monotonic()
        processes: list[subprocess.Popen[bytes]] = []
        stations: list[Station] = []
        stack.callback(stop, processes)
        names = [f'robot{number}' for number in range(arguments.robots)]
        for begin in range(0, len(names), AT_A_TIME):
            some = names[begin : begin + AT_A_TIME]
            command = [executable('flexbt_onboard', 'onboard_executive'), *ROS_ARGUMENTS]
            processes += [subprocess.Popen([*command, '-r', f'__ns:=/{name}']) for name in some]
            stations += [Station(stack.enter_context(NodeRuntime.open('console', namespace=name))) for name in some]
            for station in stations[begin:]:
                station.link.live_view(DEADLINE)
            print(f'{len(stations)} live after {time.monotonic() - started:.1f} s', file=sys.stderr)
        all_live = time.monotonic() - started
        figures = {
            'robots': len(stations),
            'all live after (s)': all_live,
            **measure(stations, [process.pid for process in processes], arguments.rounds),
        }
    print(json.dumps(figures, indent=2))
    _figures.write(arguments.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
