# SPDX-License-Identifier: BSD-3-Clause
"""The code that is made of scripts which run often does what the closures do, for all values, with all errors."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.errors import ScriptError
from flexbt_core.behavior_tree.script.interpreter import BoundScript, ScriptLibrary

NUMBERS = st.sampled_from(
    (0, 1, -1, 2, 3, 7, -12, 255, 10**6, 2**30, -(2**30), 2**31, 2**52, 2**53 - 1, 2**53, 2**63 - 1)
)
REALS = st.sampled_from(
    (0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -2.25, 1e-8, 1e9, 2.0**60, 1e300, math.inf, -math.inf, math.nan)
)
TEXTS = st.sampled_from(('', 'x', 'foo', '7', '2.5', '-1e2', 'true', 'RED', 'a b'))
KEYS = ('a', 'b', 'k', 'r', 's', 't')
CONTENTS = st.one_of(NUMBERS, REALS, TEXTS, st.booleans())


def _literal(value: int | float | str) -> str:
    if isinstance(value, str):
        return f"'{value}'"
    return repr(abs(value)) if math.isfinite(value) else '(1/0)'


def _combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    binary = st.sampled_from(['+', '-', '*', '/', '..', '&', '|', '^', '&&', '||', '==', '!=', '<', '>', '<=', '>='])
    return st.one_of(
        st.tuples(st.sampled_from('-~!'), inner).map(lambda parts: f'{parts[0]}({parts[1]})'),
        st.tuples(inner, binary, inner).map(lambda parts: f'({" ".join(parts)})'),
        st.tuples(inner, st.sampled_from(['<', '>', '==', '<=']), inner, inner).map(
            lambda parts: f'({parts[0]} {parts[1]} {parts[2]} {parts[1]} {parts[3]})'
        ),
        st.tuples(inner, inner, inner).map(lambda parts: f'({parts[0]} ? {parts[1]} : {parts[2]})'),
    )


NAMES = st.sampled_from((*KEYS, *KEYS, 'RED', 'missing'))
EXPRESSIONS = st.recursive(st.one_of(NAMES, st.one_of(NUMBERS, REALS, TEXTS).map(_literal)), _combined, max_leaves=6)
STATEMENTS = st.one_of(
    st.tuples(st.sampled_from(KEYS), st.sampled_from([':=', '=', '+=', '-=', '*=', '/=']), EXPRESSIONS).map(' '.join),
    EXPRESSIONS,
)
SCRIPTS = st.lists(STATEMENTS, min_size=1, max_size=3).map('; '.join)


def _outcome(bound: BoundScript, board: Blackboard) -> object:
    """Return result or error, and all entries, in a form in which equal means the same."""
    try:
        result: object = bound.run()
    except ScriptError as error:
        result = (error.offset, error.reason)
    entries = [(key, board.entry(key)) for key in board]
    return result, [(key, type(e.value), repr(e.value), e.sequence) for key, e in entries if e is not None]


@settings(max_examples=150, deadline=None)
@given(
    script=SCRIPTS,
    values=st.lists(st.fixed_dictionaries(dict.fromkeys(KEYS, CONTENTS)), min_size=1, max_size=3),
    condition=st.booleans(),
)
@example(
    script='a := a + 1; k := a > 3',
    values=[{'a': 2**30, 'b': 0, 'k': True, 'r': 0.0, 's': '', 't': ''}],
    condition=False,
)
def test_the_code_of_a_script_does_what_the_closures_do(
    script: str, values: list[dict[str, Any]], condition: bool
) -> None:
    outcomes = []
    for warm_up in (1, 1000):
        library = ScriptLibrary(warm_up)
        library.register_enum('RED', 2)
        board = Blackboard()
        for key in KEYS:
            board.declare(key, None)
        bound = library.script(script).bind(board, condition=condition)
        found = []
        for contents in values:
            for key, value in contents.items():
                entry = board.entry(key)
                assert entry is not None
                entry.value = value
            # The first run finds the entries, the second makes the code, the third is done by it.
            found += [_outcome(bound, board) for _ in range(3)]
        outcomes.append(found)
    assert outcomes[0] == outcomes[1]


def test_code_is_made_for_the_scripts_of_every_day() -> None:
    """Otherwise the test before would compare closures with closures."""
    board = Blackboard()
    values = {'n': 3, 'x': 1.5, 'ok': True, 's': 'foo'}
    for key, value in values.items():
        board.set(key, value)
    for text in (
        'n := n + 1; ok := n > 0',
        'n += 1; n -= 1; n *= 2; n = n / 2',
        'x = x * 0.5 + n / 2 - 1e-3',
        'ok = !ok && (n >= 3 || x < 2) && 1 < n < 100',
        "s = n == 4 ? 'foo' : 'bar'; s += '!' .. n .. x",
        'n = (n & 6 | 1) ^ ~n',
        "s == 'foo' || RED == 2",
    ):
        library = ScriptLibrary(warm_up=1)
        library.register_enum('RED', 2)
        bound = library.script(text).bind(board)
        bound.run()
        bound.run()
        assert bound.run.__name__ == 'run', text


def test_the_code_notices_that_an_entry_was_removed_or_has_another_kind() -> None:
    board = Blackboard()
    board.set('n', 1)
    bound = ScriptLibrary(warm_up=1).script("n += 1; s := 'n' .. n").bind(board)
    for _ in range(4):
        bound.run()
    assert board.snapshot() == {'n': 5, 's': 'n5'}
    removed = board.entry('n')
    board.unset('n')
    with pytest.raises(ScriptError, match='no entry'):
        bound.run()
    board.set('n', 0.5)
    for _ in range(4):
        bound.run()
    assert board.snapshot() == {'n': 4.5, 's': 'n4.500000'}
    assert removed is not None
    assert removed.value is EMPTY


class WrittenMeanwhile(Entry):
    """An entry that another thread writes just after it was read, once."""

    __slots__ = ()
    others: ClassVar[list[Any]] = []

    @property
    def value(self) -> Any:
        slot = vars(Entry)['value']
        value = slot.__get__(self)
        if self.others:
            slot.__set__(self, self.others.pop())
        return value

    @value.setter
    def value(self, value: Any) -> None:
        vars(Entry)['value'].__set__(self, value)


@pytest.mark.parametrize(
    ('script', 'before', 'other', 'after'),
    [('n += 0.5 + 0.5', 1, 10, 11), ("n += 'b'", 'a', 'x', 'xb'), ("n += 'b' .. 1; s = n", 'a', 'x', 'xb1')],
)
def test_code_adds_to_what_another_thread_has_written_meanwhile(
    script: str, before: Any, other: Any, after: Any
) -> None:
    board = Blackboard()
    board.set('n', before)
    board.set('s', '')
    bound = ScriptLibrary(warm_up=1).script(script).bind(board)
    for _ in range(2):
        bound.run()
        board.set('n', before)
    assert bound.run.__name__ == 'run'
    entry = board.entry('n')
    assert entry is not None
    entry.__class__ = WrittenMeanwhile
    WrittenMeanwhile.others.append(other)
    bound.run()
    assert board.get('n') == after


def test_two_names_of_one_entry_stay_one() -> None:
    top = Blackboard()
    scope = Blackboard(top)
    scope.remap('a', 'x')
    scope.remap('b', 'x')
    top.set('x', 1)
    bound = ScriptLibrary(warm_up=1).script('a += 1; b += 1').bind(scope)
    for _ in range(5):
        bound.run()
    assert top.get('x') == 11


@settings(max_examples=250, deadline=None)
@given(text=st.one_of(st.text(), st.text("ab1.0x' \n+-*/&|^~!<>=?:();@_eE"), SCRIPTS))
@example('+6e66>6666.6+66\r6>6;6e62=6+6e66>66666\x27; en\x27;\x7fn\x80;@e66')
def test_no_text_raises_anything_but_a_script_error(text: str) -> None:
    board = Blackboard()
    board.set('a', 1)
    board.set('b', 'text')
    try:
        bound = ScriptLibrary(warm_up=1).script(text).bind(board, condition=True)
    except ScriptError as error:
        assert 0 <= error.offset <= len(text)
        return
    for _ in range(3):
        try:
            bound.run()
        except ScriptError as error:
            assert 0 <= error.offset <= len(text)
