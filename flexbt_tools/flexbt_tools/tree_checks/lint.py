# SPDX-License-Identifier: BSD-3-Clause
"""What is suspicious about trees that the engine takes: what is likely a slip, although it runs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Final

from flexbt_core.behavior_tree import (
    Blackboard,
    ConversionError,
    Entry,
    LoadError,
    PortType,
    TreeKey,
    TreeLibrary,
    TreeLoadError,
)
from flexbt_core.behavior_tree.model import STRING, is_fixed
from flexbt_core.skills import SkillLibrary
from flexbt_core.values import similar_names
from flexbt_tools.trees import (
    EntryUsage,
    KeyUsage,
    Place,
    references,
    roots,
    sub_trees_first,
    used_trees,
    uses,
)

from .diagnostics import (
    INCOMPLETE,
    NEVER_READ,
    NEVER_WRITTEN,
    ODDITY,
    REFUSED,
    TYPE_CLASH,
    UNUSED_PORT,
    UNUSED_TREE,
    Diagnostic,
)
from .meanings import crossed_keys
from .reachability import incompleteness, unreachable_children
from .resources import shared_resources

_NO_SKILLS: Final = SkillLibrary()

HOST_KEYS: Final = ('goal', 'goals', 'number_recoveries')
"""Keys that the BT server writes before it runs a tree, as Nav2 does."""


def findings(
    library: TreeLibrary, inputs: Collection[str], *, shared: bool, skills: SkillLibrary = _NO_SKILLS
) -> Iterator[Diagnostic]:
    """Everything that is found in the trees of a library.

    ``inputs`` are keys that are written from outside. ``shared`` tells that all trees run on one blackboard.
    ``skills`` are those that files declare.
    """
    for document in library.documents.values():
        yield from (Diagnostic(ODDITY, warning) for warning in document.warnings)
    yield from _incomplete(library)
    yield from unreachable_children(library)
    yield from shared_resources(library, skills)
    yield from _unused_trees(library)
    yield from _unused_ports(library)
    usage = KeyUsage(library)
    runs = roots(library)
    for group in [runs] if shared else [[key] for key in runs]:
        board = Blackboard()
        usages: dict[Entry, EntryUsage] = {}
        errors: list[LoadError] = []
        for key in group:
            try:
                usage.add(key, board, usages)
            except TreeLoadError as error:
                errors += error.errors
        yield from (Diagnostic(REFUSED, error) for error in errors)
        if not errors:
            given = {*inputs, *HOST_KEYS, *(name for key in group for name in library.model(key.id))}
            yield from _of_entries(list(usages.values()), board, given)
            yield from crossed_keys(usages.values())


def _incomplete(library: TreeLibrary) -> Iterator[Diagnostic]:
    for key in library.tree_keys():
        tree = library.definition(key)
        for node in tree.nodes():
            problem = incompleteness(node)
            if problem:
                message = f'{problem}: an error as soon as the node is ticked'
                yield Diagnostic(INCOMPLETE, tree.error(node, message))


def _of_entries(usages: Sequence[EntryUsage], board: Blackboard, given: Collection[str]) -> Iterator[Diagnostic]:
    """What is wrong with the entries of the trees that run on ``board``, where the keys ``given`` have values."""
    inputs = {entry for key in given if (entry := board.entry(key)) is not None}
    names = {entry: key for key in board if (entry := board.entry(key)) is not None}
    written = {place.use.key for usage in usages for place in usage.writers}
    for usage in usages:
        if usage.readers and not usage.writers and not usage.given and usage.entry not in inputs:
            yield _never_written(usage.readers, written, names.get(usage.entry))
        if usage.writers and not usage.readers and not usage.may_be_read:
            place = usage.writers[0]
            yield Diagnostic(NEVER_READ, place.error(f'key [{place.use.key}] is written, and nothing reads it'))
        yield from _clashes(usage)


def _never_written(readers: Sequence[Place], written: Collection[str], name: str | None) -> Diagnostic:
    place = readers[0]
    key = place.use.key
    similar = similar_names(key, written)
    if key in written and key.startswith('_'):
        hint = 'another scope has such a key, but keys that begin with _ are not handed to sub-trees: rename it'
    elif key in written:
        hint = f'another scope has such a key, so hand it to the sub-tree: {key}="{{{key}}}"'
    elif similar:
        hint = f'did you mean [{similar[0]}]?'
    elif name is not None:
        hint = f'if the tree is given it, say --input {name}'
    else:
        hint = 'hand it to the sub-tree'
    return Diagnostic(NEVER_WRITTEN, place.error(f'key [{key}] is read, and nothing writes it; {hint}'))


def _clashes(usage: EntryUsage) -> Iterator[Diagnostic]:
    """Readers of types to which what is written cannot be converted. Clashes of two declared types are errors."""
    for reader in usage.readers:
        kind = reader.use.port.type if reader.use.port is not None else None
        if not is_fixed(kind) or kind.category == 'text':
            continue
        key = reader.use.key
        if kind.from_text is None and usage.entry.type is STRING:
            message = f'key [{key}] holds text, which cannot be read as {kind.name}'
            yield Diagnostic(TYPE_CLASH, reader.error(message))
        for place, text in usage.constants:
            problem = _conversion_problem(kind, text)
            if problem:
                message = f'port [{reader.use.attribute}] of {reader.node.label} reads it as {kind.name}: {problem}'
                yield Diagnostic(TYPE_CLASH, place.error(message))


def _conversion_problem(kind: PortType, text: str) -> str:
    try:
        kind.parse(text)
    except ConversionError as error:
        return str(error)
    return ''


def _unused_trees(library: TreeLibrary) -> Iterator[Diagnostic]:
    used = used_trees(library)
    for document in library.documents.values():
        for id, tree in document.trees.items():
            own = tree.source.file == document.file
            if own and document.main not in (None, id) and TreeKey(document.file, id) not in used:
                message = f'tree [{id}] is never used: it is neither the main tree [{document.main}] nor a sub-tree'
                yield Diagnostic(UNUSED_TREE, tree.source.error(tree.offset, message))


def _unused_ports(library: TreeLibrary) -> Iterator[Diagnostic]:
    """Attributes of sub-trees that name no key of the tree that is meant."""
    known: dict[TreeKey, set[str]] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        enums = library.documents[key.file].scripts.enums
        keys = {use.key for node in tree.nodes() for use in uses(node, enums)}
        for node, target in references(library, key):
            keys.update(value.key for value in node.values.values() if value.key is not None)
            if node.autoremap:
                keys |= known[target] - node.values.keys()
            ports = known[target] | library.model(target.id).keys()
            for name in node.values.keys() - ports:
                similar = similar_names(name, sorted(ports))
                hint = f'; did you mean [{similar[0]}]?' if similar else ''
                message = f'tree [{target.id}] does not use the key [{name}]{hint}'
                yield Diagnostic(UNUSED_PORT, tree.error(node, message, name))
        # Of the topmost scope, and private: nothing that a sub-tree can be given.
        known[key] = {name for name in keys if not name.startswith(('@', '_'))}
