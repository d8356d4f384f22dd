# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that reach any action, service, topic and parameter: what is sent, what comes back, what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from nav2_msgs.action import FollowWaypoints, Spin, Wait
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.values.entries import from_entry
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.nodes.server_world import ServerWorld, document, open_server_world, pose_stamped
from flexbt_testing.waiting import wait_until

Result = BtExecute.Result
SPIN = '<CallAction type="nav2_msgs/action/Spin" server_name="spin" {}/>'


@pytest.fixture(scope='module')
def opened() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as world:
        yield world


@pytest.fixture
def world(opened: ServerWorld) -> ServerWorld:
    for server in opened.navigation.actions.values():
        server.forget()
    opened.navigation.hold.clear()
    opened.navigation.fail.clear()
    return opened


def run(world: ServerWorld, body: str, name: str, **fields: Any) -> Any:
    world.client.load_tree(body)
    return world.client.execute(blackboard=name, **fields).result


def refused(world: ServerWorld, body: str) -> str:
    result = world.client.load(xml=document(body))
    assert result.code != BtLoad.Result.SUCCESS
    return str(result.message)


# -- actions ---------------------------------------------------------------------------------------------------------


def test_a_goal_has_constants_entries_and_expressions(world: ServerWorld) -> None:
    body = (
        '<Sequence><Script code="turns := 2"/>'
        '<CallAction type="nav2_msgs/action/FollowWaypoints" server_name="{server}" '
        'goal.number_of_loops="${turns * 3}" goal.poses.0="{first}" goal.poses.1.header.frame_id="odom" '
        'goal.poses.1.pose.position.x="${first.pose.position.x + 1}" goal.poses.1.pose.position.y="0.5"/></Sequence>'
    )
    world.navigation.serve({'my/waypoints': FollowWaypoints})
    result = run(world, body, 'goal', inputs={'first': pose_stamped(3.0), 'server': 'my/waypoints'})
    assert result.code == Result.SUCCESS, result.message
    (goal,) = world.navigation.actions['my/waypoints'].goals
    assert goal.number_of_loops == 6
    first, second = goal.poses
    assert first == pose_stamped(3.0)
    assert (second.header.frame_id, second.pose.position.x, second.pose.position.y) == ('odom', 4.0, 0.5)


def test_an_entry_of_the_blackboard_is_not_changed_by_fields_within_it(world: ServerWorld) -> None:
    body = (
        '<CallAction type="nav2_msgs/action/ComputePathToPose" server_name="compute_path_to_pose" goal.goal="{place}" '
        'goal.goal.header.frame_id="odom" goal.use_start="false"/>'
    )
    result = run(world, body, 'shared', inputs={'place': pose_stamped(3.0)})
    assert result.code == Result.SUCCESS, result.message
    assert world.navigation.actions[names.COMPUTE_PATH_TO_POSE].goals[0].goal.header.frame_id == 'odom'
    assert value(world, 'place', 'shared') == pose_stamped(3.0)


def test_results_and_feedback_go_to_the_blackboard(world: ServerWorld) -> None:
    world.navigation.hold.add(names.WAIT)
    body = (
        '<CallAction type="nav2_msgs/action/Wait" server_name="wait" goal.time.sec="3" feedback.time_left.sec="{left}" '
        'result="{whole}" result.total_elapsed_time.sec="{passed}"/>'
    )
    world.client.load_tree(body)
    goal = world.client.execute(blackboard='results')
    wait = world.navigation.actions[names.WAIT]
    wait_until(lambda: wait.goals, 'the goal')
    assert wait.goals[0].time.sec == 3
    feedback = Wait.Feedback()
    feedback.time_left.sec = 2
    wait.feedback(0, feedback)
    wait_until(lambda: value(world, 'left', 'results') == 2, 'the feedback')
    result = Wait.Result()
    result.total_elapsed_time.sec = 7
    wait.end(0, result=result)
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert value(world, 'passed', 'results') == 7


def test_feedback_right_before_the_end_counts(world: ServerWorld) -> None:
    async def script(handle: ServerGoalHandle) -> Any:
        for turned in (1.0, 2.0):
            handle.publish_feedback(Spin.Feedback(angular_distance_traveled=turned))
        getattr(handle, 'abort' if handle.request.target_yaw else 'succeed')()
        return Spin.Result()

    ScriptedActionServer(world.navigation_runtime, Spin, 'turn', script)
    body = (
        '<CallAction type="nav2_msgs/action/Spin" server_name="turn" goal.target_yaw="{}" '
        'feedback.angular_distance_traveled="{{turned}}" success="feedback.angular_distance_traveled == 2"/>'
    )
    for yaw, code in ((0.0, Result.SUCCESS), (1.0, Result.FAILURE)):
        result = run(world, body.format(yaw), f'turn{code}')
        assert result.code == code, result.message
        assert value(world, 'turned', f'turn{code}') == 2.0


