# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's generic states: their outcomes, what they read and write, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Bool, Empty, Int64, String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_common.values.value_types import resolve_type
from flexbt_core.state_machine.engine.operator_commands import pause, resume
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_flexbe import EventState as FlexbeState
from flexbt_flexbe import Logger, OperatableStateMachine, ProxySubscriberCached, states
from flexbt_flexbe.api.topic_proxies import QOS_LATCH
from flexbt_flexbe.states import (
    BtGetDataState,
    BtSetDataState,
    CalculationState,
    CheckConditionState,
    DecisionState,
    FlexibleCalculationState,
    FlexibleCheckConditionState,
    InputState,
    LogKeyState,
    LogState,
    OperatorDecisionState,
    PublisherBoolState,
    PublisherEmptyState,
    PublisherStringState,
    SelectionState,
    SubscriberState,
    UserdataState,
    WaitForServersState,
    WaitState,
)
from flexbt_flexbe.states.bt_states import full_type
from flexbt_msgs.action import OperatorInput
from flexbt_onboard.behaviors.run_context import building
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import wait_until

Result = OperatorInput.Result


def outcome_of(
    bench: StateBench, make: Callable[[], EventState], *, read: dict[str, Any] | None = None, **userdata: Any
) -> tuple[str, Any]:
    """Outcome of a state, and what it wrote to its output key."""
    got: dict[str, Any] = {} if read is None else read
    (output,) = bench_outputs(bench, make) or (None,)
    if output is not None:
        userdata.setdefault(output, 'nothing')
    run = bench.run_state(make, userdata, outputs=[output] if output else [], read=got)
    return run.wait(), got.get(output) if output else None


def bench_outputs(bench: StateBench, make: Callable[[], EventState]) -> tuple[str, ...]:
    """Return the output keys of a state, which has to be made in a run."""
    found: list[tuple[str, ...]] = []

    def probe() -> EventState:
        found.append(make().output_keys)
        return WaitState(0.0)

    assert bench.run_state(probe).wait() == 'done'
    return found[0]


