# SPDX-License-Identifier: BSD-3-Clause
"""Definitions from which running trees are built: documents, trees, nodes, their names, and tree libraries."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Protocol

from .blackboard import Blackboard
from .errors import LoadError, Source, TreeLoadError
from .outcomes import Example, Outcomes
from .ports import Port, PortDirection, PortValue, with_branch
from .status import NodeKind


@dataclass(frozen=True, slots=True)
class NodeManifest:
    """The declaration of a node type, available without an instance.

    ``children`` is the minimum and maximum number of children. ``node_class`` is the class that the engine
    instantiates.
    """

    id: str
    kind: NodeKind
    node_class: type[Any]
    ports: Mapping[str, Port]
    children: tuple[int, int | None]
    description: str
    nav2_branch: str = ''
    """Only branch of Nav2 (see ``NodeRegistry``) that has these nodes; '' if all branches have them."""

    @property
    def documentation(self) -> str:
        """Description; its first paragraph gives the only branch of Nav2 that has these nodes."""
        summary, *rest = self.description.split('\n\n')
        return '\n\n'.join((with_branch(summary, self.nav2_branch), *rest))

    @property
    def example(self) -> Example | None:
        """Example declared by this class itself: a derived class does not inherit it."""
        example = vars(self.node_class).get('example')
        return example if isinstance(example, Example) else None

    @property
    def outcomes(self) -> Outcomes | None:
        """Rule declared by this class itself: a derived class may behave differently."""
        outcomes = vars(self.node_class).get('outcomes')
        return outcomes if isinstance(outcomes, Outcomes) else None


class RunnableScript(Protocol):
    """A script on the blackboard of a node."""

    @property
    def run(self) -> Callable[[], bool | None]:
        """Function that runs the script. It returns the truth of a condition, else None, and raises ScriptError."""


class ParsedScript(Protocol):
    """A script in a definition; its text is valid."""

    @property
    def text(self) -> str: ...

    @property
    def empty(self) -> bool:
        """True if the script does nothing."""

    def bind(self, board: Blackboard, *, condition: bool = False) -> RunnableScript:
        """Return the script on ``board``. A ``condition`` returns its truth when it runs.

        Raises ScriptError if a condition is empty.
        """


class ScriptFactory(Protocol):
    """A factory that makes scripts from texts."""

    @property
    def enums(self) -> Mapping[str, int]:
        """Enum constants available in scripts."""

    def script(self, text: str) -> ParsedScript:
        """Raise ScriptError if the text is not a script."""


NO_CONDITIONS: Final[Mapping[str, ParsedScript]] = {}


class NodeDefinition(NamedTuple):
    """One node of the XML. For a sub-tree, ``tree_id`` is set and ``values`` are the ports of the tree, as given.

    ``extra`` are the attributes that the engine ignores (they begin with ``_``). ``offset`` is the place in the source;
    ``places`` are the places of the attributes, relative to it. ``conditions`` are the pre- and post-conditions, by
    attribute.
    """

    manifest: NodeManifest
    name: str
    values: Mapping[str, PortValue]
    children: tuple[NodeDefinition, ...]
    offset: int
    places: Mapping[str, int]
    extra: Mapping[str, str]
    tree_id: str | None = None
    autoremap: bool = False
    conditions: Mapping[str, ParsedScript] = NO_CONDITIONS

    @property
    def label(self) -> str:
        """Name of the node in error messages."""
        id = self.tree_id or self.manifest.id
        return f'<{self.manifest.id} {self.name!r}>' if self.name != id or self.tree_id else f'<{id}>'


class TreeDefinition(NamedTuple):
    """One <BehaviorTree>."""

    id: str
    root: NodeDefinition
    source: Source
    offset: int

    def nodes(self) -> Iterator[NodeDefinition]:
        """Yield all nodes, parents first, in document order."""
        stack = [self.root]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(reversed(node.children))

    def error(self, node: NodeDefinition, message: str, attribute: str | None = None) -> LoadError:
        """Return an error located at the node, or at one of its attributes."""
        offset = node.offset + (0 if attribute is None else node.places.get(attribute, 0))
        return self.source.error(offset, message, node.label)


class SubTreeModelPort(NamedTuple):
    """A port that a model (<TreeNodesModel>) declares for a tree. With ``default`` None it is required."""

    direction: PortDirection
    default: str | None


class TreeDocument(NamedTuple):
    """The definitions of one file.

    ``main`` is the tree to run by default: the one that the file names as main, or its only tree. ``names_main`` is
    true if the file names it. ``scripts`` is the script factory of the registry that the file was read with.
    """

    file: str
    trees: Mapping[str, TreeDefinition]
    main: str | None
    models: Mapping[str, Mapping[str, SubTreeModelPort]]
    warnings: tuple[LoadError, ...]
    scripts: ScriptFactory
    names_main: bool


# Libraries: documents loaded together, with their references to sub-trees resolved.

MAX_NODES: Final = 65_535
"""Maximum number of nodes of a running tree, sub-trees included: the tools' formats store a uid in 16 bits. Its
sub-trees may have as many ports, which take memory in each instance."""


class TreeKey(NamedTuple):
    """The identity of a tree: the file of its document, and its ID."""

    file: str
    id: str


class TreeLibrary:
    """Documents by file. Immutable: :meth:`stage` returns a new library, or raises and leaves this one unchanged.

    A <SubTree> refers to the tree with that ID in its own document, or else to the one staged last.
    """

    def __init__(self, documents: Iterable[TreeDocument] = (), *, max_nodes: int = MAX_NODES) -> None:
        """Raise TreeLoadError with all errors: unknown trees, recursion, missing ports of models, too many nodes."""
        self._documents = {document.file: document for document in documents}
        self._max_nodes = max_nodes
        self._newest: dict[str, TreeKey] = {}
        self._models: dict[str, Mapping[str, SubTreeModelPort]] = {}
        for document in self._documents.values():
            self._models.update({id: ports for id, ports in document.models.items() if id not in document.trees})
            for id in document.trees:
                self._newest[id] = TreeKey(document.file, id)
        errors = list(_Checker(self).errors())
        if errors:
            raise TreeLoadError(errors)

    def stage(
        self, documents: Iterable[TreeDocument], *, without: Collection[str] = (), in_place: bool = False
    ) -> TreeLibrary:
        """Return a library with these documents added. They replace those of the same files; ``without`` are left out.

        Documents replaced ``in_place`` keep their order; they do not become the newest.
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
        """Return the IDs of all trees, each once."""
        return list(self._newest)

    def tree_keys(self) -> Iterator[TreeKey]:
        for document in self._documents.values():
            for id in document.trees:
                yield TreeKey(document.file, id)

    def find(self, id: str, file: str | None = None) -> TreeKey | None:
        """Return the tree with this ID: from the document ``file`` if it has one, otherwise the one staged last."""
        document = self._documents.get(file) if file is not None else None
        if document is not None and id in document.trees:
            return TreeKey(document.file, id)
        return self._newest.get(id)

    def definition(self, key: TreeKey) -> TreeDefinition:
        return self._documents[key.file].trees[key.id]

    def model(self, key: TreeKey) -> Mapping[str, SubTreeModelPort]:
        """Return the ports that a model declares for a tree, in its own document or else in one without such a tree;
        empty without a model."""
        own = self._documents[key.file].models.get(key.id)
        return self._models.get(key.id, {}) if own is None else own


