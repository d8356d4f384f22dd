# SPDX-License-Identifier: BSD-3-Clause
"""Check tree files for errors, and for suspicious parts that the engine accepts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.blackboard import Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import ConversionError, LoadError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import STRING, PortType, is_fixed
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.values.text import similar_names
from flexbt_tools.errors import RefusedError
from flexbt_tools.trees.files import read_library, references, roots, shown_name, sub_trees_first, used_trees
from flexbt_tools.trees.key_usage import EntryUsage, KeyUsage, LostWrite, lost_writes, uses

from .diagnostics import (
    INCOMPLETE,
    LOST_WRITE,
    NEVER_READ,
    NEVER_WRITTEN,
    ODDITY,
    REFUSED,
    TYPE_CLASH,
    UNDECLARED,
    UNUSED_PORT,
    UNUSED_TREE,
    CheckRule,
    Diagnostic,
)
from .reachability import incompleteness, short_limits, unreachable_children
from .resources import NO_SKILLS, shared_resources
from .slips import copies, crossed_keys, mixed_up

HOST_KEYS: Final = ('goal', 'goals', 'number_recoveries', 'waypoint_statuses')
"""Keys that the BT server writes before it runs a tree, like Nav2."""


def findings(
    library: TreeLibrary, inputs: Collection[str], *, shared: bool, skills: SkillLibrary = NO_SKILLS
) -> Iterator[Diagnostic]:
    """Yield all findings for the trees of a library.

    Something outside the trees writes the keys ``inputs``. ``shared``: all trees run on one blackboard. ``skills`` are
    those that files declare.
    """
    for document in library.documents.values():
        yield from (Diagnostic(ODDITY, warning) for warning in document.warnings)
    yield from _incomplete(library)
    yield from unreachable_children(library)
    yield from short_limits(library, skills)
    yield from shared_resources(library, skills)
    yield from _unused_trees(library)
    yield from _unused_ports(library)
    usage = KeyUsage(library)
    runs = roots(library)
    mains = {TreeKey(one.file, one.main) for one in library.documents.values() if one.main and one.names_main}
    mains -= used_trees(library)
    boards: list[_Board] = []
    for group in [runs] if shared else [[key] for key in runs]:
        blackboard = Blackboard()
        usages: dict[Entry, EntryUsage] = {}
        errors: list[LoadError] = []
        for key in group:
            try:
                usage.add(key, blackboard, usages)
            except TreeLoadError as error:
                errors += error.errors
        yield from (Diagnostic(REFUSED, error) for error in errors)
        if not errors:
            given = {*inputs, *HOST_KEYS, *(name for key in group for name in library.model(key))}
            names = {entry: name for name in blackboard if (entry := blackboard.entry(name)) is not None}
            boards.append(_Board(list(usages.values()), names, given, is_main=not mains.isdisjoint(group)))
    lost: dict[Entry, list[LostWrite]] = {}
    for one in lost_writes([usage for board in boards for usage in board.usages]):
        lost.setdefault(one.entry, []).append(one)
    for board in boards:
        yield from _of_entries(board, lost)
        yield from crossed_keys(board.usages)


class _Board(NamedTuple):
    """The entries of trees on one blackboard: their ``names`` there, and the keys ``given`` from outside.

    ``is_main`` is true if a file names one of the trees as its main tree: then no other file passes values to it.
    """

    usages: Sequence[EntryUsage]
    names: Mapping[Entry, str]
    given: Collection[str]
    is_main: bool


def _incomplete(library: TreeLibrary) -> Iterator[Diagnostic]:
    for key in library.tree_keys():
        tree = library.definition(key)
        for node in tree.nodes():
            problem = incompleteness(node)
            if problem:
                message = f'{problem}: an error as soon as the node is ticked'
                yield Diagnostic(INCOMPLETE, tree.error(node, message))


def _of_entries(board: _Board, lost: Mapping[Entry, Sequence[LostWrite]]) -> Iterator[Diagnostic]:
    """Yield the findings for the entries of a blackboard."""
    written = {place.use.key for usage in board.usages if usage.is_written for place in usage.writers}
    for usage in board.usages:
        name = board.names.get(usage.entry)
        if usage.readers and not usage.is_written and name not in board.given:
            rule = NEVER_WRITTEN if name is None or board.is_main else UNDECLARED
            yield _never_written(rule, usage, written, name)
        if usage.writers and not usage.is_read:
            place = usage.writers[0]
            is_for_others = name in board.given or place.use.key.startswith('@')
            if usage.entry in lost and not is_for_others:
                yield from map(lost_write, lost[usage.entry])
            else:
                yield Diagnostic(NEVER_READ, place.error(f'key [{place.use.key}] is written, and nothing reads it'))
        yield from _clashes(usage)


def lost_write(one: LostWrite) -> Diagnostic:
    """Return the finding for a value that does not reach its intended reader."""
    key, other = one.writer.use.key, one.reader.use.key
    message = f'key [{key}] is written, and nothing reads it: {one.reader.node.label} after it reads '
    if key == other:
        message += f'the key of this name of another scope; hand it to the sub-tree: {key}="{{{key}}}"'
    else:
        message += f'[{other}], which is as it was before; is [{key}] meant there, or [{other}] here?'
    return Diagnostic(LOST_WRITE, one.writer.error(message))


def _never_written(rule: CheckRule, usage: EntryUsage, written: Collection[str], name: str | None) -> Diagnostic:
    place = usage.readers[0]
    key = place.use.key
    similar = similar_names(key, written)
    if key in written and key.startswith('_'):
        hint = 'another scope has such a key, but keys that begin with _ are not handed to sub-trees: rename it'
    elif key in written:
        hint = f'another scope has such a key, so hand it to the sub-tree: {key}="{{{key}}}"'
    elif similar:
        hint = f'did you mean [{similar[0]}]?'
    elif name is not None:
        hint = f'if the tree is given it, declare it as an input_port in a TreeNodesModel, or say --input {name}'
    else:
        hint = 'hand it to the sub-tree'
    what = 'a first value to it' if usage.writers else 'it'
    return Diagnostic(rule, place.error(f'key [{key}] is read, and nothing writes {what}; {hint}'))


def _clashes(usage: EntryUsage) -> Iterator[Diagnostic]:
    """Yield readers whose type the written value cannot convert to. Clashes of two declared types are errors."""
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
    """Yield attributes of sub-trees that match no key of the tree."""
    known: dict[TreeKey, set[str]] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        enums = library.documents[key.file].scripts.enums
        keys = {use.key for node in tree.nodes() for use in uses(node, enums)}
        for node, target in references(library, key):
            keys.update(value.key for value in node.values.values() if value.key is not None)
            if node.autoremap:
                keys |= known[target] - node.values.keys()
            ports = known[target] | library.model(target).keys()
            for name in node.values.keys() - ports:
                similar = similar_names(name, sorted(ports))
                hint = f'; did you mean [{similar[0]}]?' if similar else ''
                message = f'tree [{target.id}] does not use the key [{name}]{hint}'
                yield Diagnostic(UNUSED_PORT, tree.error(node, message, name))
        # Keys of the topmost scope and private keys cannot be passed to a sub-tree.
        known[key] = {name for name in keys if not name.startswith(('@', '_'))}


# All checks of tree files.

ENTRY_POINTS: Final = 'flexbt.tree_checks'
"""Entry point group through which a package adds checks.