class TestComputing:
    def test_calculation(self, bench: StateBench) -> None:
        assert outcome_of(bench, lambda: CalculationState(lambda x: x + 1), input_value=2) == ('done', 3)
        assert outcome_of(bench, lambda: CalculationState(lambda x: None), input_value=2) == ('done', None)

    @pytest.mark.parametrize(
        'calculation',
        [
            lambda a, b: a - b,
            lambda **values: values['a'] - values['b'],
            lambda values: values[0] - values[1],
        ],
    )
    def test_flexible_calculation_takes_keywords_or_a_list(
        self, bench: StateBench, calculation: Callable[..., Any]
    ) -> None:
        assert outcome_of(bench, lambda: FlexibleCalculationState(calculation, ['a', 'b']), a=3, b=4) == ('done', -1)

    def test_differs_a_value_is_computed_once_also_while_the_operator_is_asked(self, bench: StateBench) -> None:
        """FlexBE computes it again in each tick."""
        seen: list[int] = []
        make = lambda: FlexibleCalculationState(lambda n: seen.append(n) or n + 1, ['n'])  # type: ignore[func-returns-value]  # noqa: E731
        run = bench.run_state(make, {'n': 1, 'output_value': 0}, required=3)
        (asked,) = wait_until(run.decisions, 'decision')
        assert (run.answer_to(pause), run.answer_to(resume), run.confirm(asked.id)) == (None, None, None)
        assert (run.wait(), seen) == ('done', [1])

    def test_flexible_calculation_takes_builtins(self, bench: StateBench) -> None:
        assert outcome_of(bench, lambda: FlexibleCalculationState(max, ['a', 'b']), a=3, b=4) == ('done', 4)

    @pytest.mark.parametrize(
        'predicate',
        [lambda values: values[0] > values[1], lambda a, b: a > b, lambda **values: values['a'] > values['b']],
    )
    def test_flexible_check_condition_takes_a_list_or_keywords(
        self, bench: StateBench, predicate: Callable[..., Any]
    ) -> None:
        for b, expected in ((3, 'true'), (5, 'false')):
            made = lambda: FlexibleCheckConditionState(predicate, ['a', 'b'])  # noqa: E731
            assert bench.run_state(made, {'a': 4, 'b': b}).wait() == expected

    def test_one_key_is_a_keyword_to_a_calculation_and_in_a_list_to_a_condition(self, bench: StateBench) -> None:
        """As in FlexBE 2.3.3."""
        assert outcome_of(bench, lambda: FlexibleCalculationState(lambda a: a, ['a']), a=3) == ('done', 3)
        state = lambda: FlexibleCheckConditionState(lambda a: a == [3], ['a'])  # noqa: E731
        assert bench.run_state(state, {'a': 3}).wait() == 'true'

    @pytest.mark.parametrize(('value', 'expected'), [(-4, 'negative'), (4, 'positive')])
    def test_decision(self, bench: StateBench, value: int, expected: str) -> None:
        def make() -> EventState:
            return DecisionState(['negative', 'positive'], lambda x: 'negative' if x < 0 else 'positive')

        assert bench.run_state(make, {'input_value': value}).wait() == expected

    def test_decision_is_asked_again_while_it_gives_none(self, bench: StateBench) -> None:
        asked: list[int] = []

        def conditions(value: int) -> str | None:
            asked.append(value)
            return 'done' if len(asked) == 3 else None

        assert bench.run_state(lambda: DecisionState(['done'], conditions), {'input_value': 1}).wait() == 'done'

    def test_differs_a_decision_for_an_unknown_outcome_is_a_fault(self, bench: StateBench) -> None:
        """FlexBE waits for ever."""
        run = bench.run_state(lambda: DecisionState(['yes'], lambda _: 'yess'), {'input_value': 1})
        assert run.wait() == 'error'
        assert "'yess', which is none of its outcomes yes" in run.errors()

    @pytest.mark.parametrize(
        'make',
        [
            lambda: CalculationState(lambda x: 1 / x),
            lambda: CheckConditionState(lambda x: 1 / x),
            lambda: FlexibleCalculationState(lambda input_value: 1 / input_value, ['input_value']),
            lambda: FlexibleCheckConditionState(lambda values: 1 / values[0], ['input_value']),
            lambda: DecisionState(['a'], lambda x: 1 / x),
        ],
    )
    def test_differs_an_exception_is_a_fault_and_not_an_old_answer(
        self, bench: StateBench, make: Callable[[], EventState]
    ) -> None:
        """FlexBE gives the previous result again, or 'false'."""
        run = bench.run_state(make, {'input_value': 0, 'output_value': 7})
        assert run.wait() == 'error'
        assert 'ZeroDivisionError' in run.errors()

    @pytest.mark.parametrize(
        'make',
        [
            lambda: CheckConditionState('lambda x: x > 1'),  # type: ignore[arg-type]
            lambda: FlexibleCheckConditionState('lambda x: x[0] > 1', ['a']),  # type: ignore[arg-type]
            lambda: CalculationState(None),  # type: ignore[arg-type]
            lambda: FlexibleCalculationState(lambda x, y, z: 0, ['x', 'y']),
            lambda: FlexibleCheckConditionState(lambda x, y, z: 0, ['x', 'y']),
            lambda: DecisionState([], lambda _: None),
            lambda: DecisionState(['a'], None),  # type: ignore[arg-type]
        ],
    )
    def test_differs_what_cannot_be_called_is_refused_and_texts_are_not_evaluated(
        self, bench: StateBench, make: Callable[[], EventState]
    ) -> None:
        refused: list[str] = []

        def probe() -> EventState:
            with pytest.raises(StateParameterError) as caught:
                make()
            refused.append(str(caught.value))
            return WaitState(0.0)

        assert bench.run_state(probe).wait() == 'done'
        assert refused


