# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's leaves that ask the costmaps, and what is built on them: to clear, for costs, whether a path is free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs import srv

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.errors import PortError
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, STRING, UNSIGNED, Port, input_port, list_of, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.skills.literals import ConditionSensor, Predicate
from flexbt_core.skills.skill import Skill
from flexbt_server.leaves.path_tracking import yaw_of
from flexbt_server.leaves.service_leaf import SERVICE_PORTS, ServiceCondition, ServiceLeaf
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, POSES, WAYPOINT_STATUSES

from .branches import SKIPPED, mark
from .field_ports import FieldService
from .motion_actions import VALID, count_recovery

_OCCUPIED: Final = Predicate('occupied', {'pose': 'pose'}, ConditionSensor('CheckPoseOccupancy', {'pose': '{$pose}'}))

_PLUGINS: Final = input_port(
    list_of(STRING), optional=True, description='layers to clear, separated by ;; all if none', nav2_branch='main'
)
_DISTANCE: Final = input_port(DOUBLE, default='1.0', description='side of the square, m')


class _ClearCostmap(FieldService, ServiceLeaf):
    """A leaf that clears a costmap. Counts as a recovery."""

    __slots__ = ()

    def make_request(self) -> Any:
        request = super().make_request()
        count_recovery(self.blackboard)
        return request

    def on_response(self, response: Any) -> NodeStatus:
        # Only main's services report success.
        if getattr(response, 'success', True):
            return NodeStatus.SUCCESS
        return self.fail(f'{self.service_name} did not clear the costmap')


class ClearEntireCostmap(_ClearCostmap):
    """Forgets everything that a costmap has seen. Counts as a recovery."""

    __slots__ = ()

    service_type = srv.ClearEntireCostmap
    default_service = names.CLEAR_GLOBAL_COSTMAP
    ports = SERVICE_PORTS | {'plugins': _PLUGINS}
    example = Example('<ClearEntireCostmap service_name="local_costmap/clear_entirely_local_costmap"/>')


class ClearCostmapExceptRegion(_ClearCostmap):
    """Forgets what a costmap has seen, except in a square around the robot. Counts as a recovery."""

    __slots__ = ()

    service_type = srv.ClearCostmapExceptRegion
    default_service = 'local_costmap/clear_except_local_costmap'
    ports = SERVICE_PORTS | {'reset_distance': _DISTANCE, 'plugins': _PLUGINS}
    example = Example(
        '<ClearCostmapExceptRegion service_name="local_costmap/clear_except_local_costmap" reset_distance="2.0"/>'
    )


class ClearCostmapAroundRobot(_ClearCostmap):
    """Forgets what a costmap has seen in a square around the robot. Counts as a recovery."""

    __slots__ = ()

    service_type = srv.ClearCostmapAroundRobot
    default_service = 'local_costmap/clear_around_local_costmap'
    ports = SERVICE_PORTS | {'reset_distance': _DISTANCE, 'plugins': _PLUGINS}
    example = Example(
        '<ClearCostmapAroundRobot service_name="local_costmap/clear_around_local_costmap" reset_distance="2.0"/>'
    )


class ClearCostmapAroundPose(_ClearCostmap):
    """Forgets what a costmap has seen in a square around a pose. Counts as a recovery."""

    __slots__ = ()

    service_type = srv.ClearCostmapAroundPose
    default_service = 'local_costmap/clear_around_pose_local_costmap'
    ports = SERVICE_PORTS | {
        'pose': input_port(POSE_STAMPED, description='middle of the square'),
        'reset_distance': _DISTANCE,
        'plugins': _PLUGINS,
    }
    example = Example(
        '<ClearCostmapAroundPose service_name="global_costmap/clear_around_pose_global_costmap" pose="{goal}"/>'
    )


