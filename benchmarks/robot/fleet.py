# SPDX-License-Identifier: BSD-3-Clause
"""Many robots in one DDS domain, apart by namespace: each has an executive, a process, and a console of its own.

1. From the first start of an executive until every console shows its own one, live. They are started some at a time:
   all at once, 100 nodes would have to start on the cores of one machine.
2. At rest, with a state active that waits for the operator: processor time of an executive, and what one console gets
   (serialized messages, without the headers of the middleware).
3. All operators command at the same time: from the command to the picture that shows its effect.

With --trees, each robot has a BT server too, and all of them are in one simulated world, in real time, by whose clock
everything goes:

4. Each BT server ticks a tree with a deadline each 0.1 s: how late it is, by the stamps of its stream of transitions
   (the clock itself comes each 0.05 s); how fast the simulated time goes; and processor time of the whole fleet.

All consoles are nodes in this process, so that the third figure has their contention for one interpreter in it.

Each robot and each console is a DDS participant. By simple discovery, each tells each of all that it has; on two cores
the time until all are live grows with the cube of their number (20 robots: 37 s, 30: 155 s, 35: 286 s), and on
localhost alone Fast DDS shows no more than 32 participants of a domain to each other. So there is a discovery server of
Fast DDS, as a fleet would have, through which each hears of what it shares topics with; --simple does without it.

Twenty robots with trees, on a machine that does nothing else; none is to be later than a period:

    python3 benchmarks fleet --robots 20 --rounds 1 --trees --output out/bench/fleet_trees.json

Usage: python3 benchmarks fleet [--robots N] [--rounds N] [--trees] [--simple] [--output FILE.json]
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
from typing import Any, Final

from _figures import install_behavior, processor_time, write_figures
from domain_coordinator import domain_id

from flexbt_common.discovery import PROFILE
from flexbt_testing.system.processes import executable

HERE: Final = Path(__file__).resolve().parent
DEADLINE = 400.0
REST_SECONDS = 10.0
AT_A_TIME = 5
BETWEEN_ROUNDS = 0.3  # a picture is sent 20 times a second at most, on average
DEADLINE_MS = 100
TREE = f"""
<root BTCPP_format="4">
  <BehaviorTree ID="Deadlines"><Repeat num_cycles="-1"><Sleep msec="{DEADLINE_MS}"/></Repeat></BehaviorTree>
