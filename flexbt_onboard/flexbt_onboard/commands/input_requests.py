# SPDX-License-Identifier: BSD-3-Clause
"""Input requests: typed values that nodes and states ask the operator for, by an action, and the answers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

from builtin_interfaces.msg import Time

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
from flexbt_onboard.link.status_publisher import StatusPublisher
from flexbt_onboard.persistence.reporter import Reporter

from .command_bounds import OPEN_REQUESTS

MOST_REQUESTS: Final = 100
"""Requests that are open at a time: each is in every status."""


SUBJECT_BYTES: Final = 128_000
"""Maximum size of the subject of a request, bytes: it is sent to every console."""


@dataclass
class _InputRequest:
    id: str
    prompt: str
    type: str
    choices: list[str]
    asker: str
    since: Time
    goal: ServedGoal
    subject: DecisionSubject | None


class InputRequests:
    """The server of ``operator_input``: each goal is a request that stays open until it is answered, declined or
    withdrawn.

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
        return [
            PendingDecision(
                id=request.id,
                kind=PendingDecision.INPUT,
                path=request.asker,
                required_autonomy=-1,
                prompt=request.prompt,
                input_type=request.type,
                input_choices=request.choices,
                since=request.since,
                **subject_fields(request.subject),
            )
            for request in self._open.values()
        ]

    def subjects(self) -> list[DecisionSubject]:
        """Return what the open requests are about."""
        return [request.subject for request in self._open.values() if request.subject is not None]

    def is_open(self, request_id: str) -> bool:
        """Return whether the request exists and waits for its answer."""
        return request_id in self._open

    def answer(self, request_id: str, value: BlackboardEntry, operator_id: str) -> None:
        """Answer a request; a value that is refused leaves it open.

        Raises:
            CommandRefusedError: the request does not exist, or the value does not fit.
        """
        request = self._find(request_id)
        checked = _checked_answer(request, value)
        self._close(request, OperatorInput.Result.SUCCESS, '', operator_id, checked)

    def decline(self, request_id: str, operator_id: str, reason: str) -> None:
        """Decline to answer a request.

        Raises:
            CommandRefusedError: the request does not exist.
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
        del self._open[request.id]
        result = OperatorInput.Result(
            code=code, message=message, operator_id=operator_id, value=value or BlackboardEntry()
        )
        if code == OperatorInput.Result.SUCCESS:
            request.goal.succeed(result)
        elif code == OperatorInput.Result.CANCELED:
            request.goal.canceled(result)
        else:
            request.goal.abort(result)
        self._report.event('decided', run=self._report.run_id, decision=request.id)
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
        request = _InputRequest(
            id=id,
            prompt=wanted.prompt,
            type=type,
            choices=list(wanted.choices),
            asker=wanted.asker,
            since=self._runtime.clock.stamp(),
            goal=goal,
            subject=subject,
        )
        self._open[request.id] = request
        self._report.event(
            'waiting',
            run=self._report.run_id,
            decision=request.id,
            path=request.asker,
            kind='input',
            outcome='',
            outcomes=[],
            required=-1,
            prompt=request.prompt,
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
    """Return the canonical name of the type that is asked for."""
    type = resolve_type(goal.type).name
    for text in goal.choices:
        text_to_value(text, type)
    return type


def _checked_subject(id: str, given: DecisionSubject) -> DecisionSubject | None:
    """Return what a request is about, under the name of the request; None when it is about nothing."""
    size = sum(len(entry.text) + len(entry.data) for entry in given.entries)
    if size > SUBJECT_BYTES:
        raise CommandRefusedError(f'the subject has {size} bytes; at most {SUBJECT_BYTES} are shown with a request')
    given.id, given.number = id, 1
    return given if given.entries or given.notes else None


def _checked_answer(request: _InputRequest, answer: BlackboardEntry) -> BlackboardEntry:
    try:
        given = resolve_type(answer.type).name if answer.type else request.type
        if given != request.type:
            raise CommandRefusedError(f'the request asks for a {request.type}, not for a {given}')
        value = from_entry(BlackboardEntry(type=request.type, text=answer.text, data=answer.data))
        if request.choices and value not in [text_to_value(text, request.type) for text in request.choices]:
            raise CommandRefusedError(f'{answer.text!r} is none of the choices: {", ".join(request.choices)}')
        return to_entry('', value, request.type)
    except CommandRefusedError:
        raise
    except FlexbtError as error:
        raise CommandRefusedError(str(error)) from error
