# SPDX-License-Identifier: BSD-3-Clause
"""Several robots, one mirror each, and which of them needs its operator first."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from .freshness import LinkState
from .history import HISTORY_BYTES, History
from .lanes import Lanes
from .mirror import Mirror
from .records import Decision, ExecutiveState, IncidentReport, Peer, TreeHold
from .view import View

PAST_BYTES: Final = 256_000_000
"""Bytes of the pasts of all robots, at most; each has the same share."""


class Urgency(IntEnum):
    """The needs of a robot, the most urgent first. FAILED: its run failed, or was interrupted. UNREACHABLE: it is not
    heard any more, or was never; LATE: a heartbeat was missed. DEGRADED: a node that it depends on is not there, late
    or not ready, a tree is held by a breakpoint or a pause, or the stop guard holds the robot. INCIDENT: its black box
    has written one; that is over, so it does not count for the robot as a whole."""

    ALARM = 0
    DECISION = 1
    FAILED = 2
    UNREACHABLE = 3
    LATE = 4
    DEGRADED = 5
    RUNS = 6
    IDLE = 7
    INCIDENT = 8


@dataclass(frozen=True, slots=True)
class RobotOverview:
    """One robot among several: its namespace, its picture, what it needs, and for how many seconds already.

    The seconds are 0 if no operator has to act.
    """

    name: str
    view: View
    urgency: Urgency
    seconds: float

    @property
    def needs_operator(self) -> bool:
        """Return whether an operator has to act; False for a robot that is not heard."""
        return self.urgency < Urgency.UNREACHABLE

    @property
    def is_unreachable(self) -> bool:
        """Return whether the robot is not heard: its needs are unknown then."""
        return self.urgency is Urgency.UNREACHABLE


@dataclass(frozen=True, slots=True)
class Need:
    """One need of a robot, for how many seconds already (0 if that is not known), and what it is about.

    Together with the name of the robot and the urgency, ``key`` distinguishes it from all other needs, before and
    after.
    """

    urgency: Urgency
    key: str = ''
    seconds: float = 0.0
    about: Decision | Peer | TreeHold | IncidentReport | None = None


def needs_of(view: View) -> list[Need]:
    """Return the needs of a robot, the most urgent first. What a robot needs that is not live is not known, except that
    it moved, that its stop guard holds it, and its incidents."""
    snapshot = view.snapshot
    told = [Need(Urgency.DEGRADED, 'stop guard')] if view.guard.told else []
    told += [Need(Urgency.INCIDENT, one.name, about=one) for one in view.incidents]
    if snapshot is None or view.link is LinkState.LOST:
        return [Need(Urgency.UNREACHABLE, seconds=view.age or 0.0), *told]
    run = f'{snapshot.executive_id} {snapshot.run_id}'
    moves = [Need(Urgency.ALARM, run)] if view.unwanted_motion is not None else []
    if not view.live:
        return [*moves, Need(Urgency.LATE, seconds=view.age or 0.0), *told]
    decisions = [
        Need(Urgency.DECISION, f'{snapshot.executive_id} {one.id}', max(0.0, snapshot.stamp - one.since), one)
        for one in snapshot.decisions
    ]
    has_failed = not view.running and snapshot.outcome in ('error', 'failed')
    failed = [Need(Urgency.FAILED, run)] if has_failed or snapshot.state is ExecutiveState.INTERRUPTED else []
    missed = [Need(Urgency.DEGRADED, f'node {one.name}', about=one) for one in snapshot.missed_peers]
    held = [Need(Urgency.DEGRADED, f'tree {one.run_id} {one.since}', about=one) for one in snapshot.tree_holds]
    return [*moves, *decisions, *failed, *missed, *held, *told]


def overview_of(name: str, view: View) -> RobotOverview:
    """Return the most urgent need of a robot, from its view."""
    needs = [one for one in needs_of(view) if one.urgency is not Urgency.INCIDENT]
    first = next(iter(needs), Need(Urgency.RUNS if view.running else Urgency.IDLE))
    return RobotOverview(name, view, first.urgency, first.seconds)


class Fleet:
    """The mirrors of several robots by their namespaces. Thread-safe; listeners are called without a lock."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._mirrors: dict[str, Mirror] = {}
        self._pasts: dict[str, tuple[Mirror, History, Lanes]] = {}
        self._listeners: list[Callable[[], None]] = []
        self.left_out = 0
        """Robots that were found and are not among these; see :meth:`note_left_out`."""
        self.is_growing = False
        """True if robots are still to be joined."""

    def add(self, name: str, mirror: Mirror) -> None:
        """Add a robot. It stays until :meth:`remove`, even if it is silent, since the operator has to see that."""
        with self._lock:
            self._mirrors[name] = mirror
        mirror.add_listener(lambda change: self._tell())
        self._tell()

    def remove(self, name: str) -> None:
        """Forget a robot. Harmless when it is not known."""
        with self._lock:
            self._mirrors.pop(name, None)
            self._pasts.pop(name, None)
        self._tell()

    def past(self, name: str, mirror: Mirror) -> tuple[History, Lanes]:
        """Return the past of a robot, and the lanes of its time line, which begin when this is called first with its
        mirror."""
        with self._lock:
            known = self._pasts.get(name)
            if known is None or known[0] is not mirror:
                known = self._pasts[name] = mirror, History(mirror), Lanes(mirror)
                for _, history, _ in self._pasts.values():
                    history.limit(min(HISTORY_BYTES, PAST_BYTES // len(self._pasts)))
            return known[1:]

    def note_left_out(self, count: int, *, is_growing: bool = False) -> None:
        """Note how many robots were found but not added: there are too many, or the fleet is still growing."""
        if (count, is_growing) != (self.left_out, self.is_growing):
            self.left_out, self.is_growing = count, is_growing
            self._tell()

    def add_listener(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` after each change of any robot, on the thread that brought it."""
        with self._lock:
            self._listeners.append(listener)

    @property
    def names(self) -> tuple[str, ...]:
        """The namespaces of the robots, sorted."""
        with self._lock:
            return tuple(sorted(self._mirrors))

    def overview(self) -> list[RobotOverview]:
        """Return the robots, the most urgent first; of the same urgency, the one that has waited longest."""
        with self._lock:
            mirrors = sorted(self._mirrors.items())
        robots = [overview_of(name, mirror.view()) for name, mirror in mirrors]
        return sorted(robots, key=lambda one: (one.urgency, -one.seconds))

    def _tell(self) -> None:
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener()
