# SPDX-License-Identifier: BSD-3-Clause
"""Blackboard scopes and types, and the ports of nodes. The tables are those of BehaviorTree.CPP."""

from __future__ import annotations

import math
import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import (
    BlackboardError,
    ConversionError,
    NodeExecutionError,
    PortError,
    RegistrationError,
    TreeLoadError,
)
from flexbt_core.behavior_tree.model.ports import (
    ANY,
    BOOL,
    DOUBLE,
    INT,
    INT64,
    KEY,
    NODE_STATUS,
    STRING,
    UINT8,
    UINT64,
    UNSIGNED,
    Port,
    PortType,
    cast,
    inout_port,
    input_port,
    list_of,
    number_from_text,
    output_port,
    pointer_key,
    separated,
    type_of,
)
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml

REFUSED = 'refused'

# What an entry that first took the value of the row takes then.
WRITES: list[tuple[Any, dict[Any, Any]]] = [
    (1, {5: 5, 2.0: 2, 2.5: REFUSED, '7': 7, '7.5': 7, 'abc': REFUSED, True: 1}),
    (0.5, {5: 5.0, 2.0: 2.0, 2.5: 2.5, '7': 7.0, '7.5': 7.5, 'abc': REFUSED, True: 1.0}),
    (False, {5: REFUSED, 2.0: REFUSED, 2.5: REFUSED, '7': REFUSED, 'abc': REFUSED, 'true': True, True: True}),
    ('text', {5: 5, 2.0: 2.0, 2.5: 2.5, '7': '7', 'abc': 'abc', True: True}),
]


@pytest.mark.parametrize(
    ('first', 'second', 'result'), [(first, second, result) for first, row in WRITES for second, result in row.items()]
)
def test_second_write(first: Any, second: Any, result: Any) -> None:
    board = Blackboard()
    board.set('k', first)
    if result is REFUSED:
        with pytest.raises(BlackboardError, match='k'):
            board.set('k', second)
        assert board.get('k') == first
        assert board.entry('k').sequence == 1  # type: ignore[union-attr]
    else:
        board.set('k', second)
        assert board.get('k') == result
        assert type(board.get('k')) is type(result)
        assert board.entry('k').sequence == 2  # type: ignore[union-attr]


def test_second_text_makes_an_entry_text() -> None:
    board = Blackboard()
    board.set('k', 'a')
    board.set('k', 'b')
    for value in (5, 2.5, True):
        with pytest.raises(BlackboardError, match='has the type'):
            board.set('k', value)


def test_scopes() -> None:
    root = Blackboard()
    middle, leaf = Blackboard(root), None
    middle.remap('in', 'out')
    leaf = Blackboard(middle)
    leaf.enable_autoremap()
    leaf.set('in', 5)
    assert root.keys() == ['out']
    assert leaf.get('in') == middle.get('in') == root.get('out') == 5
    leaf.set('_private', 1)
    assert leaf.keys() == ['_private']
    leaf.set('local', 2)
    assert middle.keys() == ['local']
    leaf.set('@global', 3)
    assert root.get('global') == middle.get('@global') == 3
    assert 'global' not in middle
    with pytest.raises(BlackboardError, match='missing key'):
        middle.get('global')
    middle.remap('far', '@global')
    assert leaf.get('far') == 3
    middle.remap('later', '@made')
    leaf.set('later', 'x')
    assert root.get('made') == 'x'


def test_text_through_a_remapping_is_not_converted_but_readers_convert_it() -> None:
    root = Blackboard()
    child = Blackboard(root)
    child.remap('k', 'n')
    root.set('n', 3)
    child.set('k', '7')
    assert root.get('n') == '7'
    with pytest.raises(BlackboardError, match='int'):
        child.set('k', 2.5)


def test_unset_removes_only_the_own_entry() -> None:
    root = Blackboard()
    child = Blackboard(root)
    child.remap('k', 'k')
    root.set('k', 1)
    child.unset('k')
    assert root.get('k') == 1
    root.unset('k')
    assert root.get_or('k', 'gone') == 'gone'
    root.set('k', 'other type is fine now')


def test_declared_entries_have_a_type_and_no_value() -> None:
    board = Blackboard()
    board.declare('k', INT)
    assert 'k' in board
    assert board.snapshot() == {}
    with pytest.raises(BlackboardError, match='never written'):
        board.get('k')
    with pytest.raises(BlackboardError, match='type'):
        board.declare('k', DOUBLE)
    board.set('k', '12abc')
    assert board.get('k') == 12


