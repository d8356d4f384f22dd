# SPDX-License-Identifier: BSD-3-Clause
"""Predicates with typed arguments, the sensors that measure them, and literals over variables or objects."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from string import Template
from types import MappingProxyType
from typing import Final, Self

from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr


class SkillError(FlexbtError):
    """Manifests cannot be used. ``problems`` lists all problems, as ``place: problem; remedy``."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems: tuple[str, ...] = tuple(problems)
        super().__init__('\n'.join(self.problems))


# Predicates with typed arguments, their sensors, and literals: predicates of variables or objects.

EQUAL: Final = '='
"""The built-in predicate of every library: both arguments are the same object."""

_NAME: Final = r'[A-Za-z_][A-Za-z0-9_]*'
_TERM: Final = r'\w[\w.:/@-]*'
_LITERAL: Final = re.compile(rf'\s*(not\s+|!\s*)?({_NAME})\s*(?:\(([^()]*)\))?\s*')
_EQUALITY: Final = re.compile(rf'\s*({_TERM})\s*(!=|=)\s*({_TERM})\s*')
_LONGEST: Final = 1000
"""Maximum length of a literal, characters; those of a plan have some tens."""


def is_name(text: str) -> bool:
    """Return whether a text can name a predicate, type, parameter or outcome."""
    return len(text) <= _LONGEST and re.fullmatch(_NAME, text) is not None


def is_object(text: str) -> bool:
    """Return whether a text can name an object."""
    return len(text) <= _LONGEST and re.fullmatch(_TERM, text) is not None


@dataclass(frozen=True, slots=True)
class Literal:
    """A predicate of arguments, or its negation: ``at(robot, place)``, ``not open(door)``, ``from != to``.

    An argument is a parameter of the skill or an object.
    """

    predicate: str
    arguments: tuple[str, ...] = ()
    positive: bool = True

    @property
    def atom(self) -> Literal:
        """The literal without ``not``."""
        return self if self.positive else Literal(self.predicate, self.arguments)

    def __invert__(self) -> Literal:
        return Literal(self.predicate, self.arguments, not self.positive)

    def bound(self, binding: Mapping[str, str]) -> Literal:
        """Return the literal with parameters replaced by objects; names that are not in ``binding`` stay."""
        return Literal(self.predicate, tuple(binding.get(one, one) for one in self.arguments), self.positive)

    def __str__(self) -> str:
        if self.predicate == EQUAL:
            return f'{self.arguments[0]} {"=" if self.positive else "!="} {self.arguments[1]}'
        arguments = f'({", ".join(self.arguments)})' if self.arguments else ''
        return f'{"" if self.positive else "not "}{self.predicate}{arguments}'


def parse_literal(text: str, place: str = '') -> Literal:
    """Parse a literal.

    Raises:
        SkillError: the text is not a literal. The error names the ``place``.
    """
    if len(text) <= _LONGEST:
        equality = _EQUALITY.fullmatch(text)
        if equality is not None:
            return Literal(EQUAL, (equality[1], equality[3]), equality[2] == '=')
        found = _LITERAL.fullmatch(text)
        if found is not None and found[2] != 'not':
            arguments = tuple(one.strip() for one in found[3].split(',')) if (found[3] or '').strip() else ()
            if all(map(is_object, arguments)):
                return Literal(found[2], arguments, found[1] is None)
    split = text.count('(') != text.count(')')
    remedy = (
        'in [ ] one with a comma has to be in quotes' if split else 'such as at(robot, place), not open(door), a != b'
    )
    raise SkillError([f'{place and place + ": "}{short_repr(text)} is not a literal; {remedy}'])


def parse_literals(texts: Iterable[str | Literal]) -> tuple[Literal, ...]:
    """Parse literals. Raises SkillError."""
    return tuple(one if isinstance(one, Literal) else parse_literal(one) for one in texts)


class Immutable:
    """A base for immutable objects, whose copy is the object itself: copied states keep their skills."""

    __slots__ = ()

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self


@dataclass(frozen=True, slots=True)
class ConditionSensor(Immutable):
    """A sensor that uses a condition: a leaf that succeeds or fails, or a state with outcomes true and false.

    ``ports`` are the ports of the leaf, or the parameters of the state; ``$name`` is replaced by an argument.
    """

    id: str
    ports: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'ports', MappingProxyType(dict(self.ports)))

    @property
    def texts(self) -> tuple[str, ...]:
        """Everything in which arguments may stand."""
        return tuple(self.ports.values())


@dataclass(frozen=True, slots=True)
class TopicSensor:
    """A sensor that reads the newest message of a topic: ``test`` is a script whose names are fields of the message."""

    topic: str
    type: str
    test: str

    @property
    def texts(self) -> tuple[str, ...]:
        """Everything in which arguments may stand."""
        return (self.topic, self.test)


@dataclass(frozen=True, slots=True)
class BlackboardSensor:
    """A sensor that reads the blackboard: ``test`` is a script (``battery_level > 0.2``)."""

    test: str

    @property
    def texts(self) -> tuple[str, ...]:
        """Everything in which arguments may stand."""
        return (self.test,)


Sensor = ConditionSensor | TopicSensor | BlackboardSensor


@dataclass(frozen=True, slots=True)
class Predicate(Immutable):
    """A relation of objects that is true or false, such as ``at`` for a robot and a place.

    ``parameters`` maps the names of its arguments to types. Without a ``sensor``, only the effects of skills are known.
    If the parameter ``exclusive`` is set, it holds for at most one object there, with the same other arguments: a robot
    at one place is not at another, so an effect that makes one true ends the others.
    """

    name: str
    parameters: Mapping[str, str] = field(default_factory=dict)
    sensor: Sensor | None = None
    exclusive: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'parameters', MappingProxyType(dict(self.parameters)))

    def __call__(self, *arguments: str) -> Literal:
        """Return the literal of these arguments."""
        return Literal(self.name, arguments)

    def problems(self) -> list[str]:
        """Return the problems of this predicate alone."""
        found = []
        if not is_name(self.name) or self.name == 'not':
            found.append(f'{short_repr(self.name)} cannot name a predicate: letters, digits and _, a letter first')
        if self.exclusive is not None and self.exclusive not in self.parameters:
            found.append(
                f'exclusive: {short_repr(self.exclusive)} is none of its parameters; it has {list(self.parameters)}'
            )
        for text in self.sensor.texts if self.sensor is not None else ():
            template = Template(text)
            if not template.is_valid():
                found.append(f'sensor: {short_repr(text)} has a $ without a name; write $$ for the character')
            found += [
                f'sensor: ${name} in {short_repr(text)} is none of its parameters; it has {list(self.parameters)}'
                for name in template.get_identifiers()
                if name not in self.parameters
            ]
        return found
