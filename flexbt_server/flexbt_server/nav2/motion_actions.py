# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that move the robot by Nav2's servers: drive, recover, navigate, dock. Names, ports and defaults are
Nav2's."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

from nav2_msgs import action

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.errors import TransformError
from flexbt_common.values.message_fields import duration_message
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import PortError
from flexbt_core.behavior_tree.model.outcomes import Example, Lasting
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, FLOAT, STRING, UINT16, input_port, output_port
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeStatus
from flexbt_core.skills.literals import ConditionSensor, Predicate
from flexbt_core.skills.skill import Skill
from flexbt_server.leaves.action_leaf import ACTION_PORTS, BASE
from flexbt_server.leaves.path_tracking import PathTracker
from flexbt_server.trees.blackboards import RECOVERIES_KEY
from flexbt_server.trees.ros_ports import DURATION, PATH, POSE_STAMPED, POSES, TRACKING_FEEDBACK, TrackingFeedback

from .field_ports import FieldAction
from .pose_leaves import AT

VALID: Final = Predicate('valid', {'path': 'path'}, ConditionSensor('IsPathValid', {'path': '{$path}'}))
"""No pose of a path is in collision."""

PATH_SECONDS: Final = 10.0
"""Time for which the next path is awaited after a failure of the controller, s of wall time."""


def count_recovery(board: Blackboard) -> None:
    """Add one to the recoveries of the run."""
    count = board.root.get_or(RECOVERIES_KEY, 0)
    board.root.set(RECOVERIES_KEY, int(count) + 1)


class RecoveryLeaf(FieldAction):
    """A leaf that counts as a recovery when it starts, in the blackboard key ``number_recoveries``."""

    __slots__ = ()

    def counts(self) -> bool:
        """Return whether this start is a recovery: always, or as the port ``is_recovery`` says."""
        return 'is_recovery' not in self.ports or bool(self.get_input('is_recovery'))

    def on_start(self) -> NodeStatus:
        if self.counts():
            count_recovery(self.blackboard)
        return super().on_start()


class FollowPath(FieldAction):
    """Drives along ``path``. A new path or another controller on the blackboard replaces the goal without a stop.

    A path without poses replaces nothing: while the tree retries a failed planner, the robot continues along its
    current path. If the controller fails meanwhile, its next attempt waits for the next path. If none arrives in time,
    it gets the path without poses and rejects it.

    ``tracking_feedback`` comes from the controller. If the installed interfaces lack it, as in Jazzy, the leaf computes
    it from the path and the pose of the robot.
    """

    __slots__ = ('_path_by', '_sent', '_tracker')

    action_type = action.FollowPath
    default_server = names.FOLLOW_PATH
    skill = Skill.of(parameters={'path': 'path'}, preconditions=['valid(path)'], resources=[BASE], predicates=[VALID])
    ports = ACTION_PORTS | {
        'path': input_port(PATH, description='the path to follow'),
        'controller_id': input_port(STRING, optional=True, description='controller to use'),
        'goal_checker_id': input_port(STRING, optional=True, description='goal checker to use'),
        'progress_checker_id': input_port(STRING, optional=True, description='progress checker to use'),
        'path_handler_id': input_port(STRING, optional=True, description='path handler to use', nav2_branch='main'),
        'tracking_feedback': output_port(
            TRACKING_FEEDBACK, description='how the robot is on the path', nav2_branch='main'
        ),
    }
    example = Example('<FollowPath path="{path}" controller_id="FollowPath" error_code_id="{follow_path_error_code}"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._sent: tuple[Any, ...] = ()
        self._tracker: PathTracker | None = None
        self._path_by = -math.inf

    def on_running(self) -> NodeStatus:
        if self._awaits_path():
            self._limit_wait()  # once the path arrives, ending goals again get the full time
            return NodeStatus.RUNNING
        return super().on_running()

    def on_halted(self) -> None:
        self._path_by = -math.inf
        super().on_halted()

    def _awaits_path(self) -> bool:
        if self._goal is not None or self._steady.now() >= self._path_by:
            return False
        try:
            return not self.get_input('path').poses
        except PortError:
            return False  # make_goal reports the reason

    def make_goal(self) -> Any:
        self._sent = self._wanted()
        return self.filled(self.action_type.Goal(path=self._sent[0]), *_PLUGINS)

    def newer_goal(self, feedback: Any) -> Any | None:
        if feedback is not None and self.port_key('tracking_feedback') is not None:
            self._track(feedback)
        wanted = self._wanted()
        # The blackboard gives the same object until it is written again: no comparison of hundreds of poses.
        if wanted[0] is self._sent[0] and wanted[1:] == self._sent[1:]:
            return None
        return self.make_goal() if wanted[0].poses else None

    def on_success(self, result: Any) -> NodeStatus:
        self._path_by = -math.inf
        self._forget_tracking()
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        if self._sent[0].poses:
            self._path_by = self._steady.now() + PATH_SECONDS
        self._forget_tracking()

    def _forget_tracking(self) -> None:
        self._tracker = None
        if self.port_key('tracking_feedback') is not None:
            self.set_output('tracking_feedback', TrackingFeedback())

    def _track(self, feedback: Any) -> None:
        tracking = getattr(feedback, 'tracking_feedback', None)
        path = self._sent[0]
        if tracking is None and len(path.poses) > 1:
            if self._tracker is None or self._tracker.path is not path:
                self._tracker = PathTracker(path)
            try:
                tracking = self._tracker.feedback(self.host.frames.robot_pose(path.header.frame_id), feedback.speed)
            except TransformError:
                return  # while the pose of the robot is unknown, there is nothing new to report
        if tracking is not None:
            self.set_output('tracking_feedback', tracking)

    def _wanted(self) -> tuple[Any, ...]:
        return (self.get_input('path'), *(str(self.get_input_or(port, '')) for port in _PLUGINS))


_PLUGINS: Final = ('controller_id', 'goal_checker_id', 'progress_checker_id', 'path_handler_id')

_ALLOWANCE: Final = input_port(DOUBLE, default='10.0', description='give up after this time, s; 0 for never')
_UNCHECKED: Final = input_port(BOOL, default='false', description='whether to ignore obstacles', nav2_branch='main')


class Spin(RecoveryLeaf):
    """Turns on the spot by ``spin_dist``."""

    __slots__ = ()

    action_type = action.Spin
    default_server = names.SPIN
    renamed = {'spin_dist': 'target_yaw', 'is_recovery': ''}
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'spin_dist': input_port(DOUBLE, default='1.57', description='angle, rad, positive to the left'),
        'time_allowance': _ALLOWANCE,
        'disable_collision_checks': _UNCHECKED,
        'is_recovery': input_port(BOOL, default='true', description='whether it counts as a recovery'),
    }
    example = Example('<Spin spin_dist="1.57"/>')

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        turned = 0.0 if feedback is None else feedback.angular_distance_traveled
        goal.target_yaw = float(_rest(goal.target_yaw, turned))
        return goal


