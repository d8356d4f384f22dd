# SPDX-License-Identifier: BSD-3-Clause
"""Tree files on this computer: their includes, their errors, and the order of their trees."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import (
    NodeDefinition,
    TreeDocument,
    TreeKey,
    TreeLibrary,
    tree_name_problem,
)
from flexbt_core.behavior_tree.model.errors import LoadError, TreeLoadError
from flexbt_core.behavior_tree.xml.parser import MAX_BYTES
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text_files import open_regular
from flexbt_tools.errors import RefusedError

from .stand_ins import OpenRegistry, add_models

STDIN: Final = '-'
"""File name that means the standard input."""

BY_PACKAGE: Final = 'package://'
"""Prefix of a file in the share directory of a package: ``package://PACKAGE/PATH``."""

_TREE_ID: Final = re.compile(r'<BehaviorTree\b[^>]*?\bID\s*=\s*["\']([^"\'<>&]+)["\']')


def read_library(
    files: Sequence[str], registry: NodeRegistry, texts: Mapping[str, bytes] = MappingProxyType({})
) -> TreeLibrary:
    """Return one library of the files, given by path or as ``package://PACKAGE/PATH``.

    ``texts`` contains the contents of documents that are not files, or that replace those of files, also of included
    ones. With an OpenRegistry, node types may be unknown.

    Raises RefusedError with all errors of all files, including references to missing trees.
    """
    documents: list[TreeDocument] = []
    errors: list[LoadError] = []
    for given in dict.fromkeys(files):
        content, file = b'', given
        try:
            file = str(find_resource(given.removeprefix(BY_PACKAGE))) if given.startswith(BY_PACKAGE) else given
            content = texts[file] if file in texts else _content(file)
            document = load_xml(content, shown_name(file), registry, include=partial(_include, texts))
        except OSError as error:
            errors.append(LoadError(shown_name(file), 1, 1, '', f'cannot be read: {error.strerror or error}'))
        except TreeLoadError as error:
            errors.extend(error.errors)
        else:
            documents.append(registry.settled(document) if isinstance(registry, OpenRegistry) else document)
            continue
        documents += _place_holders(file, content, registry)
    try:
        library = TreeLibrary(documents)
    except TreeLoadError as error:
        errors.extend(error.errors)
    if errors:
        raise RefusedError(dict.fromkeys(errors))
    return library


def read_models(files: Sequence[str], registry: NodeRegistry) -> None:
    """Register the node types that the files describe in a <TreeNodesModel>. Raises RefusedError."""
    errors: list[LoadError] = []
    for file in files:
        try:
            errors += add_models(registry, shown_name(file), _content(file).decode('utf-8-sig'))
        except (OSError, UnicodeDecodeError) as error:
            errors.append(LoadError(shown_name(file), 1, 1, '', f'cannot be read: {error}'))
        except TreeLoadError as error:
            errors.extend(error.errors)
    if errors:
        raise RefusedError(errors)


def _place_holders(file: str, content: bytes, registry: NodeRegistry) -> list[TreeDocument]:
    """Return stand-ins for a rejected file: trees with the same names, so that other files find their references."""
    found = dict.fromkeys(_TREE_ID.findall(content.decode('utf-8', 'replace')))
    ids = [id for id in found if not tree_name_problem(id) and id not in registry]
    trees = ''.join(f'<BehaviorTree ID="{id}"><AlwaysSuccess/></BehaviorTree>' for id in ids)
    return [load_xml(f'<root BTCPP_format="4">{trees}</root>', shown_name(file), registry)] if ids else []


def shown_name(file: str) -> str:
    """Return the name of a file in messages. It is the same for a file from the user and for an included file."""
    return '<stdin>' if file == STDIN else os.path.normpath(file)


def _content(file: str) -> bytes:
    # Read one byte more than allowed, so that the reader rejects the file as too long and reports the position.
    if file == STDIN:
        return sys.stdin.buffer.read(MAX_BYTES + 1)
    with open(file, 'rb', opener=open_regular) as content:
        return content.read(MAX_BYTES + 1)


def _include(texts: Mapping[str, bytes], path: str, package: str | None, including: str) -> tuple[str, bytes]:
    """Resolve an include as BehaviorTree.CPP does: relative to the including file or a package's share directory."""
    if package is not None and not path.startswith('/'):
        file = str(find_resource(f'{package}/{path}'))
    else:
        file = os.path.normpath(Path(including).parent / path)
    return file, texts[file] if file in texts else _content(file)


def find_resource(name: str) -> Path:
    """Find ``package/relative/path`` in the share directory of a package. Raises OSError."""
    try:
        from flexbt_common.files import resolve_file
    except ImportError as error:
        raise OSError(f'packages are found by ROS, which is not here: {error}') from error
    try:
        return resolve_file(name)
    except FlexbtError as error:
        raise OSError(str(error)) from error


# References between the trees of a library.


def references(library: TreeLibrary, key: TreeKey) -> Iterator[tuple[NodeDefinition, TreeKey]]:
    """Yield the sub-tree nodes of a tree, and the trees that they refer to."""
    for node in library.definition(key).nodes():
        if node.tree_id is not None:
            target = library.find(node.tree_id, key.file)
            assert target is not None, 'a library has no open references'
            yield node, target


def sub_trees_first(library: TreeLibrary) -> list[TreeKey]:
    """Return all trees, each after the trees that it refers to."""
    order: dict[TreeKey, None] = {}
    for start in library.tree_keys():
        path = [(start, references(library, start))] if start not in order else []
        while path:
            key, rest = path[-1]
            target = next((target for _, target in rest if target not in order), None)
            if target is None:
                order[key] = None
                path.pop()
            else:
                path.append((target, references(library, target)))
    return list(order)


def used_trees(library: TreeLibrary) -> set[TreeKey]:
    """Return the trees that others use as sub-trees. A tree that several documents include counts once."""
    targets = {target for key in library.tree_keys() for _, target in references(library, key)}
    places = {_place(library, target) for target in targets}
    return {key for key in library.tree_keys() if _place(library, key) in places}


def _place(library: TreeLibrary, key: TreeKey) -> tuple[str, int]:
    tree = library.definition(key)
    return tree.source.file, tree.offset


def roots(library: TreeLibrary) -> list[TreeKey]:
    """Return the trees that run on their own, if any: trees that are not sub-trees, and the main trees of all files."""
    used = used_trees(library)
    mains = {TreeKey(document.file, document.main) for document in library.documents.values() if document.main}
    return [key for key in library.tree_keys() if key not in used or key in mains]
