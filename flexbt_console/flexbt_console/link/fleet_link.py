# SPDX-License-Identifier: BSD-3-Clause
"""The robots of the domain, each with an operator link of its own, on one node."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from rclpy.clock import Clock, ClockType

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_console.mirror import Fleet, Mirror

from .operator_link import OperatorLink
from .surroundings_link import SurroundingsLink

LOOK_SECONDS: Final = 1.0
"""From one look for robots that have come to the next: nobody waits for them."""

_STATUS_TYPE: Final = 'flexbt_msgs/msg/ExecutiveStatus'


class FleetLink:
    """Joins every robot whose executive is there; ``fleet`` has their mirrors, made by ``make_mirror``.

    ``operator`` is as for :class:`OperatorLink`: who sits here is present at all of them; ``scan_period`` as for
    :class:`SurroundingsLink`. Map and trees come from the
    robot that was selected last, at first the one in the node's own namespace. That is in the fleet when its executive
    is there, or when the node has a namespace: who gives none need not have a robot there.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        fleet: Fleet,
        make_mirror: Callable[[], Mirror],
        operator: str | None = '',
        scan_period: float = 0.0,
    ) -> None:
        self.fleet = fleet
        self.own = runtime.node.get_namespace()
        self._runtime = runtime
        self._make_mirror = make_mirror
        self._operator = operator
        self._scan_period = scan_period
        self._joined: dict[str, tuple[Mirror, OperatorLink]] = {}
        self._surroundings: SurroundingsLink | None = None
        runtime.call(lambda: self._join(self.own) if self.own == '/' else self._list(self.own))
        runtime.call(self._look)
        runtime.call(
            lambda: runtime.node.create_timer(LOOK_SECONDS, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        )

    def link(self, name: str) -> OperatorLink:
        """The link of a robot. Raises KeyError when it is not known."""
        return self._joined[name][1]

    def select(self, name: str) -> tuple[Mirror, OperatorLink]:
        """Have map and trees come from a robot, and give its mirror and its link. Raises KeyError as :meth:`link`."""
        mirror, link = self._joined[name]
        if self._surroundings is not None:
            self._surroundings.close()
        self._surroundings = SurroundingsLink(self._runtime, mirror, name, self._scan_period)
        return mirror, link

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
