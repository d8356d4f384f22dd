# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxies for actions and services."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from action_msgs.msg import GoalStatus as RosGoalStatus

from flexbt_common.calls.action_call import ActionCall, ActionServerLink, GoalOutcome, GoalStatus
from flexbt_common.calls.service_call import ServiceCall, ServiceLink, ServiceOutcome
from flexbt_common.values.value_types import message_type_name
from flexbt_core.values.text import short_repr
from flexbt_flexbe.errors import NoResultError, ProxyError
from flexbt_onboard.behaviors.run_context import RunContext, current_run

from .run_proxy import Listeners, RunProxy, calling_state

SERVER_SECONDS: Final = 2.0
"""Time from the creation of a client until its server counts as missing, s."""

_STATUS: Final = {
    GoalStatus.SUCCEEDED: RosGoalStatus.STATUS_SUCCEEDED,
    GoalStatus.CANCELED: RosGoalStatus.STATUS_CANCELED,
}
_TERMINAL: Final = (*_STATUS.values(), RosGoalStatus.STATUS_ABORTED)
_STATUS_NAMES: Final = {
    value: name.removeprefix('STATUS_') for name, value in vars(RosGoalStatus).items() if name.startswith('STATUS_')
}


@dataclass
class _Client:
    """One action of a proxy: the link and the last goal."""

    topic: str
    link: ActionServerLink
    made_at: float
    listeners: Listeners = field(default_factory=Listeners)
    call: ActionCall | None = None
    sent: object = None
    """Identity of the last goal."""
    feedback: Any = None
    is_removed: bool = False

    @property
    def ended(self) -> GoalOutcome | None:
        """Outcome of the last goal, unless it was removed."""
        return self.call.outcome if self.call is not None and not self.is_removed else None

    def forget_result(self) -> None:
        """Drop the result of the last goal."""
        self.is_removed |= self.ended is not None


class _Clients(list[_Client]):
    """The clients of a run."""

    def __init__(self, run: RunContext) -> None:
        super().__init__()


class _Results:
    """FlexBE's ``ProxyActionClient._result``: results by topic, for the clients of the calling state. States of
    flexible_navigation write None there for a result that they have read."""

    def __contains__(self, topic: str) -> bool:
        return any(self._used(topic))

    def __setitem__(self, topic: str, result: None) -> None:
        if result is not None:
            raise ProxyError(
                f'action {topic!r}: a result comes from its server; only None may be written, to forget it'
            )
        for client in self._used(topic):
            client.forget_result()

    def _used(self, topic: str) -> Iterator[_Client]:
        for client in current_run().shared(_Clients):
            if client.topic == topic and client.listeners.has_caller():
                yield client


