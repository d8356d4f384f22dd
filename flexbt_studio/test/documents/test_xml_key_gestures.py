# SPDX-License-Identifier: BSD-3-Clause
"""Gestures on keys and sub-trees: the engine runs the trees before and after, and must do the same."""

from __future__ import annotations

import random
import re
from typing import Any

import pytest

from flexbt_core import ManualClock, SyncAction, Tree, TreeLibrary, builtin_registry, input_port, load_xml
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import KEYS as KEYS_OF_OTHERS
from flexbt_core.behavior_tree.model.ports import STRING
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_studio.documents.text import applied
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.errors import GestureError

KEYS = ['a', 'b', 'c', 'd', '_p', '@g']
REGISTRY = builtin_registry()


class Maker:
    """Random trees: Main uses One and Two, One uses Two."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def document(self) -> str:
        two = self.tree('Two', [])
        one = self.tree('One', ['Two'])
        main = self.tree('Main', ['One', 'Two'])
        model = ''
        if self.random.random() < 0.6:
            default = self.random.choice(['{b}', '7'])
            port = f'<inout_port name="a" default="{default}"/>'
            model = f'<TreeNodesModel><SubTree ID="Two">{port}</SubTree></TreeNodesModel>'
        return f'<root BTCPP_format="4">\n{main}\n{one}\n{two}\n{model}\n</root>\n'

    def tree(self, id: str, below: list[str]) -> str:
        self.size = 0
        return f'  <BehaviorTree ID="{id}">\n    {self.node(below, 0)}\n  </BehaviorTree>'

    def node(self, below: list[str], depth: int) -> str:
        self.size += 1
        if depth < 3 and self.size < 12 and (depth == 0 or self.random.random() < 0.3):
            tag = self.random.choice(['Sequence', 'Fallback'])
            inner = ''.join(self.node(below, depth + 1) for _ in range(self.random.randint(2, 4)))
            return f'<{tag}{self.conditions()}>{inner}</{tag}>'
        if below and self.random.random() < 0.35:
            return self.call(self.random.choice(below))
        key, other = self.random.choice(KEYS), self.random.choice(KEYS)
        return self.random.choice(
            [
                f'<Script code="{key} := {self.random.randint(1, 5)}"{self.conditions()}/>',
                f'<Script code="{key} += {other}"/>',
                f'<ScriptCondition code="{key} == {other} || {key} &lt; 3"{self.conditions()}/>',
                f'<ForceSuccess><ScriptCondition code="{key} > 2"/></ForceSuccess>',
                f'<SetBlackboard value="{{{key}}}" output_key="{other}"/>',
                f'<SetBlackboard value="4" output_key="{other}"/>',
                f'<UnsetBlackboard key="{key}"/>',
                f'<Precondition if="{key} == 2" else="SUCCESS"><Script code="{other} := {key}"/></Precondition>',
                f'<Repeat num_cycles="2"><Script code="{other} += 1"/></Repeat>',
                f'<Switch2 variable="{{{key}}}" case_1="1" case_2="{{{other}}}"><AlwaysSuccess/><AlwaysFailure/>'
                '<AlwaysSuccess/></Switch2>',
            ]
        )

    def call(self, id: str) -> str:
        given = self.random.sample(['a', 'b', 'c', 'd'], self.random.randint(0, 4))
        values = [self.random.choice([f'{{{self.random.choice(KEYS)}}}', '{=}', '2']) for _ in given]
        ports = ''.join(f' {name}="{value}"' for name, value in zip(given, values, strict=True))
        name = f' name="{id}{self.random.randint(0, 10**9)}"'
        shared = self.random.choice(['', '', ' _autoremap="true"'])
        return f'<SubTree ID="{id}"{name}{shared}{ports}{self.conditions()}/>'

    def conditions(self) -> str:
        key = self.random.choice(KEYS)
        return self.random.choice(['', '', '', f' _skipIf="{key} == 1"', f' _onSuccess="{key} := 9"'])


def run(text: str, values: dict[str, Any]) -> tuple[list[str], dict[str, Any]] | None:
    """Return the statuses of 3 ticks, and the blackboard without private keys; None if the engine refuses the trees."""
    board = Blackboard()
    for key, value in values.items():
        board.set(key, value)
    try:
        tree = Tree(TreeLibrary([load_xml(text, 'test.xml', REGISTRY)]), 'Main', blackboard=board, clock=ManualClock())
    except TreeLoadError:
        return None
    statuses = []
    for _ in range(3):
        try:
            statuses.append(tree.tick_once().name)
        except BehaviorTreeError as error:
            statuses.append(type(error).__name__)
            tree.halt()
    return statuses, {key: value for key, value in board.snapshot().items() if not key.startswith('_')}


class HandOver(SyncAction):
    """Give entries to somebody who knows them by their keys."""

    ports = {'keys': input_port(STRING, literal=KEYS_OF_OTHERS)}

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


def test_a_key_that_others_know_is_not_renamed() -> None:
    registry = builtin_registry()
    registry.register_class(HandOver)
    nodes = '<HandOver keys="a; b"/><Script code="a := b"/>'
    text = f'<root><BehaviorTree ID="T"><Sequence>{nodes}</Sequence></BehaviorTree></root>'
    document = XmlDocument(text, '', registry)
    with pytest.raises(GestureError, match=r'hands \[b\] over by this name'):
        document.gesture('rename_key', {'tree': 'T', 'old': 'b', 'new': 'c'})
    extracted = applied(text, document.gesture('extract', {'node': 'T/0/0', 'id': 'New'}))
    assert '<SubTree ID="New" a="{a}" b="{b}"/>' in extracted


def test_a_key_that_a_tree_only_hands_on_with_all_others_is_renamed() -> None:
    text = """<root BTCPP_format="4">
  <BehaviorTree ID="Main"><Fallback><SubTree ID="One" b="{x}"/><SubTree ID="One" _autoremap="1"/></Fallback>
  </BehaviorTree>
  <BehaviorTree ID="One"><SubTree ID="Two" _autoremap="1"/></BehaviorTree>
  <BehaviorTree ID="Two"><Script code="b := 1"/></BehaviorTree>
