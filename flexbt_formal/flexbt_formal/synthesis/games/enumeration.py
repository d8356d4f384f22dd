# SPDX-License-Identifier: BSD-3-Clause
"""All valuations that satisfy formulas, found one variable after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from .formula import Formula, Name, Valuation, names_in, value_of
from .specification import Variable


def valuations(
    names: Sequence[Name], formulas: Iterable[Formula], known: Valuation, variables: Mapping[str, Variable]
) -> Iterator[dict[Name, int]]:
    """All values of ``names`` with which every formula holds, given values of others (``known``).

    In order of the names, each from its least value. Formulas that hold or not whatever the names are, are checked
    once. Raises KeyError when a formula has variables that are in neither.
    """
    found = dict(known)
    position = {name: index for index, name in enumerate(names)}
    by_last: list[list[Formula]] = [[] for _ in names]  # a formula is checked whenever one of its names gets a value
    for formula in formulas:
        places = {position[name] for name in names_in(formula) if name in position}
        if not places and not value_of(formula, found):
            return
        for place in places:
            by_last[place].append(formula)
    yield from _extended(names, by_last, found, variables, 0)


def _extended(
    names: Sequence[Name],
    by_last: Sequence[Sequence[Formula]],
    found: dict[Name, int],
    variables: Mapping[str, Variable],
    place: int,
) -> Iterator[dict[Name, int]]:
    if place == len(names):
        yield {name: found[name] for name in names}
        return
    name = names[place]
    for value in variables[name.name].values:
        found[name] = value
        if all(value_of(formula, found) is not False for formula in by_last[place]):
            yield from _extended(names, by_last, found, variables, place + 1)
    del found[name]
