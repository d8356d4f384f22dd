# SPDX-License-Identifier: BSD-3-Clause
"""The fewest states that behave the same: partition refinement, then merging where an outcome cannot come.

Two states are the same if they do the same, and lead to the same by every outcome. (Hopcroft 1971; here by rounds, as
machines are small.) A state that lacks an outcome which another one has may be merged with it all the same (Paull and
Unger 1959): any answer to what does not happen is right. That is done one pair after the other, which need not be the
best; without such outcomes the result is the smallest there is.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from itertools import combinations


def blocks_of(outputs: Sequence[Hashable], edges: Sequence[Mapping[str, Collection[int]]]) -> list[int]:
    """For each state the number of its block, that of all states that behave the same.

    ``edges[i]`` are the targets of state ``i`` by outcome. Blocks are numbered from 0 in the order of their first
    states.
    """
    blocks = _numbered(outputs)
    while True:
        finer = _numbered(
            [
                (
                    block,
                    tuple(
                        sorted(
                            (outcome, tuple(sorted({blocks[to] for to in targets}))) for outcome, targets in of.items()
                        )
                    ),
                )
                for block, of in zip(blocks, edges, strict=True)
            ]
        )
        if finer == blocks:
            return blocks
        blocks = finer


def merged(outputs: Sequence[Hashable], edges: Sequence[Mapping[str, int]]) -> list[int]:
    """For each state the number of the one that it is merged with, so that no outcome has two targets."""
    root = list(range(len(outputs)))
    for one, other in combinations(range(len(outputs)), 2):
        if _find(root, one) != _find(root, other) and outputs[one] == outputs[other]:
            root = _joined(root, one, other, outputs, edges) or root
    return [_find(root, state) for state in range(len(outputs))]


def _joined(
    root: Sequence[int], one: int, other: int, outputs: Sequence[Hashable], edges: Sequence[Mapping[str, int]]
) -> list[int] | None:
    """The classes when two blocks are one, with all that follows; None when that contradicts what they do."""
    tried = list(root)
    waiting = [(one, other)]
    while waiting:
        a, b = (_find(tried, block) for block in waiting.pop())
        if a == b:
            continue
        if outputs[a] != outputs[b]:
            return None
        tried[max(a, b)] = min(a, b)
        targets: dict[str, int] = {}
        for block in range(len(outputs)):
            if _find(tried, block) == min(a, b):
                for outcome, to in edges[block].items():
                    waiting.append((targets.setdefault(outcome, to), to))
    return tried


def _find(root: Sequence[int], block: int) -> int:
    while root[block] != block:
        block = root[block]
    return block


def _numbered(keys: Sequence[Hashable]) -> list[int]:
    numbers: dict[Hashable, int] = {}
    return [numbers.setdefault(key, len(numbers)) for key in keys]
