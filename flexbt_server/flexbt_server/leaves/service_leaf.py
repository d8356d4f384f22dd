# SPDX-License-Identifier: BSD-3-Clause
"""Leaves whose work is a request to a service. They never block; the answer has a deadline."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from action_msgs.srv import CancelGoal
from nav2_msgs import srv
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls import ServiceCall
from flexbt_core.behavior_tree import NodeConfig, NodeStatus, Port, StatefulAction, input_port
from flexbt_core.behavior_tree.model import STRING, UNSIGNED, PortError
from flexbt_server.trees import PATH

from .action_leaf import SERVER_PORTS
from .leaf_services import LeafServices
from .navigation_actions import count_recovery

SERVICE_PORTS: Final[dict[str, Port]] = {
    'service_name': input_port(STRING, optional=True, description="name of the service, if not the node's default"),
    'server_timeout': input_port(
        UNSIGNED, optional=True, description="wait for the service and its answer, ms; the BT server's by default"
    ),
}
"""Ports of every service leaf."""


class ServiceLeaf(StatefulAction):
    """Base of leaves that ask a service, of type ``service_type``.

    ``ports`` of a subclass has to contain :data:`SERVICE_PORTS`.
    """

    __slots__ = ('_call',)

    service_type: ClassVar[type[Any]]
    default_service: ClassVar[str] = ''
    ports: ClassVar[Mapping[str, Port]] = SERVICE_PORTS
    goes_on = 'its request was sent, and cannot be taken back'

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._call: ServiceCall | None = None

    @abstractmethod
    def make_request(self) -> Any:
        """The request, from the input ports. PortError and ValueError become the reason of a FAILURE."""

    def on_response(self, response: Any) -> NodeStatus:
        """There is a response: write the output ports."""
        return NodeStatus.SUCCESS

    @property
    def host(self) -> LeafServices:
        """What the BT server provides."""
        services: LeafServices = self.services
        return services

    @property
    def service_name(self) -> str:
        """Name of the service, as the node resolves it."""
        return str(self.get_input_or('service_name', '') or self.default_service)

    def on_start(self) -> NodeStatus:
        try:
            request = self.make_request()
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        milliseconds = self.get_input_or('server_timeout', None)
        timeout = self.host.server_timeout if milliseconds is None else milliseconds / 1000.0
        self._call = ServiceCall(
            self.host.services.link(self.service_type, self.service_name),
            request,
            on_done=lambda outcome: self.wake(),
            server_timeout=self.host.appear_timeout(timeout),
            response_timeout=timeout,
        )
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        assert self._call is not None  # made by on_start
        outcome = self._call.outcome
        if outcome is None:
            return NodeStatus.RUNNING
        if outcome.response is None:
            return self.fail(outcome.reason)
        return self.on_response(outcome.response)

    def on_halted(self) -> None:
        if self._call is not None:
            self._call.cancel()
            self._call = None


class ClearEntireCostmap(ServiceLeaf):
    """Forgets everything that a costmap has seen. Counts as a recovery."""

    __slots__ = ()

    service_type = srv.ClearEntireCostmap
    default_service = names.CLEAR_GLOBAL_COSTMAP

    def make_request(self) -> Any:
        count_recovery(self.blackboard)
        return self.service_type.Request()


class IsPathValid(ServiceLeaf):
    """Succeeds when no pose of ``path`` is in collision."""

    __slots__ = ()

    service_type = srv.IsPathValid
    default_service = names.IS_PATH_VALID
    ports = SERVICE_PORTS | {'path': input_port(PATH, optional=True, description='the path to check')}

    def make_request(self) -> Any:
        return self.service_type.Request(path=self.get_input_or('path', Path()))

    def on_response(self, response: Any) -> NodeStatus:
        return NodeStatus.SUCCESS if response.is_valid else self.fail('the path is not valid')


class CancelAction(ServiceLeaf):
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


class CancelSpin(CancelAction):
    """Cancels all goals of spin."""

    __slots__ = ()
    default_action = names.SPIN


class CancelBackUp(CancelAction):
    """Cancels all goals of backup."""

    __slots__ = ()
    default_action = names.BACKUP


class CancelWait(CancelAction):
    """Cancels all goals of wait."""

    __slots__ = ()
    default_action = names.WAIT


class CancelDriveOnHeading(CancelAction):
    """Cancels all goals of drive_on_heading."""

    __slots__ = ()
    default_action = names.DRIVE_ON_HEADING


NODES: Final = (
    ClearEntireCostmap,
    IsPathValid,
    CancelControl,
    CancelSpin,
    CancelBackUp,
    CancelWait,
    CancelDriveOnHeading,
)
