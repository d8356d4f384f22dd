# SPDX-License-Identifier: BSD-3-Clause
"""Who wrote what: random scripts behave the same while they are watched, and each write has its node."""

from __future__ import annotations

import random
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.blackboard_watch import MOST_WRITES, BlackboardWatch
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.ports import INT
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees.scripted_nodes import registry

TICKS = 30  # more than it takes until code is made for a script


def tree_of(chance: random.Random, board: Blackboard) -> Tree:
    keys = 'abc'

    def script(number: int) -> str:
        key, other = chance.choice(keys), chance.choice(keys)
        code = chance.choice((f'{key} := {other} + 1', f'{key} += 2', f'{key} := {chance.randrange(9)}'))
        after = chance.choice(('', f' _onSuccess="{other} := {number}"', f' _post="{key} := {other}"'))
        return f'<Script name="s{number}" code="{code}"{after}/>'

    first = ''.join(f'<Script name="first_{key}" code="{key} := 1"/>' for key in keys)
    inner = ''.join(script(number) for number in range(8))
    xml = (
        f'<root BTCPP_format="4" main_tree_to_execute="T"><BehaviorTree ID="T"><Sequence>{first}'
        f'<SubTree ID="I" name="inner" _autoremap="true"/></Sequence></BehaviorTree>'
        f'<BehaviorTree ID="I"><Sequence>{inner}</Sequence></BehaviorTree></root>'
    )
    return Tree(TreeLibrary([load_xml(xml, 'watch.xml', registry())]), 'T', blackboard=board, clock=ManualClock())


@pytest.mark.parametrize('seed', range(15))
def test_watched_trees_do_the_same_and_each_write_is_counted(seed: int) -> None:
    plain, watched = Blackboard(), Blackboard()
    trees = [tree_of(random.Random(seed), board) for board in (plain, watched)]
    watch, clock = BlackboardWatch(lambda: 7.0), trees[1]
    boards = [subtree.blackboard for subtree in clock.subtrees]
    begin, end = sorted(random.Random(seed).sample(range(TICKS), 2))
    before: dict[str, int] = {}
    for tick in range(TICKS):
        if tick == begin:
            before = {key: entry.sequence for key, entry in watched.entries().items()}
            watch.watch('me', boards)
        if tick == end:
            for key, entry in watched.entries().items():
                writes = watch.writes(entry)
                assert writes.count == entry.sequence - before.get(key, 0), key
                assert len(writes.latest) == min(writes.count, MOST_WRITES)
                names = {one.writer.partition(' (')[0] for one in writes.latest}
                assert names <= {*(f'inner/s{number}' for number in range(8)), *(f'first_{key}' for key in 'abc')}
                if writes.count:
                    assert (writes.latest[0].value, writes.latest[0].when) == (repr(entry.value), 7.0)
            watch.leave('me')
            assert {type(entry) for entry in watched.entries().values()} == {Entry}
        assert trees[0].tick_exactly_once() is trees[1].tick_exactly_once()
        assert plain.snapshot() == watched.snapshot()


def test_an_entry_that_two_watch_is_watched_until_both_have_left() -> None:
    board, other = Blackboard(), Blackboard()
    watch = BlackboardWatch(lambda: 0.0)
    for client in ('a', 'b'):
        watch.watch(client, [board])
    made, plain = board.declare('typed', INT), other.declare('typed', INT)
    assert (made.value, made.type, made.sequence, made.present) == (plain.value, INT, plain.sequence, plain.present)
    board.unset('typed')
    assert not watch.writes(made).count, 'nobody can ask for what is removed'
    silent = board.declare('silent', None)
    board.set('new', 1)  # created while it is watched
    board.set('new', 2)
    entry = board.entry('new')
    assert entry is not None
    board.put('new', EMPTY, entry.type)
    assert [(one.writer, one.value) for one in watch.writes(entry).latest] == [('', 'nothing'), ('', '2'), ('', '1')]
    watch.watch('a', [other])
    board.set('new', 3)
    assert watch.writes(entry).count == 4
    watch.leave('b')
    watch.leave('nobody')
    board.set('new', 4)
    board.set('later', 5)
    assert {type(one) for one in (entry, silent, board.entry('later'))} == {Entry} and not watch.writes(entry).count
    board.unset('new')
    assert not watch.is_watching('b') and watch.is_watching('a')


def test_entries_that_others_create_on_a_shared_blackboard_are_watched() -> None:
    shared, watch = Blackboard(), BlackboardWatch(lambda: 0.0)
    ours, theirs = (shared.with_own(['own']) for _ in range(2))
    watch.watch('a client', [ours])
    for board, key in ((ours, 'ours'), (theirs, 'theirs'), (shared, 'given')):
        Blackboard(board).set(f'@{key}', 1)
    theirs.set('own', 1)
    counts = {key: watch.writes(entry).count for key, entry in ours.entries().items()}
    assert counts == {'ours': 1, 'theirs': 1, 'given': 1}
    watch.leave('a client')
    shared.set('later', 1)
    assert {type(entry) for board in (ours, theirs) for entry in board.entries().values()} == {Entry}


def test_a_client_leaves_while_a_tree_removes_an_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    board, watch = Blackboard(), BlackboardWatch(lambda: 0.0)
    board.set('k', 1)
    watch.watch('a client', [board])

    class RemovedMeanwhile(dict[Entry, Any]):
        def keys(self) -> Any:
            found = set(super().keys())
            board.unset('k')
            return found

    monkeypatch.setattr(watch, '_writes', RemovedMeanwhile(watch._writes))
    watch.leave('a client')
    assert not watch.is_watching('a client')
    board.set('k', 2)
    assert type(board.entry('k')) is Entry
