# SPDX-License-Identifier: BSD-3-Clause
"""Node types that are not installed here, as a TreeNodesModel describes them or as a file uses them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, Final

from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import ControlNode, DecoratorNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model import ports as types
from flexbt_core.behavior_tree.model.definition import NodeDefinition, NodeManifest, TreeDefinition, TreeDocument
from flexbt_core.behavior_tree.model.errors import LoadError, RegistrationError, Source
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortDirection, PortType
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.xml.parser import Element, parse

_BASES: Final[Mapping[NodeKind, Any]] = {
    NodeKind.ACTION: LeafNode,
    NodeKind.CONDITION: LeafNode,
    NodeKind.DECORATOR: DecoratorNode,
    NodeKind.CONTROL: ControlNode,
}
_KINDS: Final = {kind.value: kind for kind in _BASES}
_DIRECTIONS: Final = {f'{direction.value}_port': direction for direction in PortDirection}
_ANY_TYPE: Final = 'BT::AnyTypeAllowed'
# C++ names of types that have different names in FlexBT.
_ALIASES: Final = {
    'short': types.INT16,
    'unsigned short': types.UINT16,
    'signed char': types.INT8,
    'unsigned char': types.UINT8,
    'long': types.INT64,
    'unsigned long': types.UINT64,
    'long long': types.INT64,
    'unsigned long long': types.UINT64,
}
_TYPES: Final = {kind.name: kind for kind in vars(types).values() if isinstance(kind, PortType)} | _ALIASES
_TAG: Final = re.compile(r'<(\w+)')
UNKNOWN_PORT: Final = Port(PortDirection.INOUT, declares=False)
"""A port of which only the name is known."""


class StandIn:
    """Marker of classes for node types that are not installed here. Their nodes cannot be ticked.

    ``is_guessed`` is true if no file declares their kind.
    """

    __slots__ = ()

    is_guessed: ClassVar[bool] = False


def _stand_in(
    kind: NodeKind, ports: Mapping[str, Port], where: str = __name__, *, is_guessed: bool = False
) -> type[TreeNode]:
    """Return a class whose module name is ``where``, the file that describes it: messages about its ports show it."""

    def execute(self: TreeNode) -> NodeStatus:
        raise self.fault('this node type is not installed here')

    members = {'__module__': where, 'kind': kind, 'ports': ports, 'execute': execute, 'is_guessed': is_guessed}
    return type('StandIn', (StandIn, _BASES[kind]), members)


def is_stand_in(manifest: NodeManifest) -> bool:
    """Return whether nodes of this type can be shown and checked but not ticked."""
    return issubclass(manifest.node_class, StandIn)


def is_of_unknown_kind(manifest: NodeManifest) -> bool:
    """Return whether no file declares if a leaf of this type is an action or a condition."""
    kind = manifest.node_class
    return issubclass(kind, StandIn) and kind.is_guessed and manifest.kind is NodeKind.ACTION


# -- as a model describes them ---------------------------------------------------------------------------------------


def add_models(registry: NodeRegistry, file: str, text: str) -> list[LoadError]:
    """Register the node types that a <TreeNodesModel> of the file describes, unless they are already registered.

    Return the problems of those that cannot be registered. Raises TreeLoadError if the file is not XML.
    """
    source = Source(file, text)
    errors = []
    known = _TYPES | {
        port.type.name: port.type for manifest in registry for port in manifest.ports.values() if port.type
    }
    for element in _models(parse(source)):
        kind = _KINDS.get(element.tag)
        id = element.attributes.get('ID')
        if kind is None or id is None or id in registry:
            continue
        ports = {
            port.attributes.get('name', ''): _port(port, known) for port in element.children if port.tag in _DIRECTIONS
        }
        try:
            registry.register(id, _stand_in(kind, ports, file))
        except RegistrationError as error:
            errors.append(source.error(element.offset, str(error), str(element)))
    return errors


def _models(root: Element) -> Iterator[Element]:
    for element in root.children:
        if element.tag == 'TreeNodesModel':
            yield from element.children


def _port(element: Element, known: dict[str, PortType]) -> Port:
    attributes = element.attributes
    name = attributes.get('type', '')
    if name not in ('', _ANY_TYPE) and name not in known:
        # A separate type, because only the text of its values is known.
        text = type(name, (str,), {})
        known[name] = PortType(name, text, from_text=text, immutable=True)
    return Port(
        _DIRECTIONS[element.tag],
        known.get(name),
        attributes.get('default', NO_DEFAULT),
        attributes.get('description', ''),
        declares=bool(name),
    )


# -- as a file uses them ---------------------------------------------------------------------------------------------


@lru_cache(maxsize=8)  # all trees of a file share its text
def _described_kinds(text: str) -> Mapping[str, NodeKind]:
    """Return the kinds of the node types that a file describes in its own <TreeNodesModel>."""
    if '<TreeNodesModel' not in text:
        return {}
    models = _models(parse(Source('', text)))
    return {one.attributes.get('ID', ''): _KINDS[one.tag] for one in models if one.tag in _KINDS}


class _AnyPorts(Mapping[str, Port]):
    """A mapping in which every name is a port, and no port is required."""

    def __getitem__(self, name: str) -> Port:
        return UNKNOWN_PORT

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


class OpenRegistry(NodeRegistry):
    """A registry that knows a type for every ID. Call :meth:`settled` for each document read with it."""

    def __init__(self, known: NodeRegistry) -> None:
        super().__init__()
        self.scripts = known.scripts
        self.nav2_branches, self.nav2_branch_of = known.nav2_branches, known.nav2_branch_of
        self._manifests.update((manifest.id, manifest) for manifest in known)

    def get(self, id: str) -> NodeManifest | None:
        known = super().get(id)
        if known is not None:
            return known
        return NodeManifest(id, NodeKind.CONTROL, _stand_in(NodeKind.CONTROL, {}), _AnyPorts(), (0, None), '')

    def settled(self, document: TreeDocument) -> TreeDocument:
        """Return the document with kinds and ports for its unregistered types, derived from how the file uses them."""
        trees = {id: tree._replace(root=self._settled_root(tree)) for id, tree in document.trees.items()}
        return document._replace(trees=trees)

    def _settled_root(self, tree: TreeDefinition) -> NodeDefinition:
        settled: dict[int, NodeDefinition] = {}
        described = _described_kinds(tree.source.text)
        # Documents list parents first, so go from the end: the children are then ready.
        for node in reversed(list(tree.nodes())):
            children = tuple(settled.pop(id(child)) for child in node.children)
            settled[id(node)] = self._settle(tree, node._replace(children=children), described)
        return settled[id(tree.root)]

    def _settle(self, tree: TreeDefinition, node: NodeDefinition, described: Mapping[str, NodeKind]) -> NodeDefinition:
        if not isinstance(node.manifest.ports, _AnyPorts):
            return node
        tag = _TAG.match(tree.source.text, node.offset)
        kind = _KINDS.get(tag.group(1)) if tag is not None else None
        kind = kind or described.get(node.manifest.id)
        count = len(node.children)
        is_guessed = kind is None or (count > 0) != (kind in (NodeKind.CONTROL, NodeKind.DECORATOR))
        if kind is None or is_guessed:
            kind = (NodeKind.ACTION, NodeKind.DECORATOR, NodeKind.CONTROL)[min(count, 2)]
        ports: dict[str, Any] = dict.fromkeys(node.values, UNKNOWN_PORT)
        node_class = _stand_in(kind, ports, is_guessed=is_guessed)
        manifest = replace(node.manifest, kind=kind, ports=ports, node_class=node_class)
        return node._replace(manifest=manifest)
