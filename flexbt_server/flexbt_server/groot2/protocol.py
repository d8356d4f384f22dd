# SPDX-License-Identifier: BSD-3-Clause
"""The messages between a running tree and Groot2: ZeroMQ frames, and the XML that describes the tree.

The client sends requests (REQ), the server replies (REP). Each message begins with a header. On the next port, the
server publishes the breakpoints that were reached (PUB). Source: groot2_protocol.h of BehaviorTree.CPP 4.10.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from typing import Final

from flexbt_core.behavior_tree.engine.leaf import ExpandingAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import NodeDefinition, NodeManifest
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.values.text import xml_attribute, xml_text

PROTOCOL: Final = 2
DEFAULT_PORT: Final = 1667
HEADER_BYTES: Final = 6
RECORD_BYTES: Final = 9
MAX_UID: Final = 0xFFFF
"""Maximum uid of a node: the protocol and the log files have two bytes for it."""

_HEADER: Final = struct.Struct('<BBI')
_RECORD: Final = struct.Struct('<IHHB')
_STATUS: Final = struct.Struct('<HB')
_WENT_IDLE: Final = 10
_SHOWN: Final = {
    **{int(status): status for status in NodeStatus},
    **{_WENT_IDLE + status: status for status in NodeStatus},
    _WENT_IDLE + NodeStatus.RUNNING: NodeStatus.IDLE,  # it was halted
}


class RefusedRequest(Exception):
    """A request that the server refuses; the text is its reason."""


class RequestType(IntEnum):
    """The second byte of a header."""

    FULL_TREE = ord('T')
    STATUS = ord('S')
    BLACKBOARD = ord('B')
    HOOK_INSERT = ord('I')
    HOOK_REMOVE = ord('R')
    BREAKPOINT_REACHED = ord('N')
    BREAKPOINT_UNLOCK = ord('U')
    HOOKS_DUMP = ord('D')
    REMOVE_ALL_HOOKS = ord('A')
    DISABLE_ALL_HOOKS = ord('X')
    TOGGLE_RECORDING = ord('r')
    GET_TRANSITIONS = ord('t')


def request_header(type: RequestType, id: int | None = None) -> bytes:
    """Return the first frame of a request or notification. Without ``id``, the ID is random."""
    return _HEADER.pack(PROTOCOL, type, int.from_bytes(os.urandom(4)) if id is None else id)


def reply_header(request: bytes, tree: bytes) -> bytes:
    """Return the first frame of a reply: the header of the request with our protocol version, and the 16 bytes that
    identify the tree."""
    return bytes((PROTOCOL,)) + request[1:HEADER_BYTES] + tree


def read_reply(request: bytes, frames: Sequence[bytes]) -> tuple[bytes, bytes]:
    """Return the bytes that identify the tree, and the content, of the reply to a request with this header.

    Raises:
        RefusedRequest: the server refuses it.
        ValueError: it is no reply of this protocol.
    """
    if len(frames) == 2 and frames[0] == b'error':
        raise RefusedRequest(frames[1].decode('utf-8', 'replace'))
    header = frames[0] if frames else b''
    if len(header) != HEADER_BYTES + 16 or header[1:HEADER_BYTES] != request[1:] or len(frames) > 2:
        raise ValueError('the reply is not one of this protocol')
    if header[0] != PROTOCOL:
        raise ValueError(f'version {header[0]} of the protocol is not known, only {PROTOCOL} (BehaviorTree.CPP 4)')
    return header[HEADER_BYTES:], frames[1] if len(frames) == 2 else b''


def read_statuses(content: bytes) -> dict[int, NodeStatus]:
    """Return the status of each node by its uid; of an idle one, how it has ended before. Raises ValueError."""
    try:
        return {uid: _SHOWN[number] for uid, number in _STATUS.iter_unpack(content)}
    except (struct.error, KeyError) as error:
        raise ValueError(f'{len(content)} bytes are no statuses of nodes: {error}') from error


def status_bytes(uid: int, status: NodeStatus) -> bytes:
    """Return the bytes of a node in the reply to a request for statuses."""
    return _STATUS.pack(uid, status)


def status_byte(before: int, after: int) -> int:
    """Return the number of a status for clients. For a node that has become IDLE it encodes the status before."""
    return after or _WENT_IDLE + before


def record(microseconds: int, uid: int, status: int) -> bytes:
    """Return the bytes of a transition in a recording or a log file; ``microseconds`` since its start, 48 bits."""
    return _RECORD.pack(microseconds & 0xFFFFFFFF, microseconds >> 32 & 0xFFFF, uid, status)


def read_record(data: bytes, offset: int) -> tuple[int, int, int]:
    """Return microseconds, uid and status of a transition."""
    low, high, uid, status = _RECORD.unpack_from(data, offset)
    return high << 32 | low, uid, status


# The XML that describes a running tree to Groot2, with a separate tree for each instance of a sub-tree, and with uids.
#
# It follows the XML that BehaviorTree.CPP writes for Groot2 and into log files. Trees cannot be loaded from it. It
# contains only the node types that the tree uses.


def tree_document(tree: Tree) -> str:
    """Return the XML of a running tree."""
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
    """Yield the nodes of one sub-tree. ``tree_ids`` has the tree IDs of sub-trees by their paths."""
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
    """Yield the lines of a document with only a TreeNodesModel, for import into Groot2."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<root BTCPP_format="4">'
    yield '  <TreeNodesModel>'
    for manifest in manifests:
        yield from (f'    {line}' for line in model_lines(manifest))
    yield '  </TreeNodesModel>'
    yield '</root>'


def model_lines(manifest: NodeManifest) -> Iterator[str]:
    """Yield the model of a node type."""
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
