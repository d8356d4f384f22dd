# SPDX-License-Identifier: BSD-3-Clause
"""Blackboards as JSON: what is exported comes back, whatever it is; what cannot be read changes nothing."""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model import ports
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard
from flexbt_core.behavior_tree.model.blackboard_json import (
    JsonObject,
    JsonTypes,
    export_blackboard,
    import_blackboard,
    show_blackboard,
)
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import BlackboardError
from flexbt_core.behavior_tree.model.ports import PortType
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.behavior_tree.xml.reader import load_xml


@dataclass(frozen=True)
class Waypoint:
    name: str
    x: float


TYPES = JsonTypes()
TYPES.register('demo::Waypoint', Waypoint, asdict, lambda fields: Waypoint(**fields))

NUMBERS = st.integers(-(2**63), 2**64 - 1) | st.floats()
SCALARS = st.none() | st.booleans() | NUMBERS | st.text() | st.sampled_from(NodeStatus)
LEAVES = SCALARS | st.builds(Waypoint, st.text(), st.floats(allow_nan=False, allow_infinity=False))
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner)
        | st.lists(inner).map(tuple)
        | st.lists(inner).map(deque)
        | st.dictionaries(st.text() | st.integers() | st.tuples(st.text(), st.booleans()), inner)
    ),
    max_leaves=8,
)
OF_LITERALS = (ports.KEY, ports.KEYS)
NAMED = [kind for kind in vars(ports).values() if isinstance(kind, PortType) and kind not in OF_LITERALS]
KINDS = st.none() | st.sampled_from([*NAMED, ports.list_of(ports.INT), ports.list_of(ports.STRING)])
KEYS = st.text(st.characters(exclude_characters='@', codec='utf-8'), max_size=5)


def identical(one: Any, other: Any) -> bool:
    """Equal, of the same classes all through, not-a-number and signs of zero included."""
    if one.__class__ is not other.__class__:
        return False
    if isinstance(one, float):
        return (
            math.isnan(other) if math.isnan(one) else (one, math.copysign(1, one)) == (other, math.copysign(1, other))
        )
    if isinstance(one, list | tuple | deque):
        return len(one) == len(other) and all(map(identical, one, other))
    if isinstance(one, dict):
        return identical(list(one), list(other)) and identical(list(one.values()), list(other.values()))
    return bool(one == other)


def contents(board: Blackboard) -> dict[str, tuple[str | None, Any]]:
    found = ((key, board.entry(key)) for key in board)
    return {
        key: (None if entry.type is None else entry.type.name, entry.value) for key, entry in found if entry is not None
    }


def same(one: Blackboard, other: Blackboard) -> bool:
    left, right = contents(one), contents(other)
    return left.keys() == right.keys() and all(
        left[key][0] == right[key][0] and identical(left[key][1], right[key][1]) for key in left
    )


@st.composite
def boards(draw: st.DrawFn) -> Blackboard:
    """Return what sets, declarations, copies and writes through ports leave behind."""
    board = Blackboard()
    below = Blackboard(board)
    for key in draw(st.lists(KEYS, max_size=6)):
        below.remap('port', key)
        value, kind = draw(VALUES), draw(KINDS)
        for deed in draw(st.lists(st.integers(0, 5), max_size=4)):
            with contextlib.suppress(BlackboardError):
                match deed:
                    case 0:
                        board.declare(key, kind)
                    case 1:
                        board.set(key, value)
                    case 2:
                        board.set(key, str(value))
                    case 3:
                        board.put(key, value, None)
                    case 4:
                        below.set('port', value)
                    case _:
                        below.set('port', 'some text')
    return board


@settings(max_examples=100, deadline=None)
@given(boards())
def test_every_entry_comes_back_with_its_type_and_its_value(board: Blackboard) -> None:
    document, problems = export_blackboard(board, TYPES)
    assert not problems
    again = Blackboard()
    import_blackboard(again, json.loads(json.dumps(document, allow_nan=False)), TYPES)
    assert same(board, again), (contents(board), contents(again))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner)
        | st.dictionaries(st.sampled_from(['__type', 'type', 'value', 'name', 'x']), inner)
        | st.fixed_dictionaries(
            {
                '__type': st.sampled_from(
                    ['double', 'dict', 'tuple', 'deque', 'BT::NodeStatus', 'demo::Waypoint', 'int']
                )
            },
            optional={'value': inner, 'name': inner, 'x': inner},
        )
        | st.fixed_dictionaries(
            {
                'type': st.sampled_from(
                    ['int', 'bool', 'std::vector<int>', 'BT::Any', 'list', 'std::vector<', 'Waypoint']
                )
            },
            optional={'value': inner},
        )
    ),
    max_leaves=10,
)


