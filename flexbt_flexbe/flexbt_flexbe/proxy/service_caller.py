# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxy for services."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_common.calls import ServiceCall, ServiceLink, ServiceOutcome
from flexbt_core.values import shown
from flexbt_flexbe.errors import NoResultError, ProxyError

from .action_client import SERVER_SECONDS
from .run_proxy import Listeners, RunProxy

RESPONSE_SECONDS: Final = 30.0
"""How long a service may take to answer a request that is not waited for."""

BLOCKING_SECONDS: Final = 5.0
"""How long :meth:`ProxyServiceCaller.call` waits for an answer."""


@dataclass
class _Service:
    """One service as this proxy uses it: the link, and the request that was sent last."""

    link: ServiceLink
    listeners: Listeners = field(default_factory=Listeners)
    call: ServiceCall | None = None


class ProxyServiceCaller(RunProxy):
    """Sends requests to services, one at a time on each, and keeps the responses."""

    def __init__(self, topics: Mapping[str, type[Any]] | None = None, wait_duration: float = 10.0) -> None:
        super().__init__()
        self._services: dict[str, _Service] = {}
        for topic, service_type in (topics or {}).items():
            self.setupService(topic, service_type, wait_duration)

    def setupService(self, topic: str, srv_type: type[Any], wait_duration: float = 10.0) -> None:
        """Make the service known. Discovery begins now; it is not waited for, whatever ``wait_duration`` says."""
        known = self._services.get(topic)
        if known is None:
            self._services[topic] = _Service(self._run.services.services.link(srv_type, topic))
        elif known.link.service_type is not srv_type:
            raise ProxyError(f'service {topic!r} is used as {known.link} already, not as {shown(srv_type)}')

    setup_service = setupService

    def is_available(self, topic: str, wait_duration: float = 1.0) -> bool:
        """Whether the service was set up and is there now; ``wait_duration`` is not waited for."""
        service = self._services.get(topic)
        if service is None:
            return False
        return bool(self._run.services.runtime.call(service.link.is_ready))

    def call(self, topic: str, request: Any, wait_duration: float = 1.0) -> Any:
        """Send a request and wait for its response: at most ``wait_duration`` s for the service and 5 s for the answer.

        The run can neither be paused nor stopped meanwhile: prefer :meth:`call_async`.

        Raises:
            ProxyError: the service was not set up, or this is a callback on the executor's thread.
            NoResultError: no service, or no response in time.
        """
        if self._run.services.runtime.on_executor_thread:
            raise ProxyError(f'service {topic!r}: a callback cannot wait for a response; use call_async')
        answered = threading.Event()
        call = self._send(topic, request, wait_duration, BLOCKING_SECONDS, answered.set)
        answered.wait(max(wait_duration, SERVER_SECONDS) + 2 * BLOCKING_SECONDS)
        return _response(topic, call)

    def call_async(self, topic: str, request: Any, wait_duration: float = 1.0) -> None:
        """Send a request; ask :meth:`done` for its end, which comes within bounded time.

        Raises:
            ProxyError: the service was not set up, or the request is not one of it.
        """
        service = self._service(topic)
        service.listeners.note_caller()
        service.call = self._send(topic, request, wait_duration, RESPONSE_SECONDS, service.listeners.wake)

    def done(self, topic: str) -> bool:
        """Whether the request has ended, with a response or without."""
        service = self._service(topic)
        service.listeners.note_caller()
        return service.call is not None and service.call.done

    def result(self, topic: str) -> Any:
        """The response; None while there is none.

        Raises:
            NoResultError: the request has ended without one.
        """
        service = self._service(topic)
        service.listeners.note_caller()
        return _response(topic, service.call) if service.call is not None and service.call.done else None

    def remove_client(self, topic: str) -> None:
        """Forget the service, and the response to its last request."""
        self._services.pop(topic, None)

    def _send(self, topic: str, request: Any, wait: float, response_timeout: float, ring: Any) -> ServiceCall:
        service = self._service(topic)
        request_type = service.link.service_type.Request
        if not isinstance(request, request_type):
            raise ProxyError(f'service {topic!r}: a request is a {request_type.__name__}, not {shown(request)}')

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
