# SPDX-License-Identifier: BSD-3-Clause
"""What the check says of behaviors and the trees that they run."""

from __future__ import annotations

from pathlib import Path

import pytest
from behavior_tool_support import found

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_retry, with_timeout
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_states import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, BtSetDataState, WaitState

POSE = 'geometry_msgs/msg/PoseStamped'
PATH = 'nav_msgs/msg/Path'


def chain(*states: EventState) -> OperatableStateMachine:
    """States one after the other, S0, S1 ..., as long as each is done."""
    keys = sorted({key for state in states for key in state.input_keys})
    machine = OperatableStateMachine(outcomes=['done', 'failed'], input_keys=keys)
    with machine:
        for index, state in enumerate(states):
            after = f'S{index + 1}' if index + 1 < len(states) else 'done'
            ways = {outcome: after if outcome == 'done' else 'failed' for outcome in state.outcomes}
            OperatableStateMachine.add(f'S{index}', state, ways)
    return machine


def xml(body: str, tree: str = 'Main') -> str:
    return f'<root BTCPP_format="4"><BehaviorTree ID="{tree}">{body}</BehaviorTree></root>'


PLAN = '<ComputePathToPose goal="{goal}" path="{path}"/>'
FOLLOW = '<FollowPath path="{path}"/>'
SMOOTH = f'<Sequence>{PLAN}<SmoothPath unsmoothed_path="{{path}}" smoothed_path="{{smooth}}"/></Sequence>'
WAIT = '<Sequence><Wait wait_duration="5"/><Sleep msec="1000"/></Sequence>'


def test_states_and_trees_that_agree() -> None:
    machine = chain(
        BtLoaderState(xml=xml(PLAN, 'Plan')),
        BtLoaderState(xml=xml(FOLLOW, 'Follow')),
        BtExecuteGoalState(bt_file='Plan'),
        BtGetDataState(request_id='path', request_msg_type=PATH),
        BtExecuteState(bt_file='Follow'),
    )
    assert found(machine) == []


@pytest.mark.parametrize(
    ('states', 'expected'),
    [
        pytest.param(
            [BtLoaderState(xml=xml(PLAN)), BtExecuteState(bt_file='Mian')],
            [('no-tree', '/S1')],
            id='no such tree',
        ),
        pytest.param(
            [BtLoaderState(xml=xml('<NoSuchNode/>')), BtExecuteState(bt_file='Main')],
            [('broken-tree', '/S0')],
            id='unknown node',
        ),
        pytest.param(
            [
                BtLoaderState(xml=xml(PLAN, 'Plan')),
                BtLoaderState(xml=xml('<FollowPath path="{goal}"/>', 'Follow')),
                BtExecuteGoalState(bt_file='Plan'),
                BtExecuteState(bt_file='Follow'),
            ],
            [('broken-tree', '/S3')],
            id='two trees that use a key for different things',
        ),
        pytest.param(
            [BtLoaderState(xml=xml(PLAN)), BtExecuteGoalState(bt_file='Main', inputs={'gaol': POSE})],
            [('unread-key', '/S1')],
            id='a key that the tree does not read',
        ),
        pytest.param(
            [BtLoaderState(xml=xml(PLAN)), BtExecuteGoalState(bt_file='Main', outputs={'paht': PATH})],
            [('unwritten-key', '/S1')],
            id='an output that the tree does not write',
        ),
        pytest.param(
            [BtLoaderState(xml=xml(FOLLOW)), BtExecuteState(bt_file='Main')],
            [('unwritten-key', '/S1')],
            id='a key of the tree that nobody writes',
        ),
        pytest.param(
            [BtLoaderState(xml=xml(FOLLOW)), BtExecuteState(bt_file='Main', inputs={'path': POSE})],
            [('key-clash', '/S1')],
            id='a key of another type',
        ),
        pytest.param(
            [
                BtLoaderState(xml=xml(FOLLOW)),
                BtSetDataState(goal_id='path', goal_msg_type=PATH, blackboard='other'),
                BtExecuteState(bt_file='Main'),
            ],
            [('unwritten-key', '/S2'), ('unread-key', '/S1')],
            id='the key of another blackboard',
        ),
        pytest.param(
            [
                BtLoaderState(xml=xml(SMOOTH, 'Plan')),
                BtLoaderState(xml=xml(FOLLOW, 'Follow')),
                BtExecuteGoalState(bt_file='Plan'),
                BtExecuteState(bt_file='Follow'),
            ],
            [('lost-write', '/S2')],
            id='a value that gets to nobody',
        ),
        pytest.param(
            [
                BtLoaderState(xml=xml(SMOOTH, 'Plan')),
                BtLoaderState(xml=xml(FOLLOW, 'Follow')),
                BtExecuteGoalState(bt_file='Plan', outputs={'smooth': PATH}),
                BtExecuteState(bt_file='Follow'),
            ],
            [],
            id='a value that a state reads',
        ),
        pytest.param(
            [
                BtLoaderState(xml=xml(WAIT)),
                BtExecuteState(bt_file='Main', timeout=2.0),
                BtExecuteState(bt_file='Main', timeout=6.0),
                with_retry(with_timeout(WaitState(5.0), 1.0), 2, on=['timeout']),
                with_timeout(WaitState(5.0), 5.0),
            ],
            [('too-short', '/S3'), ('too-short', '/S1')],
            id='a time that is too short',
        ),
        pytest.param(
            [BtSetDataState(goal_id='path', goal_msg_type=PATH), BtExecuteState(bt_file='')],
            [],
            id='nothing is known of the default tree',
        ),
    ],
)  # fmt: skip
def test_disagreements(states: list[EventState], expected: list[tuple[str, str]]) -> None:
    assert found(chain(*states)) == expected


