# SPDX-License-Identifier: BSD-3-Clause
"""Skill manifests as YAML files: read, written, and exported as a capability file of flexbe_synthesis.

An example::

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

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import yaml

from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle
from flexbt_core.values.yaml_data import YamlParts, line_of

from .grounding import Grounding, argument_texts
from .library import ANYTHING, At, SkillLibrary
from .literals import (
    BlackboardSensor,
    ConditionSensor,
    Literal,
    Predicate,
    Sensor,
    SkillError,
    TopicSensor,
    parse_literal,
)
from .skill import LEVELS, Outcome, OutcomeClass, Skill, level, outcome_class, usual_outcome_class

_SENSORS: Final = {'condition': ('ports',), 'topic': ('type', 'test'), 'blackboard': ()}


def read_skills(text: str, source: str = '<text>', base: SkillLibrary | None = None) -> SkillLibrary:
    """Return the library that a text describes, added to ``base``.

    For a skill in ``base``, the text replaces the entries that it lists, and cannot add outcomes that the class lacks.
    If the text declares a predicate differently from ``base``, it is another predicate: skills that are only in
    ``base`` lose their literals with it.

    Raises:
        SkillError: the text has problems; the error lists each as ``source:line: problem; remedy``.
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
        if self.problems:  # they would cause further problems of the whole
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
        what = f'predicate {truncate_middle(name)}'
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
        source = self.name(entries[kind], f'{kind} of {what}')
        if kind == 'condition':
            return ConditionSensor(source, self.pairs(entries.get('ports'), f'ports of {what}'))
        if kind == 'blackboard':
            return BlackboardSensor(source)
        for needed in ('type', 'test'):
            if needed not in entries:
                self.problem(node, f'{what} has no {needed}; a topic needs the type of its messages, and a test of one')
                return None
        return TopicSensor(source, self.name(entries['type'], f'type of {what}'), self.name(entries['test'], what))

    # -- skills ------------------------------------------------------------------------------------------------------

    def _skill(self, name: str, node: yaml.Node) -> Skill:
        what = f'skill {truncate_middle(name)}'
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
                self.problem(child, f'{what} has no outcome {short_repr(name)}{did_you_mean(name, known.outcomes)}')
            outcomes[name] = self._outcome(name, child, f'outcome {truncate_middle(name)} of {what}')
        return outcomes

    def _outcome(self, name: str, node: yaml.Node, what: str) -> Outcome:
        usual = usual_outcome_class(name)
        if isinstance(node, yaml.ScalarNode):
            if '(' not in node.value:
                return Outcome(self._class(node, what))
            self.problem(node, f'{what}: effects are a list; write [{truncate_middle(node.value)}]')
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
        """Return a list of literals."""
        found = (self._told(one, partial(self._literal, one, what), what) for one in self.sequence(node, what))
        return tuple(one for one in found if one is not None)

    def _literal(self, node: yaml.Node, what: str) -> Literal:
        return parse_literal(self.name(node, what))

    def number(self, node: yaml.Node, what: str) -> float | None:
        """Return a number."""
        value = self.value(node, what)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.problem(node, f'{what} has to be a number, not {short_repr(value)}')
            return None
        try:
            return float(value)
        except OverflowError:
            self.problem(node, f'{what} is too large')
            return None

    def count(self, node: yaml.Node, what: str) -> int | None:
        """Return a whole number."""
        number = self.number(node, what)
        if number is not None and not number.is_integer():
            self.problem(node, f'{what} has to be a whole number, not {number}')
            return None
        return None if number is None else int(number)

    def span(self, node: yaml.Node, what: str) -> tuple[float, float | None] | None:
        """Return a minimum and an optional maximum time, s."""
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
        """Store the lines of all named entries."""
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
"""Readers of the entries of a skill, except its outcomes."""


def _without(base: SkillLibrary, names: Collection[str]) -> dict[str, Skill]:
    """Return the skills of a library without their literals of these predicates, which the text declares
    differently."""

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
    """Return the types in the parameters of these predicates."""
    return {kind: ANYTHING for name in predicates for kind in base.predicates[name].parameters.values()}


def _shown_place(at: Iterable[str]) -> str:
    first, *others = at
    return ' '.join([first.removesuffix('s') if others else first, *(one[:80] for one in others)])


# Manifests as YAML, in the form that ``read_skills`` reads.


def write_skills(library: SkillLibrary) -> str:
    """Return the text of a library; reading it returns an equal library."""
    document = {
        'types': dict(library.types),
        'objects': dict(library.objects),
        'predicates': {one.name: predicate_entry(one) for one in library.predicates.values()},
        'skills': {one.name: skill_entry(one) for one in library.skills.values()},
    }
    text: str = yaml.safe_dump(_told(document), sort_keys=False, width=120)
    return text


def predicate_entry(predicate: Predicate) -> dict[str, Any]:
    """Return a predicate as plain data."""
    sensor: dict[str, Any] = {}
    if isinstance(predicate.sensor, ConditionSensor):
        sensor = _told({'condition': predicate.sensor.id, 'ports': dict(predicate.sensor.ports)})
    elif isinstance(predicate.sensor, TopicSensor):
        sensor = {'topic': predicate.sensor.topic, 'type': predicate.sensor.type, 'test': predicate.sensor.test}
    elif isinstance(predicate.sensor, BlackboardSensor):
        sensor = {'blackboard': predicate.sensor.test}
    return _told({'parameters': dict(predicate.parameters), 'sensor': sensor, 'exclusive': predicate.exclusive})


