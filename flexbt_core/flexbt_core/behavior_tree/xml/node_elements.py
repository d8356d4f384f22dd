# SPDX-License-Identifier: BSD-3-Clause
"""The node elements of a document: their node types, ports and children, and the problems in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final, Protocol

from flexbt_core.behavior_tree.model.definition import (
    NO_CONDITIONS,
    PRE_POST_ATTRIBUTES,
    RESERVED_ATTRIBUTES,
    NodeDefinition,
    NodeManifest,
    ParsedScript,
    ScriptFactory,
    port_name_problem,
    tree_name_problem,
)
from flexbt_core.behavior_tree.model.errors import ConversionError, ElementError, LoadError, ScriptError, Source
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortValue, bool_from_text, is_fixed, pointer_key
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.behavior_tree.script.interpreter import CONDITION, SCRIPT
from flexbt_core.values.text import pluralize, similar_names

from .parser import Element, value_offset

_CONTROL_CHARACTER: Final = re.compile(r'[^\t\r\n -\U0010ffff]')
EXPLICIT_TAGS: Final = frozenset(kind.value for kind in NodeKind)
OPTIONAL_TYPES: Final = {'ReachGoal': 'flexbt_formal'}
"""Optional packages of FlexBT, by the node types that they add."""


class NodeTypes(Protocol):
    """The node types that a document may name."""

    @property
    def scripts(self) -> ScriptFactory: ...

    def get(self, id: str) -> NodeManifest | None: ...

    def suggestions(self, id: str) -> list[str]:
        """Return known IDs similar to ``id``, best first."""

    def __contains__(self, id: str) -> bool: ...


class DocumentTypes(NodeTypes, Protocol):
    """The node types of all documents; the meaning of an ID may depend on the file."""

    def types_for(self, elements: Iterable[tuple[str, Mapping[str, str]]]) -> NodeTypes:
        """Return the node types for a file, from the ID (or else the tag) and the attributes of each element."""


def elements_of(root: Element) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Yield the elements that show which software a file was written for: the root, its trees and nodes."""
    yield root.tag, root.attributes
    pending = [element for element in root.children if element.tag == 'BehaviorTree']
    while pending:
        element = pending.pop()
        is_node = element.tag in EXPLICIT_TAGS and element.tag != NodeKind.SUBTREE.value
        yield element.attributes.get('ID', '') if is_node else element.tag, element.attributes
        pending += element.children