def test_object_entries_keep_their_class() -> None:
    board = Blackboard()
    board.set('k', [1])
    board.set('k', [2])
    with pytest.raises(BlackboardError, match='list'):
        board.set('k', {'a': 1})
    with pytest.raises(BlackboardError, match='list'):
        board.set('k', 'text')


def test_concurrent_writers_lose_nothing() -> None:
    board = Blackboard()

    def write() -> None:
        child = Blackboard(board)
        for number in range(500):
            child.set('@k', number)

    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    entry = board.entry('k')
    assert entry is not None
    assert entry.sequence == 2000


NO = ConversionError


@pytest.mark.parametrize(
    ('value', 'kind', 'result'),
    [
        ('42', INT, 42), ('-3x', INT, -3), ('7.9', INT, 7), ('+5', INT, NO), (' 5', INT, NO), ('', INT, NO),
        ('0x10', INT, 0), (str(2**31), INT, NO), (str(2**31), INT64, 2**31), ('-1', UNSIGNED, NO), ('256', UINT8, NO),
        (str(2**64 - 1), UINT64, 2**64 - 1), ('1' * 5000, UINT64, NO), ('0' * 5000 + '7', INT, 7),
        ('2.5', DOUBLE, 2.5), ('1e3x', DOUBLE, 1000.0), ('inf', DOUBLE, math.inf), ('-nan', DOUBLE, math.nan),
        ('x', DOUBLE, NO),
        ('true', BOOL, True), ('FALSE', BOOL, False), ('1', BOOL, True), ('2', BOOL, NO), ('yes', BOOL, NO),
        (5, DOUBLE, 5.0), (2**53, DOUBLE, NO), (2.0, INT, 2), (2.5, INT, NO), (math.inf, INT, NO), (math.nan, INT, NO),
        (3e9, INT, NO), (-1, UNSIGNED, NO), (1, BOOL, True), (2, BOOL, NO), (0.5, BOOL, True), (-0.5, BOOL, NO),
        (True, INT, 1), (True, STRING, '1'), (7, STRING, '7'), (2.5, STRING, '2.500000'), ([], STRING, NO),
        (None, INT, NO),
        ('1;2;3', list_of(INT), [1, 2, 3]), ('', list_of(INT), []), ('a;;b;', list_of(STRING), ['a', '', 'b']),
        ('1;x', list_of(INT), NO), ([1], list_of(INT), [1]), (5, list_of(INT), NO),
    ],
)  # fmt: skip
def test_conversions(value: Any, kind: PortType, result: Any) -> None:
    if result is NO:
        with pytest.raises(ConversionError):
            cast(value, kind)
    else:
        converted = cast(value, kind)
        assert converted == result or (math.isnan(converted) and math.isnan(result))
        assert type(converted) is type(result)


@given(st.one_of(st.integers(-(2**70), 2**70), st.floats(), st.booleans(), st.text(max_size=30)))
def test_every_conversion_gives_the_type_or_an_error_of_ours(value: Any) -> None:
    for kind in (INT, INT64, UINT8, UNSIGNED, UINT64, DOUBLE, BOOL, STRING):
        try:
            converted = cast(value, kind)
        except ConversionError:
            continue
        assert type(converted) is kind.python_type
        assert cast(converted, kind) == converted or math.isnan(converted)


OUT_OF_INT = 'is out of the range of int, -2147483648 to 2147483647'


