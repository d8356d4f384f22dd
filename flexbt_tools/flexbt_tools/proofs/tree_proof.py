# SPDX-License-Identifier: BSD-3-Clause
"""A tree by itself, proved with whatever its leaves may do."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from flexbt_core.behavior_tree import NodeRegistry, TreeKey, TreeLibrary
from flexbt_core.exploration import Limits, Move, Progress, Report, TreeSystem, Violation, explore, replay
from flexbt_server.node_types import node_registry
from flexbt_tools.trees import OpenRegistry, read_library

from .moves import moves_of

GOALS: Final = ('goal', 'goals')
"""Keys that whoever runs a tree writes before, as Nav2's navigators do."""
TREE_BOUNDS: Final = 'any result of each leaf at any time, a stop at any time'


def prove_tree(
    library: TreeLibrary,
    key: TreeKey,
    *,
    given: Iterable[str] = (),
    limits: Limits | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> Report:
    """Explore a tree. ``given`` are keys that are on the blackboard before it begins. Raises TreeLoadError."""
    keys = (*GOALS, *given)

    def make() -> TreeSystem:
        return TreeSystem(library, key, given=keys)

    taken = make().given
    bounds = TREE_BOUNDS + (f'; given before it begins: {", ".join(taken)}' if taken else '')
    return explore(make, f'tree {key.id}', bounds, limits, on_progress)


def replay_tree(
    files: Sequence[str], tree: str, moves: Iterable[Sequence[Any]], *, given: Iterable[str] = ()
) -> list[Violation]:
    """What is wrong on a way that a proof has found, as a saved test has it. Nothing, when that way is closed.

    Raises RefusedError or LookupError when there are no such files, or no such tree.
    """
    registry: NodeRegistry = OpenRegistry(node_registry(lambda source, error: None))
    library = read_library(files, registry)
    key = library.find(tree)
    if key is None:
        raise LookupError(f'there is no tree {tree!r} in {", ".join(files)}')
    keys = (*GOALS, *given)
    way: tuple[Move, ...] = moves_of(moves)
    return replay(lambda: TreeSystem(library, key, given=keys), way)