def test_a_goal_that_is_sent_again_after_a_pause_has_no_feedback_at_first(world: ServerWorld) -> None:
    world.navigation.hold.add(names.WAIT)
    body = (
        '<ReactiveSequence><ScriptCondition code="(ticks += 1) > 0"/>'
        '<CallAction type="nav2_msgs/action/Wait" server_name="wait" feedback.time_left.sec="{left}"/>'
        '</ReactiveSequence>'
    )
    world.client.load_tree(body)
    goal = world.client.execute(blackboard='paused', inputs={'ticks': 0})
    wait = world.navigation.actions[names.WAIT]
    wait_until(lambda: wait.goals, 'the goal')
    feedback = Wait.Feedback()
    feedback.time_left.sec = 2
    wait.feedback(0, feedback)
    wait_until(lambda: value(world, 'left', 'paused') == 2, 'the feedback')
    run = world.server_runtime.call(lambda: world.server.goals.running.find(goal.call.goal_id.hex()).run)
    run.hold('a test')
    wait_until(lambda: wait.cancels, 'the cancel for the pause')
    run.hold('')
    wait_until(lambda: len(wait.goals) == 2, 'the goal is sent again')
    before = value(world, 'ticks', 'paused')
    wait_until(lambda: goal.ended or value(world, 'ticks', 'paused') > before + 1, 'a tick without feedback')
    assert not goal.ended, goal.result.message
    feedback.time_left.sec = 1
    wait.feedback(1, feedback)
    wait_until(lambda: value(world, 'left', 'paused') == 1, 'the next feedback')
    wait.end(1)
    assert goal.result.code == Result.SUCCESS, goal.result.message


@pytest.mark.parametrize(('code', 'condition', 'succeeds'), [
    (0, 'result.error_code == 0', True),
    (0, 'result.error_code == result.NONE', True),
    (0, "result.error_msg == 'no'", False),
    (0, 'limit > result.error_code', True),
    (0, 'unknown == result.error_code', False),
])  # fmt: skip
def test_success_may_be_a_condition_on_the_result(
    world: ServerWorld, code: int, condition: str, succeeds: bool
) -> None:
    escaped = condition.replace('>', '&gt;')
    result = run(world, SPIN.format(f'success="{escaped}"'), 'condition', inputs={'limit': 5})
    assert (result.code == Result.SUCCESS) is succeeds, result.message
    if not succeeds:
        assert 'success: ' in result.message


def test_a_goal_that_fails_is_a_failure_with_its_error_code(world: ServerWorld) -> None:
    world.navigation.fail[names.SPIN] = 1, 703
    result = run(world, SPIN.format('error_code_id="{code}"'), 'fails')
    assert result.code == Result.FAILURE
    assert 'scripted failure 0' in result.message
    assert value(world, 'code', 'fails') == 703
    unmade = SPIN.format('error_code_id="{code}" goal.time_allowance.sec="{nowhere}"')
    assert run(world, unmade, 'fails').code == Result.FAILURE
    assert value(world, 'code', 'fails') == 0


def test_a_halt_cancels_the_goal(world: ServerWorld) -> None:
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree(SPIN.format(''))
    goal = world.client.execute(blackboard='halt')
    spin = world.navigation.actions[names.SPIN]
    wait_until(lambda: spin.goals, 'the goal')
    goal.cancel()
    wait_until(lambda: spin.cancels == 1, 'the cancel')
    assert goal.result.code == Result.CANCELED


# -- services --------------------------------------------------------------------------------------------------------


def test_a_service_is_called_and_its_response_judged(world: ServerWorld) -> None:
    asked = []

    def answer(request: Any, response: Any) -> Any:
        asked.append(request.data)
        response.success, response.message = request.data, f'it is {request.data}'
        return response

    node = world.navigation_runtime.node
    service = world.navigation_runtime.call(lambda: node.create_service(SetBool, 'lamp', answer))
    call = '<CallService type="std_srvs/SetBool" service_name="lamp" request.data="{}" {}/>'
    body = call.format('{on}', 'response.message="{said}" success="response.success"')
    result = run(world, body, 'on', inputs={'on': True})
    assert result.code == Result.SUCCESS, result.message
    assert (asked, value(world, 'said', 'on')) == ([True], 'it is True')
    result = run(world, body, 'off', inputs={'on': False})
    assert result.code == Result.FAILURE
    assert 'not true: response.success (response.success = False)' in result.message
    result = run(world, call.format('false', ''), 'any')
    assert result.code == Result.SUCCESS, result.message
    world.navigation_runtime.call(lambda: node.destroy_service(service))