class _Checker:
    """A check of the references of a library."""

    def __init__(self, library: TreeLibrary) -> None:
        self._library = library
        self._references: dict[TreeKey, list[tuple[NodeDefinition, TreeKey]]] = {}
        self._own_sizes: dict[TreeKey, tuple[int, int]] = {}

    def errors(self) -> Iterator[LoadError]:
        for key in self._library.tree_keys():
            yield from self._read(key)
        yield from self._check_order()

    def _read(self, key: TreeKey) -> Iterator[LoadError]:
        library = self._library
        tree = library.definition(key)
        references = self._references[key] = []
        nodes = ports = 0
        for node in tree.nodes():
            nodes += 1
            if node.tree_id is None:
                continue
            target = library.find(node.tree_id, key.file)
            if target is None:
                known = ', '.join(sorted(library.tree_ids()))
                message = f'there is no tree [{node.tree_id}]; load the file that defines it, too. Known trees: {known}'
                yield tree.error(node, message, 'ID')
                continue
            references.append((node, target))
            model = {} if node.autoremap else library.model(target)
            ports += max(len(model), len(node.values))
            if ports <= library.max_nodes:
                for name, port in model.items():
                    if port.default is None and name not in node.values:
                        yield tree.error(
                            node, f'the model of [{node.tree_id}] declares the port [{name}]; add {name}="{{key}}"'
                        )
        self._own_sizes[key] = nodes, ports

    def _check_order(self) -> Iterator[LoadError]:
        """Visit trees after the trees they refer to; find recursion, and count the nodes and ports of each expanded
        tree."""
        sizes: dict[TreeKey, tuple[int, ...]] = {}
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
                    parts = [sizes.get(target, (0, 0)) for _, target in self._references[key]]
                    sizes[key] = tuple(map(sum, zip(self._own_sizes[key], *parts, strict=True)))
                    for what, size, *others in zip(('nodes with', 'ports of'), sizes[key], *parts, strict=True):
                        # Do not report a tree as too large if a reported tree makes it so.
                        if size > self._library.max_nodes >= max(others, default=0):
                            yield self._too_large(key, f'{size} {what} its sub-trees')

    def _too_large(self, key: TreeKey, size: str) -> LoadError:
        tree = self._library.definition(key)
        return tree.error(tree.root, f'tree [{key.id}] has {size}; the limit is {self._library.max_nodes}')


