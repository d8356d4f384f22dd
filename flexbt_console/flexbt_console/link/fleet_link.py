# SPDX-License-Identifier: BSD-3-Clause
"""The robots of the domain, each with its own operator link, on one node.

Any participant in the domain can publish statuses under any name. So the link limits the cost of robots:

- It joins at most :data:`MOST_ROBOTS`, in addition to the requested ones, and a few at a time.
- Each process gets a fair share of these, so that one process with a thousand names cannot exclude others.
- It receives only the status of a robot that is not open.
- It forgets a robot that is gone.
"""

from __future__ import annotations

import functools
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_full_topic_name import validate_full_topic_name

from flexbt_common import names
from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, guid_prefix_of
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror

from .costmap_link import CostmapLinks
from .operator_link import ExecutiveLink

MOST_ROBOTS: Final = 64
"""Maximum number of joined robots, without those that were named or opened."""

JOINED_AT_ONCE: Final = 4
"""Maximum number of robots joined in one turn of the executor, which delays an operator's command."""

LOOK_SECONDS: Final = 0.5
LOOK_TOLERANCE: Final = 0.1
"""Time between two searches for new robots, and the tolerance of that time, s."""

LOOK_SHARE: Final = 0.05
"""Maximum share of the executor's time for searches: with more topics, searches are rarer."""

NEXT_SECONDS: Final = 0.1
"""Time between two searches while found robots are still to be joined, s."""

FORGET_SECONDS: Final = 600.0
"""Time after which a robot that is gone is forgotten, s, unless it was named or opened."""

_STATUS_TYPE: Final = 'flexbt_msgs/msg/ExecutiveStatus'
_ENDING: Final = f'/{names.EXECUTIVE_STATUS}'


