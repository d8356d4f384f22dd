# SPDX-License-Identifier: BSD-3-Clause
"""Facts that an exploration knows from conditions and from effects of skills, to check preconditions."""

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
"""Mark in the name of a blackboard entry with an unknown value. No text of a tree contains it."""


class Needs(NamedTuple):
    """The preconditions and effects of a leaf, with the values of its ports in place of parameters.

    ``effects`` are the literals of each result, and True if the leaf has measured them rather than caused them.
    ``ends`` is the index of the exclusive argument of a predicate: at most one object holds there. ``changes`` are the
    literals that the leaf may affect once it has begun, with any result; None for all, if its effects are not declared.
    ``is_at_once``: it finishes within a tick.
    """

    preconditions: tuple[Literal, ...] = ()
    effects: Mapping[NodeStatus, tuple[bool, tuple[Literal, ...]]] = MappingProxyType({})
    ends: Mapping[str, int] = MappingProxyType({})
    changes: tuple[Literal, ...] | None = None
    is_at_once: bool = False


def needs_of(leaf: TreeNode, skill: Skill | None, names: dict[Entry, str]) -> Needs:
    """Return the needs of a leaf, with its skill bound by its ports; literals with unbound parameters are omitted.

    ``names`` maps blackboard entries, whose keys differ between sub-trees, to unique names; new ones are added.
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
    """Return whether a condition has a non-default port that its literals do not mention, such as another limit or
    another topic: then its result does not prove them."""
    about = {told.get(name, name) for name in skill.parameters}
    return any(
        port in leaf.ports and port not in about and not _is_default(leaf.ports[port], value)
        for port, value in leaf.port_values.items()
    )


def _is_default(port: Port, value: PortValue) -> bool:
    """Return whether a port has its default value, in any notation."""

    def meant(given: Any) -> Any:
        if isinstance(given, str) and port.type is not None and port.type.from_text is not None:
            with suppress(ConversionError):
                return port.type.parse(given)
        return given

    return value.key is None and bool(
        meant(value.text if value.literal is NO_DEFAULT else value.literal) == meant(port.default)
    )


def _object(leaf: TreeNode, port: str, names: dict[Entry, str]) -> str | None:
    """Return the text of a port, or the name of its entry; None if that entry does not exist."""
    value = leaf.port_values[port]
    if value.key is None:
        return str(value.text)
    entry = leaf.blackboard.entry(value.key)
    if entry is None:
        return None
    return names.setdefault(entry, f'{value.key}{_MARK}{len(names)}')


class Facts:
    """Truth values of the atoms that some leaf needs, each with the path of the leaf that established it.

    ``lasting`` are effects of skills, valid until they are contradicted. ``measured`` are results of conditions, valid
    while no time passes. A write to a blackboard entry discards the facts about it.
    """

    def __init__(self) -> None:
        self.lasting: dict[str, tuple[bool, str]] = {}
        self.measured: dict[str, tuple[bool, str]] = {}
        self.names: dict[Entry, str] = {}
        self._needed: dict[str, Literal] = {}
        self._written: dict[str, int] = {}

    def need(self, needs: Needs) -> None:
        """Track the atoms of these preconditions."""
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
        """Forget the facts that a leaf may change, while it works or when it ends."""
        if not self._needed:
            return
        changes = needs.changes
        changed = self._needed if changes is None else {atom for one in changes for atom in self._near(one, needs)}
        for atom in changed:
            self.lasting.pop(atom, None)
            if needs.is_at_once:  # a longer action begins after, or ends before, the measurement
                self.measured.pop(atom, None)

    def ends(self, path: str, needs: Needs, status: NodeStatus) -> None:
        """Record the facts that the result of a leaf causes or proves."""
        if not self._needed:
            return
        self.refresh()
        self.works(needs)
        is_measured, effects = needs.effects.get(status, (False, ()))
        known = self.measured if is_measured else self.lasting
        for effect in effects:
            near = list(self._near(effect, needs))
            self._forget(near)
            if not any(_MARK in one for one in effect.arguments):  # any other near atom names another object
                others = [atom for atom in near if not any(_MARK in one for one in self._needed[atom].arguments)]
                known |= dict.fromkeys(others, (False, path))
        known |= {atom: (one.positive, path) for one in effects if (atom := str(one.atom)) in self._needed}

    def _near(self, effect: Literal, needs: Needs) -> Iterator[str]:
        """Yield the atoms that may equal that of an effect, or exclude it."""
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
