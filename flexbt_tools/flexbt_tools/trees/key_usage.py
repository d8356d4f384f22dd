# SPDX-License-Identifier: BSD-3-Clause
"""Blackboard keys that nodes read and write: through their ports, by name, and in their scripts."""

from __future__ import annotations

import contextlib
import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter, itemgetter
from typing import NamedTuple

from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import (
    NO_CONDITIONS,
    NodeDefinition,
    ParsedScript,
    TreeDefinition,
    TreeKey,
    TreeLibrary,
)
from flexbt_core.behavior_tree.model.errors import BlackboardError, LoadError
from flexbt_core.behavior_tree.model.ports import KEY, KEYS, NO_DEFAULT, Port, separated
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.script.interpreter import CompiledScript
from flexbt_core.behavior_tree.script.parser import (
    Assignment,
    Binary,
    Comparison,
    Conditional,
    Expression,
    Name,
    Unary,
    parse_script,
)


class KeyUse(NamedTuple):
    """The use of ``key`` by a node, in ``attribute``. If it only ``may_read`` the key, the entry may be missing.

    ``port`` is the declared port; None for a script.
    """

    key: str
    attribute: str
    reads: bool = False
    writes: bool = False
    may_read: bool = False
    port: Port | None = None


def uses(node: NodeDefinition, enums: Collection[str]) -> Iterator[KeyUse]:
    """Yield the keys that a node uses in its own scope. ``enums`` are the names of constants in scripts.

    An argument of a sub-tree leads to entries that other nodes use; it is not a use itself.
    """
    if node.tree_id is None:
        yield from _uses_of_ports(node, enums)
    for attribute, script in node.conditions.items():
        yield from _uses_of_script(attribute, script, enums)


def _uses_of_ports(node: NodeDefinition, enums: Collection[str]) -> Iterator[KeyUse]:
    for name, port in node.manifest.ports.items():
        value = node.values.get(name)
        if value is None:
            # For a port that is not given, nodes of Nav2 read the entry of the same name.
            if port.readable and port.default is NO_DEFAULT:
                yield KeyUse(name, name, may_read=True)
        elif isinstance(value.literal, CompiledScript):
            yield from _uses_of_script(name, value.literal, enums)
        elif value.key is not None:
            is_name = port.literal in (KEY, KEYS)  # what the entry holds says which key is written
            yield KeyUse(value.key, name, reads=port.readable, writes=port.writable and not is_name, port=port)
        elif port.literal in (KEY, KEYS):
            for key in separated(value.text) if port.literal is KEYS else [value.text]:
                yield KeyUse(key, name, reads=not port.writable, writes=port.writable)


def _uses_of_script(attribute: str, script: ParsedScript, enums: Collection[str]) -> Iterator[KeyUse]:
    for statement in parse_script(script.text):
        for use in _uses_of_expression(attribute, statement):
            if use.writes or use.key not in enums:
                yield use


def _uses_of_expression(attribute: str, expression: Expression) -> Iterator[KeyUse]:
    match expression:
        case Name(_, name):
            yield KeyUse(name, attribute, reads=True)
        case Assignment(_, operator, target, value):
            is_changed = operator not in (':=', '=') or target in _always_read(value)
            yield KeyUse(target, attribute, reads=is_changed, writes=True)
    for part in _parts(expression):
        yield from _uses_of_expression(attribute, part)


def _parts(expression: Expression) -> tuple[Expression, ...]:
    match expression:
        case Assignment(_, _, _, value):
            return (value,)
        case Unary(_, _, operand):
            return (operand,)
        case Binary(_, _, left, right):
            return (left, right)
        case Comparison(_, _, operands):
            return operands
        case Conditional(_, condition, then, otherwise):
            return (condition, then, otherwise)
    return ()


def _always_read(expression: Expression) -> Iterator[str]:
    """Yield the names that are read whatever a condition gives."""
    if isinstance(expression, Name):
        yield expression.name
    parts = _parts(expression)
    for part in parts[:1] if isinstance(expression, Conditional) else parts:
        yield from _always_read(part)


# Readers and writers of the blackboard entries of a tree, sub-trees included.
#
# The tree is built as for a run, but from nodes that do nothing. So the engine itself decides which entry a key refers
# to, through remappings, model defaults and ``@``, and which types clash.


class NodePlace(NamedTuple):
    """A use of an entry. ``number`` follows the order of the nodes in the running tree, sub-trees included."""

    tree: TreeDefinition
    node: NodeDefinition
    use: KeyUse
    number: int = 0

    def error(self, message: str) -> LoadError:
        return self.tree.error(self.node, message, self.use.attribute)


@dataclass
class EntryUsage:
    """An entry of the running tree. ``constants`` are the places that set it to a text when the tree is built."""

    entry: Entry
    readers: list[NodePlace] = field(default_factory=list)
    writers: list[NodePlace] = field(default_factory=list)
    constants: list[tuple[NodePlace, str]] = field(default_factory=list)
    may_be_read: bool = False

    @property
    def is_read(self) -> bool:
        """True if something reads it, or may read it because a node uses this name for a port that is not given."""
        return bool(self.readers) or self.may_be_read

    def add(self, place: NodePlace) -> None:
        if place.use.reads:
            self.readers.append(place)
        if place.use.writes:
            self.writers.append(place)
        self.may_be_read |= place.use.may_read

    @property
    def is_written(self) -> bool:
        """True if it has a value from the start, from an attribute of a sub-tree or a model default, or if something
        writes it. A script that changes a value, as ``n += 1``, needs one that is there."""
        return self.entry.value is not EMPTY or not all(_is_changed(place.use) for place in self.writers)