</root>"""
    after = applied(text, XmlDocument(text).gesture('rename_key', {'tree': 'One', 'old': 'b', 'new': 'c'}))
    one, *parts = '<SubTree ID="One" c="{x}"/>', '_autoremap="1" c="{b}"', '_autoremap="1" b="{c}"'
    assert all(part in after for part in (one, *parts))
    assert run(after, {}) == run(text, {})
    with pytest.raises(GestureError, match=r'has no key \[z\]'):
        XmlDocument(text).gesture('rename_key', {'tree': 'One', 'old': 'z', 'new': 'c'})


@pytest.mark.parametrize('declared', ['', ' BTCPP_format="3"'])
def test_an_edit_does_not_change_the_format_by_which_keys_of_sub_trees_are_read(declared: str) -> None:
    calls = '<SequenceStar><SubTree ID="S" k="place"/></SequenceStar>'
    trees = f'<BehaviorTree ID="T">{calls}</BehaviorTree><BehaviorTree ID="S"><Fallback/></BehaviorTree>'
    document = XmlDocument(f'<root{declared}>{trees}</root>')
    for name, arguments in (
        ('unwrap', {'node': 'T/0'}),
        ('set_type', {'node': 'T/0', 'type': 'Sequence'}),
    ):
        if declared:
            assert XmlDocument(applied(document.text, document.gesture(name, arguments))).is_old
        else:
            with pytest.raises(GestureError, match=r'would mean themselves.* write BTCPP_format="3" into <root>'):
                document.gesture(name, arguments)
    new = XmlDocument(f'<root{declared}>{trees.replace("Star", "")}</root>')
    if not declared:
        with pytest.raises(GestureError, match=r'would mean keys.* write BTCPP_format="4" into <root>'):
            new.gesture('set_type', {'node': 'T/0', 'type': 'SequenceStar'})
    assert new.gesture('set_type', {'node': 'S/0', 'type': 'Sequence'})
    assert document.gesture('remove', {'node': 'T/0'})  # with what would be read anew


def given(text: str) -> dict[str, Any]:
    """Return values for the keys that Main, or a tree that shares its keys, uses."""
    main = text.partition('</BehaviorTree>')[0]
    values = {'a': 1, 'b': 2, 'c': 3, 'd': 1, 'g': 1}
    shares = '_autoremap' in main
    return {key: value for key, value in values.items() if shares or re.search(rf'\b{key}\b(?!=")', main)}


@pytest.mark.parametrize('seed', range(6))
def test_trees_do_the_same_after_extract_inline_and_rename(seed: int) -> None:
    maker = Maker(seed)
    before = None
    while before is None:
        text = maker.document()
        values = given(text)
        before = run(text, values)
    document = XmlDocument(text)
    for node in document.view()['nodes']:
        for name, arguments in (
            ('extract', {'node': node['path'], 'id': 'Extracted'}),
            ('inline', {'node': node['path']}),
        ):
            try:
                edits = document.gesture(name, arguments)
            except GestureError:
                continue
            after = applied(text, edits)
            statuses, board = run(after, values) or ([], {})
            # A key of the inlined tree alone is one of the tree around it now.
            board = {key: value for key, value in board.items() if key in before[1] or name == 'extract'}
            assert (statuses, board) == before, f'{name} {arguments}\n{text}\n{after}'
    for tree in document.trees:
        for key in KEYS:
            new = '@new' if key == '@g' else '_new' if key == '_p' else 'new'
            try:
                edits = document.gesture('rename_key', {'tree': tree, 'old': key, 'new': new})
            except GestureError:
                continue
            after = applied(text, edits)
            if tree == 'Main' and key != '@g':
                others = {new if name == key else name: value for name, value in values.items()}
                statuses, board = run(after, others) or ([], {})
                renamed = {key if name == new else name: value for name, value in board.items()}
                assert (statuses, renamed) == before, f'rename {key} of {tree}\n{text}\n{after}'
            elif key != '@g':
                assert run(after, values) == before, f'rename {key} of {tree}\n{text}\n{after}'
