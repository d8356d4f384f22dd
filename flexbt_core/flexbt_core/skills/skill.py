# SPDX-License-Identifier: BSD-3-Clause
"""The manifest of a skill: what a leaf or a state needs, what it brings about, and how it may fail."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from string import Template
from types import MappingProxyType
from typing import Final

from flexbt_core.values.text import did_you_mean, short_repr

from .literals import Immutable, Literal, Predicate, SkillError, parse_literals

LEVELS: Final = ('off', 'low', 'high', 'full')
"""Names of the levels of autonomy; the place of one is its number."""


class OutcomeClass(Enum):
    """The meaning of an outcome for the mission, independent of its name."""

    COMPLETED = 'completed'
    """The skill did what it is for."""
    ANSWERED = 'answered'
    """A result that reports a fact and changed nothing: a condition, a decision of the operator."""
    FAILED = 'failed'
    """A failed attempt."""
    TIMED_OUT = 'timed_out'
    """An attempt that ran out of time."""
    CANCELED = 'canceled'
    """An attempt that was ended from outside."""


_NAMES: Final = {
    OutcomeClass.COMPLETED: 'SUCCESS done finished completed succeeded success received ready',
    OutcomeClass.ANSWERED: 'true false yes no',
    OutcomeClass.FAILED: 'FAILURE failed failure fail error aborted not_found unavailable rejected no_connection '
    'data_error',
    OutcomeClass.TIMED_OUT: 'timeout timed_out',
    OutcomeClass.CANCELED: 'canceled cancelled preempted declined',
}
_CLASSES: Final = {name: kind for kind, names in _NAMES.items() for name in names.split()}


def usual_outcome_class(outcome: str) -> OutcomeClass | None:
    """Return the class of an outcome by its name, where that is a usual one."""
    return _CLASSES.get(outcome)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One way in which a skill ends.

    ``kind`` None: its meaning is not declared. ``effects`` hold after it, and what they contradict does not hold any
    more. ``autonomy`` is the level that the outcome requires where it is a transition of a machine; None: none.
    """

    kind: OutcomeClass | None = None
    effects: tuple[Literal, ...] = ()
    autonomy: int | None = None

    @classmethod
    def of(cls, kind: OutcomeClass | str | None, *effects: str | Literal, autonomy: str | int | None = None) -> Outcome:
        """Return an outcome of texts.

        Raises:
            SkillError: an unknown class or level, or an effect that is not a literal.
        """
        return cls(
            outcome_class(kind) if isinstance(kind, str) else kind,
            parse_literals(effects),
            level(autonomy) if isinstance(autonomy, str) else autonomy,
        )


def outcome_class(name: str) -> OutcomeClass:
    """Return the class of this name. Raises SkillError."""
    try:
        return OutcomeClass(name)
    except ValueError:
        known = [kind.value for kind in OutcomeClass]
        raise SkillError([f'{short_repr(name)} is no class of outcomes{did_you_mean(name, known)}']) from None


def level(name: str) -> int:
    """Return the level of autonomy of this name. Raises SkillError."""
    if name.lower() not in LEVELS:
        raise SkillError([f'{short_repr(name)} is no level of autonomy; there are {", ".join(LEVELS)}'])
    return LEVELS.index(name.lower())


