# SPDX-License-Identifier: BSD-3-Clause
"""The action by which FlexBE's editor asks for a synthesis, where the package ``flexbe_msgs`` is installed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import from_plain, resolve_type
from flexbt_core.values import sendable
from flexbt_onboard.errors import CommandRefusedError

from .synthesizer import Answer, SearchRequest, Synthesizer, Verdict

_CODES: Final = {
    Verdict.MADE: 1,
    Verdict.UNREALIZABLE: -21,
    Verdict.WRONG: -2,
    Verdict.CANCELED: -9,
    Verdict.FAULT: -20,
}
"""Error codes of flexbe_synthesis: SUCCESS, SPEC_UNSYNTHESIZABLE, INVALID_REQUEST, PREEMPTED, SYNTHESIS_FAILED."""


def serve_flexbe(runtime: NodeRuntime, synthesizer: Synthesizer, admission: GoalAdmission) -> None:
    """Serve ``flexbe_msgs/BehaviorSynthesis`` where there is such a type; ``admission`` says whether goals are taken at
    all. On the executor thread.

    The states go to the editor, which makes a behavior of them; the executive does not keep the machine. Why there is
    none is told by the last feedback, since the result has no text.
    """
    if importlib.util.find_spec('flexbe_msgs') is None:
        return
    action: Any = importlib.import_module('flexbe_msgs.action').BehaviorSynthesis

    def result(code: int, states: list[Any]) -> Any:
        made = action.Result(states=states)
        made.error_code.value = code
        return made

    def refuse(goal: ServedGoal, why: str, code: int) -> None:
        goal.publish_feedback(action.Feedback(status=sendable(why, 10_000), progress=1.0))
        goal.abort(result(code, []))

    def serve(goal: ServedGoal) -> None:
        def end(answer: Answer) -> None:
            code = _CODES[answer.verdict]
            if answer.verdict is Verdict.MADE:
                states = from_plain(list(answer.states), resolve_type('flexbe_msgs/msg/StateInstantiation[]'))
                goal.succeed(result(code, states))
            elif answer.verdict is Verdict.CANCELED:
                goal.canceled(result(code, []))
            else:
                refuse(goal, '\n'.join([answer.message, *answer.explanation]), code)

        def progress(doing: str, seconds: float) -> None:
            goal.publish_feedback(action.Feedback(status=sendable(doing), progress=0.0))

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
            refuse(goal, str(error), _CODES[Verdict.WRONG])
        else:
            goal.on_cancel(search.cancel)

    GoalServer(
        runtime,
        action,
        names.FLEXBE_SYNTHESIS,
        serve,
        refused=lambda why: result(_CODES[Verdict.WRONG], []),
        admission=admission,
    )
