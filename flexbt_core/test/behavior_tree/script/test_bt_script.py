# SPDX-License-Identifier: BSD-3-Clause
"""The scripting language: what scripts mean, and what is refused, with its place."""

from __future__ import annotations

import math
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, RegistrationError, ScriptError
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, UINT8, UINT64, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_testing.behavior_trees.steps import make


class Narrow(Condition):
    ports = {'small': input_port(UINT8)}

    def tick(self) -> NodeStatus:
        self.get_input('small')
        return NodeStatus.SUCCESS


def evaluate(text: str, board: Blackboard | None = None, **enums: int) -> Any:
    """Return the value of the last statement."""
    library = ScriptLibrary()
    for name, number in enums.items():
        library.register_enum(name, number)
    script = library.script(text)
    return script.evaluate(script.scope(board if board is not None else Blackboard()))


# A script and the value of its last statement. Those of BehaviorTree.CPP's own tests of its parser are among them.
VALUES: list[tuple[str, Any]] = [
    ('628', 628),
    ('-628', -628.0),
    ('0x100', 256),
    ('0X1f', 31),
    ('3.14', 3.14),
    ('-3.14e2', -314.0),
    ('3e-2', 0.03),
    ('true', 1.0),
    ("'hello world '", 'hello world '),
    ("'a\n;b'", 'a\n;b'),
    ("'it''s'", 's'),
    ('x := 3; y := 5; x + y', 8.0),
    ('x := 3; x += 1', 4),
    ('x := 3; x -= 1', 2),
    ('x := 3; x *= 2', 6),
    ('x := 6; x /= 2', 3),
    ('x := 3; -x', -3.0),
    ('y := 5; y / 2', 2.5),
    ('5 & 3', 1.0),
    ('5 | 3', 7.0),
    ('5 ^ 3', 6.0),
    ("A := 'hello'; B := ' '; C := 'world'; A + B + C", 'hello world'),
    ("A := 'hello'; B := ' world'; A .. ' ' .. B", 'hello  world'),
    ("A := '65'; B := '66'; A..B", '6566'),
    ("'a'..1", 'a1'),
    ("1..'a'", '1a'),
    ("'a'..2.5", 'a2.500000'),
    ("'a'..(1+1)", 'a2.000000'),
    ('1..2', EMPTY),
    # precedence and associativity
    ('5 - 2 + 1', 4.0),
    ('10 - 3 - 2', 5.0),
    ('12 / 3 / 2', 2.0),
    ('12 / 3 * 2', 8.0),
    ('2 + 3 * 4 - 1', 13.0),
    ('(2 + 3) * 4', 20.0),
    ('6 | 3 & 5', 7.0),
    ('1 & 1 == 1', 1.0),
    ('false && true || true', 1.0),
    ('false || true && true', 1.0),
    ('1 || 0 && 0', 1.0),
    ('1 + 1 == 2 && !0', 1.0),
    ('10 + -3', 7.0),
    ('-2 * -3', 6.0),
    ('--1', 1.0),
    ('!!true', 1.0),
    ('!-1', 0.0),
    ('~0', -1.0),
    ('~2.5', -3.0),
    ('-(3 + 2)', -5.0),
    # comparison
    ('1 < 2 < 3', 1.0),
    ('1 < 2 > 3', 0.0),
    ('3 >= 2 >= 1', 1.0),
    ('5 == 5 != 3', 1.0),
    ('1 == 1.0000001', 1.0),
    ('1 == 1.000001', 0.0),
    ('1.0000001 > 1', 1.0),
    ("'hello' < 'world'", 1.0),
    ("'a' < 'ab'", 1.0),
    ("'Z' < 'a'", 1.0),
    ("'\u00e9' > 'z'", 1.0),
    ("'3' == 3", 1.0),
    ("3 != '4'", 1.0),
    ("'7.5abc' == 7.5", 1.0),
    ("'true' == 1", 1.0),
    ("1 > 'false'", 1.0),
    ('A := 0; A != -1', 1.0),
    ('A := -1; A < -1', 0.0),
    # conditional
    ("3 > 2 ? 'yes' : 'no'", 'yes'),
    ('true ? 2 + 3 : 10', 5.0),
    ('false ? 10 : 2 + 3', 5.0),
    ('0 ? 1 : 0 ? 2 : 3', 3),
    ('1 ? 0 ? 1 : 2 : 3', 2),
    ("'1' ? 1 : 2", 1),
    ("'0.0' ? 1 : 2", 2),
    ('0 ? missing : 2', 2),
    ('-1 ? 1 : 2', 1),
    # assignment
    ('x := y := 3; x + y', 6.0),
    ('x := 1 ? 2 : 3', 2),
    ('(x) := 3', 3),
    ('x := 3; x = 2.0', 2),
    ('x := 3.5; x = 2', 2.0),
    ("x := 3; x = '7'", 7.0),
    ("x := 'a'; x += 'b'", 'ab'),
    ('x := 1; 2 + (x := 5)', 7.0),
    ('x := 1 y := 2 x + y', 3.0),
    ('x := 1;;; y := 2;;', 2),
    ('x := false; x = !x; x', 1.0),
    # numbers that are none
    ('1 / 0', math.inf),
    ('-1 / 0', -math.inf),
    ('1 / -0.0', -math.inf),
    ('x := 0 / 0; x != x', 1.0),
    ('0 / 0 < 1', 1.0),
    ('1 / 0 == 1 / 0', 0.0),
    ('!(0 / 0)', 0.0),
]


