# SPDX-License-Identifier: BSD-3-Clause
"""What differs on purpose from BehaviorTree.CPP, and what the library does: rows of docs/reference/bt_differences.md.

Some differ from the library of the wheel (4.8.2) only, and are as in 4.10; these are marked.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees import wheel as bt_wheel

TICK = ['tick']


class Row(NamedTuple):
    why: str
    body: str
    ops: list[list[Any]]
    theirs: str
    ours: str
    board: dict[str, Any] = {}
    others: str = ''


def outcome(trace: dict[str, Any]) -> str:
    """Return the result of each step, with ``!`` and the names of the leaves that were halted in it."""
    if trace['load_error']:
        return 'load error'
    steps = []
    for step in trace['steps']:
        halted = ''.join(event[1] for event in step['events'] if event[0] == 'halt')
        result = 'error' if step['error'] else step['status'] or '-'
        steps.append(f'{result}!{halted}' if halted else result)
    return ' '.join(steps)


ROWS = [
    Row(
        'a default {=} in the model of a sub-tree means the entry with the name of the port',
        '<Sequence><SubTree ID="T"/><ScriptCondition code="out == 2"/></Sequence>',
        [TICK],
        'error',
        'S',
        others='<BehaviorTree ID="T"><Script code="out := 2"/></BehaviorTree><TreeNodesModel><SubTree ID="T">'
        '<output_port name="out" default="{=}"/></SubTree></TreeNodesModel>',
    ),
    Row(
        'the nodes of a sub-tree that is named like its tree have the path of the sub-tree, with its number',
        '<SubTree ID="T" name="T"/>',
        [TICK, ['halt']],
        'R -!T/a',
        'R -!T::1/a',
        others='<BehaviorTree ID="T"><Act name="a" _script="R"/></BehaviorTree>',
    ),
    Row(
        'a port writes a double to its entry, also if a script has set it to an integer',
        '<Sequence><Script code="x := 1"/><LoopDouble queue="2.5" value="{x}"><AlwaysSuccess/></LoopDouble></Sequence>',
        [TICK],
        'error',
        'R',
    ),
    Row(
        'the explicit form is accepted below a ReactiveSequence',
        '<ReactiveSequence><Action ID="AlwaysSuccess"/></ReactiveSequence>',
        [TICK],
        'load error',
        'S',
    ),
    Row(
        'a condition that is RUNNING is an error',
        '<ReactiveFallback><Cond name="c" _script="RF"/><Act name="a" _script="RS"/></ReactiveFallback>',
        [TICK],
        'R',
        'error',
    ),
    Row(
        'a port that a node cannot do without is missed at load',
        '<Repeat><AlwaysSuccess/></Repeat>',
        [TICK],
        'error',
        'load error',
    ),
    Row(
        'a status that is none is refused at load',
        '<LoopInt queue="" if_empty="success"><AlwaysSuccess/></LoopInt>',
        [TICK],
        'error',
        'load error',
    ),
    Row(
        'a port that cannot be read is an error, not true',
        '<RunOnce then_skip="{x}"><AlwaysSuccess/></RunOnce>',
        [TICK, TICK],
        'S K',
        'S error',
        {'x': 'neither'},
    ),
    Row(
        'a number fits into an entry of another width when its value does',
        '<Sequence><Act name="a" _write="x:i:5" _read="x"/><Delay delay_msec="{x}"><AlwaysSuccess/></Delay></Sequence>',
        [TICK],
        'error',
        'R',
    ),
    Row(
        'a remapping to @key means the entry key of the topmost scope, also when that does not exist yet',
        '<Sequence><SubTree ID="T" p="{@g}"/><Switch2 variable="{g}" case_1="5" case_2="7">'
        '<AlwaysSuccess/><AlwaysSuccess/><AlwaysFailure/></Switch2></Sequence>',
        [TICK],
        'F',
        'S',
        {},
        '<BehaviorTree ID="T"><SetBlackboard value="5" output_key="p"/></BehaviorTree>',
    ),
    Row(
        'an assignment to what is no name is refused at load',
        '<Fallback><AlwaysSuccess/><Script code="(1) = 2"/></Fallback>',
        [TICK],
        'S',
        'load error',
    ),
    Row('a condition that is empty is refused at load', '<ScriptCondition code=""/>', [TICK], 'error', 'load error'),
    Row('what is not a number has no bits', '<Script code="x := (~(0 / 0))"/>', [TICK], 'S', 'error'),
    Row(
        'a script of _onHalted that fails keeps no other node from being halted',
        '<Parallel><Act name="a" _script="R" _onHalted="z = 1"/><Act name="b" _script="R"/></Parallel>',
        [TICK, ['halt']],
        'R error!a',
        'R error!ab',
    ),
    Row(
        'as in 4.10: operators of one level are applied from left to right',
        '<ScriptCondition code="10 - 3 - 2 == 5"/>',
        [TICK],
        'F',
        'S',
    ),
    Row('as in 4.10: && binds tighter than ||', '<ScriptCondition code="1 || 0 &amp;&amp; 0"/>', [TICK], 'F', 'S'),
    Row('as in 4.10: semicolons may be repeated', '<Script code="x := 1;; y := 2;"/>', [TICK], 'load error', 'S'),
    Row('as in 4.10: groups of operators mix', '<Script code="x := !-1 &amp; 2 + 3"/>', [TICK], 'load error', 'S'),
    Row('as in 4.10: no sign before a number but -', '<Script code="x := +1"/>', [TICK], 'S', 'load error'),
    Row('as in 4.10: text in single quotes only', '<Script code="x := &quot;a&quot;"/>', [TICK], 'S', 'load error'),
    Row(
        'as in 4.10: true is a double',
        "<ScriptCondition code=\"('a' .. true) == 'a1.000000'\"/>",
        [TICK],
        'F',
        'S',
    ),
    Row(
        'as in 4.10: the decorators that watch an entry halt their child',
        '<ReactiveFallback><Cond name="c" _script="FS"/><SkipUnlessUpdated entry="{x}"><Act name="a" _script="R"/>'
        '</SkipUnlessUpdated></ReactiveFallback>',
        [TICK, TICK],
        'R S',
        'R S!a',
        {'x': 1},
    ),
    Row(
        'as in 4.10: a case is a number only as a whole',
        '<Switch2 variable="5abc" case_1="5" case_2="6"><AlwaysSuccess/><AlwaysSuccess/><AlwaysFailure/></Switch2>',
        [TICK],
        'S',
        'F',
    ),
]


def case_of(row: Row) -> dict[str, Any]:
    main = f'<BehaviorTree ID="Main">{row.body}</BehaviorTree>{row.others}'
    xml = f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}</root>'
    return {'xml': xml, 'bb': row.board, 'ops': row.ops}


@pytest.fixture(scope='module')
def traces_of_btcpp() -> dict[str, dict[str, Any]]:
    """Of each row, by its reason; from one process."""
    return dict(zip((row.why for row in ROWS), bt_wheel.traces(map(case_of, ROWS)), strict=True))


@pytest.mark.skipif(not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4')
@pytest.mark.parametrize('row', ROWS, ids=[row.why for row in ROWS])
def test_differs_on_purpose(row: Row, traces_of_btcpp: dict[str, dict[str, Any]]) -> None:
    assert outcome(traces_of_btcpp[row.why]) == row.theirs
    assert outcome(bt_scripted.Run(case_of(row)).trace()) == row.ours
