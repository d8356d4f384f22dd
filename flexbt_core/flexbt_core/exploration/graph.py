# SPDX-License-Identifier: BSD-3-Clause
"""The configurations that were reached, and the steps between them: ways, dead ends, traps."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from .model import Move, Property, Violation


class Graph:
    """Configurations by their keys.

    ``unfinished`` are those whose steps were not made, ``broken`` those after something was wrong: nothing is known of
    what follows.
    """

    def __init__(self) -> None:
        self.ended: dict[bytes, str | None] = {}
        self.waiting: set[bytes] = set()
        self.unfinished: set[bytes] = set()
        self.broken: set[bytes] = set()
        self.depth = 0
        self._first: bytes | None = None
        self._from: dict[bytes, tuple[bytes, Move] | None] = {}
        self._depths: dict[bytes, int] = {}
        self._after: dict[bytes, dict[bytes, Move]] = {}

    def __len__(self) -> int:
        return len(self._from)

    def add(self, key: bytes, source: bytes | None, move: Move | None) -> bool:
        """Add a step, and what it leads to; whether that is new."""
        if source is not None and move is not None:
            before = self._after.setdefault(source, {}).get(key)
            if before is None or (before.label.is_stop and not move.label.is_stop):
                self._after[source][key] = move
        if key in self._from:
            return False
        if source is None or move is None:
            self._first = key
            self._from[key] = None
            self._depths[key] = 0
        else:
            self._from[key] = (source, move)
            self._depths[key] = self._depths[source] + 1
            self.depth = max(self.depth, self._depths[key])
        return True

    def way_to(self, key: bytes) -> tuple[Move, ...]:
        """The shortest way from the beginning."""
        moves: list[Move] = []
        come = self._from[key]
        while come is not None:
            moves.append(come[1])
            come = self._from[come[0]]
        return tuple(reversed(moves))

    def problems(self, position: Callable[[tuple[Move, ...]], str]) -> Iterator[tuple[Violation, tuple[Move, ...]]]:
        """Where nothing can happen any more, and where it cannot end any more although it could before."""
        stuck = [key for key in self._from if self._is_stuck(key)]
        if stuck:
            way = self.way_to(min(stuck, key=self._depths.__getitem__))
            where = position(way)
            text = f'stuck: {where}; nothing that can happen changes that, and nobody is asked'
            yield Violation(Property.NO_DEADLOCK, where, text), way
        can_end = self._can_end()
        if self._first in can_end:
            caught = [key for key in self._from if key not in can_end and not self._is_stuck(key)]
            if caught:
                way = self.way_to(min(caught, key=self._depths.__getitem__))
                where = position(way)
                text = f'from here it can never end by itself, whatever happens: {where}; only a stop ends it'
                yield Violation(Property.CAN_END, where, text), way

    def _open(self, key: bytes) -> bool:
        """Whether it is not known what follows."""
        return key in self.unfinished or key in self.broken

    def _is_stuck(self, key: bytes) -> bool:
        if self.ended[key] is not None or key in self.waiting or self._open(key):
            return False
        return all(after == key or move.label.is_stop for after, move in self._after.get(key, {}).items())

    def _can_end(self) -> set[bytes]:
        """Configurations from which an end can be reached without a stop, or might be."""
        before: dict[bytes, list[bytes]] = {}
        for source, steps in self._after.items():
            for key, move in steps.items():
                if not move.label.is_stop:
                    before.setdefault(key, []).append(source)
        found = {key for key, ended in self.ended.items() if ended is not None or self._open(key)}
        ahead = list(found)
        while ahead:
            for source in before.get(ahead.pop(), ()):
                if source not in found:
                    found.add(source)
                    ahead.append(source)
        return found
