# SPDX-License-Identifier: BSD-3-Clause
"""What the operator link carries: a robot and the consoles of an operator in two networks, and a cable that counts.

The robot is the whole demonstration; only its executive is told to be found across the link. The consoles show no map,
but in the last settings: there all nodes are found, and the consoles are screens, without and with the scan.
In bytes a second, at rest and while the robot drives, with one console and with two:

- payload: the serialized messages of the executive to one console;
- messages: what they, the commands and the presence of consoles need on the wire, from the IP header on, with
  acknowledgements and retransmissions, in both directions;
- wire: everything, with the middleware's discovery and liveliness.

For several settings: the profile of the middleware (for radio links; of a workspace; none), and the executive's
heartbeat period. Needs network namespaces (Linux, root).

Usage: python3 benchmarks link [--settings NAME ...] [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from _figures import write_figures
from domain_coordinator import domain_id

from flexbt_common.discovery import PROFILE, only_this_computer, profile
from flexbt_console.commands.effects import SCAN_PERIOD
from flexbt_onboard.commands.command_ledger import REPORT_TIME
from flexbt_testing.system import networks
from flexbt_testing.system.networks import LossyLink, NetworkNamespace
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.remote import RemoteConsole, RemoteObserver, remote_console, remote_observer
from flexbt_testing.waiting import DEADLINE

SETTLING = REPORT_TIME + 1.0
GOAL = '{header: {frame_id: map}, pose: {position: {x: 10.0, y: 2.3}, orientation: {w: 1.0}}}'
RADIO = profile('radio_robot'), profile('radio_console')
QUICK = profile('network')
NO_PROFILE = Path('/dev/null')
SETTINGS = {
    'radio, heartbeat 0.5 s': (*RADIO, 0.5, None),
    'radio, heartbeat 1 s': (*RADIO, 1.0, None),
    'workspace, heartbeat 0.5 s': (QUICK, QUICK, 0.5, None),
    'no profile, heartbeat 0.5 s': (NO_PROFILE, NO_PROFILE, 0.5, None),
    'radio, screens with --slow-link': (*RADIO, 0.5, 0.0),
    'radio, screens': (*RADIO, 0.5, SCAN_PERIOD),
}
"""Profiles of the robot and of the consoles, seconds between two heartbeats, and between two scans of a screen."""


def wait(condition: Callable[[], object], what: str) -> None:
    """Until it is so.

    Raises:
        TimeoutError: it was not in time.
    """
    end = time.monotonic() + DEADLINE
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f'{what}: not within {DEADLINE:g} s')
        time.sleep(0.05)


class Meter:
    """Bytes a second over a window of time."""

    def __init__(self, link: LossyLink, observer: RemoteObserver, seconds: float) -> None:
        self._link = link
        self._observer = observer
        self._seconds = seconds

    def measure(self) -> dict[str, Any]:
        """Return the figures of a window that begins now."""
        before, payload, begun = self._link.sent(), self._observer.payload(), time.monotonic()
        time.sleep(self._seconds)  # a window to measure in, not a wait for something
        seconds = time.monotonic() - begun
        to_console, to_robot = (now - was for now, was in zip(self._link.sent(), before, strict=True))
        return {
            'payload': (self._observer.payload() - payload) / seconds,
            'messages': {
                'to console': user_bytes(to_console) / seconds,
                'to robot': user_bytes(to_robot) / seconds,
            },
            'wire': {
                'to console': to_console.total() / seconds,
                'to robot': to_robot.total() / seconds,
                'sum': (to_console.total() + to_robot.total()) / seconds,
            },
        }


def user_bytes(by_port: Counter[int]) -> int:
    """Bytes for the ports of user traffic, which are the odd ones (RTPS 2.5, 9.6.2.3)."""
    return sum(count for port, count in by_port.items() if port % 2)


def measure(
    robot_side: Path, console_side: Path, heartbeat: float, scan_period: float | None, seconds: float
) -> dict[str, Any]:
    """Return the figures with one of the settings, in windows of that many seconds."""
    across = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
    at_executive = {**across, PROFILE: str(robot_side)}
    at_console = {**across, PROFILE: str(console_side)}
    with ExitStack() as stack:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        robot, station = (stack.enter_context(NetworkNamespace()) for _ in range(2))
        link = stack.enter_context(LossyLink(robot, station))
        processes = stack.enter_context(Stack(directory, robot))
        for name in ('simulator', 'navigation', 'bt_server'):
            processes.start(name, {}, {} if scan_period is None else at_executive)
        processes.start('stop_guard', {}, at_executive)
        processes.start('onboard_executive', {'heartbeat_period': str(heartbeat)}, at_executive)
        observer = stack.enter_context(remote_observer(robot, {}))
        meter = Meter(link, observer, seconds)

        first = stack.enter_context(remote_console(station, at_console, 'ann', scan_period))
        wait_ready(first)
        figures: dict[str, Any] = {'one console': {'at rest': meter.measure()}}
        drive(first)
        figures['one console']['driving'] = meter.measure()
        first.send('stop')
        second = stack.enter_context(remote_console(station, at_console, 'bob', scan_period))
        wait_ready(second)
        figures['two consoles'] = {'at rest': meter.measure()}
    return figures


def wait_ready(console: RemoteConsole) -> None:
    """Until a console shows a robot that is ready and at rest, and the discovery is over."""

    def is_ready() -> bool:
        view = console.view()
        peers = view.snapshot.peers if view.snapshot is not None else ()
        return view.live and bool(view.behaviors) and bool(peers) and all(peer.ready for peer in peers)

    wait(is_ready, 'readiness')
    wait(lambda: not console.view().running, 'idle executive')
    settle()


def drive(console: RemoteConsole) -> None:
    """Have the robot on its way to the kitchen."""
    console.send('start', 'Navigate', '--autonomy', 'high')
    wait(lambda: console.view().decision, 'question for a goal')
    decision = console.view().decision
    assert decision is not None
    console.send('input', '--decision', decision.id, GOAL)
    wait(lambda: '/Drive' in console.view().active_paths, 'driving')
    settle()


def settle() -> None:
    """Let discovery, and the answers to commands that are part of each status for some time, be over."""
    end = time.monotonic() + SETTLING
    wait(lambda: time.monotonic() > end, 'end of the settling')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--settings', nargs='+', choices=SETTINGS, default=list(SETTINGS), help='which of them')
    parser.add_argument('--seconds', type=float, default=15.0, help='length of each window')
    parser.add_argument('--output', type=Path, default=Path('out/link.json'))
    arguments = parser.parse_args()
    problem = networks.missing()
    figures: dict[str, Any] = {'not measured': problem}
    if not problem:
        with domain_id() as domain:
            os.environ['ROS_DOMAIN_ID'] = str(domain)
            only_this_computer()
            figures = {name: measure(*SETTINGS[name], arguments.seconds) for name in arguments.settings}
    print(json.dumps(figures, indent=2))
    write_figures(arguments.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
