# SPDX-License-Identifier: BSD-3-Clause
"""Knowledge of an exploration about the needs of skills: from conditions, and from effects of skills."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from string import Template
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.model.blackboard import Entry
from flexbt_core.behavior_tree.model.errors import ConversionError
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortValue
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.skills.literals import Literal
from flexbt_core.skills.skill import OutcomeClass, Skill

_MARK: Final = '\0'
"""Mark in the name of a blackboard entry whose value is not known: no text of a tree contains it."""


class Needs(NamedTuple):
    """The needs and effects of a leaf, with the values of its ports in place of parameters.

    ``effects`` are those of its results, and whether that is how things are now, rather than what it has changed.
    ``ends`` are places of arguments, by predicates of which one object holds at most there. ``changes`` is what may be
    different once it has begun, with any result: None for anything, if its effects are not declared.
    ``is_at_once``: it does its work within a tick.
    """

    preconditions: tuple[Literal, ...] = ()
    effects: Mapping[NodeStatus, tuple[bool, tuple[Literal, ...]]] = MappingProxyType({})
    ends: Mapping[str, int] = MappingProxyType({})
    changes: tuple[Literal, ...] | None = None
    is_at_once: bool = False


def needs_of(leaf: TreeNode, skill: Skill | None, names: dict[Entry, str]) -> Needs:
    """Return the skill of a leaf as its ports bind it; literals of what they do not tell are left out.

    ``names`` are those of entries of blackboards, which have other keys in other sub-trees; the new ones are added.
    """
    if skill is None:
        return Needs()
    objects = {port: name for port in leaf.port_values if (name := _object(leaf, port, names)) is not None}
    told = {name: port for port, text in skill.arguments.items() for name in Template(text).get_identifiers()}
    binding = {name: objects[told.get(name, name)] for name in skill.parameters if told.get(name, name) in objects}
    unbound = skill.parameters.keys() - binding.keys()

    def bound(literals: Iterable[Literal]) -> tuple[Literal, ...]:
        return tuple(one.bound(binding) for one in literals if unbound.isdisjoint(one.arguments))

    is_condition = leaf.kind is NodeKind.CONDITION
    is_told = is_condition or any(one.effects for one in skill.outcomes.values())
    says_it = not (is_condition and _is_asked_otherwise(leaf, skill, told))
    changing = [one for one in skill.outcomes.values() if one.kind is not OutcomeClass.ANSWERED]
    anything = binding | dict.fromkeys(unbound, _MARK)
    return Needs(
        bound(skill.preconditions),
        {
            NodeStatus[name]: (one.kind is OutcomeClass.ANSWERED, bound(one.effects))
            for name, one in skill.outcomes.items()
            if one.effects and name in NodeStatus.__members__ and says_it
        },
        {one.name: list(one.parameters).index(one.exclusive) for one in skill.predicates if one.exclusive is not None},
        tuple(effect.bound(anything) for one in changing for effect in one.effects) if is_told else None,
        skill.duration == (0.0, 0.0),
    )


def _is_asked_otherwise(leaf: TreeNode, skill: Skill, told: Mapping[str, str]) -> bool:
    """Return whether a condition is given more than what its literals are about, and not its default: with another
    limit, or of another topic, it says something else."""
    about = {told.get(name, name) for name in skill.parameters}
    return any(
        port in leaf.ports and port not in about and not _is_default(leaf.ports[port], value)
        for port, value in leaf.port_values.items()
    )


def _is_default(port: Port, value: PortValue) -> bool:
    """Return whether a port is given its default, in any notation."""

    def meant(given: Any) -> Any:
        if isinstance(given, str) and port.type is not None and port.type.from_text is not None:
            with suppress(ConversionError):
                return port.type.parse(given)
        return given

    return value.key is None and bool(
        meant(value.text if value.literal is NO_DEFAULT else value.literal) == meant(port.default)
    )


def _object(leaf: TreeNode, port: str, names: dict[Entry, str]) -> str | None:
    """Return what a port is given: a text, or the name of an entry; None for an entry that is not there."""
    value = leaf.port_values[port]
    if value.key is None:
        return str(value.text)
    entry = leaf.blackboard.entry(value.key)
    if entry is None:
        return None
    return names.setdefault(entry, f'{value.key}{_MARK}{len(names)}')


class Facts:
    """Literals that hold: of each atom that something needs, whether it holds, and what has shown that.

    ``lasting`` are the effects of skills, until something else is known. ``measured`` are the results of conditions, as
    long as no time goes by. What was known of an entry of a blackboard is forgotten when it is written.
    """

    def __init__(self) -> None:
        self.lasting: dict[str, tuple[bool, str]] = {}
        self.measured: dict[str, tuple[bool, str]] = {}
        self.names: dict[Entry, str] = {}
        self._needed: dict[str, Literal] = {}
        self._written: dict[str, int] = {}

    def need(self, needs: Needs) -> None:
        """Something needs this, so that it is of interest."""
        self._needed |= {str(one.atom): one.atom for one in needs.preconditions}

    def refresh(self) -> None:
        """Forget facts about entries that were written since the last time, by any writer."""
        if not self._needed:
            return
        for entry, name in self.names.items():
            if entry.sequence != self._written.get(name) or not entry.present:
                self._written[name] = entry.sequence
                self._forget(atom for atom, one in self._needed.items() if name in one.arguments)

    def begins(self, path: str, needs: Needs, found: Callable[[Violation], None]) -> None:
        """Begin a leaf, and report each of its needs that is known not to hold."""
        self.refresh()
        for one in needs.preconditions:
            atom = str(one.atom)
            holds, source = self.measured.get(atom) or self.lasting.get(atom) or (one.positive, '')
            if holds is not one.positive:
                says = 'has just said' if atom in self.measured else 'has brought about'
                text = f'{path} begins, and its skill needs {_plain(one)}: {source} {says} {_plain(~one)}'
                found(Violation(Property.PRECONDITION, path, text))
        self.works(needs)

    def works(self, needs: Needs) -> None:
        """Forget what a leaf that works, or has worked until now, may change."""
        if not self._needed:
            return
        changes = needs.changes
        changed = self._needed if changes is None else {atom for one in changes for atom in self._near(one, needs)}
        for atom in changed:
            self.lasting.pop(atom, None)
            if needs.is_at_once:  # otherwise it was measured before it has begun, or after its end
                self.measured.pop(atom, None)

    def ends(self, path: str, needs: Needs, status: NodeStatus) -> None:
        """Note what the result of a leaf brings about, or says."""
        if not self._needed:
            return
        self.refresh()
        self.works(needs)
        is_measured, effects = needs.effects.get(status, (False, ()))
        known = self.measured if is_measured else self.lasting
        for effect in effects:
            near = list(self._near(effect, needs))
            self._forget(near)
            if not any(_MARK in one for one in effect.arguments):  # what is not it, but near, is another object
                others = [atom for atom in near if not any(_MARK in one for one in self._needed[atom].arguments)]
                known |= dict.fromkeys(others, (False, path))
        known |= {atom: (one.positive, path) for one in effects if (atom := str(one.atom)) in self._needed}

    def _near(self, effect: Literal, needs: Needs) -> Iterator[str]:
        """Yield the atoms that may be that of an effect, or cannot hold together with it."""
        place = needs.ends.get(effect.predicate) if effect.positive else None
        for atom, one in self._needed.items():
            if one.predicate == effect.predicate and all(
                index == place or mine == other or _MARK in mine + other
                for index, (mine, other) in enumerate(zip(one.arguments, effect.arguments, strict=False))
            ):
                yield atom

    def _forget(self, atoms: Iterable[str]) -> None:
        for atom in atoms:
            self.lasting.pop(atom, None)
            self.measured.pop(atom, None)


def _plain(literal: Literal) -> str:
    """Return a literal for people, without the marks of entries."""
    return str(
        Literal(literal.predicate, tuple(one.partition(_MARK)[0] for one in literal.arguments), literal.positive)
    )
