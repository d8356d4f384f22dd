# SPDX-License-Identifier: BSD-3-Clause
"""Pausing, resuming and stepping trees of a live server: what goes on meanwhile, and what does not."""

from __future__ import annotations

import random
import re
import threading
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
from nav2_msgs.action import BackUp
from rclpy.action import CancelResponse

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.runtime.health import Hang
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry
from flexbt_msgs.action import BtExecute, BtGetData
from flexbt_msgs.msg import TreeStatus
from flexbt_msgs.srv import ControlTree
from flexbt_server.actions import tree_goals
from flexbt_server.actions.goal_owners import OWNER_SECONDS, GoalOwners
from flexbt_testing.behavior_trees.faulty_leaves import Held
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.server_world import ServerWorld, install_nodes, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

Result = BtExecute.Result
PAUSE, RESUME, STEP = ControlTree.Request.PAUSE, ControlTree.Request.RESUME, ControlTree.Request.STEP
COUNTING = '<KeepRunningUntilFailure><Counts key="ticks"/></KeepRunningUntilFailure>'


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=200.0, feedback_rate=50.0) as opened:
        yield opened


class Operator:
    """A client of the service, and a witness of the stream."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        node = runtime.node
        link = ServiceLinks(runtime).link(ControlTree, names.CONTROL_TREE)
        self._link = link
        self.statuses: list[TreeStatus] = []
        runtime.call(
            lambda: node.create_subscription(
                TreeStatus, names.TREE_STATUS, self.statuses.append, names.transient_local_qos(100)
            )
        )
        wait_until(link.is_ready, 'control_tree')

    def send(self, command: int, run_id: str = '', owner: str = '') -> Any:
        """Return the future of the response."""
        request = ControlTree.Request(command=command, run_id=run_id, owner=owner)
        return self._runtime.call(lambda: self._link.client.call_async(request))

    def ask(self, command: int, run_id: str = '', owner: str = '') -> str:
        """'' when it had its effect, otherwise why not."""
        return answer(self.send(command, run_id, owner))

    @property
    def shown(self) -> bool:
        """What the stream says last."""
        return bool(self.statuses and self.statuses[-1].paused)


def answer(future: Any) -> str:
    wait_until(future.done, 'the response')
    response = future.result()
    assert response.success is not bool(response.message)
    return str(response.message)


@pytest.fixture
def operator(world: ServerWorld) -> Operator:
    return Operator(world.client.runtime)


def ticks(world: ServerWorld, blackboard: str = '') -> int:
    entries = world.client.get(blackboard=blackboard).entries
    return next((int(from_entry(entry)) for entry in entries if entry.key == 'ticks'), 0)


def goal_id(goal: Any) -> str:
    return bytes(goal.call.goal_id).hex()


def test_a_paused_tree_is_not_ticked_and_gives_no_result_before_it_goes_on(
    world: ServerWorld, operator: Operator
) -> None:
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load_tree('<Spin/>')
    goal = world.client.execute()
    wait_until(lambda: spin.running)
    assert operator.ask(PAUSE) == ''
    wait_until(lambda: operator.shown, 'paused in the stream')
    wait_until(lambda: spin.statuses == {0: 'canceled'}, 'the goal of the leaf canceled')
    known = len(goal.feedback)
    wait_until(lambda: len(goal.feedback) > known + 3, 'feedback')
    assert not goal.ended
    assert goal.feedback[-1].active_nodes
    assert operator.ask(PAUSE) == ''  # it is, already
    assert operator.ask(RESUME) == ''
    spin.end(1)  # it was sent again
    assert goal.result.code == Result.SUCCESS
    wait_until(lambda: operator.statuses[-1].finished)
    assert [message.paused for message in operator.statuses].count(True) == 1
    assert not operator.shown


def test_a_step_is_one_tick_answered_when_it_is_over_and_refused_when_not_paused(
    world: ServerWorld, operator: Operator
) -> None:
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    wait_until(lambda: ticks(world) > 2)
    assert 'not paused' in operator.ask(STEP)
    assert operator.ask(PAUSE) == ''
    before = ticks(world)
    for number in range(1, 6):
        assert operator.ask(STEP) == ''
        assert ticks(world) == before + number
    others = [Operator(world.server_runtime), Operator(world.navigation_runtime)]
    futures = [client.send(STEP) for _ in range(20) for client in (operator, *others)]
    assert [answer(future) for future in futures] == [''] * 60
    assert ticks(world) == before + 65
    assert operator.ask(RESUME) == ''
    wait_until(lambda: ticks(world) > before + 70)
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    assert operator.ask(STEP) == 'no tree is running'


def test_a_step_may_end_the_tree_and_its_result_follows(world: ServerWorld, operator: Operator) -> None:
    world.client.load_tree('<Sequence><Sleep msec="1"/><AlwaysFailure name="last"/></Sequence>')
    world.client.load_tree('<Sequence><Sleep msec="100000"/><AlwaysFailure name="last"/></Sequence>', 'Long')
    goal = world.client.execute('Long')
    wait_until(lambda: goal.feedback and goal.feedback[-1].active_nodes)
    assert operator.ask(PAUSE) == ''
    assert operator.ask(STEP) == ''
    assert not goal.ended
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    blocked = world.client.execute()
    messages = []
    while not blocked.ended:
        messages.append(operator.ask(random.choice((PAUSE, STEP))))
    assert blocked.result.failed_node == 'last'
    assert {message for message in messages if 'not paused' not in message} <= {
        '', 'the run has ended', 'no tree is running'
    }  # fmt: skip


def test_time_goes_on_while_a_tree_is_paused(world: ServerWorld, operator: Operator) -> None:
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree('<Timeout msec="200" name="limit"><Spin/></Timeout>')
    goal = world.client.execute()
    wait_until(lambda: world.navigation.actions[names.SPIN].running)
    assert operator.ask(PAUSE) == ''
    clock = world.server_runtime.clock
    due = clock.now() + 0.2
    wait_until(lambda: clock.now() > due)
    assert not goal.ended
    assert operator.ask(RESUME) == ''
    assert (goal.result.code, goal.result.failed_node) == (Result.FAILURE, 'limit')


def test_pause_is_answered_when_the_tick_that_is_under_way_is_over(world: ServerWorld, operator: Operator) -> None:
    Held.reset()
    world.client.load_tree('<Sequence><HeldInTick/><Sleep msec="100000"/></Sequence>')
    goal = world.client.execute()
    assert Held.entered.wait(DEADLINE)
    pause = operator.send(PAUSE)
    assert world.client.get('nothing').code == BtGetData.Result.FAILURE  # the server does not wait
    assert not pause.done()
    Held.release.set()
    assert answer(pause) == ''
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_pause_of_a_tree_that_ends_with_the_tick_that_is_under_way_is_refused(
    world: ServerWorld, operator: Operator
) -> None:
    Held.reset()
    world.client.load_tree('<HeldInTick/>')
    goal = world.client.execute()
    assert Held.entered.wait(DEADLINE)
    pause = operator.send(PAUSE)
    run = world.server_runtime.call(lambda: world.server.goals.running.find('').run)
    wait_until(lambda: run._control.pending, 'the command at the run')
    Held.release.set()
    assert answer(pause) == 'the run has ended'
    assert goal.result.code == Result.SUCCESS


def test_a_paused_tree_is_canceled_and_its_leaves_are_halted(world: ServerWorld, operator: Operator) -> None:
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load_tree('<Spin/>')
    goal = world.client.execute()
    wait_until(lambda: spin.running)
    assert operator.ask(PAUSE) == ''
    goal.call.cancel(DEADLINE)
    assert goal.wait().status is GoalStatus.CANCELED
    assert spin.statuses == {0: 'canceled'}


def test_a_paused_tree_is_taken_over_and_stays_paused(world: ServerWorld, operator: Operator) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load_tree(
        '<Sequence><ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/></Sequence>'
    )
    old = world.client.execute(goals=[pose_stamped(1)])
    wait_until(lambda: follow.running)
    assert operator.ask(PAUSE) == ''
    new = world.client.execute(goals=[pose_stamped(2)], outputs=['goal'], output_encoding=BtExecute.Goal.BINARY)
    assert 'newer goal' in old.result.message
    wait_until(lambda: follow.statuses == {0: 'canceled'})
    assert not new.ended
    # The run has the ID of the goal that began it, and is known by that of its present one as well.
    structure_id = operator.statuses[-1].run_id
    assert structure_id == goal_id(old)
    assert operator.ask(PAUSE, structure_id) == operator.ask(PAUSE, goal_id(new)) == ''
    assert operator.ask(STEP, goal_id(new)) == ''
    assert len(follow.goals) == 1  # a step is no reason to drive
    assert operator.ask(RESUME, goal_id(new)) == ''
    follow.end(1)
    assert new.result.code == Result.SUCCESS
    assert from_entry(new.result.outputs[0]) == pose_stamped(2)


REPLANNING = (
    '<PipelineSequence><RateController hz="1000.0"><ComputePathToPose goal="{goal}" path="{path}"/></RateController>'
    '<FollowPath path="{path}"/></PipelineSequence>'
)


def test_whoever_paused_a_tree_resumes_it_however_often_it_was_taken_over_meanwhile(
    world: ServerWorld, operator: Operator
) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load_tree(REPLANNING)
    goals = [world.client.execute(goals=[pose_stamped(1)])]
    wait_until(lambda: follow.running)
    for x in (2, 3):
        goals.append(world.client.execute(goals=[pose_stamped(x)]))
        assert 'newer goal' in goals[-2].result.message
        if x == 2:
            assert operator.ask(PAUSE, goal_id(goals[1])) == ''  # neither the first nor the last
    wait_until(lambda: not follow.running, 'the robot at rest')
    sent = len(follow.goals)
    assert operator.ask(PAUSE, goal_id(goals[2])) == ''
    assert len(follow.goals) == sent and operator.shown
    assert operator.ask(RESUME, goal_id(goals[1])) == ''
    wait_until(
        lambda: follow.running and follow.goals[-1].path.poses[-1] == pose_stamped(3), 'driving to the newest goal'
    )
    world.navigation.hold.clear()  # the next path is followed to its end
    assert goals[2].result.code == Result.SUCCESS


def test_a_tree_that_was_taken_over_goes_on_when_all_are_gone_for_whom_it_was_paused(
    world: ServerWorld, operator: Operator
) -> None:
    world.client.load_tree(COUNTING)
    with NodeRuntime.open('first') as first, NodeRuntime.open('second') as second:
        LivelinessToken(first)
        LivelinessToken(second)
        old = world.client.execute(owner='/first')
        wait_until(lambda: ticks(world) > 2)
        for owner in ('/first', '/second'):
            assert operator.ask(PAUSE, goal_id(old), owner) == ''
            wait_until(lambda owner=owner: world.server.goals.owners.sees(owner))  # type: ignore[misc]
        new = world.client.execute()
        assert 'newer goal' in old.result.message
        first.close()
        wait_until(lambda: not world.server.goals.owners.sees('/first'))
        (running,) = world.server_runtime.call(world.server.goals.running.all)
        assert running.paused_for == {'/second'} and operator.shown
    before = ticks(world)
    wait_until(lambda: ticks(world) > before and not operator.shown, 'on its way')
    assert operator.ask(PAUSE) == operator.ask(PAUSE, owner='/third') == ''  # which is not there
    wait_until(lambda: running.paused_for == {''}, 'nobody sees it')
    assert operator.shown
    assert 'not a node name' in operator.ask(PAUSE, owner='not a name')
    new.call.cancel(DEADLINE)
    assert new.result.code == Result.CANCELED


def test_the_death_of_the_owner_stops_a_paused_tree(world: ServerWorld, operator: Operator) -> None:
    world.client.load_tree(COUNTING)
    with NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)
        goal = world.client.execute(owner='/owner')
        wait_until(lambda: world.server.goals.owners.sees('/owner'))
        assert operator.ask(PAUSE) == ''
    assert goal.result.code == Result.CANCELED
    assert '/owner' in goal.result.message


def test_what_is_left_of_a_motion_is_sent_when_the_tree_goes_on(world: ServerWorld, operator: Operator) -> None:
    world.navigation.hold.add(names.BACKUP)
    backup = world.navigation.actions[names.BACKUP]
    world.client.load_tree('<BackUp backup_dist="1.0" backup_speed="0.1"/>')
    goal = world.client.execute()
    wait_until(lambda: backup.running)
    for driven in (0.25, 0.5):
        left = backup.goals[-1].target.x
        backup.feedback(len(backup.goals) - 1, BackUp.Feedback(distance_traveled=driven))
        leaf = leaf_of(world, 'BackUp')
        wait_until(lambda leaf=leaf: leaf._goal.feedback is not None, 'feedback')  # type: ignore[misc]
        assert operator.ask(PAUSE) == ''
        wait_until(lambda: not backup.running, 'the goal canceled')
        assert operator.ask(RESUME) == ''
        wait_until(lambda: backup.running, 'the rest of the motion')
        assert backup.goals[-1].target.x == pytest.approx(left - driven)
    assert backup.statuses == {0: 'canceled', 1: 'canceled'}
    backup.end(2)
    assert goal.result.code == Result.SUCCESS


def test_a_goal_that_ends_while_it_is_canceled_for_a_pause_has_its_result(
    world: ServerWorld, operator: Operator
) -> None:
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    spin.on_cancel = lambda _handle: CancelResponse.ACCEPT  # and it goes on
    world.client.load_tree('<Spin/>')
    goal = world.client.execute()
    wait_until(lambda: spin.running)
    assert operator.ask(PAUSE) == ''
    wait_until(lambda: spin.cancels > 0)
    spin.end(0)
    wait_until(lambda: not spin.running)
    assert not goal.ended
    assert operator.ask(RESUME) == ''
    assert goal.result.code == Result.SUCCESS
    assert len(spin.goals) == 1


@pytest.mark.parametrize('command', [PAUSE, RESUME])
def test_a_tree_that_is_stopped_in_a_pause_sends_nothing_again(
    world: ServerWorld, operator: Operator, command: int
) -> None:
    """Also when it goes on, before the goal that was canceled for the pause has ended."""
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    spin.delay_cancel = 0.3
    world.client.load_tree('<Spin/>')
    goal = world.client.execute()
    wait_until(lambda: spin.running)
    assert operator.ask(PAUSE) == ''
    assert operator.ask(command) == ''
    goal.call.cancel(DEADLINE)
    assert goal.wait().status is GoalStatus.CANCELED
    assert spin.statuses == {0: 'canceled'} and len(spin.goals) == 1


def test_what_goes_on_in_a_pause_is_told(world: ServerWorld, operator: Operator) -> None:
    world.client.load_tree('<Parallel success_count="2"><InThread ms="100000"/><Sleep msec="100000"/></Parallel>')
    goal = world.client.execute()
    wait_until(lambda: goal.feedback and len(goal.feedback[-1].active_nodes) > 2)
    future = operator.send(PAUSE)
    assert answer(future) == ''
    (told,) = future.result().not_paused
    assert told.startswith('InThread') and told.endswith(': its thread continues')
    goal.call.cancel(DEADLINE)
    goal.wait()


def test_a_tree_whose_owner_is_late_is_held_and_goes_on_and_ends_when_it_is_gone(world: ServerWorld) -> None:
    """Apart from the pause that an operator asks for."""
    operator = Operator(world.client.runtime)
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load_tree('<Spin/>')
    go_on = threading.Event()
    with NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)
        goal = world.client.execute(owner='/owner')
        wait_until(lambda: world.server.goals.owners.sees('/owner'))
        wait_until(lambda: spin.running)
        owner.post(lambda: go_on.wait(DEADLINE))  # its executor hangs
        wait_until(lambda: operator.shown and spin.statuses == {0: 'canceled'}, 'held')
        assert operator.ask(RESUME) == ''  # of the operator's pauses, there is none
        assert 'is late' in operator.ask(STEP)
        assert operator.shown and not goal.ended and len(spin.goals) == 1
        go_on.set()
        wait_until(lambda: len(spin.goals) == 2, 'sent again')
    assert goal.result.code == Result.CANCELED and 'is gone' in goal.result.message


def test_a_process_that_is_stopped_again_holds_its_trees_for_the_whole_time_once_more(
    world: ServerWorld, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    runtime, passed = world.server_runtime, threading.Event()

    def stop(seconds_held: float) -> None:
        monkeypatch.setattr(tree_goals, 'RETURN_SECONDS', seconds_held)
        runtime.health._tell(Hang('the whole process', 2.0, is_over=True, was_out_of_reach=True))
        runtime.call(lambda: None)

    wait_until(lambda: goal.feedback, 'the tree')
    stop(0.2)
    stop(1000.0)
    runtime.call(lambda: runtime.post_in(0.3, passed.set))
    assert passed.wait(DEADLINE)
    (running,) = world.server.goals.running.all()
    assert running.run._control.reason.startswith('the whole process answers again, after 2.0 s')
    stop(0.0)
    wait_until(lambda: not running.run._control.reason, 'the tree goes on')
    goal.call.cancel(DEADLINE)
    goal.wait()


def test_a_tree_that_begins_while_the_process_is_stopped_is_held_as_well(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tree_goals, 'RETURN_SECONDS', 1000.0)
    running = world.server.goals.running
    add = running.add

    def stopped_before(tree: tree_goals.RunningTree) -> None:
        world.server_runtime.health._tell(Hang('the whole process', 2.0, is_over=True, was_out_of_reach=True))
        add(tree)

    monkeypatch.setattr(running, 'add', stopped_before)
    world.client.load_tree(COUNTING)
    goal = world.client.execute()
    wait_until(lambda: [one.run._control.reason[:17] for one in running.all()] == ['the whole process'], 'held')
    goal.call.cancel(DEADLINE)
    goal.wait()


def test_an_owner_that_hangs_is_gone_after_the_time_that_was_set() -> None:
    go_on, seen = threading.Event(), []
    with open_server_world(peer_timeout=1.0) as world, NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)

        def tell(alive: bool) -> None:
            """Return whether it came a bit later than the time that was set, and sooner than by default."""
            if not alive:
                seen.append(world.server.goals.owners.sees('/owner'))

        watch = LivelinessWatch(world.server_runtime, 'owner', tell, timeout=2.0)
        wait_until(lambda: watch.alive, 'the owner')
        world.client.load_tree(COUNTING)
        goal = world.client.execute(owner='/owner')
        wait_until(lambda: goal.feedback, 'the tree')
        owner.post(lambda: go_on.wait(DEADLINE))
        assert goal.result.code == Result.CANCELED and 'late for too long' in goal.result.message
        wait_until(lambda: seen, 'who waits longer')
        go_on.set()
    assert not any(seen)


def leaf_of(world: ServerWorld, node_id: str) -> Any:
    (running,) = world.server.goals.running.all()
    assert running.run.tree is not None
    return next(node for node in running.run.tree.nodes if node.id == node_id)


def test_the_end_of_the_server_does_not_wait_for_a_paused_tree() -> None:
    with open_server_world() as world:
        operator = Operator(world.client.runtime)
        world.client.load_tree(COUNTING)
        goal = world.client.execute()
        wait_until(lambda: goal.feedback)
        assert operator.ask(PAUSE) == ''
        began = uncontended_time()
        world.server_runtime.close()
        assert uncontended_time() - began < 1.5
        assert goal.result.code == Result.CANCELED


def test_several_trees_are_paused_each_by_itself(world: ServerWorld, operator: Operator) -> None:
    world.client.load_tree(COUNTING)
    goals = {name: world.client.execute(blackboard=name) for name in 'abc'}
    wait_until(lambda: all(ticks(world, name) > 2 for name in goals))
    asked = operator.ask(PAUSE)
    assert 'several trees' in asked
    ids = {name: found for found, name in re.findall(r"(\w{32}) \(tree 'Main' on blackboard '(\w)'\)", asked)}
    assert ids.keys() == goals.keys()
    assert operator.ask(PAUSE, ids['b']) == ''
    still = ticks(world, 'b')
    before = {name: ticks(world, name) for name in 'ac'}
    wait_until(lambda: all(ticks(world, name) > before[name] + 5 for name in before))
    assert ticks(world, 'b') == still
    goals['b'].call.cancel(DEADLINE)
    assert goals['b'].result.code == Result.CANCELED
    assert ids['b'] in operator.ask(PAUSE, ids['b'])
    for name in 'ac':
        goals[name].call.cancel(DEADLINE)
        assert goals[name].result.code == Result.CANCELED


@pytest.mark.parametrize('command', [0, 12, 255])
def test_a_command_that_is_none_is_refused(world: ServerWorld, operator: Operator, command: int) -> None:
    message = operator.ask(command)
    assert message.startswith(f'command {command} is unknown; known commands: 1 (PAUSE), 2 (RESUME), 3 (STEP), ')
    assert message.endswith(', 11 (SET)')


@pytest.mark.parametrize('seed', range(3))
def test_commands_goals_and_cancels_at_random_are_all_answered(
    world: ServerWorld, operator: Operator, seed: int
) -> None:
    chance = random.Random(seed)
    world.client.load_tree('<Sequence><Counts key="ticks"/><Sleep msec="2"/><Counts key="ticks"/></Sequence>')
    wait_until(world.client.executor.is_ready)
    goals, futures = [], []
    for _ in range(60):
        match chance.randrange(4):
            case 0:
                goals.append(world.client.execute())
            case 1 if goals:
                chance.choice(goals).call.cancel(DEADLINE)
            case _:
                futures.append(operator.send(chance.choice((PAUSE, RESUME, STEP))))
        time.sleep(chance.uniform(0.0, 0.004))
    for future in futures:
        text = answer(future)
        is_held = text.startswith('the tree is held: ')  # by a process that had to wait for the processor
        assert is_held or text in (
            '', 'the run has ended', 'no tree is running', 'the tree is not paused; pause it before you step it'
        )  # fmt: skip
    while not all(goal.ended for goal in goals):
        operator.ask(RESUME)
    assert {goal.result.code for goal in goals if goal.wait().result} <= {Result.SUCCESS, Result.CANCELED}


def test_an_owner_that_is_not_seen_has_its_whole_time_with_each_pause() -> None:
    ended: list[float] = []
    with NodeRuntime.open('bt_server') as runtime:
        owners, steady = runtime.call(lambda: GoalOwners(runtime, 5.0)), runtime.steady
        watch = partial(owners.watch, '/nobody', 'the tree', lambda _why: ended.append(steady.now()))
        runtime.call(watch)
        runtime.call(lambda: owners.release('/nobody', 'the tree'))
        half = steady.now() + OWNER_SECONDS / 2.0
        wait_until(lambda: steady.now() > half, 'half of its time')
        again = steady.now()
        runtime.call(watch)
        wait_until(lambda: ended, 'the end of the pause')
        assert ended[0] >= again + OWNER_SECONDS