def test_a_tree_is_seen_through_attempts_and_time_limits(tmp_path: Path) -> None:
    file = tmp_path / 'main.xml'
    file.write_text(xml(FOLLOW))
    states = [BtLoaderState(filepaths=[str(file)]), with_retry(with_timeout(BtExecuteState(bt_file=str(file)), 5.0), 2)]
    assert ('unwritten-key', '/S1') in found(chain(*states))


def test_files_of_the_server_and_their_errors_have_a_place(tmp_path: Path) -> None:
    file = tmp_path / 'trees.xml'
    file.write_text(xml(FOLLOW))
    machine = chain(BtExecuteState(bt_file='Main', inputs={'path': PATH}))
    assert found(machine) == [('no-tree', '/S0')]
    again = chain(BtExecuteState(bt_file='Main', inputs={'path': PATH}))
    assert found(again, str(file)) == []
    broken = tmp_path / 'broken.xml'
    broken.write_text('<root BTCPP_format="4">\n<BehaviorTree ID="B"><Nonsense/></BehaviorTree></root>')
    both = chain(BtExecuteState(bt_file='Main', inputs={'path': PATH}))
    assert found(both, str(file), str(broken)) == [('broken-tree', '')]


@pytest.mark.parametrize(
    ('label', 'tree', 'rules'),
    [
        ('Recover', 'Recovery', []),
        ('Recover', 'Navigation', [('other-tree', '/Recover')]),
        ('Drive', 'Navigation', []),  # it is called after none
        ('NavigateHome', 'Recovery', []),
        ('Navigation', 'Recovery', [('other-tree', '/Navigation')]),
    ],
)
def test_a_state_that_is_called_after_another_tree(label: str, tree: str, rules: list[tuple[str, str]]) -> None:
    machine = OperatableStateMachine(outcomes=['done', 'failed'])
    ways = {'done': 'done', 'canceled': 'failed', 'failed': 'failed'}
    trees = [xml('<BackUp/>', 'Recovery'), xml('<Wait/>', 'Navigation')]
    with machine:
        for number, text in enumerate(trees):
            following = f'Load{number + 1}' if number + 1 < len(trees) else label
            OperatableStateMachine.add(
                f'Load{number}', BtLoaderState(xml=text), {'done': following, 'failed': 'failed'}
            )
        OperatableStateMachine.add(label, BtExecuteState(bt_file=tree), ways)
    assert found(machine) == rules
