# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2's trees that work on paths and on lists of goals of the blackboard."""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves.path_tracking import NearestPose, first_beyond, position_of
from flexbt_server.leaves.topic_leaf import PoseLeaf
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, POSES, ROUTE, WAYPOINT_STATUSES

from .branches import COMPLETED, mark

MIN_POSES = 2
"""A truncated path keeps this many poses."""


class TruncatePath(PoseLeaf, SyncAction):
    """Removes the last ``distance`` metres of a path, and turns its new end toward the old one."""

    __slots__ = ()

    ports = {
        'input_path': input_port(PATH, description='the path'),
        'distance': input_port(DOUBLE, default='1.0', description='what is taken off, m'),
        'output_path': output_port(PATH, description='what is left'),
    }
    example = Example('<TruncatePath input_path="{path}" distance="1.0" output_path="{first_part}"/>')

    def evaluate(self) -> NodeStatus:
        path: Any = self.get_input('input_path')
        poses = list(path.poses)
        if poses:
            end = poses[-1]
            distance = float(self.get_input('distance'))
            while len(poses) > MIN_POSES and math.dist(position_of(poses[-1]), position_of(end)) < distance:
                poses.pop()
            poses[-1] = _facing(poses[-1], end)
        self.set_output('output_path', Path(header=path.header, poses=poses))
        return NodeStatus.SUCCESS


def _facing(pose: PoseStamped, target: PoseStamped) -> PoseStamped:
    here, there = position_of(pose), position_of(target)
    turned = PoseStamped(header=pose.header)
    turned.pose.position = pose.pose.position
    yaw = math.atan2(there[1] - here[1], there[0] - here[0])
    turned.pose.orientation.z, turned.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return turned


class TruncatePathLocal(PoseLeaf, SyncAction):
    """Cuts out the part of a path around the robot, or around ``pose``.

    The ports set how far the part reaches back and forward along the path from the nearest pose. A path without poses
    stays unchanged. FAILURE while the pose of the robot in the frame of the path is unknown.
    """

    __slots__ = ('_nearest',)

    ports = {
        'input_path': input_port(PATH, description='the path'),
        'output_path': output_port(PATH, description='the part of it'),
        'distance_forward': input_port(DOUBLE, default='8.0', description='m; less than 0 for all that is ahead'),
        'distance_backward': input_port(DOUBLE, default='4.0', description='m'),
        'robot_frame': input_port(STRING, optional=True, description='as robot_base_frame', nav2_branch='jazzy'),
        'robot_base_frame': input_port(
            STRING, optional=True, description="frame of the robot, if not the server's", nav2_branch='main'
        ),
        'transform_tolerance': input_port(DOUBLE, default='0.2', description='not used: the newest transform counts'),
        'pose': input_port(POSE_STAMPED, optional=True, description='pose to go by, in the frame of the path'),
        'angular_distance_weight': input_port(
            DOUBLE, default='0.0', description='distance that 1 rad of another direction counts as, m'
        ),
        'max_robot_pose_search_dist': input_port(
            DOUBLE, default='inf', description='how far along the same path from the last time is searched, m'
        ),
    }
    example = Example(
        '<TruncatePathLocal input_path="{path}" distance_forward="3.0" distance_backward="0.0" output_path="{near}"/>'
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._nearest = NearestPose()

    def evaluate(self) -> NodeStatus:
        path: Any = self.get_input('input_path')
        pose = self.get_input_or('pose', None)
        if pose is None:
            base = self.get_input_or('robot_base_frame', '') or self.get_input_or('robot_frame', '')
            pose = self.frames.robot_pose(path.header.frame_id, base)
        if path.poses:
            window = float(self.get_input('max_robot_pose_search_dist'))
            here = self._nearest.index(path, pose, window, float(self.get_input('angular_distance_weight')))
            forward, backward = float(self.get_input('distance_forward')), float(self.get_input('distance_backward'))
            points = self._nearest.points
            end = first_beyond(points, here, math.inf if forward < 0.0 else forward)
            back = first_beyond(points[here::-1], 0, backward)
            path = Path(header=path.header, poses=path.poses[here + 1 - back : end])
        self.set_output('output_path', path)
        return NodeStatus.SUCCESS


class ConcatenatePaths(PoseLeaf, SyncAction):
    """Joins two paths. FAILURE when neither has a pose.

    The result has the header of the first path that has one.
    """

    __slots__ = ()

    ports = {
        'input_path1': input_port(PATH, optional=True, description='the path that comes first'),
        'input_path2': input_port(PATH, optional=True, description='the path that comes then'),
        'output_path': output_port(PATH, description='both'),
    }
    example = Example('<ConcatenatePaths input_path1="{there}" input_path2="{back}" output_path="{path}"/>')

    def evaluate(self) -> NodeStatus:
        first, then = (self.get_input_or(port, Path()) for port in ('input_path1', 'input_path2'))
        poses = [*first.poses, *then.poses]
        if not poses:
            return self.fail('both paths are empty')
        header = then.header if first.header == Header() else first.header
        self.set_output('output_path', Path(header=header, poses=poses))
        return NodeStatus.SUCCESS


class GetPoseFromPath(PoseLeaf, SyncAction):
    """Returns the pose of a path at ``index``. FAILURE if the path has no such pose."""

    __slots__ = ()

    ports = {
        'path': input_port(PATH, description='the path'),
        'index': input_port(INT, default='0', description='from 0; -1 is the last, and so on'),
        'pose': output_port(POSE_STAMPED, description='the pose, in the frame of the path if it names none'),
    }
    example = Example('<GetPoseFromPath path="{path}" index="-1" pose="{end}"/>')

    def evaluate(self) -> NodeStatus:
        path: Any = self.get_input('path')
        index: int = self.get_input('index')
        if not -len(path.poses) <= index < len(path.poses):
            return self.fail(f'the path has {len(path.poses)} poses, and none of index {index}')
        pose = path.poses[index]
        if not pose.header.frame_id:
            pose = PoseStamped(header=Header(stamp=pose.header.stamp, frame_id=path.header.frame_id), pose=pose.pose)
        self.set_output('pose', pose)
        return NodeStatus.SUCCESS


# Leaves of Nav2's trees that work on lists of goals of the blackboard.
#
# A list of goals is a list of poses in both branches of Nav2, also where those of main are nav_msgs/Goals.


class RemovePassedGoals(PoseLeaf, SyncAction):
    """Drops the first goals as long as the robot is within ``radius`` of them, but never the last goal.

    With ``input_waypoint_statuses``, the statuses of dropped goals become COMPLETED. FAILURE if a status is missing.
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
    """Returns the first ``num_goals`` of goals. FAILURE if the list is empty."""

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
    """Returns the nodes of a route as goals, without a direction. FAILURE if the route has no nodes."""

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


NODES: Final = (
    TruncatePath,
    TruncatePathLocal,
    ConcatenatePaths,
    GetPoseFromPath,
    RemovePassedGoals,
    AppendGoalPoseToGoals,
    GetNextFewGoals,
    ExtractRouteNodesAsGoals,
)