@pytest.mark.parametrize(
    ('value', 'kind', 'message'),
    [
        ('+5', INT, "can't convert text '+5' to int"),
        (str(2**31), INT, f'2147483648 {OUT_OF_INT}'),
        (3e9, INT, f'3000000000 {OUT_OF_INT}'),
        ('9' * 20, UINT64, f'{"9" * 20} is out of the range of uint64_t, 0 to {2**64 - 1}'),
        ('9' * 21, UINT64, f"can't convert text '{'9' * 21}' to uint64_t"),
        (2.5, INT, '2.5 is not an integer, and cannot be read as int'),
        (None, INT, 'no safe conversion from NoneType to int'),
        ('x', DOUBLE, "can't convert text 'x' to double"),
        ('1e999', DOUBLE, 'the number 1e999 does not fit into a double'),
        (2**53, DOUBLE, 'loss of precision when the integer 9007199254740992 is read as double'),
        ('2', BOOL, "can't convert text '2' to bool; write one of 0 false False FALSE 1 true True TRUE"),
        (2, BOOL, 'of the integers only 0 and 1 can be read as bool, not 2'),
        (-0.5, BOOL, 'a negative number cannot be read as bool: -0.5'),
        ('1;x', list_of(INT), "can't convert text 'x' to int"),
        ('json:{}', list_of(INT), "'{}' is not a list of JSON"),
        ('json:["a"]', list_of(INT), "'a' is not of type int"),
        ('json:[1', list_of(INT), "can't convert text 'json:[1' to std::vector<int>: Expecting ',' delimiter: "
         'line 1 column 3 (char 2)'),
        ('json:' + '[' * 501, list_of(INT), 'nested more than 500 deep'),
        ('?', NODE_STATUS, "'?' is not a status; write one of IDLE RUNNING SUCCESS FAILURE SKIPPED"),
        ('', KEY, "can't convert text '' to key: a key cannot be empty"),
        ('a', ANY, 'an entry that may hold anything does not say what a text means'),
        ('a', PortType('pose', int), 'pose cannot be written as text'),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_converted_is_refused_with_the_reason(value: Any, kind: PortType, message: str) -> None:
    with pytest.raises(ConversionError) as caught:
        kind.parse(value) if isinstance(value, str) else cast(value, kind)
    assert str(caught.value) == message


POSE = PortType('pose', object)
LIST = PortType('list', list)


@pytest.mark.parametrize(
    ('declared', 'held', 'value', 'message'),
    [
        (POSE, EMPTY, 'a', 'has the type pose, which cannot be changed; it was now used as std::string'),
        (INT, EMPTY, 2.5, 'has the type int, which cannot be changed; it was now used as double: '
         '2.5 is not an integer, and cannot be read as int'),
        (STRING, EMPTY, 5, 'has the type std::string, which cannot be changed; it was now used as int'),
        (BOOL, EMPTY, 5, 'has the type bool, which cannot be changed; it was now used as int'),
        (POSE, EMPTY, 5, 'has the type pose, which cannot be changed; it was now used as int'),
        (INT, '7', 3, "of type int holds '7', and so does not take 3; it has to be removed first"),
        (STRING, 5, 'a', "of type std::string holds 5, and so does not take 'a'; it has to be removed first"),
        (LIST, 2.5, [1], 'of type list holds 2.5, and so does not take [1]; it has to be removed first'),
        (LIST, 1, [1], 'of type list holds 1, and so does not take [1]; it has to be removed first'),
    ],
)  # fmt: skip
def test_a_write_that_an_entry_does_not_take_names_both(
    declared: PortType, held: Any, value: Any, message: str
) -> None:
    board = Blackboard()
    board.declare('k', declared).value = held
    with pytest.raises(BlackboardError) as caught:
        board.set('k', value)
    assert str(caught.value) == f'entry [k] {message}'
    assert not caught.value.is_absent


def test_what_is_not_there_is_named() -> None:
    board = Blackboard()
    with pytest.raises(BlackboardError) as missing:
        board.get('k')
    board.declare('k', INT)
    with pytest.raises(BlackboardError) as empty:
        board.get('k')
    messages = ['missing key [k]', 'entry [k] was declared but never written']
    assert [str(missing.value), str(empty.value)] == messages
    assert missing.value.is_absent and empty.value.is_absent
    with pytest.raises(BlackboardError, match=r'^entry \[n\]: the integer 1180591620717411303424 does not fit into 64'):
        board.set('n', 2**70)
    for value, kind, shown in ((2.5, DOUBLE, 'double'), (EMPTY, None, 'one without a type')):
        with pytest.raises(BlackboardError, match=rf'^entry \[k\] has the type int, .*; it was now used as {shown}$'):
            board.put('k', value, kind)


@pytest.mark.parametrize(
    ('text', 'key'),
    [
        ('{k}', 'k'), ('  {k} ', 'k'), ('{ k }', ' k '), ('{=}', 'port'), ('=', 'port'), ('{}', None), ('k', None),
        ('{k', None), ('\t{k}', None), ('{@k}', '@k'), ('', None), ('{a}{b}', 'a}{b'),
    ],
)  # fmt: skip
def test_pointers(text: str, key: str | None) -> None:
    assert pointer_key(text, 'port') == key


class Probe(SyncAction):
    """Reads and writes its ports as the test says."""

    ports = {
        'number': input_port(INT, default='7'),
        'text': input_port(STRING, optional=True),
        'any': input_port(optional=True),
        'numbers': input_port(list_of(INT), default='1;2'),
        'real': inout_port(DOUBLE, optional=True),
        'result': output_port(INT),
        'echo': output_port(STRING, default='{=}'),
    }
    todo: Any = None

    def tick(self) -> NodeStatus:
        self.todo(self)
        return NodeStatus.SUCCESS


def probe(attributes: str, board: Blackboard | None = None) -> Probe:
    registry = builtin_registry()
    registry.register('Probe', Probe)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M"><Probe name="p" {attributes}/></BehaviorTree></root>'
    node = Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'M', blackboard=board).root
    assert isinstance(node, Probe)
    return node


def test_inputs() -> None:
    board = Blackboard()
    board.set('s', '12')
    board.set('x', 2.0)
    assert probe('').get_input('number') == 7
    assert probe('number="3"').get_input('number') == 3
    assert probe('number="{s}"', board).get_input('number') == 12
    assert probe('text="{x}"', Blackboard(board)).get_input_or('text', 'none') == 'none'
    assert probe('any="{x}"', board).get_input('any') == 2.0
    assert probe('any="5"').get_input('any') == '5'
    with pytest.raises(TreeLoadError, match=r'entry \[x\] with the type std::string, but it has the type double'):
        probe('text="{x}"', board)
    board.declare('free', None)
    with pytest.raises(TreeLoadError, match=r'port \[text\] uses the blackboard entry \[x\]'):
        probe('number="{free}" text="{x}"', board)  # a port before it fits
    node = probe('')
    # Each read of a list gives a new one: nobody can change it for the others.
    node.get_input('numbers').append(3)
    assert node.get_input('numbers') == [1, 2]
    assert node.get_input_or('text', 'none') == 'none'


def test_port_errors_name_node_port_and_key() -> None:
    node = probe('number="{n}" real="2.5"')
    for call, port, reason in (
        (lambda: node.get_input('number'), 'number', 'the entry was never written'),
        (lambda: node.get_input('text'), 'text', 'it is not given in the XML, and has no default'),
        (lambda: node.get_input('nonsense'), 'nonsense', 'Probe declares no such port'),
        (lambda: node.get_input('result'), 'result', 'it is not declared as an input'),
        (lambda: node.set_output('number', 1), 'number', 'it is not declared as an output'),
        (
            lambda: node.set_output('real', 1.0),
            'real',
            "an output has to point to the blackboard, as in {key}, not '2.5'",
        ),
        (lambda: node.set_output('nonsense', 1.0), 'nonsense', 'Probe declares no such port'),
        (lambda: node.port_key('nonsense'), 'nonsense', 'Probe declares no such port'),
    ):
        with pytest.raises(PortError) as caught:
            call()
        error = caught.value
        assert error.key == ('n' if port == 'number' else None)
        shown = '' if error.key is None else f' (blackboard key [{error.key}])'
        assert str(error) == f'port [{port}]{shown} of Probe at [p]: {reason}'
        assert (error.node_path, error.node_id, error.port, error.uid) == ('p', 'Probe', port, 1)
        assert error.is_absent is reason.endswith('written')
    node.blackboard.unset('n')
    node.blackboard.set('n', '99999999999')
    with pytest.raises(PortError, match='out of the range'):
        node.get_input('number')
    node.blackboard.unset('n')
    with pytest.raises(PortError, match=r': the blackboard has no such entry$') as caught:
        node.get_input('number')
    assert (caught.value.port, caught.value.is_absent) == ('number', True)
    node.blackboard.set('n', 4)
    assert node.get_input('number') == 4


def test_outputs() -> None:
    node = probe('result="{r}" real="{x}"')
    node.set_output('result', 2.0)
    assert node.blackboard.get('r') == 2
    assert type(node.blackboard.get('r')) is int
    with pytest.raises(PortError, match='not an integer'):
        node.set_output('result', 2.5)
    with pytest.raises(PortError, match='out of the range'):
        node.set_output('result', 2**31)
    node.set_output('real', 3)
    assert node.get_input('real') == 3.0
    node.set_output('echo', 'hello')
    assert node.blackboard.get('echo') == 'hello'
    # Not given, and no default: not written.
    probe('').set_output('result', 1)


def test_an_entry_has_one_type_in_all_nodes_of_a_tree() -> None:
    registry = builtin_registry()
    registry.register('Probe', Probe)
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence>\n<Probe number="{k}"/>\n<SubTree ID="S" inner="{k}"/>\n'
        '<Probe real="{k}"/></Sequence></BehaviorTree>\n'
        '<BehaviorTree ID="S">\n<Probe real="{inner}"/></BehaviorTree></root>'
    )
    with pytest.raises(TreeLoadError) as caught:
        Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'M')
    assert [(error.line, error.column) for error in caught.value.errors] == [(6, 8), (4, 8)]
    assert 'inner' in caught.value.errors[0].message


