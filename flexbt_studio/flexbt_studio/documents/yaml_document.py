# SPDX-License-Identifier: BSD-3-Clause
"""Machines and behaviors in YAML as documents.

The text is read event by event, with the place of each part, as far as it is YAML. What an edit does not know stays.
Names that readers of YAML 1.1 would not read as text, such as ``yes``, are quoted. Parts with anchors or aliases are
not edited. The keys of the form are those of :mod:`flexbt_core.state_machine.authoring.yaml_form`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import yaml

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import MAX_YAML_DEPTH, YamlError, construct_yaml
from flexbt_studio.errors import GestureError

from .machine_document import LEVELS, Condition, Item, MachineDocument, State, Table, Wrapper, edit, json_value
from .text import Span, TextEdit, applied

_LOADER: Final[Any] = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_RESOLVER: Final[Any] = yaml.resolver.Resolver()
_TEXT: Final = 'tag:yaml.org,2002:str'
_COMMENT: Final = re.compile(r'(?<![^\s\ufeff])#[^\r\n]*')
_PLAIN: Final = re.compile(r'\w(?:[\w ./+$-]*[\w./+$-])?')
_REFERENCE: Final = re.compile(r'\$[A-Za-z_]\w*')
_OCTAL: Final = re.compile(r'[-+]?0[0-9_]+')

_CONTAINERS: Final = ('machine', 'concurrency', 'priority')
_KINDS: Final = ('state', *_CONTAINERS, 'behavior')
_ORDER: Final = (*_KINDS, 'parameters', 'timeout', 'retry', 'transitions', 'autonomy', 'remapping')
_CONTENT: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys', 'autonomy', 'userdata', 'conditions', 'states')
_WRAPPERS: Final = {'retry': ('attempts', 'on', 'delay', 'timeout'), 'timeout': ('after', 'outcome')}
_HEAD: Final = ('name', 'description', 'author', 'parameters', 'inputs', 'operator_gone', 'operator_gone_after')
_HEAD_VALUES: Final = tuple(key for key in _HEAD if key not in ('parameters', 'inputs'))
_PARAMETER: Final = ('default', 'description', 'label', 'unit', 'minimum', 'maximum', 'choices')


@dataclass(slots=True)
class Node:
    """A part of a YAML text: a scalar, a mapping (keys and values in turn), a sequence, or an alias."""

    kind: str
    start: int
    end: int
    """End of its last character: comments and blanks behind it do not count."""
    value: str = ''
    """Of a scalar; the anchor's name of an alias."""
    is_plain: bool = False
    is_flow: bool = False
    tag: str | None = None
    is_marked: bool = False
    """Whether it has an anchor."""
    parts: list[Node] = field(default_factory=list)


class Tree:
    """The parts of a YAML text, as far as it can be read."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.root: Node | None = None
        self.scalars: list[Node] = []
        self.anchors: dict[str, Node] = {}
        self.fixed: list[tuple[Span, str]] = []
        self.error: tuple[int, str] | None = None
        """Place and message of what ends the reading."""
        shift = int(text.startswith('\ufeff'))
        stack: list[Node] = []
        try:
            event: Any
            for event in yaml.parse(text[shift:], Loader=_LOADER):
                start, end = event.start_mark.index + shift, event.end_mark.index + shift
                if isinstance(event, yaml.CollectionEndEvent):
                    self._close(stack.pop(), end)
                if not isinstance(event, yaml.NodeEvent):
                    continue
                if (self.root is not None and not stack) or len(stack) == MAX_YAML_DEPTH:
                    what = f'nested more than {MAX_YAML_DEPTH} levels deep' if stack else 'a second document begins'
                    self.error = start, what
                    break
                node = self._node(event, start, end)
                self.root = self.root or node
                if stack:
                    stack[-1].parts.append(node)
                if node.kind in ('mapping', 'sequence'):
                    stack.append(node)
        except (yaml.YAMLError, ValueError) as error:  # ValueError: characters that cannot be encoded
            mark = getattr(error, 'problem_mark', None)
            self.error = (mark.index + shift if mark else 0, getattr(error, 'problem', None) or str(error))
        while stack:
            self._close(stack.pop(), None)

    def comments(self) -> dict[int, int]:
        """Return begin and end of each comment: what is between scalars and begins with #."""
        found: dict[int, int] = {}
        position = 0
        for start, end in [*((node.start, node.end) for node in self.scalars), (len(self.text), 0)]:
            found.update((one.start(), one.end()) for one in _COMMENT.finditer(self.text, position, start))
            position = max(position, end)
        return found

    def _node(self, event: Any, start: int, end: int) -> Node:
        anchor = event.anchor
        if isinstance(event, yaml.AliasEvent):
            self.fixed.append((Span(start, end), f'aliases (*{anchor}) are not edited; write the value out'))
            return Node('alias', start, end, value=anchor)
        if isinstance(event, yaml.ScalarEvent):
            end = start + len(self.text[start:end].rstrip())  # a block scalar ends behind its line break
            node = Node('scalar', start, end, value=event.value, tag=event.tag, is_plain=event.implicit[0])
            self.scalars.append(node)
        else:
            kind = 'mapping' if isinstance(event, yaml.MappingStartEvent) else 'sequence'
            node = Node(kind, start, end, is_flow=bool(event.flow_style), tag=event.tag)
        if anchor is not None:
            node.is_marked = True
            self.anchors[anchor] = node
            if node.kind == 'scalar':
                self._fix(node)
        return node

    def _close(self, node: Node, end: int | None) -> None:
        if node.kind == 'mapping' and len(node.parts) % 2:
            node.parts.append(Node('scalar', node.parts[-1].end, node.parts[-1].end, is_plain=True))
        if node.is_flow and end is not None:
            node.end = end
        elif node.parts:
            node.end = max(part.end for part in node.parts[-2:])
        if node.is_marked:
            self._fix(node)

    def _fix(self, node: Node) -> None:
        self.fixed.append((Span(node.start, node.end), 'parts with an anchor (&) are not edited; write the values out'))


