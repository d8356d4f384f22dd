# SPDX-License-Identifier: BSD-3-Clause
"""Questions to the operator for typed values: the action that other nodes and states ask by, and their answers."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import from_entry, resolve_type, text_to_value, to_entry
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import BlackboardEntry, PendingDecision
from flexbt_onboard.errors import CommandRefusedError


@dataclass
class _Question:
    id: str
    prompt: str
    type: str
    choices: list[str]
    asker: str
    since: Time
    goal: ServedGoal


class OperatorQuestions:
    """Serves ``operator_input``: each goal is a question that stays open until it is answered, declined or withdrawn.

    Used on the executor thread only. ``on_change`` is called when a question comes or goes.
    """

    def __init__(self, runtime: NodeRuntime, admission: GoalAdmission, on_change: Callable[[], None]) -> None:
        self._runtime = runtime
        self._on_change = on_change
        self._questions: dict[str, _Question] = {}
        self._numbers = itertools.count(1)
        ask = admission.guard(self._ask, _refused)
        self._server = GoalServer(runtime, OperatorInput, names.OPERATOR_INPUT, ask, self._withdraw)

    def decisions(self) -> list[PendingDecision]:
        """The open questions, oldest first."""
        return [
            PendingDecision(
                id=question.id,
                kind=PendingDecision.INPUT,
                path=question.asker,
                required_autonomy=-1,
                prompt=question.prompt,
                input_type=question.type,
                input_choices=question.choices,
                since=question.since,
            )
            for question in self._questions.values()
        ]

    def is_open(self, question_id: str) -> bool:
        """Whether there is such a question and it waits for its answer."""
        return question_id in self._questions

    def answer(self, question_id: str, value: BlackboardEntry, operator_id: str) -> None:
        """Answer a question; a value that is refused leaves it open.

        Raises:
            CommandRefusedError: no such question, or the value does not fit.
        """
        question = self._find(question_id)
        checked = _checked_answer(question, value)
        self._close(question, OperatorInput.Result.SUCCESS, '', operator_id, checked)

    def decline(self, question_id: str, operator_id: str, reason: str) -> None:
        """Decline to answer a question.

        Raises:
            CommandRefusedError: no such question.
        """
        message = f'the operator declined: {reason}' if reason else 'the operator declined'
        self._close(self._find(question_id), OperatorInput.Result.DECLINED, message, operator_id)

    def close(self, why: str) -> None:
        """Withdraw all questions."""
        for question in list(self._questions.values()):
            self._close(question, OperatorInput.Result.CANCELED, why)

    def _find(self, question_id: str) -> _Question:
        try:
            return self._questions[question_id]
        except KeyError:
            raise CommandRefusedError(
                f'question {question_id!r} is not open: it was answered, declined or withdrawn'
            ) from None

    def _close(
        self,
        question: _Question,
        code: int,
        message: str,
        operator_id: str = '',
        value: BlackboardEntry | None = None,
    ) -> None:
        del self._questions[question.id]
        result = OperatorInput.Result(
            code=code, message=message, operator_id=operator_id, value=value or BlackboardEntry()
        )
        if code == OperatorInput.Result.SUCCESS:
            question.goal.succeed(result)
        elif code == OperatorInput.Result.CANCELED:
            question.goal.canceled(result)
        else:
            question.goal.abort(result)
        self._on_change()

    def _ask(self, goal: ServedGoal) -> None:
        request = goal.request
        try:
            type = _checked_question(request)
        except FlexbtError as error:
            goal.abort(_refused(str(error)))
            return
        question = _Question(
            id=f'input-{next(self._numbers)}',
            prompt=request.prompt,
            type=type,
            choices=list(request.choices),
            asker=request.asker,
            since=self._runtime.clock.stamp(),
            goal=goal,
        )
        self._questions[question.id] = question
        self._on_change()
        goal.publish_feedback(OperatorInput.Feedback(shown=True))

    def _withdraw(self, goal: ServedGoal) -> None:
        for question in list(self._questions.values()):
            if question.goal is goal:
                self._close(question, OperatorInput.Result.CANCELED, 'the question was withdrawn')


def _refused(why: str) -> Any:
    return OperatorInput.Result(code=OperatorInput.Result.ERROR, message=why)


def _checked_question(goal: Any) -> str:
    """The canonical name of the type that is asked for."""
    type = resolve_type(goal.type).name
    for text in goal.choices:
        text_to_value(text, type)
    return type


def _checked_answer(question: _Question, answer: BlackboardEntry) -> BlackboardEntry:
    try:
        given = resolve_type(answer.type).name if answer.type else question.type
        if given != question.type:
            raise CommandRefusedError(f'the question asks for a {question.type}, not for a {given}')
        value = from_entry(BlackboardEntry(type=question.type, text=answer.text, data=answer.data))
        if question.choices and value not in [text_to_value(text, question.type) for text in question.choices]:
            raise CommandRefusedError(f'{answer.text!r} is none of the choices: {", ".join(question.choices)}')
        return to_entry('', value, question.type)
    except CommandRefusedError:
        raise
    except FlexbtError as error:
        raise CommandRefusedError(str(error)) from error