def test_port_errors_within_a_tick_are_errors_of_the_node() -> None:
    node = probe('number="{n}"')
    node.todo = lambda self: self.get_input('number')
    with pytest.raises(NodeExecutionError, match=r'in node \[p\] \(Probe\): PortError') as caught:
        node.execute()
    assert isinstance(caught.value.__cause__, PortError)


@pytest.mark.parametrize('at_fault', ['<Probe number="{n}"/>', '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'])
def test_a_port_error_within_a_tick_has_the_node_and_its_ancestors(at_fault: str) -> None:
    registry = builtin_registry()
    registry.register('Probe', Probe)
    body = f'<Sequence name="s">{at_fault}</Sequence>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="M">{body}</BehaviorTree></root>'
    tree = Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'M')
    node = tree.nodes[1]
    if isinstance(node, Probe):
        node.todo = lambda self: self.get_input('number')
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    assert (caught.value.uid, caught.value.trace.chain) == (node.uid, ('s', node.path))


@pytest.mark.parametrize(
    ('name', 'port', 'words'),
    [
        ('name', input_port(INT), "'name' is a reserved attribute name"),
        ('', input_port(INT), 'a port name cannot be empty'),
        ('n', input_port(INT, default='x'), "the default does not fit the type: can't convert text 'x' to int"),
        ('n', output_port(INT, default='3'), "the default of an output has to be a pointer, as in {key}, not '3'"),
        ('n', 'no port', "'no port' is not a Port; use input_port, output_port or inout_port"),
    ],
)
def test_bad_ports_are_refused_at_registration(name: str, port: Port, words: str) -> None:
    class Bad(SyncAction):
        ports = {name: port}

        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS

    with pytest.raises(RegistrationError) as caught:
        builtin_registry().register('Bad', Bad)
    assert str(caught.value) == f'node ID [Bad], port [{name}]: {words}'


