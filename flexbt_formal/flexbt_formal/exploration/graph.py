# SPDX-License-Identifier: BSD-3-Clause
"""The configurations that were reached, and the steps between them: paths, deadlocks, traps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from itertools import combinations

from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirements import Possible

from .model import LabelEffect, Move

_Ways = frozenset[LabelEffect | None]
"""Ways to make a step without a stop: the effects of the servers' answers, and None for a step without one."""
_STOPS: _Ways = frozenset()
_ANY: _Ways = frozenset((None,))
_Before = dict[bytes, list[tuple[bytes, _Ways]]]
"""Steps, by the configuration to which they lead."""


class ConfigurationGraph:
    """A graph of configurations, by key, that starts with ``first``.

    ``unfinished`` are those that were not fully expanded, ``broken`` those after a violation: the successors of both
    are unknown.
    """

    def __init__(self, first: bytes) -> None:
        self.ended: dict[bytes, str | None] = {}
        self.over: set[bytes] = set()
        """Configurations whose end is decided."""
        self.waiting: set[bytes] = set()
        self.asking: set[bytes] = set()
        """Configurations in which a person is asked and can also do something else."""
        self.unfinished: set[bytes] = set()
        self.broken: set[bytes] = set()
        self.depth = 0
        self._first = first
        self._from: dict[bytes, tuple[bytes, Move] | None] = {first: None}
        self._depths = {first: 0}
        self._after: dict[bytes, dict[bytes, _Ways]] = {}
        self._servers: set[str] = set()
        self._leading: dict[str, set[bytes]] = {}
        self._turns: dict[bytes, dict[bytes, Move]] = {}

    def __len__(self) -> int:
        return len(self._from)

    def add(self, key: bytes, source: bytes, move: Move, answer: LabelEffect | None = None) -> bool:
        """Add a step; return whether its target is new. ``answer`` is the answer of a server that causes it, if any."""
        after = self._after.setdefault(source, {})
        ways = after.setdefault(key, _STOPS)
        if not move.label.is_stop and answer not in ways:
            after[key] = ways | {answer}
        if answer is not None and answer.server:
            self._servers.add(answer.server)
        if key in self._from:
            return False
        self._from[key] = (source, move)
        self._depths[key] = self._depths[source] + 1
        self.depth = max(self.depth, self._depths[key])
        return True

    def way_to(self, key: bytes) -> tuple[Move, ...]:
        """Return the shortest path from the start."""
        moves: list[Move] = []
        come = self._from[key]
        while come is not None:
            moves.append(come[1])
            come = self._from[come[0]]
        return tuple(reversed(moves))

    def problems(
        self, position: Callable[[tuple[Move, ...]], str], faults: int
    ) -> Iterator[tuple[Violation, tuple[Move, ...]]]:
        """Yield deadlocks, and configurations from which the system can no longer end although it could before.

        Also check this after up to ``faults`` servers fail permanently, so that actions that need them never succeed.
        An uncaused event does not count as a way to end then; a question to a person does.
        """
        stuck = {key for key in self._from if self._is_stuck(key)}
        if stuck:
            way, where = self._shortest(stuck, position)
            text = f'stuck: {where}; nothing that can happen changes that, and nobody is asked'
            yield Violation(Property.NO_DEADLOCK, where, text), way
        before = self._before()
        can_end = self._can_end(before, frozenset())
        if self._first not in can_end:
            return
        caught = can_end.symmetric_difference(self._from) - stuck
        if caught:
            way, where = self._shortest(caught, position)
            text = f'from here it can never end by itself, whatever happens: {where}; only a stop ends it'
            yield Violation(Property.CAN_END, where, text), way
        told: list[set[str]] = []
        can_end = self._can_end(before, frozenset(), is_caused=True)
        for number in range(1, faults + 1):
            for gone in combinations(sorted(self._servers), number):
                if any(known <= set(gone) for known in told):
                    continue
                caught = can_end - self._can_end(before, frozenset(gone), is_caused=True)
                if caught:
                    told.append(set(gone))
                    way, where = self._shortest(caught, position)
                    whose = f'{" and that of ".join(gone)} {"is" if number == 1 else "are"} gone for good'
                    text = f'when the server of {whose}, it continues forever from here: {where}; only a stop ends it'
                    yield Violation(Property.CAN_END, ', '.join(gone), text), way

    def add_turn(self, source: bytes, key: bytes, move: Move) -> None:
        """Add a step in which no time passes and no external event occurs."""
        self._turns.setdefault(source, {}).setdefault(key, move)

    def round(self) -> tuple[Move, ...] | None:
        """Return the shortest path to a cycle of such steps, and once along it; None without a cycle."""
        # Repeatedly remove configurations without a predecessor: they are on no cycle.
        leading = Counter(key for keys in self._turns.values() for key in keys)
        ahead = [key for key in self._turns if not leading[key]]
        while ahead:
            for key in self._turns.get(ahead.pop(), ()):
                leading[key] -= 1
                if not leading[key]:
                    ahead.append(key)
        rounds = ((key, self._way_back(key)) for key in self._turns if leading[key])
        return next(((*self.way_to(key), *moves) for key, moves in rounds if moves), None)

    def _way_back(self, first: bytes) -> list[Move]:
        """Return the shortest path from a configuration back to itself; empty if none exists."""
        before: dict[bytes, tuple[bytes, Move]] = {}
        ahead = deque([first])
        while ahead and first not in before:
            source = ahead.popleft()
            for key, move in self._turns.get(source, {}).items():
                if key not in before:
                    before[key] = (source, move)
                    ahead.append(key)
        moves: list[Move] = []
        key = first
        while first in before and (not moves or key != first):
            key, move = before[key]
            moves.append(move)
        return moves[::-1]

    def comes_about(self, event: str, source: bytes) -> None:
        """Record that a step from ``source``, other than a stop, causes an event that must stay possible."""
        self._leading.setdefault(event, set()).add(source)

    def lost(
        self, possible: Iterable[Possible], position: Callable[[tuple[Move, ...]], str]
    ) -> Iterator[tuple[Violation, tuple[Move, ...]]]:
        """Yield configurations where a required event became impossible without a stop, and where even a stop does not
        end the system."""
        before = self._before()
        going_on = self._going_on()
        for one in possible:
            ways = self._leading.get(one.event, set()) | self.unfinished | self.broken
            lost = going_on - _sources(ways, before, lambda way: True)
            if lost:
                way, where = self._shortest(lost, position)
                text = f'from here {one.event} is not possible any more: {where}; required is: {one}'
                yield Violation(Property.POSSIBLE, where, text), way
        if any(not ways for steps in self._after.values() for ways in steps.values()):
            ends = {key for key, ended in self.ended.items() if ended is not None or self._open(key)}
            caught = self._from.keys() - _sources(ends, self._before(is_stopped=True), lambda way: True)
            if caught:
                way, where = self._shortest(caught, position)
                text = f'from here not even a stop ends it, whatever happens: {where}'
                yield Violation(Property.RECOVERY, where, text), way

    def _going_on(self) -> set[bytes]:
        """Return the configurations that are reachable without a stop, and whose end is not decided."""
        found, ahead = {self._first}, [self._first]
        while ahead:
            for key, ways in self._after.get(ahead.pop(), {}).items():
                if ways and key not in found:
                    found.add(key)
                    ahead.append(key)
        return found - self.over

    def unlimited(self) -> list[str]:
        """Return the servers that can prevent the end by never answering a request: no time limit applies to
        them."""
        before = self._before()
        can_end = self._can_end(before, frozenset())
        return [one for one in sorted(self._servers) if can_end - self._can_end(before, frozenset(), silent=one)]

    def can_end_by_itself(self) -> bool:
        """Return whether an end is, or may be, reachable from the start without a stop."""
        return self._first in self._can_end(self._before(), frozenset())

    def _shortest(self, keys: set[bytes], position: Callable[[tuple[Move, ...]], str]) -> tuple[tuple[Move, ...], str]:
        """Return the shortest path to one of ``keys``, and its position in words. Among equally short ones, return the
        first found."""
        way = self.way_to(next(key for key in self._from if key in keys))
        return way, position(way) if way else 'the beginning'

    def _open(self, key: bytes) -> bool:
        """Return whether the successors are unknown."""
        return key in self.unfinished or key in self.broken

    def _is_stuck(self, key: bytes) -> bool:
        if self.ended[key] is not None or key in self.waiting or key in self._turns or self._open(key):
            return False
        return all(after == key or not ways for after, ways in self._after.get(key, {}).items())

    def _before(self, *, is_stopped: bool = False) -> _Before:
        """Return the steps without a stop, by their targets; with ``is_stopped``, all steps."""
        before: _Before = {}
        for source, steps in self._after.items():
            for key, ways in steps.items():
                if (ways or is_stopped) and key != source:
                    before.setdefault(key, []).append((source, ways or _ANY))
        return before

    def _can_end(
        self, before: _Before, gone: frozenset[str], silent: str | None = None, *, is_caused: bool = False
    ) -> set[bytes]:
        """Return the configurations from which an end is, or may be, reachable without a stop.

        Actions that need a server in ``gone`` never succeed, and the server ``silent`` never answers. With
        ``is_caused``, exclude steps that need an outside cause, and count a question to a person as a possible end.
        """
        ends = {key for key, ended in self.ended.items() if ended is not None or self._open(key)}

        def is_way(way: LabelEffect | None) -> bool:
            if way is None:
                return True
            if is_caused and not way.is_caused:
                return False
            return way.server != silent and not (way.is_success and way.server in gone)

        return _sources(ends | self.asking if is_caused else ends, before, is_way)


def _sources(targets: set[bytes], before: _Before, is_way: Callable[[LabelEffect | None], bool]) -> set[bytes]:
    """Return ``targets`` and the configurations that reach them by steps that ``is_way`` accepts."""
    found, ahead = set(targets), list(targets)
    while ahead:
        for source, ways in before.get(ahead.pop(), ()):
            if source not in found and any(map(is_way, ways)):
                found.add(source)
                ahead.append(source)
    return found
