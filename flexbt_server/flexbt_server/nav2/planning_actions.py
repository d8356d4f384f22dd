# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that compute paths and routes with Nav2's servers. Names, ports and defaults are those of Nav2.

A path is for one goal: a planner that is halted while it plans empties ``{path}``, as in Nav2, and a tree that plans
starts without a path. (In Nav2 the halts at the end of every run empty it. Here the tree of a controller may read the
path from the blackboard after the tree of the planner has ended.)
"""

from __future__ import annotations

from typing import Any, ClassVar, Final

from builtin_interfaces.msg import Duration
from nav2_msgs import action

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, INT, STRING, UINT16, UNSIGNED, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves.action_leaf import ACTION_PORTS
from flexbt_server.trees.ros_ports import DURATION, PATH, POSE_STAMPED, POSES, ROUTE

from .field_ports import FieldAction

_START: Final = input_port(POSE_STAMPED, optional=True, description="where the path begins, if not at the robot's pose")


class _Planner(FieldAction):
    """A leaf that plans. If it is halted, there is no plan."""

    __slots__ = ()

    cancels_on_pause = False  # nothing moves by it
    begins_without: ClassVar[tuple[str, ...]] = ('path',)

    def on_halted(self) -> None:
        super().on_halted()
        for port in self.begins_without:
            self.empty_output(port)

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.write(self.action_type.Result())


class _PathPlanner(_Planner):
    """A leaf that plans a path, from the robot's pose or from ``start``."""

    __slots__ = ()

    renamed = {'use_start': ''}

    def make_goal(self) -> Any:
        goal = super().make_goal()
        goal.use_start = self.get_input_or('start', None) is not None
        if 'use_start' in self.ports:
            is_wanted = bool(self.get_input_or('use_start', goal.use_start))
            if is_wanted and not goal.use_start:
                self.host.warn_once(f'[{self.path}] is to use a start that is not given; it plans from the robot')
            goal.use_start &= is_wanted
        return goal


class ComputePathToPose(_PathPlanner):
    """Plans a path to ``goal``, from the robot's pose or from ``start``."""

    __slots__ = ()

    action_type = action.ComputePathToPose
    default_server = names.COMPUTE_PATH_TO_POSE
    ports = ACTION_PORTS | {
        'goal': input_port(POSE_STAMPED, description='where the path ends'),
        'start': _START,
        'use_start': input_port(BOOL, optional=True, description='whether a given start counts; true by default'),
        'planner_id': input_port(STRING, default='', description='planner to use'),
        'viapoints': input_port(
            POSES, optional=True, description='poses that the path is to come by', nav2_branch='main'
        ),
        'path': output_port(PATH, description='the path; empty when there is none'),
    }
    example = Example('<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{compute_path_error_code}"/>')


class ComputePathThroughPoses(_PathPlanner):
    """Plans a path through ``goals``, in their order."""

    __slots__ = ()

    action_type = action.ComputePathThroughPoses
    default_server = names.COMPUTE_PATH_THROUGH_POSES
    ports = ACTION_PORTS | {
        'goals': input_port(POSES, description='poses to pass; the last is where the path ends'),
        'start': _START,
        'planner_id': input_port(STRING, default='', description='planner to use'),
        'path': output_port(PATH, description='the path; empty when there is none'),
        'last_reached_index': output_port(
            INT,
            description='the last of the goals that the path reaches, from 0; -1 for all of them',
            nav2_branch='main',
        ),
    }
    example = Example('<ComputePathThroughPoses goals="{goals}" path="{path}"/>')

    def write(self, message: Any) -> None:
        super().write(message)
        # A planner that does not report the index has planned through all goals.
        self.set_output('last_reached_index', getattr(message, 'last_reached_index', -1))


