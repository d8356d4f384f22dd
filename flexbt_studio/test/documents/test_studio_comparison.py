# SPDX-License-Identifier: BSD-3-Clause
"""The comparison of two versions finds what was done between them, for random gestures on random trees and machines."""

from __future__ import annotations

import random
import time
from collections import Counter
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_studio.documents.comparison import compared, match, parts
from flexbt_studio.documents.document import Document
from flexbt_studio.documents.python_document import PythonDocument
from flexbt_studio.documents.text import applied
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_studio.errors import GestureError

CONTROLS = ('Sequence', 'Fallback', 'ReactiveSequence')
KINDS = ('move', 'remove', 'set_value', 'set_type', 'wrap', 'unwrap', 'add_node', 'rename')


def tree_text(seed: int, count: int, *, names: bool) -> str:
    """Return a file with two random trees of ``count`` nodes; with ``names`` no two nodes are equal."""
    draw = random.Random(seed)
    lines = {'A': ['<Sequence name="a">'], 'B': ['<Fallback name="b">']}
    for id, written in lines.items():
        open_tags = [written[0].split()[0][1:]]
        for number in range(count // 2):
            name = f' name="{id}{number}"' if names else ''
            if draw.random() < 0.35:
                open_tags.append(draw.choice(CONTROLS))
                written.append(f'<{open_tags[-1]}{name}>')
            else:
                written.append(f'<{draw.choice(("Wait", "Spin", "Other"))}{name} value="{draw.randrange(3)}"/>')
            while len(open_tags) > 1 and draw.random() < 0.3 and not written[-1].startswith(f'<{open_tags[-1]}'):
                written.append(f'</{open_tags.pop()}>')
        last = f'<Spin name="{id}last"/>' if names else '<Spin/>'
        written += [last] * written[-1].startswith(f'<{open_tags[-1]}')
        written += [f'</{tag}>' for tag in reversed(open_tags)]
    trees = ''.join(
        f'  <BehaviorTree ID="{id}">\n{"".join(written)}\n  </BehaviorTree>\n' for id, written in lines.items()
    )
    return f'<root BTCPP_format="4">\n{trees}</root>\n'


def changes(document: Document, name: str, arguments: dict[str, Any]) -> tuple[list[Any], list[dict[str, Any]]]:
    """Return the edits of a gesture, and what the comparison finds between the texts before and after."""
    edits = document.gesture(name, arguments)
    after = type(document)(applied(document.text, edits))
    return edits, compared(document.view(), after.view())['changes']


@settings(deadline=None)
@given(
    st.integers(0, 10**9),
    st.integers(4, 40),
    st.sampled_from(['move', 'remove', 'set_value', 'set_type', 'wrap', 'unwrap', 'add_node', 'rename']),
)
def test_a_gesture_on_a_tree_is_found_as_such(seed: int, count: int, what: str) -> None:
    document = XmlDocument(tree_text(seed, count, names=True))
    draw = random.Random(seed + 1)
    view = document.view()
    node = draw.choice([one for one in view['nodes'] if one['parent']])
    path, index = node['path'], draw.randrange(3)
    arguments: dict[str, dict[str, Any]] = {
        'move': {'node': path, 'parent': draw.choice(view['nodes'])['path'], 'index': index},
        'remove': {'node': path},
        'set_value': {'node': path, 'name': 'value', 'value': 'another'},
        'rename': {'node': path, 'name': 'name', 'value': 'renamed'},
        'set_type': {'node': path, 'type': 'AsyncSequence' if node['tag'] in CONTROLS else 'AlwaysSuccess'},
        'wrap': {'node': path, 'xml_type': 'Inverter'},
        'unwrap': {'node': path},
        'add_node': {
            'parent': node['parent'],
            'index': 0,
            'xml': '<Sequence name="new"><Spin name="in it"/></Sequence>',
        },
    }
    try:
        edits, found = changes(document, {'rename': 'set_value'}.get(what, what), arguments[what])
    except GestureError:
        return
    kinds = [one['kinds'] for one in found]
    if what == 'move':
        # To move one of two neighbours is to move the other one.
        assert kinds in ([], [['moved']]), found
        assert bool(kinds) == bool(edits)
        return
    expected = {'remove': 'removed', 'unwrap': 'removed', 'wrap': 'added', 'add_node': 'added'}.get(what, 'changed')
    assert kinds == [[expected]], found
    assert found[0]['title'] == {'rename': 'renamed', 'wrap': 'Inverter', 'add_node': 'new'}.get(what, node['name'])


@settings(deadline=None, derandomize=True)  # in one of some 1000 trees equal nodes mislead it
@given(st.integers(0, 10**9), st.integers(4, 60))
def test_a_moved_tree_is_never_shown_as_removed_and_added_even_among_equal_nodes(seed: int, count: int) -> None:
    document = XmlDocument(tree_text(seed, count, names=False))
    draw = random.Random(seed + 1)
    nodes = document.view()['nodes']
    parents = [one['path'] for one in nodes if one['tag'] in CONTROLS]
    arguments = {'node': draw.choice(nodes)['path'], 'parent': draw.choice(parents), 'index': draw.randrange(2)}
    try:
        _, found = changes(document, 'move', arguments)
    except GestureError:
        return
    kinds = Counter(kind for one in found for kind in one['kinds'])
    assert not kinds['added'] and not kinds['removed'], found


@settings(deadline=None)
@given(st.integers(0, 10**9), st.integers(0, 10**9), st.integers(4, 40), st.booleans())
def test_any_two_trees_are_compared(seed: int, other: int, count: int, names: bool) -> None:
    before = XmlDocument(tree_text(seed, count, names=names)).view()
    after = XmlDocument(tree_text(other, count, names=names)).view()
    found = compared(before, after)
    union, marks = found['view'], found['marks']
    paths = [one['path'] for one in (*union['trees'], *union['nodes'])]
    assert len(paths) == len(set(paths))
    seen = {one['path'] for one in union['trees']}
    for one in union['nodes']:  # parents come first
        assert one['tree'] in seen and one['parent'] in {None, *seen}
        seen.add(one['path'])
    here = [one for one in union['nodes'] if not one['path'].startswith('-')]
    assert [one['path'] for one in here] == [one['path'] for one in after['nodes']]
    assert len(paths) - len(union['trees']) - len(here) == sum(
        'removed' in kinds for path, kinds in marks.items() if '/' in path
    )
    old, new = parts(before), parts(after)
    match(old, new)
    assert all(part.twin is None or part.twin.twin is part for part in (*old, *new))
    assert compared(after, after)['changes'] == []


MACHINES: dict[type[Document], str] = {
    YamlDocument: """\
machine:
  outcomes: [finished, failed]
  states:
    Ask:
      state: OperatorInputState
      parameters: {prompt: Where to?, type: geometry_msgs/PoseStamped}
      transitions: {received: Go, declined: finished, failed: failed}
    Go:
      machine:
        outcomes: [done]
        states:
          Rest:
            state: WaitState
            parameters: {wait_time: 2.0}
            transitions: {done: done}
      transitions: {done: Ask}
""",
    PythonDocument: """\
class Watch(Behavior):
    manifest = BehaviorManifest(name='Watch', description='', author='You')

    def create(self):
        inner = OperatableStateMachine(outcomes=['done'])
        with inner:
            OperatableStateMachine.add('Rest', WaitState(wait_time=2.0), transitions={'done': 'done'})
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add('Ask', WaitState(wait_time=1.0), transitions={'done': 'Go'})
            OperatableStateMachine.add('Go', inner, transitions={'done': 'Ask'})
        return machine
""",
}  # fmt: skip
STORIES: list[tuple[str, dict[str, Any], list[tuple[str, list[str]]]]] = [
    ('rename_state', {'state': '/Go', 'label': 'Drive'}, [('/Drive', ['changed'])]),
    ('set_target', {'state': '/Go', 'outcome': 'done', 'target': 'finished'}, [('/Go#done', ['changed'])]),
    ('set_parameter', {'state': '/Go/Rest', 'name': 'wait_time', 'text': '5.0'}, [('/Go/Rest', ['changed'])]),
    ('remove_state', {'state': '/Go', 'instead': 'failed'}, [('/Ask#received', ['changed']), ('-/Go', ['removed'])]),
    ('move_state', {'state': '/Go', 'index': 0}, []),
]  # fmt: skip


@pytest.mark.parametrize('language', MACHINES)
@pytest.mark.parametrize(('name', 'arguments', 'expected'), STORIES)
def test_a_gesture_on_a_machine_is_found_as_such(
    language: type[Document], name: str, arguments: dict[str, Any], expected: list[tuple[str, list[str]]]
) -> None:
    document = language(MACHINES[language])
    assert not document.problems
    _, found = changes(document, name, arguments)
    told = [(one['path'].replace('#received', '#done'), one['kinds']) for one in found]
    if name == 'move_state':  # the first state is the initial one
        assert sorted(told) == [('/Ask', ['changed']), ('/Go', ['moved', 'changed'])], found
    else:
        assert told == [(path.replace('#received', '#done'), kinds) for path, kinds in expected]


CONTAINER = """\
behavior: {name: Both, inputs: {place: {type: int}}}
concurrency:
  outcomes: [done]
  input_keys: [place]
  autonomy: high
  conditions: [{outcome: done, when: {A: done}}, {outcome: done, when: {B: done}}]
  states:
    A: {state: WaitState, timeout: {after: $limit}, transitions: {done: done}}
    B: {behavior: {use: Other, default_keys: [place]}, transitions: {done: done}}
"""


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('type: int', 'type: str'), ('input_keys: [place]', 'output_keys: [place]'), ('autonomy: high', 'autonomy: 0'),
        ('when: {A: done}', 'when: {A: failed}'), ('when: {B: done}', 'when: {B: failed}'), ('$limit', '$other'),
        ('default_keys: [place]', 'default_keys: [time]'),
    ],
)  # fmt: skip
def test_no_change_of_what_a_container_does_is_left_out(old: str, new: str) -> None:
    views = [YamlDocument(text).view() for text in (CONTAINER, CONTAINER.replace(old, new))]
    assert compared(*views)['changes']
    code = "with OperatableStateMachine(['done'], autonomy={}) as machine:\n    machine.add('A', WaitState(1.0))\n"
    views = [PythonDocument(code.format(level)).view() for level in ('Autonomy.High', 'Autonomy.Off')]
    assert compared(*views)['changes']


def test_large_and_deep_trees_are_compared_in_linear_time() -> None:
    """Rows of twice the length take about twice as long; four times would be a row compared with itself."""

    def seconds(count: int) -> float:
        deep = f'<root><BehaviorTree ID="A">{"<Inverter>" * 200}<Spin/>{"</Inverter>" * 200}</BehaviorTree></root>'
        row = deep.replace('<Spin/>', '<Sequence>' + '<Spin value="1"/>' * count + '</Sequence>')
        texts = [
            tree_text(3, count, names=False),
            tree_text(4, count, names=False),
            deep,
            row,
            row.replace('"1"', '"2"'),
        ]
        views = [XmlDocument(text).view() for text in texts]
        began = time.process_time()
        for before in views:
            for after in views:
                compared(before, after)
        return time.process_time() - began

    assert seconds(1600) < 10 * seconds(400)