def _is_changed(use: KeyUse) -> bool:
    return use.reads and use.port is None


class _Inert(ControlNode):
    """A stand-in for any node."""

    __slots__ = ()

    def execute(self) -> NodeStatus:
        raise self.fault('this tree is not made to be ticked')


class KeyUsage:
    """The uses of all entries of the trees of a library."""

    def __init__(self, library: TreeLibrary) -> None:
        self._library = library
        self._numbers = itertools.count()
        self._uses: dict[int, tuple[TreeDefinition, tuple[KeyUse, ...]]] = {}
        for document in library.documents.values():
            for tree in document.trees.values():
                for node in tree.nodes():
                    self._uses[id(node)] = tree, tuple(uses(node, document.scripts.enums))

    def add(self, key: TreeKey, board: Blackboard, usages: dict[Entry, EntryUsage]) -> None:
        """Add the uses of a tree that runs on ``board``. Raises TreeLoadError if the tree cannot be built."""
        definitions: list[NodeDefinition] = []

        def inert(node: NodeDefinition, path: str) -> NodeDefinition:
            definitions.append(node)
            return node._replace(manifest=replace(node.manifest, node_class=_Inert), conditions=NO_CONDITIONS)

        tree = Tree(self._library, key.id, file=key.file, blackboard=board, substitute=inert)
        boards = {sub_tree.path: sub_tree.blackboard for sub_tree in tree.subtrees}

        def usage(of: Blackboard, key: str) -> EntryUsage:
            entry = of.declare(key, None)
            return usages.setdefault(entry, EntryUsage(entry))

        for node, definition in zip(tree.nodes, definitions, strict=True):
            owner, node_uses = self._uses[id(definition)]
            number = next(self._numbers)
            for use in node_uses:
                # An entry that cannot be declared was reported, or is an error when a script runs.
                with contextlib.suppress(BlackboardError):
                    usage(node.blackboard, use.key).add(NodePlace(owner, definition, use, number))
            if definition.tree_id is not None:
                for place, text in _constants(owner, definition):
                    usage(boards[node.path], place.use.key).constants.append((place, text))


class LostWrite(NamedTuple):
    """A write by ``writer`` to an ``entry`` that nothing reads, while ``reader`` reads another entry."""

    entry: Entry
    writer: NodePlace
    reader: NodePlace


def lost_writes(usages: Collection[EntryUsage]) -> Iterator[LostWrite]:
    """Yield the writes to entries that nothing reads, if the intended reader is clear.

    The intended reader is the next node that reads a value of the same kind, under two conditions:

    - nothing writes its entry in between;
    - the writer computes the new value from that entry, or it has the same key in another scope.

    A write does not count if another use of the same port of the file is read. Nor does a path elsewhere that is
    planned only to test whether one exists.
    """
    needed = {_output(place) for usage in usages if usage.is_read for place in usage.writers}
    readers: dict[tuple[str, str], list[tuple[int, NodePlace, EntryUsage]]] = {}
    for usage in usages:
        for place in usage.readers:
            if (kind := _kind(place)) is not None:
                readers.setdefault(kind, []).append((place.number, place, usage))
    for alike in readers.values():
        alike.sort(key=itemgetter(0))
    for usage in usages:
        for writer in () if usage.is_read else usage.writers:
            kind = _kind(writer)
            alike = readers.get(kind, []) if kind is not None and _output(writer) not in needed else []
            following = bisect_right(alike, writer.number, key=itemgetter(0))
            if following == len(alike):
                continue
            number, reader, other = alike[following]
            written = _last_before(number, other.writers)
            is_made_of_it = _last_before(writer.number + 1, other.readers) == writer.number
            has_its_name = writer.use.key == reader.use.key and written >= 0
            if written < writer.number and (is_made_of_it or has_its_name):
                yield LostWrite(usage.entry, writer, reader)


def _last_before(number: int, places: Sequence[NodePlace]) -> int:
    """Return the number of the last place before ``number``; -1 for none. The places are sorted by number."""
    index = bisect_left(places, number, key=attrgetter('number'))
    return places[index - 1].number if index else -1


def _output(place: NodePlace) -> tuple[int, str]:
    """Return the identity of a port in a file, the same for all uses of its tree."""
    return id(place.node), place.use.attribute


def _kind(place: NodePlace) -> tuple[str, str] | None:
    """Return the kind of value in a port of objects: its type, and the last word of the port name.

    Return None for numbers and texts: many have equal types and different meanings.
    """
    port = place.use.port
    if port is None or port.type is None or port.type.category != 'object':
        return None
    return port.type.name, place.use.attribute.rpartition('_')[2]


def _constants(tree: TreeDefinition, node: NodeDefinition) -> Iterator[tuple[NodePlace, str]]:
    for name, value in node.values.items():
        if value.key is None:
            yield NodePlace(tree, node, KeyUse(name, name)), value.text
