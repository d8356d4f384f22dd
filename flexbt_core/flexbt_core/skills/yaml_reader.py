# SPDX-License-Identifier: BSD-3-Clause
"""Manifests as YAML: for classes that are somebody else's, and for missions with their objects. ::

types: {cup: thing}
objects: {kitchen: place, office: place, mug: cup}
predicates:
  at: {parameters: {where: place}, exclusive: where, sensor: {condition: GoalReached, ports: {goal: '{$where}'}}}
  holding:
    parameters: {what: thing}
    sensor: {topic: gripper, type: std_msgs/msg/String, test: data == '$what'}
  charged: {sensor: {blackboard: battery_level > 0.2}}
skills:
  GoTo:
    parameters: {from: place, to: place}
    preconditions: [at(from), from != to, charged]
    outcomes:
      SUCCESS: [at(to)]                                          # completed, with these effects
      FAILURE: {class: failed, effects: [not at(from)], autonomy: low}
    resources: [base]
    cost: 15.0
    deadline: 120.0
    retries: 2
    duration: [1.0, 120.0]
    arguments: {goal: '{$to}'}
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import yaml

from flexbt_core.values import YamlParts, excerpt, hint, line_of, shown

from .errors import SkillError
from .library import ANYTHING, At, SkillLibrary
from .literals import BlackboardSensor, ConditionSensor, Literal, Predicate, Sensor, TopicSensor, parse_literal
from .skill import Outcome, OutcomeClass, Skill, class_of, level, outcome_class

_SENSORS: Final = {'condition': ('ports',), 'topic': ('type', 'test'), 'blackboard': ()}


def read_skills(text: str, source: str = '<text>', base: SkillLibrary | None = None) -> SkillLibrary:
    """The library that a text describes, with all that ``base`` has.

    Of a skill that ``base`` has, the text replaces what it names, and cannot speak of outcomes that the class does not
    have. A predicate that the text declares otherwise than ``base`` is another one: skills of ``base`` of which the
    text does not speak say nothing by it.

    Raises:
        SkillError: with everything that is wrong, each as ``source:line: what; what to do``.
    """
    reader = _Reader(source, base if base is not None else SkillLibrary())
    library = reader.read(text)
    if reader.problems:
        raise SkillError(dict.fromkeys(reader.problems))
    return library


class _Reader(YamlParts):
    def __init__(self, source: str, base: SkillLibrary) -> None:
        super().__init__(source)
        self._base = base
        self._lines: dict[At, int] = {(): 1}

    def read(self, text: str) -> SkillLibrary:
        root = self.root(text)
        self._note(root, ())
        entries = self.mapping(root, 'the text')
        self.refuse_others(entries, ('types', 'objects', 'predicates', 'skills'), 'the text')
        base = self._base
        own = {name: self.pairs(entries.get(name), name) for name in ('types', 'objects')}
        predicates = [
            self._predicate(name, node) for name, node in self.mapping(entries.get('predicates'), 'predicates').items()
        ]
        skills = [self._skill(name, node) for name, node in self.mapping(entries.get('skills'), 'skills').items()]
        if self.problems:  # what is wrong as a whole would follow from that
            return base
        others = {one.name for one in predicates if base.predicates.get(one.name, one) != one}
        merged = {**_without(base, others), **{one.name: one for one in skills}}
        library, problems = SkillLibrary.joined(
            (replace(one, predicates=()) for one in merged.values()),
            {**base.predicates, **{one.name: one for one in predicates}}.values(),
            types={**_types(base, others), **base.types, **own['types']},
            objects={**base.objects, **own['objects']},
        )
        self.problems += [f'{self.source}:{self._line(at)}: {_shown_place(at)}: {text}' for at, text in problems]
        return library

    # -- predicates --------------------------------------------------------------------------------------------------

    def _predicate(self, name: str, node: yaml.Node) -> Predicate:
        what = f'predicate {excerpt(name)}'
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('parameters', 'sensor', 'exclusive'), what)
        exclusive = self.name(entries['exclusive'], f'exclusive of {what}') if 'exclusive' in entries else None
        sensor = self._sensor(entries['sensor'], f'sensor of {what}') if 'sensor' in entries else None
        return Predicate(name, self.pairs(entries.get('parameters'), f'parameters of {what}'), sensor, exclusive)

    def _sensor(self, node: yaml.Node, what: str) -> Sensor | None:
        entries = self.mapping(node, what)
        kinds = [kind for kind in _SENSORS if kind in entries]
        if len(kinds) != 1:
            self.problem(node, f'{what} has to have one of {", ".join(_SENSORS)}')
            return None
        kind = kinds[0]
        self.refuse_others(entries, (kind, *_SENSORS[kind]), what)
        told = self.name(entries[kind], f'{kind} of {what}')
        if kind == 'condition':
            return ConditionSensor(told, self.pairs(entries.get('ports'), f'ports of {what}'))
        if kind == 'blackboard':
            return BlackboardSensor(told)
        for needed in ('type', 'test'):
            if needed not in entries:
                self.problem(node, f'{what} has no {needed}; a topic needs the type of its messages, and a test of one')
                return None
        return TopicSensor(told, self.name(entries['type'], f'type of {what}'), self.name(entries['test'], what))

    # -- skills ------------------------------------------------------------------------------------------------------

    def _skill(self, name: str, node: yaml.Node) -> Skill:
        what = f'skill {excerpt(name)}'
        entries = self.mapping(node, what)
        known = self._base.skills.get(name)
        given: dict[str, Any] = {}
        for key, child in entries.items():
            read = _FIELDS.get(key)
            if read is not None:
                given[key] = read(self, child, f'{key} of {what}')
        self.refuse_others(entries, [*_FIELDS, 'outcomes'], what)
        if 'outcomes' in entries:
            given['outcomes'] = self._outcomes(entries['outcomes'], what, known)
        skill = known if known is not None else Skill(name)
        return replace(skill, **{key: value for key, value in given.items() if value is not None})

    def _outcomes(self, node: yaml.Node, what: str, known: Skill | None) -> dict[str, Outcome]:
        outcomes = dict(known.outcomes) if known is not None else {}
        for name, child in self.mapping(node, f'outcomes of {what}').items():
            if known is not None and known.outcomes and name not in known.outcomes:
                self.problem(child, f'{what} has no outcome {shown(name)}{hint(name, known.outcomes)}')
            outcomes[name] = self._outcome(name, child, f'outcome {excerpt(name)} of {what}')
        return outcomes

    def _outcome(self, name: str, node: yaml.Node, what: str) -> Outcome:
        usual = class_of(name)
        if isinstance(node, yaml.ScalarNode):
            if '(' not in node.value:
                return Outcome(self._class(node, what))
            self.problem(node, f'{what}: effects are a list; write [{excerpt(node.value)}]')
            return Outcome(usual)
        if isinstance(node, yaml.SequenceNode):
            return Outcome(usual or OutcomeClass.COMPLETED, self.literals(node, f'effects of {what}'))
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('class', 'effects', 'autonomy'), what)
        kind = self._class(entries['class'], f'class of {what}') if 'class' in entries else usual
        effects = self.literals(entries['effects'], f'effects of {what}') if 'effects' in entries else ()
        return Outcome(kind, effects, self._level(entries['autonomy'], what) if 'autonomy' in entries else None)

    def _class(self, node: yaml.Node, what: str) -> OutcomeClass | None:
        return self._told(node, lambda: outcome_class(self.name(node, what)), what)

    def _level(self, node: yaml.Node, what: str) -> int | None:
        return self._told(node, lambda: level(self.name(node, what)), f'autonomy of {what}')

    # -- the parts of a manifest -------------------------------------------------------------------------------------

    def literals(self, node: yaml.Node, what: str) -> tuple[Literal, ...]:
        """A list of literals."""
        found = (self._told(one, partial(self._literal, one, what), what) for one in self.sequence(node, what))
        return tuple(one for one in found if one is not None)

    def _literal(self, node: yaml.Node, what: str) -> Literal:
        return parse_literal(self.name(node, what))

    def number(self, node: yaml.Node, what: str) -> float | None:
        """A number."""
        value = self.value(node, what)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.problem(node, f'{what} has to be a number, not {shown(value)}')
            return None
        try:
            return float(value)
        except OverflowError:
            self.problem(node, f'{what} is too large')
            return None

    def count(self, node: yaml.Node, what: str) -> int | None:
        """A whole number."""
        number = self.number(node, what)
        if number is not None and not number.is_integer():
            self.problem(node, f'{what} has to be a whole number, not {number}')
            return None
        return None if number is None else int(number)

    def truth(self, node: yaml.Node, what: str) -> bool | None:
        """Whether something is so."""
        value = self.value(node, what)
        if not isinstance(value, bool):
            self.problem(node, f'{what} has to be true or false, not {shown(value)}')
            return None
        return value

    def span(self, node: yaml.Node, what: str) -> tuple[float, float | None] | None:
        """A least and a greatest time; the greatest may be left out."""
        parts = self.sequence(node, what)
        numbers = [self.number(one, what) for one in parts]
        if len(numbers) not in (1, 2):
            self.problem(node, f'{what} has to be [least] or [least, greatest], s')
            return None
        least = numbers[0]
        return None if least is None else (least, numbers[1] if len(numbers) == 2 else None)

    def _told(self, node: yaml.Node, read: Any, what: str) -> Any:
        try:
            return read()
        except SkillError as error:
            self.problem(node, f'{what}: {error}')
            return None

    # -- places ------------------------------------------------------------------------------------------------------

    def _note(self, node: yaml.Node | None, at: At) -> None:
        """Remembers the lines of everything that has a name."""
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if isinstance(key, yaml.ScalarNode):
                    self._lines[*at, key.value] = line_of(key)
                    self._note(value, (*at, key.value))

    def _line(self, at: At) -> int:
        while at not in self._lines:
            at = at[:-1]
        return self._lines[at]


_FIELDS: Final[dict[str, Any]] = {
    'parameters': _Reader.pairs,
    'preconditions': _Reader.literals,
    'resources': _Reader.names,
    'reads': _Reader.names,
    'writes': _Reader.names,
    'cost': _Reader.number,
    'deadline': _Reader.number,
    'retries': _Reader.count,
    'ignores_cancel': _Reader.truth,
    'duration': _Reader.span,
    'arguments': _Reader.pairs,
}
"""How each entry of a skill but its outcomes is read."""


def _without(base: SkillLibrary, names: Collection[str]) -> dict[str, Skill]:
    """The skills of a library, without what they say by predicates of these names: the text means others by them."""

    def kept(literals: Iterable[Literal]) -> tuple[Literal, ...]:
        return tuple(one for one in literals if one.predicate not in names)

    return {
        name: replace(
            skill,
            preconditions=kept(skill.preconditions),
            outcomes={key: replace(one, effects=kept(one.effects)) for key, one in skill.outcomes.items()},
        )
        for name, skill in base.skills.items()
    }


def _types(base: SkillLibrary, predicates: Collection[str]) -> dict[str, str]:
    """The types that a library knows by these predicates."""
    return {kind: ANYTHING for name in predicates for kind in base.predicates[name].parameters.values()}


def _shown_place(at: Iterable[str]) -> str:
    first, *others = at
    return ' '.join([first.removesuffix('s') if others else first, *(one[:80] for one in others)])
