# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2's trees that ask where the robot is."""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header

from flexbt_core.behavior_tree.engine.leaf import Condition, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import DOUBLE, STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.skills.literals import ConditionSensor, Predicate
from flexbt_core.skills.skill import Skill
from flexbt_server.leaves.path_tracking import NearestPose, path_length, position_of
from flexbt_server.leaves.topic_leaf import PoseLeaf
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, TRACKING_FEEDBACK

AT: Final = Predicate('at', {'goal': 'pose'}, ConditionSensor('GoalReached', {'goal': '{$goal}'}), exclusive='goal')
"""The robot is at a pose; the blackboard has this pose under the name of the object."""

_NEAR: Final = Predicate(
    'near',
    {'ref_pose': 'pose', 'target_pose': 'pose'},
    ConditionSensor('ArePosesNear', {'ref_pose': '{$ref_pose}', 'target_pose': '{$target_pose}'}),
)
_TRANSFORM: Final = Predicate(
    'transform_available',
    {'child': 'frame', 'parent': 'frame'},
    ConditionSensor('TransformAvailable', {'child': '$child', 'parent': '$parent'}),
)

_GLOBAL: Final = input_port(STRING, optional=True, description="frame of the poses, if not the server's")
_BASE: Final = input_port(STRING, optional=True, description="frame of the robot, if not the server's")


class GetCurrentPose(PoseLeaf, SyncAction):
    """Returns the pose of the robot. FAILURE while the pose is unknown."""

    __slots__ = ()

    ports = {
        'global_frame': _GLOBAL,
        'robot_base_frame': _BASE,
        'current_pose': output_port(POSE_STAMPED, description='where the robot is'),
    }
    example = Example('<GetCurrentPose current_pose="{start}"/>')

    def evaluate(self) -> NodeStatus:
        self.set_output('current_pose', self.robot_pose())
        return NodeStatus.SUCCESS


class ArePosesNear(PoseLeaf, Condition):
    """SUCCESS when two poses are within ``tolerance``. Poses in different frames are compared in ``global_frame``."""

    __slots__ = ()

    skill = Skill.measuring(_NEAR)
    ports = {
        'ref_pose': input_port(POSE_STAMPED, description='one of the poses'),
        'target_pose': input_port(POSE_STAMPED, description='the other'),
        'global_frame': _GLOBAL,
        'tolerance': input_port(DOUBLE, default='0.5', description='m'),
    }
    example = Example('<ArePosesNear ref_pose="{goal}" target_pose="{end}" tolerance="0.3"/>')

    def evaluate(self) -> NodeStatus:
        poses = [self.get_input('ref_pose'), self.get_input('target_pose')]
        if poses[0].header.frame_id != poses[1].header.frame_id:
            frame = self.get_input_or('global_frame', '') or self.frames.global_frame
            poses = [self.frames.pose_in(pose, frame) for pose in poses]
        distance = math.dist(*map(position_of, poses))
        if distance <= self.get_input('tolerance'):
            return NodeStatus.SUCCESS
        return self.fail(f'the poses are {distance:.2f} m apart')


class GoalReached(PoseLeaf, Condition):
    """SUCCESS when the robot is within the server's parameter ``goal_reached_tol`` of ``goal``."""

    __slots__ = ()

    skill = Skill.measuring(AT)
    ports = {
        'goal': input_port(POSE_STAMPED, description='the goal'),
        'global_frame': input_port(
            STRING, optional=True, description='not used: that of the goal counts', nav2_branch='jazzy'
        ),
        'robot_base_frame': _BASE,
    }
    example = Example('<GoalReached goal="{goal}"/>')

    def evaluate(self) -> NodeStatus:
        goal = self.get_input('goal')
        distance = math.dist(position_of(goal), position_of(self.robot_pose(goal.header.frame_id)))
        if distance <= self.host.goal_reached_tol:
            return NodeStatus.SUCCESS
        return self.fail(f'the robot is {distance:.2f} m away')


