# SPDX-License-Identifier: BSD-3-Clause
"""The engine against BehaviorTree.CPP: random trees, every status of every node, every call of a leaf, every entry."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_testing.behavior_trees import conformance as bt_conformance
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees import wheel as bt_wheel
from flexbt_testing.behavior_trees.random_trees import script_case, wheel_case

needs_wheel = pytest.mark.skipif(
    not bt_wheel.available(),
    reason='the judge is not installed: pip install behaviortreepy==0.1.4 (BehaviorTree.CPP 4.8.2, a test dependency)',
)

DOCUMENT = '<root BTCPP_format="4"><BehaviorTree ID="Main">{}</BehaviorTree></root>'


@needs_wheel
@pytest.mark.parametrize('block', bt_conformance.BLOCKS)
def test_trees_of_the_corpus_give_the_trace_of_btcpp(block: int) -> None:
    seeds = range(block * 350, (block + 1) * 350)
    cases = map(wheel_case, seeds)
    for seed, (case, expected, found) in zip(seeds, bt_conformance.compare(cases), strict=True):
        assert not found, f'seed {seed}: {found}\n{case["xml"]}'
        assert 'crash' not in expected


def test_random_trees_are_reproducible_and_cover_the_nodes() -> None:
    cases = [make_case(seed) for make_case in (wheel_case, script_case) for seed in range(300)]
    assert cases == [make_case(seed) for make_case in (wheel_case, script_case) for seed in range(300)]
    text = ''.join(case['xml'] for case in cases)
    for manifest in bt_scripted.registry():
        if manifest.id == 'TryCatch':
            continue  # not in the library of the wheel
        assert f'<{manifest.id}' in text or f'"{manifest.id}"' in text, f'no case has a {manifest.id}'


@needs_wheel
@pytest.mark.parametrize(
    ('body', 'ops'),
    [
        # A timer that fires between two ticks: halted there by the library, at the next tick by the engine.
        ('<Timeout msec="40" name="t"><Act name="a" _script="R"/></Timeout>', [['tick'], ['sleep'], ['tick']]),
        ('<Timeout msec="40" name="t"><Act name="a" _script="RS"/></Timeout>', [['tick'], ['tick'], ['sleep']]),
        # The limit passes while the child is skipped: then there is none any more.
        (
            '<Timeout msec="40" name="t"><Act name="a" _script="KRRR"/></Timeout>',
            [['tick'], ['sleep'], ['tick'], ['tick'], ['sleep'], ['tick']],
        ),
        (
            '<Delay delay_msec="40" name="d"><Act name="a" _script="RS"/></Delay>',
            [['tick'], ['sleep'], *[['tick']] * 3],
        ),
        (
            '<Delay delay_msec="40" name="d"><Act name="a"/></Delay>',
            [['tick'], ['halt'], ['tick'], ['sleep'], ['tick']],
        ),
        ('<Sleep msec="40" name="s"/>', [['tick'], ['tick'], ['sleep'], ['tick'], ['tick']]),
        (
            '<Fallback name="f"><Timeout msec="40" name="t"><Parallel name="p"><Act name="a" _script="R"/>'
            '<Act name="b" _script="RRR"/></Parallel></Timeout><Act name="c"/></Fallback>',
            [['tick'], ['tick'], ['sleep'], ['tick']],
        ),
    ],
)
def test_timed_nodes_give_the_trace_of_btcpp(body: str, ops: list[list[object]]) -> None:
    """On a busy machine the library's thread of timers may be late: then both get more time."""

    def flat(trace: dict[str, list[dict[str, object]]]) -> list[object]:
        return [event for step in trace['steps'] for event in step['events']]  # type: ignore[attr-defined]

    for pause in (150, 1000, 5000):
        case = {
            'xml': DOCUMENT.format(body),
            'bb': {},
            'ops': [['sleep', pause] if op == 'sleep' else [op] for (op,) in ops],
        }
        (expected,) = bt_wheel.traces([case])
        actual = bt_scripted.Run(case).trace()
        if flat(actual) == flat(expected):
            break
    assert flat(actual) == flat(expected)
    assert [step['status'] for step in actual['steps']] == [step['status'] for step in expected['steps']]


CHOICE = '<Switch2 variable="{y}" case_1="1" case_2="2"><AlwaysSuccess/><AlwaysFailure/><AlwaysFailure/></Switch2>'
SUB_TREE = '<SubTree ID="Sub" name="sub" x="{x}"/>'


