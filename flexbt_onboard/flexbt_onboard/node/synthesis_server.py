# SPDX-License-Identifier: BSD-3-Clause
"""Actions that synthesize a behavior from capabilities while another one runs: FlexBT's and that of FlexBE's editor."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.value_types import from_plain, resolve_type
from flexbt_core.clock.clock import Timer
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_onboard.errors import CommandRefusedError

from .synthesizer import RunningSearch, SearchRequest, SynthesisAnswer, SynthesisVerdict, Synthesizer

Goal, Result = SynthesizeBehavior.Goal, SynthesizeBehavior.Result

LIVENESS: Final = {Goal.FAIR: 'fair', Goal.ADVERSARIAL: 'adversarial', Goal.FAIR_OUTCOMES: 'fair-outcomes'}
_CODES: Final = {
    SynthesisVerdict.MADE: Result.SUCCESS,
    SynthesisVerdict.UNREALIZABLE: Result.UNREALIZABLE,
    SynthesisVerdict.WRONG: Result.FAILURE,
    SynthesisVerdict.CANCELED: Result.CANCELED,
    SynthesisVerdict.FAULT: Result.ERROR,
}
_LINES: Final = 1000

GONE_SECONDS: Final = 10.0
"""Time for which the operator who asked may be disconnected, s. A short failure of the link does not end the search."""


class SynthesisServer:
    """The server of SynthesizeBehavior. Used on the executor thread.

    Only one search runs at a time. So that an abandoned search does not block others, it is canceled after the operator
    who asked for it has disconnected. For searches of programs, which do not connect as operators, only the time limit
    applies.
    """

    def __init__(
        self, runtime: Runtime, synthesizer: Synthesizer, admission: GoalAdmission, presence: PresenceWatch
    ) -> None:
        """``admission`` decides whether the server takes goals; ``presence`` reports the connected operators."""
        self._runtime = runtime
        self._synthesizer = synthesizer
        self._presence = presence
        self._search: RunningSearch | None = None
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
        def end(answer: SynthesisAnswer) -> None:
            self._watch(None)
            result = Result(
                code=_CODES[answer.verdict],
                message=sanitize_for_message(answer.message),
                behavior=answer.behavior,
                machine=sanitize_for_message(answer.machine),
                notes=_sendable_lines(answer.notes),
                explanation=_sendable_lines(answer.explanation),
            )
            if answer.verdict is SynthesisVerdict.CANCELED:
                goal.canceled(result)
            else:
                (goal.succeed if answer.verdict is SynthesisVerdict.MADE else goal.abort)(result)

        def progress(doing: str, seconds: float) -> None:
            goal.publish_feedback(SynthesizeBehavior.Feedback(doing=sanitize_for_message(doing), seconds=seconds))

        try:
            search = self._synthesizer.begin(_request(goal.request), progress, end)
        except CommandRefusedError as error:
            goal.abort(_refused(str(error)))
        else:
            goal.on_cancel(search.cancel)
            self._watch(search)

    def _watch(self, search: RunningSearch | None) -> None:
        self._search = search
        self._was_there = False
        self._stop_timer()
        self._look()

    def _look(self) -> None:
        """Check whether the operator who asked is still connected."""
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

    def _time_is_over(self, search: RunningSearch) -> None:
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
    return [sanitize_for_message(text, 1000) for text in texts[:_LINES]]


def _refused(why: str) -> Any:
    return Result(code=Result.FAILURE, message=why)


# The action by which FlexBE's editor requests a synthesis, if the package ``flexbe_msgs`` is installed.

_FLEXBE_CODES: Final = {
    SynthesisVerdict.MADE: 1,
    SynthesisVerdict.UNREALIZABLE: -21,
    SynthesisVerdict.WRONG: -2,
    SynthesisVerdict.CANCELED: -9,
    SynthesisVerdict.FAULT: -20,
}
"""Error codes of flexbe_synthesis: SUCCESS, SPEC_UNSYNTHESIZABLE, INVALID_REQUEST, PREEMPTED, SYNTHESIS_FAILED."""


def serve_flexbe(runtime: Runtime, synthesizer: Synthesizer, admission: GoalAdmission) -> None:
    """Serve ``flexbe_msgs/BehaviorSynthesis`` if this type is installed. On the executor thread.

    ``admission`` decides whether the server takes goals at all. The editor gets the states and makes a behavior from
    them; the executive does not store the machine. If the synthesis fails, the last feedback has the reason, since the
    result has no text.
    """
    if importlib.util.find_spec('flexbe_msgs') is None:
        return
    action: Any = importlib.import_module('flexbe_msgs.action').BehaviorSynthesis

    def result(code: int, states: list[Any]) -> Any:
        made = action.Result(states=states)
        made.error_code.value = code
        return made

    def refuse(goal: ServedGoal, why: str, code: int) -> None:
        goal.publish_feedback(action.Feedback(status=sanitize_for_message(why, 10_000), progress=1.0))
        goal.abort(result(code, []))

    def serve(goal: ServedGoal) -> None:
        def end(answer: SynthesisAnswer) -> None:
            code = _FLEXBE_CODES[answer.verdict]
            if answer.verdict is SynthesisVerdict.MADE:
                states = from_plain(list(answer.states), resolve_type('flexbe_msgs/msg/StateInstantiation[]'))
                goal.succeed(result(code, states))
            elif answer.verdict is SynthesisVerdict.CANCELED:
                goal.canceled(result(code, []))
            else:
                refuse(goal, '\n'.join([answer.message, *answer.explanation]), code)

        def progress(doing: str, seconds: float) -> None:
            goal.publish_feedback(action.Feedback(status=sanitize_for_message(doing), progress=0.0))

        asked = goal.request.request
        request = SearchRequest(
            system=asked.system,
            goals=[asked.goal] if asked.goal else [],
            initial_conditions=[asked.initial_condition] if asked.initial_condition else [],
            outcomes=list(asked.sm_outcomes),
            name=asked.name,
            by=f'action {names.FLEXBE_SYNTHESIS}',
            is_kept=False,
        )
        try:
            search = synthesizer.begin(request, progress, end)
        except CommandRefusedError as error:
            refuse(goal, str(error), _FLEXBE_CODES[SynthesisVerdict.WRONG])
        else:
            goal.on_cancel(search.cancel)

    GoalServer(
        runtime,
        action,
        names.FLEXBE_SYNTHESIS,
        serve,
        refused=lambda why: result(_FLEXBE_CODES[SynthesisVerdict.WRONG], []),
        admission=admission,
    )
