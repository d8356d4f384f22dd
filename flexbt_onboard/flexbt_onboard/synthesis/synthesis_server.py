# SPDX-License-Identifier: BSD-3-Clause
"""The action ``synthesize_behavior``: an operator has a behavior made of capabilities, while another one runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_core.values import sendable
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_onboard.errors import CommandRefusedError

from .synthesizer import Answer, SearchRequest, Synthesizer, Verdict

Goal, Result = SynthesizeBehavior.Goal, SynthesizeBehavior.Result

LIVENESS: Final = {Goal.FAIR: 'fair', Goal.ADVERSARIAL: 'adversarial', Goal.FAIR_OUTCOMES: 'fair-outcomes'}
_CODES: Final = {
    Verdict.MADE: Result.SUCCESS,
    Verdict.UNREALIZABLE: Result.UNREALIZABLE,
    Verdict.WRONG: Result.FAILURE,
    Verdict.CANCELED: Result.CANCELED,
    Verdict.FAULT: Result.ERROR,
}
_LINES: Final = 1000


class SynthesisServer:
    """Serves SynthesizeBehavior. Used on the executor thread."""

    def __init__(self, runtime: NodeRuntime, synthesizer: Synthesizer, admission: GoalAdmission) -> None:
        """``admission``: whether goals are taken at all."""
        self._synthesizer = synthesizer
        GoalServer(
            runtime,
            SynthesizeBehavior,
            names.SYNTHESIZE_BEHAVIOR,
            self._serve,
            refused=_refused,
            admission=admission,
        )

    def _serve(self, goal: ServedGoal) -> None:
        def end(answer: Answer) -> None:
            result = Result(
                code=_CODES[answer.verdict],
                message=sendable(answer.message),
                behavior=answer.behavior,
                machine=sendable(answer.machine),
                notes=_sendable_lines(answer.notes),
                explanation=_sendable_lines(answer.explanation),
            )
            if answer.verdict is Verdict.CANCELED:
                goal.canceled(result)
            else:
                (goal.succeed if answer.verdict is Verdict.MADE else goal.abort)(result)

        def news(doing: str, seconds: float) -> None:
            goal.publish_feedback(SynthesizeBehavior.Feedback(doing=sendable(doing), seconds=seconds))

        try:
            search = self._synthesizer.begin(_request(goal.request), news, end)
        except CommandRefusedError as error:
            goal.abort(_refused(str(error)))
        else:
            goal.on_cancel(search.cancel)


def _request(goal: Any) -> SearchRequest:
    if goal.liveness not in LIVENESS:
        known = ', '.join(f'{number} ({name})' for number, name in LIVENESS.items())
        raise CommandRefusedError(f'liveness {goal.liveness} is unknown; known are {known}')
    return SearchRequest(
        goal.system,
        goal.capabilities,
        goal.specification,
        goal.goals,
        goal.initial_conditions,
        goal.outcomes,
        LIVENESS[goal.liveness],
        goal.retries if goal.retries >= 0 else None,
        goal.name,
        goal.time_limit,
        goal.operator_id,
    )


def _sendable_lines(texts: Sequence[str]) -> list[str]:
    return [sendable(text, 1000) for text in texts[:_LINES]]


def _refused(why: str) -> Any:
    return Result(code=Result.FAILURE, message=why)
