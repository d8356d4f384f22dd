# SPDX-License-Identifier: BSD-3-Clause
"""The action ``synthesize_behavior``: an operator has a behavior made of capabilities, while another one runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.liveness import PresenceWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer
from flexbt_core.values import sendable
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_onboard.errors import CommandRefusedError

from .synthesizer import Answer, Search, SearchRequest, Synthesizer, Verdict

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

GONE_SECONDS: Final = 10.0
"""How long the operator who asked may be gone: a link that was bad for a while costs no search."""


class SynthesisServer:
    """Serves SynthesizeBehavior. Used on the executor thread.

    There is one search at a time. So that none is in the way of others for nobody, it is canceled when the operator who
    asked for it was there, and is gone. Programs may ask without being there: for these there is the time limit.
    """

    def __init__(
        self, runtime: NodeRuntime, synthesizer: Synthesizer, admission: GoalAdmission, presence: PresenceWatch
    ) -> None:
        """``admission``: whether goals are taken at all; ``presence`` tells who is there."""
        self._runtime = runtime
        self._synthesizer = synthesizer
        self._presence = presence
        self._search: Search | None = None
        self._was_there = False
        self._timer: Timer | None = None
        presence.add_listener(self._look)
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
            self._watch(None)
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

        def progress(doing: str, seconds: float) -> None:
            goal.publish_feedback(SynthesizeBehavior.Feedback(doing=sendable(doing), seconds=seconds))

        try:
            search = self._synthesizer.begin(_request(goal.request), progress, end)
        except CommandRefusedError as error:
            goal.abort(_refused(str(error)))
        else:
            goal.on_cancel(search.cancel)
            self._watch(search)

    def _watch(self, search: Search | None) -> None:
        self._search = search
        self._was_there = False
        self._stop_timer()
        self._look()

    def _look(self) -> None:
        """Whether the operator who asked is there."""
        search = self._search
        if search is None or not search.request.by:
            return
        if search.request.by in self._presence.present:
            self._was_there = True
            self._stop_timer()
        elif self._was_there and self._timer is None:
            self._timer = self._runtime.post_in(GONE_SECONDS, lambda: self._time_is_over(search))

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_is_over(self, search: Search) -> None:
        operator = search.request.by
        if search is self._search and operator not in self._presence.present:
            search.cancel(f'operator {operator!r}, who asked for it, is gone')


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
