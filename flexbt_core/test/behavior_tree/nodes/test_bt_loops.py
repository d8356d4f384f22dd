# SPDX-License-Identifier: BSD-3-Clause
"""Loops over queues, decorators and an action that look for writes, and RunOnce. Rules of BehaviorTree.CPP 4.10."""

from __future__ import annotations

from collections import deque
from typing import Any

import pytest

from flexbt_core.behavior_tree.model.errors import NodeExecutionError, PortError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import BOOL, INT, PortType
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.loops import Loop
from flexbt_testing.behavior_trees.steps import NAMES, check, first_failure, make, step


def loop(script: str, queue: str, tag: str = 'LoopInt', **ports: str) -> str:
    attributes = ''.join(f' {name}="{value}"' for name, value in ports.items())
    return f'<{tag} name="loop" queue="{queue}" value="{{v}}"{attributes}>{step(script)}</{tag}>'


def retry(first: str) -> str:
    return f'<RetryUntilSuccessful num_attempts="{{n}}"><Sequence>{first}{step("F")}</Sequence></RetryUntilSuccessful>'


def watch(tag: str, script: str, entry: str = '{x}') -> str:
    return f'<{tag} name="watch" entry="{entry}">{step(script)}</{tag}>'


# What happens to a tree, in the notation of flexbt_testing.behavior_trees.steps.
VECTORS: list[tuple[str, str]] = [
    # An element a tick; when none is left, one more.
    (loop('S', '1;2;3'), 'R 0S | R 0S | R 0S | S'),
    (loop('RS', '1;2'), 'R 0R | R 0S | R 0R | R 0S | S | R 0R'),
    (loop('SF', '1;2;3'), 'R 0S | F 0F | R 0S'),
    (loop('K', '1;2'), 'R 0K | R 0K | S'),
    (loop('S', ''), 'S'),
    (loop('S', '', if_empty='FAILURE'), 'F'),
    (loop('S', '1', if_empty='FAILURE'), 'R 0S | F | R 0S | F'),
    (loop('S', '', if_empty='SKIPPED'), 'K'),
    (loop('S', '', if_empty='RUNNING'), 'R | R'),
    (loop('S', '', if_empty='IDLE'), 'error'),
    # The element that was being worked on is lost by a halt, and the next run begins with the first.
    (loop('SR', '1;2;3'), 'R 0S | R 0R | halt 0! | R 0S'),
    (loop('S', '1;2'), 'R 0S | halt | R 0S | R 0S | S'),
    (loop('S', '0.5', tag='LoopDouble'), 'R 0S | S'),
    # A text on the blackboard is a queue, of which each run takes a copy.
    (loop('S', '{q}'), "q='1;2' R 0S | R 0S | S | R 0S"),
    (loop('S', '{q}'), "q='1;' R 0S | q='1;2' S | R 0S | -q R 0S | S | error"),
    (loop('S', '{q}'), "q='x' error"),
    (loop('S', '{q}'), 'error'),
    (loop('S', '{q}'), 'q=5 error'),
    # The number of attempts may change, or be removed, while the node is at work.
    (retry('<Script code="n := 2"/>'), 'n=4 F 0F 0F'),
    (retry('<Script code="n := 4"/>'), 'n=1 F 0F 0F 0F 0F'),
    (retry('<UnsetBlackboard key="n"/>'), 'n=2 error 0F'),
    ('<SetBlackboard value="{x}" output_key="y"/>', 'F | -x error | x=1 S'),
    # RunOnce
    (f'<RunOnce>{step("RS")}</RunOnce>', 'R 0R | S 0S | K | halt | K'),
    (f'<RunOnce>{step("RFS")}</RunOnce>', 'R 0R | halt 0! | F 0F | K'),
    (f'<RunOnce>{step("KS")}</RunOnce>', 'K 0K | S 0S | K'),
    (f'<RunOnce then_skip="false">{step("FS")}</RunOnce>', 'F 0F | F | halt | F'),
    (f'<RunOnce then_skip="{{x}}">{step("S")}</RunOnce>', "S 0S | K | x='false' S | x='true' K | -x K"),
    # SkipUnlessUpdated: a write, not a change; and one that was seen before a halt is used up.
    (watch('SkipUnlessUpdated', 'S'), 'K | x=1 S 0S | K | x=1 S 0S | x=2 x=3 S 0S | K'),
    (watch('SkipUnlessUpdated', 'RF'), 'x=1 R 0R | x=2 F 0F | R 0R | halt 0! | K | x=2 F 0F'),
    (watch('SkipUnlessUpdated', 'KS'), 'x=1 K 0K | K | x=1 S 0S'),
    (watch('SkipUnlessUpdated', 'S', 'x'), 'K | x=1 S 0S | K'),
    (watch('SkipUnlessUpdated', 'S', '{@x}'), 'K | x=1 S 0S | K'),
    # Removed and written as often as before: not noticed.
    (watch('SkipUnlessUpdated', 'S'), 'x=1 S 0S | -x K | x=2 K | x=2 S 0S'),
    # WaitValueUpdate
    (watch('WaitValueUpdate', 'S'), 'R | R | x=1 S 0S | R | halt | R | x=1 S 0S'),
    (watch('WaitValueUpdate', 'RS'), 'x=1 R 0R | S 0S | R | x=2 R 0R | halt 0! | R | x=3 S 0S'),
    (watch('WaitValueUpdate', 'K'), 'x=1 K 0K | R'),
    # WasEntryUpdated
    ('<WasEntryUpdated entry="{x}"/>', 'F | x=1 S | F | x=1 S | halt | F | -x F'),
    ('<WasEntryUpdated entry="x"/>', 'F | x=1 S | F'),
]


