# SPDX-License-Identifier: BSD-3-Clause
"""The manifest of a skill: preconditions, effects and possible failures of a leaf or a state."""

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
"""Names of the autonomy levels; the index is the number of the level."""


class OutcomeClass(Enum):
    """The meaning of an outcome for the mission, independent of its name."""

    COMPLETED = 'completed'
    """The skill has fulfilled its purpose."""
    ANSWERED = 'answered'
    """A result that reports a fact without changing anything: a condition, a decision of the operator."""
    FAILED = 'failed'
    """A failed attempt."""
    TIMED_OUT = 'timed_out'
    """An attempt that ran out of time."""
    CANCELED = 'canceled'
    """An attempt that was canceled from outside."""


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
    """Return the class of an outcome with a usual name; None for other names."""
    return _CLASSES.get(outcome)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One way in which a skill ends.

    ``kind`` None means that its class is not declared. ``effects`` hold afterwards; literals that they contradict no
    longer hold. ``autonomy`` is the level that the outcome requires as a transition of a machine, or None.
    """

    kind: OutcomeClass | None = None
    effects: tuple[Literal, ...] = ()
    autonomy: int | None = None

    @classmethod
    def of(cls, kind: OutcomeClass | str | None, *effects: str | Literal, autonomy: str | int | None = None) -> Outcome:
        """Return an outcome from texts.

        Raises:
            SkillError: a class or level is unknown, or an effect is not a literal.
        """
        return cls(
            outcome_class(kind) if isinstance(kind, str) else kind,
            parse_literals(effects),
            level(autonomy) if isinstance(autonomy, str) else autonomy,
        )


def outcome_class(name: str) -> OutcomeClass:
    """Return the outcome class called ``name``. Raises SkillError."""
    try:
        return OutcomeClass(name)
    except ValueError:
        known = [kind.value for kind in OutcomeClass]
        raise SkillError([f'{short_repr(name)} is not a class of outcomes{did_you_mean(name, known)}']) from None


def level(name: str) -> int:
    """Return the autonomy level called ``name``. Raises SkillError."""
    if name.lower() not in LEVELS:
        raise SkillError([f'{short_repr(name)} is not a level of autonomy; there are {", ".join(LEVELS)}'])
    return LEVELS.index(name.lower())


@dataclass(frozen=True, slots=True)
class Skill(Immutable):
    """The manifest of a leaf or a state, known without running it. Immutable.

    ==================  ============================================================================================
    ``name``            the ID of the leaf, or the name of the state's class; '' in a class for its own name
    ``parameters``      variables of the literals, with their types
    ``preconditions``   literals that must hold when it begins
    ``outcomes``        by name: class, effects, autonomy
    ``resources``       actuators that it needs exclusively while it runs
    ``reads, writes``   ports, or keys of the userdata
    ``cost``            cost of one attempt in the unit of the mission, usually seconds
    ``deadline``        time limit of an attempt, s; None for no limit
    ``retries``         useful number of attempts after the first; None for any number
    ``ignores_cancel``  whether its work continues after it was canceled
    ``duration``        minimum and maximum time of an attempt, s; a maximum of None for no limit
    ``arguments``       values of the leaf's ports or the state's parameters; ``$name`` is replaced by a parameter of
                        the skill. By default a parameter of the skill sets the port or parameter of the same name
    ``predicates``      predicates that it declares
    ``knows_ports``     whether ``reads`` and ``writes`` are all ports of the leaf, which may have none
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
    knows_ports: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        for name in ('parameters', 'arguments'):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        # The class of an undeclared outcome follows from its name.
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
        """Return a skill from texts, as a class declares it.

        An outcome is the name of its class or a list of effects. In a list, its class follows from its name.

        Raises:
            SkillError: a text is not of the required form.
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
        """Return the skill completed from its class, with the name, the ``outcomes`` that it does not declare, and
        its keys."""
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
        """Return the skill with this deadline for an attempt in s; None for no limit."""
        return replace(self, deadline=deadline)

    def lasting(self, least: float, most: float | None) -> Skill:
        """Return the skill with this minimum and maximum duration of an attempt, in s."""
        return replace(self, duration=(least, most))

    def bound(self, **binding: str) -> Skill:
        """Return the skill with some parameters bound. A state calls it with its constructor arguments.

        Raises:
            SkillError: the skill lacks a parameter.
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
        """Return the problems of this skill alone: the place in the manifest, and the text."""
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
    """Return the atoms that are required both to hold and not to hold."""
    said = set(literals)
    return sorted((one for one in said if one.positive and ~one in said), key=str)


def _outcome(name: str, given: Outcome | OutcomeClass | str | Iterable[str | Literal]) -> Outcome:
    if isinstance(given, Outcome):
        return given
    if isinstance(given, OutcomeClass | str):
        return Outcome.of(given)
    return Outcome(usual_outcome_class(name) or OutcomeClass.COMPLETED, parse_literals(given))
