# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's nodes: the rules of the Jazzy release, tick by tick, on a manual clock."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees.steps import NAMES, check, control, make, step

# Tree, and what happens to it (the notation of flexbt_testing.behavior_trees.steps).
VECTORS: list[tuple[str, str]] = [
    # A controller that a pre-condition has completed, and nobody reset, waits for a change of the goal.
    (f'<IfThenElse><GoalUpdatedController _failureIf="x">{step("S")}</GoalUpdatedController>{step("S", 1)}'
     '</IfThenElse>', "x=1 F | x=0 R | goal='a' S 0S 1S"),
    # The others begin at once.
    *((f'<IfThenElse><{tag} _failureIf="x">{step("S")}</{tag}>{step("S", 1)}</IfThenElse>', 'x=1 F | x=0 S 0S 1S')
      for tag in ('RateController', 'SingleTrigger')),
    ('<InitialPoseReceived/>', "F | initial_pose_received='true' S | initial_pose_received='false' F"),
    ('<InitialPoseReceived initial_pose_received="{there}"/>', "F | initial_pose_received='true' F | there='true' S"),
    # RecoveryNode
    (control('RecoveryNode', 'S', 'S'), 'S 0S'),
    (control('RecoveryNode', 'FS', 'S'), 'S 0F 1S 0S'),
    (control('RecoveryNode', 'F', 'S'), 'F 0F 1S 0F | F 0F 1S 0F'),
    (control('RecoveryNode', 'F', 'S', number_of_retries='2'), 'F 0F 1S 0F 1S 0F'),
    (control('RecoveryNode', 'F', 'S', number_of_retries='0'), 'F 0F'),
    (control('RecoveryNode', 'RF', 'RS'), 'R 0R | R 0F 1R | R 1S 0R | F 0F'),
    (control('RecoveryNode', 'F', 'F'), 'F 0F 1F | F 0F 1F'),
    (control('RecoveryNode', 'K', 'S'), 'K 0K'),
    # A skipped recovery: the attempts that were made still count afterwards.
    (control('RecoveryNode', 'F', 'KS'), 'F 0F 1K | F 0F 1S 0F'),
    (control('RecoveryNode', 'F', 'SKS', number_of_retries='2'), 'F 0F 1S 0F 1K | F 0F 1S 0F'),
    (control('RecoveryNode', 'F', 'SFS', number_of_retries='2'), 'F 0F 1S 0F 1F | F 0F 1S 0F 1S 0F'),
    # One that is skipped while it is RUNNING is halted.
    (control('RecoveryNode', 'F', 'RKS'), 'R 0F 1R | F 1K 1! | F 0F 1S 0F'),
    # A node whose children were skipped is IDLE: it asks its pre-conditions again.
    *((f'<{tag} _failureIf="x">{step("K")}{step("K", 1)}</{tag}>', f'x=0 K {calls} | x=1 F')
      for tag, calls in (('RecoveryNode', '0K'), ('RoundRobin', '0K 1K'))),
    # PipelineSequence
    (control('PipelineSequence', 'S', 'S'), 'S 0S 1S'),
    (control('PipelineSequence', 'S', 'RS'), 'R 0S 1R | S 1S'),
    (control('PipelineSequence', 'RS', 'R', 'S'), 'R 0R | R 0S 1R | R 1R'),
    (control('PipelineSequence', 'SRRR', 'R'), 'R 0S 1R | R 1R'),
    (control('PipelineSequence', 'R', 'R'), 'R 0R | R 0R'),
    (control('PipelineSequence', 'S', 'F'), 'F 0S 1F | F 0S 1F'),
    (control('PipelineSequence', 'K', 'K'), 'K 0K 1K'),
    (control('PipelineSequence', 'K', 'S'), 'S 0K 1S'),
    (control('PipelineSequence', 'SR', 'R'), 'R 0S 1R | halt 1! | R 0R'),
    (control('PipelineSequence', 'SSR', 'S'), 'S 0S 1S | S 0S 1S | R 0R'),
    # RoundRobin
    (control('RoundRobin', 'S', 'S', 'S'), 'S 0S | S 1S | S 2S | S 0S'),
    (control('RoundRobin', 'F', 'S', 'F'), 'S 0F 1S | S 2F 0F 1S'),
    (control('RoundRobin', 'F', 'F', 'F'), 'F 0F 1F 2F | F 0F 1F 2F'),
    (control('RoundRobin', 'F', 'RF', 'F'), 'R 0F 1R | F 1F 2F | R 0F 1R'),
    (control('RoundRobin', 'S', 'F', 'F'), 'S 0S | S 1F 2F 0S | S 1F 2F 0S'),
    (control('RoundRobin', 'K', 'K'), 'K 0K 1K'),
    (control('RoundRobin', 'K', 'F'), 'F 0K 1F'),
    # SingleTrigger: the root is set to IDLE after each result, so it is armed again.
    (control('SingleTrigger', 'RS'), 'R 0R | S 0S | R 0R'),
    (f'<Sequence>{control("SingleTrigger", "S")}<Step name="RRS_1"/></Sequence>', 'R 0S 1R | R 1R | S 1S'),
    (
        f'<PipelineSequence>{control("SingleTrigger", "S")}<Step name="RRR_1"/></PipelineSequence>',
        'R 0S 1R | F 1!',
    ),
]  # fmt: skip


