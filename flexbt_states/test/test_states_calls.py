# SPDX-License-Identifier: BSD-3-Clause
"""The states that reach any action, service and topic: what they send, what they keep, how they are left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import Spin
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry
from flexbt_states import (
    CallActionState,
    CallServiceState,
    CheckTopicState,
    PublishState,
    ReadTopicState,
    topic_states,
)
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.state_machines.bench import Bench, machine
from flexbt_testing.waiting import wait_until

SPIN = 'nav2_msgs/action/Spin'


@pytest.fixture
def peer() -> Iterator[NodeRuntime]:
    """Run another node."""
    with NodeRuntime.open('peer') as runtime:
        yield runtime


def place(x: float) -> PoseStamped:
    pose = PoseStamped()
    pose.pose.position.x = x
    return pose


# -- actions ---------------------------------------------------------------------------------------------------------


def test_a_goal_is_made_of_values_keys_and_expressions(bench: StateBench) -> None:
    server = bench.serve(Spin, 'spin', ends(Spin.Result(error_code=0)))
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: CallActionState(
            SPIN,
            'spin',
            goal={'target_yaw': '${turns * 6.28 + place.pose.position.x}', 'time_allowance.sec': '{patience}'},
            result={'error_code': 'code'},
        ),
        {'turns': 2, 'patience': 7, 'place': place(1.0), 'code': None},
        outputs=['code'],
        read=read,
    )
    assert run.wait() == 'done', run.errors()
    (goal,) = server.goals
    assert (round(goal.target_yaw, 3), goal.time_allowance.sec) == (13.56, 7)
    assert read == {'code': 0}


@pytest.mark.parametrize(('code', 'outcome'), [(0, 'turned'), (701, 'blocked'), (5, 'failed')])
def test_the_first_true_condition_is_the_outcome(bench: StateBench, code: int, outcome: str) -> None:
    bench.serve(Spin, 'spin', ends(Spin.Result(error_code=code)))
    run = bench.run_state(
        lambda: CallActionState(
            SPIN,
            'spin',
            outcomes={'turned': 'result.error_code == 0', 'blocked': 'result.error_code > limit'},
        ),
        {'limit': 700},
    )
    assert run.wait() == outcome
    assert ('no condition of result is true' in run.errors()) is (outcome == 'failed')


def test_if_no_condition_is_true_the_values_of_the_userdata_that_they_read_are_told(bench: StateBench) -> None:
    bench.serve(Spin, 'spin', ends(Spin.Result(error_code=5)))
    run = bench.run_state(
        lambda: CallActionState(
            SPIN,
            'spin',
            result={'error_code': 'limit'},
            outcomes={'done': 'result.error_code > limit && place.pose.position.x > 1'},
        ),
        {'limit': 700, 'place': place(1.0)},
        outputs=['limit'],
    )
    assert run.wait() == 'failed'
    for told in ('limit = 700', 'result.error_code = 5', 'place.pose.position.x = 1.0'):
        assert told in run.errors()
    assert 'raised' not in run.errors()


def test_a_goal_that_fails_and_one_that_cannot_be_made(bench: StateBench) -> None:
    bench.serve(Spin, 'spin', ends(Spin.Result(error_msg='too narrow'), 'abort'))
    run = bench.run_state(lambda: CallActionState(SPIN, 'spin'))
    assert run.wait() == 'failed'
    assert 'goal of spin: too narrow' in run.errors()
    run = bench.run_state(lambda: CallActionState(SPIN, 'spin', goal={'target_yaw': '{angle}'}), {'angle': 'left'})
    assert run.wait() == 'failed'
    assert "goal of spin: [target_yaw]: expected a number, got 'left'" in run.errors()


# -- services --------------------------------------------------------------------------------------------------------


def test_a_service_is_called(bench: StateBench, peer: NodeRuntime) -> None:
    def answer(request: Any, response: Any) -> Any:
        response.success, response.message = request.data, f'it is {request.data}'
        return response

    peer.call(lambda: peer.node.create_service(SetBool, 'lamp', answer))
    for value, outcome in ((True, 'on'), (False, 'failed')):
        read: dict[str, Any] = {}
        run = bench.run_state(
            lambda: CallServiceState(
                'std_srvs/srv/SetBool',
                'lamp',
                request={'data': '{wanted}'},
                response={'message': 'said'},
                outcomes={'on': 'response.success'},
            ),
            {'wanted': value, 'said': ''},
            outputs=['said'],
            read=read,
        )
        assert run.wait() == outcome, run.errors()
        assert read == {'said': f'it is {value}'}


def test_a_service_that_is_not_there(bench: StateBench) -> None:
    run = bench.run_state(lambda: CallServiceState('std_srvs/srv/SetBool', 'nobody', timeout=0.1))
    assert run.wait() == 'failed'
    assert 'service nobody: ' in run.errors()


# -- topics ----------------------------------------------------------------------------------------------------------


def test_a_message_is_published(bench: StateBench, peer: NodeRuntime) -> None:
    heard: list[Any] = []
    subscription = (PoseStamped, 'target', heard.append, names.transient_local_qos())
    peer.call(lambda: peer.node.create_subscription(*subscription))
    end = peer.call(lambda: peer.node.create_publisher(String, 'end', names.transient_local_qos()))

    def machine() -> OperatableStateMachine:
        root = OperatableStateMachine(outcomes=['received', 'failed'])
        root.userdata['at'] = place(4.0).pose
        fields = {'header.frame_id': 'map', 'pose': '{at}', 'pose.position.y': '${2 + 1}'}
        with root:
            publish = PublishState('target', 'geometry_msgs/msg/PoseStamped', fields, latched=True)
            OperatableStateMachine.add('Publish', publish, {'done': 'End', 'failed': 'failed'})
            wait = ReadTopicState('end', 'std_msgs/msg/String', latched=True)  # the publisher lives as long as the run
            OperatableStateMachine.add('End', wait, {'received': 'received', 'timeout': 'failed'})
        return root

    run = bench.run(machine)
    wait_until(lambda: heard, 'the message')
    end.publish(String())
    assert run.wait() == 'received', run.errors()
    position = heard[0].pose.position
    assert (heard[0].header.frame_id, position.x, position.y) == ('map', 4.0, 3.0)


def test_a_message_is_awaited_of_which_a_condition_is_true(bench: StateBench, peer: NodeRuntime) -> None:
    publisher = peer.call(lambda: peer.node.create_publisher(BatteryState, 'battery', 10))
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: ReadTopicState(
            'battery',
            'sensor_msgs/msg/BatteryState',
            message={'percentage': 'charge'},
            outcomes={'low': 'message.percentage < least', 'full': 'message.percentage > 0.9'},
        ),
        {'least': 0.2, 'charge': 0.0},
        outputs=['charge'],
        read=read,
    )
    wait_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(BatteryState(percentage=0.5))
    publisher.publish(BatteryState(percentage=1.0))
    assert run.wait() == 'full'
    assert read == {'charge': 1.0}


def test_a_topic_decides_by_its_newest_message(bench: StateBench, peer: NodeRuntime) -> None:
    publisher = peer.call(lambda: peer.node.create_publisher(String, 'mode', 10))
    run = bench.run_state(
        lambda: CheckTopicState('mode', 'std_msgs/msg/String', {'manual': "message.data == 'manual'", 'other': ''})
    )
    wait_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(String(data='auto'))
    assert run.wait() == 'other'


def test_a_topic_without_messages_times_out(bench: StateBench) -> None:
    run = bench.run_state(lambda: CheckTopicState('silent', 'std_msgs/msg/String', {'any': ''}, timeout=0.05))
    assert run.wait() == 'timeout'
    assert run.errors() == 'no message on silent within 0.05 s'


class Topic:
    """The topic of a state, without a middleware, and the steady clock of its node."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.steady = ManualClock()
        self._receivers: list[Callable[[Any], None]] = []
        node = SimpleNamespace(
            create_subscription=lambda type, topic, receive, qos: self._receivers.append(receive),
            destroy_subscription=lambda subscription: None,
        )
        runtime = SimpleNamespace(node=node, post=lambda fn: fn(), steady=self.steady)
        monkeypatch.setattr(topic_states, 'state_services', lambda state: SimpleNamespace(runtime=runtime))

    def receive(self, message: Any) -> None:
        self._receivers[-1](message)

    def send(self, bench: Bench, message: Any) -> None:
        self.receive(message)
        bench.settle()


