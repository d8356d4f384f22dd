# SPDX-License-Identifier: BSD-3-Clause
"""How the world prevents a goal, as a sequence diagram."""

from __future__ import annotations

from flexbt_common.pictures import Arrow, Note, SequenceDiagram
from flexbt_formal.requests import happening
from flexbt_formal.synthesis.explanation import Explanation

_MACHINE, _WORLD = 'any machine', 'the world'


def counterstrategy_diagram(title: str, explanation: Explanation) -> SequenceDiagram:
    """The course of events of an explanation; without one, what never becomes possible."""
    steps: list[Arrow | Note] = [Note(_MACHINE, ['These demands conflict:', *explanation.conflict])]
    for step in explanation.steps:
        steps.append(Arrow(_WORLD, _MACHINE, happening(step)))
        others = len(step.choices) - 1
        if step.chosen:
            steps.append(Arrow(_MACHINE, _WORLD, step.chosen))
        if others > 0:
            steps.append(Note(_MACHINE, ['or, in vain as well:', *(one for one in step.choices if one != step.chosen)]))
    end = [*explanation.never, *explanation.stuck]
    if explanation.steps and not explanation.stuck:
        end.append('… and so on for ever; no other answer helps')
    steps.append(Note(_MACHINE, [f'No machine can do that: {explanation.kind.value}', *end], is_wrong=True))
    return SequenceDiagram(title, [_MACHINE, _WORLD], steps)
