# SPDX-License-Identifier: BSD-3-Clause
"""The state that asks the operator for a value, with the executive's own server and with bad ones."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.action import CancelResponse

from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import BlackboardEntry
from flexbt_onboard.commands.input_requests import InputRequests
from flexbt_onboard.errors import CommandRefusedError
from flexbt_states import OperatorInputState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import wait_until

POSE = 'geometry_msgs/msg/PoseStamped'
RESULT = OperatorInput.Result


class Desk:
    """The executive's side of requests for input, as an operator uses it."""

    def __init__(self, bench: StateBench) -> None:
        self.runtime = NodeRuntime('desk', args=())
        self.changes = 0
        self.events: list[tuple[str, str]] = []
        report: Any = SimpleNamespace(
            run_id='', event=lambda event, decision, **_fields: self.events.append((event, decision))
        )
        status: Any = SimpleNamespace(changed=self._count)
        self.requests = self.runtime.call(
            lambda: InputRequests(self.runtime, GoalAdmission('the desk'), report, status)
        )
        link = bench.services.actions.link(OperatorInput, 'operator_input')
        wait_until(lambda: bench.runtime.call(link.is_ready), 'discovered')

    def pending(self) -> Any:
        (decision,) = wait_until(lambda: self.runtime.call(self.requests.decisions), 'decision')
        return decision

    def none_pending(self) -> None:
        wait_until(lambda: not self.runtime.call(self.requests.decisions), 'decision gone')

    def answer(self, **fields: Any) -> None:
        decision = self.pending()
        self.runtime.call(lambda: self.requests.answer(decision.id, BlackboardEntry(**fields), 'eva'))

    def _count(self) -> None:
        self.changes += 1


@pytest.fixture
def desk(bench: StateBench) -> Iterator[Desk]:
    desk = Desk(bench)
    yield desk
    desk.runtime.call(lambda: desk.requests.close('the desk is closed'))
    desk.runtime.close()


def ask(type: str = POSE, **options: Any) -> OperatorInputState:
    return OperatorInputState('Where to?', type, **options)


def test_an_answer_as_text_arrives_as_a_value(bench: StateBench, desk: Desk) -> None:
    read: dict[str, Any] = {}
    run = bench.run_state(ask, {'data': None}, outputs=['data'], read=read)
    decision = desk.pending()
    assert (decision.prompt, decision.input_type, decision.path) == ('Where to?', POSE, '/State')
    desk.answer(text='{header: {frame_id: map}, pose: {position: {x: 2}}}')
    assert run.wait() == 'received', run.lines
    assert desk.events == [('waiting', decision.id), ('decided', decision.id)]
    expected = PoseStamped()
    expected.header.frame_id, expected.pose.position.x = 'map', 2.0
    assert read == {'data': expected}
    desk.none_pending()


def test_what_the_question_is_about_is_shown_with_it(bench: StateBench, desk: Desk) -> None:
    run = bench.run_state(lambda: ask('string', shows=['speed']), {'speed': 0.5, 'data': None})
    decision = desk.pending()
    assert (list(decision.subject), decision.subject_number) == (['speed'], 1)
    (subject,) = desk.runtime.call(desk.requests.subjects)
    assert (subject.id, subject.entries[0].text) == (decision.id, '0.5')
    desk.answer(text='slower')
    assert run.wait() == 'received', run.lines
    for shows in ('speed', ['']):
        with pytest.raises(StateParameterError, match='shows'):
            ask(shows=shows)


@pytest.mark.parametrize(
    ('fields', 'words'),
    [
        ({'text': '{pose: {position: {x: far}}}'}, 'pose.position.x'),
        ({'text': '{goal: 1}'}, 'goal'),
        ({'text': '{}', 'type': 'string'}, POSE),
        ({'data': b'123'}, 'CDR'),
        ({'type': 'no/msg/Such', 'text': '1'}, 'no/msg/Such'),
    ],
)
def test_a_refused_answer_leaves_the_decision_open(
    bench: StateBench, desk: Desk, fields: dict[str, Any], words: str
) -> None:
    run = bench.run_state(ask, {'data': None})
    with pytest.raises(CommandRefusedError) as refusal:
        desk.answer(**fields)
    assert words in str(refusal.value)
    desk.answer(text='{}')
    assert run.wait() == 'received'


