# SPDX-License-Identifier: BSD-3-Clause
"""Skills bound to objects as STRIPS actions, with preconditions and effects as plain names (atoms).

An action needs ``pre``, makes ``add`` true and ``delete`` false. A required literal with ``not`` becomes a separate
atom, ``not open(door)``, that actions update, so that all conditions are positive (Gazen, Knoblock: "Combining the
expressivity of UCPOP with the efficiency of Graphplan", 1997).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from string import Template
from typing import Final

from .library import SkillLibrary
from .literals import EQUAL, Literal, SkillError
from .skill import Outcome, OutcomeClass, Skill

MAX_TRIED: Final = 200_000
"""Maximum number of bindings tried for one skill, including incomplete ones; this takes some seconds."""


@dataclass(frozen=True, slots=True)
class GroundAction:
    """A skill bound to objects, with one of its outcomes. ``name`` is unique; ``arguments`` are the values of the
    leaf's ports or the state's parameters."""

    name: str
    skill: str
    outcome: str
    binding: Mapping[str, str]
    arguments: Mapping[str, str]
    pre: frozenset[str]
    add: frozenset[str]
    delete: frozenset[str]
    cost: float


@dataclass(frozen=True, slots=True)
class GroundProblem:
    """A planning problem: the actions, the atoms true at the start, and the atoms to reach."""

    actions: tuple[GroundAction, ...]
    start: frozenset[str]
    goal: frozenset[str]


def ground(library: SkillLibrary, start: Iterable[Literal], goal: Iterable[Literal]) -> GroundProblem:
    """Return the planning problem of a library with its objects.

    Literals that ``start`` does not list are false. A skill becomes an action for each binding whose unchanging
    preconditions hold, and for each of its outcomes of class completed with an effect.

    Raises:
        SkillError: start or goal has names that the library lacks, or a skill has more than MAX_TRIED bindings.
    """
    start, goal = tuple(start), tuple(goal)
    _check(library, start, goal)
    return Grounding(library, start, goal).problem()


def _check(library: SkillLibrary, start: Iterable[Literal], goal: Iterable[Literal]) -> None:
    """Check that the library knows all names. Parts of the goal may exclude each other, for example as alternatives."""
    said = {'start': start, 'goal': goal}
    problems = [
        f'{where}: {text}' for where, literals in said.items() for one in literals for text in library.problems_of(one)
    ]
    if problems:
        raise SkillError(problems)


class Grounding:
    """A library with its objects: the possible bindings, and the effects of outcomes for them."""

    def __init__(self, library: SkillLibrary, start: tuple[Literal, ...], goal: tuple[Literal, ...]) -> None:
        self._library = library
        self._goal = goal
        self._start = {one for one in start if one.positive}
        self._texts: dict[Literal, str] = {}
        self._exclusive: dict[tuple[str, tuple[str, ...], tuple[str, ...]], frozenset[Literal]] = {}
        skills = library.skills.values()
        self._changed = {
            effect.predicate
            for skill in skills
            for outcome in skill.outcomes.values()
            if outcome.kind is not OutcomeClass.ANSWERED  # an answer changes nothing
            for effect in outcome.effects
        }
        asked = [*goal, *(one for skill in skills for one in skill.preconditions)]
        self._negated = {one.predicate for one in asked if not one.positive} & self._changed

    @property
    def unchanging(self) -> set[str]:
        """Predicates that no skill changes."""
        return {name for name in self._library.predicates if name not in self._changed}

    def problem(self) -> GroundProblem:
        actions = tuple(action for skill in self._library.skills.values() for action in self._actions(skill))
        atoms = {str(one) for one in self._start}
        negative = {str(~atom) for name in self._negated for atom in self._atoms(name) if atom not in self._start}
        goal = {str(one) for one in self._goal if not (one.predicate == EQUAL and self._holds(one))}
        # For unchanging predicates the start decides whether a negated goal holds.
        fixed = {str(one) for one in self._goal if self._is_fixed(one) and not one.positive and self._holds(one)}
        return GroundProblem(actions, frozenset(atoms | negative), frozenset(goal - fixed))

    def _atoms(self, predicate: str) -> Iterator[Literal]:
        kinds = list(self._library.predicates[predicate].parameters.values())
        names: list[tuple[str, ...]] = [()]
        for kind in kinds:
            names = [(*before, one) for before in names for one in self._library.objects_of(kind)]
        return (Literal(predicate, arguments) for arguments in names)

    def _is_fixed(self, literal: Literal) -> bool:
        return literal.predicate not in self._changed

    def _holds(self, literal: Literal) -> bool:
        """Return whether an unchanging literal of objects holds."""
        if literal.predicate == EQUAL:
            return (literal.arguments[0] == literal.arguments[1]) is literal.positive
        return (literal.atom in self._start) is literal.positive

    # -- the actions of a skill --------------------------------------------------------------------------------------

    def _actions(self, skill: Skill) -> Iterator[GroundAction]:
        outcomes = {
            name: outcome
            for name, outcome in skill.outcomes.items()
            if outcome.kind is OutcomeClass.COMPLETED and outcome.effects
        }
        for binding in self.bindings(skill) if outcomes else ():
            shown = f'{skill.name}({", ".join(binding[name] for name in skill.parameters)})'
            ports = {*skill.reads, *skill.writes}
            pre = self.conditions(skill, binding)
            if any(~one in pre for one in pre):
                continue
            for name, outcome in outcomes.items():
                effects = self.effects(outcome, binding)
                yield GroundAction(
                    shown if len(outcomes) == 1 else f'{shown}:{name}',
                    skill.name,
                    name,
                    binding,
                    argument_texts(skill, binding, ports if ports or skill.knows_ports else None),
                    frozenset(map(str, pre)),
                    self._atoms_of(effects, added=True),
                    self._atoms_of(effects, added=False),
                    skill.cost,
                )

    def conditions(self, skill: Skill, binding: Mapping[str, str]) -> set[Literal]:
        """Return the preconditions on predicates that skills change."""
        return {one.bound(binding) for one in skill.preconditions if not self._is_fixed(one)}

    def effects(self, outcome: Outcome, binding: Mapping[str, str]) -> set[Literal]:
        """Return the effects of an outcome, including the end of literals that exclude a new one."""
        effects = {one.bound(binding) for one in outcome.effects}
        true = {one for one in effects if one.positive}
        false = effects - true
        for one in true:
            false |= self._one_at_most(one)
        return true | (false - {~one for one in true})

    def _atoms_of(self, effects: set[Literal], *, added: bool) -> frozenset[str]:
        """Return the atoms that effects make true (``added``) or false, including atoms for literals with ``not``."""
        plain = {self._text(one) for one in effects if one.positive is added}
        opposite = {str(~one.atom) for one in effects if one.positive is not added and one.predicate in self._negated}
        return frozenset(plain | opposite)

    def _text(self, literal: Literal) -> str:
        """Return the atom of a literal, as text."""
        found = self._texts.get(literal)
        if found is None:
            found = self._texts[literal] = str(literal.atom)
        return found

    def _one_at_most(self, atom: Literal) -> frozenset[Literal]:
        """Return the negations of all atoms that exclude each other, this one included; empty if not exclusive."""
        predicate = self._library.predicates[atom.predicate]
        if predicate.exclusive is None:
            return frozenset()
        place = list(predicate.parameters).index(predicate.exclusive)
        before, after = atom.arguments[:place], atom.arguments[place + 1 :]
        key = (atom.predicate, before, after)
        found = self._exclusive.get(key)
        if found is None:
            objects = self._library.objects_of(predicate.parameters[predicate.exclusive])
            found = frozenset(Literal(atom.predicate, (*before, one, *after), positive=False) for one in objects)
            self._exclusive[key] = found
        return found

    def bindings(self, skill: Skill) -> Iterator[dict[str, str]]:
        """Yield the bindings of objects to parameters. Drop an incomplete one as soon as a precondition fails."""
        names = list(skill.parameters)
        fixed = [one for one in skill.preconditions if self._is_fixed(one)]
        # The number of bound parameters at which each precondition can be checked.
        due: list[list[Literal]] = [[] for _ in range(len(names) + 1)]
        for one in fixed:
            due[max((names.index(name) + 1 for name in one.arguments if name in skill.parameters), default=0)].append(
                one
            )

        tried = 0
        binding: dict[str, str] = {}

        def bind(bound: int) -> Iterator[dict[str, str]]:
            """Yield the complete bindings for the first ``bound`` parameters in ``binding``."""
            nonlocal tried
            tried += 1
            if tried > MAX_TRIED:
                raise SkillError([_too_many(skill)])
            if due[bound] and not all(self._holds(one.bound(binding)) for one in due[bound]):
                return
            if bound == len(names):
                yield dict(binding)
                return
            for one in objects[bound]:
                binding[names[bound]] = one
                yield from bind(bound + 1)
            binding.pop(names[bound], None)  # it is missing if no object has its type

        objects = [self._library.objects_of(kind) for kind in skill.parameters.values()]
        return bind(0)


def _too_many(skill: Skill) -> str:
    return (
        f'skill {skill.name}: more than {MAX_TRIED:,} ways to bind {", ".join(skill.parameters)} to objects; give the '
        'parameters narrower types, or a precondition that nothing changes (such as which places are next to each '
        'other) of the first of them'
    )


def argument_texts(skill: Skill, binding: Mapping[str, str], declared: Collection[str] | None = None) -> dict[str, str]:
    """Return the values of ports or parameters for these objects.

    ``declared`` are the known ports; None if unknown. A parameter of the skill that is not a port is used only in
    literals, unless ``arguments`` use it.
    """
    given = {port: Template(text).safe_substitute(binding) for port, text in skill.arguments.items()}
    used = {name for text in skill.arguments.values() for name in Template(text).get_identifiers()}
    plain = {name: one for name, one in binding.items() if name not in used and (declared is None or name in declared)}
    return {**plain, **given}
