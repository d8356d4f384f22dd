# SPDX-License-Identifier: BSD-3-Clause
"""Reading XML: what is accepted, what is refused, and where the error is said to be."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeDocument, TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, LoadError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_testing.waiting import uncontended_time


class OpenDoor(StatefulAction):
    """Opens a door."""

    ports = {
        'door': input_port(STRING),
        'speed': input_port(DOUBLE, default='0.5'),
        'attempts': input_port(INT, optional=True),
        'angle': output_port(DOUBLE),
    }

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    def on_halted(self) -> None:
        pass


def registry() -> NodeRegistry:
    nodes = builtin_registry()
    nodes.register('OpenDoor', OpenDoor)
    return nodes


def wrap(body: str, id: str = 'Main') -> str:
    return f'<root BTCPP_format="4">\n<BehaviorTree ID="{id}">\n{body}\n</BehaviorTree>\n</root>'


def errors_of(text: str | bytes) -> tuple[LoadError, ...]:
    with pytest.raises(TreeLoadError) as caught:
        TreeLibrary([load_xml(text, 'file.xml', registry())])
    return caught.value.errors


# (why, document, line, column, words of the message)
REFUSED: list[tuple[str, str, int, int, str]] = [
    ('unknown node', wrap(' <OpenDor door="a"/>'), 3, 2, 'did you mean OpenDoor'),
    ('missing port', wrap('<OpenDoor/>'), 3, 1, 'port [door] of type std::string of [OpenDoor] is missing; add door='),
    ('unknown port', wrap('<OpenDoor door="a"\n   sped="1"/>'), 4, 4, 'did you mean [speed]'),
    ('bad literal', wrap('<OpenDoor door="a" speed="fast"/>'), 3, 20, "can't convert text 'fast' to double"),
    ('literal for an output', wrap('<OpenDoor door="a" angle="90"/>'), 3, 20, 'angle="{key}"'),
    ('unsigned port', wrap('<Delay delay_msec="-5"><AlwaysSuccess/></Delay>'), 3, 8, 'out of the range'),
    ('script', wrap('<Script code="a := 1 +"/>'), 3, 23, 'script of [code]: a value is missing here'),
    ('script with entities', wrap("<ScriptCondition code = 'a &amp;&amp;&#10; )'/>"), 3, 44, "found ')'"),
    (
        'script of several lines',
        wrap('<Precondition if="a\r\n &lt; $"><AlwaysSuccess/></Precondition>'),
        4,
        7,
        "'$' means",
    ),
    ('empty condition', wrap('<ScriptCondition code=""/>'), 3, 24, 'the script is empty'),
    ('pre-condition', wrap('<AlwaysSuccess _skipIf="a = 2 == "/>'), 3, 34, 'script of [_skipIf]'),
    ('post-condition of a sub-tree', wrap('<SubTree ID="Main2" _onSuccess=" "/>'), 3, 34, 'the script is empty'),
    ('decorator without child', wrap('<Inverter/>'), 3, 1, 'exactly 1 child, not 0'),
    (
        'decorator with two',
        wrap('<Inverter><AlwaysSuccess/><AlwaysSuccess/></Inverter>'),
        3,
        1,
        'exactly 1 child, not 2',
    ),
    ('control without children', wrap('<Sequence></Sequence>'), 3, 1, '1 child or more'),
    ('leaf with child', wrap('<AlwaysSuccess><AlwaysSuccess/></AlwaysSuccess>'), 3, 1, 'has no children'),
    ('sub-tree with child', wrap('<SubTree ID="X"><AlwaysSuccess/></SubTree>'), 3, 1, 'has no children'),
    ('unknown sub-tree', wrap('<SubTree ID="Nowhere"/>'), 3, 10, 'there is no tree [Nowhere]'),
    ('sub-tree without ID', wrap('<SubTree/>'), 3, 1, "needs the attribute 'ID'"),
    ('explicit form without ID', wrap('<Action name="a"/>'), 3, 1, "needs the attribute 'ID'"),
    ('compact form with ID', wrap('<AlwaysSuccess ID="a"/>'), 3, 16, 'not allowed'),
    ('bad autoremap', wrap('<SubTree ID="Main2" _autoremap="yes"/>'), 3, 21, "can't convert text 'yes' to bool"),
    ('direct recursion', wrap('<Inverter><SubTree ID="Main"/></Inverter>'), 3, 20, 'Main > Main'),
    ('tree named as a node', wrap('<AlwaysSuccess/>', id='Sequence'), 2, 15, 'is the name of a node type'),
    ('tree named Root', wrap('<AlwaysSuccess/>', id='Root'), 2, 15, 'reserved'),
    ('bad tree name', wrap('<AlwaysSuccess/>', id='a/b'), 2, 15, "'/'"),
    ('two roots in a tree', wrap('<AlwaysSuccess/><AlwaysSuccess/>'), 2, 1, 'exactly 1 root node, not 2'),
    ('empty tree', wrap(''), 2, 1, 'exactly 1 root node, not 0'),
    ('wrong root element', '<tree/>', 1, 1, 'root element'),
    ('no tree', '<root BTCPP_format="4"/>', 1, 1, 'no <BehaviorTree>'),
    (
        'unknown main tree',
        '<root BTCPP_format="4" main_tree_to_execute="B"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>',
        1,
        24,
        'its trees are: A',
    ),
    (
        'tree without ID',
        '<root BTCPP_format="4">\n<BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree>\n'
        '<BehaviorTree><AlwaysSuccess/></BehaviorTree></root>',
        3,
        1,
        "needs the attribute 'ID'",
    ),
    (
        'two asynchronous children of a reactive sequence',
        wrap(
            '<ReactiveSequence>\n<AsyncSequence><AlwaysSuccess/></AsyncSequence>\n'
            '<Control ID="AsyncSequence"><AlwaysSuccess/></Control>\n</ReactiveSequence>'
        ),
        5,
        1,
        'more than one AsyncSequence',
    ),
    (
        'include without a resolver',
        '<root BTCPP_format="4"><include path="other.xml"/></root>',
        1,
        24,
        'without a file system',
    ),
    # Not well formed
    ('unclosed element', wrap('<Sequence>\n<AlwaysSuccess/>'), 5, 1, 'does not close <Sequence>, opened at line 3'),
    ('unclosed at the end', '<root>\n <BehaviorTree>', 2, 2, 'never closed'),
    ('closes nothing', '<root/></root>', 1, 8, 'closes nothing'),
    ('attribute twice', wrap('<AlwaysSuccess name="a" name="b"/>'), 3, 25, 'given twice'),
    ('attribute without quotes', wrap('<AlwaysSuccess name=a/>'), 3, 16, 'not quoted'),
    ('attribute without value', wrap('<AlwaysSuccess name/>'), 3, 16, 'no value'),
    ('attribute never closed', wrap('<AlwaysSuccess name="a/>'), 3, 16, 'no closing quote'),
    ('no space between attributes', wrap('<AlwaysSuccess name="a"b="c"/>'), 3, 24, 'space is missing'),
    ('text outside', '<root/> text', 1, 9, 'outside'),
    ('text before', 'text <root/>', 1, 1, 'outside'),
    ('no element', '<!-- nothing -->', 1, 1, 'no element'),
    ('empty', '', 1, 1, 'no element'),
    ('unclosed comment', '<root>\n<!-- a </root>', 2, 1, 'comment is never closed'),
    ('comment that only begins', '<root>\n<!--></root>', 2, 1, 'comment is never closed'),
    ('not a name', '<root><1/></root>', 1, 7, 'not followed by the name'),
    # Hostile
    ('doctype', '<?xml version="1.0"?>\n<!DOCTYPE root [<!ENTITY a "b">]>\n<root/>', 2, 1, 'DOCTYPE'),
    ('entity declaration later', '<root>\n<!ENTITY a "b"></root>', 2, 1, 'refused'),
    ('zero character', wrap('<AlwaysSuccess name="a\x00"/>'), 3, 23, 'U+0000'),
    ('surrogate', wrap('<AlwaysSuccess name="\ud800"/>'), 3, 22, 'U+D800'),
]


@pytest.mark.parametrize(('why', 'text', 'line', 'column', 'words'), REFUSED, ids=[row[0] for row in REFUSED])
def test_refused_with_place_and_reason(why: str, text: str, line: int, column: int, words: str) -> None:
    errors = errors_of(text)
    assert any(words in error.message and (error.line, error.column) == (line, column) for error in errors), errors
    assert str(errors[0]).startswith('file.xml:')


def test_a_name_that_only_begins_as_another_one_is_no_slip_of_it() -> None:
    (error,) = errors_of(wrap('<OpenDrawer/>'))
    assert 'did you mean' not in error.message


def test_all_errors_are_reported_in_order_of_their_place() -> None:
    errors = errors_of(
        wrap('<Sequence>\n <Nope/>\n <OpenDoor sped="1"/>\n <Inverter/>\n <SubTree/>\n</Sequence>').replace(
            '</root>', '<BehaviorTree ID="Timeout"><Nope2/></BehaviorTree></root>'
        )
    )
    assert [(error.line, error.message.split(';')[0]) for error in errors] == [
        (4, 'node type [Nope] is not registered'),
        (5, 'port [door] of type std::string of [OpenDoor] is missing'),
        (5, '[OpenDoor] has no port [sped]'),
        (6, 'Decorator [Inverter] has exactly 1 child, not 0'),
        (7, "<SubTree> needs the attribute 'ID', the tree"),
        (10, '[Timeout] is the name of a node type, and cannot name a tree'),
        (10, 'node type [Nope2] is not registered'),
    ]
    assert errors[1].node == '<OpenDoor>'
    # Whose type it is: that of another project may be meant.
    assert errors[1].message.endswith(f'(the [OpenDoor] of {__name__})')
    assert errors[3].message.endswith('not 0')


@pytest.mark.parametrize('file', ['text', 'bytes'])
def test_columns_count_characters_of_the_file_as_the_user_sees_it(file: str) -> None:
    text = '\ufeff<root BTCPP_format="4">\r\n<BehaviorTree ID="M">\r\n  <!-- ä€😀 --> <Nope/>\r\n</BehaviorTree></root>'
    errors = errors_of(text.encode() if file == 'bytes' else text)
    assert (errors[0].line, errors[0].column) == (3, 16)


def test_what_is_not_utf_8_is_refused_at_its_place() -> None:
    text = wrap('<AlwaysSuccess name="ä-x"/>').encode().replace(b'-x', b'\xff\xfe')
    (error,) = errors_of(text)
    assert (error.line, error.column) == (3, 23)
    assert '0xff' in error.message


@pytest.mark.parametrize('encoding', ['utf-16', 'latin-1'])
def test_other_encodings_are_refused(encoding: str) -> None:
    errors = errors_of(wrap('<AlwaysSuccess name="ä"/>').encode(encoding))
    assert 'UTF-8' in errors[0].message


@pytest.mark.parametrize(
    'make',
    [
        lambda: wrap('<Sequence>' + '<AlwaysSuccess/>' * 700_000 + '</Sequence>'),
        lambda: b'\xff' * 10_000_000,
        lambda: '<' * 10_000_000,
        lambda: wrap('<Inverter>' * 300 + '<AlwaysSuccess/>' + '</Inverter>' * 300),
        lambda: '<root>' * 60_000,
        lambda: '<root ' + 'a="b" ' * 100_000,
        lambda: '<root a="' + '&amp' * 200_000,
        lambda: wrap('<AlwaysSuccess name="' + '&#' * 400_000 + '"'),
        lambda: '<root ' + ' ' * 1_000_000,
        lambda: wrap(f'<Repeat num_cycles="{"9" * 900_000}"><AlwaysSuccess/></Repeat>'),
        lambda: wrap(f'<{"A" * 900_000}/>'),
        lambda: wrap(f'<Repeat {"n" * 900_000}="1"><AlwaysSuccess/></Repeat>'),
    ],
    ids=['10 MB of nodes', '10 MB of bytes', '10 MB of <', '300 deep', 'no end', 'many attributes', 'entity',
         'references', 'spaces', 'digits', 'long tag', 'long port'],
)  # fmt: skip
def test_hostile_documents_are_refused_within_a_second(make: Callable[[], str | bytes]) -> None:
    text = make()
    start = uncontended_time()
    errors = errors_of(text)
    assert uncontended_time() - start < 1.0
    assert errors
    assert len(str(errors[0])) < 1000


def test_depth_of_256_is_the_limit() -> None:
    def nested(depth: int) -> str:
        return wrap('<Inverter>' * depth + '<AlwaysSuccess/>' + '</Inverter>' * depth)

    tree = Tree(TreeLibrary([load_xml(nested(255), 'file.xml', registry())]), 'Main')
    assert tree.tick_once() is NodeStatus.FAILURE
    (error,) = errors_of(nested(256))
    assert 'nested more than 256 deep' in error.message
    assert (error.line, error.column) == (3, 256 * len('<Inverter>') + 1)


def test_a_tree_that_explodes_through_its_sub_trees_is_refused() -> None:
    trees = ''.join(
        f'<BehaviorTree ID="T{level}"><Sequence>'
        + ''.join(f'<SubTree ID="T{level + 1}" name="s{index}"/>' for index in range(10))
        + '</Sequence></BehaviorTree>'
        for level in range(30)
    )
    text = f'<root BTCPP_format="4">{trees}<BehaviorTree ID="T30"><AlwaysSuccess/></BehaviorTree></root>'
    start = uncontended_time()
    (error,) = errors_of(text)
    assert uncontended_time() - start < 1.0
    assert 'the limit is 65535' in error.message


def test_indirect_recursion_names_the_way() -> None:
    trees = {'A': 'B', 'B': 'C', 'C': 'B'}
    body = ''.join(f'<BehaviorTree ID="{id}">\n<SubTree ID="{to}"/></BehaviorTree>' for id, to in trees.items())
    (error,) = errors_of(f'<root BTCPP_format="4">{body}</root>')
    assert '(B > C > B)' in error.message
    assert error.line == 4


# Accepted, though strict XML would refuse or alter it; the value that the name has then.
LENIENT = [
    ('a && b < c > d', 'a && b < c > d'),
    ('&lt;&gt;&amp;&quot;&apos;&#65;&#x42;', '<>&"\'AB'),
    ('&unknown; &amp &#0; &#xD800;', '&unknown; &amp &#0; &#xD800;'),
    ('two\r\nlines\tand\rmore', 'two\nlines\tand\nmore'),
]


@pytest.mark.parametrize(('written', 'value'), LENIENT)
def test_attribute_values_are_read_as_btcpp_does(written: str, value: str) -> None:
    document = load_xml(wrap(f"<AlwaysSuccess\n name = '{written.replace(chr(39), '&apos;')}'\n/>"), 'f', registry())
    assert document.trees['Main'].root.name == value


def test_what_btcpp_ignores_is_ignored() -> None:
    text = (
        '\ufeff<?xml version="1.0" encoding="latin-1"?><!-- c > c --><root BTCPP_format="4" other="1">'
        '<Unknown ID="x"/><BehaviorTree ID="A" extra="1">text<!--> <x/> --><!---> <x/> --><![CDATA[<x>]]><?pi <a?>'
        '<AlwaysSuccess _description="d" _uid="3"/></BehaviorTree><TreeNodesModel><Whatever/></TreeNodesModel></root >'
        '<root/><!-- end -->'
    )
    document = load_xml(text, 'f', registry())
    assert document.trees['A'].root.extra == {'_description': 'd', '_uid': '3'}
    assert document.main == 'A'
    assert 'ignored' in document.warnings[0].message


def test_explicit_and_compact_form_are_the_same() -> None:
    text = wrap('<Control ID="ReactiveSequence"><Action ID="AlwaysSuccess"/><Condition ID="AlwaysSuccess"/></Control>')
    tree = Tree(TreeLibrary([load_xml(text, 'f', registry())]), 'Main')
    assert [node.id for node in tree.nodes] == ['ReactiveSequence', 'AlwaysSuccess', 'AlwaysSuccess']
    assert [node.path for node in tree.nodes] == ['ReactiveSequence::1', 'AlwaysSuccess::2', 'AlwaysSuccess::3']


def test_the_later_of_two_trees_with_one_name_counts() -> None:
    text = wrap('<AlwaysSuccess/>').replace('</root>', '<BehaviorTree ID="Main"><AlwaysFailure/></BehaviorTree></root>')
    document = load_xml(text, 'f', registry())
    assert document.trees['Main'].root.manifest.id == 'AlwaysFailure'
    assert 'replaced' in document.warnings[0].message


def test_a_file_without_format_is_read_with_a_warning() -> None:
    document = load_xml('<root><BehaviorTree><AlwaysSuccess/></BehaviorTree></root>', 'f', registry())
    assert document.main == 'BehaviorTree_0'
    assert 'BTCPP_format' in document.warnings[0].message


class Files:
    """A file system for includes."""

    def __init__(self, **files: str) -> None:
        self.files = files
        self.asked: list[tuple[str, str | None, str]] = []

    def __call__(self, path: str, package: str | None, including: str) -> tuple[str, str]:
        self.asked.append((path, package, including))
        if path not in self.files:
            raise FileNotFoundError(f'no such file: {path}')
        return path, self.files[path]

    def load(self, text: str) -> TreeDocument:
        return load_xml(text, 'main.xml', registry(), include=self)


def test_includes_are_resolved_by_the_host_and_own_trees_win() -> None:
    files = Files(
        door=wrap('<AlwaysFailure/>', id='Door').replace(
            '</root>', '<include path="more"/><BehaviorTree ID="Main"><AlwaysFailure/></BehaviorTree></root>'
        ),
        more=wrap('<AlwaysFailure/>', id='More'),
    )
    document = files.load(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><include ros_pkg="p" path="door"/>'
        '<BehaviorTree ID="Main"><SubTree ID="Door"/></BehaviorTree></root>'
    )
    assert set(document.trees) == {'Door', 'More', 'Main'}
    assert document.trees['Main'].source.file == 'main.xml'
    assert document.trees['Door'].source.file == 'door'
    assert files.asked == [('door', 'p', 'main.xml'), ('more', None, 'door')]
    assert Tree(TreeLibrary([document]), 'Main').tick_once() is NodeStatus.FAILURE


def test_a_model_is_that_of_the_tree_in_its_own_document() -> None:
    def document(file: str, port: str) -> TreeDocument:
        ports = f'<input_port name="{port}" default="1"/><input_port name="{port}_needed"/>'
        door = f'<BehaviorTree ID="Door"><ScriptCondition code="{port} == {port}_needed"/></BehaviorTree>'
        return load_xml(
            f'<root BTCPP_format="4"><BehaviorTree ID="{file}"><SubTree ID="Door" {port}_needed="1"/></BehaviorTree>'
            f'{door}<TreeNodesModel><SubTree ID="Door">{ports}</SubTree></TreeNodesModel></root>',
            file,
            registry(),
        )

    documents = [document('one', 'x'), document('two', 'y')]
    for library in (TreeLibrary(documents), TreeLibrary(documents[::-1])):
        assert [Tree(library, file).tick_once() for file in ('one', 'two')] == [NodeStatus.SUCCESS] * 2
    away = load_xml(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><SubTree ID="Far"/></BehaviorTree><TreeNodesModel>'
        '<SubTree ID="Far"><input_port name="x" default="1"/></SubTree></TreeNodesModel></root>',
        'away',
        registry(),
    )
    far = load_xml(wrap('<ScriptCondition code="x == 1"/>', id='Far'), 'far', registry())
    assert Tree(TreeLibrary([away, far]), 'Main').tick_once() is NodeStatus.SUCCESS


def test_models_of_one_tree_have_the_ports_of_all_of_them() -> None:
    def model(**defaults: str) -> str:
        ports = ''.join(f'<input_port name="{name}" default="{value}"/>' for name, value in defaults.items())
        return f'<SubTree ID="Door">{ports}</SubTree>'

    door = f'<root BTCPP_format="4"><TreeNodesModel>{model(x="1", y="2")}</TreeNodesModel></root>'
    models = f'<TreeNodesModel>{model(y="3")}{model(z="4")}</TreeNodesModel>'
    document = Files(door=door).load(f'<root BTCPP_format="4"><include path="door"/>{models}</root>')
    assert {name: port.default for name, port in document.models['Door'].items()} == {'x': '1', 'y': '3', 'z': '4'}


@pytest.mark.parametrize(
    ('files', 'file', 'words'),
    [
        ({}, 'main.xml', 'no such file: a'),
        ({'a': '<root>\n<include path="a"/></root>'}, 'a', 'included by itself'),
        ({'a': '<root>\n<include path="b"/></root>', 'b': '<root>\n<include path="a"/></root>'}, 'b', 'by itself'),
        ({'a': wrap('<Nope/>')}, 'a', 'not registered'),
        ({'a': '<root>\n<include/></root>'}, 'a', "needs the attribute 'path'"),
    ],
)
def test_bad_includes_are_refused(files: dict[str, str], file: str, words: str) -> None:
    with pytest.raises(TreeLoadError) as caught:
        Files(**files).load('<root BTCPP_format="4">\n<include path="a"/></root>')
    (error,) = caught.value.errors
    assert error.file == file
    assert words in error.message


def test_includes_cannot_explode() -> None:
    files = Files(
        **{f'f{level}': f'<root>{f"<include path={chr(34)}f{level + 1}{chr(34)}/>" * 5}</root>' for level in range(20)}
    )
    start = uncontended_time()
    with pytest.raises(TreeLoadError, match='more than 100 files'):
        files.load('<root><include path="f0"/></root>')
    assert uncontended_time() - start < 1.0


PIECES = st.sampled_from(
    ['<', '>', '/', '=', '"', "'", '&', ';', '!', '?', '-', '[', ']', ' ', '\n', 'a', '{', '}', 'root', 'BehaviorTree',
     'Sequence', 'AlwaysSuccess', 'SubTree', 'ID', 'name', '<!--', '-->', '<![CDATA[', ']]>', '<?', '?>', '</', '/>',
     '<!DOCTYPE', '&#', 'include', 'TreeNodesModel', '\x00', 'ä', '{=}', 'num_cycles', 'Repeat']
)  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(st.one_of(st.text(max_size=60), st.lists(PIECES, max_size=60).map(''.join), st.binary(max_size=60)))
def test_whatever_is_read_gives_a_document_or_load_errors(text: str | bytes) -> None:
    try:
        TreeLibrary([load_xml(text, 'f', registry())])
    except BehaviorTreeError as error:
        assert isinstance(error, TreeLoadError)
        assert all(item.line >= 1 and item.column >= 1 for item in error.errors)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 400), st.sampled_from(['', '<', '>', '"', '/', '&', '\x00', '</Sequence>', 'ID="x" ']))
def test_damaged_documents_give_load_errors_or_load(position: int, damage: str) -> None:
    text = wrap(
        '<Sequence name="s">\n<OpenDoor door="a" angle="{angle}"/><SubTree ID="Sub" p="{q}"/></Sequence>'
    ).replace(
        '</root>', '<BehaviorTree ID="Sub"><Repeat num_cycles="2"><AlwaysSuccess/></Repeat></BehaviorTree></root>'
    )
    position %= len(text)
    with contextlib.suppress(TreeLoadError):
        TreeLibrary([load_xml(text[:position] + damage + text[position + 1 :], 'f', registry())])
