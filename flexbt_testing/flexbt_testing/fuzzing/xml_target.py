# SPDX-License-Identifier: BSD-3-Clause
"""Behavior-tree files: whatever the text, reading it gives a document, or errors with places in that text.

A document that is read can be checked as ``bt_tool`` does it, made into a tree, and ticked. The texts are made of
Nav2's trees where they are at hand, of random trees of all nodes, and of hostile documents.
"""

from __future__ import annotations

import collections
import contextlib
import re
from collections.abc import Hashable

from flexbt_core.behavior_tree import (
    BehaviorTreeError,
    Blackboard,
    NodeRegistry,
    NodeStatus,
    StatefulAction,
    Tree,
    TreeLibrary,
    TreeLoadError,
    load_xml,
    simple_action,
    simple_condition,
    simple_decorator,
)
from flexbt_core.clock import ManualClock
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES
from flexbt_testing.behavior_trees.hostile_xml import ACCEPTED, CORPUS
from flexbt_testing.random_trees import nodes, scripts
from flexbt_tools.tree_checks import findings

from .fuzzer import Target

LONGEST_RUN = 60_000
"""Characters of a file whose trees are ticked."""
WORDS = r"""
    < > /> </ " ' & &lt; &#65; &#x110000; &#xD800; ; { } {=} {@a} {} = <!-- --> <![CDATA[ ]]> <?xml?> <!DOCTYPE ]>
    ID="Main" name="" _skipIf="a==1" _onHalted="b:=2" _while="true" _autoremap="true" num_cycles="3" BTCPP_format="3"
    -1 1e999 99999999999999999999 0x 1;2;3 json:[1 json:{'a':1} nan true := && || ? : ( ) += <TreeNodesModel>
    <SubTree_ID="Main"/> <include_path="a.xml"/> <Action_ID="AlwaysSuccess"/> <BehaviorTree_ID="T">
    <root_BTCPP_format="4"> <Sequence> </Sequence> </BehaviorTree> </root>""".replace('_ID', ' ID').split()


class Act(StatefulAction):
    """A leaf of the random trees, as are those that follow."""

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    def on_halted(self) -> None:
        pass


def _registry() -> NodeRegistry:
    """The nodes of the server, and those of the random trees."""

    def refuse(source: str, error: Exception) -> None:
        raise error

    registry = node_registry(refuse)
    registry.register('Act', Act)
    registry.register('Sync', simple_action(lambda node: NodeStatus.SUCCESS))
    registry.register('Cond', simple_condition(lambda node: False))
    registry.register('Deco', simple_decorator(lambda status, node: status))
    return registry


def _seeds() -> list[str]:
    texts = [file.read_text() for file in STOCK_TREES]
    texts += [nodes.make_case(seed)['xml'] for seed in range(40)]
    texts += [scripts.make_case(seed)['xml'] for seed in range(40)]
    hostile = [content for content, _ in CORPUS.values()] + list(ACCEPTED.values())
    texts += [content.decode('utf-8', 'replace') for content in hostile if len(content) < 5000]
    return texts


class XmlTarget(Target):
    """:func:`flexbt_core.behavior_tree.load_xml`, and what becomes of a document."""

    words = tuple(WORDS)

    def __init__(self) -> None:
        self._registry = _registry()

    def seeds(self) -> list[str]:
        return _seeds()

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        includes = dict.fromkeys(['a.xml', 'b.xml'], data)

        def include(path: str, package: str | None, including: str) -> tuple[str, bytes]:
            if path not in includes:
                raise FileNotFoundError(path)
            return path, includes[path]

        try:
            document = load_xml(data, 'file.xml', self._registry, include=include)
            library = TreeLibrary([document])
        except TreeLoadError as error:
            counts['refused'] += 1
            assert error.errors
            lines = data.count(b'\n') + data.count(b'\r') + 1
            for reason in error.errors:
                assert 1 <= reason.line <= lines + 3 and reason.column >= 1, reason
                str(reason).encode()
            return tuple(sorted({' '.join(re.findall('[a-z]{3,}', reason.message)[:4]) for reason in error.errors})[:3])
        counts['read'] += 1
        if document.main is not None and len(data) <= LONGEST_RUN:
            self._run(library, document.main, counts)
        return ('read', *(node.manifest.id for tree in document.trees.values() for node in tree.nodes()))

    def _run(self, library: TreeLibrary, main: str, counts: collections.Counter[str]) -> None:
        for shared in (False, True):
            for finding in findings(library, (), shared=shared):
                assert finding.place.line >= 1
        with contextlib.suppress(BehaviorTreeError):
            clock = ManualClock()
            tree = Tree(library, main, blackboard=Blackboard(), clock=clock, max_rounds=20)
            try:
                for _ in range(3):
                    if tree.tick_once() is not NodeStatus.RUNNING:
                        break
                    clock.advance(0.1)
            finally:
                tree.halt()
            counts['ticked'] += 1
