# SPDX-License-Identifier: BSD-3-Clause
"""The node types that trees of this server may name: the engine's, Nav2's, and those of installed packages."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Final

from flexbt_server.behavior_tree import NodeRegistry, builtin_registry, nav2_nodes
from flexbt_server.leaves import register_leaves

ENTRY_POINTS: Final = 'flexbt.bt_nodes'
"""Group of the entry points by which an installed package adds node types: functions that take the registry."""


def node_registry(on_broken: Callable[[str, Exception], None]) -> NodeRegistry:
    """A registry with everything that is installed.

    ``on_broken(entry point, error)`` is told of a package whose nodes cannot be used; the others can.
    """
    registry = builtin_registry()
    nav2_nodes.register(registry)
    register_leaves(registry)
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        try:
            point.load()(registry)
        except Exception as error:  # code of others
            on_broken(f'{point.name} = {point.value}', error)
    return registry