class ProxyActionClient(RunProxy):
    """A client that sends goals, one at a time per action, and keeps the results.

    Each proxy has its own goals: two states that use the same action do not disturb each other. Nothing blocks: a goal
    is sent when its server is available. If none appears, or the goal is rejected, lost, or aborted without a result,
    :meth:`get_result` raises an error with the reason instead of returning an invented result.
    """

    _result: Final = _Results()

    def __init__(self, topics: Mapping[str, type[Any]] | None = None, wait_duration: float = 10.0) -> None:
        super().__init__()
        self._clients: dict[str, _Client] = {}
        for topic, action_type in (topics or {}).items():
            self.setupClient(topic, action_type, wait_duration)

    def setupClient(self, topic: str, action_type: type[Any], wait_duration: float = 10.0) -> None:
        """Set up the action and start discovery. It never waits; ``wait_duration`` has no effect."""
        known = self._clients.get(topic)
        if known is not None and known.link.server_type is action_type:
            return
        if known is not None:
            used = message_type_name(known.link.server_type)
            raise ProxyError(f'action {topic!r} is used as {used} already, not as {short_repr(action_type)}')
        services = self._run.services
        client = _Client(topic, services.actions.link(action_type, topic), services.runtime.steady.now())
        self._clients[topic] = client
        self._run.shared(_Clients).append(client)

    setup_client = setupClient

    def send_goal(self, topic: str, goal: Any, wait_duration: float = 0.0) -> None:
        """Send a goal. Its server must appear within ``wait_duration`` seconds; this call does not wait for it.

        Raises:
            ProxyError: the action was not set up, the goal has another type, the last goal is still active, or the
                server is known to be missing.
        """
        client = self._client(topic)
        goal_type = client.link.server_type.Goal
        if not isinstance(goal, goal_type):
            raise ProxyError(f'action {topic!r}: a goal is a {goal_type.__name__}, not {short_repr(goal)}')
        if self.is_active(topic) and client.call is not None and not client.call.cancel_requested:
            raise ProxyError(f'action {topic!r}: the goal that was sent before is still active; cancel it first')
        runtime = self._run.services.runtime
        patience = max(wait_duration, SERVER_SECONDS - (runtime.steady.now() - client.made_at))
        if patience <= 0 and not client.link.is_ready():
            raise ProxyError(f'there is no {client.link}; is its node running?')
        client.feedback = None
        client.is_removed = False
        client.listeners.note_caller()
        sent = client.sent = object()

        def keep_feedback(feedback: Any) -> None:
            if client.sent is sent:  # a goal that was replaced goes on until its cancel takes effect
                client.feedback = client.link.server_type.Impl.FeedbackMessage(feedback=feedback)
                client.listeners.wake()

        client.call = ActionCall(
            client.link,
            goal,
            on_done=lambda _: client.listeners.wake(),
            on_feedback=keep_feedback,
            server_timeout=max(patience, 0.0),
        )
        self._run.services.goals.add(calling_state(), topic, client.call)

    def is_available(self, topic: str) -> bool:
        """Return whether the action was set up and its server is available."""
        client = self._clients.get(topic)
        return client is not None and client.link.is_ready()

    def is_active(self, topic: str) -> bool:
        """Return whether a goal was sent and has not ended."""
        client = self._asked(topic)
        return client is not None and client.call is not None and not client.call.done

    def has_result(self, topic: str) -> bool:
        """Return whether the goal has ended; :meth:`get_result` returns or raises the result."""
        client = self._asked(topic)
        return client is not None and client.ended is not None

    def get_result(self, topic: str, clear: bool = False) -> Any:
        """Return the result of the goal, None before its end; ``clear`` drops it as :meth:`remove_result` does.

        Raises:
            NoResultError: the goal has ended without a result. This includes an aborted goal with a default result,
                because the zeros in it often mean success.
        """
        client = self._asked(topic)
        ended = client.ended if client is not None else None
        if client is None or ended is None:
            return None
        client.is_removed |= clear
        result = ended.result
        is_own_cancel = ended.status is GoalStatus.CANCELED and client.call is not None and client.call.cancel_requested
        if result is not None and (
            ended.status is GoalStatus.SUCCEEDED or is_own_cancel or result != type(result)()  # has content
        ):
            return result
        raise NoResultError(f'action {topic!r}: {ended.reason}')

    def remove_result(self, topic: str) -> None:
        """Drop the result of the last goal."""
        client = self._clients.get(topic)
        if client is not None:
            client.forget_result()

    def has_feedback(self, topic: str) -> bool:
        """Return whether feedback on the last goal has arrived."""
        client = self._asked(topic)
        return client is not None and client.feedback is not None

    def get_feedback(self, topic: str, clear: bool = False) -> Any:
        """Return the newest feedback message or None. As in rclpy, the feedback itself is in its field
        ``feedback``.

        ``clear`` drops it.
        """
        client = self._asked(topic)
        feedback = client.feedback if client is not None else None
        if clear:
            self.remove_feedback(topic)
        return feedback

    def remove_feedback(self, topic: str) -> None:
        """Drop the feedback."""
        client = self._clients.get(topic)
        if client is not None:
            client.feedback = None

    def get_status(self, topic: str) -> int:
        """Return a constant of action_msgs/msg/GoalStatus: UNKNOWN before the goal is accepted, ABORTED for all
        failures."""
        client = self._client(topic)
        client.listeners.note_caller()
        call = client.call
        if call is None:
            return RosGoalStatus.STATUS_UNKNOWN
        if call.outcome is not None:
            return _STATUS.get(call.outcome.status, RosGoalStatus.STATUS_ABORTED)
        if call.cancel_requested:
            return RosGoalStatus.STATUS_CANCELING
        return RosGoalStatus.STATUS_EXECUTING if call.accepted else RosGoalStatus.STATUS_UNKNOWN

    get_state = get_status

    def get_status_string(self, topic: str) -> str:
        """Return the name of :meth:`get_status`: 'UNKNOWN', 'EXECUTING', 'CANCELING', 'SUCCEEDED', 'CANCELED',
        'ABORTED'."""
        return _STATUS_NAMES[self.get_status(topic)]

    def verify_action_status(self, topic: str, wait_duration: float = 0.1) -> tuple[bool, int]:
        """Return whether the goal has ended, and its status. It never waits; ``wait_duration`` has no effect.

        The run waits for a goal that was canceled when its state was left.
        """
        status = self.get_status(topic)
        return status in _TERMINAL, status

    def cancel(self, topic: str) -> None:
        """Cancel the goal, at any time. The state that sent it has halted only when the goal has ended."""
        client = self._clients.get(topic)
        if client is not None and client.call is not None:
            client.call.cancel(None)

    def remove_client(self, topic: str) -> None:
        """Cancel the goal and remove the action."""
        self.cancel(topic)
        removed = self._clients.pop(topic, None)
        clients = self._run.shared(_Clients)
        clients[:] = [client for client in clients if client is not removed]

    def _client(self, topic: str) -> _Client:
        try:
            return self._clients[topic]
        except KeyError:
            known = ', '.join(self._clients) or 'none'
            raise ProxyError(f'action {topic!r} was not set up (known: {known}); call setupClient first') from None

    def _asked(self, topic: str) -> _Client | None:
        client = self._clients.get(topic)
        if client is not None:
            client.listeners.note_caller()
        return client


