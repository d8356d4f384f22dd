# SPDX-License-Identifier: BSD-3-Clause
"""The nodes and blackboard scopes of a running tree, built from definitions."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import (
    BlackboardError,
    LoadError,
    PortError,
    ScriptError,
    TreeLoadError,
    text_of_cause,
)
from flexbt_core.behavior_tree.model.ports import STRING, PortDirection, PortValue, is_fixed, pointer_key

from .context import TreeContext
from .node import Conditions, NodeConfig, TreeNode, node_path
from .parents import ControlNode, DecoratorNode

Substitute = Callable[[NodeDefinition, str], NodeDefinition]
"""A function that returns the definition to make a node from, for the original definition and the path."""


class SubTreeInstance(NamedTuple):
    """A tree within a running tree. ``path`` is the prefix of its node paths; '' for the main tree."""

    path: str
    tree_id: str
    blackboard: Blackboard


class Instance(NamedTuple):
    """The parts of a running tree. ``nodes`` are in the order of their uid, the root first; ``depth`` is the maximum
    number of nodes from the root to a leaf."""

    nodes: tuple[TreeNode, ...]
    definitions: tuple[NodeDefinition, ...]
    subtrees: tuple[SubTreeInstance, ...]
    depth: int


class _Scope(NamedTuple):
    """A tree within the running tree, with the blackboard of its nodes."""

    tree: TreeDefinition
    file: str
    path: str
    board: Blackboard


def instantiate(
    library: TreeLibrary,
    key: TreeKey,
    blackboard: Blackboard,
    context: TreeContext,
    substitute: Substitute | None = None,
    path: str = '',
    first_uid: int = 1,
) -> Instance:
    """Make the tree ``key`` on ``blackboard``, from the definitions that ``substitute`` returns. ``path`` is the prefix
    of the paths of its nodes.

    Raises TreeLoadError, with all errors, if nodes use one blackboard entry with different types, if the blackboard
    lacks a value that a node is made from, such as a script, or if the constructor of a node raises.
    """
    return _Builder(library, context, substitute, first_uid).build(key, blackboard, path)


class _Builder:
    def __init__(
        self, library: TreeLibrary, context: TreeContext, substitute: Substitute | None, first_uid: int
    ) -> None:
        self._library = library
        self._context = context
        self._substitute = substitute
        self._first_uid = first_uid
        self._errors: list[LoadError] = []
        self._subtrees: dict[str, SubTreeInstance] = {}
        self._nodes: list[TreeNode] = []
        self._definitions: list[NodeDefinition] = []
        self._families: list[tuple[TreeNode, list[TreeNode]]] = []
        # Nodes to make: definition, scope, list of siblings to append to, depth.
        self._pending: list[tuple[NodeDefinition, _Scope, list[TreeNode], int]] = []

    def build(self, key: TreeKey, blackboard: Blackboard, path: str) -> Instance:
        main = self._library.definition(key)
        self._subtrees[path] = SubTreeInstance(path, key.id, blackboard)
        self._pending.append((main.root, _Scope(main, key.file, path, blackboard), [], 1))
        depth = 0
        while self._pending:
            definition, scope, siblings, level = self._pending.pop()
            depth = max(depth, level)
            self._make(definition, scope, siblings, level)
        if self._errors:
            raise TreeLoadError(self._errors)
        for node, children in reversed(self._families):
            if isinstance(node, ControlNode | DecoratorNode):
                node.attach(children)
        return Instance(tuple(self._nodes), tuple(self._definitions), tuple(self._subtrees.values()), depth)

    def _make(self, definition: NodeDefinition, scope: _Scope, siblings: list[TreeNode], level: int) -> None:
        uid = self._first_uid + len(self._nodes)
        if self._substitute is not None:
            id = definition.tree_id or definition.manifest.id
            definition = self._substitute(definition, node_path(scope.path, id, definition.name, uid))
        manifest = definition.manifest
        tree_id = definition.tree_id
        if tree_id is None and definition.values:
            self._declare_entries(definition, scope)
        config = NodeConfig(
            tree_id or manifest.id,
            definition.name,
            uid,
            scope.path,
            self._context,
            scope.board,
            definition.values,
        )
        try:
            node: TreeNode = manifest.node_class(config)
            if definition.conditions:
                node.conditions = Conditions(node, definition.conditions)
        except PortError as error:
            self._errors.append(scope.tree.error(definition, f'port [{error.port}]: {error.reason}', error.port))
            return
        except ScriptError as error:
            self._errors.append(scope.tree.error(definition, str(error)))
            return
        except Exception as error:
            name = manifest.node_class.__name__
            self._errors.append(scope.tree.error(definition, f'{name} cannot be made: {text_of_cause(error)}'))
            return
        self._nodes.append(node)
        self._definitions.append(definition)
        siblings.append(node)
        if tree_id is not None:
            children: list[TreeNode] = []
            self._families.append((node, children))
            self._enter(definition, tree_id, scope, node, children, level)
        elif definition.children:
            children = []
            self._families.append((node, children))
            for child in reversed(definition.children):
                self._pending.append((child, scope, children, level + 1))

    def _enter(
        self,
        definition: NodeDefinition,
        tree_id: str,
        scope: _Scope,
        node: TreeNode,
        children: list[TreeNode],
        level: int,
    ) -> None:
        """Make the scope of a sub-tree, and queue its root."""
        key = self._library.find(tree_id, scope.file)
        assert key is not None
        path = node.path
        if path in self._subtrees:
            message = f'two sub-trees have the path [{path}]; give them different names'
            self._errors.append(scope.tree.error(definition, message, 'name'))
        board = Blackboard(scope.board)
        values = dict(definition.values)
        if not definition.autoremap:
            for name, port in self._library.model(key).items():
                if name not in values and port.default is not None:
                    values[name] = PortValue(port.default, pointer_key(port.default, name))
        for name, value in values.items():
            if value.key is not None:
                board.remap(name, value.key)
            else:
                # Constants belong to the scope itself. They are text: each reader converts them to the type it needs.
                board.set(name, value.text)
        board.enable_autoremap(definition.autoremap)
        self._subtrees[path] = SubTreeInstance(path, tree_id, board)
        tree = self._library.definition(key)
        self._pending.append((tree.root, _Scope(tree, key.file, path, board), children, level + 1))

    def _declare_entries(self, definition: NodeDefinition, scope: _Scope) -> None:
        """Declare the entries that the XML of a node points to, with the types of the ports; not those of defaults."""
        board = scope.board
        for name, port in definition.manifest.ports.items():
            value = definition.values.get(name)
            if value is None or value.key is None or not port.declares or name not in definition.places:
                continue
            try:
                entry = board.entry(value.key)
                if entry is None:
                    board.declare(value.key, port.type)
                    continue
            except BlackboardError as error:
                self._errors.append(scope.tree.error(definition, f'port [{name}]: {error}', name))
                continue
            known = entry.type
            if not is_fixed(known) or not is_fixed(port.type):
                continue
            # Readers convert the values of a text entry.
            writable = known is STRING or known.same(port.type)
            if not (port.type.may_read(known) if port.direction is PortDirection.INPUT else writable):
                message = (
                    f'port [{name}] uses the blackboard entry [{value.key}] with the type {port.type.name}, '
                    f'but it has the type {known.name} already; use another key, or another blackboard'
                )
                self._errors.append(scope.tree.error(definition, message, name))