A check is a function of library and registry that yields findings.
"""


def check_trees(
    files: Sequence[str],
    registry: NodeRegistry,
    inputs: Sequence[str] = (),
    *,
    shared: bool = False,
    skills: SkillLibrary = NO_SKILLS,
    texts: Mapping[str, bytes] = MappingProxyType({}),
) -> list[Diagnostic]:
    """Return the findings for the files, in the order of files and places. ``texts`` replace the contents of files.

    Look for warnings only if there are no errors. ``skills`` that files declare replace those of the classes.
    """
    try:
        library = read_library(files, registry, texts)
    except RefusedError as error:
        found = [Diagnostic(REFUSED, reason) for reason in error.errors]
    else:
        own = findings(library, inputs, shared=shared, skills=skills)
        all_found = [*own, *copies(library, registry), *mixed_up(library, registry), *_added(library, registry)]
        found = list(dict.fromkeys(all_found))
    order = {shown_name(file): index for index, file in enumerate(files)}
    return sorted(
        found,
        key=lambda one: (order.get(one.place.file, len(order)), one.place.file, one.place.line, one.place.column),
    )


def _added(library: TreeLibrary, registry: NodeRegistry) -> Iterable[Diagnostic]:
    for point in sorted(entry_points(group=ENTRY_POINTS)):
        yield from point.load()(library, registry)


def joined(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return the findings for people: one for all unregistered node types of a file, at their first node."""
    found: dict[tuple[str, int], list[Diagnostic]] = {}
    for number, one in enumerate(diagnostics):
        found.setdefault((one.place.file, -1 if one.place.unknown else number), []).append(one)
    return [one[0] if not one[0].place.unknown else _unknown_types(one) for one in found.values()]


def _unknown_types(errors: list[Diagnostic]) -> Diagnostic:
    nodes = [one.place for one in errors]
    types = list(dict.fromkeys(f'[{one.unknown}]' for one in nodes))
    told = nodes[0].message if len(types) == 1 else f'node types {", ".join(types)} are not registered'
    several = f' ({len(nodes)} nodes)' if len(nodes) > len(types) else ''
    remedy = 'install their package, describe them by --models FILE, or check the rest by --allow-unknown'
    message = f'{told}{several}; {remedy}'
    return Diagnostic(REFUSED, replace(nodes[0], node='' if len(types) > 1 else nodes[0].node, message=message))