# Valid names of nodes, trees and ports.

# Attributes that any node may have; ports cannot use these names (source: BehaviorTree.CPP 4).
PRE_POST_ATTRIBUTES: Final = frozenset(
    ('_failureIf', '_successIf', '_skipIf', '_while', '_onHalted', '_onFailure', '_onSuccess', '_post')
)
RESERVED_ATTRIBUTES: Final = PRE_POST_ATTRIBUTES | {'name', 'ID', '_autoremap'}
FORBIDDEN_IN_NAMES: Final = frozenset(' \t\r\n<>&"\'/\\:*?|.')


@functools.lru_cache(1024)
def port_name_problem(name: str) -> str:
    """Return why ``name`` is not valid for a port; '' if it is valid."""
    if not name:
        return 'a port name cannot be empty'
    if name in RESERVED_ATTRIBUTES:
        return f"'{name}' is a reserved attribute name"
    if not (name[0].isascii() and name[0].isalpha()):
        return f"port name '{name}' has to begin with a letter"
    return _forbidden_character(name)


def model_name_problem(name: str, allowed: str = '') -> str:
    """Return why ``name`` cannot be the ID of a node type; '' if it can. It may contain the characters ``allowed``."""
    if not name:
        return 'the name of a tree or node type cannot be empty'
    if name in ('Root', 'root'):
        return f"'{name}' is a reserved name"
    return _forbidden_character(name, allowed)


def tree_name_problem(name: str) -> str:
    """Return why ``name`` is not valid as the ID of a tree; '' if it is valid.

    Spaces between words are allowed: BehaviorTree.CPP up to 4.8 accepts them, and MoveIt Pro's trees use them.
    """
    return model_name_problem(name, allowed=' ' if name == name.strip(' ') else '')


def _forbidden_character(name: str, allowed: str = '') -> str:
    for character in name:
        if (character in FORBIDDEN_IN_NAMES or ord(character) < 0x20 or ord(character) == 0x7F) and (
            character not in allowed
        ):
            return f"name '{name}' contains the character {character!r}, which is not allowed there"
    return ''