@dataclass(frozen=True, slots=True)
class Skill(Immutable):
    """The manifest of a leaf or a state, known without running it. Immutable.

    ==================  ============================================================================================
    ``name``            the ID of the leaf, the name of the state's class; '' in a class: its own
    ``parameters``      variables of the literals, with their types
    ``preconditions``   what has to hold when it begins
    ``outcomes``        by name: class, effects, autonomy
    ``resources``       actuators that it needs for itself while it runs
    ``reads, writes``   ports, or keys of the userdata
    ``cost``            of one attempt, in the unit of the mission; usually seconds
    ``deadline``        s, after which an attempt is given up; None: never
    ``retries``         attempts after the first that make sense; None: any number
    ``ignores_cancel``  whether what it has begun goes on after it was canceled
    ``duration``        least and greatest time of an attempt, s; None: any
    ``arguments``       ports of the leaf, or parameters of the state, as an instance gets them: ``$name`` stands for a
                        parameter of the skill. Without an entry a parameter goes to what has its name
    ``predicates``      those that are declared along with it
    ==================  ============================================================================================

    Declarations of the class (ports, keys, outcomes) need not be repeated: see ``node_skill`` and ``state_skill`` of
    the engines.
    """

    name: str = ''
    parameters: Mapping[str, str] = field(default_factory=dict)
    preconditions: tuple[Literal, ...] = ()
    outcomes: Mapping[str, Outcome] = field(default_factory=dict)
    resources: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    cost: float = 1.0
    deadline: float | None = None
    retries: int | None = None
    ignores_cancel: bool = False
    duration: tuple[float, float | None] = (0.0, None)
    arguments: Mapping[str, str] = field(default_factory=dict)
    predicates: tuple[Predicate, ...] = ()

    def __post_init__(self) -> None:
        for name in ('parameters', 'arguments'):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        # What is not declared follows from the name.
        outcomes = {
            name: one if one.kind is not None else replace(one, kind=usual_outcome_class(name))
            for name, one in self.outcomes.items()
        }
        object.__setattr__(self, 'outcomes', MappingProxyType(outcomes))
        for name in ('resources', 'reads', 'writes'):
            object.__setattr__(self, name, tuple(dict.fromkeys(getattr(self, name))))

    @classmethod
    def of(
        cls,
        name: str = '',
        *,
        parameters: Mapping[str, str] | None = None,
        preconditions: Iterable[str | Literal] = (),
        outcomes: Mapping[str, Outcome | OutcomeClass | str | Iterable[str | Literal]] | None = None,
        resources: Iterable[str] = (),
        cost: float = 1.0,
        deadline: float | None = None,
        retries: int | None = None,
        ignores_cancel: bool = False,
        duration: tuple[float, float | None] = (0.0, None),
        arguments: Mapping[str, str] | None = None,
        predicates: Iterable[Predicate] = (),
    ) -> Skill:
        """Return a skill as a class declares it, of texts.

        An outcome is the name of its class, or a list of effects; then its class is the one that its name suggests.

        Raises:
            SkillError: a text that is none of what it has to be.
        """
        return cls(
            name,
            parameters or {},
            parse_literals(preconditions),
            {key: _outcome(key, given) for key, given in (outcomes or {}).items()},
            tuple(resources),
            cost=cost,
            deadline=deadline,
            retries=retries,
            ignores_cancel=ignores_cancel,
            duration=duration,
            arguments=arguments or {},
            predicates=tuple(predicates),
        )

    def completed_by(
        self, name: str, outcomes: Mapping[str, Outcome], reads: Iterable[str] = (), writes: Iterable[str] = ()
    ) -> Skill:
        """Return the skill completed from its class: the name, the ``outcomes`` that it does not declare, and its
        keys."""
        return replace(
            self,
            name=name or self.name,
            outcomes={**outcomes, **self.outcomes},
            reads=(*self.reads, *reads),
            writes=(*self.writes, *writes),
        )

    @classmethod
    def measuring(cls, predicate: Predicate) -> Skill:
        """Return the skill of a condition that checks whether a predicate of its parameters holds."""
        atom = predicate(*predicate.parameters)
        outcomes = {
            'SUCCESS': Outcome(OutcomeClass.ANSWERED, (atom,)),
            'FAILURE': Outcome(OutcomeClass.ANSWERED, (~atom,)),
        }
        return cls.of(parameters=predicate.parameters, outcomes=outcomes, predicates=[predicate])

    def within(self, deadline: float | None) -> Skill:
        """Return the skill, of which an attempt is given up after this time, s; None: never."""
        return replace(self, deadline=deadline)

    def lasting(self, least: float, most: float | None) -> Skill:
        """Return the skill, of which an attempt takes this long, s."""
        return replace(self, duration=(least, most))

    def bound(self, **binding: str) -> Skill:
        """Return the skill of which some parameters are known: a state calls it with what it was made with.

        Raises:
            SkillError: it has no such parameter.
        """
        for name in binding:
            if name not in self.parameters:
                known = did_you_mean(name, self.parameters)
                raise SkillError([f'{self.name or "the skill"} has no parameter {short_repr(name)}{known}'])
        return replace(
            self,
            parameters={name: kind for name, kind in self.parameters.items() if name not in binding},
            preconditions=tuple(one.bound(binding) for one in self.preconditions),
            outcomes={
                name: replace(one, effects=tuple(effect.bound(binding) for effect in one.effects))
                for name, one in self.outcomes.items()
            },
            arguments={name: Template(text).safe_substitute(binding) for name, text in self.arguments.items()},
        )

    def problems(self) -> list[tuple[tuple[str, ...], str]]:
        """Return what is wrong with it, taken by itself: where in the manifest, and what."""
        found: list[tuple[tuple[str, ...], str]] = []
        if not (math.isfinite(self.cost) and self.cost >= 0.0):
            found.append((('cost',), f'{short_repr(self.cost)} has to be a number from 0 on'))
        if self.deadline is not None and not (math.isfinite(self.deadline) and self.deadline > 0.0):
            found.append(
                (('deadline',), f'{short_repr(self.deadline)} has to be a time above 0, s; leave it out for never')
            )
        least, most = self.duration
        if not (math.isfinite(least) and least >= 0.0 and (most is None or least <= most)):
            found.append((('duration',), f'[{least}, {most}] has to be a least and a greatest time, s'))
        if self.retries is not None and self.retries < 0:
            found.append((('retries',), f'{short_repr(self.retries)} has to be a number from 0 on'))
        found += [
            (('preconditions',), f'asks for {one} and {~one}, so it is never done; leave out one of them')
            for one in _contradictions(self.preconditions)
        ]
        for name, outcome in self.outcomes.items():
            found += [
                (('outcomes', name), f'has {one} and {~one} as effects; leave out one of them')
                for one in _contradictions(outcome.effects)
            ]
        return found


def _contradictions(literals: Iterable[Literal]) -> list[Literal]:
    """Return the atoms that are to hold, and not to."""
    said = set(literals)
    return sorted((one for one in said if one.positive and ~one in said), key=str)


def _outcome(name: str, given: Outcome | OutcomeClass | str | Iterable[str | Literal]) -> Outcome:
    if isinstance(given, Outcome):
        return given
    if isinstance(given, OutcomeClass | str):
        return Outcome.of(given)
    return Outcome(usual_outcome_class(name) or OutcomeClass.COMPLETED, parse_literals(given))
