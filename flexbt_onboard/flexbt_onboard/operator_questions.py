# SPDX-License-Identifier: BSD-3-Clause
"""Questions to the operator for typed values: the action that other nodes and states ask by, and their answers."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.errors import FlexbtError
from flexbt_common.node_runtime import NodeRuntime
from flexbt_common.values import from_entry, resolve_type, text_to_value, to_entry
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import BlackboardEntry, PendingDecision
from flexbt_onboard.errors import CommandRefusedError

_RESULT_SECONDS = 30
"""How long the result of a question can be asked for again, after an outage of the link."""


@dataclass
class _Question:
    id: str
    prompt: str
    type: str
    choices: list[str]
    asker: str
    since: Time
    future: Future  # of an OperatorInput.Result


class OperatorQuestions:
    """Serves ``operator_input``: each goal is a question that stays open until it is answered, declined or withdrawn.

    Used on the executor thread only. ``on_change`` is called when a question comes or goes.
    """

    def __init__(self, runtime: NodeRuntime, on_change: Callable[[], None]) -> None:
        self._runtime = runtime
        self._on_change = on_change
        self._questions: dict[str, _Question] = {}
        self._by_goal: dict[bytes, _Question] = {}
        self._numbers = itertools.count(1)
        self._server = ActionServer(
            runtime.node,
            OperatorInput,
            names.OPERATOR_INPUT,
            execute_callback=self._execute,
            cancel_callback=self._cancel,
            result_timeout=_RESULT_SECONDS,
            **names.deep_action_services(),
        )

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

    def close(self) -> None:
        """Withdraw all questions; the executive ends."""
        for question in list(self._questions.values()):
            self._close(question, OperatorInput.Result.CANCELED, 'the executive is shutting down')

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
        question.future.set_result(result)
        self._on_change()

    async def _execute(self, goal_handle: ServerGoalHandle) -> Any:
        goal = goal_handle.request
        if goal_handle.is_cancel_requested:
            goal_handle.canceled()
            return OperatorInput.Result(code=OperatorInput.Result.CANCELED, message='the question was withdrawn')
        try:
            type = _checked_question(goal)
        except FlexbtError as error:
            goal_handle.abort()
            return OperatorInput.Result(code=OperatorInput.Result.ERROR, message=str(error))
        question = _Question(
            id=f'input-{next(self._numbers)}',
            prompt=goal.prompt,
            type=type,
            choices=list(goal.choices),
            asker=goal.asker,
            since=self._runtime.clock.stamp(),
            future=Future(),
        )
        goal_key = bytes(goal_handle.goal_id.uuid)
        self._questions[question.id] = question
        self._by_goal[goal_key] = question
        self._on_change()
        goal_handle.publish_feedback(OperatorInput.Feedback(shown=True))
        result = await question.future
        del self._by_goal[goal_key]
        if goal_handle.is_cancel_requested and result.code == OperatorInput.Result.CANCELED:
            goal_handle.canceled()
        elif result.code == OperatorInput.Result.SUCCESS:
            goal_handle.succeed()
        else:
            goal_handle.abort()
        return result

    def _cancel(self, goal_handle: ServerGoalHandle) -> CancelResponse:
        question = self._by_goal.get(bytes(goal_handle.goal_id.uuid))
        if question is not None and question.id in self._questions:
            self._close(question, OperatorInput.Result.CANCELED, 'the question was withdrawn')
        return CancelResponse.ACCEPT


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