class SmoothPath(FieldAction):
    """Smooths ``unsmoothed_path``."""

    __slots__ = ()

    action_type = action.SmoothPath
    default_server = names.SMOOTH_PATH
    renamed = {'unsmoothed_path': 'path', 'smoothed_path': 'path'}
    cancels_on_pause = False  # nothing moves by it
    ports = ACTION_PORTS | {
        'unsmoothed_path': input_port(PATH, description='the path to smooth'),
        'smoother_id': input_port(STRING, optional=True, description='smoother to use'),
        'max_smoothing_duration': input_port(DOUBLE, default='3.0', description='time that it may take, s'),
        'check_for_collisions': input_port(BOOL, default='false', description='whether the result is checked'),
        'smoothed_path': output_port(PATH, description='the smooth path'),
        'smoothing_duration': output_port(DOUBLE, description='time that it took, s'),
        'was_completed': output_port(BOOL, description='false when it had to stop early'),
    }
    example = Example('<SmoothPath unsmoothed_path="{path}" max_smoothing_duration="1.0" smoothed_path="{path}"/>')

    def on_failure(self, outcome: GoalOutcome) -> None:
        """Leave the output ports unchanged: ``smoothed_path`` may be the path itself."""


_ROUTE_GOAL_PORTS: Final = {
    'use_poses': input_port(BOOL, default='false', description='whether start and goal are poses, not IDs of nodes'),
    'goal': input_port(POSE_STAMPED, optional=True, description='where the path ends, with use_poses'),
    'use_start': input_port(BOOL, default='false', description='whether to use start, with use_poses'),
    'start': _START,
    'goal_id': input_port(UNSIGNED, optional=True, description='node of the graph where it ends'),
    'start_id': input_port(UNSIGNED, optional=True, description='node of the graph where it begins'),
}


class _RouteLeaf(FieldAction):
    """A leaf whose goal is a route in the graph of the route server: by poses, or by IDs of nodes."""

    __slots__ = ()

    cancels_on_pause = False  # nothing moves by it

    def make_goal(self) -> Any:
        goal = self.action_type.Goal(use_poses=bool(self.get_input('use_poses')))
        if not goal.use_poses:
            return self.filled(goal, 'start_id', 'goal_id')
        goal.goal = self.get_input('goal')
        goal.use_start = bool(self.get_input('use_start'))
        if goal.use_start:
            goal.start = self.get_input('start')
        return goal


class ComputeRoute(_RouteLeaf, _Planner):
    """Computes a route in the graph of the route server, and a path along it."""

    __slots__ = ()

    action_type = action.ComputeRoute
    default_server = names.COMPUTE_ROUTE
    begins_without = ('path', 'route')
    ports = (
        ACTION_PORTS
        | _ROUTE_GOAL_PORTS
        | {
            'route': output_port(ROUTE, description='the route; empty when there is none'),
            'path': output_port(PATH, description='a path along the route; empty when there is none'),
            'planning_time': output_port(DURATION, description='time that it took'),
        }
    )
    example = Example('<ComputeRoute start_id="1" goal_id="7" route="{route}" path="{path}"/>')


class ComputeAndTrackRoute(_RouteLeaf):
    """Computes a route, and reports the robot's progress on it until the robot is at its end.

    The outputs follow the feedback of the server, and are empty after the end. Another start or goal on the
    blackboard replaces the current goal.
    """

    __slots__ = ()

    action_type = action.ComputeAndTrackRoute
    default_server = names.COMPUTE_AND_TRACK_ROUTE
    ports = (
        ACTION_PORTS
        | _ROUTE_GOAL_PORTS
        | {
            'last_node_id': output_port(UINT16, description='node that was passed last'),
            'next_node_id': output_port(UINT16, description='node that comes next'),
            'current_edge_id': output_port(UINT16, description='edge between them'),
            'route': output_port(ROUTE, description='the route'),
            'path': output_port(PATH, description='a path along the route'),
            'rerouted': output_port(BOOL, description='whether it is another route than before'),
            'execution_duration': output_port(DURATION, description='time that it took'),
        }
    )
    example = Example('<ComputeAndTrackRoute use_poses="true" goal="{goal}" next_node_id="{next}"/>')

    def newer_goal(self, feedback: Any) -> Any | None:
        if feedback is not None:
            self.write(feedback)
        wanted = self.make_goal()
        return None if wanted == self.sent_goal else wanted

    def on_success(self, result: Any) -> NodeStatus:
        self._end(result.execution_duration)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self._end(Duration())

    def _end(self, duration: Duration) -> None:
        self.write(self.action_type.Feedback())
        self.set_output('execution_duration', duration)


NODES: Final = (
    ComputePathToPose,
    ComputePathThroughPoses,
    SmoothPath,
    ComputeRoute,
    ComputeAndTrackRoute,
)
