# SPDX-License-Identifier: BSD-3-Clause
"""Documents that are loaded together, with their references to sub-trees resolved."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from .definition import NodeDefinition, SubTreeModelPort, TreeDefinition, TreeDocument
from .errors import LoadError, TreeLoadError

MAX_NODES: Final = 65_535
"""Nodes of one running tree, sub-trees included: the number of a node has 16 bits in the formats of the tools."""


class TreeKey(NamedTuple):
    """A tree: the file of its document, and its ID."""

    file: str
    id: str


class TreeLibrary:
    """Documents by file. Immutable: :meth:`stage` gives a new library, or raises and leaves this one as it is.

    A <SubTree> means the tree of that ID in its own document, otherwise the one that was staged last.
    """

    def __init__(self, documents: Iterable[TreeDocument] = (), *, max_nodes: int = MAX_NODES) -> None:
        """Raises TreeLoadError with all errors: unknown trees, recursion, missing ports of models, too many nodes."""
        self._documents = {document.file: document for document in documents}
        self._max_nodes = max_nodes
        self._newest: dict[str, TreeKey] = {}
        self._models: dict[str, Mapping[str, SubTreeModelPort]] = {}
        for document in self._documents.values():
            self._models.update(document.models)
            for id in document.trees:
                self._newest[id] = TreeKey(document.file, id)
        errors = list(_Checker(self).errors())
        if errors:
            raise TreeLoadError(errors)

    def stage(
        self, documents: Iterable[TreeDocument], *, without: Collection[str] = (), in_place: bool = False
    ) -> TreeLibrary:
        """A library with these documents added; replaces those of the same files, leaves out ``without``.

        Those that are replaced ``in_place`` do not become the newest.
        """
        merged = {file: document for file, document in self._documents.items() if file not in without}
        for document in documents:
            if not in_place:
                # Staged last, so that its trees are the newest.
                merged.pop(document.file, None)
            merged[document.file] = document
        return TreeLibrary(merged.values(), max_nodes=self._max_nodes)

    @property
    def documents(self) -> Mapping[str, TreeDocument]:
        return MappingProxyType(self._documents)

    @property
    def max_nodes(self) -> int:
        return self._max_nodes

    def tree_ids(self) -> list[str]:
        """The IDs of all trees, each once."""
        return list(self._newest)

    def tree_keys(self) -> Iterator[TreeKey]:
        for document in self._documents.values():
            for id in document.trees:
                yield TreeKey(document.file, id)

    def find(self, id: str, file: str | None = None) -> TreeKey | None:
        """The tree of this ID: the one of the document ``file`` if that has it, otherwise the one staged last."""
        document = self._documents.get(file) if file is not None else None
        if document is not None and id in document.trees:
            return TreeKey(document.file, id)
        return self._newest.get(id)

    def definition(self, key: TreeKey) -> TreeDefinition:
        return self._documents[key.file].trees[key.id]

    def model(self, id: str) -> Mapping[str, SubTreeModelPort]:
        """The ports that models declare for the tree of this ID; empty when there is no model."""
        return self._models.get(id, {})


class _Checker:
    """What is wrong with the references of a library."""

    def __init__(self, library: TreeLibrary) -> None:
        self._library = library
        self._references: dict[TreeKey, list[tuple[NodeDefinition, TreeKey]]] = {}
        self._own_nodes: dict[TreeKey, int] = {}

    def errors(self) -> Iterator[LoadError]:
        for key in self._library.tree_keys():
            yield from self._read(key)
        yield from self._check_order()

    def _read(self, key: TreeKey) -> Iterator[LoadError]:
        library = self._library
        tree = library.definition(key)
        references = self._references[key] = []
        count = 0
        for node in tree.nodes():
            count += 1
            if node.tree_id is None:
                continue
            target = library.find(node.tree_id, key.file)
            if target is None:
                known = ', '.join(sorted(library.tree_ids()))
                message = f'there is no tree [{node.tree_id}]; load the file that defines it, too. Known trees: {known}'
                yield tree.error(node, message, 'ID')
                continue
            references.append((node, target))
            if not node.autoremap:
                for name, port in library.model(node.tree_id).items():
                    if port.default is None and name not in node.values:
                        yield tree.error(
                            node, f'the model of [{node.tree_id}] declares the port [{name}]; add {name}="{{key}}"'
                        )
        self._own_nodes[key] = count

    def _check_order(self) -> Iterator[LoadError]:
        """Visits trees after those that they refer to: finds recursion, and counts the nodes of each as expanded."""
        sizes: dict[TreeKey, int] = {}
        for start in self._references:
            path: dict[TreeKey, Iterator[tuple[NodeDefinition, TreeKey]]] = {}
            if start not in sizes:
                path[start] = iter(self._references[start])
            while path:
                key = next(reversed(path))
                for node, target in path[key]:
                    if target in path:
                        cycle = [*list(path)[list(path).index(target) :], target]
                        names = ' > '.join(step.id for step in cycle)
                        tree = self._library.definition(key)
                        yield tree.error(node, f'recursion: tree [{target.id}] contains itself ({names})', 'ID')
                    elif target not in sizes:
                        path[target] = iter(self._references[target])
                        break
                else:
                    del path[key]
                    size = self._own_nodes[key]
                    size += sum(sizes.get(target, 0) for _, target in self._references[key])
                    sizes[key] = size
                    # A tree that is too large only because of one that was reported is not reported again.
                    largest = max((sizes.get(target, 0) for _, target in self._references[key]), default=0)
                    if size > self._library.max_nodes >= largest:
                        yield self._too_large(key, size)

    def _too_large(self, key: TreeKey, size: int) -> LoadError:
        tree = self._library.definition(key)
        message = f'tree [{key.id}] has {size} nodes with its sub-trees; the limit is {self._library.max_nodes}'
        return tree.error(tree.root, message)
