# SPDX-License-Identifier: BSD-3-Clause
"""Scripts against BehaviorTree.CPP: random expressions, value by value and error by error.

The library of the wheel, 4.8.2, has another grammar than the engine, which follows 4.10. So every operator has its
parentheses here, and ``true`` is not a result by itself: it is an integer there, and a double in 4.10.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees import wheel as bt_wheel

pytestmark = pytest.mark.skipif(
    not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4'
)

Trace = dict[str, Any]
Judge = Callable[[dict[str, Any]], Trace]


@pytest.fixture(scope='module')
def judge() -> Iterator[Judge]:
    """Give the trace of a case, all cases with one process of the library."""
    waiting: list[dict[str, Any]] = []
    traces = bt_wheel.traces(iter(waiting.pop, None))

    def trace(case: dict[str, Any]) -> Trace:
        waiting.append(case)
        return next(traces)

    yield trace
    traces.close()  # type: ignore[attr-defined]


# What the library says, and what the engine says for the same reason.
REASONS = (
    ('Variable not found', 'has no entry'),
    ("doesn't exist, yet", 'create it by'),
    ('is not initialized', 'never written'),
    ('Operation not permitted', 'does not apply|join texts'),
    ('Invalid operator for std::string', 'needs a number, not the text'),
    ('undefined', 'needs a number, not an entry that was never written'),
    ('Binary operators are not allowed', 'needs integers'),
    ('Logic operators are not allowed', 'needs truth values'),
    ('out of range for bitwise', 'fits into 64 bits'),
    ('failed string to number', "can't convert text|fit into a double"),
    ("Can't convert string|convertFromString|^sto[dil]+$", "can't convert text|fit into a double"),
    ('Loss of precision', 'loss of precision'),
    ('non-numeric type', 'does not apply'),
    ('Operator not supported for strings', 'does not apply'),
    ('copyInto fails', 'does not apply'),
    ('Invalid floating point to integer', 'is not an integer|out of the range'),
    ('Error assigning a value', 'is not an integer|out of the range|loss of precision|cannot be assigned'),
    ('Implicit casting to bool', 'only 0 and 1'),
    ("negative and can't be converted", 'a negative number|only 0 and 1'),
    ('between .* and .bool.', 'neither true nor false'),
    ('it is empty', 'never written'),
)


BOARD = {'a': 3, 'b': -2, 'r': 2.5, 'q': -0.25, 's': 'foo', 't': '2.5', 'k': True, 'l': False, 'one': 1}


def check(judge: Judge, node: str) -> None:
    """Check that both sides have the same entries and errors in each of three ticks."""
    # [empty] is declared by a port, and never written.
    body = f'<Sequence>{node}<AlwaysFailure/><Repeat num_cycles="{{empty}}"><AlwaysSuccess/></Repeat></Sequence>'
    document = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    case = {'xml': document, 'bb': BOARD, 'ops': [['tick']] * 3}
    expected, actual = judge(case), bt_scripted.Run(case).trace()
    assert expected['load_error'] is None, expected['load_error']
    assert actual['load_error'] is None, actual['load_error']
    for theirs, ours in zip(expected['steps'], actual['steps'], strict=True):
        if ours['error'] is not None and re.search('out of the range of int,|64 bits, not nan', ours['error']):
            # On purpose: the type of an entry bounds what a script assigns; no bits of what is not a number.
            return
        assert _without_sign_of_nan(theirs['bb']['']) == ours['bb'][''], theirs['error'] or ours['error']
        assert (theirs['error'] is None) is (ours['error'] is None), theirs['error'] or ours['error']
        if theirs['error'] is not None:
            why = next((mine for reason, mine in REASONS if re.search(reason, theirs['error'])), None)
            assert why is not None, theirs['error']
            assert re.search(why, ours['error']), (theirs['error'], ours['error'])
        assert theirs['events'] == ours['events']


def _without_sign_of_nan(board: dict[str, list[str]]) -> dict[str, list[str]]:
    return {key: [kind, text.replace('-nan', 'nan')] for key, (kind, text) in board.items()}


# -- random scripts --------------------------------------------------------------------------------------------------

NAMES = st.sampled_from((*BOARD, *BOARD, 'empty', 'missing', 'x'))
NUMBERS = st.sampled_from(
    ('0', '1', '2', '5', '0.5', '2.25', '1e3', '0x1F', '9007199254740991', '9007199254740993', '9223372036854775807')
)
TEXTS = st.sampled_from(("''", "'x'", "'foo'", "'7'", "'2.5e1'", "'-3'", "'true'", "'7.5 apples'"))


def _combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    # Where it does not matter of which kind a number is.
    operand = st.one_of(inner, inner, inner, st.sampled_from(('true', 'false')))
    binary = st.sampled_from(['+', '-', '*', '/', '&', '|', '^', '&&', '||', '==', '!=', '<', '>', '<=', '>='])
    relation = st.sampled_from(['<', '>', '==', '<='])
    return st.one_of(
        st.tuples(st.sampled_from('-~!'), operand).map(lambda parts: f'({parts[0]}({parts[1]}))'),
        st.tuples(operand, binary, operand).map(lambda parts: f'({" ".join(parts)})'),
        st.tuples(inner, inner).map(lambda parts: f'({parts[0]} .. {parts[1]})'),
        st.tuples(operand, relation, operand, relation, operand).map(lambda parts: f'({" ".join(parts)})'),
        st.tuples(operand, inner, inner).map(lambda parts: f'({parts[0]} ? {parts[1]} : {parts[2]})'),
    )


EXPRESSIONS = st.recursive(st.one_of(NAMES, NUMBERS, TEXTS), _combined, max_leaves=6)
ASSIGNMENTS = st.tuples(
    st.one_of(NAMES, st.just('x')), st.sampled_from([':=', ':=', '=', '+=', '-=', '*=', '/=']), EXPRESSIONS
).map(' '.join)


@settings(max_examples=200, deadline=None)
@given(script=st.lists(ASSIGNMENTS, min_size=1, max_size=3).map('; '.join))
def test_assignments(judge: Judge, script: str) -> None:
    check(judge, f'<Script code={quoteattr(script)}/>')


@settings(max_examples=200, deadline=None)
@given(script=EXPRESSIONS, attribute=st.sampled_from(('code', '_skipIf', '_while')))
def test_conditions(judge: Judge, script: str, attribute: str) -> None:
    if attribute == 'code':
        check(judge, f'<ScriptCondition code={quoteattr(script)}/>')
    else:
        check(judge, f'<AlwaysSuccess {attribute}={quoteattr(script)}/>')
