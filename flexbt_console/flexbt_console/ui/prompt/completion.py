# SPDX-License-Identifier: BSD-3-Clause
"""What may come next on the line that is being typed."""

from __future__ import annotations

from collections.abc import Mapping

from flexbt_console.commands.command_table import COMMANDS
from flexbt_console.commands.operator_values import Place, is_pose
from flexbt_console.mirror import View, choices
from flexbt_console.mirror.records import AutonomyLevel, DecisionKind


def candidates(text: str, view: View, places: Mapping[str, Place]) -> list[str]:
    """Words that complete the last word of ``text`` (the line up to the cursor), the likely ones first.

    Only plain printable words: what the robot sends must not be typed for the operator otherwise.
    """
    words = text.split(' ')
    last, before = words[-1], [word for word in words[:-1] if word]
    if not before:
        known = [*_answers(view, places), *(spec.name for spec in COMMANDS if spec.in_prompt), 'help', 'quit']
    else:
        known = _arguments(before, view, places)
    fitting = [word for word in dict.fromkeys(known) if word.startswith(last)]
    return [word for word in fitting if word.isprintable() and ' ' not in word]


def _answers(view: View, places: Mapping[str, Place]) -> list[str]:
    decision = view.decision
    if decision is None:
        return []
    options = list(choices(decision))
    if decision.kind is DecisionKind.INPUT and not options and is_pose(decision.input_type):
        return sorted(places)
    return options


def _arguments(before: list[str], view: View, places: Mapping[str, Place]) -> list[str]:
    name, *given = before
    behaviors = view.behaviors or ()
    if name in ('start', 'switch') and not given:
        return [behavior.name for behavior in behaviors if not behavior.error]
    if name == 'start':
        chosen = next((behavior for behavior in behaviors if behavior.name == given[0]), None)
        if before[-1] == '--autonomy':
            return [level.name.lower() for level in AutonomyLevel]
        parameters = chosen.parameters if chosen else ()
        return [*(f'{parameter.name}=' for parameter in parameters), '--autonomy', '--input']
    if name == 'autonomy' and not given:
        return [level.name.lower() for level in AutonomyLevel]
    if name == 'force' and not given:
        waiting = view.decision.outcomes if view.decision else ()
        single = view.outcomes(view.active_paths[0]) if len(view.active_paths) == 1 else ()
        return [*waiting, *single, *view.active_levels]
    if name == 'force':
        return list(view.outcomes(given[0]))
    if name in ('autonomy', 'lock', 'breakpoint'):
        return [state.path for state in view.structure.states] if view.structure else list(view.active_levels)
    if name in ('unlock', 'clear') and view.snapshot is not None:
        return list(view.snapshot.locked if name == 'unlock' else view.snapshot.breakpoints)
    if name == 'repeat':
        return list(view.active_levels)
    if name == 'input':
        return _answers(view, places)
    if name in ('confirm', 'decline'):
        return [decision.id for decision in view.decisions]
    if name == 'help':
        return [spec.name for spec in COMMANDS if spec.in_prompt]
    return []