# -- topics ----------------------------------------------------------------------------------------------------------


def test_a_message_is_published_and_read(world: ServerWorld) -> None:
    heard: list[Any] = []
    runtime = world.navigation_runtime
    runtime.call(lambda: runtime.node.create_subscription(Float64MultiArray, 'numbers', heard.append, 10))
    body = (
        '<Publish type="std_msgs/msg/Float64MultiArray" topic_name="numbers" message.data="1;2.5;3" '
        'message.layout.dim.0.label="a" message.layout.dim.0.size="3"/>'
    )
    result = run(world, body, 'publish')
    assert result.code == Result.SUCCESS, result.message
    wait_until(lambda: heard, 'the message')
    assert list(heard[0].data) == [1.0, 2.5, 3.0]
    assert [(one.label, one.size) for one in heard[0].layout.dim] == [('a', 3)]


def test_a_topic_is_read_when_a_message_comes(world: ServerWorld) -> None:
    runtime = world.navigation_runtime
    qos = QoSProfile(depth=1)
    publisher = runtime.call(lambda: runtime.node.create_publisher(String, 'said', qos))
    world.client.load_tree(
        '<ReadTopic type="std_msgs/msg/String" topic_name="said" timeout="60000" new="true" message.data="{text}"/>'
    )
    goal = world.client.execute(blackboard='read')
    wait_until(lambda: publisher.get_subscription_count(), 'the subscription')
    wait_until(lambda: goal.feedback, 'it waits')
    publisher.publish(String(data='hello'))
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert value(world, 'text', 'read') == 'hello'


def test_a_topic_without_messages_fails_in_time(world: ServerWorld) -> None:
    body = '<ReadTopic type="std_msgs/msg/String" topic_name="silent" timeout="10"/>'
    result = run(world, body, 'silent')
    assert (result.code, 'no message on silent within 0.01 s' in result.message) == (Result.FAILURE, True)


@pytest.mark.dds('the middleware refuses a second type of a topic')
@pytest.mark.parametrize('leaf', ['ReadTopic', 'Publish'])
def test_a_topic_that_has_another_type_is_a_failure_with_its_reason(world: ServerWorld, leaf: str) -> None:
    faults: list[BaseException] = []
    world.server_runtime.on_fault(faults.append)
    result = run(world, f'<{leaf} type="std_msgs/msg/String" topic_name="pose"/>', 'wrong')
    assert result.code == Result.FAILURE, result.message
    assert 'has the type geometry_msgs/msg/PoseStamped' in result.message
    assert not faults


def test_a_condition_on_a_topic(world: ServerWorld) -> None:
    runtime = world.navigation_runtime
    publisher = runtime.call(lambda: runtime.node.create_publisher(BatteryState, 'cell', 10))
    check = '<CheckTopic type="sensor_msgs/msg/BatteryState" topic_name="cell" check="message.percentage &gt; least"/>'
    world.client.load_tree(check)
    wait_until(lambda: publisher.get_subscription_count(), 'the subscription, made at load')
    assert 'no message yet' in world.client.execute(blackboard='cell', inputs={'least': 0.2}).result.message
    publisher.publish(BatteryState(percentage=0.5))
    wait_until(
        lambda: world.client.execute(blackboard='cell', inputs={'least': 0.2}).result.code == Result.SUCCESS, 'it holds'
    )
    result = world.client.execute(blackboard='cell', inputs={'least': 0.7}).result
    assert result.code == Result.FAILURE
    assert 'not true: message.percentage > least (message.percentage = 0.5)' in result.message


@pytest.mark.parametrize(('leaf', 'what'), [
    ('<CallAction type="nav2_msgs/action/Spin" server_name="{name}"/>', 'action server'),
    ('<CallService type="std_srvs/srv/SetBool" service_name="{name}"/>', 'service'),
])  # fmt: skip
def test_a_name_that_no_server_can_have_is_told(world: ServerWorld, leaf: str, what: str) -> None:
    result = run(world, leaf, 'names', inputs={'name': 'two words'})
    assert result.code == Result.ERROR
    assert f"{what} 'two words' (" in result.message