@pytest.mark.parametrize(('body', 'expected'), VECTORS)
def test_tick_by_tick(body: str, expected: str) -> None:
    check(body, expected)


def elements(queue: Any, tag: str = 'LoopInt') -> list[Any]:
    """Return the values that a loop over a queue on the blackboard writes."""
    tree, _ = make(loop('S', '{q}', tag))
    tree.blackboard.set('q', queue)
    seen = []
    while tree.tick_once() is NodeStatus.RUNNING:
        seen.append(tree.blackboard.get('v'))
    entry = tree.blackboard.entry('v')
    assert entry is not None and entry.sequence == len(seen)
    return seen


@pytest.mark.parametrize(
    ('tag', 'text', 'values'),
    [
        ('LoopInt', '1;-2;3', [1, -2, 3]),
        ('LoopDouble', '1;2.5', [1.0, 2.5]),
        ('LoopString', 'a;;b c;', ['a', '', 'b c']),
        ('LoopBool', 'true;0', [True, False]),
    ],
)
def test_elements_have_the_type_of_the_loop_whatever_the_queue_is(tag: str, text: str, values: list[Any]) -> None:
    for queue in (text, list(values), tuple(values), deque(values)):
        seen = elements(queue, tag)
        assert seen == values
        assert [type(value) for value in seen] == [type(value) for value in values]
    tree, _ = make(loop('S', text, tag))
    assert [NAMES[tree.tick_once()] for _ in range(len(values) + 1)] == ['R'] * len(values) + ['S']


def test_an_element_of_another_type_is_an_error_that_names_the_port() -> None:
    tree, _ = make(loop('S', '{q}'))
    tree.blackboard.set('q', [1, 'two'])
    assert tree.tick_once() is NodeStatus.RUNNING
    with pytest.raises(NodeExecutionError, match=r'port \[value\].*loop') as caught:
        tree.tick_once()
    assert isinstance(caught.value.cause, PortError)


def test_a_list_is_left_as_it_is_and_a_deque_is_emptied() -> None:
    kept, shared = [1, 2], deque([1, 2])
    elements(kept)
    elements(shared)
    assert (kept, list(shared)) == ([1, 2], [])


def test_elements_may_be_added_to_a_deque_while_the_loop_runs_and_after_a_halt_the_rest_is_there() -> None:
    tree, _ = make(loop('S', '{q}'))
    queue = deque([1])
    tree.blackboard.set('q', queue)
    assert tree.tick_once() is NodeStatus.RUNNING
    queue.extend([2, 3])
    assert tree.tick_once() is NodeStatus.RUNNING
    tree.halt()
    assert list(queue) == [3]
    assert tree.tick_once() is NodeStatus.RUNNING
    assert tree.blackboard.get('v') == 3
    # Another deque in the middle of a run is followed.
    tree.blackboard.set('q', deque([7]))
    assert tree.tick_once() is NodeStatus.RUNNING
    assert tree.blackboard.get('v') == 7
    assert tree.tick_once() is NodeStatus.SUCCESS


def test_two_loops_share_a_deque() -> None:
    body = f'<ParallelAll>{loop("S", "{q}")}<LoopInt queue="{{q}}" value="{{w}}">{step("S", 1)}</LoopInt></ParallelAll>'
    tree, calls = make(body)
    tree.blackboard.set('q', deque(range(5)))
    while tree.tick_once() is NodeStatus.RUNNING:
        pass
    assert sorted(calls) == ['0S'] * 3 + ['1S'] * 2


@pytest.mark.parametrize(
    ('body', 'message'),
    [
        (loop('S', '1;x'), r'port \[queue\] of type queue of int'),
        (loop('S', '1', if_empty='empty'), r'port \[if_empty\].*not a status'),
        ('<LoopInt value="{v}"><AlwaysSuccess/></LoopInt>', r'port \[queue\].*is missing'),
        ('<LoopInt queue="1" value="v"><AlwaysSuccess/></LoopInt>', r'output port \[value\] has to point'),
        ('<WasEntryUpdated/>', r'port \[entry\] of type BT::Any of \[WasEntryUpdated\] is missing'),
        ('<WasEntryUpdated entry=""/>', r'port \[entry\].*cannot be empty'),
        ('<RunOnce then_skip="yes"><AlwaysSuccess/></RunOnce>', r'port \[then_skip\]'),
    ],
)
def test_what_is_wrong_is_said_at_load(body: str, message: str) -> None:
    with pytest.raises(TreeLoadError, match=message):
        make(body)


