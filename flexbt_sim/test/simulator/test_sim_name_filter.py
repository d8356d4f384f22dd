# SPDX-License-Identifier: BSD-3-Clause
"""Filters for names: what Python's own expressions match, in bounded time."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import SimulationError
from flexbt_sim.simulator.entity_services import NameFilter
from flexbt_testing.waiting import processor_time

atoms = st.sampled_from(['a', 'b', '.', '[ab]', '[^a]', '[a-c]', r'\.', 'robot', '^', '$'])


def grouped(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.one_of(
        st.lists(parts, min_size=1, max_size=3).map(''.join),
        st.tuples(parts, parts).map(lambda two: f'({two[0]}|{two[1]})'),
        st.tuples(parts, st.sampled_from(['*', '+', '?', '{2}', '{0,2}', '{1,}'])).map(
            lambda two: f'({two[0]}){two[1]}'
        ),
    )


@given(st.recursive(atoms, grouped, max_leaves=6), st.text('abc.', max_size=8))
@settings(max_examples=120)
def test_names_are_matched_as_by_python(pattern: str, name: str) -> None:
    assert NameFilter(pattern)(name) is (re.fullmatch(pattern, name) is not None)


@pytest.mark.parametrize(
    ('pattern', 'matched', 'other'),
    [
        ('', 'anything', None),
        ('robot[[:digit:]]+', 'robot12', 'robot'),
        ('[]a]+', 'a]', 'b'),
        ('^robot.*$', 'robot_a', 'a_robot'),
        ('(.*_|^)a', 'b_a', 'ba'),
        ('.*(^|_)a', 'b_a', 'ba'),
        ('a|', '', 'b'),
        ('[[:alpha:]_]+', 'a_b', 'a1'),
    ],
)
def test_the_forms_of_posix(pattern: str, matched: str, other: str | None) -> None:
    assert NameFilter(pattern)(matched)
    assert other is None or not NameFilter(pattern)(other)


@pytest.mark.parametrize('pattern', ['(', ')', 'a)', '*', 'a**', '[', '[a', 'a{2', 'a{3,1}', '\\', '(' * 999])
def test_what_is_none_is_refused(pattern: str) -> None:
    with pytest.raises(SimulationError, match='not an extended regular expression'):
        NameFilter(pattern)


def test_no_expression_takes_long() -> None:
    began = processor_time()
    for pattern in (
        '(a+)+b',
        '(a|a)*b',
        '(.*)(.*)(.*)(.*)(.*)b',
        '((a{0,9}){0,9})*b',
        'a{999}' * 9,
        '((a{0,999}){999}){999}b',
        f'{"(" * 20}{"|a){999}" * 20}b',
    ):
        assert not NameFilter(pattern)('a' * 63)
    assert processor_time() - began < 5.0