@pytest.mark.parametrize(('text', 'value'), VALUES)
def test_a_script_has_the_value(text: str, value: Any) -> None:
    found = evaluate(text)
    assert found == value
    assert type(found) is type(value)


# A script that cannot be parsed, the column, and words of the reason.
UNPARSABLE: list[tuple[str, int, str]] = [
    (' ', 2, 'empty'),
    ('\t\n\r', 4, 'empty'),
    ('; x := 1', 1, "found ';'"),
    ('x := ', 6, 'the end of the script'),
    ('x := (1', 8, "')' is missing here, to close the parenthesis at column 6"),
    ('x := 1)', 7, "found ')'"),
    ('a ? 1', 6, "':' is missing here, to go with the '?' at column 3"),
    ('a ? 1 ; 2', 7, "found ';'"),
    ('x := 1 + * 2', 10, "found '*'"),
    ('x := +1', 6, "found '+'"),
    ('2 % 2', 3, "'%' means nothing"),
    ('a := "text"', 6, 'single quotes'),
    ("a := 'text", 6, 'not closed'),
    ('x.y := 1', 2, "'.' means nothing"),
    ('.5', 1, "'.' means nothing"),
    ('5.', 1, "'5.' is not a number"),
    ('1_000', 1, "'1_000' is not a number"),
    ('3foo', 1, "'3foo' is not a number"),
    ('65.43foo', 1, "'65.43foo' is not a number"),
    ('3e', 1, "'3e' is not a number"),
    ('3e+', 1, "'3e' is not a number"),
    ('0x', 1, 'no digits'),
    ('0xG', 1, "'0xG' is not a number"),
    ('0X100.', 1, "'0X100.' is not a number"),
    ("0x1F..'a'", 1, "'0x1F..' is not a number"),
    ('99999999999999999999', 1, '64 bits'),
    ('0xFFFFFFFFFFFFFFFF', 1, '64 bits'),
    ('1' * 5000, 1, '64 bits'),
    ('1e999', 1, 'a double'),
    ('1e-999', 1, 'a double'),
    ('gr\u00f6\u00dfe := 1', 3, 'ASCII letters'),
    ("'hello' = 'world'", 9, 'the name of a blackboard entry'),
    ('3.0 = 2.0', 5, 'the name of a blackboard entry'),
    ('a + b := 1', 7, 'the name of a blackboard entry'),
    ('a == b = c', 8, 'the name of a blackboard entry'),
    ('(' * 1000, 201, 'nested'),
    ('-' * 1000 + '1', 201, 'nested'),
    ('1' + '+1' * 1000, 399, 'nested'),
    ('x:=' * 1000 + '1', 301, 'nested'),
    ('a?b:' * 1000 + '1', 399, 'nested'),
]


@pytest.mark.parametrize(('text', 'column', 'words'), UNPARSABLE, ids=[row[0][:20] for row in UNPARSABLE])
def test_what_cannot_be_parsed_is_refused_with_its_place(text: str, column: int, words: str) -> None:
    with pytest.raises(ScriptError) as caught:
        ScriptLibrary().script(text)
    assert words in caught.value.reason
    assert caught.value.offset + 1 == column
    assert len(str(caught.value)) < 500