def test_bad_registrations_are_refused() -> None:
    class Abstract(SyncAction):
        pass

    registry = builtin_registry()
    taken = 'is registered already, for flexbt_core.behavior_tree.nodes.sequences.Sequence; choose another ID'
    derive = 'derive it from SyncAction, StatefulAction, Condition, Decorator or Control'
    for id, node_class, words in [
        ('Sequence', Probe, f' {taken}'),
        ('Root', Probe, ": 'Root' is a reserved name"),
        ('Abstract', Abstract, f': {Abstract.__qualname__} does not implement tick'),
        ('Number', int, f": <class 'int'> is not a node class; {derive}"),
    ]:
        with pytest.raises(RegistrationError) as caught:
            registry.register(id, node_class)
        assert str(caught.value) == f'node ID [{id}]{words}'
    assert len(registry) == len(builtin_registry())


def test_sub_tree_ports_constants_models_and_autoremap() -> None:
    registry = builtin_registry()
    registry.register('Probe', Probe)
    text = """<root BTCPP_format="4" main_tree_to_execute="M">
    <BehaviorTree ID="M"><Sequence>
      <SubTree ID="S" name="given" number="{n}" text="hello"/>
      <SubTree ID="S" name="auto" _autoremap="true" text="5"/>
    </Sequence></BehaviorTree>
    <BehaviorTree ID="S"><Probe number="{number}" text="{text}" result="{result}" any="{_private}"/></BehaviorTree>
    <TreeNodesModel><SubTree ID="S"><input_port name="number"/><output_port name="result" default="{of_model}"/>
    </SubTree></TreeNodesModel></root>"""
    tree = Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'M')
    boards = {subtree.path: subtree.blackboard for subtree in tree.subtrees}
    assert list(boards) == ['', 'given', 'auto']
    first, second = (node for node in tree.nodes if isinstance(node, Probe))
    tree.blackboard.set('n', 1)
    tree.blackboard.set('number', 2)
    assert first.get_input('number') == 1
    assert second.get_input('number') == 2
    assert first.get_input('text') == 'hello'
    assert second.get_input('text') == '5'
    assert 'text' not in tree.blackboard
    first.set_output('result', 10)
    second.set_output('result', 20)
    assert tree.blackboard.get('of_model') == 10
    assert tree.blackboard.get('result') == 20
    second.blackboard.set('_private', 1)
    assert '_private' not in tree.blackboard
    with pytest.raises(TreeLoadError) as caught:
        TreeLibrary([load_xml(text.replace('number="{n}"', ''), 'f', registry)])
    reason = 'the model of [S] declares the port [number]; add number="{key}"'
    assert str(caught.value) == f"f:3:7: <SubTree 'given'>: {reason}"