class _PathChecker(FieldService):
    """A leaf that asks whether a path is free."""

    __slots__ = ()

    service_type = srv.IsPathValid
    default_service = names.IS_PATH_VALID
    skill = Skill.measuring(VALID)
    ports = SERVICE_PORTS | {
        'path': input_port(PATH, optional=True, description='the path to check'),
        'max_cost': input_port(UNSIGNED, default='253', description='cost from which a cell is in collision'),
        'consider_unknown_as_obstacle': input_port(
            BOOL, default='false', description='whether unknown cells are obstacles'
        ),
    }

    def on_response(self, response: Any) -> NodeStatus:
        return NodeStatus.SUCCESS if response.is_valid else self.fail('the path is not valid')


class IsPathValid(_PathChecker, ServiceCondition):
    """Succeeds when no pose of ``path`` is in collision. In Nav2's branch main this leaf is ValidatePath.

    ``max_cost`` and ``consider_unknown_as_obstacle`` come from kilted. Services with Jazzy's interfaces lack these
    fields: there the ports have no effect, and the node logs it if a tree sets one.
    """

    __slots__ = ()

    nav2_branch = 'jazzy'
    example = Example('<IsPathValid path="{path}"/>')


class ValidatePath(_PathChecker, ServiceLeaf):
    """Succeeds when no pose of ``path`` is in collision."""

    __slots__ = ('_path',)

    nav2_branch = 'main'
    skill = _PathChecker.skill
    ports = _PathChecker.ports | {
        'max_cost': input_port(UNSIGNED, default='254', description='cost from which a cell is in collision'),
        'layer_name': input_port(STRING, default='', description='layer of the costmap to look at; all if empty'),
        'footprint': input_port(STRING, default='', description="footprint to check, if not the robot's"),
        'stop_at_first_collision': input_port(BOOL, default='true', description='whether one collision is enough'),
        'max_lookahead_distance': input_port(
            DOUBLE, default='-1.0', description='how far along the path, m; less than 0 for all of it'
        ),
        'collision_poses': output_port(POSES, description='poses in collision'),
    }
    example = Example('<ValidatePath path="{path}" max_lookahead_distance="5.0" collision_poses="{blocked}"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._path: Any = None

    def make_request(self) -> Any:
        request = super().make_request()
        self._path = request.path
        return request

    def on_response(self, response: Any) -> NodeStatus:
        if not getattr(response, 'success', True):
            return self.fail(f'{self.service_name} could not check the path')
        poses = self._path.poses
        wrong = () if response.is_valid else response.invalid_pose_indices
        self.set_output('collision_poses', [poses[index] for index in wrong if 0 <= index < len(poses)])
        return super().on_response(response)


NO_INFORMATION: Final = 255
"""Cost of an unknown cell."""

_ASKS_FOR_ALL: Final = hasattr(srv, 'GetCosts')
"""True if the service accepts all poses at once, as in main. Jazzy's accepts one, in the frame of the costmap."""

_COST_PORTS: Final[Mapping[str, Port]] = SERVICE_PORTS | {
    'cost_threshold': input_port(DOUBLE, default='254.0', description='cost from which a pose is occupied'),
    'use_footprint': input_port(BOOL, default='true', description="whether the robot's footprint is checked"),
    'consider_unknown_as_obstacle': input_port(
        BOOL, default='false', description='whether unknown cells are obstacles'
    ),
}


class _CostLeaf(ServiceLeaf):
    """A leaf that asks a costmap for the costs of poses."""

    __slots__ = ('_costs', '_poses')

    service_type = srv.GetCosts if _ASKS_FOR_ALL else srv.GetCost
    default_service = 'global_costmap/get_cost_global_costmap'

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._poses: Sequence[PoseStamped] = ()
        self._costs: list[float] = []

    def poses(self) -> Sequence[PoseStamped]:
        """Return the poses whose costs the leaf requests, at least one. PortError becomes the reason of a FAILURE."""
        raise NotImplementedError

    def on_occupied(self, occupied: Sequence[bool]) -> NodeStatus:
        """Return the status of the leaf; ``occupied``: whether each pose is occupied."""
        raise NotImplementedError

    def make_request(self) -> Any:
        self._poses, self._costs = self.poses(), []
        return self._request()

    def on_response(self, response: Any) -> NodeStatus:
        if not getattr(response, 'success', True):
            return self.fail(f'{self.service_name} has no costs of these poses')
        self._costs += response.costs if _ASKS_FOR_ALL else [response.cost]
        if _ASKS_FOR_ALL and len(self._costs) != len(self._poses):
            return self.fail(f'{self.service_name} gave {len(self._costs)} costs of {len(self._poses)} poses')
        if len(self._costs) < len(self._poses):
            try:
                return self.ask(self._request())
            except ValueError as error:
                return self.fail(str(error))
        least, unknown = self.get_input('cost_threshold'), self.get_input('consider_unknown_as_obstacle')
        return self.on_occupied([cost >= least and (unknown or cost != NO_INFORMATION) for cost in self._costs])

    def _request(self) -> Any:
        request = self.service_type.Request(use_footprint=bool(self.get_input('use_footprint')))
        if _ASKS_FOR_ALL:
            request.poses = list(self._poses)
            return request
        frames = self.host.frames
        try:
            pose = frames.pose_in(self._poses[len(self._costs)], frames.global_frame)
        except TransformError as error:
            raise ValueError(str(error)) from error
        request.x, request.y, request.theta = pose.pose.position.x, pose.pose.position.y, yaw_of(pose)
        return request


class CheckPoseOccupancy(_CostLeaf):
    """Succeeds when the costmap has an obstacle at ``pose``."""

    __slots__ = ()

    nav2_branch = 'main'
    skill = Skill.measuring(_OCCUPIED)
    ports = {**_COST_PORTS, 'pose': input_port(POSE_STAMPED, description='the pose to check')}
    example = Example('<CheckPoseOccupancy service_name="global_costmap/get_cost_global_costmap" pose="{goal}"/>')

    def poses(self) -> Sequence[PoseStamped]:
        return [self.get_input('pose')]

    def on_occupied(self, occupied: Sequence[bool]) -> NodeStatus:
        return NodeStatus.SUCCESS if any(occupied) else self.fail('the pose is free')


class RemoveInCollisionGoals(_CostLeaf):
    """Drops goals at which the costmap has an obstacle, even all of them. Their waypoint statuses become SKIPPED."""

    __slots__ = ()

    nav2_branch = 'main'
    ports = {
        **_COST_PORTS,
        'input_goals': input_port(POSES, description='goals to pass'),
        'output_goals': output_port(POSES, description='those that are free'),
        'input_waypoint_statuses': input_port(WAYPOINT_STATUSES, optional=True, description='statuses of waypoints'),
        'output_waypoint_statuses': output_port(WAYPOINT_STATUSES, description='the same, with those of the goals'),
    }
    example = Example(
        '<RemoveInCollisionGoals service_name="global_costmap/get_cost_global_costmap" '
        'input_goals="{goals}" output_goals="{goals}"/>'
    )

    def on_start(self) -> NodeStatus:
        try:
            goals = self.get_input('input_goals')
        except PortError as error:
            return self.fail(str(error))
        if not goals:
            self.set_output('output_goals', [])
            return NodeStatus.SUCCESS
        return super().on_start()

    def poses(self) -> Sequence[PoseStamped]:
        goals: Sequence[PoseStamped] = self.get_input('input_goals')
        return goals

    def on_occupied(self, occupied: Sequence[bool]) -> NodeStatus:
        statuses = self.get_input_or('input_waypoint_statuses', None)
        dropped = [goal for goal, there in zip(self._poses, occupied, strict=True) if there]
        if statuses is not None:
            try:
                statuses = mark(statuses, dropped, SKIPPED)
            except LookupError as error:
                return self.fail(str(error))
        self.set_output('output_goals', [goal for goal, there in zip(self._poses, occupied, strict=True) if not there])
        self.set_output('output_waypoint_statuses', [] if statuses is None else statuses)
        return NodeStatus.SUCCESS


NODES: Final = (
    ClearEntireCostmap,
    ClearCostmapExceptRegion,
    ClearCostmapAroundRobot,
    ClearCostmapAroundPose,
    IsPathValid,
    ValidatePath,
    CheckPoseOccupancy,
    RemoveInCollisionGoals,
)
