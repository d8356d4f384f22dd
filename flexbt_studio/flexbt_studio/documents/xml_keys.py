# SPDX-License-Identifier: BSD-3-Clause
"""Where the nodes of a tree name blackboard keys: in pointers, in scripts, and in ports whose text is a key."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.definition import PRE_POST_ATTRIBUTES, NodeManifest, port_name_problem
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ConversionError
from flexbt_core.behavior_tree.model.ports import KEY, KEYS, Port, bool_from_text, pointer_key
from flexbt_core.behavior_tree.script.interpreter import CONDITION, SCRIPT
from flexbt_core.behavior_tree.script.parser import TokenKind, tokenize
from flexbt_core.behavior_tree.xml.node_elements import EXPLICIT_TAGS, NodeTypes

from .text import Span
from .xml_text import XmlElement, raw_places

SUBTREES: Final = ('SubTree', 'SubTreePlus')
_EXPLICIT: Final = (*EXPLICIT_TAGS, 'SubTreePlus')
_AUTOREMAP: Final = ('_autoremap', '__autoremap', '__shared_blackboard')
_ASSIGNMENTS: Final = (':=', '=', '+=', '-=', '*=', '/=')
_READ_BY_DEFAULT: Final = 'by default the entry [{}]'
"""What the description of a port has if the node reads the entry of that name when the port is not given."""
_REMOVED_KEY: Final = ('UnsetBlackboard', 'key')
_FIELDS: Final = re.compile(r'(?<=[A-Za-z0-9_])(?:\.[A-Za-z0-9_]+)+')
_WORDS: Final = re.compile(r'[^;\s](?:[^;]*[^;\s])?')
_SCRIPT_NAME: Final = re.compile('[A-Za-z_@][A-Za-z0-9_]*')


Defaults = Mapping[str, list[tuple[str, str]]]
"""Ports and keys by the ID of a tree."""


class KeyUse(NamedTuple):
    """A place that names a key.

    ``form`` is one of:

    - ``pointer``, ``{key}``; ``same``, ``{=}``; ``key``, a bare key; ``script``, a name in a script;
    - ``argument``, the value of an attribute of a sub-tree;
    - ``own``, a bare key of the tree alone, whatever the ports of a sub-tree;
    - ``absent``, a port that is not given, where the node then reads the entry of the same name;
    - ``default``, a port of a sub-tree that is not given, where its model names the key.

    ``span`` is what is replaced in the text; empty for the last two. ``port`` is that of a known node type.
    """

    key: str
    element: XmlElement
    attribute: str
    form: str
    span: Span
    port: Port | None = None
    writes: bool = False
    updates: bool = False
    """Whether a script writes what it computes of the value before, as in ``key += 1``."""

    @property
    def role(self) -> str:
        """What the node does with the key: reads, writes, both, or hands it over; ``uses`` if that is not known."""
        if self.form in ('argument', 'default'):
            return 'hands over'
        if self.form == 'script':
            return 'reads and writes' if self.updates else 'writes' if self.writes else 'reads'
        if self.form == 'own':
            return 'removes'
        if self.port is None:
            return 'uses'
        if self.form == 'key':
            return 'writes' if self.port.writable else 'reads'
        return ' and '.join(['reads'] * self.port.readable + ['writes'] * self.port.writable) or 'uses'


def node_type(element: XmlElement) -> str:
    """Return the node type of an element; for a sub-tree the ID of the tree."""
    return element.attributes.get('ID', '') if element.tag in _EXPLICIT else element.tag


def is_true(text: str) -> bool:
    """Return whether the text of an attribute says yes."""
    try:
        return bool_from_text(text)
    except ConversionError:
        return False


def is_autoremapped(subtree: XmlElement) -> bool:
    """Return whether all keys of a sub-tree are those of the tree around it."""
    return any(is_true(subtree.attributes.get(name, '')) for name in _AUTOREMAP)


def arguments(subtree: XmlElement, *, bare: bool) -> dict[str, tuple[str, str | None]]:
    """Return the text of each port of a sub-tree, and the key that it leads to; None for a constant.

    With ``bare``, as in format 3, a text without braces is a key.
    """
    found = {
        remap.attributes['internal']: remap.attributes['external']
        for remap in subtree.children
        if remap.tag == 'remap' and {'internal', 'external'} <= remap.attributes.keys()
    }
    found |= {name: text for name, text in subtree.attributes.items() if not port_name_problem(name)}
    is_bare = bare and subtree.tag == 'SubTree'
    return {name: (text, pointer_key(text, name) or (text if is_bare else None)) for name, text in found.items()}


def script_name_problem(key: str, types: NodeTypes) -> str:
    """Return why a key cannot be written in a script; '' if it can."""
    if _SCRIPT_NAME.fullmatch(key) is None or key in ('true', 'false'):
        return f'scripts cannot name the key [{key}]; use ASCII letters, digits and _'
    return f'[{key}] is a constant in scripts; choose another name' if key in types.scripts.enums else ''


class KeyReader:
    """A reader of the keys that nodes name.

    ``defaults`` are the ports of trees, with the keys that models give them by default. ``bare`` is true in format 3.
    """

    def __init__(self, text: str, types: NodeTypes, defaults: Defaults, *, bare: bool) -> None:
        self._text = text
        self._defaults = defaults
        self._types = types
        self._bare = bare

    def uses(self, root: XmlElement) -> Iterator[KeyUse]:
        """Yield the uses of keys by an element and all below it, in document order.

        Raises:
            BehaviorTreeError: a script cannot be read.
        """
        return (use for element in root.all() for use in self._of(element))

    def readable(self, root: XmlElement) -> Iterator[KeyUse]:
        """Yield the uses of keys by an element and all below it, as far as its scripts can be read."""
        return (use for element in root.all() for use in self.of(element))

    def of(self, element: XmlElement) -> Iterator[KeyUse]:
        """Yield the uses of keys by an element itself, as far as its scripts can be read."""
        with contextlib.suppress(BehaviorTreeError):
            yield from self._of(element)

    def _of(self, element: XmlElement) -> Iterator[KeyUse]:
        if element.tag in SUBTREES:
            yield from self._of_subtree(element)
        elif element.tag != 'remap' or element.parent is None or element.parent.tag not in SUBTREES:
            yield from self._of_node(element)
        elif 'external' in element.attributes:
            yield self._whole(element, 'external', 'argument')

    def _of_subtree(self, element: XmlElement) -> Iterator[KeyUse]:
        known = arguments(element, bare=self._bare)
        for name in element.attributes:
            if name in PRE_POST_ATTRIBUTES:
                yield from self._names(element, name)
            elif name in known and known[name][1] is not None:
                use = self._pointer(element, name, None) or self._whole(element, name, 'argument')
                yield use._replace(form=use.form if use.form == 'same' else 'argument')
        for name, key in () if is_autoremapped(element) else self._defaults.get(element.attributes.get('ID', ''), ()):
            if name not in known:
                yield KeyUse(key, element, name, 'default', Span(element.offset, element.offset))

    def _of_node(self, element: XmlElement) -> Iterator[KeyUse]:
        manifest = self._types.get(node_type(element))
        ports = self._ports(element, manifest)
        for name, text in element.attributes.items():
            port = ports.get(name)
            kind = None if port is None else port.literal or port.type
            if name in PRE_POST_ATTRIBUTES:
                yield from self._names(element, name, port)
            elif port is None and port_name_problem(name):
                continue
            elif (use := self._pointer(element, name, port)) is not None:
                yield use
            elif kind in (SCRIPT, CONDITION):
                yield from self._names(element, name, port)
            elif (node_type(element), name) == _REMOVED_KEY:
                yield self._whole(element, name, 'own')
            elif kind in (KEY, KEYS) and text.strip():
                words = [word.span() for word in _WORDS.finditer(text)] if kind is KEYS else [(0, len(text))]
                yield from (self._part(element, name, 'key', *word, port) for word in words)
            elif manifest is not None:
                yield from self._in_expression(element, name, port, manifest)
        for name, port in ports.items():
            if name not in element.attributes and _READ_BY_DEFAULT.format(name) in port.description:
                yield KeyUse(name, element, name, 'absent', Span(element.offset, element.offset), port)

    def _ports(self, element: XmlElement, manifest: NodeManifest | None) -> dict[str, Port]:
        if manifest is None:
            return {}
        for_element: Callable[..., Any] | None = getattr(manifest.node_class, 'for_element', None)
        try:
            node_class = manifest.node_class if for_element is None else for_element(element.attributes)
        except BehaviorTreeError:
            return dict(manifest.ports)
        return dict(manifest.ports if node_class is manifest.node_class else node_class.ports)

    def _part(
        self, element: XmlElement, name: str, form: str, start: int, end: int, port: Port | None, writes: bool = False
    ) -> KeyUse:
        """Return the use of the key that is the part ``start:end`` of a value."""
        part = element.parts[name]
        places = raw_places(self._text[part.value_start : part.value_end])
        span = Span(part.value_start + places[start], part.value_start + places[end])
        return KeyUse(part.value[start:end], element, name, form, span, port, writes)

    def _whole(self, element: XmlElement, name: str, form: str) -> KeyUse:
        return self._part(element, name, form, 0, len(element.attributes[name]), None)

    def _pointer(self, element: XmlElement, name: str, port: Port | None) -> KeyUse | None:
        text = element.attributes[name]
        key = pointer_key(text, name)
        if key is None:
            return None
        is_name = port is not None and port.literal in (KEY, KEYS)  # what the entry holds says which key is written
        writes = port is None or (port.writable and not is_name)
        if text.strip(' {}') == '=':
            return self._part(element, name, 'same', 0, len(text), port, writes)._replace(key=name)
        start = text.index('{') + 1
        return self._part(element, name, 'pointer', start, start + len(key), port, writes)

    def _in_expression(
        self, element: XmlElement, name: str, port: Port | None, manifest: NodeManifest
    ) -> Iterator[KeyUse]:
        """Yield the names in ``${…}``, and in the condition on the messages that a leaf has received."""
        text = element.attributes[name]
        stripped = text.strip()
        if getattr(manifest.node_class, 'for_element', None) is None:
            return
        if stripped.startswith('${') and stripped.endswith('}'):
            yield from self._names(element, name, port, Span(text.index('${') + 2, text.rindex('}')))
        elif name == getattr(manifest.node_class, 'condition', None):
            messages = getattr(manifest.node_class, 'parts', {}).items()
            own = frozenset(part for part, message in messages if not message.is_input)
            yield from self._names(element, name, port, others=own)

    def _names(
        self,
        element: XmlElement,
        name: str,
        port: Port | None = None,
        within: Span | None = None,
        others: frozenset[str] = frozenset(),
    ) -> Iterator[KeyUse]:
        """Yield the names in a script: the value of an attribute, or what is ``within`` it; not the ``others``."""
        text = element.attributes[name]
        begin, end = within or (0, len(text))
        tokens = tokenize(_FIELDS.sub(lambda field: ' ' * len(field.group()), text[begin:end]))
        for token, following in pairwise(tokens):
            key, start = str(token.value), begin + token.offset
            writes = following.kind is TokenKind.OPERATOR and following.value in _ASSIGNMENTS
            updates = writes and following.value not in (':=', '=')
            if token.kind is TokenKind.NAME and key not in others and (writes or key not in self._types.scripts.enums):
                use = self._part(element, name, 'script', start, start + len(key), port, writes)
                yield use._replace(updates=updates)
