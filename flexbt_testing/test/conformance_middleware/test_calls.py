# SPDX-License-Identifier: BSD-3-Clause
"""Services, actions, parameters and lifecycle nodes: what each side is answered, and when."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from nav2_msgs.action import Wait
from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    SetParametersResult,
)
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.action.graph import get_action_names_and_types
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException, ParameterNotDeclaredException
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.parameter import Parameter, ParameterValue
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSPresetProfiles, QoSProfile, ReliabilityPolicy, qos_profile_action_status_default
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

RCLError = rclpy_implementation.RCLError

# Services


def test_clients_get_their_own_responses(ros: Any) -> None:
    def answer(request: Any, response: Any) -> Any:
        response.success, response.message = request.data, str(request.data)
        return response

    deep = QoSProfile(depth=100)
    ros.node('server').create_service(SetBool, ros.topic, answer, qos_profile=deep)
    clients = [ros.node(f'client_{n}').create_client(SetBool, ros.topic, qos_profile=deep) for n in range(2)]
    for client in clients:
        assert client.wait_for_service(60.0)
    futures = [clients[number % 2].call_async(SetBool.Request(data=number % 3 == 0)) for number in range(20)]
    assert [ros.result(future).success for future in futures] == [number % 3 == 0 for number in range(20)]


def test_a_service_that_ends_is_gone_and_comes_back(ros: Any) -> None:
    server = ros.node('server')
    client = ros.node('client').create_client(Trigger, ros.topic)
    assert not client.wait_for_service(0.01)
    service = server.create_service(Trigger, ros.topic, lambda _request, response: response)
    assert client.wait_for_service(60.0)
    server.destroy_service(service)
    ros.wait(lambda: not client.service_is_ready())
    server.create_service(Trigger, ros.topic, lambda _request, response: response)
    ros.wait(client.service_is_ready)
    assert ros.result(client.call_async(Trigger.Request())) == Trigger.Response()


def test_a_service_may_be_answered_by_a_coroutine(ros: Any) -> None:
    node = ros.node('server')
    group = ReentrantCallbackGroup()
    inner = node.create_client(Trigger, f'{ros.topic}_inner', callback_group=group)

    async def answer(_request: Any, response: Any) -> Any:
        response.message = 'outer ' + (await inner.call_async(Trigger.Request())).message
        return response

    def answer_inner(_request: Any, response: Any) -> Any:
        response.message = 'inner'
        return response

    node.create_service(Trigger, ros.topic, answer, callback_group=group)
    ros.node('other').create_service(Trigger, f'{ros.topic}_inner', answer_inner)
    assert inner.wait_for_service(60.0)
    client = ros.node('client').create_client(Trigger, ros.topic)
    assert client.wait_for_service(60.0)
    assert ros.result(client.call_async(Trigger.Request())).message == 'outer inner'


def test_a_queue_of_requests_keeps_the_newest(ros: Any) -> None:
    asked: list[bool] = []
    server = ros.node('server', spins=False)

    def answer(request: Any, response: Any) -> Any:
        asked.append(request.data)
        return response

    server.create_service(SetBool, ros.topic, answer, qos_profile=QoSProfile(depth=2))
    client = ros.node('client').create_client(SetBool, ros.topic)
    assert client.wait_for_service(60.0)
    futures = [client.call_async(SetBool.Request(data=number >= 3)) for number in range(5)]
    ros.spin(server)
    assert ros.result(futures[4]) is not None
    assert asked[-1] is True
    if rclpy.get_rmw_implementation_identifier() == 'one_process':  # where all have arrived before the server looks
        assert asked == [True, True]


def test_a_service_has_one_type_in_a_context(ros: Any) -> None:
    node = ros.node('server')
    node.create_service(Trigger, ros.topic, lambda _request, response: response)
    with pytest.raises(RCLError):
        node.create_client(SetBool, ros.topic)
    with pytest.raises(RCLError):
        node.create_service(SetBool, ros.topic, lambda _request, response: response)


RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
PERIODIC = QoSProfile(depth=10, deadline=Duration(seconds=10.0))
BEST = QoSPresetProfiles.BEST_AVAILABLE.value


@pytest.mark.parametrize(
    ('served', 'asked'), [(RELIABLE, BEST_EFFORT), (BEST_EFFORT, RELIABLE), (RELIABLE, PERIODIC), (PERIODIC, RELIABLE)]
)
def test_only_a_service_whose_quality_fits_both_ways_is_there(ros: Any, served: QoSProfile, asked: QoSProfile) -> None:
    ros.node('server').create_service(Trigger, ros.topic, lambda _request, response: response, qos_profile=served)
    node = ros.node('client')
    misfit, fit = (node.create_client(Trigger, ros.topic, qos_profile=qos) for qos in (asked, served))
    assert fit.wait_for_service(60.0)
    assert ros.result(fit.call_async(Trigger.Request())) == Trigger.Response()
    assert not misfit.service_is_ready()
    best = node.create_client(Trigger, ros.topic, qos_profile=BEST)
    assert best.wait_for_service(60.0 if served is RELIABLE else 0.0) == (served is RELIABLE)


# Actions


class Server:
    """An action server whose goals wait until the test ends them."""

    def __init__(self, ros: Any, **options: Any) -> None:
        self.node = ros.node('server', spins=False)
        self.handles: list[Any] = []
        self.end = threading.Event()
        self.outcome = 'succeed'
        self.accepts_cancel = self.notices_cancel = True
        self.asked_to_cancel = 0
        self._ros = ros
        self.server = ActionServer(
            self.node,
            Wait,
            ros.topic,
            self._execute,
            goal_callback=lambda goal: GoalResponse.REJECT if goal.time.sec < 0 else GoalResponse.ACCEPT,
            cancel_callback=self._answer_cancel,
            callback_group=ReentrantCallbackGroup(),
            **options,
        )
        self._executor = MultiThreadedExecutor(8, context=self.node.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def _answer_cancel(self, _goal: Any) -> CancelResponse:
        self.asked_to_cancel += 1
        return CancelResponse.ACCEPT if self.accepts_cancel else CancelResponse.REJECT

    def _execute(self, handle: Any) -> Any:
        self.handles.append(handle)
        handle.publish_feedback(Wait.Feedback())
        self._ros.wait(lambda: self.end.is_set() or (handle.is_cancel_requested and self.notices_cancel))
        if self.outcome != 'raise':
            getattr(handle, 'canceled' if handle.is_cancel_requested else self.outcome)()
            return Wait.Result()
        raise RuntimeError('of the test')

    def close(self) -> None:
        self.end.set()
        self._executor.shutdown()
        self._thread.join()


@pytest.fixture
def server(ros: Any) -> Iterator[Server]:
    made = Server(ros)
    yield made
    made.close()


@pytest.fixture
def client(ros: Any, server: Server) -> Any:
    made = ActionClient(ros.node('client'), Wait, ros.topic)
    assert made.wait_for_server(60.0)
    return made


def goal(seconds: int = 1) -> Any:
    made = Wait.Goal()
    made.time.sec = seconds
    return made


@pytest.mark.parametrize(
    ('outcome', 'status'),
    [
        ('succeed', GoalStatus.STATUS_SUCCEEDED),
        ('abort', GoalStatus.STATUS_ABORTED),
        ('raise', GoalStatus.STATUS_ABORTED),
    ],
)
def test_a_goal_ends(ros: Any, server: Server, client: Any, outcome: str, status: int) -> None:
    feedback: list[Any] = []
    server.outcome = outcome
    handle = ros.result(client.send_goal_async(goal(), feedback.append))
    assert handle.accepted
    ros.wait(lambda: feedback)
    assert bytes(feedback[0].goal_id.uuid) == bytes(handle.goal_id.uuid)
    result = handle.get_result_async()
    server.end.set()
    assert ros.result(result).status == status
    assert ros.result(handle.get_result_async()).status == status, 'a second time'


def test_a_goal_is_rejected(ros: Any, server: Server, client: Any) -> None:
    handle = ros.result(client.send_goal_async(goal(-1)))
    assert not handle.accepted
    assert server.handles == []


def test_a_goal_is_canceled_if_the_server_agrees(ros: Any, server: Server, client: Any) -> None:
    handle = ros.result(client.send_goal_async(goal()))
    ros.wait(lambda: server.handles)
    server.accepts_cancel = False
    refused = ros.result(handle.cancel_goal_async())
    assert list(refused.goals_canceling) == []
    server.accepts_cancel = True
    canceling = ros.result(handle.cancel_goal_async())
    assert canceling.return_code == CancelGoal.Response.ERROR_NONE
    assert [bytes(one.goal_id.uuid) for one in canceling.goals_canceling] == [bytes(handle.goal_id.uuid)]
    assert ros.result(handle.get_result_async()).status == GoalStatus.STATUS_CANCELED
    late = ros.result(handle.cancel_goal_async())
    assert late.return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED


def test_a_goal_is_canceled_once(ros: Any, server: Server, client: Any) -> None:
    handle = ros.result(client.send_goal_async(goal()))
    ros.wait(lambda: server.handles)
    server.notices_cancel = False
    assert len(ros.result(handle.cancel_goal_async()).goals_canceling) == 1
    again = ros.result(handle.cancel_goal_async())
    assert (again.return_code, list(again.goals_canceling)) == (CancelGoal.Response.ERROR_GOAL_TERMINATED, [])
    assert server.asked_to_cancel == 1
    server.notices_cancel = True
    assert ros.result(handle.get_result_async()).status == GoalStatus.STATUS_CANCELED


def test_cancel_of_all_and_of_what_is_unknown(ros: Any, server: Server, client: Any) -> None:
    handles = [ros.result(client.send_goal_async(goal())) for _ in range(3)]
    ros.wait(lambda: len(server.handles) == 3)
    cancel = ros.node('other').create_client(CancelGoal, f'{ros.topic}/_action/cancel_goal')
    assert cancel.wait_for_service(60.0)
    unknown = CancelGoal.Request(goal_info=GoalInfo())
    unknown.goal_info.goal_id.uuid = [1] * 16
    assert ros.result(cancel.call_async(unknown)).return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID
    everything = ros.result(cancel.call_async(CancelGoal.Request()))
    assert {bytes(one.goal_id.uuid) for one in everything.goals_canceling} == {
        bytes(one.goal_id.uuid) for one in handles
    }
    for handle in handles:
        assert ros.result(handle.get_result_async()).status == GoalStatus.STATUS_CANCELED


def test_the_list_of_goals_tells_each_status(ros: Any, server: Server, client: Any) -> None:
    lists: list[list[int]] = []
    late: list[list[int]] = []
    listener = ros.node('listener')
    topic = f'{ros.topic}/_action/status'

    def into(those: list[list[int]]) -> Any:
        return lambda message: those.append([one.status for one in message.status_list])

    listener.create_subscription(GoalStatusArray, topic, into(lists), qos_profile_action_status_default)
    ros.wait(lambda: listener.count_publishers(topic))
    handle = ros.result(client.send_goal_async(goal()))
    ros.wait(lambda: [GoalStatus.STATUS_EXECUTING] in lists)
    server.end.set()
    assert ros.result(handle.get_result_async()).status == GoalStatus.STATUS_SUCCEEDED
    ros.wait(lambda: lists[-1] == [GoalStatus.STATUS_SUCCEEDED])
    listener.create_subscription(GoalStatusArray, topic, into(late), qos_profile_action_status_default)
    ros.wait(lambda: late)
    assert late[-1] == [GoalStatus.STATUS_SUCCEEDED]


def test_an_action_is_in_the_graph_until_its_server_ends(ros: Any, server: Server, client: Any) -> None:
    node = ros.node('other')
    ros.wait(lambda: (f'/{ros.topic}', ['nav2_msgs/action/Wait']) in get_action_names_and_types(node))
    server.server.destroy()
    ros.wait(lambda: not client.server_is_ready())


@pytest.mark.parametrize('seconds', [-1.0, 1e10, math.inf, math.nan])
def test_a_time_for_results_that_no_timer_can_wait_for_is_refused(ros: Any, seconds: float) -> None:
    with pytest.raises(ValueError, match='timer period must be non-negative'):
        ActionServer(ros.node('server', spins=False), Wait, ros.topic, print, result_timeout=seconds)


def test_a_goal_that_has_ended_stays_as_it_is(ros: Any, server: Server, client: Any) -> None:
    handle = ros.result(client.send_goal_async(goal()))
    server.end.set()
    assert ros.result(handle.get_result_async()).status == GoalStatus.STATUS_SUCCEEDED
    for end, event in ((server.handles[0].abort, 'ABORT'), (server.handles[0].canceled, 'CANCELED')):
        with pytest.raises(RCLError, match=f'invalid transition from state SUCCEEDED with event {event}'):
            end()


# Parameters


def test_parameters_are_set_and_refused(ros: Any) -> None:
    node = ros.node('server')
    node.declare_parameter(
        'speed', 0.5, ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1.0)])
    )
    node.declare_parameter('fixed', 'a', ParameterDescriptor(read_only=True))
    node.declare_parameter('count', 3)
    node.add_on_set_parameters_callback(
        lambda those: SetParametersResult(successful=all(one.value != 13 for one in those), reason='not 13')
    )
    client = AsyncParameterClient(ros.node('client'), node.get_fully_qualified_name())
    assert client.wait_for_services(60.0)
    wanted = {'speed': 0.7, 'fixed': 'b', 'count': 13, 'unknown': 1}
    results = ros.result(
        client.set_parameters([Parameter(name, value=value) for name, value in wanted.items()])
    ).results
    assert [one.successful for one in results] == [True, False, False, False]
    assert results[2].reason == 'not 13'
    too_fast, wrong_type = ros.result(
        client.set_parameters([Parameter('speed', value=2.0), Parameter('count', value='many')])
    ).results
    assert not too_fast.successful and not wrong_type.successful
    values = ros.result(client.get_parameters(['speed', 'fixed', 'count'])).values
    assert (values[0].double_value, values[1].string_value, values[2].integer_value) == (0.7, 'a', 3)
    described = ros.result(client.describe_parameters(['speed'])).descriptors[0]
    assert (described.type, described.floating_point_range[0].to_value) == (ParameterType.PARAMETER_DOUBLE, 1.0)
    listed = ros.result(client.list_parameters([], 10)).result.names
    assert {'speed', 'fixed', 'count', 'use_sim_time'} <= set(listed)


def test_changes_of_parameters_are_events(ros: Any) -> None:
    events: list[Any] = []
    listener = ros.node('listener')
    listener.create_subscription(ParameterEvent, '/parameter_events', events.append, 100)
    node = ros.node(f'of_{ros.topic}')
    ros.wait(lambda: listener.count_publishers('/parameter_events') >= 2)
    ros.wait(lambda: node.count_subscribers('/parameter_events') >= 1)
    node.declare_parameter('speed', 1.0)

    def of_node() -> list[Any]:
        own = node.get_fully_qualified_name()
        return [p.value for e in events if e.node == own for p in e.changed_parameters if p.name == 'speed']

    node.set_parameters([Parameter('speed', value=2.0)])
    ros.wait(of_node)
    assert of_node() == [ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=2.0)]


def test_parameters_come_from_arguments_and_files(ros: Any, tmp_path: Any) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    a: 1\n    nested: {b: [1.5, 2.5]}\nother:\n  ros__parameters: {a: 2}\n'
    )
    arguments = ['--ros-args', '--params-file', str(file), '-p', 'c:=true', '-p', 'text:="5"', '-p', 'other:d:=1']
    node = ros.node('own', context=ros.context(arguments), automatically_declare_parameters_from_overrides=True)
    values = {name: node.get_parameter(name).value for name in ('a', 'nested.b', 'c', 'text')}
    assert {**values, 'nested.b': list(values['nested.b'])} == {'a': 1, 'nested.b': [1.5, 2.5], 'c': True, 'text': '5'}
    assert not node.has_parameter('d')
    with pytest.raises(ParameterNotDeclaredException):
        node.get_parameter('d')
    with pytest.raises(ParameterAlreadyDeclaredException):
        node.declare_parameter('a', 2)


def test_of_the_values_of_a_parameter_the_last_one_counts(ros: Any, tmp_path: Any) -> None:
    file = tmp_path / 'parameters.yaml'
    contents = ('/**', '{a: 1, b: 1}'), ('own', '{a: 2}'), ('/**', '{b: 3, c: 4}')
    file.write_text(''.join(f'{pattern}:\n  ros__parameters: {values}\n' for pattern, values in contents))
    words = ['--ros-args', '-p', 'a:=0', '-p', 'd:=0', '--params-file', str(file), '-p', 'c:=5']
    node = ros.node('own', context=ros.context(words), automatically_declare_parameters_from_overrides=True)
    assert [node.get_parameter(name).value for name in 'abcd'] == [2, 3, 5, 0]


@pytest.mark.parametrize(
    ('contents', 'words', 'value'),
    [
        ('/**: 1, own: 2', '-p own:a:=3', 3),
        ('/**: 1, own: 2', '-p a:=3', 2),  # /** stands before own
        ('own: 2, /**: 1', '-p a:=3', 3),
        ('own: 1, /own: 2', '-p own:a:=3', 2),
        ('/**: 1', '-p a:=2.5', 1),  # of one pattern the type counts first
        ('/**: x', '-p a:=2.5', 2.5),
        ('/**: [x]', '-p a:=z', 'z'),
        ('/**: x, own: 2', '', 2),
    ],
)
def test_a_pattern_of_nodes_keeps_its_place_and_a_parameter_its_type(
    ros: Any, tmp_path: Any, contents: str, words: str, value: Any
) -> None:
    file = tmp_path / 'parameters.yaml'
    parts = (part.split(': ') for part in contents.split(', '))
    file.write_text(''.join(f'{pattern}:\n  ros__parameters: {{a: {one}}}\n' for pattern, one in parts))
    context = ros.context(['--ros-args', '--params-file', str(file), *words.split()])
    node = ros.node('own', context=context, spins=False, automatically_declare_parameters_from_overrides=True)
    assert (node.get_parameter('a').value, type(node.get_parameter('a').value)) == (value, type(value))


@pytest.mark.parametrize(('word', 'kind'), [
    ('-r no-rule', r'RCLInvalidROSArgsError: Failed to parse ROS arguments: .*no-rule'),
    ('--no-option', r"UnknownROSArgsError: \['--no-option'\]"),
])  # fmt: skip
def test_arguments_of_a_node_that_are_of_no_use_are_refused(ros: Any, word: str, kind: str) -> None:
    with pytest.raises(Exception) as raised:
        ros.node('own', spins=False, cli_args=['--ros-args', *word.split()])
    assert re.match(kind, f'{type(raised.value).__name__}: {raised.value}')


def test_a_context_can_keep_logs_from_the_topic(ros: Any) -> None:
    node = ros.node('own', context=ros.context(['--ros-args', '--disable-rosout-logs']), enable_rosout=True)
    own = node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())
    assert [topic for topic, _ in own] == ['/parameter_events']


PARAMETERS = {
    '1e3': 1000.0,
    '-.5e-3': -0.0005,
    '5.': 5.0,
    'inf': math.inf,
    '-.INF': -math.inf,
    'Infinity': math.inf,
    '0x10': 16,
    '010': 8,
    '08': 8.0,
    '+5': 5,
    '9223372036854775808': 2.0**63,
    '0b11': '0b11',
    '1_000': '1_000',
    '1e400': '1e400',
    '-2e-310': '-2e-310',
    '0e-400': 0.0,
    'y': True,
    'Off': False,
    'tRue': 'tRue',
    "'true'": 'true',
    '!!str 007': '007',
    'null': 'null',
    '~': '~',
    '2024-01-01': '2024-01-01',
    '12:30': '12:30',
    '=': '=',
    '[1e3]': [1000.0],
    '[yes, n]': [True, False],
    "['1', b]": ['1', 'b'],
}


@pytest.mark.parametrize('text', PARAMETERS)
@pytest.mark.parametrize('in_file', [False, True], ids=['argument', 'file'])
def test_a_parameter_is_what_rcl_reads(ros: Any, tmp_path: Any, text: str, in_file: bool) -> None:
    file = tmp_path / 'parameters.yaml'
    file.write_text(f'own:\n  ros__parameters:\n    one: {text}\n')
    words = ['--params-file', str(file)] if in_file else ['-p', f'one:={text}']
    context = ros.context(['--ros-args', *words])
    node = ros.node('own', context=context, spins=False, automatically_declare_parameters_from_overrides=True)
    value = node.get_parameter('one').value
    value = list(value) if not isinstance(value, str) and hasattr(value, '__iter__') else value
    assert value == PARAMETERS[text]
    assert type(value) is type(PARAMETERS[text])


@pytest.mark.parametrize('words', ['-p one', '-r one', '-p one:=[1,b]', '-p one:={a:1}', '--params-file /no/such.yaml'])
def test_arguments_of_no_use_are_refused_at_the_start(words: str) -> None:
    with pytest.raises(RCLError, match="failed to initialize rcl: Couldn't parse"):
        Context().init(['--ros-args', *words.split()])


# The end of a context


def test_after_the_shutdown_of_a_context_its_nodes_are_of_no_use(ros: Any) -> None:
    node = ros.node('ending', spins=False)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    publisher = node.create_publisher(String, ros.topic, 10)
    client = node.create_client(Trigger, ros.topic)
    node.context.shutdown()
    for name, call in {
        'publish': lambda: publisher.publish(String()),
        'publish bytes': lambda: publisher.publish(b''),
        'matches': publisher.get_subscription_count,
        'liveliness': publisher.assert_liveliness,
        'publisher': lambda: node.create_publisher(String, 'other', 10),
        'subscription': lambda: node.create_subscription(String, 'other', print, 10),
        'timer': lambda: node.create_timer(1.0, print),
        'client': lambda: node.create_client(Trigger, 'other'),
        'service': lambda: node.create_service(Trigger, 'other', print),
        'guard condition': lambda: node.create_guard_condition(print),
        'service is ready': client.service_is_ready,
        'wait for a service': lambda: client.wait_for_service(0.1),
        'nodes': node.get_node_names,
        'topics': node.get_topic_names_and_types,
        'endpoints': lambda: node.get_publishers_info_by_topic(ros.topic),
        'count': lambda: node.count_publishers(ros.topic),
        'parameter': lambda: node.declare_parameter('speed', 1.0),
        'spin': lambda: executor.spin_once(timeout_sec=0.1),
        'domain': node.context.get_domain_id,
        'end': node.context.shutdown,
    }.items():
        with pytest.raises(RuntimeError):  # RCLError, or on Kilted, which destroys the nodes, InvalidHandle
            call()
            pytest.fail(f'{name} does not fail')
    node.get_logger().info('can be logged')
    node.get_clock().now()


# Lifecycle nodes


class Managed(LifecycleNode):
    """A lifecycle node whose transitions end as it is told."""

    answer = TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        return self.answer

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.SUCCESS


def test_a_lifecycle_node_goes_its_way(ros: Any) -> None:
    node, asking = ros.node('managed', kind=Managed), ros.node('asking')
    change = asking.create_client(ChangeState, '/managed/change_state')
    get = asking.create_client(GetState, '/managed/get_state')
    available = asking.create_client(GetAvailableTransitions, '/managed/get_available_transitions')
    for one in (change, get, available):
        assert one.wait_for_service(60.0)

    def go(transition: int) -> bool:
        return bool(ros.result(change.call_async(ChangeState.Request(transition=Transition(id=transition)))).success)

    def state() -> int:
        return int(ros.result(get.call_async(GetState.Request())).current_state.id)

    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    node.answer = TransitionCallbackReturn.FAILURE
    assert not go(Transition.TRANSITION_CONFIGURE)
    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    node.answer = TransitionCallbackReturn.ERROR
    assert not go(Transition.TRANSITION_CONFIGURE)
    assert state() == State.PRIMARY_STATE_UNCONFIGURED, 'on_error has repaired it'
    node.answer = TransitionCallbackReturn.SUCCESS
    for transition, reached in (
        (Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE),
        (Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE),
        (Transition.TRANSITION_CLEANUP, State.PRIMARY_STATE_UNCONFIGURED),
    ):
        assert go(transition)
        assert state() == reached
    listed = ros.result(available.call_async(GetAvailableTransitions.Request())).available_transitions
    assert {one.transition.label for one in listed} == {'configure', 'shutdown'}
    assert go(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert state() == State.PRIMARY_STATE_FINALIZED


def test_a_lifecycle_node_tells_its_changes_and_refuses_an_unknown_label(ros: Any) -> None:
    name = f'managed_{ros.topic}'
    node, asking = ros.node(name, kind=Managed), ros.node('asking')
    told: list[TransitionEvent] = []
    asking.create_subscription(TransitionEvent, f'/{name}/transition_event', told.append, RELIABLE)
    change = asking.create_client(ChangeState, f'/{name}/change_state')
    graph = asking.create_client(GetAvailableTransitions, f'/{name}/get_transition_graph')
    assert change.wait_for_service(60.0) and graph.wait_for_service(60.0)
    ros.wait(lambda: asking.count_publishers(f'/{name}/transition_event'))

    def go(label: str) -> bool:
        return bool(ros.result(change.call_async(ChangeState.Request(transition=Transition(label=label)))).success)

    assert not go('no such label')
    assert go('configure')
    ros.wait(lambda: told and told[-1].goal_state.label == 'inactive')
    assert (told[-1].start_state.label, told[-1].transition, told[-1].timestamp) == ('configuring', Transition(), 0)
    everything = ros.result(graph.call_async(GetAvailableTransitions.Request())).available_transitions
    assert [one.transition.id for one in everything[:6]] == [1, 10, 11, 12, 2, 20]
    assert node.get_name() == name