def skill_entry(skill: Skill) -> dict[str, Any]:
    """Return a skill as plain data, without undeclared entries."""
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
    """Return the entries that are not empty."""
    return {name: value for name, value in entries.items() if value is not None and value not in ({}, [])}


# Skills of states as a capability file of flexbe_synthesis: one capability for each binding of a skill.
#
# An atom becomes a bit of the memory, ``at(kitchen)`` is ``at_kitchen``; the outcomes of a skill are normalized to
# ``completed`` and ``failure``. Skills that only answer (conditions, the operator) become no capabilities.

_NORMALIZED: Final = {
    OutcomeClass.COMPLETED: 'completed',
    OutcomeClass.FAILED: 'failure',
    OutcomeClass.TIMED_OUT: 'failure',
    OutcomeClass.CANCELED: 'failure',
}


def capability_file(library: SkillLibrary, start: Iterable[Literal], name: str) -> str:
    """Return the capability file of a library of states, named ``name``, for a world in which ``start`` holds.

    Raises:
        SkillError: the format cannot express part of the manifests; each problem has a remedy.
    """
    return _Capabilities(library, tuple(start)).text(name)


class _Capabilities:
    def __init__(self, library: SkillLibrary, start: tuple[Literal, ...]) -> None:
        self._skills = [skill for skill in library.skills.values() if _is_capability(skill)]
        self._start = {one for one in start if one.positive}
        self._grounding = Grounding(library, start, ())
        self._problems: list[str] = []
        self._names: dict[str, str] = {}  # meaning by name

    def text(self, name: str) -> str:
        mappings = self._mappings()
        memory: dict[str, bool] = {}
        capabilities = {}
        for skill in self._skills:
            for binding in self._grounding.bindings(skill):
                entry = self._capability(skill, binding, memory)
                capabilities[self._name('_'.join((skill.name, *binding.values())), str((skill.name, binding)))] = entry
        if not capabilities:
            self._problems.append(self._why_none())
        if self._problems:
            raise SkillError(dict.fromkeys(self._problems))
        document = {
            'name': name,
            'state_outcome_mappings': mappings,
            'sm_outcome_mappings': {'finished': 'finished'},
            'transition_outcomes': ['completed', 'failure'],
            'memory': {'sys_props': memory},
            'capabilities': capabilities,
        }
        text: str = yaml.safe_dump(document, sort_keys=False, width=120)
        return text

    def _why_none(self) -> str:
        if not self._skills:
            return 'no skill brings anything about; name effects of its completed outcome'
        needed = {one.predicate for skill in self._skills for one in skill.preconditions if one.positive}
        lacking = sorted(needed & self._grounding.unchanging - {one.predicate for one in self._start})
        remedy = f'; say what no skill changes, too: {", ".join(lacking)}' if lacking else '; name objects'
        return f'no skill can be carried out from this start{remedy}'

    def _mappings(self) -> dict[str, str]:
        """Return the normalized name of each outcome, which is the same for all states."""
        found: dict[str, str] = {}
        for skill in self._skills:
            for outcome, declared in skill.outcomes.items():
                normalized = _NORMALIZED.get(declared.kind) if declared.kind is not None else None
                if normalized is None:
                    kind = 'has no class' if declared.kind is None else 'is an answer'
                    self._problems.append(
                        f'skill {skill.name}: outcome {outcome!r} {kind}; a capability completes or fails: '
                        'give it the class completed or failed'
                    )
                elif found.setdefault(outcome, normalized) != normalized:
                    self._problems.append(
                        f'skill {skill.name}: outcome {outcome!r} is {normalized}, and {found[outcome]} in another '
                        'skill; a capability file has one meaning for each name: rename one'
                    )
        return found

    def _capability(self, skill: Skill, binding: Mapping[str, str], memory: dict[str, bool]) -> dict[str, Any]:
        def word(literal: Literal) -> str:
            atom = literal.atom
            bit = self._name('_'.join((atom.predicate, *atom.arguments)), str(atom))
            memory[bit] = atom in self._start
            return bit if literal.positive else f'!{bit}'

        effects: dict[str, set[Literal]] = {}
        for outcome, declared in skill.outcomes.items():
            after = self._grounding.effects(declared, binding)
            normalized = _NORMALIZED.get(declared.kind) if declared.kind is not None else None
            if normalized is not None and effects.setdefault(normalized, after) != after:
                self._problems.append(
                    f'skill {skill.name}: outcomes that are {normalized} have other effects than {outcome!r}; a '
                    'capability has one set of them: make it one, or give another class'
                )
        entry = {
            'interface': skill.name,
            'parameters': argument_texts(skill, binding),
            'preconditions': sorted(map(word, self._grounding.conditions(skill, binding))),
            'postconditions': {name: sorted(map(word, after)) for name, after in effects.items() if after},
            'autonomy': {name: one.autonomy for name, one in skill.outcomes.items() if one.autonomy is not None},
            'resources': list(skill.resources),
        }
        return {key: value for key, value in entry.items() if value}

    def _name(self, text: str, meaning: str) -> str:
        """Return a unique name of letters, digits and _; add a problem if it is already used."""
        name = re.sub(r'\W', '_', text, flags=re.ASCII)
        if self._names.setdefault(name, meaning) != meaning:
            self._problems.append(f'{meaning} and {self._names[name]} would both be called {name}; rename an object')
        return name


def _is_capability(skill: Skill) -> bool:
    return any(one.kind is OutcomeClass.COMPLETED and one.effects for one in skill.outcomes.values())
