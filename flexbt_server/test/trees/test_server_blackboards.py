# SPDX-License-Identifier: BSD-3-Clause
"""The blackboards of a server: made by who writes, released when nobody works on them, and bounded."""

from __future__ import annotations

import gc

import pytest

from flexbt_common.errors import LimitExceededError
from flexbt_common.values.entries import Encoding, to_entry
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BlackboardError
from flexbt_msgs.msg import BlackboardEntry
from flexbt_server.trees.blackboards import MOST_BLACKBOARDS, MOST_KEYS, Blackboards, entries_of, write_all


def give(boards: Blackboards, name: str, *entries: BlackboardEntry) -> None:
    write_all(boards.get(name), boards.receive(name, entries))


def test_who_reads_makes_none() -> None:
    boards = Blackboards()
    for number in range(1000):
        assert not boards.find(f'read {number}').keys()
    assert len(boards._named) == 0


def test_of_those_on_which_nobody_works_the_latest_stay() -> None:
    boards = Blackboards()
    give(boards, '', to_entry('here', 1))
    in_use = boards.get('in use')
    for number in range(2 * MOST_BLACKBOARDS):
        give(boards, f'board {number}', to_entry('number', number))
        boards.get('named again and again')
    gc.collect()
    assert len(boards._named) == MOST_BLACKBOARDS + 1  # with the one in use
    assert boards.find('in use') is in_use
    assert boards.find('').get('here') == 1
    assert boards.find(f'board {2 * MOST_BLACKBOARDS - 1}').get('number') == 2 * MOST_BLACKBOARDS - 1
    assert not boards.find('board 0').keys()


def test_entries_are_bounded() -> None:
    boards = Blackboards()
    give(boards, 'full', *(to_entry(f'key {number}', number) for number in range(MOST_KEYS)))
    with pytest.raises(LimitExceededError, match=f"'full' has {MOST_KEYS} entries; 1 more"):
        boards.receive('full', [to_entry('one more', 1)])
    give(boards, 'full', to_entry('key 0', 2))
    boards.get('full').unset('key 1')
    give(boards, 'full', to_entry('one more', 1))


def test_the_size_of_all_values_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.trees.blackboards.MOST_VALUES', 10_000)
    boards = Blackboards()
    for name in ('one', 'other'):
        give(boards, name, to_entry('large', 'x' * 4000))
    with pytest.raises(LimitExceededError, match='would have 12006 bytes; at most 10000'):
        boards.receive('', [to_entry('large', 'x' * 4000)])
    assert 'large' not in boards.get('')
    for name in ('one', 'other'):
        give(boards, name, to_entry('large', ''))
    give(boards, '', to_entry('large', 'x' * 4000))
    boards.get('').unset('large')
    give(boards, '', to_entry('other', 'x' * 8000))


def test_what_is_more_than_a_message_is_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.trees.blackboards.MESSAGE', 10_000)
    board = Blackboards().get('')
    for key in 'abc':
        board.set(key, 'x' * 4000)
    entries, missing, problems = entries_of(board, ['a', 'b', 'c'], Encoding.TEXT)
    assert [entry.key for entry in entries] == ['a', 'b']
    assert not missing
    assert problems == ["the values from 'c' on are more than 10000 bytes; ask for fewer keys at a time"]


def test_all_values_are_written_or_none() -> None:
    board = Blackboard()
    board.set('count', 1)
    subtree = Blackboard(board)
    subtree.remap('out', 'count')
    subtree.set('out', 'many')  # text in an entry of numbers
    with pytest.raises(BlackboardError, match="holds 'many'"):
        write_all(board, [('speed', 0.5, None), ('count', 2, None)])
    assert 'speed' not in board
