# SPDX-License-Identifier: BSD-3-Clause
"""What is known in an exploration of what skills need: from conditions, and from what skills have brought about."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from string import Template
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree import NodeStatus, TreeNode
from flexbt_core.monitors import Property, Violation
from flexbt_core.skills import Literal, OutcomeClass, Skill


class Needs(NamedTuple):
    """What a leaf needs and brings about, with what its ports say in the place of parameters.

    ``effects`` are those of its results, and whether that is how things are now, rather than what it has changed.
    ``ends`` are places of arguments, by predicates of which one object holds at most there.
    """

    preconditions: tuple[Literal, ...] = ()
    effects: Mapping[NodeStatus, tuple[bool, tuple[Literal, ...]]] = MappingProxyType({})
    ends: Mapping[str, int] = MappingProxyType({})
    written: frozenset[str] = frozenset()


NOTHING: Final = Needs()


def needs_of(leaf: TreeNode, skill: Skill | None, names: dict[Any, str]) -> Needs:
    """The skill of a leaf as its ports bind it; literals of what they do not tell are left out.

    ``names`` are those of entries of blackboards, which have other keys in other sub-trees; the new ones are added.
    """
    if skill is None:
        return NOTHING
    objects = {port: _object(leaf, port, names) for port in leaf._values}
    told = {name: port for port, text in skill.arguments.items() for name in Template(text).get_identifiers()}
    binding = {name: objects[told.get(name, name)] for name in skill.parameters if told.get(name, name) in objects}
    unbound = skill.parameters.keys() - binding.keys()

    def bound(literals: Iterable[Literal]) -> tuple[Literal, ...]:
        return tuple(one.bound(binding) for one in literals if unbound.isdisjoint(one.arguments))

    return Needs(
        bound(skill.preconditions),
        {
            NodeStatus[name]: (one.kind is OutcomeClass.ANSWERED, bound(one.effects))
            for name, one in skill.outcomes.items()
            if one.effects and name in NodeStatus.__members__
        },
        {one.name: list(one.parameters).index(one.exclusive) for one in skill.predicates if one.exclusive is not None},
        frozenset(objects[name] for name, port in leaf.ports.items() if port.writable and name in objects),
    )


def _object(leaf: TreeNode, port: str, names: dict[Any, str]) -> str:
    """What a port is given: a text, or the name of an entry."""
    value = leaf._values[port]
    entry = None if value.key is None else leaf.blackboard.entry(value.key)
    if entry is None:
        return str(value.text)
    if entry not in names:
        same = sum(name.partition('#')[0] == value.key for name in names.values())
        names[entry] = f'{value.key}#{same}' if same else str(value.key)
    return names[entry]


class Facts:
    """What holds. ``lasting`` is what skills have brought about, until something else is known; ``measured`` is what
    conditions say, as long as no time goes by. Of each atom that something needs: whether it holds, and from whom that
    is known.
    """

    def __init__(self) -> None:
        self.lasting: dict[str, tuple[bool, str]] = {}
        self.measured: dict[str, tuple[bool, str]] = {}
        self.names: dict[Any, str] = {}
        self._needed: dict[str, Literal] = {}

    def need(self, needs: Needs) -> None:
        """Something needs this, so that it is of interest."""
        self._needed |= {str(one.atom): one.atom for one in needs.preconditions}

    def begins(self, path: str, needs: Needs, found: Callable[[Violation], None]) -> None:
        """A leaf begins; what it needs, and is known not to hold, is wrong."""
        for one in needs.preconditions:
            atom = str(one.atom)
            holds, source = self.measured.get(atom) or self.lasting.get(atom) or (one.positive, '')
            if holds is not one.positive:
                says = 'has just said' if atom in self.measured else 'has brought about'
                text = f'{path} begins, and its skill needs {_plain(one)}: {source} {says} {_plain(~one)}'
                found(Violation(Property.PRECONDITION, path, text))

    def ends(self, path: str, needs: Needs, status: NodeStatus) -> None:
        """A leaf gives a result: what it brings about, or says, is known; of what it has written nothing is, else."""
        if not self._needed:
            return
        if status is NodeStatus.SUCCESS and needs.written:
            for atom, literal in self._needed.items():
                if not needs.written.isdisjoint(literal.arguments):
                    self._forget(atom)
        is_measured, effects = needs.effects.get(status, (False, ()))
        for effect in effects:
            for atom in self._ended_by(effect, needs):
                self._forget(atom)
                self.lasting[atom] = (False, path)
            atom = str(effect.atom)
            if atom in self._needed:
                self._forget(atom)
                (self.measured if is_measured else self.lasting)[atom] = (effect.positive, path)

    def _ended_by(self, effect: Literal, needs: Needs) -> list[str]:
        place = needs.ends.get(effect.predicate)
        if place is None or not effect.positive:
            return []
        return [
            atom
            for atom, one in self._needed.items()
            if one.predicate == effect.predicate
            and one.arguments[:place] + one.arguments[place + 1 :]
            == effect.arguments[:place] + effect.arguments[place + 1 :]
        ]

    def _forget(self, atom: str) -> None:
        self.lasting.pop(atom, None)
        self.measured.pop(atom, None)


def _plain(literal: Literal) -> str:
    """A literal for people, without the marks of entries."""
    return str(Literal(literal.predicate, tuple(one.partition('#')[0] for one in literal.arguments), literal.positive))
