# SPDX-License-Identifier: BSD-3-Clause
"""Rounds among the steps in which no time goes by."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_formal.exploration.graph import ConfigurationGraph
from flexbt_formal.exploration.model import Label, Move


def round_of(steps: Iterable[tuple[int, int]]) -> list[str] | None:
    """Return the steps of the round that is found, in a graph that begins with 0; they are made in this order."""
    keys = [number.to_bytes(4, 'big') for number in range(1 + max(max(step) for step in steps))]
    graph = ConfigurationGraph(keys[0])
    for source, target in steps:
        move = Move(Label(f'{source}-{target}'))
        graph.add(keys[target], keys[source], move)
        graph.add_turn(keys[source], keys[target], move)
    found = graph.round()
    return None if found is None else [str(move.label) for move in found]


def test_the_nearest_round_is_found_and_the_shortest_way_along_it() -> None:
    assert round_of([(0, 1), (0, 2), (1, 3), (2, 3)]) is None
    assert round_of([(0, 0)]) == ['0-0']
    far = [(0, 1), (1, 2), (0, 3), (3, 4), (2, 2)]
    assert round_of(far) == ['0-1', '1-2', '2-2']
    near = [*far, (4, 5), (5, 3), (4, 3)]
    assert round_of(near) == ['0-3', '3-4', '4-3']


def test_a_long_way_to_a_round_is_no_longer_search() -> None:
    """One from each place, with a copy of its way, would not come to an end here."""
    long = [(number, number + 1) for number in range(20_000)]
    assert round_of(long) is None
    found = round_of([*long, (20_000, 19_990)])
    assert found is not None and len(found) == 20_001 and found[-1] == '20000-19990'