# -- parameters ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(('default', 'text', 'wanted'), [
    (1.0, '2', 2.0),
    (1, '3', 3),
    ('a', '5', '5'),
    (True, 'false', False),
    ([1.0], '[2, 3]', [2.0, 3.0]),
    (1, '4.0', 4),
    ([1.0], '[2, 3.5]', [2.0, 3.5]),
    ([1], '[2, 3.0]', [2, 3]),
])  # fmt: skip
def test_a_parameter_is_set_as_the_type_that_it_has(world: ServerWorld, default: Any, text: str, wanted: Any) -> None:
    node = world.navigation_runtime.node
    name = f'p{abs(hash(str(wanted)))}'
    world.navigation_runtime.call(lambda: node.declare_parameter(name, default))
    result = run(world, f'<SetParameter node_name="/navigation" parameter="{name}" value="{text}"/>', 'set')
    assert result.code == Result.SUCCESS, result.message
    found = world.navigation_runtime.call(lambda: node.get_parameter(name).value)
    assert (list(found) if isinstance(wanted, list) else found) == wanted


@pytest.mark.parametrize('text', ['9223372036854775808', '[1, -9223372036854775809]', '1' + '0' * 400])
def test_what_no_parameter_can_have_is_told(world: ServerWorld, text: str) -> None:
    result = run(world, f'<SetParameter node_name="/navigation" parameter="any" value="{text}"/>', 'set')
    assert result.code == Result.FAILURE
    assert 'port [value]: no parameter can have the value ' in result.message


def test_a_parameter_is_checked(world: ServerWorld) -> None:
    node = world.navigation_runtime.node
    world.navigation_runtime.call(lambda: node.declare_parameter('speed', 0.5))
    check = '<CheckParameter node_name="navigation" parameter="{}" check="value &lt; {}"/>'
    assert run(world, check.format('speed', 1), 'check').code == Result.SUCCESS
    result = run(world, check.format('speed', 0.1), 'check')
    assert 'not true: value < 0.1 (value = 0.5)' in result.message
    result = run(world, check.format('sped', 1), 'check')
    assert "navigation has no parameter 'sped'" in result.message
    result = run(world, '<SetParameter node_name="navigation" parameter="sped" value="1"/>', 'set')
    assert "navigation refused to set 'sped'" in result.message


# -- what is refused at load -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(('body', 'reason'), [
    (SPIN.replace('Spin', 'Spn', 1).format(''), "package 'nav2_msgs' has no action 'Spn'; did you mean 'Spin'?"),
    (SPIN.format('goal.target_yw="1"'), "Spin_Goal has no field 'target_yw'; did you mean 'target_yaw'?"),
    (SPIN.format('goal.target_yaw="left"'), 'port [goal.target_yaw] of type float: '),
    (SPIN.format('goal.time_allowance.second="1"'), "Duration has no field 'second'"),
    (SPIN.format('result.error_cod="{x}"'), "Spin_Result has no field 'error_cod'; did you mean 'error_code'?"),
    (SPIN.format('result.error_code="5"'), 'output port [result.error_code] has to point to the blackboard'),
    (SPIN.format('success="result.error_cod == 0"'), "Spin_Result has no field 'error_cod'"),
    (SPIN.format('success="result.error_code =="'), 'port [success] of type condition: '),
    (SPIN.format('goal.target_yaw="${1 +}"'), 'port [goal.target_yaw] of type expression: '),
    (SPIN.format('gaol.target_yaw="1"'), "[CallAction] has no 'gaol'"),
    (SPIN.format('on_pause="stop"'), "[on_pause]: 'stop' is none of cancel, continue"),
    (SPIN.format('resources="arm; {which}"'), '[resources]: {which} has to be written here, not on the blackboard'),
    ('<CallAction server_name="spin"/>', 'port [type] of type std::string of [CallAction] is missing'),
    ('<CallAction type="{kind}" server_name="spin"/>', 'write package/action/Name'),
    ('<Publish type="std_msgs/msg/String" topic_name="x" message.data.0="a"/>', "which has no field '0'"),
    ('<Publish type="std_msgs/msg/String" topic_name="x" qos="best"/>', "'best' is none of default, latched, sensor"),
    ('<CheckTopic type="std_msgs/msg/String" topic_name="x" check="message.data == \'a\'" message.data="{x}"/>',
     'a condition writes nothing; use ReadTopic'),
])  # fmt: skip
def test_mistakes_are_found_at_load(world: ServerWorld, body: str, reason: str) -> None:
    assert reason in refused(world, body)


def value(world: ServerWorld, key: str, blackboard: str) -> Any:
    """Return an entry of a blackboard of the server; None while there is none."""
    entries = world.client.get(key, blackboard=blackboard).entries
    return from_entry(entries[0]) if entries else None
