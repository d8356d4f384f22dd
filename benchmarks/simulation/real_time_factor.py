# SPDX-License-Identifier: BSD-3-Clause
"""How fast a robot is simulated with all its processes and DDS: simulated seconds per second while it drives.

Simulator (as fast as possible), navigation, BT server and executive are processes of their own; a client plans ways
through the rooms and has them followed.

Usage: python3 benchmarks real_time_factor [--composed] [--seconds S] [--factor F] [--odom-rate HZ] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path
from typing import Any

from _figures import processor_time, write_figures
from domain_coordinator import domain_id
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import ComputePathToPose, FollowPath
from simulation_interfaces.srv import GetEntityState

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.system.processes import Stack

PLACES = ((3.8, 1.2), (0.8, 4.45), (9.6, 6.6), (10.0, 2.3))
DEADLINE = 300.0


def pose(x: float, y: float) -> PoseStamped:
    """Return a place on the map."""
    message = PoseStamped()
    message.header.frame_id = 'map'
    message.pose.position.x, message.pose.position.y, message.pose.orientation.w = float(x), float(y), 1.0
    return message


class Client:
    """Gives a robot its goals, one after the other, and reads the clock of the simulation."""

    def __init__(self, runtime: NodeRuntime, namespace: str, entity: str) -> None:
        self._runtime = runtime
        self._entity = entity
        links = ActionLinks(runtime)
        self._plan = links.link(ComputePathToPose, f'{namespace}{names.COMPUTE_PATH_TO_POSE}')
        self._follow = links.link(FollowPath, f'{namespace}{names.FOLLOW_PATH}')
        self._clock = ServiceLinks(runtime).link(GetEntityState, '/simulator/get_entity_state')
        self.goals = 0

    def drive(self, x: float, y: float) -> None:
        """Plan a way to a place and have it followed."""
        plan = SentGoal(self._plan, ComputePathToPose.Goal(goal=pose(x, y)), DEADLINE)
        outcome = plan.wait()
        if outcome.status is not GoalStatus.SUCCEEDED:
            raise RuntimeError(f'no path to ({x:g}, {y:g}): {outcome.reason or plan.result.error_msg}')
        outcome = SentGoal(self._follow, FollowPath.Goal(path=plan.result.path), DEADLINE).wait()
        if outcome.status is not GoalStatus.SUCCEEDED:
            raise RuntimeError(f'the way to ({x:g}, {y:g}) was not followed: {outcome.reason}')
        self.goals += 1

    def now(self) -> float:
        """Return simulated time, s."""
        request = GetEntityState.Request(entity=self._entity)
        response: Any = service_outcome(self._clock, request, DEADLINE).response
        stamp = response.state.header.stamp
        return float(stamp.sec + 1e-9 * stamp.nanosec)


def main() -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=20.0, help='least wall time of the drive')
    parser.add_argument('--composed', action='store_true', help='simulator and navigation in one process')
    parser.add_argument('--factor', type=float, default=0.0)
    parser.add_argument('--odom-rate', type=float, default=20.0, help='Hz; the rate of the control, 20 Hz with Nav2')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with Stack(Path(directory), forked=False) as stack, NodeRuntime.open('driver') as runtime:
            settings = {'speed_factor': str(options.factor), 'odom_rate': str(options.odom_rate)}
            if options.composed:
                stack.start('simulation', settings)
                for name in ('bt_server', 'onboard_executive'):
                    stack.start(name)
            else:
                stack.start_all(settings)
            client = Client(runtime, '', 'robot')
            places = cycle(PLACES)
            client.drive(*next(places))  # everything is there, and compiled
            processes = sorted(stack.running())
            before = {name: processor_time(stack.process_id(name)) for name in processes}
            began, simulated, goals = time.monotonic(), client.now(), client.goals
            while time.monotonic() - began < options.seconds:
                client.drive(*next(places))
            wall, simulated, goals = time.monotonic() - began, client.now() - simulated, client.goals - goals
            used = {name: processor_time(stack.process_id(name)) - before[name] for name in processes}
    figures = {
        'real_time_factor': round(simulated / wall, 1),
        'simulated_seconds': round(simulated, 1),
        'wall_seconds': round(wall, 1),
        'goals': goals,
        'processor_ms_per_simulated_second': {name: round(1000.0 * used[name] / simulated, 2) for name in processes},
    }
    print(f'{figures["real_time_factor"]} times real time: {goals} goals, {simulated:.0f} s in {wall:.1f} s')
    for name in processes:
        print(f'  {name:18} {100.0 * used[name] / wall:5.1f} % of a core')
    if options.output is not None:
        write_figures(options.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
