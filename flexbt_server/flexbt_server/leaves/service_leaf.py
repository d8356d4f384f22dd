# SPDX-License-Identifier: BSD-3-Clause
"""Leaves whose work is a request to a service. They never block; the answer has a deadline."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from flexbt_common.calls import ServiceCall
from flexbt_core.behavior_tree import NodeConfig, NodeStatus, Port, StatefulAction, input_port
from flexbt_core.behavior_tree.model import STRING, UNSIGNED, PortError
from flexbt_core.skills import Skill

from .leaf_services import LeafServices

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
    skill = Skill.of(ignores_cancel=True)

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
        return self.ask(request)

    def ask(self, request: Any) -> NodeStatus:
        """Send a request; RUNNING. In :meth:`on_response` another one, after the first."""
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
