# SPDX-License-Identifier: BSD-3-Clause
"""Values of unknown origin in messages: short ones as they are, and of all others enough to recognise them."""

from __future__ import annotations

import tracemalloc
from collections import OrderedDict
from functools import total_ordering
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.values.text import MAX_REPR, short_repr, truncate_middle

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda inner: st.lists(inner, max_size=40)
)


@given(st.text(max_size=300), st.integers(20, 200))
def test_an_excerpt_is_the_text_or_its_ends(text: str, most: int) -> None:
    kept = truncate_middle(text, most)
    assert kept == text if len(text) <= most else len(kept) == most
    begin, _, end = kept.rpartition(' ... ') if len(text) > most else (text, '', text)
    assert text.startswith(begin) and text.endswith(end)


@settings(max_examples=40)
@given(PLAIN)
def test_a_value_is_shown_as_python_writes_it_up_to_the_bound(value: Any) -> None:
    written = repr(value)
    assert short_repr(value) == written if len(written) <= MAX_REPR else len(short_repr(value)) <= MAX_REPR


class Hostile:
    def __repr__(self) -> str:
        raise RuntimeError('no')


def test_nothing_raises_and_a_value_is_cut_before_it_is_written() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    for value in (Hostile(), 10**5000, deep, 'x' * 10**7, [['x' * 10**6] * 1000] * 1000):  # the last would be 1 TB
        assert 0 < len(short_repr(value)) <= MAX_REPR, type(value)


@total_ordering
class Counted:
    work = 0

    def __repr__(self) -> str:
        Counted.work += 1
        return 'c'

    def __lt__(self, other: object) -> bool:
        Counted.work += 1
        return id(self) < id(other)


def nested(depth: int) -> list[Any]:
    return [nested(depth - 1) if depth else Counted() for _ in range(30)]


def test_what_is_left_out_is_not_looked_at() -> None:
    many = [Counted() for _ in range(10_000)]
    value: Any
    for value in (nested(3), set(many), frozenset(many), dict.fromkeys(many), OrderedDict.fromkeys(many), many):
        Counted.work = 0
        assert 'c' in short_repr(value) and Counted.work < 5 * MAX_REPR, type(value)
    large = bytes(10**7)
    for value in (large, bytearray(large), {'data': large}):
        tracemalloc.start()
        assert 'x00' in short_repr(value)
        assert tracemalloc.get_traced_memory()[1] < 10**5
        tracemalloc.stop()


def test_what_is_derived_from_a_collection_is_shown_with_its_type() -> None:
    class Name(str): ...

    assert short_repr(Name('n')) == "'n'"
    assert short_repr(OrderedDict(a=1)) == "OrderedDict({'a': 1})"
