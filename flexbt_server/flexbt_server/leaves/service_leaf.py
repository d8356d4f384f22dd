# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that send a request to a service. The response has a deadline.

As in Nav2, a leaf completes within the tick of the request if the service responds at once. Otherwise, below a
reactive control, a RUNNING leaf would halt the nodes behind it, and these would restart in each tick and never end.
While a tick waits for a response, no other node of the tree is ticked. A cancel of the tree ends the wait.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from flexbt_common.calls.service_call import ServiceCall
from flexbt_core.behavior_tree.engine.leaf import Condition, LeafNode, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.errors import PortError, TickAbandoned
from flexbt_core.behavior_tree.model.ports import STRING, UNSIGNED, Port, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.skills.skill import Skill

from .leaf_services import ServerNode

SERVICE_PORTS: Final[dict[str, Port]] = {
    'service_name': input_port(STRING, optional=True, description="name of the service, if not the node's default"),
    'server_timeout': input_port(
        UNSIGNED, optional=True, description="wait for the server and its answer, ms; the BT server's by default"
    ),
}
"""Ports of every service leaf."""

ANSWER_SECONDS = 0.5
"""Time for which a tick waits for the response to a :class:`ServiceLeaf`, s of wall time. Nav2 waits 5 ms, half of its
loop period. Services in Python take longer on a busy machine.
"""


class ServiceNode(ServerNode, LeafNode):
    """The base of leaves that call a service, of type ``service_type``.

    ``ports`` of a subclass must contain :data:`SERVICE_PORTS`.
    """

    __slots__ = ('_answered', '_call', '_is_in_tick')

    service_type: ClassVar[type[Any]]
    default_service: ClassVar[str] = ''
    ports: ClassVar[Mapping[str, Port]] = SERVICE_PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._call: ServiceCall | None = None
        self._answered = WakeEvent()
        self._is_in_tick = False

    @abstractmethod
    def make_request(self) -> Any:
        """Return the request, from the input ports. PortError and ValueError become the reason of a FAILURE."""

    def on_response(self, response: Any) -> NodeStatus:
        """Write the output ports from the response, and return the status of the leaf."""
        return NodeStatus.SUCCESS

    @property
    def service_name(self) -> str:
        """Name of the service, as the node resolves it."""
        return str(self.get_input_or('service_name', '') or self.default_service)

    @property
    def timeout(self) -> float:
        """Time limit for the service to appear, and then to respond, s of wall time."""
        milliseconds = self.get_input_or('server_timeout', None)
        return self.host.server_timeout if milliseconds is None else float(milliseconds) / 1000.0

    def ask(self, request: Any) -> NodeStatus:
        """Send a request and return RUNNING. :meth:`on_response` may call it again for another request."""
        link = self.host.services.link(self.service_type, self.service_name)
        self._call = ServiceCall(
            link,
            request,
            on_done=lambda outcome: self._on_done(),
            server_timeout=self.host.appear_timeout(self.timeout, link),
            response_timeout=self.timeout,
        )
        return NodeStatus.RUNNING

    def _on_done(self) -> None:
        self._answered.set()
        if not self._is_in_tick:
            self.wake()

    def ask_within_tick(self, seconds: float) -> NodeStatus:
        """Send the request and wait for the result within the tick; return RUNNING if it does not arrive in time."""
        clock = self.host.runtime.steady
        until = clock.now() + seconds
        try:
            request = self.make_request()
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        self._is_in_tick = True
        try:
            status = self.ask(request)
            awaited = None
            while status is NodeStatus.RUNNING and self._call is not awaited:
                awaited = self._call
                assert awaited is not None  # made by ask
                while not awaited.done and clock.now() < until:
                    self.wait_in_tick(self._answered, clock, until)
                self._is_in_tick = awaited.done  # if False, a later answer wakes the tree
                status = self.result()
        except TickAbandoned:
            self.give_up()
            raise
        finally:
            self._is_in_tick = False
        return status

    def result(self) -> NodeStatus:
        """Return the status of the leaf for the response, or RUNNING until one arrives."""
        assert self._call is not None  # made by ask
        outcome = self._call.outcome
        if outcome is None:
            return NodeStatus.RUNNING
        if outcome.response is None:
            return self.fail(outcome.reason)
        return self.on_response(outcome.response)

    def give_up(self) -> None:
        """Forget the request."""
        if self._call is not None:
            self._call.cancel()
            self._call = None


class ServiceLeaf(ServiceNode, StatefulAction):
    """Base of actions that call a service; RUNNING if the response takes longer than :data:`ANSWER_SECONDS`.

    Leaves that Nav2 derives from BtServiceNode use it.
    """

    __slots__ = ()

    goes_on = 'its request was sent, and cannot be taken back'
    answers_soon = True
    skill = Skill.of(ignores_cancel=True)

    def on_start(self) -> NodeStatus:
        return self.ask_within_tick(ANSWER_SECONDS)

    def on_running(self) -> NodeStatus:
        return self.result()

    def on_halted(self) -> None:
        self.give_up()


class _WithinTick(ServiceNode):
    __slots__ = ()

    def tick(self) -> NodeStatus:
        """Send the request and wait for the response."""
        timeout = self.timeout
        status = self.ask_within_tick(timeout)
        if status is not NodeStatus.RUNNING:
            return status
        self.give_up()
        return self.fail(f'service {self.service_name!r} did not answer within {timeout:g} s; is its node running?')


class ServiceCondition(_WithinTick, Condition):
    """Base of conditions that call a service. The tick waits for the response; FAILURE if it does not come in time."""

    __slots__ = ()


class ServiceSyncAction(_WithinTick, SyncAction):
    """Base of actions that call a service and complete within the tick, which waits for the response."""

    __slots__ = ()
