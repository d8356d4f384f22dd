# SPDX-License-Identifier: BSD-3-Clause
"""FlexBT's states in another engine: one that calls them as FlexBE 2.3.3 does, at its ticks.

The real FlexBE is no package of the index that these tests run with; the stand-in here has its order of calls.
"""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.action import CancelResponse

import flexbt_states
from flexbt_core import EventState, with_retry
from flexbt_flexbe.for_flexbe import hosted
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import BlackboardEntry
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import uncontended_time, wait_until

Result = BtExecute.Result


class FlexbeState:
    """FlexBE's EventState as far as a state notices: built with keywords, ticked, not left when it is preempted."""

    _node: Any = None

    def __init__(self, outcomes: list[str], input_keys: list[str], output_keys: list[str]) -> None:
        self.outcomes, self.input_keys, self.output_keys = outcomes, input_keys, output_keys
        self.path = '/State'
        self.is_entering = True

    def tick(self, userdata: dict[str, Any], *, is_blocked: bool = False) -> str | None:
        if self.is_entering:
            self.is_entering = False
            self.on_enter(userdata)
        outcome = self.execute(userdata)
        if outcome is None or is_blocked:
            return None
        self.is_entering = True
        self.on_exit(userdata)
        return outcome

    def on_start(self) -> None: ...

    def on_enter(self, userdata: Any) -> None: ...

    def execute(self, userdata: Any) -> str | None: ...

    def on_exit(self, userdata: Any) -> None: ...

    def on_stop(self) -> None: ...


class Told:
    """FlexBE's Logger, which keeps what its operator is told."""

    REPORT_INFO, REPORT_WARN, REPORT_HINT, REPORT_ERROR, REPORT_DEBUG = 0, 1, 2, 3, 10

    def __init__(self) -> None:
        self.lines: list[str] = []

    def log(self, text: str, severity: int) -> None:
        assert severity in (0, 1, 2, 3, 10)
        self.lines.append(text)


@pytest.fixture
def told() -> Told:
    return Told()


def state(bench: StateBench, told: Told, state_class: Any, **parameters: Any) -> Any:
    base = type('EventState', (FlexbeState,), {'_node': bench.runtime.node})
    made = hosted(state_class, base, told)(**parameters)
    made.on_start()
    return made


def ticked(shell: Any, userdata: dict[str, Any]) -> str:
    """Tick until there is an outcome."""
    outcome: str = wait_until(lambda: shell.tick(userdata), 'an outcome')
    return outcome


def test_it_has_the_interface_of_the_state_in_a_class_of_flexbes(bench: StateBench, told: Told) -> None:
    made = state(
        bench, told, flexbt_states.BtExecuteState, bt_file='Tree', inputs={'a': 'int64'}, outputs={'b': 'int64'}
    )
    assert isinstance(made, FlexbeState)
    assert (made.outcomes, made.input_keys, made.output_keys) == (['done', 'canceled', 'failed'], ['a'], ['b'])
    assert '-- bt_file' in str(type(made).__doc__)
    made.on_stop()


def test_a_tree_runs_and_its_output_reaches_userdata_again_and_again(bench: StateBench, told: Told) -> None:
    result = Result(code=Result.SUCCESS, outputs=[BlackboardEntry(key='b', type='int64', text='7')])
    server = bench.serve(BtExecute, 'bt_executor', ends(result))
    made = state(
        bench, told, flexbt_states.BtExecuteState, bt_file='Tree', inputs={'a': 'int64'}, outputs={'b': 'int64'}
    )
    for _ in range(2):
        userdata: dict[str, Any] = {'a': 3}
        assert ticked(made, userdata) == 'done'
        assert userdata['b'] == 7
    assert [goal.inputs[0].text for goal in server.goals] == ['3', '3']
    made.on_stop()


def test_a_blocked_outcome_stays_and_the_goal_is_not_sent_again(bench: StateBench, told: Told) -> None:
    server = bench.serve(BtExecute, 'bt_executor', ends(Result(code=Result.SUCCESS)))
    made = state(bench, told, flexbt_states.BtExecuteState, bt_file='Tree')
    made.tick({}, is_blocked=True)
    wait_until(lambda: server.statuses, 'the tree has ended')
    for _ in range(5):
        assert made.tick({}, is_blocked=True) is None
    assert ticked(made, {}) == 'done'
    assert len(server.goals) == 1
    made.on_stop()