@pytest.mark.parametrize(
    ('content', 'message'),
    [
        ('1;x', "can't convert text 'x' to int"),
        (None, 'the blackboard has no such entry, or it was never written'),
        (7, 'a queue is a deque, a list, a tuple or a text, not a int'),
    ],
)
def test_a_queue_on_the_blackboard_that_cannot_be_used_is_an_error_of_the_port(content: Any, message: str) -> None:
    tree, _ = make(loop('S', '{q}'))
    if content is not None:
        tree.blackboard.set('q', content)
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    assert isinstance(caught.value.cause, PortError)
    assert str(caught.value.cause) == f'port [queue] (blackboard key [q]) of LoopInt at [loop]: {message}'
    assert caught.value.cause.is_absent is (content is None)


def test_a_write_through_a_remapping_is_seen_and_two_watchers_see_it_independently() -> None:
    tree, _ = make(f'<Sequence>{"".join(watch("SkipUnlessUpdated", "S") for _ in range(2))}</Sequence>')
    assert NAMES[tree.tick_once()] == 'K'
    tree.blackboard.set('x', 1)
    assert NAMES[tree.tick_once()] == 'S'


CAUSES = [
    (loop('SF', '1;2'), 'SF_0', 'Step returned FAILURE'),
    (loop('F', '', if_empty='FAILURE'), 'loop', 'LoopInt: the queue is empty (if_empty="FAILURE")'),
    (loop('S', '1', if_empty='FAILURE'), 'loop', 'LoopInt: the queue is empty (if_empty="FAILURE")'),
    ('<WasEntryUpdated name="w" entry="{x}"/>', 'w', 'WasEntryUpdated: entry [x] was not written since the last tick'),
    (f'<RunOnce name="once" then_skip="false">{step("RF")}</RunOnce>', 'RF_0', 'Step returned FAILURE'),
]


@pytest.mark.parametrize(('body', 'path', 'reason'), CAUSES)
def test_why_it_failed(body: str, path: str, reason: str) -> None:
    assert first_failure(f'<Sequence name="root">{body}</Sequence>')[:2] == (path, reason)


@pytest.mark.parametrize('tag', ['SkipUnlessUpdated', 'WaitValueUpdate'])
def test_the_child_of_an_update_decorator_is_why_it_fails(tag: str) -> None:
    tree, _ = make(watch(tag, 'RF'))
    tree.blackboard.set('x', 1)
    assert [NAMES[tree.tick_once()] for _ in range(2)] == ['R', 'F']
    assert tree.failure is not None
    assert tree.failure.chain == ('watch', 'RF_0')


def test_a_result_that_is_remembered_keeps_its_reason() -> None:
    tree, _ = make(f'<RunOnce name="once" then_skip="false">{step("FS")}</RunOnce>')
    for _ in range(2):
        assert tree.tick_once() is NodeStatus.FAILURE
        assert tree.failure is not None
        assert tree.failure.path == 'FS_0'


PAIR = PortType('pair', tuple, from_text=lambda text: tuple(map(int, text.split(','))), immutable=True)


class LoopPair(Loop, element=PAIR):
    """A loop of a user."""


def test_a_loop_over_elements_of_ones_own_type_is_a_class_of_one_line() -> None:
    tree, _ = make('<LoopPair queue="1,2;3,4" value="{v}"><AlwaysSuccess/></LoopPair>', extra=(LoopPair,))
    seen = []
    while tree.tick_once() is NodeStatus.RUNNING:
        seen.append(tree.blackboard.get('v'))
    assert seen == [(1, 2), (3, 4)]
    with pytest.raises(TreeLoadError, match='queue of pair'):
        make('<LoopPair queue="1,x" value="{v}"><AlwaysSuccess/></LoopPair>', extra=(LoopPair,))


@pytest.mark.parametrize('value', ['5', '{v}'])
@pytest.mark.parametrize('key', ['a', '{k}'])
def test_a_key_that_is_on_the_blackboard_is_looked_up_for_each_write(value: str, key: str) -> None:
    tree, _ = make(f'<SetBlackboard value="{value}" output_key="{key}"/>')
    board = tree.blackboard
    for name in 'ab':
        board.declare(name, INT)
    board.set('v', 5)
    for board_key in ('a', 'a', 'b', 'a'):
        board.set('k', board_key)
        for name in 'ab':
            board.set(name, 0)
        assert tree.tick_once() is NodeStatus.SUCCESS
        written = board_key if key == '{k}' else 'a'
        assert (board.get('a'), board.get('b')) == ((5, 0) if written == 'a' else (0, 5))


@pytest.mark.parametrize(('value', 'problem'), [('far', r"entry \[a\]: .*'far'"), ('{b}', r'\[a\].*int.*bool')])
def test_what_an_entry_cannot_take_is_refused_with_its_name(value: str, problem: str) -> None:
    tree, _ = make(f'<SetBlackboard value="{value}" output_key="a"/>')
    tree.blackboard.declare('a', INT)
    tree.blackboard.declare('b', BOOL)
    tree.blackboard.set('b', True)
    with pytest.raises(NodeExecutionError, match=problem):
        tree.tick_once()
