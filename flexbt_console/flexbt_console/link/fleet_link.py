# SPDX-License-Identifier: BSD-3-Clause
"""The robots of the domain, each with an operator link of its own, on one node."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Final

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_console.mirror import Fleet, Mirror

from .operator_link import OperatorLink

LOOK_SECONDS: Final = 0.5
LOOK_TOLERANCE: Final = 0.1
"""From one look for robots that have come to the next, s: nobody waits for them."""

_STATUS_TYPE: Final = 'flexbt_msgs/msg/ExecutiveStatus'


class FleetLink:
    """Joins robots by their namespaces, each with a link of its own; ``fleet`` has their mirrors, made by
    ``make_mirror``.

    With ``only`` they are these; else every robot whose executive is there, and that in the node's own namespace
    (``own``) if it has one: who gives none need not have a robot there. ``operator`` is as for :class:`OperatorLink`:
    who sits here is present at all of them; ``scan_period`` as for :class:`SurroundingsLink`. Map and trees come from
    the robots that are open.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        fleet: Fleet,
        make_mirror: Callable[[], Mirror],
        operator: str | None = '',
        scan_period: float = 0.0,
        only: Sequence[str] = (),
    ) -> None:
        self.fleet = fleet
        self.own = only[0] if only else runtime.node.get_namespace()
        self._runtime = runtime
        self._make_mirror = make_mirror
        self._operator = operator
        self._scan_period = scan_period
        self._joined: dict[str, tuple[Mirror, OperatorLink]] = {}
        self._selected = ''
        for name in only or [self.own]:
            runtime.call(functools.partial(self._join if name == '/' and not only else self._list, name))
        if not only:
            runtime.call(self._look)
            runtime.call(lambda: runtime.repeat_near(LOOK_SECONDS, LOOK_TOLERANCE, self._look))

    def robot(self, name: str) -> tuple[Mirror, OperatorLink]:
        """The mirror and the link of a robot. Raises KeyError when it is not known."""
        return self._joined[name]

    def open(self, name: str) -> None:
        """Have map, trees and scan of a robot come until :meth:`close` was called as often. Raises as :meth:`robot`.

        Neither of both on the executor thread.
        """
        self._joined[name][1].open_surroundings(self._scan_period)

    def close(self, name: str) -> None:
        """See :meth:`open`."""
        self._joined[name][1].close_surroundings()

    def select(self, name: str) -> tuple[Mirror, OperatorLink]:
        """Have one robot open, instead of the one before, and give it. Raises as :meth:`robot`."""
        self.open(name)
        if self._selected:
            self.close(self._selected)
        self._selected = name
        return self._joined[name]

    def _look(self) -> None:
        node = self._runtime.node
        ending = f'/{names.EXECUTIVE_STATUS}'
        for topic, types in node.get_topic_names_and_types():
            name = topic.removesuffix(ending) or '/'
            is_status = topic.endswith(ending) and _STATUS_TYPE in types
            if is_status and name not in self.fleet.names and node.count_publishers(topic) > 0:
                self._list(name)

    def _join(self, name: str) -> Mirror:
        mirror = self._make_mirror()
        self._joined[name] = mirror, OperatorLink(self._runtime, mirror, self._operator, name)
        return mirror

    def _list(self, name: str) -> None:
        self.fleet.add(name, self._joined[name][0] if name in self._joined else self._join(name))
