# SPDX-License-Identifier: BSD-3-Clause
"""Whether what skills name is there: the condition leaves of sensors, and the ports that are given."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from string import Template

from flexbt_core.behavior_tree import NodeRegistry, ScriptError
from flexbt_core.behavior_tree.script import parse_script
from flexbt_core.skills import ConditionSensor, Predicate, SkillLibrary
from flexbt_core.values import hint, shown


def unknown_names(library: SkillLibrary, base: SkillLibrary, registry: NodeRegistry) -> Iterator[str]:
    """What a library names beyond those of ``base`` and is not there, as lines for people.

    A class that is no leaf of this computer is known when the library has a skill of it.
    """
    conditions = {manifest.id for manifest in registry if manifest.kind.value == 'Condition'}
    for predicate in library.predicates.values():
        sensor = predicate.sensor
        if predicate == base.predicates.get(predicate.name):
            continue
        if sensor is None:
            yield f'predicate {predicate.name} has no sensor: it is only remembered, so no tree can test it'
        elif isinstance(sensor, ConditionSensor):
            yield from _unknown_ports(sensor.id, sensor.ports, registry, f'sensor of predicate {predicate.name}')
            if sensor.id not in registry and sensor.id not in library.skills:
                near = hint(sensor.id, conditions)
                yield f'sensor of predicate {predicate.name}: there is no leaf {shown(sensor.id)}{near}'
        else:
            yield from _wrong_script(predicate, sensor.test)
    for skill in library.skills.values():
        if skill != base.skills.get(skill.name):
            yield from _unknown_ports(skill.name, skill.arguments, registry, f'arguments of skill {skill.name}')


def _wrong_script(predicate: Predicate, test: str) -> Iterator[str]:
    try:
        parse_script(Template(test).safe_substitute(dict.fromkeys(predicate.parameters, 'x')))
    except ScriptError as error:
        yield f'sensor of predicate {predicate.name}: {shown(test)} is no script: {error}'


def unreached_ports(library: SkillLibrary, base: SkillLibrary, registry: NodeRegistry) -> Iterator[str]:
    """Of skills that are not as in ``base``: an installed leaf has the name, but learns of none of the parameters."""
    for skill in library.skills.values():
        manifest = registry.get(skill.name)
        if manifest is None or not manifest.ports or not skill.parameters:
            continue
        if skill.name in base.skills and skill.parameters == base.skills[skill.name].parameters:
            continue
        told = {name for text in skill.arguments.values() for name in Template(text).get_identifiers()}
        if skill.parameters.keys().isdisjoint(told | manifest.ports.keys()):
            yield (
                f'skill {skill.name}: the installed leaf of this name learns of no parameter '
                f'({", ".join(skill.parameters)}); say how by arguments (its ports: {", ".join(manifest.ports)}), '
                'or give the skill another name if another leaf is meant'
            )


def _unknown_ports(id: str, ports: Iterable[str], registry: NodeRegistry, what: str) -> Iterator[str]:
    manifest = registry.get(id)
    if manifest is not None:
        for name in ports:
            if name not in manifest.ports:
                yield f'{what}: {id} has no port {shown(name)}{hint(name, manifest.ports)}'