def _rest(whole: float, done: float) -> float:
    """Return the rest of a motion, with the sign of the whole. Feedback is rare, so the robot repeats the distance that
    it moved since the last feedback and while it braked.
    """
    return math.copysign(max(0.0, abs(whole) - abs(done)), whole)


class _Drive(FieldAction):
    """A leaf that drives in a straight line, as far as its target port requires."""

    __slots__ = ()

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        if feedback is not None:
            goal.target.x = _rest(goal.target.x, feedback.distance_traveled)
        return goal


class BackUp(_Drive, RecoveryLeaf):
    """Drives backward by ``backup_dist``."""

    __slots__ = ()

    action_type = action.BackUp
    default_server = names.BACKUP
    renamed = {'backup_dist': 'target', 'backup_speed': 'speed'}
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'backup_dist': input_port(DOUBLE, default='0.15', description='distance, m'),
        'backup_speed': input_port(DOUBLE, default='0.025', description='speed, m/s'),
        'time_allowance': _ALLOWANCE,
        'disable_collision_checks': _UNCHECKED,
    }
    example = Example('<BackUp backup_dist="0.3" backup_speed="0.1"/>')


class DriveOnHeading(_Drive):
    """Drives straight ahead by ``dist_to_travel``."""

    __slots__ = ()

    action_type = action.DriveOnHeading
    default_server = names.DRIVE_ON_HEADING
    renamed = {'dist_to_travel': 'target'}
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'dist_to_travel': input_port(DOUBLE, default='0.15', description='distance, m; negative is backward'),
        'speed': input_port(DOUBLE, default='0.025', description='speed, m/s; of the same sign'),
        'time_allowance': _ALLOWANCE,
        'disable_collision_checks': _UNCHECKED,
    }
    example = Example('<DriveOnHeading dist_to_travel="0.5" speed="0.1"/>')


class Wait(RecoveryLeaf):
    """Waits for ``wait_duration``, on the clock of the server. The sign is ignored."""

    __slots__ = ()

    action_type = action.Wait
    default_server = names.WAIT
    ports = ACTION_PORTS | {
        'error_code_id': replace(ACTION_PORTS['error_code_id'], nav2_branch='main'),
        'wait_duration': input_port(DOUBLE, default='1.0', description='how long, s'),
    }
    outcomes = Lasting((RUNNING, SUCCESS, FAILURE), 'wait_duration')
    example = Example('<Wait wait_duration="5.0"/>')

    def make_goal(self) -> Any:
        seconds = float(self.get_input('wait_duration'))
        if seconds < 0.0:
            self.host.warn_once(f'[{self.path}] is to wait for {seconds} s; it waits for {-seconds} s')
            seconds = -seconds
        return self.action_type.Goal(time=duration_message(seconds))

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        return goal if feedback is None else self.action_type.Goal(time=feedback.time_left)


class AssistedTeleop(RecoveryLeaf):
    """Lets a person drive the robot by teleoperation, and prevents collisions.

    SUCCESS if the server aborts, as it does after ``time_allowance``; FAILURE then if the leaf is a recovery.
    """

    __slots__ = ()

    action_type = action.AssistedTeleop
    default_server = names.ASSISTED_TELEOP
    renamed = {'is_recovery': ''}
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'time_allowance': _ALLOWANCE,
        'is_recovery': input_port(BOOL, default='false', description='whether it counts as a recovery'),
    }
    example = Example('<AssistedTeleop time_allowance="30.0"/>')

    def on_failure(self, outcome: GoalOutcome) -> NodeStatus | None:
        gave_up = outcome.status is GoalStatus.ABORTED and not self.counts()
        return NodeStatus.SUCCESS if gave_up else None