class TestTelling:
    @pytest.mark.parametrize(
        ('constant', 'severity'),
        [
            (Logger.REPORT_DEBUG, Severity.DEBUG),
            (Logger.REPORT_INFO, Severity.INFO),
            (Logger.REPORT_HINT, Severity.HINT),
            (Logger.REPORT_WARN, Severity.WARN),
            (Logger.REPORT_ERROR, Severity.ERROR),
        ],
    )
    def test_log_at_each_severity(self, bench: StateBench, constant: int, severity: Severity) -> None:
        run = bench.run_state(lambda: LogState('100 %s {}', constant))
        assert run.wait() == 'done'
        assert run.lines == [(severity.value, '/State', '100 %s {}')]

    def test_what_is_logged_need_not_be_text(self, bench: StateBench) -> None:
        run = bench.run_state(lambda: LogState(text=42))
        assert run.wait() == 'done'
        assert run.lines == [(Severity.HINT.value, '/State', '42')]

    def test_log_key(self, bench: StateBench) -> None:
        run = bench.run_state(lambda: LogKeyState('at {} %', Logger.REPORT_INFO), {'data': 7})
        assert run.wait() == 'done'
        assert run.lines == [(Severity.INFO.value, '/State', 'at 7 %')]

    def test_user_data(self, bench: StateBench) -> None:
        assert outcome_of(bench, lambda: UserdataState({'a': [1]})) == ('done', {'a': [1]})

    def test_what_others_do_with_the_data_is_not_in_what_is_written_the_next_time(self, bench: StateBench) -> None:
        seen: list[Any] = []

        class Filling(FlexbeState):
            def execute(self, userdata: Any) -> str:
                userdata.data.append(1)
                seen.append(list(userdata.data))
                return 'done' if len(seen) == 2 else 'again'

        def machine() -> OperatableStateMachine:
            made = OperatableStateMachine(outcomes=['finished'])
            with made:
                OperatableStateMachine.add('Begin', UserdataState([]), {'done': 'Fill'})
                fill = Filling(outcomes=['again', 'done'], io_keys=['data'])
                OperatableStateMachine.add('Fill', fill, {'again': 'Begin', 'done': 'finished'})
            return made

        assert bench.run(machine).wait() == 'finished'
        assert seen == [[1], [1]]

    def test_wait_takes_its_time(self, bench: StateBench) -> None:
        begin = bench.runtime.clock.now()
        assert bench.run_state(lambda: WaitState(wait_time=0.2)).wait() == 'done'
        assert bench.run_state(lambda: WaitForServersState(['nobody'], timeout=0.1)).wait() == 'timeout'
        assert 0.2 <= bench.runtime.clock.now() - begin < 2

    def test_the_operator_is_asked_for_a_decision_and_a_suggestion_is_taken(self, bench: StateBench) -> None:
        run = bench.run_state(lambda: OperatorDecisionState(['left', 'right'], hint='where?'))
        (asked,) = wait_until(run.decisions, 'decision')
        assert (asked.prompt, list(asked.outcomes)) == ('where?', ['left', 'right'])
        run.force('/State', 'right', asked.id)
        assert run.wait() == 'right'
        suggesting = bench.run_state(lambda: OperatorDecisionState(['left', 'right'], suggestion='left'))
        assert suggesting.wait() == 'left'


