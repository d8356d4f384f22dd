# SPDX-License-Identifier: BSD-3-Clause
"""The branches of Nav2 whose nodes differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Literal, get_args

from flexbt_core.behavior_tree.engine import TreeNode

Dialect = Literal['jazzy', 'main']
"""Branches of Nav2 whose nodes differ. Nodes that only ``main`` has are there in both dialects."""

DIALECTS: Final[tuple[Dialect, ...]] = get_args(Dialect)


def of_dialect(node_classes: Iterable[type[TreeNode]], dialect: Dialect) -> Iterator[type[TreeNode]]:
    """Those that are nodes in that branch: a class that is one in a single branch names it, as ``dialect``."""
    return (node_class for node_class in node_classes if vars(node_class).get('dialect', dialect) == dialect)
