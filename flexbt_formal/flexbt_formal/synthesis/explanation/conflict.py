# SPDX-License-Identifier: BSD-3-Clause
"""The smallest set of demands that conflict.

That something conflicts stays so when demands are added. One set that is minimal is found by halving (Junker:
QuickXplain, 2004); a smallest one by sets of which it has to have a member each, the demands that remain outside of
what can be fulfilled together (Ignatiev, Previti, Liffiton, Marques-Silva: Smallest MUS extraction, 2015).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Final, NamedTuple

Conflicts = Callable[[Sequence[str]], bool]

_MOST_SETS: Final = 20_000


class Conflict(NamedTuple):
    """Demands of which each is needed for the conflict; ``is_smallest`` when no smaller set conflicts."""

    demands: tuple[str, ...]
    is_smallest: bool


def smallest_conflict(demands: Sequence[str], conflicts: Conflicts, may_go_on: Callable[[], bool]) -> Conflict:
    """A smallest set of demands that conflict, given that all of them do.

    ``may_go_on`` is asked before each further search; when it says no, the answer is a set of which each member is
    needed, which need not be the smallest.
    """
    if conflicts(()):
        return Conflict((), True)
    minimal = _minimal((), tuple(demands), conflicts, is_new=False)
    outside: list[frozenset[str]] = []
    tried = 0
    while may_go_on():
        for size in range(len(minimal)):
            candidate = None
            for one in combinations(sorted(set().union(*outside), key=demands.index), size):
                tried += 1
                if tried > _MOST_SETS:
                    return Conflict(minimal, False)
                if all(hit & set(one) for hit in outside):
                    candidate = one
                    break
            if candidate is not None:
                break
        if candidate is None:
            return Conflict(minimal, True)
        if conflicts(candidate):
            return Conflict(candidate, True)
        rest = tuple(one for one in demands if one not in candidate)
        fulfilled = _extended(candidate, rest, conflicts)
        outside.append(frozenset(demands) - frozenset(fulfilled))
    return Conflict(minimal, False)


def _minimal(
    background: tuple[str, ...], demands: tuple[str, ...], conflicts: Conflicts, *, is_new: bool
) -> tuple[str, ...]:
    """Of ``demands`` those that are needed beside the ``background``; ``is_new`` when that has grown."""
    if is_new and conflicts(background):
        return ()
    if len(demands) == 1:
        return demands
    half = len(demands) // 2
    first, second = demands[:half], demands[half:]
    of_second = _minimal((*background, *first), second, conflicts, is_new=bool(first))
    of_first = _minimal((*background, *of_second), first, conflicts, is_new=bool(of_second))
    return (*of_first, *of_second)


def _extended(chosen: tuple[str, ...], rest: tuple[str, ...], conflicts: Conflicts) -> tuple[str, ...]:
    """As many further demands as can be fulfilled beside those that are chosen."""
    if not rest or not conflicts((*chosen, *rest)):
        return (*chosen, *rest)
    if len(rest) == 1:
        return chosen
    half = len(rest) // 2
    return _extended(_extended(chosen, rest[:half], conflicts), rest[half:], conflicts)