class DistanceTraveled(PoseLeaf, Condition):
    """SUCCESS each time the robot has moved ``distance`` in a straight line. The first tick after IDLE starts counting.

    Some parents set the node to IDLE, such as a ReactiveSequence with a RUNNING child. Below them it restarts in each
    tick.
    """

    __slots__ = ('_start',)

    ports = {
        'distance': input_port(DOUBLE, default='1.0', description='m'),
        'global_frame': _GLOBAL,
        'robot_base_frame': _BASE,
    }
    example = Example('<DistanceTraveled distance="0.5"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._start: tuple[float, float] | None = None

    def evaluate(self) -> NodeStatus:
        if self.status is NodeStatus.IDLE:
            self._start = None
        here = position_of(self.robot_pose())
        if self._start is None:
            self._start = here
            return self.fail('the robot has not moved yet')
        moved = math.dist(self._start, here)
        if moved < self.get_input('distance'):
            return self.fail(f'the robot has moved {moved:.2f} m')
        self._start = here
        return NodeStatus.SUCCESS


class IsGoalNearby(PoseLeaf, Condition):
    """SUCCESS when less than ``proximity_threshold`` of the path is left.

    The remaining length counts from the pose of the path that is nearest to the robot. FAILURE if the path has no
    poses, and while the pose of the robot is unknown.
    """

    __slots__ = ('_nearest',)

    nav2_branch = 'main'
    ports = {
        'path': input_port(PATH, optional=True, description='the path'),
        'proximity_threshold': input_port(DOUBLE, default='1.0', description='length that is near, m'),
        'max_robot_pose_search_dist': input_port(
            DOUBLE, default='-1.0', description='how far along the same path from the last time is searched, m; '
            'less than 0 for all of it',
        ),
        'global_frame': _GLOBAL,
        'robot_base_frame': _BASE,
    }  # fmt: skip
    example = Example('<IsGoalNearby path="{path}" proximity_threshold="1.5"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._nearest = NearestPose()

    def evaluate(self) -> NodeStatus:
        path: Any = self.get_input_or('path', None)
        if path is None or not path.poses:
            return self.fail('the path is empty')
        pose = self.robot_pose(path.header.frame_id)
        nearest = self._nearest.index(path, pose, float(self.get_input('max_robot_pose_search_dist')))
        left = path_length(self._nearest.points[nearest:])
        if left < self.get_input('proximity_threshold'):
            return NodeStatus.SUCCESS
        return self.fail(f'{left:.2f} m of the path are left')


class IsWithinPathTrackingBounds(PoseLeaf, Condition):
    """SUCCESS while the tracking error of the robot on its path is within the bounds, or unknown.

    The signs of the bounds are ignored.
    """

    __slots__ = ()

    nav2_branch = 'main'
    ports = {
        'max_error_left': input_port(DOUBLE, default='0.5', description='how far to the left it may be, m'),
        'max_error_right': input_port(DOUBLE, default='0.5', description='how far to the right it may be, m'),
        'max_error_heading': input_port(DOUBLE, default='3.14', description='how far it may be turned away, rad'),
        'tracking_feedback': input_port(
            TRACKING_FEEDBACK, optional=True, description='how the robot is on the path, by FollowPath'
        ),
    }
    example = Example(
        '<IsWithinPathTrackingBounds max_error_left="0.3" max_error_right="0.3" tracking_feedback="{feedback}"/>'
    )

    def evaluate(self) -> NodeStatus:
        feedback: Any = self.get_input_or('tracking_feedback', None)
        if feedback is None:
            return NodeStatus.SUCCESS
        aside, turned = feedback.position_tracking_error, feedback.heading_tracking_error
        bound = self.get_input('max_error_left' if aside >= 0.0 else 'max_error_right')
        if abs(aside) <= abs(bound) and abs(turned) <= abs(self.get_input('max_error_heading')):
            return NodeStatus.SUCCESS
        side = 'left' if aside >= 0.0 else 'right'
        return self.fail(f'the robot is {abs(aside):.2f} m to the {side} of the path, and turned by {turned:.2f} rad')


class TransformAvailable(PoseLeaf, Condition):
    """SUCCESS as soon as a transform between two frames is known, and always after that."""

    __slots__ = ('_found',)

    skill = Skill.measuring(_TRANSFORM)
    ports = {
        'child': input_port(STRING, default='', description='one of the frames'),
        'parent': input_port(STRING, default='', description='the other'),
    }
    example = Example('<TransformAvailable child="base_link" parent="map"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._found = False

    def evaluate(self) -> NodeStatus:
        child, parent = self.get_input('child'), self.get_input('parent')
        if not (child and parent):
            raise ValueError(f'ports [child] and [parent] have to name frames, not {child!r} and {parent!r}')
        if not self._found:
            self.frames.pose_in(PoseStamped(header=Header(frame_id=parent)), child)
            self._found = True
        return NodeStatus.SUCCESS


NODES: Final = (
    GetCurrentPose,
    ArePosesNear,
    GoalReached,
    DistanceTraveled,
    IsGoalNearby,
    IsWithinPathTrackingBounds,
    TransformAvailable,
)
