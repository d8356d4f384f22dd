# SPDX-License-Identifier: BSD-3-Clause
"""The network of a world: hosts, and links between them that delay, lose and hold back messages.

Processes of one host reach each other at once. What is reliable is sent again until it arrives; what is not is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from .scheduler import SCHEDULER, SECOND, Process

ROBOT: Final = 'robot'
OPERATOR: Final = 'operator'

_REPEAT: Final = SECOND // 10
"""Time after which a reliable message that was lost is sent again, ns."""

_REUNION: Final = SECOND // 20
"""Longest time from the end of a cut until messages that waited arrive, ns."""


@dataclass(slots=True)
class Link:
    """The link between two hosts, in both directions.

    ``delay``: mean of the delay, s; delays are distributed exponentially. ``loss``: probability that a packet is lost.
    ``rate``: messages that pass per second in a direction; 0 for any number.
    """

    delay: float = 0.0
    loss: float = 0.0
    rate: float = 0.0

    def __setattr__(self, name: str, value: float) -> None:
        if name == 'loss' and not 0.0 <= value < 1.0:
            raise ValueError(f'loss {value:g}: expected a probability from 0 to below 1; cut() lets nothing pass')
        if not 0.0 <= value < math.inf:
            raise ValueError(f'{name} {value:g}: expected a number from 0')
        object.__setattr__(self, name, value)


class Network:
    """The hosts of a world and the links between them; a value for ``DOMAIN.network``.

    A process whose name begins with ``operator`` is on the host of the operator, the test (``world``) on none, all
    others on the robot. ``hosts`` has further processes, by name.
    """

    def __init__(self) -> None:
        self.hosts: dict[str, str] = {}
        self._links: dict[frozenset[str], Link] = {}
        self._cut_until: dict[frozenset[str], int] = {}
        self._alone_until: dict[str, int] = {}
        self._passed: dict[tuple[str, str], int] = {}

    def host(self, process: Process) -> str:
        """Return the host of a process; '' for the test, which every message reaches at once."""
        if process.name == 'world':
            return ''
        return self.hosts.get(process.name) or (OPERATOR if process.name.startswith(OPERATOR) else ROBOT)

    def link(self, one: str = ROBOT, other: str = OPERATOR) -> Link:
        """Return the link between two hosts, to be changed at any time. Raises ValueError if a host is unknown."""
        return self._links.setdefault(self._ends(one, other), Link())

    def cut(self, seconds: float, one: str = ROBOT, other: str = OPERATOR) -> None:
        """Let nothing pass between two hosts for this time, s. Raises ValueError if a host is unknown."""
        ends = self._ends(one, other)
        self._cut_until[ends] = max(SCHEDULER.after(seconds), self._cut_until.get(ends, 0))

    def _ends(self, *hosts: str) -> frozenset[str]:
        known = {ROBOT, OPERATOR, *self.hosts.values()}
        for host in hosts:
            if host not in known:
                there = ', '.join(sorted(known))
                raise ValueError(f'there is no host {host!r}; there are {there}. First give it processes in hosts')
        return frozenset(hosts)

    def cut_off(self, name: str, seconds: float) -> None:
        """Let nothing pass between the processes of a name and others, except the test, for this time, s."""
        self._alone_until[name] = max(SCHEDULER.after(seconds), self._alone_until.get(name, 0))

    @property
    def is_cut(self) -> bool:
        """True if a link, or a process, is cut off."""
        return any(until > SCHEDULER.now for until in (*self._cut_until.values(), *self._alone_until.values()))

    @property
    def is_good(self) -> bool:
        """True if no link is cut, and none delays or loses anything."""
        return not self.is_cut and all(link == Link() for link in self._links.values())

    def __call__(self, source: Process, target: Process, is_reliable: bool) -> int | None:
        """Return the delay of a message, ns; None if it is lost."""
        one, other = self.host(source), self.host(target)
        ends = frozenset((one, other))
        link = self._links.get(ends)
        delay = 0
        until = self._cut_until.get(ends, 0)
        if self._alone_until and one and other:
            until = max(until, *(self._alone_until.get(process.name, 0) for process in (source, target)))
        if until > SCHEDULER.now:
            if not is_reliable:
                return None
            delay = until - SCHEDULER.now + SCHEDULER.random.randrange(_REUNION)
        if link is None:
            return delay
        while link.loss and SCHEDULER.random.random() < link.loss:
            if not is_reliable:
                return None
            delay += _REPEAT
        if link.rate:
            begin = max(SCHEDULER.now, self._passed.get((one, other), 0))
            self._passed[one, other] = begin + int(SECOND / link.rate)
            delay += begin - SCHEDULER.now
        if link.delay:
            delay += int(SCHEDULER.random.expovariate(1.0 / link.delay) * SECOND)
        return delay
