# SPDX-License-Identifier: BSD-3-Clause
"""Services of the type std_srvs/Trigger by which nodes of running trees take requests."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, Final

from std_srvs.srv import Trigger

from flexbt_common.runtime import NodeRuntime

Handler = Callable[[], bool]


MOST_SERVICES: Final = 100
"""Services that are kept although no tree takes their requests now."""


class TriggerServices:
    """The services of a server, by name; they are kept for the trees that come later.

    A service calls every handler that was offered under its name, as long as the object to which it belongs exists. It
    succeeds when one of them gives True.
    """

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._handlers: dict[str, list[weakref.WeakMethod[Handler]]] = {}
        self._services: dict[str, Any] = {}

    def offer(self, name: str, handler: Handler) -> None:
        """Calls ``handler``, a bound method, on each request to the service ``name``. From any thread."""
        reference = weakref.WeakMethod(handler)
        self._runtime.call(lambda: self._add(name, reference))

    def _add(self, name: str, reference: weakref.WeakMethod[Handler]) -> None:
        name = self._runtime.node.resolve_service_name(name)
        if name not in self._handlers:
            self._forget_unused()
            self._handlers[name] = []
            self._services[name] = self._runtime.node.create_service(
                Trigger, name, lambda _, response: self._answer(name, response)
            )
        self._handlers[name] = [known for known in self._handlers[name] if known() is not None] + [reference]

    def _forget_unused(self) -> None:
        unused = [name for name, handlers in self._handlers.items() if not any(handler() for handler in handlers)]
        for name in unused[: max(0, len(self._handlers) + 1 - MOST_SERVICES)]:
            del self._handlers[name]
            self._runtime.node.destroy_service(self._services.pop(name))

    def _answer(self, name: str, response: Any) -> Any:
        handlers = [handler for reference in self._handlers[name] if (handler := reference()) is not None]
        # Each of them is asked, whatever the others say.
        taken = [handler() for handler in handlers]
        response.success = any(taken)
        if not response.success:
            response.message = 'no running tree has a node that takes this request now'
        return response
