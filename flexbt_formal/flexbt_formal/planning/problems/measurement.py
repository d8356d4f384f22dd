# SPDX-License-Identifier: BSD-3-Clause
"""How a world is: a tree that asks every sensor of a library once, and the start of a mission that follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice, product
from typing import Final, Self
from xml.etree import ElementTree

from flexbt_core.skills import Literal, Skill, SkillError, SkillLibrary, parse_literal

from .goal import parse_goal
from .problem import Leaf
from .skill_problem import sensor_leaf

MOST_FACTS: Final = 4096
"""Facts that one tree asks for."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """The facts (atoms of objects) that leaves can tell, and which leaf each."""

    leaves: dict[Literal, Leaf]

    @classmethod
    def of(cls, library: SkillLibrary, goal: str, is_type: Callable[[str], bool]) -> Self:
        """What matters for a goal (see :func:`parse_goal`) and can be told of a library's objects by leaves, of which
        ``is_type`` knows the types.

        Raises:
            PlanningError, SkillError: the goal is none, or those are more than MOST_FACTS.
        """
        leaves: dict[Literal, Leaf] = {}
        wanted = {parse_literal(text).predicate for alternative in parse_goal(goal) for text in alternative}
        for predicate in map(library.predicates.get, sorted(_that_matter(library, wanted))):
            if predicate is None:
                continue
            objects = [library.objects_of(kind) for kind in predicate.parameters.values()]
            for arguments in islice(product(*objects), MOST_FACTS + 1):
                atom = Literal(predicate.name, arguments)
                leaf = sensor_leaf(library, atom)
                if leaf is None or not is_type(leaf.type):
                    break
                leaves[atom] = leaf
            if len(leaves) > MOST_FACTS:
                raise SkillError(
                    [
                        f'more than {MOST_FACTS} facts would have to be measured, with those of {predicate.name}; '
                        'name fewer objects, or let predicates that never change do without sensor'
                    ]
                )
        return cls(leaves)

    def tree_xml(self, name: str) -> str:
        """A tree of this ID that succeeds once every sensor has answered; :meth:`start` reads what they said."""
        root = ElementTree.Element('root', BTCPP_format='4', main_tree_to_execute=name)
        tree = ElementTree.SubElement(root, 'BehaviorTree', ID=name)
        asked = ElementTree.SubElement(tree, 'Sequence', name='how the world is')
        for number, (atom, leaf) in enumerate(self.leaves.items()):
            answered = ElementTree.SubElement(asked, 'ForceSuccess')
            said = {'_onSuccess': f'{_entry(number)} := true', '_onFailure': f'{_entry(number)} := false'}
            attributes = {'name': str(atom), **leaf.ports, **said}
            ElementTree.SubElement(answered, leaf.type, attributes)
        ElementTree.SubElement(asked, 'AlwaysSuccess')  # of no sensors
        return ElementTree.tostring(root, encoding='unicode')

    def start(self, given: Iterable[str], holds: Callable[[str], bool]) -> list[str]:
        """The literals that hold at the start: those that were measured, and of ``given`` those that nothing measures.

        ``holds`` tells whether an entry of the tree's blackboard is there, and true.

        Raises:
            SkillError: one of ``given`` is no literal.
        """
        remembered = [literal for literal in map(parse_literal, given) if literal.atom not in self.leaves]
        measured = [atom for number, atom in enumerate(self.leaves) if holds(_entry(number))]
        return [*map(str, remembered), *map(str, measured)]


def _that_matter(library: SkillLibrary, wanted: set[str]) -> set[str]:
    """The predicates that are wanted, and those of the conditions of skills that bring about one that matters."""
    found = set(wanted)
    pending = list(library.skills.values())
    while bringing := [skill for skill in pending if not found.isdisjoint(_brought_about(skill))]:
        found.update(literal.predicate for skill in bringing for literal in skill.preconditions)
        pending = [skill for skill in pending if skill not in bringing]
    return found


def _brought_about(skill: Skill) -> set[str]:
    return {effect.predicate for outcome in skill.outcomes.values() for effect in outcome.effects}


def _entry(number: int) -> str:
    """Private: it stays on the blackboard of the tree."""
    return f'_fact_{number}'
