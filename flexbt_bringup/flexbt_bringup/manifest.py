# SPDX-License-Identifier: BSD-3-Clause
"""A proposal for a manifest of node types, made of the actions and services of a running robot."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from itertools import chain, count
from typing import Any, Final

import yaml
from rosidl_parser.definition import AbstractSequence, Array, NamespacedType

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.value_types import class_of_slot, interface_class
from flexbt_core.behavior_tree.model.definition import port_name_problem
from flexbt_server.node_manifests import FIXED, KINDS
from flexbt_server.node_types import node_registry

from .graph import Graph

OF_ROS: Final = ('rcl_interfaces/', 'lifecycle_msgs/', 'type_description_interfaces/', 'action_msgs/', 'flexbt_msgs/')
"""Types of services and actions that nodes have besides their own work, and those of FlexBT, which have leaves."""
DEEPEST: Final = 2
"""Levels of messages in each other whose fields become ports; deeper ones are ports as a whole."""
HEAD: Final = """\
# Proposed by "flexbt manifest --from-graph". Remove nodes and fields that trees do not need, and give ports
# descriptions and defaults. Fields that are left out keep the defaults of the message.
"""


def manifest_text(nodes: dict[str, Any]) -> str:
    """Return the text of a manifest with these nodes."""
    return HEAD + yaml.safe_dump({'nodes': nodes}, sort_keys=False, width=120)


def proposed_nodes(graph: Graph, namespace: str) -> dict[str, Any]:
    """Return a node for each action and service in a namespace, by their IDs."""
    taken = {manifest.id for manifest in node_registry(lambda source, error: None)}
    nodes: dict[str, Any] = {}
    for kind, key, found in (('action', 'action', graph.actions), ('srv', 'service', graph.services)):
        for full, types in sorted(found.items()):
            name = full.removeprefix(f'{namespace.rstrip("/")}/')
            (type_name, *_) = types
            if name == full or '/_' in full or type_name.startswith(OF_ROS):
                continue
            try:
                interface = interface_class(type_name, kind)
            except UnknownTypeError:
                continue  # its package is not installed here
            id = _id(name, {*taken, *nodes})
            nodes[id] = _node(kind, key, type_name, name, interface)
    return nodes


def _id(name: str, taken: Collection[str]) -> str:
    """Return an ID that is not taken for the node of a server: ``dock_robot`` becomes DockRobot."""
    words = re.findall(r'[A-Za-z0-9]+', name)
    id = ''.join(word[0].upper() + word[1:] for word in words) or 'Node'
    if not id[0].isalpha() or id in taken:
        id = f'Call{id}'
    return next(one for one in chain([id], (f'{id}{number}' for number in count(2))) if one not in taken)


def _node(kind: str, key: str, type_name: str, name: str, interface: type[Any]) -> dict[str, Any]:
    sent, received = ('goal', 'result') if kind == 'action' else ('request', 'response')
    messages = (interface.Goal, interface.Result) if kind == 'action' else (interface.Request, interface.Response)
    fields: dict[str, str] = {}
    used = set(KINDS[key][0].ports).difference(FIXED)
    for prefix, message in zip((sent, received), messages, strict=True):
        for path in _paths(message):
            port = path.replace('.', '_')
            port = f'{prefix}_{port}' if port in used or port_name_problem(port) else port
            used.add(port)
            fields[f'{prefix}.{path}'] = f'{{{port}}}'
    inputs = {path.strip('{}') for field, path in fields.items() if field.startswith(f'{sent}.')}
    node: dict[str, Any] = {key: type_name, 'name': name, 'description': f'Calls {name}.'}
    if fields:
        node['fields'] = fields
    if inputs:
        node['ports'] = {port: {'optional': True} for port in sorted(inputs)}
    return node


def _paths(message: type[Any], before: str = '', depth: int = 1) -> Iterator[str]:
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        path = f'{before}{name}'
        is_message = isinstance(slot, NamespacedType) and not isinstance(slot, Array | AbstractSequence)
        inner = class_of_slot(slot) if is_message else None
        # Times and poses are one value for a person.
        whole = ('builtin_interfaces', 'geometry_msgs', 'nav_msgs')
        if inner is None or depth == DEEPEST or inner.__module__.startswith(whole):
            yield path
        else:
            yield from _paths(inner, f'{path}.', depth + 1)
