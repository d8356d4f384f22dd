# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2's trees that work on lists of goals of the blackboard.

A list of goals is a list of poses in both branches of Nav2, also where those of main are nav_msgs/Goals.
"""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_core.behavior_tree import Example, NodeStatus, SyncAction, input_port, output_port
from flexbt_core.behavior_tree.model import DOUBLE, INT, STRING
from flexbt_server.leaves import POSE_STAMPED, POSES, PoseLeaf
from flexbt_server.trees import ROUTE, WAYPOINT_STATUSES

from .path_tracking import position_of
from .waypoint_statuses import COMPLETED, mark


class RemovePassedGoals(PoseLeaf, SyncAction):
    """Drops the first goals as long as the robot is within ``radius`` of them; never the last one.

    With ``input_waypoint_statuses`` those that are dropped are COMPLETED there; FAILURE when one is not among them.
    """

    __slots__ = ()

    ports = {
        'input_goals': input_port(POSES, description='goals to pass'),
        'output_goals': output_port(POSES, description='those that are left'),
        'radius': input_port(DOUBLE, default='0.5', description='m'),
        'global_frame': input_port(
            STRING, optional=True, description='not used: the goals have theirs', nav2_branch='jazzy'
        ),
        'robot_base_frame': input_port(STRING, optional=True, description="frame of the robot, if not the server's"),
        'input_waypoint_statuses': input_port(
            WAYPOINT_STATUSES, optional=True, description='statuses of all waypoints of the mission', nav2_branch='main'
        ),
        'output_waypoint_statuses': output_port(
            WAYPOINT_STATUSES, description='the same, with those passed', nav2_branch='main'
        ),
    }
    example = Example('<RemovePassedGoals input_goals="{goals}" radius="0.7" output_goals="{goals}"/>')

    def evaluate(self) -> NodeStatus:
        goals = list(self.get_input('input_goals'))
        passed = 0
        if len(goals) > 1:
            robot = self.robot_pose(goals[0].header.frame_id)
            radius = float(self.get_input('radius'))
            here = position_of(robot)
            while passed < len(goals) - 1 and math.dist(here, position_of(goals[passed])) <= radius:
                passed += 1
        statuses = self.get_input_or('input_waypoint_statuses', None)
        if statuses is not None and goals:
            try:
                marked = mark(statuses, goals[:passed], COMPLETED)
            except LookupError as error:
                return self.fail(str(error))
            self.set_output('output_waypoint_statuses', marked)
        self.set_output('output_goals', goals[passed:])
        return NodeStatus.SUCCESS


class AppendGoalPoseToGoals(PoseLeaf, SyncAction):
    """Appends a pose to goals."""

    __slots__ = ()

    nav2_branch = 'main'
    ports = {
        'goal_pose': input_port(POSE_STAMPED, description='the pose that comes last'),
        'input_goals': input_port(POSES, optional=True, description='the goals before it'),
        'output_goals': output_port(POSES, description='all of them'),
    }
    example = Example('<AppendGoalPoseToGoals goal_pose="{goal}" input_goals="{goals}" output_goals="{goals}"/>')

    def evaluate(self) -> NodeStatus:
        self.set_output('output_goals', [*self.get_input_or('input_goals', ()), self.get_input('goal_pose')])
        return NodeStatus.SUCCESS


class GetNextFewGoals(PoseLeaf, SyncAction):
    """Gives the first ``num_goals`` of goals. FAILURE when there is none."""

    __slots__ = ()

    nav2_branch = 'main'
    ports = {
        'num_goals': input_port(INT, description='how many at most'),
        'input_goals': input_port(POSES, description='the goals'),
        'output_goals': output_port(POSES, description='the first of them'),
    }
    example = Example('<GetNextFewGoals num_goals="2" input_goals="{goals}" output_goals="{next_goals}"/>')

    def evaluate(self) -> NodeStatus:
        goals = self.get_input('input_goals')
        number: int = self.get_input('num_goals')
        if number < 0:
            raise ValueError(f'port [num_goals] has to be a number from 0 on, not {number}')
        if not goals:
            return self.fail('there are no goals')
        self.set_output('output_goals', goals[:number])
        return NodeStatus.SUCCESS


class ExtractRouteNodesAsGoals(PoseLeaf, SyncAction):
    """Gives the nodes of a route as goals, without a direction. FAILURE when it has none."""

    __slots__ = ()

    nav2_branch = 'main'
    ports = {
        'route': input_port(ROUTE, description='the route'),
        'goals': output_port(POSES, description='its nodes'),
    }
    example = Example('<ExtractRouteNodesAsGoals route="{route}" goals="{goals}"/>')

    def evaluate(self) -> NodeStatus:
        route: Any = self.get_input('route')
        if not route.nodes:
            return self.fail('the route has no nodes')
        goals = []
        for node in route.nodes:
            goal = PoseStamped(header=route.header)
            goal.pose.position.x, goal.pose.position.y = node.position.x, node.position.y
            goals.append(goal)
        self.set_output('goals', goals)
        return NodeStatus.SUCCESS


NODES: Final = (RemovePassedGoals, AppendGoalPoseToGoals, GetNextFewGoals, ExtractRouteNodesAsGoals)
