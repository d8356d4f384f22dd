# SPDX-License-Identifier: BSD-3-Clause
"""The node types that trees may name: the engine's, Nav2's, and those of installed packages. Needs no ROS to be
imported; where there is none, only the leaves that need it are missing."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Final

from flexbt_core.behavior_tree import NodeRegistry, builtin_registry
from flexbt_core.behavior_tree.nodes.nav2 import Nav2Branch, register_nav2

ENTRY_POINTS: Final = 'flexbt.bt_nodes'
"""Group of the entry points by which an installed package adds node types: functions that take the registry."""


def node_registry(on_broken: Callable[[str, Exception], None], nav2_branch: Nav2Branch = 'jazzy') -> NodeRegistry:
    """A registry with everything that is installed. ``nav2_branch`` is the branch of Nav2 whose nodes trees
    expect that do not show it themselves.

    ``on_broken(nodes, error)`` is told what cannot be used: the nodes of an entry point or a module, or only one of
    them, whose ID an earlier source has taken; the others can. Entry points come in the order of their names.
    """
    registry = builtin_registry()
    register_nav2(registry, nav2_branch)
    points = sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)
    _add(registry, 'flexbt_server.nav2', lambda: _ros_leaves(nav2_branch), on_broken)
    for point in points:
        _add(registry, f'{point.name} = {point.value}', point.load, on_broken)
    return registry


def _add(
    registry: NodeRegistry,
    source: str,
    load: Callable[[], Callable[[NodeRegistry], None]],
    on_broken: Callable[[str, Exception], None],
) -> None:
    registry.on_clash = lambda id, error: on_broken(f'the node type [{id}] of {source}', error)
    try:
        load()(registry)
    except Exception as error:  # code of others, or no ROS
        on_broken(f'the nodes of {source}', error)
    registry.on_clash = None


def _ros_leaves(nav2_branch: Nav2Branch) -> Callable[[NodeRegistry], None]:
    from flexbt_server.nav2 import register_leaves

    return lambda registry: register_leaves(registry, nav2_branch)
