# SPDX-License-Identifier: BSD-3-Clause
"""Decorators of Nav2 that watch the robot's motion or a topic with newer goals, and the control node that services
pause."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Odometry

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.nav2 import controls as nav2_pause
from flexbt_core.behavior_tree.nodes.nav2 import decorators as nav2_motion
from flexbt_server.leaves.leaf_services import ServerNode
from flexbt_server.leaves.path_tracking import position_of
from flexbt_server.leaves.topic_cache import SubscribedTopic, TopicCache
from flexbt_server.trees.ros_ports import POSE_STAMPED, POSES


class DistanceController(ServerNode, nav2_motion.DistanceController):
    __doc__ = nav2_motion.DistanceController.__doc__
    __slots__ = ()
    example = Example(
        """
        <DistanceController distance="1.0">
          <ComputePathToPose goal="{goal}" path="{path}"/>
        </DistanceController>
        """
    )

    def position(self) -> nav2_motion.Position | None:
        try:
            pose = self.host.frames.robot_pose(
                self.get_input_or('global_frame', ''), self.get_input_or('robot_base_frame', '')
            )
        except TransformError:
            return None
        return position_of(pose)


class SpeedController(ServerNode, nav2_motion.SpeedController):
    __doc__ = nav2_motion.SpeedController.__doc__
    __slots__ = ('_cache',)

    ports = {
        **nav2_motion.SpeedController.ports,
        'goal': replace(nav2_motion.SpeedController.ports['goal'], type=POSE_STAMPED),
        'goals': replace(nav2_motion.SpeedController.ports['goals'], type=POSES),
    }
    odometry = SubscribedTopic(Odometry, names.ODOM)
    example = Example(
        """
        <SpeedController min_rate="0.1" max_rate="1.0" max_speed="0.5" goal="{goal}">
          <ComputePathToPose goal="{goal}" path="{path}"/>
        </SpeedController>
        """
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [cls.odometry]

    def speed(self) -> float:
        if self._cache is None:
            self._cache = self.host.topics.cache(self.odometry)
        odometry = self._cache.latest
        if odometry is None:
            return 0.0
        velocity = odometry.twist.twist.linear
        return math.hypot(velocity.x, velocity.y)


class GoalUpdater(ServerNode, Decorator):
    """Ticks the child with the last goal published on ``goal_update`` if that goal is newer than ``input_goal``.

    The stamps decide which goal is newer. A published goal without a stamp is never newer. Goals to pass are unchanged.
    """

    __slots__ = ('_cache',)

    ports = {
        'input_goal': input_port(POSE_STAMPED, description='the goal that was given'),
        'output_goal': output_port(POSE_STAMPED, description='the newer of the two'),
        'input_goals': input_port(POSES, optional=True, description='goals to pass', nav2_branch='main'),
        'output_goals': output_port(POSES, description='the same goals, or newer ones', nav2_branch='main'),
    }
    nav2_branch = 'jazzy'
    goal_update = SubscribedTopic(PoseStamped, 'goal_update')
    example = Example(
        """
        <GoalUpdater input_goal="{goal}" output_goal="{newest}">
          <ComputePathToPose goal="{newest}" path="{path}"/>
        </GoalUpdater>
        """
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [cls.goal_update]

    def tick(self) -> NodeStatus:
        if self._cache is None:
            self._cache = self.subscribe(self.goal_update)
        goal = PoseStamped() if self.port_text('input_goal') is None else self.get_input('input_goal')
        published = self._cache.latest
        if published is not None and self.newer(_stamp(published), _stamp(goal)):
            goal = published
        self.set_output('output_goal', goal)
        goals = self.newer_goals(self.get_input_or('input_goals', None))
        if goals is not None:
            self.set_output('output_goals', goals)
        return self.tick_child()

    def newer(self, published: tuple[int, int], given: tuple[int, int]) -> bool:
        """Return whether a goal published with one stamp (s, ns) replaces the given goal with the other stamp."""
        return published > given

    def newer_goals(self, goals: Sequence[PoseStamped] | None) -> Sequence[PoseStamped] | None:
        """Return the goals to pass that replace the given ones."""
        return goals


class GoalUpdaterOfMain(GoalUpdater):
    """GoalUpdater as in Nav2's branch main: a published goal with the same stamp also counts as newer.

    The topic ``goals_update`` (nav_msgs/Goals) also updates the goals to pass. The stamp of the given goals is that of
    their first. A tree that updates only these need not give a goal.
    """

    __slots__ = ('_goals',)

    xml_name = 'GoalUpdater'
    nav2_branch = 'main'
    ports = {**GoalUpdater.ports, 'input_goal': replace(GoalUpdater.ports['input_goal'], required=False)}
    goals_update = SubscribedTopic(Goals, 'goals_update')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._goals: TopicCache | None = None

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [*super().subscribes_to(), cls.goals_update]

    def newer(self, published: tuple[int, int], given: tuple[int, int]) -> bool:
        return published >= given and published != (0, 0)

    def newer_goals(self, goals: Sequence[PoseStamped] | None) -> Sequence[PoseStamped] | None:
        if self.port_key('output_goals') is None:
            return goals
        if self._goals is None:
            self._goals = self.subscribe(self.goals_update)
        published = self._goals.latest
        given = _stamp(goals[0]) if goals else (0, 0)
        if published is not None and published.goals and self.newer(_stamp(published), given):
            return list(published.goals)
        return goals


def _stamp(stamped: Any) -> tuple[int, int]:
    return stamped.header.stamp.sec, stamped.header.stamp.nanosec


class PauseResumeController(ServerNode, nav2_pause.PauseResumeController):
    __doc__ = nav2_pause.PauseResumeController.__doc__
    __slots__ = ('__weakref__', '_offered')

    nav2_branch = 'main'
    example = Example(
        """
        <PauseResumeController pause_service_name="pause" resume_service_name="resume">
          <FollowPath path="{path}"/>
        </PauseResumeController>
        """
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._offered = False

    def tick(self) -> NodeStatus:
        if not self._offered:
            self._offered = True
            for port, request in (('pause_service_name', self.pause), ('resume_service_name', self.resume)):
                name = self.get_input_or(port, '')
                if name:
                    self.host.triggers.offer(name, request)
        return super().tick()


NODES: Final = (DistanceController, SpeedController, GoalUpdater, GoalUpdaterOfMain, PauseResumeController)
