# SPDX-License-Identifier: BSD-3-Clause
"""A server of motion that ignores cancels: nothing else moves the robot while it may go on, and people are told."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from rclpy.action import CancelResponse

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.entries import to_entry
from flexbt_msgs.action import BtExecute
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result

TURN_OR_BACK = '<Fallback><Spin name="turn" _while="turns"/><BackUp name="back"/></Fallback>'


def ignores_cancels(world: ServerWorld, response: CancelResponse, action: str = names.SPIN) -> ScriptedActionServer:
    """Return the server of an action, whose goals go on whatever is asked."""
    world.navigation.hold.add(action)
    server = world.navigation.actions[action]
    server.on_cancel = lambda _handle: response
    return server


def turn_then_back(world: ServerWorld, spin: ScriptedActionServer) -> SentGoal:
    """Run TURN_OR_BACK; the turn is halted while the server works on its goal."""
    world.client.load_tree(TURN_OR_BACK)
    world.client.set(to_entry('turns', True))
    goal = world.client.execute()
    wait_until(lambda: spin.running, 'the goal')
    world.client.set(to_entry('turns', False))
    return goal


def paused_and_resumed(world: ServerWorld, server: ScriptedActionServer, leaf: str) -> SentGoal:
    """Run a leaf whose goal is canceled for a pause, which is over when this returns."""
    world.client.load_tree(leaf)
    goal = world.client.execute()
    wait_until(lambda: server.running, 'the goal')
    run_id = goal.call.goal_id.hex()
    world.server_runtime.call(lambda: world.server.goals.running.find(run_id).run.hold('a test'))
    wait_until(lambda: server.cancels, 'the cancel for the pause')
    world.server_runtime.call(lambda: world.server.goals.running.find(run_id).run.hold(''))
    return goal


@pytest.fixture
def patient() -> Iterator[ServerWorld]:
    with open_server_world(cancel_timeout=DEADLINE) as opened:
        yield opened


@pytest.mark.parametrize('response', [CancelResponse.ACCEPT, CancelResponse.REJECT])
def test_no_other_goal_moves_the_robot_while_a_canceled_one_goes_on(response: CancelResponse) -> None:
    with open_server_world(cancel_timeout=0.1) as world:
        spin = ignores_cancels(world, response)
        world.client.load_tree('<BackUp name="back"/>', 'Back')
        world.client.load_tree('<Spin name="turn"/>', 'Turn')
        world.client.load_tree('<Wait wait_duration="1"/>', 'Rest')

        told = turn_then_back(world, spin).result
        assert (told.code, told.failed_node) == (Result.ERROR, 'back'), told.message
        assert 'the goal was not sent' in told.message and 'canceling the goal of spin' in told.message
        assert 'not halted in time: canceling the goal of spin' in told.message
        (goes_on,) = told.not_ended
        assert goes_on.startswith('spin: its server has not ended the goal')

        for tree, leaf in [('Back', 'back'), ('Turn', 'turn')]:  # of other runs, too
            told = world.client.execute(tree).result
            assert (told.code, told.failed_node) == (Result.FAILURE, leaf), told.message
            assert 'canceling the goal of spin' in told.message
        told = world.client.execute('Rest').result
        assert (told.code, told.not_ended) == (Result.SUCCESS, [goes_on]), 'which moves nothing'
        assert (world.navigation.count(names.BACKUP), world.navigation.count(names.SPIN)) == (0, 1)

        spin.end(0, 'canceled' if response is CancelResponse.ACCEPT else 'succeed')
        wait_until(lambda: not spin.running, 'the end of the goal')
        wait_until(lambda: world.client.execute('Back').result.code == Result.SUCCESS, 'the next goal')


def test_what_waits_goes_on_when_the_canceled_goal_has_ended(patient: ServerWorld) -> None:
    spin = ignores_cancels(patient, CancelResponse.ACCEPT)
    patient.client.load_tree('<BackUp name="back"/>', 'Back')
    first = turn_then_back(patient, spin)
    wait_until(lambda: spin.cancels, 'the cancel')
    other = patient.client.execute('Back')
    wait_until(lambda: other.feedback and other.feedback[-1].active_nodes, 'the other tree')
    assert patient.navigation.count(names.BACKUP) == 0 and not first.ended
    spin.end(0, 'canceled')
    assert [first.result.code, other.result.code] == [Result.SUCCESS] * 2


def test_a_pause_that_a_server_ignores_leaves_the_goal_to_its_end(patient: ServerWorld) -> None:
    """The robot moves all the same: what it has reached then is reached."""
    spin = ignores_cancels(patient, CancelResponse.REJECT)
    goal = paused_and_resumed(patient, spin, '<Spin name="turn"/>')
    spin.end(0)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert patient.navigation.count(names.SPIN) == 1


def test_whoever_runs_a_tree_is_told_what_goes_on_in_a_pause() -> None:
    with open_server_world(cancel_timeout=0.1) as world:
        spin = ignores_cancels(world, CancelResponse.ACCEPT)
        world.client.load_tree('<Spin name="turn"/>')
        goal = world.client.execute()
        wait_until(lambda: spin.running, 'the goal')
        run = world.server_runtime.call(lambda: world.server.goals.running.find(goal.call.goal_id.hex()).run)
        run.hold('a test')
        (told,) = wait_until(lambda: goal.feedback and goal.feedback[-1].not_ended, 'what continues')
        assert re.match(r'spin: its server has not ended .* canceled at \d\d:\d\d:\d\d: the robot may move; STOP', told)
        spin.end(0, 'canceled')
        wait_until(lambda: not goal.feedback[-1].not_ended, 'its end')
        run.hold('')
        wait_until(lambda: spin.running, 'the goal that is sent again')
        spin.end(1)
        assert goal.result.code == Result.SUCCESS


def test_a_leaf_does_not_wait_for_ever_for_what_goes_on_after_a_pause() -> None:
    with open_server_world(cancel_timeout=0.1) as world:
        server = ignores_cancels(world, CancelResponse.REJECT, names.WAIT)
        told = paused_and_resumed(world, server, '<Wait name="rest" wait_duration="1"/>').result
        assert (told.code, told.failed_node) == (Result.ERROR, 'rest'), told.message
        assert 'wait: the goal was canceled for a pause, and has not ended' in told.message

        world.client.load_tree('<Wait name="same" wait_duration="1" server_name="/wait"/>')  # by its full name
        told = world.client.execute().result
        assert (told.code, told.failed_node) == (Result.FAILURE, 'same'), told.message
        assert 'canceling the goal of wait' in told.message and server.cancels and len(server.goals) == 1
