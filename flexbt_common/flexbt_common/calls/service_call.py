# SPDX-License-Identifier: BSD-3-Clause
"""One request to a service, with deadlines and exactly one outcome."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Final

from flexbt_common.names import service_qos
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.value_types import exact

from .links import SETTLE_SECONDS, WATCH_SECONDS, ServerCall, ServerLink, ServerLinks, ServerNodes

_LATE: Final = 1.0
"""Seconds by which the executor may be late to report a missing response."""


@dataclass(frozen=True)
class ServiceOutcome:
    """The end of a request: the response, or None and the ``reason`` for a person."""

    response: Any | None
    reason: str

    @property
    def ok(self) -> bool:
        """True if a response has arrived, with any content."""
        return self.response is not None


class ServiceLink(ServerLink):
    """The connection of this node to one service. :class:`ServiceLinks` creates it on the executor thread; ``client``
    is rclpy's."""

    kind = 'service'
    asks_silent = True  # important above all for cancels

    def __init__(self, runtime: Runtime, service_type: Any, name: str, nodes: ServerNodes) -> None:
        super().__init__(runtime, service_type, name, nodes, f'rr{runtime.node.resolve_service_name(name)}Reply')
        self.client: Any = runtime.node.create_client(service_type, name, qos_profile=service_qos())
        self.entities = (self.client,)
        self._seen_since: float | None = None

    def is_shown(self) -> bool:
        """Return whether the middleware shows the service, and the service has had time to discover this client."""
        now = self.runtime.steady.now()
        if not self.client.service_is_ready():
            self._seen_since = None
        elif self._seen_since is None:
            self._seen_since = now
        return self._seen_since is not None and now - self._seen_since >= SETTLE_SECONDS


def service_outcome(link: ServiceLink, request: Any, timeout: float) -> ServiceOutcome:
    """Send a request and wait for its outcome. Not on the executor thread.

    ``timeout``: time for the service to appear, and again for the response, s of wall time.
    """
    done: Future[ServiceOutcome] = Future()
    call = ServiceCall(link, request, on_done=done.set_result, server_timeout=timeout, response_timeout=timeout)
    try:
        return done.result(2.0 * timeout + _LATE)
    except TimeoutError:
        call.cancel()
        return ServiceOutcome(None, f'the executor of {link.runtime.name} does not get to the request to {link}')


class ServiceLinks(ServerLinks[ServiceLink]):
    """The links of one node to services."""

    link_class = ServiceLink


class ServiceCall(ServerCall[ServiceLink, ServiceOutcome]):
    """A request to a service. Thread-safe; may be created on any thread."""

    def __init__(
        self,
        link: ServiceLink,
        request: Any,
        *,
        on_done: Callable[[ServiceOutcome], None],
        server_timeout: float = 1.0,
        response_timeout: float = 1.0,
    ) -> None:
        """Send ``request`` as soon as the service is available.

        ``on_done`` is called exactly once, on the executor thread. Wall time in seconds: ``server_timeout`` for the
        service to appear, ``response_timeout`` from sending to the response.
        """
        self._request = request
        self._response_timeout = response_timeout
        self._future: Any = None
        super().__init__(link, on_done, server_timeout)  # starts the call

    def cancel(self) -> None:
        """Stop waiting for the response. The service itself cannot be stopped."""
        self._runtime.post(lambda: self._finish(None, f'the request to {self._link} was given up'))

    def _not_there(self, why: str) -> None:
        self._finish(None, why)

    def _send(self) -> None:
        try:
            self._future = self._link.client.call_async(exact(self._request))
        except Exception as error:
            self._finish(None, f'the request to {self._link} cannot be sent: {error or type(error).__name__}')
            return
        self._future.add_done_callback(self._answered)
        self._after('answer', self._response_timeout, self._not_answered)
        self._watch()

    def _watch(self) -> None:
        if self.done:
            return
        if self._servers is not None and self._servers.are_gone:
            self._finish(None, f'{self._link} is gone: its process ended, or is out of reach')
        else:
            self._after('watch', WATCH_SECONDS, self._watch)

    def _answered(self, future: Any) -> None:
        if not future.cancelled():
            self._finish(future.result(), '')

    def _not_answered(self) -> None:
        self._finish(
            None,
            f'{self._link} did not answer within {self._response_timeout:g} s; '
            'is it overloaded, or built from other interface definitions?',
        )

    def _finish(self, response: Any | None, reason: str) -> None:
        if self.done:
            return
        if self._future is not None and not self._future.done():
            self._link.client.remove_pending_request(self._future)
        self._end(ServiceOutcome(response, reason))
