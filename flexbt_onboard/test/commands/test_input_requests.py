# SPDX-License-Identifier: BSD-3-Clause
"""Input requests on the side of the executive: what operators see, how each ends, and what is refused why."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from unittest.mock import Mock, call

import pytest
from builtin_interfaces.msg import Time

from flexbt_common import names
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import BlackboardEntry, DecisionSubject, PendingDecision
from flexbt_onboard.commands import input_requests
from flexbt_onboard.commands.command_bounds import OPEN_REQUESTS
from flexbt_onboard.commands.input_requests import MOST_REQUESTS, SUBJECT_BYTES, InputRequests
from flexbt_onboard.errors import CommandRefusedError

SPEED = BlackboardEntry(key='speed', type='float64', text='0.5')
RESULT = OperatorInput.Result


class Desk:
    """The requests of an executive, with a server that the test is."""

    def __init__(self, server: Mock) -> None:
        self.around = around = Mock()
        around.runtime.clock.stamp.return_value = Time(sec=5)
        around.report.run_id = 'run'
        self.requests = InputRequests(around.runtime, around.admission, around.report, around.status)
        self.server = server
        (*_, self._ask, self._withdraw) = server.call_args.args
        self.refused: Callable[[str], Any] = server.call_args.kwargs['refused']

    def ask(self, type: str = 'int32', **fields: Any) -> Mock:
        """Let a goal come."""
        goal = Mock(request=OperatorInput.Goal(prompt='how many?', asker='/A', type=type, **fields))
        self._ask(goal)
        return goal

    def withdraw(self, goal: Mock) -> None:
        """Let the client withdraw a goal."""
        self._withdraw(goal)

    def answer(self, text: str = '', **fields: Any) -> None:
        """Answer the first request."""
        self.requests.answer('input-1', BlackboardEntry(text=text, **fields), 'ann')

    def why_not(self, text: str, **fields: Any) -> str:
        """Return why an answer is refused."""
        with pytest.raises(CommandRefusedError) as refusal:
            self.answer(text, **fields)
        return str(refusal.value)


@pytest.fixture
def desk(monkeypatch: pytest.MonkeyPatch) -> Desk:
    monkeypatch.setattr(input_requests, 'GoalServer', server := Mock())
    return Desk(server)


def test_the_server_admits_goals_as_the_executive_does_and_has_a_limit(desk: Desk) -> None:
    arguments, options = desk.server.call_args
    assert arguments[:3] == (desk.around.runtime, OperatorInput, names.OPERATOR_INPUT)
    assert (options['admission'], options['most']) == (desk.around.admission, MOST_REQUESTS)
    assert desk.refused('why') == RESULT(code=RESULT.ERROR, message='why')


def test_operators_see_who_asks_for_what(desk: Desk) -> None:
    subject = DecisionSubject(id='of a client', entries=[SPEED])
    goals = [desk.ask(choices=['1', '2'], subject=subject), desk.ask('string')]

    def shown(id: str, **fields: Any) -> PendingDecision:
        asked: dict[str, Any] = {'path': '/A', 'prompt': 'how many?', 'since': Time(sec=5)}
        return PendingDecision(id=id, kind=PendingDecision.INPUT, required_autonomy=-1, **asked, **fields)

    about: dict[str, Any] = {'input_choices': ['1', '2'], 'subject': ['speed'], 'subject_number': 1}
    assert desk.requests.decisions() == [
        shown('input-1', input_type='int32', **about),
        shown('input-2', input_type='string'),
    ]
    assert desk.requests.subjects() == [DecisionSubject(id='input-1', number=1, entries=[SPEED])]
    assert [desk.requests.is_open(f'input-{number}') for number in (1, 2, 3)] == [True, True, False]
    for number, goal in enumerate(goals, 1):
        goal.publish_feedback.assert_called_once_with(OperatorInput.Feedback(shown=True))
        waiting = {'path': '/A', 'kind': 'input', 'outcome': '', 'outcomes': [], 'required': -1, 'prompt': 'how many?'}
        assert call.report.event('waiting', run='run', decision=f'input-{number}', **waiting) in desk.around.mock_calls
    assert desk.around.status.changed.call_count == 2


@pytest.mark.parametrize(
    ('end', 'expected'),
    [
        (
            lambda desk, _: desk.answer('7'),
            call.succeed(RESULT(code=RESULT.SUCCESS, operator_id='ann', value=BlackboardEntry(type='int32', text='7'))),
        ),
        (
            lambda desk, _: desk.requests.decline('input-1', 'ann', 'busy'),
            call.abort(RESULT(code=RESULT.DECLINED, message='the operator declined: busy', operator_id='ann')),
        ),
        (
            lambda desk, _: desk.requests.decline('input-1', 'ann', ''),
            call.abort(RESULT(code=RESULT.DECLINED, message='the operator declined', operator_id='ann')),
        ),
        (
            lambda desk, goal: desk.withdraw(goal),
            call.canceled(RESULT(code=RESULT.CANCELED, message='the request was withdrawn')),
        ),
        (
            lambda desk, _: desk.requests.close('it ends'),
            call.canceled(RESULT(code=RESULT.CANCELED, message='it ends')),
        ),
    ],
    ids=['answer', 'decline', 'decline without a reason', 'withdraw', 'close'],
)
def test_a_request_ends_once_and_that_is_told(desk: Desk, end: Callable[[Desk, Mock], None], expected: Any) -> None:
    goal = desk.ask()
    goal.reset_mock()
    desk.around.reset_mock()
    end(desk, goal)
    assert goal.mock_calls == [expected]
    assert desk.around.mock_calls == [
        call.report.event('decided', run='run', decision='input-1'),
        call.status.changed(),
    ]
    assert desk.requests.decisions() == []
    with pytest.raises(CommandRefusedError) as refusal:
        desk.requests.decline('input-1', 'ann', '')
    assert str(refusal.value) == "input request 'input-1' is not open: it was answered, declined or withdrawn"


def test_only_what_is_withdrawn_ends_and_at_the_end_all(desk: Desk) -> None:
    first, second, third = (desk.ask() for _ in range(3))
    desk.withdraw(second)
    desk.withdraw(second)
    assert [decision.id for decision in desk.requests.decisions()] == ['input-1', 'input-3']
    desk.requests.close('it ends')
    assert desk.requests.decisions() == []
    assert [goal.canceled.call_count for goal in (first, second, third)] == [1, 1, 1]


def test_an_answer_is_a_value_of_the_type_and_one_of_the_choices(desk: Desk) -> None:
    desk.ask(choices=['1', '2'])
    assert desk.why_not('1', type='string') == 'the request asks for int32, not for string'
    assert desk.why_not('3') == "'3' is none of the choices: 1, 2"
    assert 'x' in desk.why_not('x')
    desk.answer('02', type='int32')
    assert desk.requests.decisions() == []


def test_what_cannot_be_asked_is_refused_with_the_reason(desk: Desk) -> None:
    refused = [
        (desk.ask('no/msg/Such'), 'no/msg/Such'),
        (desk.ask(choices=['one']), 'one'),
    ]
    size = SUBJECT_BYTES - 10
    entries = [BlackboardEntry(text='x' * size), BlackboardEntry(data=bytes(10))]
    desk.ask(subject=DecisionSubject(entries=entries))
    entries[1].data = bytes(11)
    too_large = f'the subject has {SUBJECT_BYTES + 1} bytes; at most {SUBJECT_BYTES} are shown with a request'
    refused.append((desk.ask(subject=DecisionSubject(entries=entries)), too_large))
    for _ in range(OPEN_REQUESTS - 1):
        desk.ask()
    refused.append((desk.ask(), '32 input requests wait for the operator already; no more are taken'))
    for goal, words in refused:
        ((name, (result,), _),) = goal.mock_calls
        assert (name, result.code) == ('abort', RESULT.ERROR)
        assert words in result.message
    assert refused[-2][0].abort.call_args.args[0].message == too_large
    assert len(desk.requests.decisions()) == OPEN_REQUESTS
    desk.requests.close('all')
    noted = desk.ask(subject=DecisionSubject(notes=['the path: none']))
    noted.publish_feedback.assert_called_once()
    assert [list(subject.notes) for subject in desk.requests.subjects()] == [['the path: none']]