class YamlDocument(MachineDocument):
    """A machine or a behavior in YAML."""

    language: ClassVar[str] = 'yaml'

    # -- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        tree = self._tree = Tree(self.text)
        self.fixed, self.comments = tree.fixed, tree.comments()
        self._top = Table()
        self._head = Table()
        if tree.error is not None:
            self.unreadable = True
            place = min(tree.error[0], len(self.text))
            self.problem(Span(place, min(place + 1, len(self.text))), f'no YAML: {tree.error[1]}')
        root = tree.root
        if root is None or root.kind != 'mapping':
            if not self.unreadable:
                self.problem(Span(0, 0), 'the text is not a mapping; begin with machine:')
            self.unreadable = True
            return
        self._top = self._table(root)
        self._read_head()
        kinds = [item for item in self._top.items if item.key in _CONTAINERS]
        if len(kinds) != 1:
            self.problem(Span(root.start, root.start), f'the text has to have one of {", ".join(_CONTAINERS)}')
        for item in kinds[:1]:
            state = State('', item.key, None, item.span, item.key_span, node=item.node)
            state.tables['entries'] = self._top
            self._read_container(state, item.node)
            self.roots.append((item.key, state))

    def _table(self, node: Node) -> Table:
        """Return a mapping or a list as a table; an empty one for other nodes, which is locked."""
        locked = ''
        if node.kind == 'alias':
            locked = f'it is the alias *{node.value}; write it out'
            node = self._tree.anchors.get(node.value, node)
        table = Table(span=Span(node.start, node.end), locked=locked)
        if node.kind == 'mapping':
            for key, value in zip(node.parts[::2], node.parts[1::2], strict=True):
                text = value.value if value.kind == 'scalar' else None
                whole = Span(key.start, max(key.end, value.end))
                table.items.append(
                    Item(whole, key.value, Span(key.start, key.end), text, Span(value.start, value.end), value)
                )
        elif node.kind == 'sequence':
            table.mark = '' if node.is_flow else '- '
            for part in node.parts:
                span = Span(part.start, part.end)
                table.items.append(
                    Item(span, part.value, span, part.value if part.kind == 'scalar' else None, span, part)
                )
        elif node.value or node.kind == 'alias':
            table.locked = locked or 'it is neither a mapping nor a list; write it in the text'
        if node.is_flow:
            table.inner = Span(self.text.index('{' if node.kind == 'mapping' else '[', node.start) + 1, node.end - 1)
        return table

    def _read_head(self) -> None:
        item = self._top.find('behavior')
        if item is None:
            return
        self._head = self._table(item.node)
        head: dict[str, Any] = {'name': '', 'description': '', 'span': item.span, 'name_span': None, 'root': '/'}
        for one in self._head.items:
            if one.key in _HEAD_VALUES:
                head[one.key] = one.value
                head[f'{one.key}_span'] = one.value_span
        declared = self._head.find('parameters')
        head['parameters'] = []
        for one in self._table(declared.node).items if declared else []:
            fields = {'name': one.key, 'default': '', 'description': '', 'span': one.span}
            for part in self._table(one.node).items:
                value = self.value(part)[0]
                fields[part.key] = self._source(part.value_span) if part.key == 'default' else value
            head['parameters'].append(fields)
        self.behaviors.append(head)

    def _read_container(self, state: State, node: Node) -> None:
        content = self._table(node)
        state.tables['content'] = content
        state.locked = state.locked or content.locked
        if node.kind != 'mapping':
            self.problem(Span(node.start, node.end), f'{state.kind} has to be a mapping with outcomes and states')
            return
        for item in content.items:
            if item.key in _CONTENT and item.key not in state.tables and item.key not in ('states', 'autonomy'):
                state.tables[item.key] = self._table(item.node)
        for item in state.tables['conditions'].items if 'conditions' in state.tables else []:
            parts = self._table(item.node)
            outcome, when = parts.find('outcome'), parts.find('when')
            if outcome is not None and when is not None:
                state.conditions.append(Condition(item, outcome, self._table(when.node)))
        states = content.find('states')
        if states is None:
            return
        state.rows = self._table(states.node)
        for item in state.rows.items:
            self._read_child(state, item)

    def _read_child(self, parent: State, item: Item) -> None:
        entries = self._table(item.node)
        kinds = [one for one in entries.items if one.key in _KINDS]
        kind = kinds[0].key if kinds else 'state'
        state = State(item.key, kind, parent, item.span, item.key_span, item=item, node=item.node)
        state.locked = entries.locked or parent.rows.locked or parent.locked
        state.tables['entries'] = entries
        parent.children.append(state)
        if item.node.kind == 'alias':
            return
        if len(kinds) != 1:
            self.problem(item.span, f'{state.label} has to have one of {", ".join(_KINDS)}')
            state.locked = state.locked or f'it has to have one of {", ".join(_KINDS)}'
        for one in entries.items:
            if one.key in ('transitions', 'autonomy', 'remapping') or (one.key == 'parameters' and kind == 'state'):
                state.tables.setdefault(one.key, self._table(one.node))
            elif one.key in _WRAPPERS:
                fields = {part.key: self.value(part)[0] for part in self._table(one.node).items}
                state.wrappers.append(Wrapper(one.key, one.span, {key: fields[key] for key in fields if key != 'kind'}))
        for one in state.tables['autonomy'].items if 'autonomy' in state.tables else []:
            text = (one.value or '').lower()
            one.value = LEVELS[int(text)] if text in ('0', '1', '2', '3') else text
        if kind in _CONTAINERS:
            self._read_container(state, kinds[0].node)
        elif kinds:
            state.type = kinds[0].value or ''
        if kind == 'behavior' and kinds[0].value is None:
            used = self._table(kinds[0].node)
            state.tables['behavior'] = used
            for part in used.items:
                state.type = part.value or '' if part.key == 'use' else state.type
                if part.key == 'parameters':
                    state.tables['parameters'] = self._table(part.node)

    def value(self, item: Item) -> tuple[Any, bool]:
        node: Node = item.node
        if node.kind == 'scalar' and _REFERENCE.fullmatch(node.value):
            return None, False
        try:
            return json_value(construct_yaml(_as_yaml(node)))
        except YamlError:
            return None, False

    def _source(self, span: Span) -> str:
        return self.text[span.start : span.end]

    # -- writing -----------------------------------------------------------------------------------------------------

    def name(self, name: str, like: str = '') -> str:
        quote = like[:1] if like[:1] in ('"', "'") else ''
        if not quote and _PLAIN.fullmatch(name) and _RESOLVER.resolve(yaml.ScalarNode, name, (True, False)) == _TEXT:
            return name
        return _quoted(name, quote or "'")

    def level(self, level: str, like: str, table: Table | None) -> str:
        if level == 'off' and like[:1] not in ('"', "'"):
            tables = (state.tables.get('autonomy') for state in self._states.values())
            if any(self._source(item.value_span) == 'off' for one in tables if one for item in one.items):
                return level
        return self.name(level, like)

    def value_text(self, text: str, *, is_flow: bool) -> str:
        """Return a value as it is written: the text itself, in quotes if YAML would read something else.

        Raises:
            GestureError: it is a list, a mapping or a quoted text that is not complete.
        """
        written = text.strip()
        tree = Tree(written)
        root = tree.root
        whole = root is not None and (root.start, root.end) == (0, len(written)) and not tree.error
        if (
            root is None
            or not whole
            or (root.kind != 'scalar' and not root.is_flow)
            or tree.fixed
            or len(written.splitlines()) > 1
        ):
            if written[:1] in ('[', '{') or (written[:1] in ('"', "'") and len(written.splitlines()) == 1):
                reason = tree.error[1] if tree.error else 'it has to be one value in one line, without anchors'
                raise GestureError(f'{short_repr(written)} is no value: {reason}')
            return _quoted(text, "'")
        if root.kind == 'scalar' and root.is_plain and is_flow and re.search(r'[,\[\]{}]', written):
            return _quoted(written, "'")
        edits = [TextEdit(one.start, one.end, _quoted(one.value, "'")) for one in tree.scalars if _is_ambiguous(one)]
        return applied(written, edits)

    def _unit(self) -> int:
        """Return the number of blanks by which the text indents."""
        steps: dict[int, int] = {}
        for state in self._states.values():
            if state.parent is not None and state.rows.inner is None and state.rows.items and state.item:
                deeper = len(self._line_begin(state.rows.items[0].span.start)) - len(self._line_begin(state.span.start))
                steps[deeper // 3] = steps.get(deeper // 3, 0) + 1
            entries = state.tables['entries']
            if state.parent is not None and entries.inner is None and entries.items:
                deeper = len(self._line_begin(entries.items[0].span.start)) - len(self._line_begin(state.span.start))
                steps[deeper] = steps.get(deeper, 0) + 1
        content = self.roots[0][1].tables['content'] if self.roots else Table()
        if content.items and content.inner is None:
            deeper = len(self._line_begin(content.items[0].span.start))
            steps[deeper] = steps.get(deeper, 0) + 1
        return max((count, step) for step, count in steps.items() if step > 0)[1] if any(steps) else 2

    def _is_block(self, table: str) -> bool:
        """Return whether the text writes tables of this name in rows."""
        found = [state.tables[table] for state in self._states.values() if table in state.tables]
        return bool(found) and all(one.inner is None for one in found if one.items)

    def _owner(self, state: State, table: str) -> Table:
        """Return the table in which a table of a state is an entry."""
        if table == 'parameters' and 'behavior' in state.tables:
            return state.tables['behavior']
        return state.tables['content' if state.kind in _CONTAINERS and table in ('userdata', 'outcomes') else 'entries']

    def _insert_entry(self, owner: Table, key: str, value: str, order: tuple[str, ...]) -> list[TextEdit]:
        """Insert an entry into a mapping, in the place that ``order`` gives it."""
        rank = order.index(key)
        before = [n for n, item in enumerate(owner.items) if item.key in order and order.index(item.key) < rank]
        if not owner.items and owner.inner is None:
            raise GestureError(f'{self.where(owner.span.start)}: an empty part cannot be extended; edit the text')
        index = before[-1] + 1 if before else 0
        return self.insert_item(owner, f'{key}: {value}', index)

    def add_table(self, state: State, table: str, entry: str) -> list[TextEdit]:
        owner = self._owner(state, table)
        order: tuple[str, ...] = ('use', 'parameters', 'default_keys')
        order = _CONTENT if owner is state.tables.get('content') else order
        order = _ORDER if owner is state.tables['entries'] else order
        edits = self._insert_entry(owner, table, f'{{{entry}}}', order)
        if owner.inner is None and self._is_block(table):
            indent = ' ' * (len(self._line_begin(owner.items[0].span.start)) + self._unit())
            edits = [
                one._replace(text=one.text.replace(f': {{{entry}}}', f':{self.nl}{indent}{entry}')) for one in edits
            ]
        return edits

    def remove_last(self, state: State, table: str) -> list[TextEdit]:
        owner = self._owner(state, table)
        return self.remove_items(owner, [next(n for n, one in enumerate(owner.items) if one.key == table)])

    def removed(self, state: State) -> list[TextEdit]:
        parent = state.parent
        assert parent is not None
        if len(parent.rows.items) > 1 or parent.rows.inner is not None:
            return self.remove_items(parent.rows, [parent.children.index(state)])
        row = self._row(parent.rows, 0)
        key = parent.tables['content'].find('states')
        assert key is not None
        colon = self.text.index(':', key.key_span.end) + 1
        return [TextEdit(colon, colon, ' {}'), TextEdit(*row, '')]

    def _set_value(self, state: State, table: str, key: str, text: str | None) -> list[TextEdit]:
        """Set, add or (None) remove a value in a table of a state."""
        found = state.tables.get(table)
        item = found.find(key) if found is not None else None
        if text is None:
            return self._put(state, table, key, None, self.name)
        is_flow = (
            found.inner is not None
            if found
            else self._owner(state, table).inner is not None or not self._is_block(table)
        )
        written = self.value_text(text, is_flow=is_flow)
        if item is None or found is None:
            edits = self._put(state, table, key, 'value', lambda _text, _like: written)
        elif found.locked:
            raise GestureError(f'{table} of {state.path}: {found.locked}')
        else:
            edits = [self._replaced(item, written)]
        after = type(self)(applied(self.text, self.checked(edits)), self.file)
        new = after.state(state.path).tables.get(table, Table()).find(key)
        if new is None or after.text[new.value_span.start : new.value_span.end] != written:
            raise GestureError(f'{short_repr(text)} cannot be written here; edit the text')
        return edits

    def _replaced(self, item: Item, text: str) -> TextEdit:
        start, end = item.value_span
        gap = self.text[item.key_span.end : start]
        if gap.strip() == ':' and ('\n' in gap or '\r' in gap or gap.endswith(':')):  # a block, or nothing
            return TextEdit(item.key_span.end + gap.index(':') + 1, end, f' {text}')
        return TextEdit(start, end, text)

    # -- gestures of states ------------------------------------------------------------------------------------------

    @edit
    def set_parameter(self, state: str, name: str, text: str | None) -> list[TextEdit]:
        """Set a parameter of a state to a value as it is written in YAML; None removes it."""
        one = self._child(state)
        if one.kind not in ('state', 'behavior') or (one.kind == 'behavior' and 'behavior' not in one.tables):
            raise GestureError(f'{state} is a {one.kind}; it has no parameters')
        return self._set_value(one, 'parameters', name, text)

    @edit
    def set_userdata(self, container: str, key: str, text: str | None) -> list[TextEdit]:
        """Set a key of a container's own userdata to a value as it is written in YAML; None removes it."""
        return self._set_value(self.container(container), 'userdata', key, text)

    @edit
    def set_wrapper(self, state: str, kind: str, fields: dict[str, Any] | None) -> list[TextEdit]:
        """Set the retry or the timeout of a state; None removes it. Texts are names, numbers, or $ and a parameter."""
        one = self._child(state)
        if kind not in _WRAPPERS:
            raise GestureError(f'{short_repr(kind)} is none of {", ".join(_WRAPPERS)}')
        if one.kind != 'state':
            raise GestureError(f'{state} is a {one.kind}; only states have a {kind}')
        entries = one.tables['entries']
        if fields is None and entries.find(kind) is None:
            raise GestureError(f'{state} has no {kind}')
        return self._set_fields(entries, kind, fields, _WRAPPERS[kind], _ORDER)

    def _set_fields(
        self, owner: Table, key: str, fields: dict[str, Any] | None, known: tuple[str, ...], order: tuple[str, ...]
    ) -> list[TextEdit]:
        """Set, add or (None) remove an entry that is a mapping of JSON values."""
        item = owner.find(key)
        if fields is None:
            return self.remove_items(owner, [index for index, one in enumerate(owner.items) if one is item])
        for name in fields:
            if name not in known:
                raise GestureError(f'{key} has no {short_repr(name)}{did_you_mean(name, known)}')
        texts = {name: self._json(value) for name, value in fields.items()}
        written = f'{{{", ".join(f"{name}: {text}" for name, text in texts.items())}}}'
        if item is None:
            if key in order:
                return self._insert_entry(owner, key, written, order)
            return self.insert_item(owner, f'{self.name(key)}: {written}')
        old = self._table(item.node)
        if item.node.kind != 'mapping' or {one.key for one in old.items} != set(fields):
            return [self._replaced(item, written)]
        return [
            self._replaced(one, texts[one.key]) for one in old.items if self.value(one) != json_value(fields[one.key])
        ]

    def _json(self, value: Any) -> str:
        """Return a JSON value as it is written in one line."""
        if isinstance(value, str):
            return value if _REFERENCE.fullmatch(value) else self.name(value)
        if isinstance(value, list):
            return f'[{", ".join(map(self._json, value))}]'
        if isinstance(value, dict):
            return f'{{{", ".join(f"{self.name(str(key))}: {self._json(one)}" for key, one in value.items())}}}'
        return str(yaml.safe_dump(value, width=math.inf)).partition('\n')[0]

    @edit
    def add_state(
        self,
        parent: str,
        label: str,
        type: str,
        parameters: dict[str, Any],
        transitions: dict[str, Any],
        kind: str = 'state',
    ) -> list[TextEdit]:
        """Add a state behind the others of a container.

        Parameters that are texts are written as they are; others are JSON values. ``kind`` is ``state``, ``behavior``
        (``type`` is its name), or that of a container, whose outcomes are those of its transitions.
        """
        one = self.container(parent)
        self._check_label(one, label)
        if kind not in _KINDS:
            raise GestureError(f'{short_repr(kind)} is none of {", ".join(_KINDS)}')
        values = [
            (name, self.value_text(text, is_flow=True) if isinstance(text, str) else self._json(text))
            for name, text in parameters.items()
        ]
        for name in (*parameters, *transitions):
            self._check_name(name, 'a name')
        targets: list[tuple[str, str]] = []
        for outcome, target in transitions.items():
            if target != label or one.kind == 'concurrency':
                self._check_target(one, str(target))
            targets.append((outcome, self.name(str(target))))
        entries: list[tuple[str, Any]] = [(kind, self.name(type) if kind == 'state' else '')]
        if kind in ('state', 'behavior'):
            self._check_name(type, 'the name of a state or a behavior')
        if kind == 'behavior':
            entries = [(kind, [('use', self.name(type)), *([('parameters', values)] if values else [])])]
        elif kind == 'state':
            entries += [('parameters', values)] if values else []
        else:
            outcomes = f'[{", ".join(self.name(outcome) for outcome in transitions)}]'
            entries = [(kind, [('outcomes', outcomes), ('states', '{}')])]
        entries += [('transitions', targets)] if targets else []
        return self._add_entry(one, label, entries)

    def _add_entry(self, parent: State, label: str, entries: list[tuple[str, Any]]) -> list[TextEdit]:
        rows, content = parent.rows, parent.tables['content']
        states = content.find('states')
        if rows.locked or states is None:
            raise GestureError(f'{parent.path}: {rows.locked or "it has no states: in the text; add it there"}')
        neighbor = next((one for one in reversed(parent.children) if not one.locked), None)
        flow = f'{self.name(label)}: {self._flow(entries)}'
        if neighbor is not None and neighbor.tables['entries'].inner is not None:
            return self.insert_item(rows, flow)
        if rows.items and rows.inner is None:
            indent = self._line_begin(rows.items[0].span.start)
            own = neighbor.tables['entries'].items if neighbor else []
            inner = self._line_begin(own[0].span.start) if own else indent + ' ' * self._unit()
            return self.insert_item(rows, self.nl.join(self._block(label, entries, indent, inner)).removeprefix(indent))
        if content.inner is not None:
            return self.insert_item(rows, flow) if rows.inner else [self._replaced(states, f'{{{flow}}}')]
        indent = self._line_begin(states.span.start) + ' ' * self._unit()
        lines = self._block(label, entries, indent, indent + ' ' * self._unit())
        colon = self.text.index(':', states.key_span.end) + 1
        comment = self._comment_on_line(states.value_span.end)
        at = comment.end if comment else states.value_span.end
        lead = TextEdit(colon, states.value_span.end, '')
        return [lead, TextEdit(at, at, ''.join(f'{self.nl}{line}' for line in lines))]

    def _flow(self, entries: Any) -> str:
        if isinstance(entries, str):
            return entries
        return f'{{{", ".join(f"{self.name(key)}: {self._flow(value)}" for key, value in entries)}}}'

    def _block(self, label: str, entries: list[tuple[str, Any]], indent: str, inner: str) -> list[str]:
        lines = [f'{indent}{self.name(label)}:']
        for key, value in entries:
            if isinstance(value, list) and (key in _CONTAINERS or self._is_block(key)):
                lines += self._block(key, value, inner, inner + ' ' * self._unit())
            else:
                lines.append(f'{inner}{self.name(key)}: {self._flow(value)}')
        return lines

    @edit
    def group(self, states: list[str], label: str, keys: dict[str, Any] | None = None) -> list[TextEdit]:
        """Wrap states of one container into a machine in it; it begins with the one to which transitions lead.

        ``keys`` are its input_keys, output_keys and io_keys, as lists.
        """
        members = [self._child(path) for path in dict.fromkeys(states)]
        if not members:
            raise GestureError('no states are given that could be grouped')
        parent = members[0].parent
        assert parent is not None
        if any(one.parent is not parent for one in members) or parent.kind == 'concurrency':
            raise GestureError('only states of one machine can be grouped')
        labels = {one.label for one in members}
        if label not in labels:
            self._check_label(parent, label)
        members.sort(key=parent.children.index)
        targets: dict[str, None] = {}
        into: dict[str, list[Item]] = {}
        for child in parent.children:
            self._refuse_hidden_names(child)
            for item in child.tables['transitions'].items if 'transitions' in child.tables else ():
                if child in members and item.value not in labels:
                    targets[str(item.value)] = None
                elif child not in members and item.value in labels:
                    into.setdefault(str(item.value), []).append(item)
        if parent.children[0] in members:
            into.setdefault(parent.children[0].label, [])
        if len(into) > 1:
            raise GestureError(
                f'a machine begins with one state, but several are entered from outside: {", ".join(into)}'
            )
        if not targets or label in targets:
            raise GestureError('the group has to have a transition that leads out of it, and another label')
        members.sort(key=lambda one: one.label not in into)
        rows = parent.rows
        if rows.inner is not None or any(one.tables['entries'].locked for one in members):
            raise GestureError('states in { } are not grouped; write each on lines of its own')
        places = [parent.children.index(one) for one in members]
        spans = [self._row(rows, place) for place in places]
        indent, step = self._line_begin(rows.items[0].span.start), ' ' * self._unit()
        outcomes = ', '.join(map(self.name, targets))
        head = [f'{indent}{self.name(label)}:', f'{indent}{step}machine:', f'{indent}{step * 2}outcomes: [{outcomes}]']
        for key, names in (keys or {}).items():
            if key not in ('input_keys', 'output_keys', 'io_keys') or not isinstance(names, list):
                raise GestureError(
                    f'{short_repr(key)} is none of input_keys, output_keys and io_keys with a list of names'
                )
            head.append(f'{indent}{step * 2}{key}: [{", ".join(self.name(str(name)) for name in names)}]')
        head.append(f'{indent}{step * 2}states:')
        ways = ', '.join(f'{self.name(name)}: {self.name(name)}' for name in targets)
        tail = f'{indent}{step}transitions: {{{ways}}}'
        edits = [self._renamed(item.value_span, label) for items in into.values() for item in items]
        ended = self.text.endswith(('\n', '\r')) or spans[-1].end < len(self.text)
        before = ''.join(f'{line}{self.nl}' for line in head)
        behind = f'{tail}{self.nl}' if ended else f'{self.nl}{tail}'
        if places == list(range(places[0], places[0] + len(places))):
            edits.append(TextEdit(spans[0].start, spans[0].start, before))
            edits += [TextEdit(at, at, step * 3) for at in self._line_starts(spans[0].start, spans[-1].end)]
            return [*edits, TextEdit(spans[-1].end, spans[-1].end, behind)]
        chunks = []
        for span in spans:
            inserted = [TextEdit(at - span.start, at - span.start, step * 3) for at in self._line_starts(*span)]
            chunk = applied(self.text[span.start : span.end], inserted)
            chunks.append(chunk if chunk.endswith(('\n', '\r')) else chunk + self.nl)
        at = min(spans).start
        edits.append(TextEdit(at, at, f'{before}{"".join(chunks)}{tail}{self.nl}'))
        return [*edits, *(one for place in places for one in self._remove_row(rows, place))]

    @edit
    def ungroup(self, state: str) -> list[TextEdit]:
        """Replace a machine in a machine by its states."""
        one = self._child(state)
        parent = one.parent
        assert parent is not None
        if one.kind != 'machine' or parent.kind == 'concurrency' or not one.children:
            raise GestureError(f'{state} is not a machine in a machine')
        if any(table in one.tables for table in ('autonomy', 'remapping', 'userdata')):
            raise GestureError(f'{state} has autonomy, remapping or userdata of its own; remove them before')
        table = one.tables.get('transitions', Table())
        ways = {item.key: item.value or '' for item in table.items}
        others = {child.label for child in parent.children if child is not one} | set(parent.outcomes or ())
        for child in one.children:
            if child.label in others or child.label == one.label:
                raise GestureError(f'{parent.path} has {short_repr(child.label)} already; rename {child.path} before')
        if one.rows.inner is not None or parent.rows.inner is not None or one.rows.locked or table.locked:
            raise GestureError(f'{state} is written in {{ }}, or by an alias; edit the text')
        edits = [
            self._renamed(item.value_span, one.children[0].label) for _, item in self._transitions_to(parent, one.label)
        ]
        for child in one.children:
            for item in child.tables['transitions'].items if 'transitions' in child.tables else ():
                if item.value in (one.outcomes or ()):
                    if item.value not in ways:
                        raise GestureError(
                            f'the outcome {short_repr(item.value)} of {state} leads nowhere; set its target before'
                        )
                    target = one.children[0].label if ways[item.value] == one.label else ways[item.value]
                    edits += [self._renamed(item.value_span, target)] if target != item.value else []
        whole = self._row(parent.rows, parent.children.index(one))
        first, last = self._row(one.rows, 0), self._row(one.rows, len(one.children) - 1)
        begin = self._starts[self._line(one.label_span.start)]
        deeper = len(self._line_begin(one.children[0].label_span.start)) - len(self._line_begin(one.label_span.start))
        for at in self._line_starts(first.start, last.end):
            blanks = (
                len(self.text[at:])
                - len(self.text[at : self._line_end(at)].lstrip(' '))
                - len(self.text[self._line_end(at) :])
            )
            edits.append(TextEdit(at, at + min(deeper, blanks), ''))
        return [*edits, TextEdit(begin, first.start, ''), TextEdit(last.end, whole.end, '')]

    def _line_starts(self, start: int, end: int) -> Iterator[int]:
        """Yield the begin of each line that is not blank."""
        for line in range(self._line(start), self._line(max(start, end - 1)) + 1):
            if self.text[self._starts[line] : self._line_end(self._starts[line])].strip():
                yield self._starts[line]

    # -- gestures of containers --------------------------------------------------------------------------------------

    @edit
    def add_outcome(self, container: str, outcome: str) -> list[TextEdit]:
        """Add an outcome to a container."""
        one = self.container(container)
        self._check_outcome(one, outcome)
        if 'outcomes' not in one.tables:
            return self._insert_entry(one.tables['content'], 'outcomes', f'[{self.name(outcome)}]', _CONTENT)
        return self.insert_item(one.tables['outcomes'], self.name(outcome))

    @edit
    def remove_outcome(self, container: str, outcome: str, instead: str | None = None) -> list[TextEdit]:
        """Remove an outcome of a container. What leads to it leads to ``instead``, if it is given."""
        one = self.container(container)
        place = self._outcome(one, outcome)
        if instead is not None and (instead == outcome or instead not in self._targets(one)):
            raise GestureError(f'{short_repr(instead)} cannot replace {short_repr(outcome)} in {container}')
        transitions = list(self._transitions_to(one, outcome))
        conditions = [condition for condition in one.conditions if condition.outcome.value == outcome]
        if (transitions or conditions) and instead is None:
            sources = ', '.join(f'{source.path} ({item.key})' for source, item in transitions) or 'conditions'
            raise GestureError(f'{short_repr(outcome)} of {container} is the target of {sources}; name a replacement')
        edits = self.remove_items(one.tables['outcomes'], [place])
        edits += [self._renamed(item.value_span, instead or '') for _, item in transitions]
        edits += [self._renamed(condition.outcome.value_span, instead or '') for condition in conditions]
        for table in ('transitions', 'autonomy'):
            found = one.tables.get(table)
            entry = found.find(outcome) if found else None
            if found is not None and entry is not None:
                last = len(found.items) == 1
                edits += self.remove_last(one, table) if last else self.remove_items(found, [found.items.index(entry)])
        for condition in one.parent.conditions if one.parent else ():
            pairs = [
                n for n, pair in enumerate(condition.pairs.items) if (pair.key, pair.value) == (one.label, outcome)
            ]
            if pairs:
                raise GestureError(f'a condition needs {short_repr(outcome)} of {container}; change it before')
        return edits

    @edit
    def rename_outcome(self, container: str, outcome: str, name: str) -> list[TextEdit]:
        """Rename an outcome of a container, and all that names it."""
        one = self.container(container)
        place = self._outcome(one, outcome)
        if name == outcome:
            return []
        self._check_outcome(one, name)
        edits = [self._renamed(one.tables['outcomes'].items[place].span, name)]
        edits += [self._renamed(item.value_span, name) for _, item in self._transitions_to(one, outcome)]
        edits += [
            self._renamed(each.outcome.value_span, name) for each in one.conditions if each.outcome.value == outcome
        ]
        for table in ('transitions', 'autonomy'):
            entry = one.tables[table].find(outcome) if table in one.tables else None
            edits += [self._renamed(entry.key_span, name)] if entry else []
        for condition in one.parent.conditions if one.parent else ():
            found = [pair for pair in condition.pairs.items if (pair.key, pair.value) == (one.label, outcome)]
            edits += [self._renamed(pair.value_span, name) for pair in found]
        return edits

    def _targets(self, container: State) -> list[str]:
        labels = [] if container.kind == 'concurrency' else [child.label for child in container.children]
        return [*labels, *(container.outcomes or ())]

    def _outcome(self, container: State, outcome: str) -> int:
        """Return the place of an outcome of a container in its list."""
        known = container.outcomes or []
        if outcome not in known:
            raise GestureError(f'{container.path} has no outcome {short_repr(outcome)}{did_you_mean(outcome, known)}')
        for child in container.children:
            table = child.tables.get('transitions')
            if table is not None and table.locked and any(item.value == outcome for item in table.items):
                raise GestureError(f'{child.path} leads to {outcome} and cannot be edited: {table.locked}')
        return known.index(outcome)

    def _check_outcome(self, container: State, outcome: str) -> None:
        self._check_name(outcome, 'an outcome')
        if outcome in (container.outcomes or ()) or any(child.label == outcome for child in container.children):
            raise GestureError(f'{container.path} has an outcome or a state {short_repr(outcome)} already')

    # -- gestures of the head ----------------------------------------------------------------------------------------

    @edit
    def set_behavior(self, key: str, text: str | None) -> list[TextEdit]:
        """Set an entry of the behavior's head: name, description, author, operator_gone; None removes it."""
        if key not in _HEAD_VALUES:
            raise GestureError(f'the head has no text {short_repr(key)}{did_you_mean(key, _HEAD_VALUES)}')
        item = self._head.find(key)
        if text is None:
            if item is None:
                raise GestureError(f'the behavior has no {key}')
            return self._remove_from_head(key)
        like = self._source(item.value_span) if item else ''
        written = self.name(text, like) if key != 'operator_gone_after' else self.value_text(text, is_flow=True)
        if item is not None:
            return [self._replaced(item, written)]
        return self._add_to_head(key, written)

    @edit
    def set_behavior_parameter(self, name: str, fields: dict[str, Any] | None) -> list[TextEdit]:
        """Set a parameter of the behavior: default, description, label, unit, limits, choices; None removes it."""
        if not name.isidentifier() or name.startswith('_'):
            raise GestureError(f'{short_repr(name)} cannot be the name of a parameter; use letters, digits and _')
        declared = self._head.find('parameters')
        table = self._table(declared.node) if declared else None
        known = [item.key for item in table.items] if table else []
        if fields is not None and 'default' not in fields:
            raise GestureError(f'the parameter {name} needs a default, which determines its type')
        if fields is None:
            if name not in known or table is None:
                raise GestureError(f'the behavior has no parameter {short_repr(name)}{did_you_mean(name, known)}')
            used = [self.where(one.start) for one in self._references(name)]
            if used:
                raise GestureError(f'${name} is used in {", ".join(used)}; replace it there before')
            if len(known) == 1:
                return self._remove_from_head('parameters')
        if table is None or not table.items:
            inner = {key: self._json(value) for key, value in (fields or {}).items() if self._is_field(key)}
            written = f'{{{", ".join(f"{key}: {value}" for key, value in inner.items())}}}'
            if declared is not None:
                return [self._replaced(declared, f'{{{name}: {written}}}')]
            return self._add_to_head('parameters', f'{{{name}: {written}}}')
        return self._set_fields(table, name, fields, _PARAMETER, ())

    @edit
    def rename_behavior_parameter(self, name: str, new: str) -> list[TextEdit]:
        """Rename a parameter of the behavior, and all references to it."""
        declared = self._head.find('parameters')
        items = self._table(declared.node).items if declared else []
        item = next((one for one in items if one.key == name), None)
        if item is None:
            raise GestureError(f'the behavior has no parameter {short_repr(name)}')
        if not new.isidentifier() or new.startswith('_') or any(one.key == new for one in items):
            raise GestureError(f'{short_repr(new)} cannot be the name of a parameter, or there is one already')
        edits = [self._renamed(item.key_span, new)]
        for one in self._references(name):
            at = self.text.index(f'${name}', one.start, one.end)
            edits.append(TextEdit(at + 1, at + 1 + len(name), new))
        return edits

    def _is_field(self, key: str) -> bool:
        if key not in _PARAMETER:
            raise GestureError(f'a parameter has no {short_repr(key)}{did_you_mean(key, _PARAMETER)}')
        return True

    def _references(self, name: str) -> list[Node]:
        return [
            one
            for one in self._tree.scalars
            if one.value == f'${name}' and f'${name}' in self.text[one.start : one.end]
        ]

    def _remove_from_head(self, key: str) -> list[TextEdit]:
        table = self._head if len(self._head.items) > 1 else self._top
        name = key if table is self._head else 'behavior'
        return self.remove_items(table, [next(n for n, item in enumerate(table.items) if item.key == name)])

    def _add_to_head(self, key: str, written: str) -> list[TextEdit]:
        if self._head.items:
            return self._insert_entry(self._head, key, written, _HEAD)
        if self._top.find('behavior') is not None:
            raise GestureError('behavior: is empty in the text; remove it there or write its name')
        if self._top.inner is not None:
            return self.insert_item(self._top, f'behavior: {{{key}: {written}}}', 0)
        at = self._starts[self._line(self._top.items[0].span.start)] or self._top.items[0].span.start
        indent = self._line_begin(self._top.items[0].span.start)
        return [TextEdit(at, at, f'{indent}behavior:{self.nl}{indent}{" " * self._unit()}{key}: {written}{self.nl}')]


def _quoted(text: str, quote: str) -> str:
    """Return a text in quotes; in double quotes where single ones cannot hold it."""
    dumped = str(yaml.safe_dump(text, default_style=quote, width=math.inf, allow_unicode=True)).rstrip('\n')
    if '\n' in dumped:
        dumped = str(yaml.safe_dump(text, default_style='"', width=math.inf, allow_unicode=True)).rstrip('\n')
    return dumped


def _is_ambiguous(node: Node) -> bool:
    """Return whether readers of YAML 1.1 and 1.2 read a plain scalar in different ways."""
    if not node.is_plain or node.tag:
        return False
    tag = _RESOLVER.resolve(yaml.ScalarNode, node.value, (True, False)).rpartition(':')[2]
    if tag == 'bool':
        return node.value.lower() not in ('true', 'false')
    return tag in ('timestamp', 'merge', 'value') or (
        tag in ('int', 'float') and (':' in node.value or bool(_OCTAL.fullmatch(node.value)))
    )


def _as_yaml(node: Node) -> yaml.Node:
    """Return a node as PyYAML's constructor takes it."""
    mark: Any = yaml.Mark('', 0, 0, 0, '', 0)
    if node.kind == 'alias':
        raise YamlError(None, 'an alias')
    if node.kind == 'scalar':
        tag = node.tag or (_RESOLVER.resolve(yaml.ScalarNode, node.value, (node.is_plain, not node.is_plain)))
        return yaml.ScalarNode(tag, node.value, mark, mark)
    parts = [_as_yaml(part) for part in node.parts]
    if node.kind == 'mapping':
        pairs = list(zip(parts[::2], parts[1::2], strict=True))
        return yaml.MappingNode(node.tag or 'tag:yaml.org,2002:map', pairs, mark, mark)
    return yaml.SequenceNode(node.tag or 'tag:yaml.org,2002:seq', parts, mark, mark)
