# SPDX-License-Identifier: BSD-3-Clause
"""Literals of which at most one is true at a time: where the robot is, what a hand holds, open or closed.

A set is found from a literal: whoever makes one of the set true has to make the others false, or takes the place of
one that it needed and made false; what is lacking for that joins the set (invariants as in Helmert, *Concise
finite-domain representations for PDDL planning tasks*, 2009, here on grounded actions). Not all such sets are found:
what is told is true, and what is not told may be true.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import islice
from typing import Final

from flexbt_formal.planning.problems import Domain, bits

_MOST_PAIRS: Final = 4
"""That are tried for a literal."""


class Exclusions:
    """What excludes what in all states that can be reached from ``initial`` by actions."""

    def __init__(self, domain: Domain, initial: int) -> None:
        self._domain = domain
        self._initial = initial
        adders: dict[int, list[int]] = defaultdict(list)
        deleted = 0
        for number, adds in enumerate(domain.adds):
            deleted |= domain.deletes[number]
            for literal in bits(adds):
                adders[literal].append(number)
        self._adders: Final = dict(adders)
        self.groups: Final[list[int]] = []
        self.of: Final = [0] * len(domain.literals)
        failed: set[int] = set()
        done = 0
        for literal in bits(deleted):
            if done >> literal & 1 or literal in failed or literal not in self._adders:
                continue
            group = self._largest(literal, failed)
            if group is None:
                failed.add(literal)
            elif group.bit_count() > 1:
                self.groups.append(group)
                done |= group
                for member in bits(group):
                    self.of[member] |= group & ~(1 << member)

    def _largest(self, literal: int, failed: set[int]) -> int | None:
        """The set of a literal; where it would be alone, with the one that an action that makes it true moves there."""
        alone = self._group(1 << literal | self._others_of_adders(literal), failed)
        if alone is None or alone.bit_count() > 1:
            return alone
        moved = 0
        for action in self._adders[literal]:
            moved |= self._domain.needs[action] & self._domain.deletes[action]
        pairs = (self._group(1 << literal | 1 << other, failed) for other in bits(moved) if other not in failed)
        return next((pair for pair in islice(pairs, _MOST_PAIRS) if pair is not None), alone)

    def _group(self, seeds: int, failed: set[int]) -> int | None:
        domain = self._domain
        group = seeds
        todo = list(bits(group))
        while todo:
            for action in self._adders.get(todo.pop(), ()):
                adds, deletes = domain.adds[action], domain.deletes[action]
                if (adds & group).bit_count() > 1:
                    return None
                left = group & ~adds & ~deletes
                moved = domain.needs[action] & deletes
                if not left or moved & group:
                    continue
                candidates = [literal for literal in bits(moved) if literal not in failed]
                if len(candidates) != 1:
                    return None
                group |= 1 << candidates[0]
                todo.append(candidates[0])
        return group if (group & self._initial).bit_count() <= 1 and self._holds(group) else None

    def _others_of_adders(self, seed: int) -> int:
        """What all that make a literal true make false: the other places when one goes to a place."""
        common = -1
        for action in self._adders[seed]:
            common &= self._domain.deletes[action]
        return common

    def _holds(self, group: int) -> bool:
        domain = self._domain
        for literal in bits(group):
            for action in self._adders.get(literal, ()):
                adds, deletes = domain.adds[action], domain.deletes[action]
                if (adds & group).bit_count() > 1:
                    return False
                if group & ~adds & ~deletes and not domain.needs[action] & deletes & group:
                    return False
        return True

    def excluded(self, condition: int) -> bool:
        """Whether a condition has two literals that exclude each other."""
        return any(self.of[literal] & condition for literal in bits(condition))
