# SPDX-License-Identifier: BSD-3-Clause
"""Machines and behaviors in YAML as documents.

The text is read event by event, with the place of each part, as far as it is YAML. What an edit does not know stays.
Names that readers of YAML 1.1 would not read as text, such as ``yes``, are quoted. Parts with anchors or aliases are
not edited. The keys of the form are those of :mod:`flexbt_core.state_machine.authoring.yaml_form`.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import yaml

from flexbt_core.skills.skill import LEVELS
from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import MAX_YAML_DEPTH, YamlError, construct_yaml
from flexbt_studio.errors import GestureError

from .document import gesture, need
from .machine_document import CONTAINERS, Condition, Item, MachineDocument, State, Table, json_value
from .text import LINE_BREAK, Span, TextEdit, applied

_LOADER: Final[Any] = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_RESOLVER: Final[Any] = yaml.resolver.Resolver()
_COMMENT: Final = re.compile(r'(?<![^\s\ufeff])#[^\r\n]*')
_PLAIN: Final = re.compile(r'\w(?:[\w ./+$-]*[\w./+$-])?')
_REFERENCE: Final = re.compile(r'\$[^\W\d]\w*')
_TABS: Final = re.compile(r'^\t[ \t]*', re.MULTILINE)  # an indentation that is none in YAML
_OCTAL: Final = re.compile(r'[-+]?0[0-9_]+')

_KINDS: Final = ('state', *CONTAINERS, 'behavior')
_STATE: Final = (*_KINDS, 'parameters', 'timeout', 'retry', 'transitions', 'autonomy', 'remapping')
_CONTENT: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys', 'autonomy', 'userdata', 'conditions', 'states')
_EMBEDDED: Final = ('use', 'parameters', 'default_keys')
_WRAPPERS: Final = {'retry': ('attempts', 'on', 'delay', 'timeout'), 'timeout': ('after', 'outcome')}
_TEXTS: Final = ('name', 'description', 'author', 'operator_gone', 'operator_gone_after')
_HEAD: Final = ('name', 'description', 'author', 'parameters', 'inputs', 'operator_gone', 'operator_gone_after')
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
    parts: list[Node] = field(default_factory=list)

    def pairs(self) -> list[tuple[Node, Node]]:
        """Return the keys and values of a mapping; none of other parts."""
        return [*zip(self.parts[::2], self.parts[1::2], strict=True)] if self.kind == 'mapping' else []


class Tree:
    """The parts of a YAML text, as far as it can be read."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.root: Node | None = None
        self.scalars: list[Node] = []
        self.anchored: dict[str, Node] = {}
        self.aliases: list[Node] = []
        self.error: tuple[int, str] | None = None
        """Place and message of what ends the reading."""
        shift = int(text.startswith('\ufeff'))
        stack: list[Node] = []
        event: Any
        try:
            for event in yaml.parse(text[shift:], Loader=_LOADER):
                start, end = event.start_mark.index + shift, event.end_mark.index + shift
                if isinstance(event, yaml.CollectionEndEvent):
                    _close(stack.pop(), end)
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
            _close(stack.pop(), None)

    def _node(self, event: Any, start: int, end: int) -> Node:
        if isinstance(event, yaml.AliasEvent):
            self.aliases.append(Node('alias', start, end, value=str(event.anchor)))
            return self.aliases[-1]
        if isinstance(event, yaml.ScalarEvent):
            end = start + len(self.text[start:end].rstrip())  # a block scalar ends behind its line break
            node = Node('scalar', start, end, value=event.value, tag=event.tag, is_plain=event.implicit[0])
            self.scalars.append(node)
        else:
            kind = 'mapping' if isinstance(event, yaml.MappingStartEvent) else 'sequence'
            node = Node(kind, start, end, is_flow=bool(event.flow_style), tag=event.tag)
        if event.anchor is not None:
            self.anchored[event.anchor] = node
        return node

    def comments(self) -> dict[int, int]:
        """Return begin and end of each comment: what is between scalars and begins with #."""
        found: dict[int, int] = {}
        position = 0
        for start, end in [*((node.start, node.end) for node in self.scalars), (len(self.text), 0)]:
            found.update((one.start(), one.end()) for one in _COMMENT.finditer(self.text, position, start))
            position = max(position, end)
        return found

    def fixed(self) -> Iterator[tuple[Span, str]]:
        """Yield the outermost parts with an anchor, and the aliases."""
        end = 0
        reason = 'anchors (&) and aliases (*) are not edited; write the values out'
        for node in sorted([*self.anchored.values(), *self.aliases], key=lambda one: (one.start, -one.end)):
            if node.end > end:
                yield Span(node.start, node.end), reason
                end = node.end


def _close(node: Node, end: int | None) -> None:
    """Set the end of a mapping or a list; ``end`` is None if the text breaks off."""
    if node.kind == 'mapping' and len(node.parts) % 2:
        node.parts.append(Node('scalar', node.parts[-1].end, node.parts[-1].end, is_plain=True))
    if node.is_flow and end is not None:
        node.end = end
    elif node.parts:
        node.end = max(part.end for part in node.parts[-2:])


