# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's leaves that cancel what an action server is doing, and those that ask other servers than the costmaps."""

from __future__ import annotations

from typing import Any, ClassVar, Final

from action_msgs.srv import CancelGoal
from nav2_msgs import srv
from std_srvs.srv import Empty

from flexbt_common import names
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves.action_leaf import SERVER_PORTS
from flexbt_server.leaves.service_leaf import SERVICE_PORTS, ServiceLeaf, ServiceSyncAction

from .branches import set_ports


class CancelAction(ServiceSyncAction):
    """Cancels all goals of an action server, whoever sent them."""

    __slots__ = ()

    service_type = CancelGoal
    ports = SERVER_PORTS
    default_action: ClassVar[str] = ''

    @property
    def service_name(self) -> str:
        return f'{self.get_input_or("server_name", "") or self.default_action}/_action/cancel_goal'

    def make_request(self) -> Any:
        return CancelGoal.Request()  # neither a goal nor a time: all goals

    def on_response(self, response: Any) -> NodeStatus:
        if response.return_code == CancelGoal.Response.ERROR_NONE:
            return NodeStatus.SUCCESS
        return self.fail(f'{self.service_name} refused to cancel (return code {response.return_code})')


class CancelControl(CancelAction):
    """Cancels all goals of follow_path."""

    __slots__ = ()
    default_action = names.FOLLOW_PATH
    example = Example('<CancelControl server_name="follow_path"/>')


class CancelSpin(CancelAction):
    """Cancels all goals of spin."""

    __slots__ = ()
    default_action = names.SPIN
    example = Example('<CancelSpin/>')


class CancelBackUp(CancelAction):
    """Cancels all goals of backup."""

    __slots__ = ()
    default_action = names.BACKUP
    example = Example('<CancelBackUp/>')


class CancelWait(CancelAction):
    """Cancels all goals of wait."""

    __slots__ = ()
    default_action = names.WAIT
    example = Example('<CancelWait/>')


class CancelDriveOnHeading(CancelAction):
    """Cancels all goals of drive_on_heading."""

    __slots__ = ()
    default_action = names.DRIVE_ON_HEADING
    example = Example('<CancelDriveOnHeading/>')


class CancelAssistedTeleop(CancelAction):
    """Cancels all goals of assisted_teleop."""

    __slots__ = ()
    default_action = names.ASSISTED_TELEOP
    example = Example('<CancelAssistedTeleop/>')


class CancelComputeAndTrackRoute(CancelAction):
    """Cancels all goals of compute_and_track_route."""

    __slots__ = ()
    default_action = names.COMPUTE_AND_TRACK_ROUTE
    example = Example('<CancelComputeAndTrackRoute/>')


class CancelFollowObject(CancelAction):
    """Cancels all goals of follow_object."""

    __slots__ = ()

    nav2_branch = 'main'
    default_action = names.FOLLOW_OBJECT
    example = Example('<CancelFollowObject/>')


class ReinitializeGlobalLocalization(ServiceLeaf):
    """Restarts the localization, with the robot anywhere on the map."""

    __slots__ = ()

    service_type = Empty
    default_service = 'reinitialize_global_localization'
    example = Example('<ReinitializeGlobalLocalization/>')

    def make_request(self) -> Any:
        return Empty.Request()


class ToggleCollisionMonitor(ServiceLeaf):
    """Switches the collision monitor on or off."""

    __slots__ = ()

    nav2_branch = 'main'
    service_type = srv.Toggle
    default_service = 'collision_monitor/toggle'
    ports = SERVICE_PORTS | {'enable': input_port(BOOL, default='true', description='whether it is to be on')}
    example = Example('<ToggleCollisionMonitor enable="false"/>')

    def make_request(self) -> Any:
        request = srv.Toggle.Request()
        set_ports(self, request, 'enable')
        return request

    def on_response(self, response: Any) -> NodeStatus:
        if response.success:
            return NodeStatus.SUCCESS
        return self.fail(f'{self.service_name}: {response.message or "it was not switched"}')


NODES: Final = (
    ReinitializeGlobalLocalization,
    ToggleCollisionMonitor,
    CancelControl,
    CancelSpin,
    CancelBackUp,
    CancelWait,
    CancelDriveOnHeading,
    CancelAssistedTeleop,
    CancelComputeAndTrackRoute,
    CancelFollowObject,
)