class TestTopics:
    @pytest.mark.parametrize(
        ('make', 'message_type', 'value', 'expected'),
        [
            (PublisherBoolState, Bool, True, Bool(data=True)),
            (PublisherStringState, String, 'text', String(data='text')),
            (PublisherStringState, String, 7, String(data='7')),
            (PublisherEmptyState, Empty, None, Empty()),
        ],
    )
    def test_publishers(
        self, bench: StateBench, make: Callable[[str], EventState], message_type: Any, value: Any, expected: Any
    ) -> None:
        got: list[Any] = []
        node = bench.runtime.node
        bench.runtime.call(lambda: node.create_subscription(message_type, 'out', got.append, 10))
        userdata = {} if message_type is Empty else {'value': value}

        def once() -> EventState:
            state = make('out')
            wait_until(lambda: state._publisher.number_of_subscribers('out') > 0, 'matched')  # type: ignore[attr-defined]
            return state

        assert bench.run_state(once, userdata).wait() == 'done'
        wait_until(lambda: got, 'the message')
        assert got == [expected]

    @pytest.mark.parametrize('value', [1, 'true', None])
    def test_what_is_no_bool_is_not_published_as_one(self, bench: StateBench, value: Any) -> None:
        run = bench.run_state(lambda: PublisherBoolState('out'), {'value': value})
        run.wait()
        assert 'bool' in run.errors()

    @pytest.mark.parametrize('msg_type', [Int64, 'std_msgs/msg/Int64', 'std_msgs/Int64', ''])
    def test_subscriber_takes_the_newest_message(self, bench: StateBench, msg_type: Any) -> None:
        node = bench.runtime.node
        publisher = bench.runtime.call(lambda: node.create_publisher(Int64, 'in', 10))
        read: dict[str, Any] = {}
        run = bench.run_state(
            lambda: SubscriberState('in', msg_type), {'message': None}, outputs=['message'], read=read
        )
        wait_until(lambda: publisher.get_subscription_count() == 1, 'matched')
        publisher.publish(Int64(data=5))
        assert run.wait() == 'received'
        assert read['message'].data == 5

    @pytest.mark.parametrize('blocking', [True, False])
    def test_differs_what_was_received_stays_while_the_operator_is_asked(
        self, bench: StateBench, blocking: bool
    ) -> None:
        """FlexBE executes the state again, which then waits for the next message."""
        node = bench.runtime.node
        publisher = bench.runtime.call(lambda: node.create_publisher(Int64, 'once', QOS_LATCH))
        publisher.publish(Int64(data=5))
        read: dict[str, Any] = {}

        def make() -> SubscriberState:
            state = SubscriberState('once', Int64, blocking=blocking, qos=QOS_LATCH)
            wait_until(lambda: state._subscriber.has_msg('once'), 'the message')
            return state

        run = bench.run_state(make, {'message': None}, outputs=['message'], read=read, required=3)
        (asked,) = wait_until(run.decisions, 'decision')
        assert (run.answer_to(pause), run.answer_to(resume), run.confirm(asked.id)) == (None, None, None)
        assert (run.wait(), read['message'].data) == ('received', 5)

    @pytest.mark.parametrize('make', [lambda: SubscriberState('seen', String), lambda: Hearing('seen')])
    def test_a_sensor_that_it_cannot_hear_is_shown_with_what_to_do(
        self, bench: StateBench, make: Callable[[], EventState]
    ) -> None:
        with NodeRuntime.open('camera') as camera:
            camera.call(lambda: camera.node.create_publisher(String, 'seen', qos_profile_sensor_data))
            run = bench.run_state(make, {'message': None})
            shown = (
                "No messages on '/seen' from /camera: it publishes BEST_EFFORT, /bench_executive subscribes RELIABLE. "
                'Subscribe with BEST_EFFORT, or publish with RELIABLE.'
            )
            wait_until(lambda: [one.activity for one in run.active()] == [(shown,)], lambda: str(run.active()))
        wait_until(lambda: [one.activity for one in run.active()] == [()], 'the end of the sensor')

    @pytest.mark.parametrize('blocking', [True, False])
    def test_a_topic_that_nobody_knows_is_unavailable(self, bench: StateBench, blocking: bool) -> None:
        assert outcome_of(bench, lambda: SubscriberState('unknown', '', blocking=blocking))[0] == 'unavailable'

    def test_differs_without_a_message_it_is_not_received(self, bench: StateBench) -> None:
        """FlexBE leaves by 'received', with None as the message, when it does not wait."""
        read: dict[str, Any] = {}
        make = lambda: SubscriberState('silent', String, blocking=False)  # noqa: E731
        assert outcome_of(bench, make, read=read)[0] == 'unavailable'

    def test_an_old_message_can_be_dropped_on_entering(self, bench: StateBench) -> None:
        node = bench.runtime.node
        publisher = bench.runtime.call(lambda: node.create_publisher(Int64, 'old', 10))
        made: list[SubscriberState] = []

        def make() -> EventState:
            state = SubscriberState('old', Int64, blocking=False, clear=True)
            wait_until(lambda: publisher.get_subscription_count() == 1, 'matched')
            publisher.publish(Int64(data=1))
            wait_until(lambda: state._subscriber.has_msg('old'), 'the message')
            made.append(state)
            return state

        assert bench.run_state(make, {'message': None}).wait() == 'unavailable'
        assert made


class Hearing(FlexbeState):
    """A state of users that waits for a message."""

    def __init__(self, topic: str) -> None:
        super().__init__(outcomes=['received'])
        self._topic = topic
        self._heard = ProxySubscriberCached({topic: String})

    def execute(self, userdata: Any) -> str | None:
        return 'received' if self._heard.has_msg(self._topic) else None


def answering(type_name: str, value: Any) -> Any:
    """Return an operator who gives a value."""
    return ends(Result(code=Result.SUCCESS, operator_id='me', value=to_entry('', value, type_name)))