class FleetLink:
    """The links to the robots, by namespace. ``fleet`` contains their mirrors, which ``make_mirror`` makes.

    With ``only``, these are the robots of those namespaces. Otherwise they are the robot in the node's own namespace
    (``own``) and every robot whose executive is found, up to :data:`MOST_ROBOTS`. If the node's namespace is ``/``, the
    fleet lists a robot there only when its executive is found.

    ``operator`` is as for :class:`ExecutiveLink`: the user is present at all robots. ``scan_period`` is as for
    :class:`SurroundingsLink`. Map, trees and scan are received from open robots; machine, behaviors and log from robots
    that were opened at least once.
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
        self.costmaps = CostmapLinks(runtime)
        self._make_mirror = make_mirror
        self._operator = operator
        self._scan_period = scan_period
        self._joined: dict[str, ExecutiveLink] = {}
        self._kept = {self.own, *only}
        """Robots that are never forgotten: they were named, or opened."""
        self._keeping = threading.Lock()
        self._owners: dict[str, bytes] = {}
        """GUID prefix of the participant that publishes the statuses of a robot, by the name of the robot."""
        self._gone_since: dict[str, float] = {}
        self._selected = ''
        self._present: dict[tuple[str, str], tuple[int, PresenceToken]] = {}
        """Operators who have a robot open, by robot and operator: how often, and what announces them."""
        for name in only or [self.own]:
            runtime.call(functools.partial(self._join if name == '/' and not only else self._list, name))
        if not only:
            runtime.call(self._look)

    def robot(self, name: str) -> tuple[Mirror, ExecutiveLink]:
        """Return the mirror and the link of a robot. Raises KeyError if the robot is not known."""
        link = self._joined[name]
        return link.mirror, link

    def open(self, name: str, operator: str = '') -> None:
        """Receive map, trees and scan of a robot until each call of this has been matched by one of :meth:`close`.

        An ``operator`` other than that of the links is present at the robot meanwhile.

        Raises KeyError if the robot is not known. Do not call this on the executor thread.
        """
        with self._keeping:
            link = self._joined[name]
            self._kept.add(name)
        self._runtime.call(link.hear_all)
        link.open_surroundings(self._scan_period)
        if operator and operator != self._operator:
            self._runtime.post(functools.partial(self._announce, name, operator, 1))

    def close(self, name: str, operator: str = '') -> None:
        """See :meth:`open`."""
        if operator and operator != self._operator:
            self._runtime.post(functools.partial(self._announce, name, operator, -1))
        self._joined[name].close_surroundings()

    def _announce(self, name: str, operator: str, more: int) -> None:
        count, token = self._present.pop((name, operator), (0, None))
        token = token or PresenceToken(self._runtime, operator, name)
        if count + more:
            self._present[name, operator] = count + more, token
        else:
            token.close()

    def select(self, name: str) -> tuple[Mirror, ExecutiveLink]:
        """Open a robot, close the previously selected one, and return mirror and link as :meth:`robot` does."""
        self.open(name)
        if self._selected:
            self.close(self._selected)
        self._selected = name
        return self.robot(name)

    def _look(self) -> None:
        began, pause = self._runtime.steady.now(), LOOK_SECONDS
        try:
            pause = NEXT_SECONDS if self._join_found() else LOOK_SECONDS
        finally:  # whatever one robot does, the others are looked for
            now = self._runtime.steady.now()
            self._runtime.call_near(max(began + pause, now + (now - began) / LOOK_SHARE), LOOK_TOLERANCE, self._look)

    def _join_found(self) -> bool:
        """Join some of the robots that are there; return whether others are still to be joined."""
        found = self._found()
        self._note_gone(found)
        listed = {*self.fleet.names}
        waiting = [name for name in found if name not in listed]
        shares = Counter(self._owners[name] for name in listed if name in found and name not in self._kept)
        joined = 0
        while waiting and joined < JOINED_AT_ONCE:
            name = min(waiting, key=lambda one: (one not in self._kept, shares[self._owners[one]], one))
            if name not in self._kept and not self._has_room(shares, self._owners[name]):
                break
            waiting.remove(name)
            self._list(name)
            shares[self._owners[name]] += 1
            joined += 1
        is_growing = bool(waiting) and joined == JOINED_AT_ONCE
        self.fleet.note_left_out(len(waiting), is_growing=is_growing)
        return is_growing

    def _found(self) -> set[str]:
        """Return the names of the robots whose status has a publisher, and update ``_owners``."""
        node = self._runtime.node
        owners = {}
        for topic, types in node.get_topic_names_and_types():
            name = topic.removesuffix(_ENDING) or '/'
            if not topic.endswith(_ENDING) or _STATUS_TYPE not in types or not _is_possible(name):
                continue
            if node.count_publishers(topic) == 0:
                continue
            owner = None if name in self._joined else self._owners.get(name)
            if owner is None:  # look joined robots up again: their publisher may have changed
                endpoints = node.get_publishers_info_by_topic(topic)
                owner = guid_prefix_of(bytes(endpoints[0].endpoint_gid)) if endpoints else UNKNOWN_WRITER
            owners[name] = owner
        self._owners = owners
        return {*owners}

    def _has_room(self, shares: Counter[bytes], owner: bytes) -> bool:
        """Return whether one more robot of a participant may be joined. If there are too many, make room: leave a robot
        that is gone, or else one of the participant that has the most."""
        droppable = [name for name in self.fleet.names if name not in self._kept]
        if len(droppable) < MOST_ROBOTS:
            return True
        if self._gone_since and self._leave(min(self._gone_since, key=self._gone_since.__getitem__)):
            return True
        most, count = shares.most_common(1)[0]
        if count <= shares[owner] + 1:
            return False
        name = next((one for one in reversed(droppable) if self._owners.get(one) == most), '')
        if not name or not self._leave(name):
            return False
        shares[most] -= 1
        return True

    def _note_gone(self, found: set[str]) -> None:
        """Forget robots that have been gone for FORGET_SECONDS, or are gone and have never sent a status."""
        now = self._runtime.steady.now()
        gone = {name for name in self.fleet.names if name not in found and name not in self._kept}
        self._gone_since = {name: self._gone_since.get(name, now) for name in gone}
        for name, since in list(self._gone_since.items()):
            if now - since >= FORGET_SECONDS or self._joined[name].mirror.view().snapshot is None:
                self._leave(name)

    def _leave(self, name: str) -> bool:
        """Forget a robot, unless it was opened meanwhile."""
        with self._keeping:
            if name in self._kept:
                return False
            left = self._joined.pop(name)
        self._gone_since.pop(name, None)
        self.fleet.remove(name)
        left.close()
        return True

    def _join(self, name: str) -> ExecutiveLink:
        only_status = name not in self._kept
        link = ExecutiveLink(self._runtime, self._make_mirror(), self._operator, name, only_status=only_status)
        self._joined[name] = link
        return link

    def _list(self, name: str) -> None:
        self.fleet.add(name, (self._joined.get(name) or self._join(name)).mirror)


def _is_possible(name: str) -> bool:
    """Return whether ROS allows the topics of a robot in this namespace: a program of another kind may publish a status
    under any name, and one that is too long has room for some topics only."""
    try:
        return bool(validate_full_topic_name(names.of_robot(name, names.INCIDENTS)))  # the longest one
    except InvalidTopicNameException:
        return False
