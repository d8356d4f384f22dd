# SPDX-License-Identifier: BSD-3-Clause
"""The XML that describes a running tree to Groot2: every instance of a sub-tree by itself, with the uids of its nodes.

As BehaviorTree.CPP writes it for Groot2 and into log files; it is no document to load trees from. Of the node types it
has those that the tree uses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from flexbt_core.behavior_tree import ExpandingAction, NodeDefinition, NodeManifest, Port, Tree, TreeNode
from flexbt_core.behavior_tree.model import NO_DEFAULT
from flexbt_core.values import xml_attribute, xml_text


def tree_document(tree: Tree) -> str:
    """The XML of a running tree."""
    return '\n'.join(_lines(tree)) + '\n'


def _lines(tree: Tree) -> Iterator[str]:
    yield '<root BTCPP_format="4">'
    roots: dict[int, TreeNode] = {}
    for node in tree.nodes:
        roots.setdefault(id(node.blackboard), node)
    definitions = dict(zip(tree.nodes, tree.definitions, strict=True))
    tree_ids = {subtree.path: subtree.tree_id for subtree in tree.subtrees}
    for subtree in tree.subtrees:
        yield f'  <BehaviorTree{_attributes(ID=subtree.tree_id, _fullpath=subtree.path)}>'
        yield from _nodes(roots[id(subtree.blackboard)], definitions, tree_ids)
        yield '  </BehaviorTree>'
    used = {definition.manifest.id: definition.manifest for definition in tree.definitions}
    yield '  <TreeNodesModel>'
    for _, manifest in sorted(used.items()):
        yield from (f'    {line}' for line in model_lines(manifest))
    yield '  </TreeNodesModel>'
    yield '</root>'


def _nodes(root: TreeNode, definitions: dict[TreeNode, NodeDefinition], tree_ids: Mapping[str, str]) -> Iterator[str]:
    """The nodes of one sub-tree. ``tree_ids`` has the trees of sub-trees by their paths."""
    pending: list[tuple[int, TreeNode | str]] = [(2, root)]
    while pending:
        level, node = pending.pop()
        indent = '  ' * level
        if isinstance(node, str):
            yield f'{indent}</{node}>'
            continue
        definition = definitions[node]
        below = definition.tree_id
        if isinstance(node, ExpandingAction) and node.attached:
            below = tree_ids[node.path]
        tag = definition.manifest.id if below is None else 'SubTree'
        children = node.attached if below is None else ()
        yield f'{indent}<{tag}{_node_attributes(node, definition, below)}{">" if children else "/>"}'
        if children:
            pending.append((level, tag))
            pending.extend((level + 1, child) for child in reversed(children))


def _node_attributes(node: TreeNode, definition: NodeDefinition, below: str | None) -> str:
    values = {name: value.text for name, value in definition.values.items()}
    scripts = {name: script.text for name, script in definition.conditions.items()}
    if below is not None:
        return _attributes(ID=below, _fullpath=node.path, _uid=str(node.uid), **values, **scripts)
    return _attributes(name=node.name, _uid=str(node.uid), **values, **scripts)


def _attributes(**values: str) -> str:
    return ''.join(f' {name}={xml_attribute(value)}' for name, value in values.items())


def models_document(manifests: Iterable[NodeManifest]) -> Iterator[str]:
    """Lines of a document with nothing but a TreeNodesModel, as Groot2 imports it."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<root BTCPP_format="4">'
    yield '  <TreeNodesModel>'
    for manifest in manifests:
        yield from (f'    {line}' for line in model_lines(manifest))
    yield '  </TreeNodesModel>'
    yield '</root>'


def model_lines(manifest: NodeManifest) -> Iterator[str]:
    """The model of a node type."""
    head = f'{manifest.kind.value} ID={xml_attribute(manifest.id)}'
    inner = [_port(name, port) for name, port in manifest.ports.items()]
    if manifest.documentation:
        text = xml_attribute(' '.join(manifest.documentation.split()))
        inner += ['<MetadataFields>', f'  <Metadata description={text}/>', '</MetadataFields>']
    if not inner:
        yield f'<{head}/>'
        return
    yield f'<{head}>'
    yield from (f'  {line}' for line in inner)
    yield f'</{manifest.kind.value}>'


def _port(name: str, port: Port) -> str:
    tag = f'{port.direction.value}_port'
    kind = '' if port.type is None else f' type={xml_attribute(port.type.name)}'
    default = '' if port.default is NO_DEFAULT else f' default={xml_attribute(str(port.default))}'
    return f'<{tag} name={xml_attribute(name)}{kind}{default}>{xml_text(port.documentation)}</{tag}>'
