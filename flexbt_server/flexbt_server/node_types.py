# SPDX-License-Identifier: BSD-3-Clause
"""The node types for trees: the engine's, Nav2's, and those of installed packages. The import works without ROS; then
only the leaves that need ROS are missing."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import Nav2Branch, register_nav2

ENTRY_POINTS: Final = 'flexbt.bt_nodes'
"""Group of entry points by which installed packages add node types: functions with the registry as argument."""


def node_registry(on_broken: Callable[[str, Exception], None], nav2_branch: Nav2Branch = 'jazzy') -> NodeRegistry:
    """Return a registry with all installed node types. ``nav2_branch`` is the branch of Nav2 for trees that do not show
    their branch.

    ``on_broken(nodes, error)`` is called for unusable nodes: all nodes of an entry point or a module, or a single node
    whose ID an earlier source has registered; the other nodes remain usable. Entry points are loaded in the order of
    their names.
    """
    registry = builtin_registry()
    register_nav2(registry, nav2_branch)
    points = sorted(_installed(tuple(map(_state_of, sys.path))), key=lambda point: point.name)
    _add(registry, 'flexbt_server.nav2', lambda: _ros_leaves(nav2_branch), on_broken)
    if 'CallAction' in registry:  # ROS is installed
        _add(registry, 'manifests', lambda: _of_manifests(on_broken), on_broken)
    for point in points:
        _add(registry, f'{point.name} = {point.value}', point.load, on_broken)
    return registry


@lru_cache(maxsize=1)
def _installed(_directories: tuple[tuple[str, int, int], ...]) -> EntryPoints:
    """Return the entry points installed in these directories. Reading them is the slowest part of a registry."""
    return entry_points(group=ENTRY_POINTS)


def _state_of(directory: str) -> tuple[str, int, int]:
    """Return a stamp of a directory that changes when something is installed there, or the directory is replaced."""
    try:
        status = Path(directory).stat()
    except OSError:  # most directories of Python's search path lack it
        return directory, 0, 0
    return directory, status.st_ino, status.st_mtime_ns


def _add(
    registry: NodeRegistry,
    source: str,
    load: Callable[[], Callable[[NodeRegistry], None]],
    on_broken: Callable[[str, Exception], None],
) -> None:
    registry.on_clash = lambda id, error: on_broken(f'the node type [{id}] of {source}', error)
    try:
        load()(registry)
    except Exception as error:  # an error in third-party code, or no ROS
        on_broken(f'the nodes of {source}', error)
    registry.on_clash = None


def _of_manifests(on_broken: Callable[[str, Exception], None]) -> Callable[[NodeRegistry], None]:
    from flexbt_server.node_manifests import register_manifests

    return lambda registry: register_manifests(registry, on_broken)


def _ros_leaves(nav2_branch: Nav2Branch) -> Callable[[NodeRegistry], None]:
    from flexbt_server.nav2.register import register_leaves

    return lambda registry: register_leaves(registry, nav2_branch)