@pytest.mark.parametrize(('body', 'expected'), VECTORS)
def test_tick_by_tick(body: str, expected: str) -> None:
    check(body, expected)


def test_an_early_child_that_runs_again_does_not_stop_the_later_ones() -> None:
    tree, calls = make(
        '<PipelineSequence><Inverter><Step name="FFRF_0"/></Inverter>'
        '<Inverter><Step name="RRRF_1"/></Inverter></PipelineSequence>'
    )
    assert [NAMES[tree.tick_once()] for _ in range(4)] == ['R', 'R', 'R', 'S']
    assert calls == ['0F', '1R', '0F', '1R', '0R', '1R', '0F', '1F']


def test_halting_forgets_recoveries_and_positions() -> None:
    tree, calls = make(control('RecoveryNode', 'FRFF', 'S'))
    assert tree.tick_once() is NodeStatus.RUNNING
    assert calls == ['0F', '1S', '0R']
    tree.halt()
    assert calls.pop() == '0!'
    calls.clear()
    assert tree.tick_once() is NodeStatus.FAILURE
    assert calls == ['0F', '1S', '0F']


def test_round_robin_keeps_its_position_over_successes_but_not_over_a_halt_of_the_tree() -> None:
    tree, calls = make(f'<Sequence>{control("RoundRobin", "S", "S")}</Sequence>')
    tree.tick_once()
    tree.tick_once()
    tree.tick_once()
    assert calls == ['0S', '1S', '0S']
    tree.halt()
    tree.tick_once()
    assert calls[-1] == '0S'


@pytest.mark.parametrize('scripts', [('S',), ('S', 'S', 'S')])
def test_a_recovery_node_has_two_children(scripts: tuple[str, ...]) -> None:
    with pytest.raises(TreeLoadError, match='exactly 2 children, not'):
        make(control('RecoveryNode', *scripts))


def test_the_failure_of_a_recovery_node_is_that_of_the_work_not_of_the_recovery() -> None:
    tree, _ = make(control('RecoveryNode', 'F', 'F'))
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.path == 'F_0'


def test_rate_controller_begins_its_child_once_a_period_and_asks_for_the_wake_up() -> None:
    clock = ManualClock(10.0)
    limited = '<RateController hz="2.0"><Step name="S_0"/></RateController>'
    body = f'<PipelineSequence>{limited}<Step name="R_1"/></PipelineSequence>'
    tree, calls = make(body, clock)
    tree.tick_once()
    assert calls == ['0S', '1R']
    assert tree.next_wake == 10.5
    clock.set(10.3)
    tree.tick_once()
    assert calls[2:] == ['1R']
    assert tree.next_wake == 10.5
    clock.set(10.5)
    tree.tick_once()
    assert calls[3:] == ['0S', '1R']
    assert tree.next_wake == 11.0
    tree.halt()
    assert [tree.next_wake] == [None]
    tree.tick_once()
    assert calls[-2:] == ['0S', '1R']


def test_rate_controller_ticks_a_running_child_and_does_not_delay_a_failed_one() -> None:
    clock = ManualClock()
    tree, calls = make('<RateController hz="1.0"><Step name="RRS_0"/></RateController>', clock)
    assert [NAMES[tree.tick_once()] for _ in range(3)] == ['R', 'R', 'S']
    body = '<Sequence><Inverter><RateController><Step name="F_0"/></RateController></Inverter></Sequence>'
    tree, calls = make(body, clock)
    assert [NAMES[tree.tick_once()] for _ in range(2)] == ['S', 'S']
    assert calls == ['0F', '0F']


@pytest.mark.parametrize('hz', ['0', '-1', 'nan'])
def test_rate_controller_refuses_a_rate_that_is_none(hz: str) -> None:
    tree, _ = make(f'<RateController hz="{hz}"><Step name="S_0"/></RateController>')
    with pytest.raises(NodeExecutionError, match=r'\[hz\] has to be a positive rate'):
        tree.tick_once()


