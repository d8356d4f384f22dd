# SPDX-License-Identifier: BSD-3-Clause
"""The page about the nodes: up to date, complete, and its examples do what it says."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from flexbt_core.behavior_tree import nodes
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_server import leaves, nav2
from flexbt_server.node_types import node_registry

DOCS = Path(__file__).parents[3] / 'docs'
REGISTRY = node_registry(lambda point, error: None)
EXAMPLES = {manifest.id: manifest.example for manifest in REGISTRY if manifest.example is not None}


def test_the_page_is_what_its_program_writes(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / 'tools' / 'make_bt_nodes.py', tmp_path / 'page.md'], check=True)
    page = (DOCS / 'reference' / 'bt_nodes.md').read_text()
    assert page == (tmp_path / 'page.md').read_text(), 'run docs/tools/make_bt_nodes.py'


def test_every_node_has_an_example() -> None:
    ours = {
        manifest.id
        for manifest in REGISTRY
        if manifest.node_class.__module__.startswith(('flexbt_core', 'flexbt_server'))
    }
    assert ours - set(EXAMPLES) == {'Switch3', 'Switch4', 'Switch5', 'Switch6'}, 'as Switch2, with more cases'


def test_every_node_class_but_bases_is_registered_under_the_name_that_it_declares() -> None:
    found = {node_class for room in (nodes, leaves, nav2) for node_class in node_classes(room)}
    bases = {base for node_class in found for base in node_class.__mro__[1:]}
    named = {manifest.node_class: manifest.id for branch in NAV2_BRANCHES for manifest in node_registry(fail, branch)}
    for node_class in found - bases:
        if inspect.isabstract(node_class):
            continue
        assert named.get(node_class) == vars(node_class).get('xml_name', node_class.__name__), node_class


def fail(point: str, error: Exception) -> None:
    raise error


def node_classes(room: ModuleType) -> Iterator[type[TreeNode]]:
    """Yield the node classes that the modules of a room define."""
    for found in pkgutil.walk_packages(room.__path__, f'{room.__name__}.'):
        module = importlib.import_module(found.name)
        for value in (*vars(module).values(), *getattr(module, 'NODES', ())):
            if isinstance(value, type) and issubclass(value, TreeNode) and value.__module__ == found.name:
                yield value


@pytest.mark.parametrize('id', EXAMPLES)
def test_an_example_gives_what_the_page_says(id: str) -> None:
    example = EXAMPLES[id]
    text = f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{example.xml}</BehaviorTree>'
    document = load_xml(f'{text}{example.trees}</root>', f'{id}.xml', REGISTRY)
    assert any(node.manifest.id == id for node in document.trees['Main'].nodes())
    board = Blackboard()
    for key, value in example.before.items():
        board.set(key, value)
    clock = ManualClock()
    tree = Tree(TreeLibrary([document]), 'Main', blackboard=board, clock=clock)
    given = []
    for _ in example.ticks:
        given.append(tree.tick_exactly_once())
        if tree.next_wake is not None:
            clock.advance(tree.next_wake - clock.now())
    assert tuple(given) == example.ticks
    for key, value in example.after.items():
        assert board.get(key) == value
    tree.halt()