@settings(max_examples=100, deadline=None)
@given(boards(), st.dictionaries(KEYS | KEYS.map('@{}'.format), JSON, max_size=3), st.data())
def test_a_document_is_taken_as_a_whole_or_not_at_all(
    board: Blackboard, document: dict[str, Any], data: st.DataObject
) -> None:
    if board.keys():
        # What is there and what comes is to meet.
        document = {**document, data.draw(st.sampled_from(board.keys())): data.draw(JSON)}
    before, _ = export_blackboard(board, TYPES)
    try:
        import_blackboard(board, document, TYPES)
    except BlackboardError:
        after = Blackboard()
        import_blackboard(after, before, TYPES)
        assert same(board, after)


def test_text_numbers_and_lists_stand_for_themselves() -> None:
    board = Blackboard()
    for key, value in {'name': 'kitchen', 'speed': 2.0, 'count': 3, 'ready': True, 'far': math.inf}.items():
        board.declare(key, None).write(value)
    board.set('length', 2.5)
    board.set('rooms', ['a', 1, None, [True]])
    board.set('level', 3, ports.UINT8)
    board.declare('later', ports.DOUBLE)
    board.declare('anything', None)
    assert json.loads(json.dumps(export_blackboard(board, TYPES)[0])) == {
        'name': 'kitchen',
        'speed': 2.0,
        'count': 3,
        'ready': True,
        'length': {'type': 'double', 'value': 2.5},
        'rooms': ['a', 1, None, [True]],
        'level': {'type': 'uint8_t', 'value': 3},
        'far': {'__type': 'double', 'value': 'inf'},
        'later': {'type': 'double'},
        'anything': None,
    }


def test_what_has_no_json_form_is_told_and_the_rest_is_exported() -> None:
    board = Blackboard()
    board.set('lamp', object())
    board.set('deep', [[{'lamp': object()}]])
    board.set('far', Waypoint('far', math.inf))
    board.set('x', 1)
    document, problems = export_blackboard(board, TYPES)
    assert document == {'x': {'type': 'int', 'value': 1}}
    assert [problem.partition(']')[0] for problem in problems] == ['entry [lamp', 'entry [deep', 'entry [far']
    assert show_blackboard(board, TYPES) == {'lamp': None, 'deep': None, 'far': None, 'x': 1}


def test_a_value_within_itself_is_refused_in_time() -> None:
    board = Blackboard()
    endless: list[Any] = []
    endless.append(endless)
    board.set('endless', endless)
    assert export_blackboard(board, TYPES) == ({}, ['entry [endless]: a value is nested more than 100 deep'])
    nested: Any = []
    for _ in range(2000):
        nested = [nested]
    with pytest.raises(BlackboardError, match=r'^entry \[nested\]: a value is nested more than 100 deep$'):
        import_blackboard(board, {'nested': nested}, TYPES)


@pytest.mark.parametrize(
    ('wrap', 'most'),
    [(lambda inner: [inner], 100), (lambda inner: (inner,), 100), (lambda inner: {1: inner}, 50)],
)
def test_a_value_is_as_deep_as_can_be_read_again_and_no_deeper(wrap: Any, most: int) -> None:
    nested = 0
    for _ in range(most):
        nested = wrap(nested)
    board, copied = Blackboard(), Blackboard()
    board.set('a', nested)
    document, problems = export_blackboard(board, TYPES)
    import_blackboard(copied, document, TYPES)
    assert (problems, copied.get('a')) == ([], nested)
    refused = 'entry [a]: a value is nested more than 100 deep'
    board.set('a', wrap(nested))
    assert export_blackboard(board, TYPES) == ({}, [refused])
    before, _, after = json.dumps(document['a']).partition('0')
    with pytest.raises(BlackboardError, match=f'^{re.escape(refused)}$'):
        import_blackboard(copied, {'a': json.loads(before * 2 + '0' + after * 2)}, TYPES)


def test_a_class_is_registered_once_and_has_fields_that_json_holds() -> None:
    class Odd:
        """Has a field that is no number."""

    types = JsonTypes()
    types.register('demo::Odd', Odd, lambda odd: {'x': math.nan}, lambda fields: Odd())
    for name, python_type in (('demo::Odd', int), ('other', Odd), ('list', str)):
        with pytest.raises(
            ValueError, match=f'^the JSON type {name!r}, or its class .*{python_type.__name__}, is regist'
        ):
            types.register(name, python_type, lambda value: {}, lambda fields: fields)
    board = Blackboard()
    board.set('odd', Odd())
    document, (problem,) = export_blackboard(board, types)
    assert not document
    assert problem.startswith('entry [odd]: a demo::Odd gives fields that JSON cannot hold: Out of range float values')
    assert export_blackboard(board, TYPES)[1][0].endswith('Odd has no JSON form; register one for its class')


