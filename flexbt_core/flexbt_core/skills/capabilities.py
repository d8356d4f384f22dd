# SPDX-License-Identifier: BSD-3-Clause
"""Skills of states as a capability file of flexbe_synthesis: one capability for each way to bind a skill.

An atom becomes a bit of the memory, ``at(kitchen)`` is ``at_kitchen``; the outcomes of a skill are normalized to
``completed`` and ``failure``. Who only answers (conditions, the operator) is no capability.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

import yaml

from .errors import SkillError
from .grounding import Grounding, argument_texts
from .library import SkillLibrary
from .literals import Literal
from .skill import OutcomeClass, Skill

_NORMALIZED: Final = {
    OutcomeClass.COMPLETED: 'completed',
    OutcomeClass.FAILED: 'failure',
    OutcomeClass.TIMED_OUT: 'failure',
    OutcomeClass.CANCELED: 'failure',
}


def capability_file(library: SkillLibrary, start: Iterable[Literal], name: str) -> str:
    """The capability file of a library of states, named ``name``, for a world in which ``start`` holds.

    Raises:
        SkillError: something of the manifests has no form there; each problem says what to do.
    """
    return _Capabilities(library, tuple(start)).text(name)


class _Capabilities:
    def __init__(self, library: SkillLibrary, start: tuple[Literal, ...]) -> None:
        self._skills = [skill for skill in library.skills.values() if _is_capability(skill)]
        self._start = {one for one in start if one.positive}
        self._grounding = Grounding(library, start, ())
        self._problems: list[str] = []
        self._names: dict[str, str] = {}  # what stands for what

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
        """The normalized outcome of each outcome; there is one for all states."""
        found: dict[str, str] = {}
        for skill in self._skills:
            for outcome, told in skill.outcomes.items():
                normalized = _NORMALIZED.get(told.kind) if told.kind is not None else None
                if normalized is None:
                    kind = 'has no class' if told.kind is None else 'is an answer'
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
        for outcome, told in skill.outcomes.items():
            after = self._grounding.effects(told, binding)
            normalized = _NORMALIZED.get(told.kind) if told.kind is not None else None
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
        """A name of letters, digits and _ that nothing else has."""
        name = re.sub(r'\W', '_', text, flags=re.ASCII)
        if self._names.setdefault(name, meaning) != meaning:
            self._problems.append(f'{meaning} and {self._names[name]} would both be called {name}; rename an object')
        return name


def _is_capability(skill: Skill) -> bool:
    return any(one.kind is OutcomeClass.COMPLETED and one.effects for one in skill.outcomes.values())
