# SPDX-License-Identifier: BSD-3-Clause
"""A library of skills with the types, objects and predicates that they use, checked as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from string import Template
from types import MappingProxyType
from typing import Final

from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle

from .literals import EQUAL, Immutable, Literal, Predicate, SkillError, is_name, is_object
from .skill import Skill

At = tuple[str, ...]
"""A place in a library: names from the top, such as ('skills', 'OpenDoor', 'preconditions')."""

ANYTHING: Final = 'object'
"""The type of everything."""


_MOST_PROBLEMS: Final = 100


@dataclass(frozen=True, slots=True)
class SkillLibrary(Immutable):
    """Skills by name. Immutable. ``types`` maps each type to its supertype, ``objects`` maps each object to its
    type.

    Raises:
        SkillError: the library has problems; only :meth:`of` checks this.
    """

    skills: Mapping[str, Skill] = field(default_factory=dict)
    predicates: Mapping[str, Predicate] = field(default_factory=dict)
    types: Mapping[str, str] = field(default_factory=dict)
    objects: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ('skills', 'predicates', 'types', 'objects'):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @classmethod
    def of(
        cls,
        skills: Iterable[Skill],
        predicates: Iterable[Predicate] = (),
        *,
        types: Mapping[str, str] | None = None,
        objects: Mapping[str, str] | None = None,
    ) -> SkillLibrary:
        """Return a library of skills, with the predicates that the skills declare and those in
        ``predicates``."""
        library, problems = cls.joined(skills, predicates, types=types, objects=objects)
        if problems:
            raise SkillError(f'{" ".join(at)}: {text}' for at, text in problems)
        return library

    @classmethod
    def joined(
        cls,
        skills: Iterable[Skill],
        predicates: Iterable[Predicate] = (),
        *,
        types: Mapping[str, str] | None = None,
        objects: Mapping[str, str] | None = None,
    ) -> tuple[SkillLibrary, list[tuple[At, str]]]:
        """Return the library and its problems."""
        by_name: dict[str, Skill] = {}
        known: dict[str, Predicate] = {}
        problems: list[tuple[At, str]] = []
        for predicate in predicates:
            _declare(known, predicate, ('predicates', predicate.name), problems)
        for skill in skills:
            if skill.name in by_name:
                problems.append((('skills', skill.name), 'there are two of this name; leave out one of them'))
            by_name[skill.name] = skill
            for predicate in skill.predicates:
                _declare(known, predicate, ('skills', skill.name), problems)
        library = cls(by_name, known, types or {}, objects or {})
        problems += islice(library.problems(), _MOST_PROBLEMS)
        if len(problems) >= _MOST_PROBLEMS:
            problems.append((problems[-1][0], 'there are too many problems to show; mend these first'))
        return library, problems

    def is_kind_of(self, type: str, wanted: str) -> bool:
        """Return whether ``type`` is ``wanted`` or a kind of it."""
        seen: set[str] = set()
        while type not in seen:
            if wanted in (type, ANYTHING):
                return True
            seen.add(type)
            type = self.types.get(type, ANYTHING)
        return False

    def objects_of(self, type: str) -> list[str]:
        """Return the objects of a type, in order of declaration."""
        return [name for name, own in self.objects.items() if self.is_kind_of(own, type)]

    # -- problems ----------------------------------------------------------------------------------------------------

    def problems(self) -> Iterator[tuple[At, str]]:
        """Yield each problem, with its place."""
        known = {ANYTHING, *self.types, *self.types.values()}
        known |= {kind for predicate in self.predicates.values() for kind in predicate.parameters.values()}
        yield from self._of_types()
        for name, kind in self.objects.items():
            if not is_object(name):
                yield ('objects', name), f'{short_repr(name)} cannot name an object: letters, digits and _.:/@-'
            if kind not in known:
                remedy = (
                    f'; one that no predicate takes has to be named: types: {{{truncate_middle(kind)}: {ANYTHING}}}'
                )
                yield ('objects', name), f'{short_repr(kind)} is not a type{did_you_mean(kind, known)}{remedy}'
        for predicate in self.predicates.values():
            at = ('predicates', predicate.name)
            yield from ((at, problem) for problem in predicate.problems())
            yield from ((at, problem) for problem in _names(predicate.parameters))
        for skill in self.skills.values():
            at = ('skills', skill.name)
            yield from (((*at, *where), problem) for where, problem in skill.problems())
            yield from (((*at, 'parameters'), problem) for problem in _names(skill.parameters))
            for name, kind in skill.parameters.items():
                if kind not in known:
                    yield (*at, 'parameters', name), f'{short_repr(kind)} is not a type{did_you_mean(kind, known)}'
            yield from self._of_arguments(skill, (*at, 'arguments'))
            for literal in skill.preconditions:
                yield from (((*at, 'preconditions'), text) for text in self.problems_of(literal, skill.parameters))
            yield from (((*at, 'preconditions'), problem) for problem in self._at_once(skill))
            for name, outcome in skill.outcomes.items():
                for literal in outcome.effects:
                    where = (*at, 'outcomes', name)
                    if literal.predicate == EQUAL:
                        yield where, f'{literal} cannot be an effect: no skill makes two objects one'
                    yield from ((where, text) for text in self.problems_of(literal, skill.parameters))

    def _of_types(self) -> Iterator[tuple[At, str]]:
        for start in self.types:
            seen = [start]
            while (above := self.types.get(seen[-1], ANYTHING)) != ANYTHING:
                if above == start:
                    yield ('types', start), f'it is a kind of itself: {" > ".join([*seen, start])}'
                if above in seen:
                    break
                seen.append(above)

    def _of_arguments(self, skill: Skill, at: At) -> Iterator[tuple[At, str]]:
        for port, text in skill.arguments.items():
            template = Template(text)
            if not template.is_valid():
                yield (*at, port), f'{short_repr(text)} has a $ without a name; write $$ for the character'
            for name in template.get_identifiers():
                if name not in skill.parameters:
                    yield (
                        (*at, port),
                        f'${name} in {short_repr(text)} is not a parameter of the skill{_of(skill.parameters)}',
                    )

    def _at_once(self, skill: Skill) -> Iterator[str]:
        """Yield problems of preconditions that cannot hold at once: exclusive predicates of different objects."""
        different = {
            frozenset(one.arguments) for one in skill.preconditions if one.predicate == EQUAL and not one.positive
        }
        for one, other in clashes(self, skill.preconditions):
            both = zip(one.arguments, other.arguments, strict=False)
            pair = frozenset(name for names in both if names[0] != names[1] for name in names)
            if pair and (pair in different or pair.isdisjoint(skill.parameters)):
                yield (
                    f'{one} and {other} cannot hold at once ({one.predicate} is exclusive), so it is never done; '
                    'leave out one of them'
                )

    def problems_of(self, literal: Literal, parameters: Mapping[str, str] = MappingProxyType({})) -> Iterator[str]:
        """Yield the problems of a literal of objects and of ``parameters`` (names with types)."""
        if literal.predicate == EQUAL:
            wanted: list[str] = [ANYTHING, ANYTHING]
        elif literal.predicate in self.predicates:
            wanted = list(self.predicates[literal.predicate].parameters.values())
        else:
            missing = literal.predicate
            yield f'{literal}: there is no predicate {short_repr(missing)}{did_you_mean(missing, self.predicates)}'
            return
        if len(literal.arguments) != len(wanted):
            yield f'{literal}: {literal.predicate} has {len(wanted)} arguments ({", ".join(wanted)})'
            return
        for argument, kind in zip(literal.arguments, wanted, strict=True):
            own = parameters.get(argument) or self.objects.get(argument)
            if own is None:
                known = [*parameters, *self.objects]
                what = 'neither a parameter nor an object' if parameters else 'not an object'
                yield f'{literal}: {short_repr(argument)} is {what}{did_you_mean(argument, known)}'
            elif not self.is_kind_of(own, kind):
                yield f'{literal}: {argument} is of the type {own}, and {literal.predicate} takes {kind}'


def clashes(library: SkillLibrary, literals: Iterable[Literal]) -> Iterator[tuple[Literal, Literal]]:
    """Yield pairs of literals that cannot hold at once, since their predicate is exclusive in a parameter."""
    first: dict[tuple[str, tuple[str, ...], tuple[str, ...]], Literal] = {}
    for one in literals:
        predicate = library.predicates.get(one.predicate)
        exclusive = predicate.exclusive if predicate is not None else None
        if one.positive and predicate is not None and exclusive is not None and exclusive in predicate.parameters:
            place = list(predicate.parameters).index(exclusive)
            other = first.setdefault((one.predicate, one.arguments[:place], one.arguments[place + 1 :]), one)
            if other != one:
                yield other, one


def _declare(known: dict[str, Predicate], predicate: Predicate, at: At, problems: list[tuple[At, str]]) -> None:
    if known.setdefault(predicate.name, predicate) != predicate:
        problems.append((at, f'the predicate {predicate.name} is declared twice, and differently; declare it once'))


def _names(parameters: Iterable[str]) -> Iterator[str]:
    for name in parameters:
        if not is_name(name):
            yield f'{short_repr(name)} cannot name a parameter: letters, digits and _, a letter first'


def _of(parameters: Mapping[str, str]) -> str:
    return f'; it has {", ".join(parameters)}' if parameters else '; it has none'