def test_only_choices_may_be_answered(bench: StateBench, desk: Desk) -> None:
    read: dict[str, Any] = {}
    run = bench.run_state(lambda: ask('int32', choices=['1', '2']), {'data': None}, outputs=['data'], read=read)
    with pytest.raises(CommandRefusedError, match='1, 2'):
        desk.answer(text='3')
    desk.answer(text='2')
    assert run.wait() == 'received'
    assert read == {'data': 2}


def test_the_operator_may_decline(bench: StateBench, desk: Desk) -> None:
    run = bench.run_state(ask, {'data': None})
    decision = desk.pending()
    desk.runtime.call(lambda: desk.requests.decline(decision.id, 'eva', 'not now'))
    assert run.wait() == 'declined'
    with pytest.raises(CommandRefusedError, match='not open'):
        desk.runtime.call(lambda: desk.requests.decline(decision.id, 'eva', 'not now'))


def test_a_decision_is_withdrawn_when_its_state_is_left(bench: StateBench, desk: Desk) -> None:
    run = bench.run_state(ask, {'data': None})
    desk.pending()
    assert run.stop() == 'preempted'
    desk.none_pending()


def test_without_an_answer_in_time_the_decision_is_withdrawn(bench: StateBench, desk: Desk) -> None:
    run = bench.run_state(lambda: ask(timeout=0.2), {'data': None})
    assert run.wait() == 'failed'
    assert '0.2 s' in run.errors()
    desk.none_pending()


def test_several_decisions_at_a_time_are_answered_each(bench: StateBench, desk: Desk) -> None:
    runs = [bench.run_state(lambda: ask('string'), {'data': None}) for _ in range(3)]
    decisions = wait_until(
        lambda: len(found := desk.runtime.call(desk.requests.decisions)) == 3 and found, 'three decisions'
    )
    assert len({decision.id for decision in decisions}) == 3

    def answer(decision_id: str) -> None:
        desk.runtime.call(lambda: desk.requests.answer(decision_id, BlackboardEntry(text='x'), 'eva'))

    for decision in decisions[1:]:
        answer(decision.id)
    wait_until(lambda: sum(run.outcome is not None for run in runs) == 2, 'two answered')
    assert desk.pending().id == decisions[0].id
    desk.answer(text='y')
    assert [run.wait() for run in runs] == ['received'] * 3


def test_without_an_executive_the_state_fails(bench: StateBench) -> None:
    run = bench.run_state(ask, {'data': None})
    assert run.wait() == 'failed'
    assert 'operator_input' in run.errors()


@pytest.mark.parametrize(
    ('result', 'how', 'outcome'),
    [
        (RESULT(), 'succeed', 'failed'),
        (RESULT(), 'abort', 'failed'),
        (RESULT(code=RESULT.SUCCESS, value=to_entry('', 1)), 'abort', 'failed'),
        (RESULT(code=RESULT.SUCCESS, value=to_entry('', 'x')), 'succeed', 'failed'),
        (RESULT(code=RESULT.SUCCESS), 'succeed', 'failed'),
        (RESULT(code=RESULT.ERROR, message='no'), 'abort', 'failed'),
        (RESULT(code=RESULT.DECLINED), 'abort', 'declined'),
        (RESULT(code=RESULT.SUCCESS, value=to_entry('', PoseStamped())), 'succeed', 'received'),
    ],
)
def test_nothing_but_an_answer_counts_as_received(bench: StateBench, result: Any, how: str, outcome: str) -> None:
    bench.serve(OperatorInput, 'operator_input', ends(result, how))
    run = bench.run_state(ask, {'data': None})
    assert run.wait() == outcome
    assert bool(run.errors()) == (outcome == 'failed')


def test_a_server_that_dies_is_noticed(bench: StateBench) -> None:
    async def script(_goal_handle: Any) -> Any:
        await future

    server = bench.serve(OperatorInput, 'operator_input', script, on_cancel=lambda _goal: CancelResponse.REJECT)
    future = server.future()
    run = bench.run_state(ask, {'data': None})
    wait_until(lambda: server.running, 'asked')
    server.runtime.close()
    assert run.wait() == 'failed'


@pytest.mark.parametrize(
    'make',
    [
        lambda: ask('PoseStamped'),
        lambda: ask('no/msg/Such'),
        lambda: ask('int32', choices=['one']),
        lambda: ask('int32', choices='1'),
        lambda: ask('int32', choices=[1]),
        lambda: OperatorInputState(5, 'int32'),  # type: ignore[arg-type]
        lambda: ask(timeout=-1),
        lambda: ask(topic=''),
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(make: Any) -> None:
    with pytest.raises(StateParameterError):
        make()