def test_goal_updated_fires_once_for_each_change() -> None:
    tree, _ = make('<Parallel failure_count="2"><Step name="R_0"/><Inverter><GoalUpdated/></Inverter></Parallel>')
    condition = next(node for node in tree.nodes if node.id == 'GoalUpdated')
    tree.blackboard.set('goal', (1, 2))
    results = []
    for goal in [(1, 2), (1, 2), (3, 4), (3, 4), None, (3, 4)]:
        if goal is None:
            tree.blackboard.unset('goal')  # the last one stays
        else:
            tree.blackboard.set('goal', goal)
        # Status kept from tick to tick, as below a control that does not reset it.
        results.append(NAMES[condition.execute()])
    assert results == ['F', 'F', 'S', 'F', 'F', 'F']
    tree.blackboard.set('goals', [(1, 2)])
    assert NAMES[condition.execute()] == 'S'
    condition.status = NodeStatus.IDLE
    tree.blackboard.set('goal', (5, 6))
    assert NAMES[condition.execute()] == 'F'


def test_goal_updated_below_a_reactive_fallback_never_fires_as_in_nav2() -> None:
    tree, calls = make('<ReactiveFallback><GoalUpdated/><Step name="R_0"/></ReactiveFallback>')
    for number in range(3):
        tree.blackboard.set('goal', (number,))
        assert tree.tick_once() is NodeStatus.RUNNING
    assert calls == ['0R'] * 3


def test_goal_ports_come_before_the_entries_of_the_same_name() -> None:
    tree, _ = make('<Sequence><Inverter><GoalUpdated goal="{other}"/></Inverter></Sequence>')
    condition = tree.nodes[2]
    tree.blackboard.set('goal', (1,))
    tree.blackboard.set('other', (1,))
    condition.execute()
    tree.blackboard.set('goal', (2,))
    assert NAMES[condition.execute()] == 'F'
    tree.blackboard.set('other', (2,))
    assert NAMES[condition.execute()] == 'S'
    tree.blackboard.unset('other')
    assert NAMES[condition.execute()] == 'F', 'the goal before counts while there is none'


def test_global_updated_goal_fires_first_and_at_each_change_over_all_runs() -> None:
    tree, _ = make('<Fallback><GlobalUpdatedGoal/></Fallback>')
    results = [NAMES[tree.tick_once()]]  # there is no goal yet
    for goal in [(1,), (1,), (2,), (2,)]:
        tree.blackboard.set('goal', goal)
        results.append(NAMES[tree.tick_once()])
    tree.halt()
    results.append(NAMES[tree.tick_once()])
    assert results == ['S', 'S', 'F', 'S', 'F', 'F']


def test_goal_updated_controller_ticks_its_child_at_changes() -> None:
    tree, calls = make('<GoalUpdatedController><Step name="RFS_0"/></GoalUpdatedController>')
    tree.blackboard.set('goal', (1,))
    assert [NAMES[tree.tick_once()] for _ in range(2)] == ['R', 'F']
    tree, calls = make(
        '<PipelineSequence><GoalUpdatedController><Step name="S_0"/></GoalUpdatedController>'
        '<Step name="R_1"/></PipelineSequence>'
    )
    for goal in [(1,), (1,), (2,), (2,)]:
        tree.blackboard.set('goal', goal)
        tree.tick_once()
    assert calls == ['0S', '1R', '1R', '0S', '1R', '1R']


@pytest.mark.parametrize(
    ('tag', 'code', 'result'),
    [
        ('WouldAControllerRecoveryHelp', 105, 'S'),
        ('WouldAControllerRecoveryHelp', 101, 'F'),
        ('WouldAPlannerRecoveryHelp', 208, 'S'),
        ('WouldAPlannerRecoveryHelp', 204, 'F'),
        ('WouldASmootherRecoveryHelp', 504, 'S'),
        ('WouldASmootherRecoveryHelp', None, 'F'),
    ],
)
def test_error_codes(tag: str, code: int | None, result: str) -> None:
    tree, _ = make(f'<{tag} error_code="{{code}}"/>')
    if code is not None:
        tree.blackboard.set('code', code)
    assert NAMES[tree.tick_once()] == result
    if result == 'F':
        assert tree.failure is not None
        assert f'error code {code or 0} is none of' in tree.failure.reason


def test_error_codes_of_ones_own() -> None:
    codes: dict[str, Any] = {'7': 'S', '8': 'F', '9': 'S'}
    for code, result in codes.items():
        tree, _ = make(f'<AreErrorCodesPresent error_code="{code}" error_codes_to_check="7;9"/>')
        assert NAMES[tree.tick_once()] == result
