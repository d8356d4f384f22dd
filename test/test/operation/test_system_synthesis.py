# SPDX-License-Identifier: BSD-3-Clause
"""A behavior that an operator has made from a console, and that drives the robot then."""

from __future__ import annotations

import math
from pathlib import Path

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer

CAPABILITIES = 'flexbt_demo_behaviors/navigate/visit.yaml'


def test_a_machine_that_was_asked_for_drives_the_robot(tmp_path: Path) -> None:
    with Stack(tmp_path) as stack:
        stack.start_all({'speed_factor': '10.0'}, in_one=True)
        with NodeRuntime.open('probe') as runtime:
            probe = Probe(runtime)
            probe.wait_ready()
            assert probe.pose is not None
            begin = probe.pose.pose.position
            made = console_answer('synthesize', CAPABILITIES, '--goal', 'look', '--name', 'Look there')
            assert made['behavior'] == 'Look there'
            pose = PoseStamped(pose=Pose(position=Point(x=begin.x + 1.5, y=begin.y), orientation=Quaternion(w=1.0)))
            pose.header.frame_id = 'map'
            probe.start('Look there', inputs=[to_entry('goal', pose)])
            probe.wait_active('/look')  # it was driven, by a tree, and the operator looks
            assert math.hypot(probe.pose.pose.position.x - begin.x - 1.5, probe.pose.pose.position.y - begin.y) < 0.5
            probe.applied(ExecutiveCommand.FORCE, path='/look', outcome='done')
            assert probe.wait_idle() == 'finished'
