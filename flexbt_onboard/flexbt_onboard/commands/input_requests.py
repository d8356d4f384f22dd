# SPDX-License-Identifier: BSD-3-Clause
"""Input requests, by which nodes and states ask the operator for typed values with an action."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.decision_subject import subject_fields
from flexbt_common.values.entries import from_entry, text_to_value, to_entry
from flexbt_common.values.value_types import resolve_type
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import BlackboardEntry, DecisionSubject, PendingDecision
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.link.status_publisher import StatusPublisher

from .command_bounds import OPEN_REQUESTS

MOST_REQUESTS: Final = 100
"""Maximum number of goals of the action at a time."""


SUBJECT_BYTES: Final = 128_000
"""Maximum size of the subject of a request, bytes, since every console receives it."""


@dataclass
class _InputRequest:
    decision: PendingDecision
    goal: ServedGoal
    subject: DecisionSubject | None


class InputRequests:
    """The server of the action ``operator_input``.

    Each goal is a request that stays open until an operator answers or declines it, or its client withdraws it.

    Used on the executor thread only.
    """

    def __init__(self, runtime: Runtime, admission: GoalAdmission, report: Reporter, status: StatusPublisher) -> None:
        self._runtime = runtime
        self._report = report
        self._status = status
        self._open: dict[str, _InputRequest] = {}
        self._numbers = itertools.count(1)
        self._server = GoalServer(
            runtime,
            OperatorInput,
            names.OPERATOR_INPUT,
            self._ask,
            self._withdraw,
            refused=_refused,
            most=MOST_REQUESTS,
            admission=admission,
        )

    def decisions(self) -> list[PendingDecision]:
        """Return the open requests, oldest first."""
        return [request.decision for request in self._open.values()]

    def subjects(self) -> list[DecisionSubject]:
        """Return the subjects of the open requests."""
        return [request.subject for request in self._open.values() if request.subject is not None]

    def is_open(self, request_id: str) -> bool:
        """Return whether a request waits for its answer."""
        return request_id in self._open

    def answer(self, request_id: str, value: BlackboardEntry, operator_id: str) -> None:
        """Answer a request. It stays open if the value is refused.

        Raises:
            CommandRefusedError: the request is not open, or the value does not fit it.
        """
        request = self._find(request_id)
        checked = _checked_answer(request.decision, value)
        self._close(request, OperatorInput.Result.SUCCESS, '', operator_id, checked)

    def decline(self, request_id: str, operator_id: str, reason: str) -> None:
        """Decline to answer a request.

        Raises:
            CommandRefusedError: the request is not open.
        """
        message = f'the operator declined: {reason}' if reason else 'the operator declined'
        self._close(self._find(request_id), OperatorInput.Result.DECLINED, message, operator_id)

    def close(self, why: str) -> None:
        """Withdraw all requests."""
        for request in list(self._open.values()):
            self._close(request, OperatorInput.Result.CANCELED, why)

    def _find(self, request_id: str) -> _InputRequest:
        try:
            return self._open[request_id]
        except KeyError:
            raise CommandRefusedError(
                f'input request {request_id!r} is not open: it was answered, declined or withdrawn'
            ) from None

    def _close(
        self,
        request: _InputRequest,
        code: int,
        message: str,
        operator_id: str = '',
        value: BlackboardEntry | None = None,
    ) -> None:
        del self._open[request.decision.id]
        result = OperatorInput.Result(
            code=code, message=message, operator_id=operator_id, value=value or BlackboardEntry()
        )
        if code == OperatorInput.Result.SUCCESS:
            request.goal.succeed(result)
        elif code == OperatorInput.Result.CANCELED:
            request.goal.canceled(result)
        else:
            request.goal.abort(result)
        self._report.event('decided', run=self._report.run_id, decision=request.decision.id)
        self._status.changed()

    def _ask(self, goal: ServedGoal) -> None:
        wanted = goal.request
        if len(self._open) >= OPEN_REQUESTS:
            goal.abort(_refused(f'{len(self._open)} input requests wait for the operator already; no more are taken'))
            return
        id = f'input-{next(self._numbers)}'
        try:
            type = _checked_type(wanted)
            subject = _checked_subject(id, wanted.subject)
        except FlexbtError as error:
            goal.abort(_refused(str(error)))
            return
        decision = PendingDecision(
            id=id,
            kind=PendingDecision.INPUT,
            path=wanted.asker,
            required_autonomy=-1,
            prompt=wanted.prompt,
            input_type=type,
            input_choices=wanted.choices,
            since=self._runtime.clock.stamp(),
            **subject_fields(subject),
        )
        self._open[id] = _InputRequest(decision, goal, subject)
        self._report.event(
            'waiting',
            run=self._report.run_id,
            decision=id,
            path=wanted.asker,
            kind='input',
            outcome='',
            outcomes=[],
            required=-1,
            prompt=wanted.prompt,
        )
        self._status.changed()
        goal.publish_feedback(OperatorInput.Feedback(shown=True))

    def _withdraw(self, goal: ServedGoal) -> None:
        for request in list(self._open.values()):
            if request.goal is goal:
                self._close(request, OperatorInput.Result.CANCELED, 'the request was withdrawn')


def _refused(why: str) -> Any:
    return OperatorInput.Result(code=OperatorInput.Result.ERROR, message=why)


def _checked_type(goal: Any) -> str:
    """Return the canonical name of the requested type, and check that the choices are values of it."""
    type = resolve_type(goal.type).name
    for text in goal.choices:
        text_to_value(text, type)
    return type


def _checked_subject(id: str, given: DecisionSubject) -> DecisionSubject | None:
    """Return the subject of a request, marked with the id of the request; None if it has no subject."""
    size = sum(len(entry.text) + len(entry.data) for entry in given.entries)
    if size > SUBJECT_BYTES:
        raise CommandRefusedError(f'the subject has {size} bytes; at most {SUBJECT_BYTES} are shown with a request')
    given.id, given.number = id, 1
    return given if given.entries or given.notes else None


def _checked_answer(asked: PendingDecision, answer: BlackboardEntry) -> BlackboardEntry:
    wanted, choices = asked.input_type, asked.input_choices
    try:
        given = resolve_type(answer.type).name if answer.type else wanted
        if given != wanted:
            raise CommandRefusedError(f'the request asks for {wanted}, not for {given}')
        value = from_entry(BlackboardEntry(type=wanted, text=answer.text, data=answer.data))
        if choices and value not in [text_to_value(text, wanted) for text in choices]:
            raise CommandRefusedError(f'{answer.text!r} is none of the choices: {", ".join(choices)}')
        return to_entry('', value, wanted)
    except FlexbtError as error:
        raise CommandRefusedError(str(error)) from error
