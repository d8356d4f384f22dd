# SPDX-License-Identifier: BSD-3-Clause
"""BtExecute on a live server: outcomes, cancels at any moment, preemption, several trees, faults, owners."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav2_msgs.action import FollowPath
from nav_msgs.msg import Path as RobotPath
from std_msgs.msg import Bool

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken, ProcessIdentity
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry
from flexbt_msgs.action import BtExecute, BtGetData, BtLoad
from flexbt_msgs.msg import TreeStatus, TreeStructure
from flexbt_testing.behavior_trees.faulty_leaves import Held, Work
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, document, install_nodes, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

Result = BtExecute.Result
PLAN = '<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{compute_path_error_code}"/>'
FOLLOW = '<FollowPath path="{path}" error_code_id="{follow_path_error_code}"/>'
DRIVE = f'<Sequence>{PLAN}{FOLLOW}</Sequence>'


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world() as opened:
        yield opened


def test_success_gives_typed_outputs(world: ServerWorld) -> None:
    world.client.load_tree(DRIVE)
    goal = world.client.execute(
        goals=[pose_stamped(3, 4)], outputs=['path', 'goal', 'nothing', 'follow_path_error_code'],
        output_encoding=BtExecute.Goal.BINARY,
    )  # fmt: skip
    outcome = goal.wait()
    result = goal.result
    assert outcome.status is GoalStatus.SUCCEEDED, outcome
    assert (result.code, result.message, result.failed_node, result.error_code) == (Result.SUCCESS, '', '', 0)
    values = {entry.key: from_entry(entry) for entry in result.outputs}
    assert list(values) == ['path', 'goal', 'follow_path_error_code']
    assert values['path'].poses[-1] == pose_stamped(3, 4) == values['goal']
    assert [entry.type for entry in result.outputs] == ['nav_msgs/msg/Path', 'geometry_msgs/msg/PoseStamped', 'uint16']
    assert result.missing_outputs == ['nothing']


def test_failure_names_the_node_the_reason_and_the_error_code(world: ServerWorld) -> None:
    world.navigation.fail[names.FOLLOW_PATH] = (1, FollowPath.Result.PATIENCE_EXCEEDED)
    world.client.load_tree(DRIVE)
    goal = world.client.execute(goals=[pose_stamped(1)])
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.FAILURE
    assert goal.result.error_code == FollowPath.Result.PATIENCE_EXCEEDED
    assert 'FollowPath' in goal.result.failed_node
    assert 'scripted failure 0' in goal.result.message
    # The code is not left for the next run.
    again = world.client.execute(goals=[pose_stamped(1)])
    assert (again.result.code, again.result.error_code) == (Result.SUCCESS, 0)


def test_error_codes_and_recoveries_belong_to_one_run(world: ServerWorld) -> None:
    navigation, client = world.navigation, world.client
    navigation.fail[names.COMPUTE_PATH_TO_POSE] = (1, 201)
    navigation.fail[names.FOLLOW_PATH] = (1, 105)
    navigation.hold.add(names.SPIN)
    has_code = '<AreErrorCodesPresent error_code="{{compute_path_error_code}}" error_codes_to_check="{}"/>'
    client.load_tree(
        f'<Sequence><ForceSuccess>{PLAN}</ForceSuccess><Spin/>{has_code.format(201)}</Sequence>', 'Recovering'
    )
    beside = f'<Sequence>{has_code.format(0)}<Wait/><ForceSuccess>{FOLLOW}</ForceSuccess></Sequence>'
    client.load_tree(beside, 'Beside')
    recovering = client.execute(
        'Recovering', goals=[pose_stamped(1)], outputs=['compute_path_error_code', 'number_recoveries']
    )
    wait_until(lambda: navigation.actions[names.SPIN].running)
    # It sees none of the other's codes, reports its own, and takes nothing from the other when it ends.
    inputs = {'path': RobotPath()}
    other = client.execute('Beside', inputs=inputs, outputs=['follow_path_error_code', 'number_recoveries']).result
    assert (other.code, other.error_code) == (Result.SUCCESS, 105)
    assert [from_entry(entry) for entry in other.outputs] == [105, 1]
    navigation.actions[names.SPIN].end(0)
    result = recovering.result
    assert (result.code, result.error_code) == (Result.SUCCESS, 201)
    assert [from_entry(entry) for entry in result.outputs] == [201, 1]


@pytest.mark.parametrize(
    ('tree', 'fields', 'fragment'),
    [
        ('Nowhere', {}, "no tree 'Nowhere'"),
        ('', {}, 'default_tree'),
        ('no_such_package/trees/a.xml', {}, 'no_such_package'),
        ('/etc/passwd.xml', {}, 'allowed_directories'),
    ],
)
def test_a_goal_that_cannot_run_is_an_error_with_a_reason(
    world: ServerWorld, tree: str, fields: dict[str, Any], fragment: str
) -> None:
    world.client.load_tree('<AlwaysSuccess/>')
    goal = world.client.execute(tree, **fields)
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.ERROR
    assert fragment in goal.result.message


def test_an_input_that_cannot_be_read_is_an_error_that_names_it(world: ServerWorld) -> None:
    from flexbt_msgs.msg import BlackboardEntry

    world.client.load_tree('<AlwaysSuccess/>')
    bad = BlackboardEntry(key='speed', type='float64', text='fast')
    goal = SentGoal(world.client.executor, BtExecute.Goal(behavior_tree='Main', inputs=[bad]))
    assert goal.result.code == Result.ERROR
    for fragment in ('speed', 'float64', 'fast'):
        assert fragment in goal.result.message


def test_an_input_of_the_wrong_type_for_the_tree_is_an_error(world: ServerWorld) -> None:
    world.client.load_tree(DRIVE)
    goal = world.client.execute(inputs={'goal': 3})
    assert goal.result.code == Result.ERROR
    assert 'goal' in goal.result.message


def test_the_default_tree() -> None:
    with open_server_world(default_tree='Main') as world:
        world.client.load_tree('<AlwaysSuccess/>')
        assert world.client.execute('').result.code == Result.SUCCESS


def test_several_goals_are_written_as_a_list(world: ServerWorld) -> None:
    world.client.load_tree('<ComputePathThroughPoses goals="{goals}" path="{path}"/>')
    goal = world.client.execute(goals=[pose_stamped(1), pose_stamped(2)], outputs=['path'])
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert from_entry(goal.result.outputs[0]).poses[-1] == pose_stamped(2)


def test_cancel_halts_the_leaves_and_awaits_them(world: ServerWorld) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    follow.delay_cancel = 0.3
    world.client.load_tree(DRIVE)
    goal = world.client.execute(goals=[pose_stamped(5)])
    wait_until(lambda: follow.running, 'follow_path')
    goal.call.cancel(DEADLINE)
    outcome = goal.wait()
    assert not follow.running, 'the result came before the robot was told'
    assert outcome.status is GoalStatus.CANCELED
    assert goal.result.code == Result.CANCELED
    assert goal.result.message == 'canceled by the client'


@pytest.mark.parametrize('seed', range(3))
def test_cancel_at_any_moment_leaves_no_leaf_running(world: ServerWorld, seed: int) -> None:
    world.navigation.hold.update(names_of_actions := [names.FOLLOW_PATH, names.SPIN])
    world.client.load_tree(f'<Sequence>{PLAN}<Wait wait_duration="1"/>{FOLLOW}<Spin/></Sequence>')
    chance = random.Random(seed)
    wait_until(world.client.executor.is_ready)
    for _ in range(25):
        goal = world.client.execute(goals=[pose_stamped(1)])
        time.sleep(chance.uniform(0.0, 0.02))
        goal.call.cancel(DEADLINE)
        assert goal.wait().status is GoalStatus.CANCELED
        for name in names_of_actions:
            assert not world.navigation.actions[name].running


def test_a_leaf_that_does_not_come_to_rest_is_an_error_in_time() -> None:
    with open_server_world(cancel_timeout=0.2) as world:
        world.client.load_tree('<NeverRests/>')
        goal = world.client.execute()
        wait_until(lambda: goal.feedback and goal.feedback[-1].active_nodes, 'the running leaf')
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.ERROR
        assert 'a motor that still turns' in goal.result.message


def test_a_leaf_that_needs_several_ticks_to_stop_gets_them(world: ServerWorld) -> None:
    world.client.load_tree('<SlowToStop ms="100000"/>')
    goal = world.client.execute()
    wait_until(lambda: goal.feedback and goal.feedback[-1].active_nodes, 'the running leaf')
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    assert not Work.running()


def test_a_new_goal_takes_the_running_tree_over(world: ServerWorld) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load_tree(
        '<PipelineSequence><RateController hz="20">' + PLAN + '</RateController>' + FOLLOW + '</PipelineSequence>'
    )
    old = world.client.execute(goals=[pose_stamped(1)])
    wait_until(lambda: follow.running, 'follow_path')
    new = world.client.execute(goals=[pose_stamped(2)])
    assert old.wait().status is GoalStatus.ABORTED
    assert old.result.code == Result.CANCELED
    assert 'newer goal' in old.result.message
    wait_until(lambda: follow.goals[-1].path.poses[-1] == pose_stamped(2), 'the new path at the controller')
    assert 'canceled' not in follow.statuses.values(), 'the robot was stopped in between'
    follow.end(follow.running[-1])
    assert new.result.code == Result.SUCCESS


def test_a_new_goal_whose_inputs_do_not_fit_is_refused_and_the_tree_runs_on(world: ServerWorld) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load_tree(DRIVE)
    old = world.client.execute(goals=[pose_stamped(1)])
    wait_until(lambda: follow.running, 'follow_path')
    bad = world.client.execute(inputs={'path': 'not a path'})
    assert bad.result.code == Result.ERROR
    assert 'path' in bad.result.message
    assert not old.ended
    follow.end(0)
    assert old.result.code == Result.SUCCESS


def test_goals_in_quick_succession_all_end_and_the_last_one_wins(world: ServerWorld) -> None:
    world.client.load_tree(f'<Sequence>{PLAN}{FOLLOW}</Sequence>')
    wait_until(world.client.executor.is_ready)
    chance = random.Random(1)
    for _ in range(5):
        goals = []
        for number in range(8):
            goals.append(world.client.execute(goals=[pose_stamped(number)]))
            time.sleep(chance.uniform(0.0, 0.004))
        codes = [goal.result.code for goal in goals]
        assert set(codes) <= {Result.SUCCESS, Result.CANCELED}
        assert codes[-1] == Result.SUCCESS
        assert not world.navigation.actions[names.FOLLOW_PATH].running


def test_goals_and_cancels_at_random_all_end_as_they_should(world: ServerWorld) -> None:
    world.client.load_tree(f'<Sequence>{PLAN}<Delay delay_msec="5"><AlwaysSuccess/></Delay>{FOLLOW}</Sequence>')
    wait_until(world.client.executor.is_ready)
    chance = random.Random(2)
    sent: list[tuple[Any, bool]] = []
    for number in range(60):
        goal = world.client.execute(goals=[pose_stamped(number)], blackboard=chance.choice(['', 'a']))
        time.sleep(chance.uniform(0.0, 0.01))
        canceled = chance.random() < 0.4
        if canceled:
            goal.call.cancel(DEADLINE)
        sent.append((goal, canceled))
    for goal, canceled in sent:
        if goal.wait().result is None:
            assert canceled and goal.wait().reason == 'canceled before it was sent'
            continue
        assert goal.result.code in (Result.SUCCESS, Result.CANCELED), goal.result.message
        if goal.wait().status is GoalStatus.CANCELED:
            assert canceled
    assert not world.navigation.actions[names.FOLLOW_PATH].running


def test_trees_run_at_the_same_time_and_apart(world: ServerWorld) -> None:
    world.navigation.hold.update({names.FOLLOW_PATH, names.SPIN})
    world.navigation.actions[names.FOLLOW_PATH].preempting = False
    world.client.load_tree(DRIVE)
    world.client.load_tree('<Spin/>', 'Turn')
    one = world.client.execute(goals=[pose_stamped(1)], blackboard='one')
    two = world.client.execute(goals=[pose_stamped(2)], blackboard='two')
    turn = world.client.execute('Turn')
    follow, spin = world.navigation.actions[names.FOLLOW_PATH], world.navigation.actions[names.SPIN]
    wait_until(lambda: len(follow.running) == 2 and spin.running)
    turn.call.cancel(DEADLINE)
    assert turn.result.code == Result.CANCELED
    assert len(follow.running) == 2
    follow.end(0)
    follow.end(1)
    assert one.result.code == two.result.code == Result.SUCCESS


def test_a_tree_that_blocks_holds_up_nobody_else(world: ServerWorld) -> None:
    Held.reset()
    world.client.load_tree('<HeldInTick/>', 'Blocked')
    world.client.load_tree('<AlwaysSuccess/>')
    blocked = world.client.execute('Blocked')
    assert Held.entered.wait(DEADLINE)
    assert world.client.execute().result.code == Result.SUCCESS
    assert world.client.get().code == BtGetData.Result.SUCCESS
    Held.release.set()
    assert blocked.result.code == Result.SUCCESS


@pytest.mark.parametrize(
    ('node', 'fragment'),
    [
        ('RaisesInTick', 'scripted fault'),
        ('Returns what="\'SUCCESS\'"', "'SUCCESS'"),
        ('RaisesInTick kind="{no_such_key}"', 'no_such_key'),
    ],
)
def test_a_node_that_is_broken_is_an_error_with_its_path(world: ServerWorld, node: str, fragment: str) -> None:
    world.client.load_tree(f'<Sequence><Spin/><{node}/></Sequence>')
    goal = world.client.execute()
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.ERROR
    assert node.split()[0] in goal.result.failed_node
    assert fragment in goal.result.message
    assert world.client.execute().result.code == Result.ERROR  # and the server is still there


def test_a_node_of_an_installed_package_waits_for_a_topic(world: ServerWorld) -> None:
    world.client.load_tree('<RetryUntilSuccessful num_attempts="-1"><DoorOpen/></RetryUntilSuccessful>', 'Spinning')
    world.client.load_tree('<ReactiveFallback><DoorOpen/><Wait wait_duration="60"/></ReactiveFallback>')
    world.navigation.hold.add(names.WAIT)
    goal = world.client.execute()
    wait_until(lambda: world.navigation.actions[names.WAIT].running)
    door = world.client.runtime.call(
        lambda: world.client.runtime.node.create_publisher(Bool, 'door', names.transient_local_qos())
    )
    wait_until(lambda: (door.publish(Bool(data=True)), goal.ended)[1])
    assert goal.result.code == Result.SUCCESS
    wait_until(lambda: world.navigation.actions[names.WAIT].statuses == {0: 'canceled'})


def test_feedback_tells_where_the_tree_and_the_robot_are() -> None:
    with open_server_world(feedback_rate=50.0) as world:
        world.navigation.hold.add(names.FOLLOW_PATH)
        runtime = world.navigation_runtime
        robot = runtime.call(lambda: runtime.node.create_publisher(type(pose_stamped(0)), names.POSE, 1))
        world.client.load_tree(f'<Sequence name="drive">{PLAN}<Spin/>{FOLLOW}</Sequence>')
        goal = world.client.execute(goals=[pose_stamped(3)])
        wait_until(
            lambda: (
                robot.publish(pose_stamped(1)),
                goal.feedback and goal.feedback[-1].current_location == pose_stamped(1),
            )[1]
        )
        wait_until(lambda: any('FollowPath' in path for path in goal.feedback[-1].active_nodes), 'the leaf')
        feedback = goal.feedback[-1]
        assert 'drive' in feedback.active_nodes[0]
        assert feedback.number_of_recoveries == 1
        wait_until(lambda: goal.feedback[-1].distance_remaining == pytest.approx(2.0))
        assert goal.feedback[-1].goal == pose_stamped(3) and goal.feedback[-1].poses_remaining == 1
        assert goal.feedback[-1].time_remaining == -1.0  # it stands
        assert goal.feedback[-1].run_id == goal.call.goal_id.hex()
        assert feedback.execution_time.sec + feedback.execution_time.nanosec > 0
        goal.call.cancel(DEADLINE)
        goal.wait()


def test_feedback_on_one_goal_is_not_about_the_goals_of_an_earlier_run() -> None:
    with open_server_world(feedback_rate=50.0) as world:
        world.client.load_tree('<AlwaysSuccess/>', 'Done')
        world.client.load_tree('<Sleep msec="100000"/>')
        assert world.client.execute('Done', goals=[pose_stamped(1), pose_stamped(2)]).result.code == Result.SUCCESS
        goal = world.client.execute(goals=[pose_stamped(3)])
        wait_until(lambda: goal.feedback)
        assert (goal.feedback[-1].goal, goal.feedback[-1].poses_remaining) == (pose_stamped(3), 1)
        goal.call.cancel(DEADLINE)
        goal.wait()


def test_every_transition_is_published_before_the_result(world: ServerWorld) -> None:
    runtime = world.client.runtime
    structures: list[TreeStructure] = []
    statuses: list[TreeStatus] = []
    runtime.call(
        lambda: (
            runtime.node.create_subscription(
                TreeStructure, names.TREE_STRUCTURE, structures.append, names.transient_local_qos(16)
            ),
            runtime.node.create_subscription(
                TreeStatus, names.TREE_STATUS, statuses.append, names.transient_local_qos(100)
            ),
        )
    )
    world.client.load_tree(DRIVE)
    assert world.client.execute(goals=[pose_stamped(1)]).result.code == Result.SUCCESS
    wait_until(lambda: statuses and statuses[-1].finished)
    (structure,) = structures
    assert [node.registration for node in structure.nodes][-2:] == ['ComputePathToPose', 'FollowPath']
    assert [node.uid for node in structure.nodes] == list(range(1, len(structure.nodes) + 1))
    assert {message.run_id for message in statuses} == {structure.run_id}
    assert [message.sequence for message in statuses] == list(range(1, len(statuses) + 1))
    # The changes account for every status, from the first to the last.
    shown = [TreeStatus.IDLE] * len(structure.nodes)
    history: dict[int, list[int]] = {}
    for message in statuses:
        for change in message.changes:
            assert shown[change.uid - 1] == change.previous_status
            shown[change.uid - 1] = change.status
            history.setdefault(change.uid, []).append(change.status)
        assert list(message.statuses) == shown
    for node in structure.nodes[-2:]:
        assert history[node.uid][:2] == [TreeStatus.RUNNING, TreeStatus.SUCCESS]


def test_the_death_of_the_owner_stops_the_tree(world: ServerWorld) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load_tree(DRIVE)
    with NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)
        goal = world.client.execute(goals=[pose_stamped(1)], owner='/owner')
        wait_until(lambda: follow.running)
        wait_until(lambda: world.server.goals.owners.sees('/owner'), 'the owner was seen')
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.CANCELED
    assert '/owner' in goal.result.message
    assert not follow.running


def test_an_owner_that_is_never_seen_stops_the_tree(world: ServerWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.actions.goal_owners.OWNER_SECONDS', 0.2)
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree('<Spin/>')
    goal = world.client.execute(owner='/nobody')
    assert goal.result.code == Result.CANCELED
    assert '/nobody' in goal.result.message and 'liveliness' in goal.result.message


ELSEWHERE = ProcessIdentity('another computer', 7, '1')


@pytest.mark.parametrize('dead', ['here', 'on another computer'])
def test_the_goal_of_a_dead_process_ends_though_another_one_has_its_name(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch, dead: str
) -> None:
    own = ProcessIdentity.own()
    process = ProcessIdentity(own.host, own.pid, '1') if dead == 'here' else ELSEWHERE
    monkeypatch.setattr('flexbt_server.actions.goal_owners.OWNER_SECONDS', DEADLINE if dead == 'here' else 0.2)
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree('<Spin/>')
    with NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)
        living = world.client.execute(owner='/owner', owner_process=str(own))
        wait_until(lambda: world.server.goals.owners.sees('/owner', own), 'the owner was seen')
        late = world.client.execute(blackboard='b', owner='/owner', owner_process=str(process))
        assert late.result.code == Result.CANCELED
        assert '/owner' in late.result.message
        assert not living.ended
    assert living.result.code == Result.CANCELED


def test_the_goal_of_a_process_goes_on_when_it_is_noticed_that_it_has_replaced_another(world: ServerWorld) -> None:
    own, owners = ProcessIdentity.own(), world.server.goals.owners
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree('<Spin/>')
    with NodeRuntime.open('owner') as owner:
        token = LivelinessToken(owner)
        token._held._identity = ELSEWHERE
        token.set_ready(True)
        old = world.client.execute(blackboard='b', owner='/owner', owner_process=str(ELSEWHERE))
        wait_until(lambda: owners.sees('/owner', ELSEWHERE), 'the first process was seen')
        new = world.client.execute(owner='/owner', owner_process=str(own))
        wait_until(lambda: len(owners._goals.get('/owner', ())) == 2, 'the goal')
        token._held._identity = own
        token.set_ready(True)
        assert old.result.code == Result.CANCELED and 'another process has its name' in old.result.message
        assert owners.sees('/owner', own) and not new.ended
    assert new.result.code == Result.CANCELED


def test_a_goal_ends_with_its_node_though_another_one_of_the_process_has_its_name_before_that_is_handled(
    world: ServerWorld,
) -> None:
    own, owners = ProcessIdentity.own(), world.server.goals.owners
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree('<Spin/>')
    with NodeRuntime.open('owner') as owner:
        LivelinessToken(owner)
        goal = world.client.execute(owner='/owner', owner_process=str(own))
        wait_until(lambda: owners.sees('/owner', own), 'the owner was seen')

        def restart() -> None:
            token = owners._watches['/owner']._token
            token._leave()
            token._on_status(DiagnosticStatus(), own)

        world.server_runtime.call(restart)
        assert goal.result.code == Result.CANCELED and owners.sees('/owner', own)


@pytest.mark.parametrize('process', ['7', 'x y z', ' ', 'host 1.5 3'])
def test_what_is_no_process_is_refused_and_leaves_nothing(world: ServerWorld, process: str) -> None:
    world.client.load_tree('<AlwaysSuccess/>')
    result = world.client.execute(owner='/owner', owner_process=process).result
    assert result.code == Result.ERROR and repr(process) in result.message and 'HOST PID BEGAN' in result.message
    assert not world.server.goals.owners._goals


def test_owners_whose_goals_are_over_are_forgotten(world: ServerWorld, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.actions.goal_owners.OWNER_SECONDS', 2.0)  # enough for a tree
    world.client.load_tree('<AlwaysSuccess/>')
    owners = [f'/owner{number}' for number in range(60)]  # more than are kept for a moment
    for owner in owners:
        assert world.client.execute(owner=owner).result.code == Result.SUCCESS
    count = world.client.runtime.node.count_subscribers

    def watched() -> list[str]:
        return [owner for owner in owners if count(f'{owner}/alive')]

    watches = world.server.goals.owners._watches
    wait_until(lambda: not watches and not watched(), lambda: f'the end of the watch over {[*watches]}, {watched()}')


@pytest.mark.parametrize('owner', ['two words', '/a//b', '/', '1st', '{robot}', '/' + 'long' * 99])
def test_an_owner_that_can_be_no_node_is_refused_and_leaves_nothing(world: ServerWorld, owner: str) -> None:
    faults: list[BaseException] = []
    world.server_runtime.on_fault(faults.append)
    world.client.load_tree('<AlwaysSuccess/>')
    result = world.client.execute(owner=owner).result
    assert result.code == Result.ERROR and repr(owner) in result.message and 'node name' in result.message
    owners = world.server.goals.owners
    assert not faults and not owners._goals and not owners._watches


def test_the_end_of_the_server_stops_the_robot_and_tells_the_client() -> None:
    with NodeRuntime.open('bt_server') as extra:
        extra.close()
    with open_server_world() as world:
        world.navigation.hold.add(names.FOLLOW_PATH)
        follow = world.navigation.actions[names.FOLLOW_PATH]
        world.client.load_tree(DRIVE)
        goal = world.client.execute(goals=[pose_stamped(1)])
        wait_until(lambda: follow.running)
        began = uncontended_time()
        world.server_runtime.close()
        assert uncontended_time() - began < 1.7
        assert not follow.running
        assert goal.result.code == Result.CANCELED
        assert 'shutting down' in goal.result.message


def test_a_server_of_a_leaf_that_is_missing_fails_the_tree_in_time() -> None:
    with open_server_world(server_timeout=0.2) as world:
        world.client.load_tree('<Spin server_name="no_such_server"/>')
        goal = world.client.execute()
        assert goal.result.code == Result.FAILURE
        assert 'no_such_server' in goal.result.message


def test_an_edited_file_is_used_by_the_next_goal(tmp_path: Path) -> None:
    with open_server_world(allowed_directories=[str(tmp_path)]) as world:
        file = tmp_path / 'tree.xml'
        file.write_text(document('<AlwaysSuccess/>'))
        assert world.client.execute(str(file)).result.code == Result.SUCCESS
        file.write_text(document('<AlwaysFailure name="edited"/>'))
        result = world.client.execute(str(file)).result
        assert result.code == Result.FAILURE and 'edited' in result.failed_node
        file.write_text('<root BTCPP_format="4">')
        result = world.client.execute(str(file)).result
        assert result.code == Result.FAILURE and 'edited' in result.failed_node
        assert f'the last good version runs: {file}:1:' in result.message


def test_a_failure_and_an_error_carry_the_reasons_up_to_the_root(world: ServerWorld) -> None:
    world.navigation.fail[names.SPIN] = (2, 0)
    inner = document(
        '<RetryUntilSuccessful num_attempts="2" name="again"><Spin name="turn"/></RetryUntilSuccessful>', 'Inner'
    )
    assert world.client.load(xml=inner).code == BtLoad.Result.SUCCESS
    world.client.load_tree('<Sequence name="all"><AlwaysSuccess/><SubTree ID="Inner" name="in"/></Sequence>')
    result = world.client.execute().result
    assert result.code == Result.FAILURE
    turn, *above = result.reasons
    assert turn == result.message
    assert turn.startswith('in/turn: ') and 'scripted failure 1' in turn
    assert above == [
        'in/again: RetryUntilSuccessful: all 2 attempts failed (num_attempts="2")',
        'in: the tree [Inner] failed',
        'all: Sequence: child 2 of 2 failed',
    ]
    world.client.load_tree('<Fallback name="all"><AlwaysFailure/><RaisesInTick name="bad"/></Fallback>')
    result = world.client.execute().result
    assert result.code == Result.ERROR
    assert list(result.reasons) == ['bad: RuntimeError: scripted fault', 'all: Fallback: in child 2 of 2']
    world.client.load_tree('<AlwaysSuccess/>')
    assert not world.client.execute().result.reasons