def test_the_place_in_a_script_of_several_lines() -> None:
    with pytest.raises(ScriptError, match=r'\(line 2, column 6 of the script'):
        ScriptLibrary().script('a := 1;\nb := $')


# A script that fails when it runs: the column of what is to blame, and words of the reason.
FAILING: list[tuple[str, int, str]] = [
    ('x = 1', 3, 'no entry [x]; create it by [:=]'),
    ('x += 1', 3, 'no entry [x]; create it by [:=]'),
    ('1 + x', 5, 'no entry [x]'),
    ('1 || x', 6, 'no entry [x]'),
    ('0 && x', 6, 'no entry [x]'),
    ('x := NaN', 6, 'no entry [NaN]'),
    ("'a' + 1", 5, 'join texts with numbers by ..'),
    ("'a' - 'b'", 5, "does not apply to the text 'a' and the text 'b'"),
    ("-'a'", 1, 'operator [-] needs a number'),
    ("!'a'", 1, 'operator [!] needs a number'),
    ('5 ^ 5.1', 3, 'needs integers: 5.1 is not an integer'),
    ('2 && 1', 3, 'of the integers only 0 and 1'),
    ('1 || -0.5', 3, 'a negative number'),
    ("'a' == 1", 5, "can't convert text 'a' to double"),
    ("'a' ? 1 : 2", 5, "can't convert text 'a' to double"),
    ('1..2 + 1', 6, 'the left operand of [+]'),
    ('x := 1..2', 3, 'entry [x]: the right operand of [:=]'),
    ('~1e30', 1, '64 bits'),
    ('9007199254740993 + 0', 18, 'loss of precision'),
    ('x := 3; x = 2.5', 11, 'entry [x]: 2.5 is not an integer'),
    ("x := 3; x = 'msg'", 11, "entry [x]: can't convert text 'msg'"),
    ("x := 'a'; x = 3", 13, 'the number 3 cannot be assigned to an entry that holds the text'),
    ("x := 3; x += 'a'", 11, 'operator [+] does not apply'),
    ("x := 'a'; x += 1", 13, 'operator [+] does not apply'),
    ("x := 'a'; x -= 'a'", 13, 'operator [-] does not apply'),
    ('x := 1; x += 1.5', 11, 'entry [x]: 2.5 is not an integer'),
    ('x := 9223372036854775807; x *= 2', 29, 'loss of precision'),
    ('x := 1; x = 1e300', 11, 'out of the range'),
    ('x := 1; x = 1 / 0', 11, 'inf is not an integer'),
]


@pytest.mark.parametrize(('text', 'column', 'words'), FAILING, ids=[row[0] for row in FAILING])
def test_what_fails_is_refused_with_its_place(text: str, column: int, words: str) -> None:
    with pytest.raises(ScriptError) as caught:
        evaluate(text)
    assert words in caught.value.reason
    assert caught.value.offset + 1 == column


def test_a_comparison_stops_at_the_first_that_does_not_hold() -> None:
    board = Blackboard()
    assert evaluate('0 > 1 > (x := 1)', board) == 0.0
    assert 'x' not in board


def test_what_was_done_before_a_failure_stays_done() -> None:
    board = Blackboard()
    with pytest.raises(ScriptError):
        evaluate('x := 1; y := missing; z := 2', board)
    assert board.snapshot() == {'x': 1}
    # The entry is made before its value is computed, as in BehaviorTree.CPP.
    assert board.keys() == ['x', 'y']


def test_an_assignment_counts_as_a_write_and_keeps_the_kind_of_number() -> None:
    board = Blackboard()
    board.set('real', 1.0)
    board.set('flag', True)
    evaluate('real = 2; real = 3; flag = 1 > 2; n := 1; n = 2', board)
    assert board.snapshot() == {'real': 3.0, 'flag': False, 'n': 2}
    assert [type(board.get(key)) for key in ('real', 'flag', 'n')] == [float, bool, int]
    entries = [board.entry(key) for key in ('real', 'flag', 'n')]
    assert [entry.sequence for entry in entries if entry is not None] == [3, 2, 2]
    evaluate('flag = 2', board)
    assert board.get('flag') == 2
    board.set('id', 2**63, UINT64)
    evaluate('copy := id; copy := id', board)
    assert board.get('copy') == 2**63