def test_a_converter_of_the_host_that_raises_is_a_load_error() -> None:
    class Posed(SyncAction):
        ports = {'pose': input_port(PortType('Pose', tuple, from_text=lambda text: (float(text),)))}

        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS

    registry = builtin_registry()
    registry.register('Posed', Posed)
    with pytest.raises(TreeLoadError, match=r"f:1:52: <Posed>: port \[pose\] of type Pose: can't convert text 'here'"):
        load_xml(
            '<root BTCPP_format="4"><BehaviorTree ID="M"><Posed pose="here"/></BehaviorTree></root>', 'f', registry
        )


def test_a_scope_with_keys_of_its_own_shares_all_others() -> None:
    shared = Blackboard()
    shared.set('code', 1)
    first, second = shared.with_own(['code', 'count']), shared.with_own(['code', 'count'])
    first.set('code', 'a text')  # of its own type, too
    first.set('count', 3)
    assert 'code' not in second and 'count' not in second and shared.get('code') == 1
    child = Blackboard(first)
    child.set('@path', [1])  # the topmost scope of what is below
    child.set('@count', 4)
    first.set('_private', 2)
    assert (first.get('count'), second.get('path'), shared.get('path'), shared.get('_private')) == (4, [1], [1], 2)
    assert sorted(first) == ['_private', 'code', 'count', 'path'] and sorted(shared) == ['_private', 'code', 'path']
    first.unset('count')
    assert sorted(first) == ['_private', 'code', 'path']
    second.unset('path')
    assert 'path' not in shared and first.lock is shared.lock


def test_the_outermost_scope_of_a_key_is_found_through_remappings_but_not_for_private_keys() -> None:
    root = Blackboard()
    middle = Blackboard(root)
    middle.remap('given', 'found')
    middle.enable_autoremap()
    inner = Blackboard(middle)
    inner.remap('port', 'given')
    middle.set('_private', 1)
    inner.set('own', 1)
    scopes = {
        (inner, 'own'): (inner, 'own'),
        (inner, 'other'): (inner, 'other'),
        (inner, 'port'): (root, 'found'),
        (inner, '@top'): (root, 'top'),
        (middle, 'any'): (root, 'any'),
        (middle, '_private'): (middle, '_private'),
        (middle, '_new'): (middle, '_new'),
    }
    assert {place: place[0].outermost(place[1]) for place in scopes} == scopes


def test_a_key_leads_to_the_root_once() -> None:
    with pytest.raises(BlackboardError, match=r"'@' is used several times in the key \[@a@b\]"):
        Blackboard().declare('@a@b', None)


def test_a_key_that_leads_nowhere_has_no_entry_and_takes_none() -> None:
    top = Blackboard()
    top.remap('a', 'b')
    inner = Blackboard(top)
    inner.remap('c', 'a')
    assert (inner.parent, top.parent, inner.root) == (top, None, top)
    assert (top.entry('a'), inner.entry('c'), 'c' in inner) == (None, None, False)
    for board, key in ((top, 'a'), (inner, 'c')):
        with pytest.raises(BlackboardError, match=r'^key \[a\] is remapped to a parent blackboard, but there is none$'):
            board.set(key, 1)


