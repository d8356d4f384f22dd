# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` says of keys that nothing writes and of types that clash, against what the engine does."""

from __future__ import annotations

import contextlib
import random
import re
from typing import NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, PortError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_testing.behavior_trees.bt_tool import document
from flexbt_tools.tree_checks.check import findings
from flexbt_tools.tree_checks.diagnostics import NEVER_WRITTEN, REFUSED, TYPE_CLASH, UNUSED_PORT

KEYS = ('a', 'b', '_c', '@a')
PORTS = {'int': INT, 'real': DOUBLE, 'text': STRING, 'any': None}
VALUES = {'int': 3, 'real': 2.5, 'text': 'words', 'any': 'words'}


class Get(SyncAction):
    """Reads what it is given, and tells ``services`` of what it could read."""

    ports = {name: input_port(kind, optional=True) for name, kind in PORTS.items()}

    def tick(self) -> NodeStatus:
        for port in PORTS:
            if self.port_text(port) is not None:
                try:
                    self.get_input(port)
                except PortError:
                    self.services.refused.add(self.path)
                else:
                    self.services.read.add(self.path)
        return NodeStatus.SUCCESS


class Put(SyncAction):
    """Writes to what it is given."""

    ports = {name: output_port(kind) for name, kind in PORTS.items()}

    def tick(self) -> NodeStatus:
        for port, value in VALUES.items():
            self.set_output(port, value)
        return NodeStatus.SUCCESS


class Seen:
    """The paths of the nodes that have read something, and of those that could not."""

    def __init__(self) -> None:
        self.read: set[str] = set()
        self.refused: set[str] = set()


REGISTRY = builtin_registry()
REGISTRY.register('Get', Get)
REGISTRY.register('Put', Put)


def trees(seed: int) -> str:
    """Return a file of a main tree and of up to three sub-trees, each used by one before it."""
    pick = random.Random(seed)
    count = pick.randint(1, 4)
    numbers = iter(range(1000))

    def leaf(index: int) -> str:
        key, port = pick.choice(KEYS), pick.choice([*PORTS, 'int', 'int'])
        chance = pick.random()
        if chance < 0.35:
            return f'<Get name="{next(numbers)}" {port}="{{{key}}}"/>'
        if chance < 0.6:
            return f'<Put {port}="{{{key}}}"/>'
        if chance < 0.7:
            return f'<Script code="{pick.choice(KEYS)} := {pick.choice(["1", "2.5"])}"/>'
        if chance < 0.75:
            return f'<SetBlackboard value="{pick.choice(["7", "x"])}" output_key="{pick.choice(KEYS[:3])}"/>'
        if index + 1 >= count:
            return '<AlwaysSuccess/>'
        meant = ('{a}', '{b}', '{=}', '{@b}', '5', 'x', '2.5')
        given = [f'{key}="{pick.choice(meant)}"' for key in 'ab' if pick.random() < 0.5]
        remap = ['_autoremap="true"'] if pick.random() < 0.4 else []
        name = f'name="s{next(numbers)}"'
        return f'<SubTree ID="T{pick.randint(index + 1, count - 1)}" {" ".join([name, *given, *remap])}/>'

    rows = [[leaf(index) for _ in range(pick.randint(1, 5))] for index in range(count)]
    bodies = [f'T{index}: <Sequence>{"".join(row)}</Sequence>' for index, row in enumerate(rows)]
    used: list[str] = []
    for index, body in enumerate(bodies):
        if not index or any(f'ID="T{index}"' in other for other in used):
            used.append(body)
    return document(*used, main='T0')


class Run(NamedTuple):
    """Two ticks: the nodes that have read in each tick in which they were asked, those that could not, the names of
    nodes that have read in all places of the tree, and the blackboard."""

    read: set[str]
    refused: set[str]
    reliable: set[str]
    board: dict[str, object]


def run(text: str) -> Run:
    seen = Seen()
    tree = Tree(TreeLibrary([load_xml(text, 'file', REGISTRY)]), 'T0', services=seen)
    for _ in range(2):
        with contextlib.suppress(NodeExecutionError):
            tree.tick_once()
        tree.halt()
    read = seen.read - seen.refused
    reliable = {node.name for node in tree.nodes} - {node.name for node in tree.nodes if node.path not in read}
    return Run(read, seen.refused, reliable, tree.blackboard.snapshot())


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 1_000_000))
def test_what_is_said_of_keys_holds_in_a_run(seed: int) -> None:
    text = trees(seed)
    library = TreeLibrary([load_xml(text, 'file', REGISTRY)])
    found = list(dict.fromkeys(findings(library, (), shared=False)))
    refused = [finding.place for finding in found if finding.rule is REFUSED]
    try:
        done = run(text)
    except TreeLoadError as error:
        assert refused == list(dict.fromkeys(error.errors)), 'the engine says the same'
        return
    assert not refused
    said = {(one.place.line, one.place.column) for one in found if one.rule in (NEVER_WRITTEN, TYPE_CLASH)}
    for tree in library.documents['file'].trees.values():
        for node in tree.nodes():
            if node.name in done.reliable:
                [port] = node.values
                assert tree.source.position(node.offset + node.places[port]) not in said
    for one in found:
        if one.rule is UNUSED_PORT:
            line = text.split('\n')[one.place.line - 1]
            shorter = line[: one.place.column - 1] + re.sub('^[^ />]*', '', line[one.place.column - 1 :])
            assert run(text.replace(line, shorter)) == done, 'nothing depends on that port'
