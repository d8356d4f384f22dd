# SPDX-License-Identifier: BSD-3-Clause
"""Skills as text for people."""

from __future__ import annotations

from collections.abc import Iterator

from flexbt_core.skills import LEVELS, Outcome, Skill


def skill_lines(skill: Skill) -> Iterator[str]:
    """A skill: its name with its parameters, and one line for each thing that is known of it."""
    parameters = ', '.join(f'{name}: {kind}' for name, kind in skill.parameters.items())
    yield f'{skill.name}({parameters})' if parameters else skill.name
    told = {
        'needs': ', '.join(map(str, skill.preconditions)),
        'resources': ', '.join(skill.resources),
        'reads': ', '.join(skill.reads),
        'writes': ', '.join(skill.writes),
        'takes': _span(skill),
        'deadline': f'{skill.deadline:g} s' if skill.deadline is not None else '',
        'retries': f'{skill.retries}' if skill.retries is not None else '',
        'cost': f'{skill.cost:g}' if skill.cost != 1.0 else '',
        'cancel': 'what it has begun goes on' if skill.ignores_cancel else '',
    }
    yield from (f'  {name}: {text}' for name, text in told.items() if text)
    for name, outcome in skill.outcomes.items():
        yield f'  {name}: {_outcome(outcome)}'


def _span(skill: Skill) -> str:
    least, most = skill.duration
    if most == 0.0:
        return 'no time'
    if most is None:
        return f'{least:g} s or more' if least else ''
    return f'{least:g} to {most:g} s'


def _outcome(outcome: Outcome) -> str:
    kind = outcome.kind.value.replace('_', ' ') if outcome.kind is not None else 'of no class'
    effects = f', then {", ".join(map(str, outcome.effects))}' if outcome.effects else ''
    return f'{kind}{effects}{f"; autonomy {LEVELS[outcome.autonomy]}" if outcome.autonomy is not None else ""}'
