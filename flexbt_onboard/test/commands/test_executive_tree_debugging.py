# SPDX-License-Identifier: BSD-3-Clause
"""Debugging trees of a real BT server through the executive: who may, what everybody sees, and what outlives whom."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, TreeBreakpoint
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_states import BtExecuteState
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

C = ExecutiveCommand
TREE = '<Sequence name="all"><Script code="x := 1" name="one"/><Spin name="turn"/></Sequence>'


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world() as opened:
        yield opened


def machine() -> OperatableStateMachine:
    made = OperatableStateMachine(outcomes=['finished', 'failed'])
    with made:
        transitions = {'done': 'finished', 'failed': 'failed', 'canceled': 'failed'}
        OperatableStateMachine.add('Tree', BtExecuteState(bt_file='Main'), transitions)
    return made


@pytest.fixture
def bench(world: ServerWorld) -> Iterator[ExecutiveBench]:
    bench = ExecutiveBench(parameters=ExecutiveParameters(peers=(names.BT_SERVER,)))
    bench.wait_for(lambda status: status.peers and status.peers[0].alive, 'the BT server')
    yield bench
    bench.close()


def held_at(operator: Operator, path: str) -> None:
    operator.wait_for(lambda status: [hold.path for hold in status.tree_holds] == [path], f'held at {path}')


def test_a_tree_is_debugged_by_commands_and_the_status_shows_it(world: ServerWorld, bench: ExecutiveBench) -> None:
    world.client.load_tree(TREE, 'Main')
    assert "did you mean 'turn'" in bench.refused(C.TREE_BREAK, path='trun', behavior='Main')
    bench.applied(C.TREE_BREAK, path='turn', behavior='Main', text='x == 1')
    shown = bench.wait_for(lambda status: status.tree_breakpoints, 'the breakpoint')[0]
    assert (shown.kind, shown.path, shown.condition) == (TreeBreakpoint.BREAK, 'turn', 'x == 1')
    assert shown.operator_id == 'tester'
    goal = world.client.execute('Main')
    held_at(bench, 'turn')
    hold = bench.status.tree_holds[0]
    assert (hold.operator_id, hold.behavior_tree) == ('tester', 'Main')
    assert 'SUCCESS or FAILURE' in bench.refused(C.TREE_FORCE, path='turn', outcome='RUNNING')
    bench.applied(C.TREE_FORCE, path='turn', outcome='FAILURE')
    bench.applied(C.TREE_CONTINUE, tree_run_id=hold.run_id)
    assert (goal.result.code, goal.result.failed_node) == (BtExecute.Result.FAILURE, 'turn')
    bench.wait_for(lambda status: not status.tree_holds, 'nothing held')
    assert 'no tree is running' in bench.refused(C.TREE_CONTINUE, tree_run_id=hold.run_id)
    bench.applied(C.TREE_CLEAR, behavior='Main')
    bench.wait_for(lambda status: not status.tree_breakpoints, 'nothing set')


def test_only_who_has_the_authority_debugs_and_others_see(world: ServerWorld, bench: ExecutiveBench) -> None:
    world.client.load_tree(TREE, 'Main')
    with NodeRuntime.open('other') as runtime:
        other = Operator(runtime, 'bob')
        wait_until(lambda: other.statuses)
        bench.applied(C.CLAIM_AUTHORITY)
        bench.applied(C.TREE_BREAK, path='turn', behavior='Main')
        goal = world.client.execute('Main')
        for one in (bench, other):
            held_at(one, 'turn')
        for kind in (C.TREE_CONTINUE, C.TREE_STEP, C.TREE_CLEAR, C.TREE_BREAK, C.TREE_DUMMY, C.TREE_SET):
            assert 'tester' in other.refused(kind, path='turn', outcome='SUCCESS', behavior='Main', text='x := 1')
        bench.applied(C.TREE_SET, text='speed := 0.5')
        assert [hold.path for hold in other.status.tree_holds] == ['turn']
    goal.call.cancel(DEADLINE)
    assert goal.result.code == BtExecute.Result.CANCELED


def test_a_breakpoint_outlives_the_console_that_has_set_it(world: ServerWorld, bench: ExecutiveBench) -> None:
    world.client.load_tree(TREE, 'Main')
    runtime = NodeRuntime('short', args=())
    short = Operator(runtime, 'eve')
    wait_until(lambda: short.statuses)
    short.applied(C.TREE_BREAK, path='turn', behavior='Main')
    goal = world.client.execute('Main')
    held_at(short, 'turn')
    runtime.close()
    held_at(bench, 'turn')
    assert bench.status.tree_holds[0].operator_id == 'eve'
    with NodeRuntime.open('late') as late:  # and whoever joins later sees it, and may go on
        new = Operator(late, 'new')
        held_at(new, 'turn')
        new.applied(C.TREE_STEP, tree_run_id=new.status.tree_holds[0].run_id)
    held_at(bench, '')
    goal.call.cancel(DEADLINE)
    assert goal.result.code == BtExecute.Result.CANCELED


def test_the_end_of_the_server_ends_its_breakpoints(world: ServerWorld, bench: ExecutiveBench) -> None:
    world.client.load_tree(TREE, 'Main')
    bench.applied(C.TREE_BREAK, path='turn', behavior='Main')
    world.client.execute('Main')
    held_at(bench, 'turn')
    world.server_runtime.close()
    bench.wait_for(lambda status: not status.tree_holds and not status.tree_breakpoints, 'nothing held')
    assert 'control_tree' in bench.refused(C.TREE_BREAK, path='turn', behavior='Main')


def test_a_stop_of_the_behavior_ends_a_tree_that_a_breakpoint_holds(world: ServerWorld) -> None:
    world.client.load_tree(TREE, 'Main')
    bench = ExecutiveBench(behavior_of(machine))
    bench.applied(C.TREE_BREAK, path='turn', behavior='Main')
    bench.start()
    held_at(bench, 'turn')
    bench.applied(C.PAUSE)  # of the machine, whose state pauses its tree: that stands already
    bench.wait_for(lambda status: status.state == ExecutiveStatus.PAUSED, 'paused')
    bench.applied(C.RESUME)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.RUNNING, 'running')
    held_at(bench, 'turn')  # a resume of the machine is no continue of the tree
    bench.applied(C.STOP)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'idle')
    assert bench.status.outcome == 'preempted'
    bench.wait_for(lambda status: not status.tree_holds, 'nothing held')
    assert world.navigation.count(names.SPIN) == 0
    bench.close()


def test_wrong_commands_in_a_flood_are_refused_and_the_tree_goes_on(world: ServerWorld, bench: ExecutiveBench) -> None:
    world.client.load_tree(TREE, 'Main')
    for number in range(100):
        bench.applied(C.TREE_DUMMY, path='turn', behavior='Main', outcome='SUCCESS', id=f'same-{number}')
    assert len(bench.status.tree_breakpoints) == 1
    for field, length in {'path': 4097, 'behavior': 257, 'text': 1001, 'outcome': 257, 'tree_run_id': 129}.items():
        fields = {'path': 'turn', 'behavior': 'Main', 'outcome': 'SUCCESS'} | {field: 'x' * length}
        assert field in bench.refused(C.TREE_DUMMY, **fields)
    assert world.client.execute('Main').result.code == BtExecute.Result.SUCCESS
    bench.applied(C.TREE_CLEAR, behavior='Main')