# A tree, and its sub-tree.
SURPRISES = [
    # Text for an entry that has no type: it is emptied, and refuses text then; numbers it takes.
    ('<Sequence><Script code="x := 1"/><SetBlackboard value="5" output_key="x"/></Sequence>', ''),
    ('<Sequence><Script code="x := 1"/><SetBlackboard value="{t}" output_key="x"/></Sequence>', ''),
    ('<Sequence><Script code="x := 1"/><SetBlackboard value="{n}" output_key="x"/></Sequence>', ''),
    (
        '<Sequence><SetBlackboard value="{x}" output_key="y"/><SetBlackboard value="{y}" output_key="x"/></Sequence>',
        '',
    ),
    # Through the port of a sub-tree it stays without a type.
    (f'<Sequence><Script code="x := 1"/>{SUB_TREE}</Sequence>', '<SetBlackboard value="5" output_key="x"/>'),
    (f'<Fallback>{SUB_TREE}<AlwaysSuccess/></Fallback>', '<SetBlackboard value="5" output_key="x"/>'),
    # Text in an entry of numbers: what the scope that has it can still write.
    *(
        (f'<Sequence>{SUB_TREE}{write}</Sequence>', '<Act name="w" _write="n:s:7"/>')
        for write in (
            '<Act name="v" _write="n:i:3"/>',
            '<Act name="v" _write="n:s:3"/>',
            '<SetBlackboard value="3" output_key="n"/>',
            '<SetBlackboard value="{n}" output_key="n"/>',
            '<Script code="n = 3"/>',
            '<Script code="n = \'3\'"/>',
            '<Script code="n += 1"/>',
            '<LoopInt queue="1;2;3" value="{n}"><AlwaysSuccess/></LoopInt>',
            '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>',
        )
    ),
    # The first number that an entry of integers gets is a real one: it stays that of reals, also for text.
    (
        '<Sequence><Act name="v" _write="y:d:3.0;y:i:1;y:s:9" _read="y"/><Repeat num_cycles="{y}"><AlwaysSuccess/>'
        '</Repeat></Sequence>',
        '',
    ),
    # A number in an entry of text, which a script has assigned before: where a copy of it can be written.
    *(
        (f'<Sequence><Script code="y := 1"/>{CHOICE}<SetBlackboard value="{{y}}" output_key="{key}"/></Sequence>', '')
        for key in ('z', 'x', 't', 'n')
    ),
    # A key that is the content of an entry: of any type, which the port does not fix.
    ('<Sequence><SetBlackboard value="a" output_key="{n}"/><SetBlackboard value="b" output_key="{x}"/></Sequence>', ''),
    (
        '<Sequence><Script code="y := 1"/><SetBlackboard value="a" output_key="{y}"/><Act name="v" _write="y:i:3"/>'
        '</Sequence>',
        '',
    ),
    ('<Sequence><Repeat num_cycles="{n}"><SetBlackboard value="{t}" output_key="{n}"/></Repeat></Sequence>', ''),
    # A condition that is the content of an entry, of any type.
    ('<Fallback><ScriptCondition code="{n}"/><Act name="v" _write="n:i:1"/></Fallback>', ''),
    ('<Sequence><Act name="v" _write="n:i:1"/><ScriptCondition code="{n}"/><Script code="n = 0"/></Sequence>', ''),
    # An entry that a node watches, before it is written.
    ('<Fallback><WasEntryUpdated entry="{y}"/><Script code="y := \'a\'"/></Fallback>', ''),
    ('<Fallback><WasEntryUpdated entry="{y}"/><Script code="y := 1; y := \'2\'"/></Fallback>', ''),
    ('<Fallback><WasEntryUpdated entry="{y}"/><SetBlackboard value="a" output_key="y"/></Fallback>', ''),
    ('<Fallback><WasEntryUpdated entry="{y}"/><Act name="v" _write="y:s:a;y:s:b;y:i:2" _read="y"/></Fallback>', ''),
    # A condition whose result stands, and is not asked anew.
    ('<IfThenElse><Act name="c" _script="F" _post="n += 1"/><AlwaysSuccess/></IfThenElse>', ''),
    # Integers of a script that the type of their entry has no room for.
    ('<Sequence><Script code="n = 3000000000"/><Script code="n = n - 1"/></Sequence>', ''),
    ('<Sequence><Script code="n = 3000000000"/><Repeat num_cycles="{n}"><AlwaysFailure/></Repeat></Sequence>', ''),
]
BOARDS: list[dict[str, Any]] = [{'n': 2, 't': 'text'}, {'n': 2, 't': '7', 'x': 'old'}, {'n': 2, 't': '', 'x': 0.5}]


def surprises(body: str, sub_tree: str) -> list[dict[str, Any]]:
    """Return the tree on each blackboard."""
    trees = f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
    if sub_tree:
        trees += f'<BehaviorTree ID="Sub">{sub_tree}</BehaviorTree>'
        trees = trees.replace('x="{x}"', 'x="{x}" n="{n}"')
    xml = f'<root BTCPP_format="4" main_tree_to_execute="Main">{trees}</root>'
    return [{'xml': xml, 'bb': board, 'ops': [['tick'], ['tick'], ['tick']]} for board in BOARDS]


@pytest.fixture(scope='module')
def traces_of_btcpp() -> dict[str, object]:
    """Of all surprises, from one process."""
    cases = [case for surprise in SURPRISES for case in surprises(*surprise)]
    return {str(case): trace for case, trace in zip(cases, bt_wheel.traces(cases), strict=True)}


@needs_wheel
@pytest.mark.parametrize(('body', 'sub_tree'), SURPRISES)
def test_a_surprise_is_the_same_as_in_btcpp(body: str, sub_tree: str, traces_of_btcpp: dict[str, Any]) -> None:
    for case in surprises(body, sub_tree):
        expected = traces_of_btcpp[str(case)]
        assert not expected['load_error']
        found = bt_conformance.difference(expected, bt_scripted.Run(case).trace())
        assert not found, found


# What the engine does differently on purpose: why, tree, operations, then the entry [new] there and here.
ON_PURPOSE = [
    (
        'false fits into an entry of integers as true does',
        '<Act name="a" _write="new:b:0"/>',
        [['set', 'new', 'i', 3], ['tick']],
        ['i', '3'],
        ['i', '0'],
    ),
]


@needs_wheel
@pytest.mark.parametrize(('why', 'body', 'ops', 'theirs', 'ours'), ON_PURPOSE, ids=[row[0] for row in ON_PURPOSE])
def test_differs_on_purpose(why: str, body: str, ops: list[list[object]], theirs: list[str], ours: list[str]) -> None:
    case = {'xml': DOCUMENT.format(body), 'bb': {}, 'ops': ops}
    (expected,) = bt_wheel.traces([case])
    assert expected['steps'][-1]['bb']['']['new'] == theirs
    assert bt_scripted.Run(case).trace()['steps'][-1]['bb']['']['new'] == ours
