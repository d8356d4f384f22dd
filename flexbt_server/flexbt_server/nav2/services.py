# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's leaves that cancel the goals of an action server, and those that call services other than the costmaps'."""

from __future__ import annotations

from abc import ABCMeta
from typing import Any, ClassVar, Final, cast

from action_msgs.srv import CancelGoal
from nav2_msgs import srv
from std_srvs.srv import Empty

from flexbt_common import names
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves.action_leaf import SERVER_PORTS
from flexbt_server.leaves.service_leaf import SERVICE_PORTS, ServiceLeaf, ServiceSyncAction

from .field_ports import FieldService


class CancelAction(ServiceSyncAction):
    """Cancels all goals of an action server, including those of other clients."""

    __slots__ = ()

    service_type = CancelGoal
    ports = SERVER_PORTS
    default_action: ClassVar[str] = ''

    @property
    def service_name(self) -> str:
        return f'{self.get_input_or("server_name", "") or self.default_action}/_action/cancel_goal'

    def make_request(self) -> Any:
        return CancelGoal.Request()  # no ID and no time: all goals

    def on_response(self, response: Any) -> NodeStatus:
        if response.return_code == CancelGoal.Response.ERROR_NONE:
            return NodeStatus.SUCCESS
        return self.fail(f'{self.service_name} refused to cancel (return code {response.return_code})')


def _cancel(id: str, action: str, nav2_branch: str = '') -> type[CancelAction]:
    """Return the leaf that cancels all goals of an action."""
    attributes = {
        '__doc__': f'Cancels all goals of {action}.',
        '__module__': __name__,
        '__slots__': (),
        'default_action': action,
        'nav2_branch': nav2_branch,
        'example': Example(f'<{id}/>'),
    }
    return cast('type[CancelAction]', ABCMeta(id, (CancelAction,), attributes))


class ReinitializeGlobalLocalization(FieldService, ServiceLeaf):
    """Restarts the localization, with the robot anywhere on the map."""

    __slots__ = ()

    service_type = Empty
    default_service = 'reinitialize_global_localization'
    example = Example('<ReinitializeGlobalLocalization/>')


class ToggleCollisionMonitor(FieldService, ServiceLeaf):
    """Switches the collision monitor on or off."""

    __slots__ = ()

    nav2_branch = 'main'
    service_type = srv.Toggle
    default_service = 'collision_monitor/toggle'
    ports = SERVICE_PORTS | {'enable': input_port(BOOL, default='true', description='whether it is to be on')}
    example = Example('<ToggleCollisionMonitor enable="false"/>')

    def on_response(self, response: Any) -> NodeStatus:
        if response.success:
            return NodeStatus.SUCCESS
        return self.fail(f'{self.service_name}: {response.message or "it was not switched"}')


NODES: Final = (
    ReinitializeGlobalLocalization,
    ToggleCollisionMonitor,
    _cancel('CancelControl', names.FOLLOW_PATH),
    _cancel('CancelSpin', names.SPIN),
    _cancel('CancelBackUp', names.BACKUP),
    _cancel('CancelWait', names.WAIT),
    _cancel('CancelDriveOnHeading', names.DRIVE_ON_HEADING),
    _cancel('CancelAssistedTeleop', names.ASSISTED_TELEOP),
    _cancel('CancelComputeAndTrackRoute', names.COMPUTE_AND_TRACK_ROUTE),
    _cancel('CancelFollowObject', names.FOLLOW_OBJECT, 'main'),
)
