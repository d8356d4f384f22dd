# SPDX-License-Identifier: BSD-3-Clause
"""Observation of skills in a run: a missing effect, a precondition that did not hold, too many attempts.

The monitor believes the effect of a skill until a measuring skill (whose outcome is an answer) contradicts it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from flexbt_core.values.text import short_repr

from .literals import Literal, SkillError
from .skill import Outcome, OutcomeClass, Skill

_UNSUCCESSFUL = (OutcomeClass.FAILED, OutcomeClass.TIMED_OUT)


def claims(skill: Skill) -> dict[str, Any]:
    """Return the claims of a skill that a run may contradict, as plain data; empty without claims. Literals with
    unbound parameters are left out."""
    unbound = set(skill.parameters)
    needs = [str(one) for one in skill.preconditions if unbound.isdisjoint(one.arguments)]
    outcomes = {
        name: {
            'class': one.kind.value if one.kind is not None else None,
            'effects': [str(effect) for effect in one.effects if unbound.isdisjoint(effect.arguments)],
        }
        for name, one in skill.outcomes.items()
    }
    exclusive = {
        one.name: list(one.parameters).index(one.exclusive) for one in skill.predicates if one.exclusive is not None
    }
    if not needs and skill.retries is None and not any(one['effects'] for one in outcomes.values()):
        return {}
    return {'needs': needs, 'outcomes': outcomes, 'retries': skill.retries, 'exclusive': exclusive}


@dataclass(frozen=True, slots=True)
class _Fact:
    """The known value of an atom, and its source."""

    holds: bool
    path: str
    outcome: str
    is_measured: bool

    @property
    def source(self) -> str:
        return f'as {self.path} {"measured" if self.is_measured else f"brought about by {short_repr(self.outcome)}"}'


class SkillMonitor:
    """A monitor of the skills of a run. ``claims_of`` maps the paths of its states to their :func:`claims`.

    Raises:
        SkillError: ``claims_of`` has no valid claims.
    """

    def __init__(self, claims_of: Mapping[str, Any]) -> None:
        self._skills: dict[str, Skill] = {}
        self._exclusive: dict[str, int] = {}
        try:
            for path, entry in claims_of.items():
                outcomes = {
                    str(name): Outcome.of(one['class'], *one['effects']) for name, one in entry['outcomes'].items()
                }
                self._skills[path] = Skill.of(
                    preconditions=entry['needs'], outcomes=outcomes, retries=entry.get('retries')
                )
                self._exclusive |= {str(name): int(place) for name, place in entry.get('exclusive', {}).items()}
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise SkillError([f'these are not claims of skills: {type(error).__name__}: {error}']) from error
        self._facts: dict[Literal, _Fact] = {}
        self._failures: dict[str, int] = {}
        self._active: set[str] = set()

    def began(self, path: str) -> list[str]:
        """Record that a state is entered. Return contradictions to its skill, as lines of text."""
        skill = self._skills.get(path)
        if skill is None:
            return []
        self._active.add(path)
        found = []
        for literal in skill.preconditions:
            fact = self._facts.get(literal.atom)
            if fact is not None and fact.holds is not literal.positive:
                found.append(f'it began though {literal} does not hold, {fact.source}')
        return found

    def ended(self, path: str, outcome: str, *, by_itself: bool = True) -> list[str]:
        """Record that a state was left. Return contradictions to skills. An outcome that an operator has forced is
        no evidence, and its effects are not believed."""
        skill = self._skills.get(path)
        if skill is None:
            return []
        # A state that is done within one step was not reported as entered.
        found = self.began(path) if path not in self._active else []
        self._active.discard(path)
        declared = skill.outcomes.get(outcome)
        if not by_itself:
            for effect in declared.effects if declared is not None else ():
                for atom in (effect.atom, *self._ended_by(effect)):
                    self._facts.pop(atom, None)
            return found
        if declared is None:
            return [*found, f'it ended by {short_repr(outcome)}, of which its skill knows nothing']
        is_measured = declared.kind is OutcomeClass.ANSWERED
        for effect in declared.effects:
            shows = dict.fromkeys(self._ended_by(effect), False) | {effect.atom: effect.positive}
            for atom, holds in shows.items():
                fact = self._facts.get(atom)
                if is_measured and fact is not None and not fact.is_measured and fact.holds is not holds:
                    claim = f'{fact.path} ended by {short_repr(fact.outcome)}, after which {~atom if holds else atom}'
                    found.append(f'{claim} was to hold; it does not')
                self._facts[atom] = _Fact(holds, path, outcome, is_measured)
        return [*found, *self._attempts(path, skill, declared)]

    def _ended_by(self, effect: Literal) -> Iterator[Literal]:
        """Yield known atoms that cannot hold together with an effect."""
        place = self._exclusive.get(effect.predicate)
        if effect.positive and place is not None:
            for atom in list(self._facts):
                if atom.predicate == effect.predicate and len(atom.arguments) == len(effect.arguments):
                    rest = zip(atom.arguments, effect.arguments, strict=True)
                    if all(one == other for index, (one, other) in enumerate(rest) if index != place):
                        yield atom

    def _attempts(self, path: str, skill: Skill, outcome: Outcome) -> Iterator[str]:
        failures = self._failures.get(path, 0) + 1 if outcome.kind in _UNSUCCESSFUL else 0
        self._failures[path] = failures
        if skill.retries is not None and failures == skill.retries + 2:
            yield f'it has failed {failures} times in a row; its skill allows for {skill.retries} after the first'
