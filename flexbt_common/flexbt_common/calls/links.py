# SPDX-License-Identifier: BSD-3-Clause
"""Connections of a node to servers, shared by all who call them: discovery is paid once for each server."""

from __future__ import annotations

from typing import Any, ClassVar, Generic, Protocol, TypeVar

from flexbt_common.runtime import NodeRuntime


class ServerLink(Protocol):
    """The connection to one server; made on the executor thread."""

    def __init__(self, runtime: NodeRuntime, server_type: Any, name: str) -> None: ...


LinkT = TypeVar('LinkT', bound=ServerLink)


class Links(Generic[LinkT]):
    """The links of one node, one for each type and name. From any thread.

    They are there until the executor of the runtime has ended, which destroys what is left on its node: until then a
    call that is on its way goes on looking for its server.
    """

    link_class: ClassVar[type[Any]]

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._links: dict[tuple[Any, str], LinkT] = {}

    def link(self, server_type: Any, name: str) -> LinkT:
        """The link to the server ``name``; made now if there is none yet."""
        known = self._links.get((server_type, name))
        return known if known is not None else self._runtime.call(lambda: self._link(server_type, name))

    def _link(self, server_type: Any, name: str) -> LinkT:
        key = server_type, name
        if key not in self._links:
            self._links[key] = self.link_class(self._runtime, server_type, name)
        return self._links[key]