class YamlDocument(MachineDocument):
    """A machine or a behavior in YAML."""

    language: ClassVar[str] = 'yaml'
    reference: ClassVar[str] = '$'

    # -- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        tree = self._tree = Tree(self.text)
        self.comments = tree.comments()
        self.fixed += tree.fixed()
        self._top = Table()
        self._head = Table()
        root = tree.root
        if tree.error is not None:
            place = min(tree.error[0], len(self.text))
            self.problem(Span(place, min(place + 1, len(self.text))), f'no YAML: {tree.error[1]}')
        elif root is None or root.kind != 'mapping':
            self.problem(Span(0, 0), 'the text is not a mapping; begin with machine:')
        self.unreadable = bool(self.problems)
        if root is None or root.kind != 'mapping':
            return
        self._top = self._table(root)
        self._read_head()
        kinds = [item for item in self._top.items if item.key in CONTAINERS]
        if len(kinds) != 1:
            self.problem(Span(root.start, root.start), f'the text has to have one of {", ".join(CONTAINERS)}')
        for item in kinds[:1]:
            state = State('', item.key, None, item.span, item.key_span, node=item.node)
            state.tables['entries'] = self._top
            self._read_container(state, item.node)
            self.roots.append((item.key, state))

    def _table(self, node: Node) -> Table:
        """Return a mapping or a list as a table; an empty one for other nodes, which is locked."""
        table = Table(span=Span(node.start, node.end))
        if node.kind == 'alias':
            table.locked = f'it is the alias *{node.value}; write it out'
            node = self._tree.anchored.get(node.value, node)
        if node.kind == 'mapping':
            for key, value in node.pairs():
                text = value.value if value.kind == 'scalar' else None
                whole, span = Span(key.start, max(key.end, value.end)), Span(value.start, value.end)
                table.items.append(Item(whole, key.value, Span(key.start, key.end), text, span, value))
        elif node.kind == 'sequence':
            table.mark = '' if node.is_flow else '- '
            for part in node.parts:
                span = Span(part.start, part.end)
                text = part.value if part.kind == 'scalar' else None
                table.items.append(Item(span, part.value, span, text, span, part))
        elif node.value:
            table.locked = table.locked or 'it is neither a mapping nor a list; write it in the text'
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
            if one.key in _TEXTS:
                head |= {one.key: one.value, f'{one.key}_span': one.value_span}
        head['parameters'] = []
        for one in self._parameters().items:
            fields = {part.key: self.value(part)[0] for part in self._table(one.node).items}
            default = self._table(one.node).find('default')
            parameter = {'description': '', **fields, 'name': one.key, 'span': one.span, 'value': fields.get('default')}
            parameter['default'] = self.source(default.value_span) if default else ''
            head['parameters'].append(parameter)
        inputs = self._head.find('inputs')
        head['inputs'] = self.source(inputs.value_span) if inputs else ''
        self.behaviors.append(head)

    def _parameters(self) -> Table:
        """Return the parameters of the behavior."""
        declared = self._head.find('parameters')
        return self._table(declared.node) if declared else Table()

    def _read_container(self, state: State, node: Node) -> None:
        content = state.tables['content'] = self._table(node)
        state.locked = state.locked or content.locked
        if node.kind != 'mapping':
            self.problem(Span(node.start, node.end), f'{state.kind} has to be a mapping with outcomes and states')
        for item in content.items:
            if item.key in _CONTENT and item.key not in ('states', 'autonomy'):
                state.tables.setdefault(item.key, self._table(item.node))
        for item in state.items('conditions'):
            parts = self._table(item.node)
            outcome, when = parts.find('outcome'), parts.find('when')
            if outcome is not None and when is not None:
                state.conditions.append(Condition(item, outcome, self._table(when.node)))
        states, level = content.find('states'), content.find('autonomy')
        state.level = self.source(level.value_span) if level is not None else ''
        state.rows = self._table(states.node) if states is not None else Table()
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
                fields = {part.key: self.value_or_text(part) for part in self._table(one.node).items}
                state.wrappers.append({**fields, 'kind': one.key, 'span': one.span})
        for one in state.items('autonomy'):
            text = (one.value or '').lower()
            one.value = LEVELS[int(text)] if text in ('0', '1', '2', '3') else text
        state.type, state.type_span = (kinds[0].value or '', kinds[0].value_span) if kinds else ('', state.type_span)
        if kind in CONTAINERS:
            self._read_container(state, kinds[0].node)
        elif kind == 'behavior' and kinds[0].value is None:
            used = state.tables['behavior'] = self._table(kinds[0].node)
            name, parameters, kept = used.find('use'), used.find('parameters'), used.find('default_keys')
            state.type = name.value or '' if name else ''
            state.type_span = name.value_span if name else state.type_span
            if parameters is not None:
                state.tables['parameters'] = self._table(parameters.node)
            if kept is not None:
                state.tables['default_keys'] = self._table(kept.node)

    def value(self, item: Item) -> tuple[Any, bool]:
        if item.node.kind == 'scalar' and _REFERENCE.fullmatch(item.node.value):
            return None, False
        try:
            return json_value(construct_yaml(_as_yaml(item.node)))
        except YamlError:
            return None, False

    # -- writing -----------------------------------------------------------------------------------------------------

    def name(self, name: str, like: str = '') -> str:
        return scalar_text(name, like)

    def level(self, level: str, like: str) -> str:
        items = (item for state in self.states.values() for item in state.items('autonomy'))
        is_plain = level == 'off' and like[:1] not in ('"', "'")
        is_plain = is_plain and any(self.source(one.value_span) == 'off' for one in items)
        return level if is_plain else self.name(level, like)

    def value_text(self, text: str, *, is_flow: bool) -> str:
        """Return a value as it is written: the text itself, in quotes if YAML would read something else.

        Raises:
            GestureError: it is a list, a mapping or a quoted text that is not complete.
        """
        written = text.strip()
        tree = Tree(written)
        root, is_line = tree.root, len(written.splitlines()) == 1
        whole = root is not None and (root.start, root.end) == (0, len(written)) and not (tree.error or tree.anchored)
        if not is_line or not whole or root is None or (root.kind != 'scalar' and not root.is_flow):
            reason = tree.error[1] if tree.error else 'it has to be one value in one line, without anchors'
            is_text = written[:1] not in ('[', '{') and (not is_line or written[:1] not in ('"', "'"))
            need(is_text, f'{short_repr(written)} is no value: {reason}')
            return _quoted(text, "'")
        if root.is_plain and is_flow and re.search(r'[,\[\]{}]', written):
            return _quoted(written, "'")
        edits = [TextEdit(one.start, one.end, _quoted(one.value, "'")) for one in tree.scalars if _is_ambiguous(one)]
        return applied(written, edits)

    def _json(self, value: Any) -> str:
        """Return a JSON value as it is written in one line."""
        if isinstance(value, str):
            return value if _REFERENCE.fullmatch(value) else self.name(value)
        if isinstance(value, list):
            return f'[{", ".join(map(self._json, value))}]'
        if isinstance(value, dict):
            return self._flow([(str(key), self._json(one)) for key, one in value.items()])
        return str(yaml.safe_dump(value, width=math.inf)).partition('\n')[0]

    def _flow(self, entries: Any) -> str:
        """Return entries, whose values are texts or entries, in one line."""
        if isinstance(entries, str):
            return entries
        return f'{{{", ".join(f"{self.name(key)}: {self._flow(value)}" for key, value in entries)}}}'

    def _block(self, label: str, entries: Sequence[tuple[str, Any]], indent: str, inner: str) -> list[str]:
        """Return entries in lines, as the text writes tables of their names."""
        lines = [f'{indent}{self.name(label)}:']
        for key, value in entries:
            if isinstance(value, list) and (key in CONTAINERS or self._is_block(key)):
                lines += self._block(key, value, inner, inner + self._step())
            else:
                lines.append(f'{inner}{self.name(key)}: {self._flow(value)}')
        return lines

    def _step(self) -> str:
        """Return the blanks by which the text indents."""
        steps: dict[int, int] = {}
        for state in self.states.values():
            for name, levels in (('entries', 1), ('content', 2)):
                table = state.tables.get(name, Table())
                if table.items and table.inner is None and (state.parent is not None or name == 'content'):
                    deeper = self._column(table) - len(self._line_begin(state.label_span.start))
                    levels = 1 if state.parent is None else levels
                    steps[deeper // levels] = steps.get(deeper // levels, 0) + 1
        return ' ' * max(((count, step) for step, count in steps.items() if step > 0), default=(0, 2))[1]

    def _column(self, table: Table) -> int:
        return len(self._line_begin(table.items[0].span.start))

    def _is_block(self, table: str) -> bool:
        """Return whether the text writes tables of this name in rows."""
        found = [state.tables[table] for state in self.states.values() if state.items(table)]
        return bool(found) and all(one.inner is None for one in found)

    def _owner(self, state: State, table: str) -> tuple[Table, tuple[str, ...]]:
        """Return the table in which a table of a state is an entry, and the order of its entries."""
        if table == 'parameters' and 'behavior' in state.tables:
            return state.tables['behavior'], _EMBEDDED
        is_content = state.kind in CONTAINERS and table in ('userdata', 'outcomes')
        return (state.tables['content'], _CONTENT) if is_content else (state.tables['entries'], _STATE)

    def _insert_entry(self, owner: Table, key: str, value: str, order: tuple[str, ...]) -> list[TextEdit]:
        """Insert an entry into a mapping, in its place by ``order``. The value begins with a blank or a break."""
        need(owner.items or owner.inner is not None, 'an empty part cannot be extended; edit the text')
        before = [n for n, item in enumerate(owner.items) if item.key in order[: order.index(key)]]
        return self.insert_item(owner, f'{key}:{value}', before[-1] + 1 if before else 0)

    def add_table(self, state: State, table: str, entry: str) -> list[TextEdit]:
        owner, order = self._owner(state, table)
        is_block = owner.inner is None and owner.items and self._is_block(table)
        indent = self.line_break + ' ' * self._column(owner) + self._step() if is_block else ''
        return self._insert_entry(owner, table, f'{indent}{entry}' if indent else f' {{{entry}}}', order)

    def remove_last(self, state: State, table: str) -> list[TextEdit]:
        return self._remove_entry(self._owner(state, table)[0], table)

    def _remove_entry(self, owner: Table, key: str) -> list[TextEdit]:
        return self.remove_items(owner, [next(n for n, one in enumerate(owner.items) if one.key == key)])

    def remove_items(self, table: Table, indices: list[int]) -> list[TextEdit]:
        edits = super().remove_items(table, indices)
        if table.inner is None and len(indices) == len(table.items):  # the key of the table stays, and needs a value
            line, written = self.lines.line(self.row(table, 0).start), ''
            while not written:
                line -= 1
                comment = self._comment_on_line(self.lines.starts[line])
                end = comment.start if comment else self.lines.end(self.lines.starts[line])
                written = self.text[self.lines.starts[line] : end].rstrip()
            at = self.lines.starts[line] + len(written)
            edits.append(TextEdit(at, at, ' []' if table.mark else ' {}'))
        return edits

    def _set_value(self, state: State, table: str, key: str, text: str | None) -> list[TextEdit]:
        """Set, add or (None) remove a value in a table of a state."""
        if text is None:
            return self.put(state, table, key, None, self.name)
        found = state.tables.get(table)
        is_new_flow = self._owner(state, table)[0].inner is not None or not self._is_block(table)
        is_flow = is_new_flow if found is None else found.inner is not None
        item = found.find(key) if found is not None and not found.locked else None
        written = self._block_text(item, text) or self.value_text(text, is_flow=is_flow)
        added = [] if item else self.put(state, table, key, '-', lambda _value, _like: written)
        edits = [self._replaced(item, written)] if item else added
        after = self.after(applied(self.text, self.checked(edits)))
        new = after.state(state.path).find(table, key)
        need(new is not None and after.source(new.value_span) == written, f'{short_repr(text)} cannot be written here')
        return edits

    def _block_text(self, item: Item | None, text: str) -> str:
        """Return a text of several lines in the form of the block that it replaces; empty if that is no such block."""
        old = self.source(item.value_span) if item is not None else ''
        lines = text.removesuffix('\n').split('\n')
        fits = len(lines) > 1 and lines[0].strip() and lines[0][0] != ' ' and lines[-1]
        if old[:1] != '|' or not fits or not all(line.isprintable() for line in lines):
            return ''
        first = next(line for line in old.splitlines()[1:] if line.strip())
        indent = first[: len(first) - len(first.lstrip(' '))]
        rows = ['|' if text.endswith('\n') else '|-', *(f'{indent}{line}' if line else '' for line in lines)]
        return self.line_break.join(rows) + self.line_break * old.endswith(('\n', '\r'))

    def _replaced(self, item: Item, text: str) -> TextEdit:
        """Return the edit that replaces the value of an entry by one in one line."""
        start, end = item.value_span
        gap = self.text[item.key_span.end : start]
        if gap.strip() == ':' and ('\n' in gap or '\r' in gap or gap.endswith(':')):  # a block, or nothing
            return TextEdit(item.key_span.end + gap.index(':') + 1, end, f' {text}')
        return TextEdit(start, end, text)

    def _set_fields(
        self, owner: Table, key: str, fields: dict[str, Any], known: tuple[str, ...], order: tuple[str, ...]
    ) -> list[TextEdit]:
        """Set or add an entry that is a mapping of JSON values."""
        item = owner.find(key)
        for name in fields:
            need(name in known, f'{key} has no {short_repr(name)}', name, known)
        if item is None:
            text = self._json(fields)
            entry = f'{self.name(key)}: {text}'
            return self._insert_entry(owner, key, f' {text}', order) if key in order else self.insert_item(owner, entry)
        table = self._table(item.node)
        old = {one.key: one for one in table.items} if item.node.kind == 'mapping' else {}
        gone = [number for number, name in enumerate(old) if name not in fields]
        new = [f'{self.name(name)}: {self._json(value)}' for name, value in fields.items() if name not in old]
        if len(gone) == len(old) or (gone and new):
            return [self._replaced(item, self._json(fields))]
        kept = [(one, fields[name]) for name, one in old.items() if name in fields]
        edits = [self._replaced(one, self._json(now)) for one, now in kept if self.value(one) != json_value(now)]
        edits += [edit for entry in new for edit in self.insert_item(table, entry)]
        return [*edits, *(self.remove_items(table, gone) if gone else [])]

    # -- gestures of states ------------------------------------------------------------------------------------------

    @gesture
    def set_parameter(self, state: str, name: str, text: str | None) -> list[TextEdit]:
        """Set a parameter of a state to a value as it is written in YAML; None removes it."""
        one, _ = self._child(state)
        need(one.kind == 'state' or 'behavior' in one.tables, f'{state} is a {one.kind}; it has no parameters')
        return self._set_value(one, 'parameters', name, text)

    @gesture
    def set_userdata(self, container: str, key: str, text: str | None) -> list[TextEdit]:
        """Set a key of a container's own userdata to a value as it is written in YAML; None removes it."""
        return self._set_value(self.container(container), 'userdata', key, text)

    @gesture
    def set_wrapper(self, state: str, kind: str, fields: dict[str, Any] | None) -> list[TextEdit]:
        """Set the retry or the timeout of a state; None removes it. Texts are names, numbers, or $ and a parameter."""
        one, _ = self._child(state)
        need(kind in _WRAPPERS, f'{short_repr(kind)} is none of {", ".join(_WRAPPERS)}')
        need(one.kind == 'state', f'{state} is a {one.kind}; only states have a {kind}')
        entries = one.tables['entries']
        need(fields is not None or entries.find(kind), f'{state} has no {kind}')
        if fields is None:
            return self._remove_entry(entries, kind)
        return self._set_fields(entries, kind, fields, _WRAPPERS[kind], _STATE)

    @gesture
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
        need(kind in _KINDS, f'{short_repr(kind)} is none of {", ".join(_KINDS)}')
        for name in (*parameters, *transitions, *([type] if kind in ('state', 'behavior') else [])):
            self.check_name(name)
        for target in transitions.values():
            need(isinstance(target, str), f'{short_repr(target)} is no target')
            if target != label or one.kind == 'concurrency':
                self._check_target(one, target)
        texts = {key: one for key, one in parameters.items() if isinstance(one, str)}
        values = {key: self._json(one) for key, one in parameters.items()}
        values |= {key: self.value_text(one, is_flow=True) for key, one in texts.items()}
        given = [('parameters', [*values.items()])] if values else []
        entries: list[tuple[str, Any]] = [('state', self.name(type)), *given]
        if kind == 'behavior':
            entries = [(kind, [('use', self.name(type)), *given])]
        elif kind != 'state':
            entries = [(kind, [('outcomes', self._json(list(transitions))), ('states', '{}')])]
        ways = [(outcome, self.name(target)) for outcome, target in transitions.items()]
        entries += [('transitions', ways)] if ways else []
        rows, content = one.rows, one.tables['content']
        states = content.find('states')
        if rows.locked or states is None:
            raise GestureError(f'{parent}: {rows.locked or "it has no states: in the text; add it there"}')
        neighbor = next((child.tables['entries'] for child in reversed(one.children) if not child.locked), Table())
        flow = f'{self.name(label)}: {self._flow(entries)}'
        if neighbor.inner is not None or (content.inner is not None and rows.inner is not None):
            return self.insert_item(rows, flow)
        if content.inner is not None:
            return [self._replaced(states, f'{{{flow}}}')]
        if rows.items and rows.inner is not None:
            return self.insert_item(rows, flow)
        indent = self._indent_of(rows, states)
        inner = ' ' * self._column(neighbor) if neighbor.items else indent + self._step()
        return self._new_rows(rows, states, self._block(label, entries, indent, inner))

    def _indent_of(self, rows: Table, states: Item) -> str:
        """Return the indentation of the rows of ``states:``, also if there are none yet."""
        if rows.items:
            return self._line_begin(rows.items[0].span.start)
        return self._line_begin(states.span.start) + self._step()

    def _new_rows(self, rows: Table, states: Item, lines: list[str]) -> list[TextEdit]:
        """Return the edits that write lines behind the rows of ``states:``, which may be empty."""
        if rows.items:
            return self.insert_item(rows, self.line_break.join(lines).lstrip(' '))
        colon = self.text.index(':', states.key_span.end) + 1
        comment = self._comment_on_line(states.value_span.end)
        at = comment.end if comment else states.value_span.end
        return [
            TextEdit(colon, states.value_span.end, ''),
            TextEdit(at, at, self.line_break + self.line_break.join(lines)),
        ]

    @gesture
    def paste_state(self, parent: str, text: str) -> list[TextEdit]:
        """Add the states of a text behind the others of a container. A label that is taken gets a number."""
        one = self.container(parent)
        around = 'machine:\n  outcomes: [_]\n  states:\n'
        spaces = _TABS.sub(lambda found: found.group().expandtabs(), text)
        body = textwrap.indent(self.dedented(spaces).strip('\n'), '    ')
        pasted = type(self)(f'{around}{body}\n')
        found = pasted.roots[0][1].children if pasted.roots and not pasted.problems else []
        need(found, f'{short_repr(text)} is no state of a machine in YAML; copy one')
        for label in [state.label for state in found]:
            new = self.free_label(one, label)
            if new != label:
                pasted = type(self)(applied(pasted.text, pasted.rename_state(f'/{label}', new)))
        rows, states = one.rows, one.tables['content'].find('states')
        if states is None or rows.locked or (rows.inner is not None and rows.items):
            raise GestureError(f'{parent}: its states are not in rows; edit the text')
        indent = self._indent_of(rows, states)
        pasted_lines = LINE_BREAK.split(pasted.text[len(around) :])[:-1]
        lines = [f'{indent}{line[4:]}' if line.strip() else '' for line in pasted_lines]
        return self._new_rows(rows, states, lines)

    @gesture
    def group(self, states: list[str], label: str, keys: dict[str, Any] | None = None) -> list[TextEdit]:
        """Wrap states of one container into a machine in it; it begins with the one to which transitions lead.

        ``keys`` are its input_keys, output_keys and io_keys, as lists.
        """
        need(states and all(isinstance(path, str) for path in states), 'no states are given that could be grouped')
        pairs = [self._child(path) for path in dict.fromkeys(states)]
        parent = pairs[0][1]
        is_machine = all(one is parent for _, one in pairs) and parent.kind != 'concurrency'
        need(is_machine, 'only states of one machine can be grouped')
        labels = {one.label for one, _ in pairs}
        members = [one for one in parent.children if one.label in labels]
        if label not in labels:
            self._check_label(parent, label)
        ways = [(one, item) for one in parent.children for item in one.items('transitions')]
        for one, item in ways:
            locked = one.locked or one.tables['transitions'].locked
            is_concerned = one.label in labels or item.value in labels
            need(not locked or not is_concerned, f'{one.path} cannot be edited: {locked}')
        out = (item for one, item in ways if one.label in labels and item.value not in labels)
        outcomes = list(dict.fromkeys(str(item.value) for item in out))
        into = [item for one, item in ways if one.label not in labels and item.value in labels]
        first = [parent.children[0].label] if parent.children[0].label in labels else []
        entries = list(dict.fromkeys([*(str(item.value) for item in into), *first]))
        need(len(entries) <= 1, f'a machine begins with one state, but several are entered: {", ".join(entries)}')
        need(outcomes and label not in outcomes, 'a group needs a transition that leads out of it, and another label')
        is_block = parent.rows.inner is None and not any(one.tables['entries'].locked for one in members)
        need(is_block, 'states in { } are not grouped; write each on lines of its own')
        known = ('input_keys', 'output_keys', 'io_keys')
        is_known = all(key in known and isinstance(names, list) for key, names in (keys or {}).items())
        need(is_known, f'keys: lists of {known}')
        places = [place for place, one in enumerate(parent.children) if one.label in labels]
        places.sort(key=lambda place: parent.children[place].label not in entries)
        spans = [self.row(parent.rows, place) for place in places]
        step, indent = self._step(), self._line_begin(parent.rows.items[0].span.start)
        content = {'outcomes': outcomes, **(keys or {})}
        head = [f'{indent}{self.name(label)}:', f'{indent}{step}machine:']
        head += [f'{indent}{step * 2}{key}: {self._json(names)}' for key, names in content.items()]
        tail = f'{indent}{step}transitions: {self._flow([(name, self.name(name)) for name in outcomes])}'
        if parent.level:  # it counts for the states, and not once more for what leads out of the group
            head.append(f'{indent}{step * 2}autonomy: {parent.level}')
            levels = self._flow([(name, self.level('off', '')) for name in outcomes])
            tail += f'{self.line_break}{indent}{step}autonomy: {levels}'
        before = self.line_break.join([*head, f'{indent}{step * 2}states:', ''])
        is_ended = self.text.endswith(('\n', '\r')) or max(spans).end < len(self.text)
        edits = [self.renamed(item.value_span, label) for item in into]
        if places == list(range(places[0], places[0] + len(places))):
            starts = self._line_starts(spans[0].start, spans[-1].end)
            edits += [TextEdit(spans[0].start, spans[0].start, before), *(TextEdit(at, at, step * 3) for at in starts)]
            tail = f'{tail}{self.line_break}' if is_ended else f'{self.line_break}{tail}'
            return [*edits, TextEdit(spans[-1].end, spans[-1].end, tail)]
        chunks = []
        for start, end in spans:
            inserted = [TextEdit(at - start, at - start, step * 3) for at in self._line_starts(start, end)]
            chunks.append(applied(self.text[start:end], inserted).rstrip('\r\n') + self.line_break)
        at = min(spans).start
        edits.append(TextEdit(at, at, f'{before}{"".join(chunks)}{tail}{self.line_break}'))
        return [*edits, *self.remove_items(parent.rows, places)]

    @gesture
    def ungroup(self, state: str) -> list[TextEdit]:
        """Replace a machine in a machine by its states."""
        one, parent = self._child(state)
        is_machine = one.kind == 'machine' and parent.kind != 'concurrency' and one.children
        need(is_machine, f'{state} is no machine in a machine')
        own = [table for table in ('autonomy', 'remapping', 'userdata') if table in one.tables]
        if parent.level and all(item.value == 'off' for item in one.items('autonomy')):  # as group writes it
            own = [table for table in own if table != 'autonomy']
        need(not own, f'{state} has {", ".join(own)} of its own; remove it before')
        levels = f'{one.level or "not set"}, and around it {parent.level or "not set"}'
        need(one.level == parent.level, f'the autonomy of the states in {state} is {levels}; let it be one')
        others = {*self.targets(parent), one.label}
        for child in one.children:
            taken = f'{parent.path} has {short_repr(child.label)} already; rename {child.path} before'
            need(child.label not in others, taken)
        table = one.tables.get('transitions', Table())
        is_block = one.rows.inner is None and parent.rows.inner is None and not (one.rows.locked or table.locked)
        need(is_block, f'{state} is written in {{ }}, or by an alias; edit the text')
        first_label = one.children[0].label
        edits = [self.renamed(item.value_span, first_label) for _, item in self.transitions_to(parent, one.label)]
        ways = {item.key: first_label if item.value == one.label else item.value or '' for item in table.items}
        for item in (item for child in one.children for item in child.items('transitions')):
            if item.value in (one.outcomes or ()):
                is_way = item.value in ways
                need(is_way, f'{short_repr(item.value)} of {state} leads nowhere; set its target')
                if ways[str(item.value)] != item.value:
                    edits.append(self.renamed(item.value_span, ways[str(item.value)]))
        whole = self.row(parent.rows, parent.children.index(one))
        first, last = self.row(one.rows, 0), self.row(one.rows, len(one.children) - 1)
        begin = self.lines.start(one.label_span.start)
        deeper = self._column(one.rows) - len(self._line_begin(one.label_span.start))
        for at in self._line_starts(first.start, last.end):
            line = self.text[at : self.lines.end(at)]
            edits.append(TextEdit(at, at + min(deeper, len(line) - len(line.lstrip(' '))), ''))
        return [*edits, TextEdit(begin, first.start, ''), TextEdit(last.end, whole.end, '')]

    def _line_starts(self, start: int, end: int) -> Iterator[int]:
        """Yield the begin of each line that is not blank."""
        for at in self.lines.starts[self.lines.line(start) : self.lines.line(max(start, end - 1)) + 1]:
            if self.text[at : self.lines.end(at)].strip():
                yield at

    # -- gestures of containers --------------------------------------------------------------------------------------

    @gesture
    def add_outcome(self, container: str, outcome: str) -> list[TextEdit]:
        """Add an outcome to a container."""
        one = self.container(container)
        self.check_outcome(one, outcome)
        if 'outcomes' not in one.tables:
            return self._insert_entry(one.tables['content'], 'outcomes', f' [{self.name(outcome)}]', _CONTENT)
        one.tables['outcomes'].mark = one.tables['outcomes'].mark or '- '
        return self.insert_item(one.tables['outcomes'], self.name(outcome))

    @gesture
    def remove_outcome(self, container: str, outcome: str, instead: str | None = None) -> list[TextEdit]:
        """Remove an outcome of a container. What leads to it leads to ``instead``, if it is given."""
        one, place, spans, pairs = self.uses_of_outcome(container, outcome)
        is_led_to = f'states or conditions lead to {short_repr(outcome)} of {container}; name a replacement'
        need(not spans or instead, is_led_to)
        need(not pairs, f'a condition needs {short_repr(outcome)} of {container}; change it before')
        fits = instead is None or (instead != outcome and instead in self.targets(one))
        need(fits, f'{short_repr(instead)} cannot replace {short_repr(outcome)} in {container}')
        edits = self.remove_items(one.tables['outcomes'], [place])
        edits += [self.renamed(span, instead or '') for span in spans]
        for table in ('transitions', 'autonomy'):
            if any(item.key == outcome for item in one.items(table)):
                edits += self.put(one, table, outcome, None, self.name)
        return edits

    # -- gestures of the head ----------------------------------------------------------------------------------------

    @gesture
    def set_behavior(self, key: str, text: str | None) -> list[TextEdit]:
        """Set an entry of the behavior's head: name, description, author, operator_gone; None removes it."""
        need(key in _TEXTS, f'the head has no text {short_repr(key)}', key, _TEXTS)
        item = self._head.find(key)
        if text and (block := self._block_text(item, text)):
            return [TextEdit(*item.value_span, block)] if item else []
        if text is None:
            need(item, f'the behavior has no {key}')
            return self._remove_from_head(key)
        like = self.source(item.value_span) if item else ''
        written = self.name(text, like) if key != 'operator_gone_after' else self.value_text(text, is_flow=True)
        return [self._replaced(item, written)] if item else self._add_to_head(key, written)

    def parameter_edits(self, name: str, fields: dict[str, Any]) -> list[TextEdit]:
        need('default' in fields, f'the parameter {name} needs a default, which determines its type')
        if self._parameters().items:
            return self._set_fields(self._parameters(), name, fields, _PARAMETER, ())
        need(set(fields) <= set(_PARAMETER), f'a parameter has only {", ".join(_PARAMETER)}')
        text, declared = self._json({name: fields}), self._head.find('parameters')
        return [self._replaced(declared, text)] if declared else self._add_to_head('parameters', text)

    def parameter_removal(self, name: str) -> list[TextEdit]:
        table = self._parameters()
        return self._remove_from_head('parameters') if len(table.items) == 1 else self._remove_entry(table, name)

    def parameter_uses(self, behavior: int = 0) -> Iterator[tuple[str, Span, bool]]:
        known = {item.key: item.key_span for item in self._parameters().items}
        yield from ((name, span, True) for name, span in known.items())
        for one in self._values() if known else ():
            name = one.value[1:]
            at = self.text.find(f'${name}', one.start, one.end) + 1
            if at and one.value[:1] == '$' and name in known:
                yield name, Span(at, at + len(name)), False

    def _values(self) -> Iterator[Node]:
        """Yield the scalars that may refer to parameters: others, and names in mappings, are read literally."""
        tables = [table for one in self.states.values() for table in (one.items('parameters'), one.items('userdata'))]
        wrappers = (item for one in self.states.values() for item in one.items('entries') if item.key in _WRAPPERS)
        pending = [item.node for table in (*tables, self._parameters().items, wrappers) for item in table]
        for node in pending:
            pending += node.parts[1::2] if node.kind == 'mapping' else node.parts
            if node.kind == 'scalar':
                yield node

    def renamed(self, span: Span, name: str) -> TextEdit:
        is_reference = self.text[max(span.start - 1, 0) : span.start] == '$'
        return TextEdit(*span, name) if is_reference else super().renamed(span, name)

    def default_of(self, reference: str) -> Item | None:
        item = self._parameters().find(reference[1:]) if _REFERENCE.fullmatch(reference) else None
        return None if item is None else self._table(item.node).find('default')

    def input(self, key: str) -> Item | None:
        """Return the entry of the head that describes an input key."""
        inputs = self._head.find('inputs')
        return None if inputs is None else self._table(inputs.node).find(key)

    def _remove_from_head(self, key: str) -> list[TextEdit]:
        is_last = len(self._head.items) == 1
        return self._remove_entry(self._top, 'behavior') if is_last else self._remove_entry(self._head, key)

    def _add_to_head(self, key: str, written: str) -> list[TextEdit]:
        if self._head.items:
            return self._insert_entry(self._head, key, f' {written}', _HEAD)
        need(self._top.find('behavior') is None, 'behavior: is empty in the text; remove it there, or write its name')
        if self._top.inner is not None:
            return self.insert_item(self._top, f'behavior: {{{key}: {written}}}', 0)
        at = self._top.items[0].span.start
        indent = self._line_begin(at)
        rows = 'behavior:', f'{indent}{self._step()}{key}: {written}', indent
        return [TextEdit(at, at, self.line_break.join(rows))]


def scalar_text(text: str, like: str = '') -> str:
    """Return a text as it is written: plain if all readers read it so, else in quotes, like those of ``like``."""
    quote = like[:1] if like[:1] in ('"', "'") else ''
    is_plain = not quote and _PLAIN.fullmatch(text) and _tag(text) == 'str'
    return text if is_plain else _quoted(text, quote or "'")


def _tag(text: str, *, is_plain: bool = True) -> str:
    """Return the type that YAML 1.1 gives to a scalar."""
    return str(_RESOLVER.resolve(yaml.ScalarNode, text, (is_plain, not is_plain))).rpartition(':')[2]


def _quoted(text: str, quote: str) -> str:
    """Return a text in quotes; in double quotes where single ones cannot hold it."""
    for style in (quote, '"'):
        dumped = str(yaml.safe_dump(text, default_style=style, width=math.inf, allow_unicode=True)).rstrip('\n')
        if len(dumped.splitlines()) == 1:
            break
    return dumped


def _is_ambiguous(node: Node) -> bool:
    """Return whether readers of YAML 1.1 and 1.2 read a plain scalar in different ways."""
    tag = _tag(node.value) if node.is_plain else ''
    if tag == 'bool':
        return node.value.lower() not in ('true', 'false')
    is_number = tag in ('int', 'float') and (':' in node.value or bool(_OCTAL.fullmatch(node.value)))
    return tag in ('timestamp', 'merge', 'value') or is_number


def _as_yaml(node: Node) -> yaml.Node:
    """Return a node as PyYAML's constructor takes it."""
    mark: Any = yaml.Mark('', 0, 0, 0, '', 0)
    if node.kind == 'alias':
        raise YamlError(None, 'an alias')
    if node.kind == 'scalar':
        tag = node.tag or f'tag:yaml.org,2002:{_tag(node.value, is_plain=node.is_plain)}'
        return yaml.ScalarNode(tag, node.value, mark, mark)
    if node.kind == 'mapping':
        pairs = [(_as_yaml(key), _as_yaml(value)) for key, value in node.pairs()]
        return yaml.MappingNode(node.tag or 'tag:yaml.org,2002:map', pairs, mark, mark)
    return yaml.SequenceNode(node.tag or 'tag:yaml.org,2002:seq', [*map(_as_yaml, node.parts)], mark, mark)