class TestAsking:
    @pytest.mark.parametrize(
        ('request_type', 'type_name', 'value'),
        [
            (0, 'int64', 4),
            (1, 'float64', 0.5),
            (2, 'float64[]', [1.0, 2.0]),
            (3, 'float64[]', [1.0, 2.0, 3.0]),
            (4, 'float64[]', [1.0, 2.0, 3.0, 4.0]),
            (11, 'geometry_msgs/msg/PoseStamped', PoseStamped()),
            (12, 'string', 'a word'),
        ],
    )
    def test_input_of_each_type(self, bench: StateBench, request_type: int, type_name: str, value: Any) -> None:
        server = bench.serve(OperatorInput, names.OPERATOR_INPUT, answering(type_name, value))
        assert outcome_of(bench, lambda: InputState(request_type, 'which?', timeout=1.0)) == ('received', value)
        assert (server.goals[-1].prompt, server.goals[-1].type) == ('which?', resolve_type(type_name).name)

    def test_input_of_a_wrong_length_is_a_data_error(self, bench: StateBench) -> None:
        bench.serve(OperatorInput, names.OPERATOR_INPUT, answering('float64[]', [1.0]))
        run = bench.run_state(lambda: InputState(2, 'where?'))
        assert run.wait() == 'data_error'
        assert '2 numbers are needed, not 1' in run.errors()

    def test_input_of_a_wrong_type_is_a_data_error(self, bench: StateBench) -> None:
        bench.serve(OperatorInput, names.OPERATOR_INPUT, answering('string', 'x'))
        assert bench.run_state(lambda: InputState(0, 'how many?')).wait() == 'data_error'

    def test_an_operator_who_declines_aborts(self, bench: StateBench) -> None:
        bench.serve(OperatorInput, names.OPERATOR_INPUT, ends(Result(code=Result.DECLINED, message='no'), 'abort'))
        assert outcome_of(bench, lambda: InputState(0, 'how many?')) == ('aborted', None)

    def test_nobody_to_ask_is_no_connection_each_time_anew(self, bench: StateBench) -> None:
        """In FlexBE a state that had no connection once never has one again."""
        assert bench.run_state(lambda: InputState(0, 'how many?')).wait() == 'no_connection'
        bench.serve(OperatorInput, names.OPERATOR_INPUT, answering('int64', 4))
        assert bench.run_state(lambda: InputState(0, 'how many?')).wait() == 'received'

    def test_differs_the_question_is_withdrawn_when_the_state_is_left(self, bench: StateBench) -> None:
        async def never(goal_handle: Any) -> Any:
            await withdrawn
            goal_handle.canceled()
            return Result(code=Result.CANCELED)

        def on_cancel(_: Any) -> Any:
            from rclpy.action import CancelResponse

            server.resolve(withdrawn)
            return CancelResponse.ACCEPT

        server = bench.serve(OperatorInput, names.OPERATOR_INPUT, lambda handle: never(handle), on_cancel=on_cancel)
        withdrawn = server.future()
        run = bench.run_state(lambda: InputState(0, 'how many?'))
        wait_until(lambda: server.running, 'the decision')
        assert run.stop() == 'preempted'
        assert (len(server.running), server.cancels) == (0, 1)

    def test_selection(self, bench: StateBench) -> None:
        server = bench.serve(OperatorInput, names.OPERATOR_INPUT, answering('string', '2'))
        assert outcome_of(bench, lambda: SelectionState('which?'), items=[1, 2]) == ('received', '2')
        assert list(server.goals[-1].choices) == ['1', '2']
        assert bench.run_state(lambda: SelectionState('which?'), {'items': []}).wait() == 'data_error'

    def test_unknown_requests_are_refused(self) -> None:
        with pytest.raises(StateParameterError, match='99'):
            InputState(99, 'what?')


def test_each_state_tells_what_it_declares() -> None:
    """The docstring is what FlexBE's editor reads: parameters, keys and outcomes."""
    for name in states.__all__:
        text = getattr(states, name).__doc__
        assert text and '<= ' in text, name


@pytest.mark.parametrize(
    ('short', 'full'),
    [
        ('PoseStamped', 'geometry_msgs/msg/PoseStamped'),
        ('pose_stamped', 'geometry_msgs/msg/PoseStamped'),
        ('posestamped[]', 'geometry_msgs/msg/PoseStamped[]'),
        ('Path', 'nav_msgs/msg/Path'),
        ('char', 'string'),
        ('double[]', 'double[]'),
        ('std_msgs/msg/Int64', 'std_msgs/msg/Int64'),
        ('', ''),
    ],
)
def test_short_names_of_types_are_those_of_the_states_for_trees(short: str, full: str) -> None:
    assert full_type(short) == full


def test_states_for_trees_take_short_names_of_types() -> None:
    with building():
        read = BtGetDataState(request_id='path', request_msg_type='Path', outputs={'n': 'int64'})
        write = BtSetDataState(goal_id='goals', goal_msg_type='pose_stamped[]')
        packaged = BtGetDataState(request_id='path', request_msg_type='Path', request_msg_pkg='nav_msgs')
    assert read.bt_use.reads == {'path': 'nav_msgs/msg/Path', 'n': 'int64'}
    assert write.bt_use.writes == {'goals': 'geometry_msgs/msg/PoseStamped[]'}
    assert packaged.bt_use.reads == {'path': 'nav_msgs/msg/Path'}