def test_conditions_compare_a_message_with_the_one_that_was_kept_last(monkeypatch: pytest.MonkeyPatch) -> None:
    topic = Topic(monkeypatch)
    conditions = {'less': 'message.percentage < charge'}
    state: Any = ReadTopicState('cells', BatteryState, {'percentage': 'charge'}, conditions)
    again = {'less': 'Again', 'timeout': 'ended'}
    bench = Bench(machine(Child('Again', state, again), output_keys=['charge']), userdata={'charge': 0.5})
    for percentage in (0.75, 0.625, 0.25, 0.375, 0.125):  # those that meet no condition are not kept
        topic.send(bench, BatteryState(percentage=percentage))
    assert len(bench.transitions) == 2
    assert bench.run.userdata()['charge'] == 0.125


@pytest.mark.parametrize(('kind', 'ends_by'), [(ReadTopicState, 'pressed'), (CheckTopicState, None)])
def test_of_messages_that_come_at_once_each_is_read_or_only_the_newest_checked(
    kind: type[EventState], ends_by: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    topic, made = Topic(monkeypatch), cast('Any', kind)
    state = made('button', 'std_msgs/msg/String', outcomes={'pressed': "message.data == 'down'"})
    bench = Bench(machine(Child('Button', state, {'pressed': 'ended', 'timeout': 'ended'})))
    for data in ('up', 'down', 'up'):
        topic.receive(String(data=data))
    bench.settle()
    assert [one[1] for one in bench.transitions] == ([] if ends_by is None else [ends_by])


@pytest.mark.parametrize('kind', [ReadTopicState, CheckTopicState])
def test_messages_that_meet_no_condition_are_not_told_as_missing(
    kind: type[EventState], monkeypatch: pytest.MonkeyPatch
) -> None:
    topic, made = Topic(monkeypatch), cast('Any', kind)
    state = made('mode', 'std_msgs/msg/String', outcomes={'manual': "message.data == 'manual'"}, timeout=3.0)
    bench = Bench(machine(Child('Mode', state, {'manual': 'ended', 'timeout': 'ended'})))
    topic.send(bench, String(data='auto'))
    topic.steady.advance(3.0)
    bench.settle()
    assert bench.transitions[-1][:2] == ('/Mode', 'timeout')
    assert [text for _, _, text in bench.lines] == ['no condition was true for a message on mode within 3 s']


@pytest.mark.parametrize('kind', [ReadTopicState, CheckTopicState])
def test_messages_of_which_a_condition_cannot_be_evaluated_are_told_once(
    kind: type[EventState], monkeypatch: pytest.MonkeyPatch
) -> None:
    topic, made = Topic(monkeypatch), cast('Any', kind)
    state = made('joints', JointState, outcomes={'up': 'message.position.0 > 1'})
    bench = Bench(machine(Child('Joints', state, {'up': 'ended', 'timeout': 'ended'})))
    for message in (*(JointState() for _ in range(5)), JointState(position=[0.0]), JointState()):
        topic.send(bench, message)
    assert len(bench.lines) == 1
    topic.send(bench, JointState(position=[2.0]))
    assert bench.transitions[-1][:2] == ('/Joints', 'up')


# -- what is refused while the behavior is built ---------------------------------------------------------------------


@pytest.mark.parametrize(('make', 'reason'), [
    (lambda: CallActionState('nav2_msgs/Spn', 'spin'), "action_type: type 'nav2_msgs/Spn': package 'nav2_msgs' has no"),
    (lambda: CallActionState(SPIN, 'spin', goal={'target_yw': 1}), "did you mean 'target_yaw'?"),
    (lambda: CallActionState(SPIN, 'spin', goal={'target_yaw': 'left'}), "expected a number, got 'left'"),
    (lambda: CallActionState(SPIN, 'spin', goal={'target_yaw': '${1 +}'}), "goal['target_yaw']"),
    (lambda: CallActionState(SPIN, 'spin', result={'error_code': ''}), "'' is not a userdata key"),
    (lambda: CallActionState(SPIN, 'spin', outcomes={'a': 'result.cod == 1'}), "has no field 'cod'"),
    (lambda: CallServiceState('std_srvs/SetBool', 'x', outcomes={'a': 'response.success =='}), "outcomes['a']"),
    (lambda: CallServiceState('std_srvs/SetBool', 'x', outcomes={'a': 'response.success = 1'}), 'write == to compare'),
    (lambda: PublishState('x', 'std_msgs/msg/String', {'data': 5}), 'expected a string, got 5'),
    (lambda: PublishState('x', 'std_msgs/msg/String', {5: 'x'}), 'message: 5 is not text'),  # type: ignore[dict-item]
    (lambda: ReadTopicState('x', 'std_msgs/msg/String', {5: 'x'}), 'message: 5 is not text'),  # type: ignore[dict-item]
    (
        lambda: ReadTopicState('x', 'std_msgs/msg/String', outcomes={'any': True}),  # type: ignore[dict-item]
        "outcomes['any']: True is not text; in YAML, quote it",
    ),
])  # fmt: skip
def test_mistakes_are_found_when_the_state_is_made(make: Any, reason: str) -> None:
    with pytest.raises(StateParameterError) as raised:
        make()
    assert reason in str(raised.value)


def test_a_machine_of_yaml_has_such_states(bench: StateBench) -> None:
    server = bench.serve(Spin, 'spin', ends(Spin.Result()))
    text = """
        machine:
          outcomes: [finished, failed]
          states:
            Turn:
              state: CallActionState
              parameters:
                action_type: nav2_msgs/action/Spin
                topic: spin
                goal: {target_yaw: 1.57}
                outcomes: {turned: result.error_code == 0}
              transitions: {turned: finished, canceled: failed, failed: failed}
    """

    class Turn(Behavior):
        manifest = BehaviorManifest('Turn')

        def create(self) -> Any:
            return read_machine(text, {'CallActionState': CallActionState}, 'turn.yaml')

    run = bench.run_behavior(BehaviorEntry('Turn', 'test', Turn.manifest, (), Turn))
    assert run.wait() == 'finished', run.errors()
    assert round(server.goals[0].target_yaw, 2) == 1.57
