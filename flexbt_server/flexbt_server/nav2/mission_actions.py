# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that hand a whole task to another server of Nav2: to navigate, to dock and to undock."""

from __future__ import annotations

from typing import Any, Final

from nav2_msgs import action

from flexbt_common import names
from flexbt_common.calls import GoalOutcome
from flexbt_common.values import set_poses
from flexbt_core.behavior_tree import Example, NodeStatus, input_port, output_port
from flexbt_core.behavior_tree.model import BOOL, FLOAT, STRING, UINT16
from flexbt_core.skills import Predicate, Skill
from flexbt_server.leaves import ACTION_PORTS, BASE, POSE_STAMPED, POSES, ActionLeaf

from .interface_fields import set_ports
from .pose_leaves import AT

DOCKED: Final = Predicate('docked')
"""The robot is at a dock. Nav2 has no leaf that measures it."""

_TREE: Final = input_port(STRING, optional=True, description="tree of that server, if not the server's default")


class NavigateToPose(ActionLeaf):
    """Drives to ``goal`` by a navigator, which runs a tree of its own."""

    __slots__ = ()

    action_type = action.NavigateToPose
    default_server = names.NAVIGATE_TO_POSE
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

    def make_goal(self) -> Any:
        goal = self.action_type.Goal(pose=self.get_input('goal'))
        set_ports(self, goal, 'behavior_tree')
        return goal


class NavigateThroughPoses(ActionLeaf):
    """Drives through ``goals`` by a navigator, which runs a tree of its own."""

    __slots__ = ()

    action_type = action.NavigateThroughPoses
    default_server = names.NAVIGATE_THROUGH_POSES
    skill = Skill.of(resources=[BASE])
    ports = ACTION_PORTS | {
        'goals': input_port(POSES, description='poses to pass; the last is where to drive'),
        'behavior_tree': _TREE,
    }
    example = Example('<NavigateThroughPoses goals="{goals}"/>')

    def make_goal(self) -> Any:
        goal = self.action_type.Goal()
        set_poses(goal, 'poses', self.get_input('goals'))
        set_ports(self, goal, 'behavior_tree')
        return goal


class DockRobot(ActionLeaf):
    """Docks the robot: to the dock ``dock_id`` of the server's list, or to one of a type at a pose."""

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
        goal = self.action_type.Goal()
        set_ports(self, goal, 'use_dock_id', 'navigate_to_staging_pose')
        if goal.use_dock_id:
            set_ports(self, goal, 'dock_id')
        else:
            set_ports(self, goal, 'dock_pose', 'dock_type', 'max_staging_time')
        return goal

    def on_success(self, result: Any) -> NodeStatus:
        self.set_output('success', result.success)
        self.set_output('num_retries', result.num_retries)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.set_output('success', False)
        self.set_output('num_retries', getattr(outcome.result, 'num_retries', 0))


class UndockRobot(ActionLeaf):
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

    def make_goal(self) -> Any:
        goal = self.action_type.Goal()
        set_ports(self, goal, 'dock_type', 'max_undocking_time')
        return goal

    def on_success(self, result: Any) -> NodeStatus:
        self.set_output('success', result.success)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.set_output('success', False)


NODES: Final = (NavigateToPose, NavigateThroughPoses, DockRobot, UndockRobot)