</root>
"""
LOGGING = ('--ros-args', '--log-level', 'error')
ROS_ARGUMENTS = (*LOGGING, '-p', 'peers:=[""]', '-p', 'event_log_directory:=""')


class Station:
    """The console of one robot; counts what it gets."""

    def __init__(self, runtime: Any) -> None:
        from rclpy.serialization import serialize_message

        from flexbt_common import names
        from flexbt_console.commands.command_builder import CommandBuilder
        from flexbt_console.link.operator_link import ExecutiveLink
        from flexbt_console.mirror.mirror import Mirror
        from flexbt_msgs.msg import ExecutiveLog, ExecutiveStatus

        self.mirror = Mirror(runtime.steady)
        self.link = ExecutiveLink(runtime, self.mirror)
        self.make = CommandBuilder('benchmark')
        self.bytes = 0

        def count(message: Any) -> None:
            self.bytes += len(serialize_message(message))

        def subscribe() -> None:
            for type, topic in ((ExecutiveStatus, names.EXECUTIVE_STATUS), (ExecutiveLog, names.EXECUTIVE_LOG)):
                runtime.node.create_subscription(type, topic, count, names.transient_local_qos())

        runtime.call(subscribe)
        self._runtime = runtime
        self.waits: list[tuple[float, float]] = []
        """Begin and length of what lasts until a deadline in the tree, s of the simulated time."""
        self._waits_since = 0.0

    def run_tree(self) -> Any:
        """Have the BT server of the robot run the tree of deadlines; the goal."""
        from flexbt_common import names
        from flexbt_common.calls.action_call import ActionLinks
        from flexbt_msgs.action import BtExecute, BtLoad
        from flexbt_msgs.msg import TreeStatus
        from flexbt_testing.nodes.clients import SentGoal

        links = ActionLinks(self._runtime)
        loaded = SentGoal(links.link(BtLoad, names.BT_LOADER), BtLoad.Goal(xml=TREE), DEADLINE).result
        assert loaded.code == BtLoad.Result.SUCCESS, loaded.message

        def on_status(message: TreeStatus) -> None:
            for change in message.changes:
                at = change.stamp.sec + 1e-9 * change.stamp.nanosec
                if change.uid != len(message.statuses):  # the leaf is the last node
                    continue
                if change.status == TreeStatus.RUNNING:
                    self._waits_since = at
                elif change.status == TreeStatus.SUCCESS:
                    self.waits.append((self._waits_since, at - self._waits_since))

        node = self._runtime.node
        self._runtime.call(lambda: node.create_subscription(TreeStatus, names.TREE_STATUS, on_status, 100))
        executor = links.link(BtExecute, names.BT_EXECUTOR)
        goal = SentGoal(executor, BtExecute.Goal(behavior_tree='Deadlines'), DEADLINE)
        assert goal.accepted.wait(DEADLINE), 'the tree was not accepted'
        return goal

    def wait_state(self, path: str) -> None:
        """Until a state is shown as active."""
        assert self.link.wait_for(lambda view: path in view.active_paths or None, DEADLINE), self.mirror.view()


def measure(stations: Sequence[Station], processes: Sequence[int], rounds: int) -> dict[str, Any]:
    """Return the figures; times in ms unless said otherwise."""
    for station in stations:
        view = station.link.wait_for(lambda view: view if view.behaviors else None, DEADLINE)
        assert view is not None, 'no list of behaviors'
        station.link.send(station.make.start(view, 'Fleet probe'), DEADLINE)
    for station in stations:
        station.wait_state('/Here')
    cpu, before, begun = [processor_time(one) for one in processes], [one.bytes for one in stations], time.monotonic()
    own = time.process_time()
    time.sleep(REST_SECONDS)  # a window to measure in, not a wait for something
    seconds = time.monotonic() - begun
    at_rest = [(processor_time(one) - was) / seconds * 100.0 for one, was in zip(processes, cpu, strict=True)]
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


def measure_trees(stations: Sequence[Station], processes: Sequence[int]) -> dict[str, Any]:
    """Return the figures of the trees."""
    goals = [station.run_tree() for station in stations]
    end = time.monotonic() + DEADLINE
    while not all(len(station.waits) > 10 for station in stations):
        assert time.monotonic() < end, 'not all trees run'
        time.sleep(0.1)
    cpu, begun = sum(map(processor_time, processes)), time.monotonic()
    first = [len(station.waits) for station in stations]
    time.sleep(REST_SECONDS)  # a window to measure in, not a wait for something
    waits = [station.waits[since:] for station, since in zip(stations, first, strict=True)]
    seconds = time.monotonic() - begun
    cpu = sum(map(processor_time, processes)) - cpu
    for goal in goals:
        goal.cancel()
    late = [1e3 * length - DEADLINE_MS for one in waits for _, length in one]
    simulated = statistics.median(one[-1][0] - one[0][0] for one in waits)
    return {
        'trees: deadlines': len(late),
        'trees: later than a period (100 ms)': sum(one > DEADLINE_MS for one in late),
        'trees: late (ms of simulated time)': {'median': statistics.median(late), 'greatest': max(late)},
        'trees: simulated time per time': simulated / seconds,
        'trees: all processes (% of a core)': 100.0 * cpu / seconds,
    }


def write_world(directory: Path, robots: Sequence[str]) -> Path:
    """Return a world file with robots in rows."""
    file = directory / 'fleet.yaml'
    lines = [f'  {name}: {{model: burger, pose: [{n % 10}, {n // 10}, 0]}}\n' for n, name in enumerate(robots)]
    file.write_text(f'robots:\n{"".join(lines)}')
    return file


@contextmanager
def discovery_server() -> Iterator[str]:
    """Provide a discovery server of Fast DDS on this machine; gives its address."""
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
    parser.add_argument('--trees', action='store_true', help='with a simulated world and a BT server for each robot')
    parser.add_argument('--simple', action='store_true', help='without a discovery server')
    parser.add_argument('--output', type=Path, default=Path('out/fleet.json'))
    arguments = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        install_behavior(Path(directory), HERE / '_fleet_probe.py', 'FleetProbe')
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET', ROS_LOG_DIR=directory)
        # Its announcements come 15 times as often as the middleware's default.
        os.environ.pop(PROFILE, None)
        if not arguments.simple:
            os.environ['ROS_DISCOVERY_SERVER'] = stack.enter_context(discovery_server())
        from flexbt_common.runtime.node_runtime import NodeRuntime

        started = time.monotonic()
        processes: list[subprocess.Popen[bytes]] = []
        stations: list[Station] = []
        stack.callback(stop, processes)
        names = [f'robot{number}' for number in range(arguments.robots)]
        servers: list[subprocess.Popen[bytes]] = []
        stack.callback(stop, servers)
        timed = ['-p', 'use_sim_time:=true'] if arguments.trees else []
        if arguments.trees:
            world = ['-p', f'world:={write_world(Path(directory), names)}']
            servers.append(subprocess.Popen([executable('simulator'), *LOGGING, *world]))
        for begin in range(0, len(names), AT_A_TIME):
            some = names[begin : begin + AT_A_TIME]
            command = [executable('onboard_executive'), *ROS_ARGUMENTS, *timed]
            processes += [subprocess.Popen([*command, '-r', f'__ns:=/{name}']) for name in some]
            if arguments.trees:
                command = [executable('bt_server'), *LOGGING, *timed]
                servers += [subprocess.Popen([*command, '-r', f'__ns:=/{name}']) for name in some]
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
        if arguments.trees:
            figures |= measure_trees(stations, [process.pid for process in (*processes, *servers)])
    print(json.dumps(figures, indent=2))
    write_figures(arguments.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