class FollowObject(FieldAction):
    """Follows an object whose pose comes from a topic or a frame."""

    __slots__ = ()

    nav2_branch = 'main'
    action_type = action.FollowObject
    default_server = names.FOLLOW_OBJECT
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'pose_topic': input_port(STRING, default='dynamic_pose', description="topic of the object's pose"),
        'tracked_frame': input_port(STRING, optional=True, description='its frame, instead of the topic'),
        'max_duration': input_port(FLOAT, default='0.0', description='maximum time, s; 0: no limit'),
        'total_elapsed_time': output_port(DURATION, description='how long it was followed'),
    }
    example = Example('<FollowObject pose_topic="person_pose" max_duration="60.0"/>')


# Leaves that hand a whole task to another server of Nav2: to navigate, to dock and to undock.

DOCKED: Final = Predicate('docked')
"""The robot is at a dock. Nav2 has no leaf that measures it."""

_TREE: Final = input_port(STRING, optional=True, description="tree of that server, if not the server's default")


class NavigateToPose(FieldAction):
    """Drives to ``goal`` with a navigator, which runs its own tree."""

    __slots__ = ()

    action_type = action.NavigateToPose
    default_server = names.NAVIGATE_TO_POSE
    renamed = {'goal': 'pose'}
    skill = Skill.of(
        parameters={'goal': 'pose'},
        outcomes={'SUCCESS': ['at(goal)']},
        resources=[BASE],
        arguments={'goal': '{$goal}'},
        predicates=[AT],
    )
    ports = ACTION_PORTS | {
        'goal': input_port(POSE_STAMPED, description='where to drive'),
        'behavior_tree': _TREE,
    }
    example = Example('<NavigateToPose goal="{goal}" error_msg="{why}"/>')


class NavigateThroughPoses(FieldAction):
    """Drives through ``goals`` with a navigator, which runs its own tree."""

    __slots__ = ()

    action_type = action.NavigateThroughPoses
    default_server = names.NAVIGATE_THROUGH_POSES
    renamed = {'goals': 'poses'}
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'goals': input_port(POSES, description='poses to pass; the last is where to drive'),
        'behavior_tree': _TREE,
    }
    example = Example('<NavigateThroughPoses goals="{goals}"/>')


class DockRobot(FieldAction):
    """Docks the robot at the dock ``dock_id`` of the server's list, or at a dock given by type and pose."""

    __slots__ = ()

    action_type = action.DockRobot
    default_server = names.DOCK_ROBOT
    skill = Skill.of(outcomes={'SUCCESS': ['docked']}, resources=[BASE], predicates=[DOCKED])
    ports = ACTION_PORTS | {
        'use_dock_id': input_port(BOOL, default='true', description='whether dock_id says which dock'),
        'dock_id': input_port(STRING, optional=True, description='name of the dock'),
        'dock_pose': input_port(POSE_STAMPED, optional=True, description='where the dock is, without use_dock_id'),
        'dock_type': input_port(STRING, optional=True, description='type of that dock'),
        'max_staging_time': input_port(
            FLOAT, default='1000.0', description='time to drive to where docking begins, s; without use_dock_id'
        ),
        'navigate_to_staging_pose': input_port(BOOL, default='true', description='whether it has to drive there'),
        'success': output_port(BOOL, description='whether the robot is docked'),
        'num_retries': output_port(UINT16, description='how often it was tried again'),
    }
    example = Example('<DockRobot dock_id="home" num_retries="{retries}"/>')

    def make_goal(self) -> Any:
        goal = self.filled(self.action_type.Goal(), 'use_dock_id', 'navigate_to_staging_pose')
        return self.filled(
            goal, *(('dock_id',) if goal.use_dock_id else ('dock_pose', 'dock_type', 'max_staging_time'))
        )


class UndockRobot(FieldAction):
    """Undocks the robot."""

    __slots__ = ()

    action_type = action.UndockRobot
    default_server = names.UNDOCK_ROBOT
    skill = Skill.of(outcomes={'SUCCESS': ['not docked']}, resources=[BASE], predicates=[DOCKED])
    ports = ACTION_PORTS | {
        'dock_type': input_port(STRING, optional=True, description="type of the dock, if not the server's last"),
        'max_undocking_time': input_port(FLOAT, default='30.0', description='time that it may take, s'),
        'success': output_port(BOOL, description='whether the robot is undocked'),
    }
    example = Example('<UndockRobot dock_type="simple_charging_dock"/>')


NODES: Final = (
    FollowPath,
    Spin,
    BackUp,
    DriveOnHeading,
    Wait,
    AssistedTeleop,
    FollowObject,
    NavigateToPose,
    NavigateThroughPoses,
    DockRobot,
    UndockRobot,
)