class NodeReader:
    """A reader of the nodes of one tree; it adds problems to ``errors`` and continues."""

    def __init__(self, source: Source, registry: NodeTypes, errors: list[LoadError]) -> None:
        self._source = source
        self._registry = registry
        self._errors = errors

    def read(self, root: Element) -> NodeDefinition | None:
        """Return the definition of ``root`` with all descendants; None if something is wrong with it."""
        before = len(self._errors)
        read: list[tuple[Element, NodeDefinition | None]] = []
        # Elements with identical text share their attributes, and are read once.
        known: dict[tuple[str, int, int], NodeDefinition] = {}
        stack = [root]
        while stack:
            element = stack.pop()
            children = element.children
            key = element.tag, id(element.attributes), len(children)
            node = known.get(key)
            if node is None:
                node = self._read_alone(element)
                if node is not None and len(self._errors) == before and node.manifest.id != 'ReactiveSequence':
                    known[key] = node
            read.append((element, node))
            if children:
                stack += children[::-1]
        self._errors[before:] = sorted(self._errors[before:], key=lambda error: (error.line, error.column))
        if len(self._errors) > before:
            return None
        # Built from the end of the list: of the nodes without a parent so far, the last ones are the children of the
        # next.
        built: list[NodeDefinition] = []
        for element, node in reversed(read):
            assert node is not None
            count = len(element.children)
            manifest, name, values, below, _, places, extra, tree_id, autoremap, conditions = node
            if count:
                below = tuple(built[: -count - 1 : -1])
                del built[-count:]
            built.append(
                NodeDefinition(
                    manifest, name, values, below, element.offset, places, extra, tree_id, autoremap, conditions
                )
            )
        return built[0]

    def _read_alone(self, element: Element) -> NodeDefinition | None:
        """Return the definition of an element without its children; None if something is wrong with it."""
        manifest = self._manifest(element)
        if manifest is None:
            return None
        self._check_children(element, manifest)
        for_element = getattr(manifest.node_class, 'for_element', None)
        if for_element is not None:
            try:
                node_class = for_element(element.attributes)
            except ElementError as error:
                for attribute, reason in error.problems:
                    self._error(element, f'[{attribute}]: {reason}', attribute)
                return None
            manifest = replace(manifest, node_class=node_class, ports=node_class.ports)
        return self._node(element, manifest)

    # -- node type and structure -------------------------------------------------------------------------------------

    def _manifest(self, element: Element) -> NodeManifest | None:
        """Return the registered node type of the element. Report an unknown type and return None."""
        tag = element.tag
        id = element.attributes.get('ID')
        if tag == 'SubTree':
            return self._subtree_manifest(element, id)
        if tag in EXPLICIT_TAGS:
            if id is None:
                self._error(element, f"<{tag}> needs the attribute 'ID', the node type")
                return None
        else:
            if id is not None:
                self._error(element, f'attribute [ID] is not allowed in <{tag}>; the tag is the node type', 'ID')
            id = tag
        manifest = self._registry.get(id)
        if manifest is None:
            self._unknown_node(element, id)
        return manifest

    def _subtree_manifest(self, element: Element, id: str | None) -> NodeManifest | None:
        if id is None:
            self._error(element, "<SubTree> needs the attribute 'ID', the tree")
            return None
        problem = tree_name_problem(id)
        if problem:
            self._error(element, problem, 'ID')
        elif id in self._registry:
            remedy = '' if id == 'SubTree' else f'; use <{id}> instead of <SubTree>'
            self._error(element, f'[{id}] is a node type, not a tree{remedy}', 'ID')
        return self._registry.get('SubTree')

    def _unknown_node(self, element: Element, id: str) -> None:
        if id == 'SubTreePlus':
            message = 'SubTreePlus is of format 3; write <SubTree> with _autoremap'
        elif id == 'SequenceStar':
            message = 'SequenceStar is of format 3; write <SequenceWithMemory>'
        else:
            message = f'node type [{id}] is not registered'
            package = OPTIONAL_TYPES.get(id)
            if package is not None:
                message += f'; it is a leaf of the package {package}, which is not installed here'
            similar = [] if package else self._registry.suggestions(id)
            if not similar:
                self._error(element, message, unknown=id)
                return
            message += f'; did you mean {" or ".join(similar)}?'
        self._error(element, message)

    def _check_children(self, element: Element, manifest: NodeManifest) -> None:
        count = len(element.children)
        least, most = manifest.children
        if count < least or (most is not None and count > most):
            if most == 0:
                message = f'{manifest.kind.value} [{manifest.id}] has no children; {count} are given'
            elif least == most:
                message = f'{manifest.kind.value} [{manifest.id}] has exactly {_children(least)}, not {count}'
            elif most is None:
                message = f'{manifest.kind.value} [{manifest.id}] has {_children(least)} or more, not {count}'
            else:
                message = f'{manifest.kind.value} [{manifest.id}] has {least} to {_children(most)}, not {count}'
            self._error(element, message)
        if manifest.id == 'ReactiveSequence':
            asynchronous = [
                child for child in element.children if 'AsyncSequence' in (child.tag, child.attributes.get('ID'))
            ]
            if len(asynchronous) > 1:
                self._error(asynchronous[1], 'a ReactiveSequence cannot have more than one AsyncSequence as its child')

    # -- attributes --------------------------------------------------------------------------------------------------

    def _node(self, element: Element, manifest: NodeManifest) -> NodeDefinition | None:
        is_subtree = manifest.kind is NodeKind.SUBTREE
        tree_id = element.attributes.get('ID') if is_subtree else None
        values: dict[str, PortValue] = {}
        extra: dict[str, str] = {}
        conditions = NO_CONDITIONS
        autoremap = False
        for attribute, text in element.attributes.items():
            if attribute in RESERVED_ATTRIBUTES:
                if attribute in PRE_POST_ATTRIBUTES:
                    script = self._script(element, attribute, text, may_be_empty=False)
                    if script is not None:
                        conditions = {**conditions, attribute: script}
                elif attribute == '_autoremap' and is_subtree:
                    autoremap = self._autoremap(element, text)
            elif port_name_problem(attribute) and attribute not in manifest.ports:
                extra[attribute] = text
            elif is_subtree:
                values[attribute] = PortValue(text, pointer_key(text, attribute))
            else:
                value = self._port_value(element, manifest, attribute, text)
                if value is not None:
                    values[attribute] = value
        if not is_subtree:
            self._add_absent(element, manifest, values)
        name = element.attributes.get('name')
        if name is not None and _CONTROL_CHARACTER.search(name):
            self._error(element, 'the name contains a control character', 'name')
        if name is None:
            name = tree_id or manifest.id
        return NodeDefinition(
            manifest, name, values, (), element.offset, element.places, extra, tree_id, autoremap, conditions
        )

    def _script(self, element: Element, attribute: str, text: str, *, may_be_empty: bool) -> ParsedScript | None:
        try:
            script = self._registry.scripts.script(text)
            if script.empty and not may_be_empty:
                raise ScriptError(text, 0, 'the script is empty')
        except ScriptError as error:
            place = value_offset(self._source, element.offset_of(attribute), text, error.offset)
            self._errors.append(self._source.error(place, f'script of [{attribute}]: {error.reason}', str(element)))
            return None
        return script

    def _autoremap(self, element: Element, text: str) -> bool:
        try:
            return bool_from_text(text)
        except ConversionError as error:
            self._error(element, f'[_autoremap]: {error}', '_autoremap')
            return False

    def _port_value(self, element: Element, manifest: NodeManifest, name: str, text: str) -> PortValue | None:
        port = manifest.ports.get(name)
        if port is None:
            known = ', '.join(manifest.ports) or 'none'
            similar = similar_names(name, manifest.ports)
            hint = f'did you mean [{similar[0]}]? ' if similar else ''
            message = f'[{manifest.id}] has no port [{name}]; {hint}its ports are: {known}'
            self._error(element, message + _origin(manifest), name)
            return None
        key = pointer_key(text, name)
        if key is not None:
            return PortValue(text, key)
        if not port.readable:
            self._error(
                element,
                f'output port [{name}] has to point to the blackboard, as in {name}="{{key}}", not "{text}"',
                name,
            )
            return None
        return self._literal(element, port, name, text)

    def _literal(self, element: Element, port: Port, name: str, text: str) -> PortValue | None:
        kind = port.literal or port.type
        if not is_fixed(kind):
            return PortValue(text, None, text)
        if kind in (SCRIPT, CONDITION):
            script = self._script(element, name, text, may_be_empty=kind is SCRIPT)
            return None if script is None else PortValue(text, None, script)
        if kind.from_text is None:
            self._error(
                element,
                f'port [{name}] of type {kind.name} cannot be written as text; write {name}="{{key}}"',
                name,
            )
            return None
        try:
            value = kind.parse(text)
        except ConversionError as error:
            self._error(element, f'port [{name}] of type {kind.name}: {error}', name)
            return None
        return PortValue(text, None, value if kind.immutable else NO_DEFAULT)

    def _add_absent(self, element: Element, manifest: NodeManifest, values: dict[str, PortValue]) -> None:
        """Add the defaults of absent ports; report required ports without a default."""
        for name, port in manifest.ports.items():
            if name in values or name in element.attributes:
                continue
            default = port.default
            if default is NO_DEFAULT:
                if port.required:
                    kind = f' of type {port.type.name}' if port.type is not None else ''
                    message = f'port [{name}]{kind} of [{manifest.id}] is missing; add {name}="..."'
                    self._error(element, message + _origin(manifest))
            elif isinstance(default, str):
                key = pointer_key(default, name)
                value = PortValue(default, key) if key is not None else self._literal(element, port, name, default)
                if value is not None:
                    values[name] = value
            else:
                values[name] = PortValue(str(default), None, default)

    def _error(self, element: Element, message: str, attribute: str | None = None, unknown: str = '') -> None:
        where = element.offset_of(attribute)
        self._errors.append(replace(self._source.error(where, message, str(element)), unknown=unknown))


def _origin(manifest: NodeManifest) -> str:
    """Return the origin of a node type: the user may mean one of the same name from a missing package."""
    module = manifest.node_class.__module__
    return '' if module.startswith('flexbt_core.') else f' (the [{manifest.id}] of {module})'


def _children(count: int) -> str:
    return pluralize(count, 'child', 'children')