NEITHER = 'an object has to have \'__type\' beside its fields, or only "type" and "value"; this one has'


@pytest.mark.parametrize(
    ('item', 'reason'),
    [
        ({}, f'{NEITHER} nothing'),
        ({'x': 1}, f"{NEITHER} 'x'"),
        ({'type': 'int', 'value': 1, 'more': 2}, f"{NEITHER} 'type', 'value', 'more'"),
        ({'__type': 'Nothing'}, "the type 'Nothing' is not known"),
        ({'type': 'Nothing', 'value': 1}, "the type 'Nothing' is not known"),
        ({'type': 'uint8_t', 'value': 300}, '300 is out of the range of uint8_t, 0 to 255'),
        ({'type': 'int', 'value': [1]}, 'no safe conversion from list to int'),
        ({'type': 'bool', 'value': 2}, 'of the integers only 0 and 1 can be read as bool, not 2'),
        ([{'no': 'type'}], "an object within a value has to have a '__type'"),
        ({'__type': 'demo::Waypoint', 'name': 'a'}, 'not a demo::Waypoint: Waypoint.__init__() missing 1 required '
         "positional argument: 'x'"),
        ({'__type': 'dict', 'value': [[[], 1]]}, "not a dict: unhashable type: 'list'"),
        ({'__type': 'tuple', 'value': 3}, 'the value of a tuple has to be a list'),
        ({'__type': 'BT::NodeStatus', 'value': 'DONE'}, "not a BT::NodeStatus: 'DONE'"),
        ({'__type': 'double', 'value': 'x'}, "not a double: 'x'"),
    ],
)  # fmt: skip
def test_an_item_that_is_not_understood_is_named_with_the_reason(item: Any, reason: str) -> None:
    with pytest.raises(BlackboardError) as raised:
        import_blackboard(Blackboard(), {'good': 1, 'bad': item, 'worse': item}, TYPES)
    assert str(raised.value) == f'entry [bad]: {reason}; entry [worse]: {reason}'


def test_an_entry_that_has_a_type_converts_and_counts_the_write() -> None:
    board = Blackboard()
    entry = board.declare('speed', ports.DOUBLE)
    import_blackboard(board, {'speed': 3}, TYPES)
    assert identical(entry.value, 3.0)
    assert entry.sequence == 1
    import_blackboard(board, {'speed': '4.5'}, TYPES)
    assert identical(entry.value, 4.5)
    with pytest.raises(BlackboardError, match='speed'):
        import_blackboard(board, {'new': 1, 'speed': [1]}, TYPES)
    assert 'new' not in board
    import_blackboard(board, {'speed': None}, TYPES)
    assert identical(entry.value, 4.5)


def test_what_a_script_has_put_into_an_entry_of_another_type_is_a_problem_of_the_export() -> None:
    board, again = Blackboard(), Blackboard()
    board.set('n', 1)
    board.set('k', True)
    board.declare('path', ports.list_of(ports.DOUBLE))
    board.declare('text', ports.STRING)
    ScriptLibrary().script('n = 3000000000; k = 5; path := 2.5; text := 1').bind(board).run()
    document, problems = export_blackboard(board, TYPES)
    assert [problem.partition(':')[0] for problem in problems] == ['entry [n]', 'entry [k]', 'entry [path]']
    import_blackboard(again, json.loads(json.dumps(document)), TYPES)
    assert contents(again) == {'text': ('std::string', 1)}
    with pytest.raises(BlackboardError, match='path'):
        import_blackboard(board, {'path': document['text']}, TYPES)


def test_entries_of_outer_scopes_convert_or_nothing_is_written() -> None:
    outer = Blackboard()
    outer.declare('speed', ports.DOUBLE)
    inner = Blackboard(outer)
    for key in ('speed', 'velocity'):
        inner.remap(key, 'speed')
    import_blackboard(inner, {'own': 1, 'speed': 3, '@name': 'base'}, TYPES)
    assert (inner.keys(), outer.snapshot()) == (['own'], {'speed': 3.0, 'name': 'base'})
    with pytest.raises(BlackboardError, match='speed'):
        import_blackboard(inner, {'own': 2, 'speed': 4, 'velocity': [1]}, TYPES)
    assert (inner.snapshot(), outer.snapshot()) == ({'own': 1}, {'speed': 3.0, 'name': 'base'})


