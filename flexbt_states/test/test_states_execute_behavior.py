# SPDX-License-Identifier: BSD-3-Clause
"""The state that runs a behavior of another executive: nothing but a declared outcome with its outputs counts."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import ExecuteBehavior
from flexbt_states import ExecuteBehaviorState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer, ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import wait_until

RESULT = ExecuteBehavior.Result
ACTION = 'inspector/execute_behavior'
REPORT = [to_entry('report', 'all is well')]


def state(**options: Any) -> ExecuteBehaviorState:
    return ExecuteBehaviorState('Inspect', ['done', 'finished'], topic=ACTION, **options)


def test_inputs_go_in_and_outcome_and_outputs_come_out(bench: StateBench) -> None:
    answer = RESULT(code=RESULT.SUCCESS, outcome='done', outputs=REPORT)
    server = bench.serve(ExecuteBehavior, ACTION, ends(answer))
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: state(inputs={'site': 'string'}, outputs={'report': 'string'}, arguments={'duration': '2'}, autonomy=1),
        {'site': 'gate', 'report': None},
        outputs=['report'],
        read=read,
    )
    assert run.wait() == 'done', run.lines
    assert read == {'report': 'all is well'}
    (goal,) = server.goals
    assert (goal.behavior, goal.autonomy) == ('Inspect', 1)
    assert [(one.name, one.value) for one in goal.arguments] == [('duration', '2')]
    assert [(entry.key, from_entry(entry)) for entry in goal.inputs] == [('site', 'gate')]


@pytest.mark.parametrize(
    ('result', 'how', 'outcome', 'words'),
    [
        (RESULT(), 'succeed', 'failed', "ended with '', which is none of done, finished"),
        (RESULT(code=RESULT.SUCCESS, outcome='else'), 'succeed', 'failed', "'else'"),
        (RESULT(code=RESULT.SUCCESS, outcome='failed', outputs=REPORT), 'succeed', 'failed', "ended with 'failed'"),
        (RESULT(code=RESULT.SUCCESS, outcome='canceled', outputs=REPORT), 'succeed', 'failed', "with 'canceled'"),
        (RESULT(code=RESULT.SUCCESS, outcome='finished'), 'succeed', 'failed', "'report'"),
        (RESULT(code=RESULT.SUCCESS, outcome='finished'), 'abort', 'failed', 'Inspect'),
        (RESULT(code=RESULT.FAILURE, message='no such behavior'), 'abort', 'failed', 'no such behavior'),
        (RESULT(code=RESULT.ERROR, message='it raised'), 'abort', 'failed', 'it raised'),
        (RESULT(code=RESULT.CANCELED, message='by ann'), 'abort', 'canceled', 'by ann'),
    ],
)
def test_what_goes_wrong_is_an_outcome_with_its_reason(
    bench: StateBench, result: Any, how: str, outcome: str, words: str
) -> None:
    bench.serve(ExecuteBehavior, ACTION, ends(result, how))
    run = bench.run_state(lambda: state(outputs={'report': 'string'}), {'report': None})
    assert run.wait() == outcome
    assert words in run.errors() + ' '.join(text for _, _, text in run.lines)


def test_leaving_the_state_stops_the_behavior_and_its_states_are_the_activity(bench: StateBench) -> None:
    server: ScriptedActionServer

    async def script(handle: Any) -> Any:
        handle.publish_feedback(ExecuteBehavior.Feedback(active_states=['/Look']))
        await canceled
        handle.canceled()
        return RESULT(code=RESULT.CANCELED)

    def on_cancel(_handle: Any) -> Any:
        from rclpy.action import CancelResponse

        canceled.set_result(None)
        return CancelResponse.ACCEPT

    server = bench.serve(ExecuteBehavior, ACTION, script, on_cancel=on_cancel)
    canceled = server.future()
    run = bench.run_state(state)
    wait_until(lambda: [line for one in run.active() for line in one.activity] == ['/Look'], 'activity')
    run.behavior_run.stop('enough')
    assert run.wait() == 'preempted'
    assert (server.cancels, len(server.running)) == (1, 0)


def test_without_an_executive_it_fails_soon_and_bad_parameters_are_refused(bench: StateBench) -> None:
    run = bench.run_state(state)
    assert run.wait() == 'failed'
    assert ACTION in run.errors()
    with pytest.raises(StateParameterError, match='inputs'):
        state(inputs={'x': 'no_such/Type'})
    with pytest.raises(StateParameterError, match=r"arguments\['factor'\]: 3 is not text; in YAML, quote it"):
        state(arguments={'factor': 3})
    with pytest.raises(StateParameterError, match='behavior'):
        ExecuteBehaviorState(5)  # type: ignore[arg-type]
    with pytest.raises(StateParameterError, match='autonomy 300 is none of the levels'):
        state(autonomy=300)
