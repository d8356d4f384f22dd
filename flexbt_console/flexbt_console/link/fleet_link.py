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

    ``operator`` is as for :class:`OperatorLink`: who sits here is present at all of them. Map and trees come from the
    robot that was selected last, at first the one in the node's own namespace.
    """

    def __init__(
        self, runtime: NodeRuntime, fleet: Fleet, make_mirror: Callable[[], Mirror], operator: str | None = ''
    ) -> None:
        self.fleet = fleet
        self.own = runtime.node.get_namespace()
        self._runtime = runtime
        self._make_mirror = make_mirror
        self._operator = operator
        self._links: dict[str, OperatorLink] = {}
        self._surroundings: SurroundingsLink | None = None
        runtime.call(lambda: self._join(self.own))
        runtime.call(self._look)
        runtime.call(
            lambda: runtime.node.create_timer(LOOK_SECONDS, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        )

    def link(self, name: str) -> OperatorLink:
        """The link of a robot. Raises KeyError when it is not known."""
        return self._links[name]

    def select(self, name: str) -> tuple[Mirror, OperatorLink]:
        """Have map and trees come from a robot, and give its mirror and its link. Raises KeyError as :meth:`link`."""
        mirror, link = self.fleet.mirror(name), self.link(name)
        if self._surroundings is not None:
            self._surroundings.close()
        self._surroundings = SurroundingsLink(self._runtime, mirror, name)
        return mirror, link

    def _look(self) -> None:
        node = self._runtime.node
        ending = f'/{names.EXECUTIVE_STATUS}'
        for topic, types in node.get_topic_names_and_types():
            name = topic.removesuffix(ending) or '/'
            is_status = topic.endswith(ending) and _STATUS_TYPE in types
            if is_status and name not in self._links and node.count_publishers(topic) > 0:
                self._join(name)

    def _join(self, name: str) -> None:
        mirror = self._make_mirror()
        self._links[name] = OperatorLink(self._runtime, mirror, self._operator, name)
        self.fleet.add(name, mirror)