def test_a_typed_entry_converts_text_and_a_declared_one_takes_what_comes() -> None:
    board = Blackboard()
    board.set('n', 1, INT)
    board.declare('text', STRING)
    board.declare('real', DOUBLE)
    board.declare('small', UINT8)
    evaluate("n = '42'; text = 'x'; real = 2; small = '7'", board)
    assert board.snapshot() == {'n': 42, 'text': 'x', 'real': 2, 'small': 7}
    for text in ("n = 'x'", "small = '256'", 'n = 1e19'):
        before = board.snapshot()
        with pytest.raises(ScriptError, match=r'entry \[(n|small)\]'):
            evaluate(text, board)
        assert board.snapshot() == before


@pytest.mark.parametrize('bound', [256, -1])
@pytest.mark.parametrize('warm', [False, True])
def test_an_integer_too_large_for_the_type_of_its_entry_is_refused_by_who_reads_it(bound: int, warm: bool) -> None:
    tree, _ = make('<Sequence><Script code="small = n"/><Narrow small="{small}"/></Sequence>', extra=(Narrow,))
    board = tree.blackboard
    for number in (7, *(range(50) if warm else ()), bound):
        board.set('n', number)
        if number == bound:
            with pytest.raises(NodeExecutionError, match=rf'port \[small\].*{bound}'):
                tree.tick_once()
            tree.halt()
            assert board.get('small') == bound
        else:
            assert tree.tick_once() is NodeStatus.SUCCESS
    # It is an integer as others are, and what fits can be read again.
    evaluate('small = small - n + 3', board)
    board.set('n', 3)
    assert tree.tick_once() is NodeStatus.SUCCESS


def test_an_object_is_copied_but_not_computed_with() -> None:
    board = Blackboard()
    pose = object()
    board.set('pose', pose)
    evaluate('copy := pose; pose = copy', board)
    assert board.get('copy') is pose
    for text in (
        'pose + 1',
        "pose .. 'a'",
        'pose == pose',
        'pose ? 1 : 2',
        '-pose',
        'pose && 1',
        'pose = 1',
        "pose = 'a'",
    ):
        with pytest.raises(ScriptError, match='object'):
            evaluate(text, board)


def test_entries_are_found_through_remappings_and_in_the_topmost_scope() -> None:
    top = Blackboard()
    scope = Blackboard(top)
    scope.remap('inner', 'outer')
    scope.remap('goal', '@shared')
    evaluate('inner := 1; @root := 2; own := 3; goal := 4', scope)
    assert top.snapshot() == {'outer': 1, 'root': 2, 'shared': 4}
    assert scope.snapshot() == {'own': 3}
    assert evaluate('inner + @root + own + goal', scope) == 10.0


def test_an_enum_constant_hides_an_entry_of_its_name_from_readers() -> None:
    board = Blackboard()
    board.set('RED', 7)
    board.set('colour', 'RED')
    assert evaluate('RED', board, RED=1) == 1.0
    assert evaluate('colour == RED', board, RED=1) == 1.0
    assert evaluate("colour == 'RED' && 'RED' == 1", board, RED=1) == 1.0
    evaluate('RED = 9', board, RED=1)
    assert board.get('RED') == 9
    assert evaluate('n := 3; n = colour', board, RED=1) == 1.0


def test_enum_constants_are_checked_when_they_are_registered() -> None:
    library = ScriptLibrary()
    library.register_enum('RED', 1)
    library.register_enum('RED', 1)
    assert library.enums == {'RED': 1}
    with pytest.raises(RegistrationError, match='registered already, as 1'):
        library.register_enum('RED', 2)
    for name in ('', 'a b', '1a', '@a', 'true', 'gr\u00fcn'):
        with pytest.raises(RegistrationError, match='letters'):
            library.register_enum(name, 1)


def test_equal_scripts_are_shared_and_not_kept_longer_than_they_are_used() -> None:
    library = ScriptLibrary()
    script = library.script('x := 1')
    assert library.script('x := 1') is script
    library.register_enum('x', 5)
    assert library.script('x := 1') is not script
    del script
    assert not list(library._scripts.values())