def test_a_failed_tree_is_failed_and_told(bench: StateBench, told: Told) -> None:
    bench.serve(BtExecute, 'bt_executor', ends(Result(code=Result.FAILURE, message='no path'), 'abort'))
    made = state(bench, told, flexbt_states.BtExecuteState, bt_file='Tree')
    assert ticked(made, {}) == 'failed'
    assert any('no path' in line and line.startswith('/State: ') for line in told.lines)
    made.on_stop()


def test_a_stop_cancels_the_tree_and_waits_although_flexbe_calls_on_stop_only(bench: StateBench, told: Told) -> None:
    async def script(goal_handle: Any) -> Any:
        await canceled
        goal_handle.canceled()
        return Result(code=Result.CANCELED)

    def on_cancel(_: Any) -> CancelResponse:
        server.resolve(canceled)
        return CancelResponse.ACCEPT

    server = bench.serve(BtExecute, 'bt_executor', lambda handle: script(handle), on_cancel=on_cancel)
    canceled = server.future()
    made = state(bench, told, flexbt_states.BtExecuteState, bt_file='Tree')
    wait_until(lambda: made.tick({}) or len(server.running), 'the tree runs')
    begin = uncontended_time()
    made.on_stop()
    assert (len(server.running), server.cancels) == (0, 1)
    assert uncontended_time() - begin < 3.0


def test_feedback_on_the_goal_of_an_earlier_visit_is_not_about_this_one(bench: StateBench, told: Told) -> None:
    """FlexBE enters a state again before its earlier goal has ended."""
    heard: list[str] = []

    class Hears(flexbt_states.BtExecuteState):
        def _on_feedback(self, feedback: Any) -> None:
            heard.append(feedback.run_id)
            super()._on_feedback(feedback)

    server = bench.serve(BtExecute, 'bt_executor', on_cancel=lambda _: CancelResponse.REJECT)
    made = state(bench, told, Hears, bt_file='Tree')
    made.on_enter({})
    wait_until(lambda: server.running == [0], 'the first goal')
    made.on_exit({})
    made.on_enter({})
    wait_until(lambda: server.running == [0, 1], 'the second goal')
    server.feedback(0, BtExecute.Feedback(run_id='old'))
    server.feedback(1, BtExecute.Feedback(run_id='new'))
    wait_until(lambda: 'new' in heard, 'feedback on it')
    assert heard == ['new']
    server.end(0)
    server.end(1)
    made.on_stop()


def test_what_raises_fails_once_instead_of_at_every_tick(bench: StateBench, told: Told) -> None:
    made = state(bench, told, flexbt_states.BtExecuteState, bt_file='Tree', inputs={'a': 'int64'})
    assert ticked(made, {}) == 'failed'
    assert sum('KeyError' in line for line in told.lines) == 1
    made.on_stop()


def test_a_state_with_attempts_makes_all_of_them(bench: StateBench, told: Told) -> None:
    asked: list[int] = []

    def is_new(number: int) -> bool:
        asked.append(number)
        return False

    def patient(**parameters: Any) -> EventState:
        return with_retry(flexbt_states.CheckConditionState(**parameters), 3, ['false'])

    made = state(bench, told, patient, predicate=is_new)
    assert ticked(made, {'input_value': 7}) == 'false' and asked == [7, 7, 7]
    made.on_stop()


def test_a_state_without_an_outcome_for_that_raises(bench: StateBench, told: Told) -> None:
    made = state(bench, told, flexbt_states.CheckConditionState, predicate=lambda x: 1 / x)
    with pytest.raises(ZeroDivisionError):
        made.tick({'input_value': 0})
    made.on_stop()


def test_the_operators_choice_becomes_a_hint_and_a_suggestion(bench: StateBench, told: Told) -> None:
    made = state(bench, told, flexbt_states.OperatorDecisionState, outcomes=['a', 'b'], hint='which?', suggestion='b')
    assert made.tick({}) == 'b'
    assert told.lines == ['/State: which?']
    made.on_stop()


@pytest.mark.parametrize('suggestion', ['b', None])
def test_a_state_that_asks_while_it_is_executed_asks_once(
    bench: StateBench, told: Told, suggestion: str | None
) -> None:
    class Asks(EventState):
        def execute(self, userdata: Any) -> None:
            self.ask('which?', suggestion)

    made = state(bench, told, lambda: Asks(['a', 'b']))
    for _ in range(2):
        assert [made.tick({}, is_blocked=True) for _ in range(3)] == [None] * 3
        assert made.tick({}) == suggestion
        assert told.lines == ['/State: which?']
        told.lines.clear()
        made.is_entering = True
    made.on_stop()
