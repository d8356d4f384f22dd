# SPDX-License-Identifier: BSD-3-Clause
"""The states that need nothing but the machine."""

from __future__ import annotations

import contextlib
import inspect
import threading
from collections.abc import Mapping
from typing import Any

import pytest

import flexbt_states
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy, DecisionKind
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.state_machine.model.userdata import StateError
from flexbt_states import CalculationState, CheckConditionState, LogKeyState, LogState, OperatorDecisionState, WaitState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import DEADLINE, wait_until


def test_wait_waits_for_its_time_on_the_clock_of_the_node(bench: StateBench) -> None:
    clock = bench.runtime.clock
    begin = clock.now()
    assert bench.run_state(lambda: WaitState(0.2)).wait() == 'done'
    assert clock.now() - begin >= 0.2


def test_wait_can_be_stopped_at_any_moment(bench: StateBench) -> None:
    run = bench.run_state(lambda: WaitState(3600))
    wait_until(run.active, 'active')
    assert run.stop() == 'preempted'


@pytest.mark.parametrize('severity', list(Severity))
def test_log_tells_the_operator_at_its_severity(bench: StateBench, severity: Severity) -> None:
    run = bench.run_state(lambda: LogState('hello', severity))
    assert run.wait() == 'done'
    assert run.lines == [(severity.value, '/State', 'hello')]


def test_log_key_tells_the_value(bench: StateBench) -> None:
    run = bench.run_state(lambda: LogKeyState('speed {:.1f} m/s', Severity.HINT), {'data': 0.25})
    assert run.wait() == 'done'
    assert run.lines == [(Severity.HINT.value, '/State', 'speed 0.2 m/s')]


def test_calculation_computes(bench: StateBench) -> None:
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: CalculationState(sum),
        {'input_value': [1, 2], 'output_value': None},
        outputs=['output_value'],
        read=read,
    )
    assert run.wait() == 'done'
    assert read == {'output_value': 3}


@pytest.mark.parametrize(('value', 'outcome'), [(3, 'true'), (-3, 'false')])
def test_check_condition_branches(bench: StateBench, value: int, outcome: str) -> None:
    assert bench.run_state(lambda: CheckConditionState(lambda x: x > 0), {'input_value': value}).wait() == outcome


@pytest.mark.parametrize(
    'make', [lambda: CalculationState(lambda x: 1 / x), lambda: CheckConditionState(lambda x: 1 / x)]
)
def test_an_exception_is_neither_a_result_nor_an_answer(bench: StateBench, make: Any) -> None:
    run = bench.run_state(make, {'input_value': 0, 'output_value': 5})
    assert run.wait() == 'error'
    assert 'ZeroDivisionError' in run.errors()


