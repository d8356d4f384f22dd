# SPDX-License-Identifier: BSD-3-Clause
"""Manifests as YAML: what ``read_skills`` takes."""

from __future__ import annotations

from typing import Any

import yaml

from .library import SkillLibrary
from .literals import BlackboardSensor, ConditionSensor, Predicate, TopicSensor
from .skill import LEVELS, Outcome, Skill


def write_skills(library: SkillLibrary) -> str:
    """The text of a library: read again, it gives the same one."""
    document = {
        'types': dict(library.types),
        'objects': dict(library.objects),
        'predicates': {one.name: predicate_entry(one) for one in library.predicates.values()},
        'skills': {one.name: skill_entry(one) for one in library.skills.values()},
    }
    text: str = yaml.safe_dump(_told(document), sort_keys=False, width=120)
    return text


def predicate_entry(predicate: Predicate) -> dict[str, Any]:
    """A predicate as plain data."""
    sensor: dict[str, Any] = {}
    if isinstance(predicate.sensor, ConditionSensor):
        sensor = _told({'condition': predicate.sensor.id, 'ports': dict(predicate.sensor.ports)})
    elif isinstance(predicate.sensor, TopicSensor):
        sensor = {'topic': predicate.sensor.topic, 'type': predicate.sensor.type, 'test': predicate.sensor.test}
    elif isinstance(predicate.sensor, BlackboardSensor):
        sensor = {'blackboard': predicate.sensor.test}
    return _told({'parameters': dict(predicate.parameters), 'sensor': sensor, 'exclusive': predicate.exclusive})


def skill_entry(skill: Skill) -> dict[str, Any]:
    """A skill as plain data: without what it does not say."""
    least, most = skill.duration
    return _told(
        {
            'parameters': dict(skill.parameters),
            'preconditions': [str(one) for one in skill.preconditions],
            'outcomes': {name: _outcome_entry(one) for name, one in skill.outcomes.items()},
            'resources': list(skill.resources),
            'reads': list(skill.reads),
            'writes': list(skill.writes),
            'cost': None if skill.cost == 1.0 else skill.cost,
            'deadline': skill.deadline,
            'retries': skill.retries,
            'ignores_cancel': skill.ignores_cancel or None,
            'duration': None if skill.duration == (0.0, None) else [least] if most is None else [least, most],
            'arguments': dict(skill.arguments),
        }
    )


def _outcome_entry(outcome: Outcome) -> Any:
    kind = outcome.kind.value if outcome.kind is not None else None
    if kind is not None and not outcome.effects and outcome.autonomy is None:
        return kind
    level = LEVELS[outcome.autonomy].lower() if outcome.autonomy is not None else None
    return _told({'class': kind, 'effects': [str(one) for one in outcome.effects], 'autonomy': level})


def _told(entries: dict[str, Any]) -> dict[str, Any]:
    """The entries that say something."""
    return {name: value for name, value in entries.items() if value is not None and value not in ({}, [])}