def test_nothing_is_written_if_one_type_does_not_fit_although_its_value_would() -> None:
    board = Blackboard()
    for key in 'ab':
        board.set(key, 0)
    with pytest.raises(BlackboardError, match=r'^entry \[b\] has the type int'):
        import_blackboard(board, {'a': 1, 'b': {'type': 'std::string', 'value': 5}}, TYPES)
    assert board.snapshot() == {'a': 0, 'b': 0}


def test_types_of_ones_own_are_known_where_a_tree_has_declared_them() -> None:
    color = PortType('Color', Waypoint)
    board = Blackboard()
    board.declare('color', color)
    red = {'__type': 'demo::Waypoint', 'name': 'r', 'x': 1.0}
    import_blackboard(board, {'color': {'type': 'Color', 'value': red}}, TYPES)
    assert board.get('color') == Waypoint('r', 1.0)
    assert export_blackboard(board, TYPES) == ({'color': red}, [])


@pytest.mark.parametrize('name', ['demo::Waypoint', 'Waypoint'])
def test_a_registered_class_is_known_by_both_of_its_names(name: str) -> None:
    board = Blackboard()
    import_blackboard(board, {'a': {'type': name}, 'b': {'type': f'std::vector<{name}>'}}, TYPES)
    kinds = [entry.type for entry in board.entries().values()]
    assert [(kind.name, kind.python_type) for kind in kinds if kind is not None] == [
        ('Waypoint', Waypoint),
        ('std::vector<Waypoint>', list),
    ]
    assert TYPES.port_type('std::vector<Nothing>') is None


class Family(JsonTypes):
    """Classes with types of their own, as messages have."""

    def of_class(self, python_type: type[Any]) -> JsonObject | None:
        known = super().of_class(python_type)
        return None if known is None else known._replace(type=PortType('family/Waypoint', Waypoint))


def test_a_new_entry_gets_the_type_that_the_family_of_its_class_has() -> None:
    family = Family()
    family.register('demo::Waypoint', Waypoint, asdict, lambda fields: Waypoint(**fields))
    board = Blackboard()
    red = {'__type': 'demo::Waypoint', 'name': 'r', 'x': 1.0}
    import_blackboard(board, {'a': red}, family)
    assert str(board.entries()['a'].type) == 'family/Waypoint'
    assert export_blackboard(board, family) == ({'a': red}, [])


def test_it_is_shown_as_behaviortree_cpp_shows_it() -> None:
    """What its Groot2Publisher replies for the same tree and entries (4.8.2, seen on the wire)."""
    board = Blackboard()
    for key, value in {'i': 3, 't': True, 'd': 2.0, 'inf': math.inf, 's': 'x"y', 'big': 2**31 - 1}.items():
        board.set(key, value)
    text = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>
    <Script code="a:=1; b:=2.5; c:='t'; e:=true; l:=1e300"/>
    <LoopDouble queue="{q}" value="{v}"><AlwaysSuccess/></LoopDouble><Sleep msec="{ms}"/>
    <SubTree ID="S" k="{i}" c="7" _autoremap="false"/></Sequence></BehaviorTree>
    <BehaviorTree ID="S"><Sequence><Script code="z:=k+1"/><LoopInt queue="1;2;3" value="{v}"><AlwaysSuccess/></LoopInt>
    </Sequence></BehaviorTree></root>"""
    tree = Tree(TreeLibrary([load_xml(text, 'f.xml', builtin_registry())]), 'Main', blackboard=board)
    at_first = {'big': 2147483647, 'd': 2.0, 'i': 3, 'inf': math.inf, 's': 'x"y', 't': 1}
    at_first |= dict.fromkeys(('ms', 'q', 'v'))
    assert show_blackboard(board, TYPES) == at_first
    board.set('q', '1;2;3')
    assert tree.tick_exactly_once() is NodeStatus.RUNNING
    later = {'a': 1, 'b': 2.5, 'c': 't', 'e': 1, 'l': 1e300, 'v': 1.0, 'q': '1;2;3'}
    shown = show_blackboard(board, TYPES)
    assert {**shown, 'q': '1;2;3'} == at_first | later
    assert shown['t'].__class__ is int
    inner = tree.subtrees[1]
    assert (inner.path, show_blackboard(inner.blackboard, TYPES)) == ('S::6', {'c': '7', 'v': None})
    assert board.entry('ms').value is EMPTY  # type: ignore[union-attr]