@pytest.mark.parametrize(
    'make',
    [
        lambda: WaitState(-1.0),
        lambda: WaitState('2'),  # type: ignore[arg-type]
        lambda: WaitState(float('nan')),
        lambda: WaitState(True),
        lambda: WaitState(10**400),
        lambda: LogKeyState('no place'),
        lambda: LogKeyState('{} {}'),
        lambda: LogKeyState('{name}'),
        lambda: LogKeyState('{'),
        lambda: CalculationState('x + 1'),  # type: ignore[arg-type]
        lambda: CheckConditionState('x > 1'),  # type: ignore[arg-type]
        lambda: LogState(5),  # type: ignore[arg-type]
        lambda: LogKeyState(5),  # type: ignore[arg-type]
        lambda: OperatorDecisionState(['a'], hint=5),  # type: ignore[arg-type]
        lambda: OperatorDecisionState([]),
        lambda: OperatorDecisionState('done'),
        lambda: OperatorDecisionState(['a', 'a']),
        lambda: OperatorDecisionState(['a', 'b'], suggestion='c'),
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(make: Any) -> None:
    with pytest.raises(StateParameterError):
        make()


def decision(suggestion: str | None, required: int = Autonomy.High) -> Any:
    def machine() -> OperatableStateMachine:
        root = OperatableStateMachine(outcomes=['left', 'right'])
        with root:
            OperatableStateMachine.add(
                'Choose',
                OperatorDecisionState(['go_left', 'go_right'], 'which way?', suggestion),
                {'go_left': 'left', 'go_right': 'right'},
                autonomy={'go_left': required, 'go_right': Autonomy.Full},
            )
        return root

    return machine


def answered(command: Any, *arguments: str) -> str | None:
    """Return the fate of a command."""
    done = threading.Event()
    reasons: list[str | None] = []

    def answer(reason: str | None) -> None:
        reasons.append(reason)
        done.set()

    command(*arguments, answer)
    assert done.wait(DEADLINE)
    return reasons[0]


def test_the_suggestion_is_taken_where_the_autonomy_allows_it(bench: StateBench) -> None:
    assert bench.run(decision('go_left'), autonomy=3).wait() == 'left'


@pytest.mark.parametrize('suggestion', [None, 'go_left'])
def test_otherwise_the_operator_chooses(bench: StateBench, suggestion: str | None) -> None:
    run = bench.run(decision(suggestion), autonomy=2)
    (asked,) = wait_until(run.decisions, 'decision')
    assert (asked.kind, asked.prompt, asked.outcome) == (DecisionKind.CHOICE, 'which way?', suggestion or '')
    assert list(asked.outcomes) == ['go_left', 'go_right']
    assert run.force('/Choose', 'up', asked.id) is not None
    assert run.force('/Choose', 'go_right', asked.id) is None
    assert run.wait() == 'right'


def test_the_suggestion_can_be_confirmed(bench: StateBench) -> None:
    run = bench.run(decision('go_left'), autonomy=0)
    (asked,) = wait_until(run.decisions, 'decision')
    assert run.confirm('other') is not None
    assert run.confirm(asked.id) is None
    assert run.wait() == 'left'


MADE: dict[str, dict[str, Any]] = {
    'BtExecuteGoalState': {},
    'BtExecuteState': {},
    'BtGetDataState': {'request_id': 'k', 'request_msg_type': 'string'},
    'BtLoaderState': {'xml': '<root/>'},
    'BtSetDataState': {'goal_id': 'k', 'goal_msg_type': 'string'},
    'CallActionState': {'action_type': 'nav2_msgs/action/Spin', 'topic': 'spin'},
    'CallServiceState': {'service_type': 'std_srvs/srv/SetBool', 'topic': 'light'},
    'CheckTopicState': {'topic': 'x', 'msg_type': 'std_msgs/msg/Bool', 'outcomes': {'on': 'message.data'}},
    'ExecuteBehaviorState': {'behavior': 'Inspect'},
    'OperatorDecisionState': {'outcomes': ['on']},
    'OperatorInputState': {'prompt': '?', 'type': 'string'},
    'PublishState': {'topic': 'x', 'msg_type': 'std_msgs/msg/Bool'},
    'ReadTopicState': {'topic': 'x', 'msg_type': 'std_msgs/msg/Bool'},
    'SubscribeOnceState': {'topic': 'x', 'msg_type': 'std_msgs/msg/Bool'},
    'WaitForServersState': {},
    'WaitState': {'wait_time': 1.0},
}
OF_YAML: tuple[Any, ...] = (
    None,
    True,
    5,
    -1.5,
    '',
    'x',
    [],
    [1],
    [None],
    [['a']],
    {},
    {'a': 1},
    {1: 'a'},
    {'a': ['b']},
)


@pytest.mark.parametrize(('name', 'parameters'), MADE.items(), ids=MADE)
def test_whatever_yaml_gives_as_a_parameter_is_accepted_or_refused_with_a_reason(
    name: str, parameters: Mapping[str, Any]
) -> None:
    make: type[EventState] = getattr(flexbt_states, name)
    make(**parameters)
    for parameter in inspect.signature(make).parameters:
        for value in OF_YAML:
            with contextlib.suppress(StateParameterError, StateError):
                make(**{**parameters, parameter: value})
