# SPDX-License-Identifier: BSD-3-Clause
"""Robots that are set up in another way: in a namespace, with stamped commands, in other frames, without power."""

from __future__ import annotations

from geometry_msgs.msg import TwistStamped
from nav2_msgs.action import FollowPath

from flexbt_common import names
from flexbt_common.calls import GoalStatus
from flexbt_sim.nodes import Navigation
from flexbt_sim.ros_messages import seconds_of
from flexbt_sim.simulator import Simulator
from flexbt_sim.world import DriveModel
from flexbt_testing.nodes.sim_world import DOCK, FAST, OFFICE, Probe, aborted, line, open_world, pose, without_faults

PLACE = '/fleet/robot1'


def test_a_robot_in_a_namespace_with_stamped_commands_is_driven_as_fast_as_possible() -> None:
    stamped = {'enable_stamped_cmd_vel': True, 'cmd_vel_topic': 'stamped_commands'}
    fast = stamped | {'speed_factor': 0.0, 'map_frame': 'world'}
    slaved = stamped | {'use_sim_time': True, 'global_frame': 'world'}
    with (
        without_faults(names.SIMULATOR, namespace=PLACE, parameters=fast) as simulator,
        without_faults(names.NAVIGATION, namespace=PLACE, parameters=slaved) as navigation,
        without_faults('probe', namespace=PLACE) as client,
    ):
        probe = Probe(client)
        commands: list[TwistStamped] = []
        node = client.node
        client.call(lambda: node.create_subscription(TwistStamped, f'{PLACE}/stamped_commands', commands.append, 100))
        Simulator(simulator)
        Navigation(navigation)
        path = probe.send(names.COMPUTE_PATH_TO_POSE, goal=pose(OFFICE, 'world')).result.path
        assert path.header.frame_id == 'world'
        began = probe.now.time
        assert probe.follow(path).wait().status is GoalStatus.SUCCEEDED
        rest = probe.wait_at_rest()
        assert rest.distance(OFFICE) < 0.15
        driven = [seen for seen in probe.sightings if began <= seen.time <= rest.time]
        assert max(probe.speeds(driven)) > 0.9 * DriveModel().linear_speed
        assert began <= seconds_of(commands[-1].header.stamp) <= probe.now.time


def test_a_robot_that_gets_nowhere_fails_to_make_progress() -> None:
    # Its wheels hardly turn, which navigation does not know.
    with open_world(FAST | {'linear_speed': 0.01}, {'movement_time_allowance': 3.0}) as world:
        result = aborted(world.follow(line(DOCK, (4.0, 4.45))), FollowPath.Result.FAILED_TO_MAKE_PROGRESS)
        assert '3 s' in result.error_msg
        assert world.wait_at_rest().distance(DOCK) < 0.1