# FlexBE's proxy for services.

RESPONSE_SECONDS: Final = 30.0
"""Time limit for the response to an asynchronous request, s."""

BLOCKING_SECONDS: Final = 5.0
"""Time that :meth:`ProxyServiceCaller.call` waits for a response, s."""


@dataclass
class _Service:
    """One service of a proxy: the link and the last request."""

    link: ServiceLink
    listeners: Listeners = field(default_factory=Listeners)
    call: ServiceCall | None = None


class ProxyServiceCaller(RunProxy):
    """A client that sends requests, one at a time per service, and keeps the responses."""

    def __init__(self, topics: Mapping[str, type[Any]] | None = None, wait_duration: float = 10.0) -> None:
        super().__init__()
        self._services: dict[str, _Service] = {}
        for topic, service_type in (topics or {}).items():
            self.setupService(topic, service_type, wait_duration)

    def setupService(self, topic: str, srv_type: type[Any], wait_duration: float = 10.0) -> None:
        """Set up the service and start discovery. It never waits; ``wait_duration`` has no effect."""
        known = self._services.get(topic)
        if known is None:
            self._services[topic] = _Service(self._run.services.services.link(srv_type, topic))
        elif known.link.server_type is not srv_type:
            used = message_type_name(known.link.server_type)
            raise ProxyError(f'service {topic!r} is used as {used} already, not as {short_repr(srv_type)}')

    setup_service = setupService

    def is_available(self, topic: str, wait_duration: float = 1.0) -> bool:
        """Return whether the service was set up and is available. It never waits; ``wait_duration`` has no effect."""
        service = self._services.get(topic)
        if service is None:
            return False
        return bool(self._run.services.runtime.call(service.link.is_ready))

    def call(self, topic: str, request: Any, wait_duration: float = 1.0) -> Any:
        """Send a request and wait for its response: at most ``wait_duration`` s for the service, then 5 s.

        The run cannot be paused or stopped meanwhile: prefer :meth:`call_async`.

        Raises:
            ProxyError: the service was not set up, or the caller is a callback on the executor's thread.
            NoResultError: the service is missing, or did not respond in time.
        """
        if self._run.services.runtime.on_executor_thread:
            raise ProxyError(f'service {topic!r}: a callback cannot wait for a response; use call_async')
        answered = threading.Event()
        call = self._send(topic, request, wait_duration, BLOCKING_SECONDS, answered.set)
        answered.wait(max(wait_duration, SERVER_SECONDS) + 2 * BLOCKING_SECONDS)
        return _response(topic, call)

    def call_async(self, topic: str, request: Any, wait_duration: float = 1.0) -> None:
        """Send a request without waiting; poll :meth:`done`. The request ends within bounded time.

        Raises:
            ProxyError: the service was not set up, or the request has another type.
        """
        service = self._service(topic)
        service.listeners.note_caller()
        service.call = self._send(topic, request, wait_duration, RESPONSE_SECONDS, service.listeners.wake)

    def done(self, topic: str) -> bool:
        """Return whether the request has ended, with or without a response."""
        service = self._service(topic)
        service.listeners.note_caller()
        return service.call is not None and service.call.done

    def result(self, topic: str) -> Any:
        """Return the response; None before it arrives.

        Raises:
            NoResultError: the request has ended without a response.
        """
        service = self._service(topic)
        service.listeners.note_caller()
        return _response(topic, service.call) if service.call is not None and service.call.done else None

    def remove_client(self, topic: str) -> None:
        """Remove the service and the response to its last request."""
        self._services.pop(topic, None)

    def _send(self, topic: str, request: Any, wait: float, response_timeout: float, ring: Any) -> ServiceCall:
        service = self._service(topic)
        request_type = service.link.server_type.Request
        if not isinstance(request, request_type):
            raise ProxyError(f'service {topic!r}: a request is a {request_type.__name__}, not {short_repr(request)}')

        def on_done(_: ServiceOutcome) -> None:
            ring()

        return ServiceCall(
            service.link,
            request,
            on_done=on_done,
            server_timeout=max(wait, SERVER_SECONDS),
            response_timeout=response_timeout,
        )

    def _service(self, topic: str) -> _Service:
        try:
            return self._services[topic]
        except KeyError:
            known = ', '.join(self._services) or 'none'
            raise ProxyError(f'service {topic!r} was not set up (known: {known}); call setupService first') from None


def _response(topic: str, call: ServiceCall) -> Any:
    outcome = call.outcome
    if outcome is None:
        raise NoResultError(f'service {topic!r}: no response in time')
    if not outcome.ok:
        raise NoResultError(f'service {topic!r}: {outcome.reason}')
    return outcome.response