def test_keys_in_a_text_are_between_semicolons() -> None:
    assert separated(' a ; ;b;; c d ') == ['a', 'b', 'c d']
    assert [number_from_text(text) for text in ('2.50', '-.5e1', 'inf', '2x', '', '1e999')] == [
        2.5, -5.0, math.inf, None, None, None,
    ]  # fmt: skip


def test_the_entries_of_a_scope_are_those_that_it_has() -> None:
    board = Blackboard()
    board.set('a', 1)
    entries = board.entries()
    board.set('a', 2)
    board.set('b', 3)
    assert {key: entry.value for key, entry in entries.items()} == {'a': 2}
    assert entries['a'] is board.entry('a')


def test_an_output_port_may_have_a_pointer_as_its_default() -> None:
    assert output_port(INT, default='{x}').default == '{x}'


def test_types_of_one_name_are_the_same_and_a_clash_names_both() -> None:
    assert PortType('speed', float, 'real').same(PortType('speed', float, 'real'))
    assert not PortType('speed', float, 'real').same(DOUBLE)
    board = Blackboard()
    board.declare('x', PortType('speed', float, 'real'))
    board.declare('x', PortType('speed', float, 'real'))
    with pytest.raises(BlackboardError, match=r'\[x\].* speed.* double'):
        board.declare('x', DOUBLE)


def test_lists_are_of_one_type_if_their_elements_are_or_are_numbers() -> None:
    pose, path = (PortType(name, made) for name, made in (('pose', dict), ('path', set)))
    numbers, texts, poses, any_list = list_of(INT), list_of(STRING), list_of(pose), type_of([])
    assert numbers.same(list_of(DOUBLE)) and poses.same(PortType('pose[]', list, element=pose))
    for one in (numbers, texts, poses):
        assert one.same(any_list) and any_list.same(one) and any_list.may_read(one)
    for one, other in ((numbers, texts), (texts, poses), (poses, list_of(path))):
        assert not one.same(other) and not one.may_read(other)
    board = Blackboard()
    board.declare('x', poses)
    board.set('x', [{}])
    with pytest.raises(BlackboardError, match='has the type std::vector<pose>'):
        board.set('x', ['a'], texts)


@pytest.mark.parametrize(('value', 'kind'), [(3, INT), (3.5, DOUBLE), ('a', STRING), (EMPTY, None), ((1,), None)])
@pytest.mark.parametrize('present', ['nothing', 'declared', 'untyped'])
def test_what_a_node_copies_to_a_key_of_the_root_is_put_there(value: Any, kind: PortType | None, present: str) -> None:
    found: list[object] = []
    for is_root in (True, False):
        root = Blackboard()
        if present != 'nothing':
            root.declare('x', INT if present == 'declared' else None)
        try:
            (root if is_root else Blackboard(root)).put('x' if is_root else '@x', value, kind)
        except BlackboardError as error:
            found.append(str(error))
        entry = root.entry('x')
        assert entry is not None
        found.append((str(entry.type), entry.value, entry.sequence))
    half = len(found) // 2
    assert found[:half] == found[half:]


def test_a_list_of_what_no_text_means_has_none_either() -> None:
    kind = list_of(PortType('pose', object))
    assert (kind.name, kind.python_type, kind.from_text) == ('std::vector<pose>', list, None)


@pytest.mark.parametrize('make', [input_port, inout_port])
def test_a_port_is_what_it_was_made_with(make: Any) -> None:
    plain, full = make(), make(STRING, default='a', description='b', literal=KEY, nav2_branch='main')
    assert (full.type, full.default, full.description, full.literal, full.nav2_branch) == (
        STRING,
        'a',
        'b',
        KEY,
        'main',
    )
    assert (plain.type, plain.literal, plain.nav2_branch, plain.description, plain.declares) == (
        None,
        None,
        '',
        '',
        True,
    )
    assert [port.required for port in (plain, full, make(optional=True), make(default=None))] == [True] + [False] * 3
    assert full.documentation == 'b (Nav2 main only)'
    written = output_port(INT, default='{x}', description='b', nav2_branch='main')
    assert (written.type, written.default, written.documentation) == (INT, '{x}', 'b (Nav2 main only)')
    assert not written.readable and not written.required and plain.readable
