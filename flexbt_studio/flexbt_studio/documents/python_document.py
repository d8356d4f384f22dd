# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in Python as documents, also those that FlexBE's editor generates.

Python's own parser gives the place of each part. Calls that add a state by literals can be edited. What is added in a
loop, in a branch or by computed arguments is shown with a reason, and stays. The code is never run.

Positional parameters have the names ``0``, ``1``, …
"""

from __future__ import annotations

import ast
import itertools
import keyword
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

from flexbt_core.skills.skill import LEVELS
from flexbt_core.values.text import short_repr
from flexbt_studio.errors import GestureError

from .document import gesture, need
from .machine_document import Condition, Item, MachineDocument, State, Table, json_value
from .text import LINE_BREAK, Span, TextEdit, applied

_TOKENS: Final = re.compile(
    r'#[^\r\n]*|\'\'\'(?:\\.|[^\\])*?\'\'\'|"""(?:\\.|[^\\])*?"""|\'(?:\\.|[^\'\\\r\n])*\'|"(?:\\.|[^"\\\r\n])*"',
    re.DOTALL,
)
_TOKEN_OR_BREAK: Final = re.compile(f'{_TOKENS.pattern}|{LINE_BREAK.pattern}', re.DOTALL)
_POSITION: Final = re.compile(r'# x:(-?\d+) y:(-?\d+)')
_REGION: Final = re.compile(r'# \[/?MANUAL_')  # marks that FlexBE's editor needs: no comments of a state
_NOTE: Final = re.compile(r'# [!0O] -?\d+ -?\d+ /')
_CONTAINERS: Final = {
    'OperatableStateMachine': 'machine',
    'ConcurrencyContainer': 'concurrency',
    'PriorityContainer': 'priority',
}
_WRAPPERS: Final = {
    'with_retry': ('retry', ('state', 'attempts', 'on')),
    'with_timeout': ('timeout', ('state', 'after', 'outcome')),
}
_EMBEDDING: Final = ('use_behavior', 'add_behavior')
_ADD: Final = ('label', 'state', 'transitions', 'autonomy', 'remapping')
_MANIFEST: Final = ('name', 'description', 'author', 'parameters', 'inputs')
_PARAMETER: Final = ('name', 'default', 'description', 'choices', 'label', 'unit', 'minimum', 'maximum')
_CONTENT: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys', 'conditions')


@dataclass(slots=True, eq=False)
class _Container:
    """A call that makes a container, and what fills it."""

    call: ast.Call
    kind: str
    adds: list[tuple[ast.Call, str, ast.stmt]] = field(default_factory=list)
    """Calls of ``add``, with the reason for which each cannot be edited, and its statement."""
    statements: list[ast.stmt] = field(default_factory=list)
    """Statements that make and fill it."""
    is_used: bool = False


@dataclass(slots=True, eq=False)
class _Scope:
    """A function, or the module."""

    name: str
    methods: dict[str, _Scope]
    values: dict[str, list[tuple[ast.expr, ast.stmt, str]]] = field(default_factory=dict)
    containers: dict[ast.expr | None, _Container] = field(default_factory=dict)
    uses: Counter[str] = field(default_factory=Counter)
    returned: ast.expr | None = None


class PythonDocument(MachineDocument):
    """Behaviors in a Python file."""

    language: ClassVar[str] = 'python'
    reference: ClassVar[str] = 'self.'

    # -- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        comments = (one for one in _TOKENS.finditer(self.text) if one.group()[0] == '#')
        self.comments = {one.start(): one.end() for one in comments if not _REGION.match(one.group())}
        self._base = int(self.text.startswith('\ufeff'))
        self._statements: dict[State, list[ast.stmt]] = {}
        self._widths: dict[int, list[int]] = {}
        self._owners: list[ast.ClassDef] = []  # the classes of the behaviors
        try:
            self._module = ast.parse(self.text[self._base :])
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            self.unreadable = True
            line = min(getattr(error, 'lineno', None) or 1, len(self.lines.starts))
            start = min(self.lines.starts[line - 1] + max((getattr(error, 'offset', None) or 1) - 1, 0), len(self.text))
            reason = getattr(error, 'msg', None) or str(error) or type(error).__name__
            self.problem(Span(start, min(start + 1, len(self.text))), f'no Python: {reason}')
            return
        self._names: dict[str, str] = {}  # that the module binds, with the names that they have where they come from
        for node in self._module.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                self._names.update((one.asname or one.name, one.name) for one in node.names)
            elif isinstance(node, ast.ClassDef | ast.FunctionDef):
                self._names[node.name] = node.name
        try:
            for scope, root in self._roots():
                state = State('', root.kind, None, self._span(root.call), self._span(root.call.func), node=root.call)
                self.roots.append((scope.name, state))
                self._read_container(state, root, scope)
        except RecursionError:
            self.unreadable = True
            self.problem(Span(0, 0), 'the code is nested too deep')

    def _roots(self) -> Iterator[tuple[_Scope, _Container]]:
        """Read all functions. Yield the outermost containers, those that ``create`` returns first."""
        scopes: list[_Scope] = []
        classes: list[tuple[ast.ClassDef, _Scope]] = []
        owners: list[Any] = [self._module, *(one for one in _walk(self._module) if isinstance(one, ast.ClassDef))]
        for owner in owners:
            methods: dict[str, _Scope] = {}
            for function in [node for node in owner.body if isinstance(node, ast.FunctionDef)]:
                above = owner.name if isinstance(owner, ast.ClassDef) else ''
                name = above if above and function.name == 'create' else f'{above}.{function.name}'.strip('.')
                methods[function.name] = scope = _Scope(name, methods)
                scope.uses.update(_code(node) for node in _walk(function) if _is_name(node, ast.Load))
                self._read_block(function.body, scope, None, '')
                scopes.append(scope)
            if isinstance(owner, ast.ClassDef) and 'create' in methods:
                classes.append((owner, methods['create']))
            if owner is self._module:
                scopes.append(scope := _Scope('module', methods))
                self._read_block(owner.body, scope, None, '')
        for owner, scope in classes:
            root = self._container_of(scope.returned, scope)
            if root is not None:
                self._owners.append(owner)
                self.behaviors.append(self._behavior(owner, f'{owner.name}:/' if self.roots else '/'))
                yield scope, root
        for scope in scopes:
            returned = self._container_of(scope.returned, scope)
            for container in [*([returned] if returned else []), *scope.containers.values()]:
                if not container.is_used and (container.adds or self._arguments(container.call).find('children')):
                    yield scope, container

    def _read_block(self, body: Sequence[ast.stmt], scope: _Scope, within: _Container | None, lock: str) -> None:
        """Read the statements of a block; ``within`` is the container whose ``with`` block it is."""
        for one in body:
            inner, why = within, lock
            if isinstance(one, ast.FunctionDef | ast.ClassDef | ast.AsyncFunctionDef):
                continue
            if isinstance(one, ast.Assign | ast.AnnAssign) and one.value is not None:
                made = self._made(one.value, scope)
                for target in one.targets if isinstance(one, ast.Assign) else [one.target]:
                    scope.values.setdefault(_code(target), []).append((one.value, one, lock))
                    if isinstance(target, ast.Attribute) and _code(target.value).endswith('.userdata'):
                        filled = self._container_of(target.value.value, scope)  # type: ignore[attr-defined]
                        if filled is not None:
                            filled.statements.append(one)
                if made is not None:
                    made.statements.append(one)
            elif isinstance(one, ast.Return) and one.value is not None:
                self._made(one.value, scope)
                scope.returned = one.value
            elif isinstance(one, ast.With):
                for item in one.items:
                    made = self._made(item.context_expr, scope) or self._container_of(item.context_expr, scope)
                    if made is not None:
                        inner = made
                        made.statements.append(one)
                        if item.optional_vars is not None:
                            name = _code(item.optional_vars)
                            scope.values.setdefault(name, []).append((item.context_expr, one, lock))
            elif isinstance(one, ast.Expr) and isinstance(one.value, ast.Call):
                self._made(one.value, scope)
                if within is not None and isinstance(one.value.func, ast.Attribute) and one.value.func.attr == 'add':
                    within.adds.append((one.value, lock, one))
            elif isinstance(one, ast.For | ast.While | ast.If | ast.Try | ast.TryStar | ast.Match | ast.AsyncFor):
                kind = 'a loop' if isinstance(one, ast.For | ast.While | ast.AsyncFor) else 'a branch'
                why = lock or f'it is in {kind} (line {one.lineno})'
            for part in ('body', 'orelse', 'finalbody', 'handlers', 'cases'):
                for block in getattr(one, part, []):
                    self._read_block([block] if isinstance(block, ast.stmt) else block.body, scope, inner, why)

    def _made(self, expression: ast.expr, scope: _Scope) -> _Container | None:
        """Return the container that an expression makes; also read those that it makes in ``children``."""
        for node in (one for one in _walk(expression) if isinstance(one, ast.Call)):
            if (kind := _CONTAINERS.get(self._name_of(node.func))) is not None:
                scope.containers.setdefault(node, _Container(node, kind))
        return scope.containers.get(expression)

    def _container_of(self, expression: ast.expr | None, scope: _Scope) -> _Container | None:
        """Return the container for which an expression stands: a call, a variable, or a method that returns it."""
        for _ in range(10):
            if expression is None or expression in scope.containers:
                return scope.containers.get(expression)
            if isinstance(expression, ast.Call):
                method = _code(expression.func).removeprefix('self.')
                if expression.args or expression.keywords or method not in scope.methods:
                    return None
                scope = scope.methods[method]
                expression = scope.returned
            else:
                values = scope.values.get(_code(expression), [])
                if len(values) != 1:
                    return None
                expression = values[0][0]
        return None

    def _read_container(self, state: State, container: _Container, scope: _Scope) -> None:
        container.is_used = True
        arguments = self._arguments(container.call, _CONTENT)
        for item in arguments.items:
            if item.key in _CONTENT:
                state.tables[item.key] = self._literal(item.node)
            elif item.key == 'userdata':
                state.tables[item.key] = self._literal(item.node, ast.Dict)
            elif item.key == 'autonomy':
                state.level = self.source(item.value_span)
        for item in state.items('conditions'):
            outcome = self._literal(item.node)
            if len(outcome.items) == 2:
                pairs = self._literal(outcome.items[1].node)
                for pair in pairs.items:
                    both = self._literal(pair.node).items
                    if len(both) == 2:
                        pair.key, pair.key_span = both[0].key, both[0].span
                        pair.value, pair.value_span = both[1].value, both[1].span
                state.conditions.append(Condition(item, outcome.items[0], pairs))
        children = arguments.find('children')
        if children is not None:
            given, locked = self._resolved(children.node, scope, [])
            state.rows = self._literal(given)
            state.rows.locked = state.rows.locked or locked
            for item in state.rows.items:
                lock = state.rows.locked
                if not isinstance(item.node, ast.Call) or self._name_of(item.node.func) != 'Child':
                    lock = f'it is no call of Child (line {self.lines.line(item.span.start) + 1})'
                self._read_child(state, item, item.node, lock, scope)
            if state.rows.locked:
                self._read_child(state, Item(children.value_span), children.node, state.rows.locked, scope)
        for call, lock, statement in container.adds:
            item = Item(self._span(statement))
            if children is not None:
                lock = lock or 'its container has children in two forms'
            elif not lock:
                state.rows.items.append(item)
            self._read_child(state, item, call, lock, scope)

    def _read_child(self, parent: State, item: Item, call: ast.expr, lock: str, scope: _Scope) -> None:
        arguments = self._arguments(call, _ADD) if isinstance(call, ast.Call) else Table()
        label = arguments.find('label')
        text = label.value if label is not None else None
        if text is None:
            text = self.source(label.value_span if label else item.span).split('\n')[0][:40]
            lock = lock or 'its label is computed'
        if any(one.key in ('*', '**') for one in arguments.items):
            lock = lock or 'its arguments are computed'
        label_span = label.value_span if label is not None else item.span
        state = State(text, 'state', parent, item.span, label_span, item=item, locked=lock or parent.locked, node=call)
        parent.children.append(state)
        self._statements[state] = []
        state.tables['entries'] = arguments
        for table in ('transitions', 'autonomy', 'remapping'):
            found = arguments.find(table)
            if found is not None:
                state.tables[table] = self._mapping(found.node, scope, self._statements[state])
        for one in state.items('autonomy'):
            level = self.source(one.value_span).rpartition('.')[2].lower()
            one.value = LEVELS[int(level)] if level in ('0', '1', '2', '3') else level
        made = arguments.find('state')
        if made is not None:
            self._read_state(state, made.node, scope)

    def _read_state(self, state: State, made: ast.expr, scope: _Scope) -> None:
        made, locked = self._resolved(made, scope, self._statements[state])
        while isinstance(made, ast.Call) and self._name_of(made.func) in _WRAPPERS and made.args:
            kind, names = _WRAPPERS[self._name_of(made.func)]
            fields = {one.key: self.value_or_text(one) for one in self._arguments(made, names).items[1:]}
            state.wrappers.append({**fields, 'kind': kind, 'span': self._span(made)})
            made, why = self._resolved(made.args[0], scope, self._statements[state])
            locked = locked or why
        container = self._container_of(made, scope)
        if container is not None and not container.is_used:
            state.kind = container.kind
            self._statements[state] += container.statements
            method = made.func if isinstance(made, ast.Call) else None
            inside = scope.methods.get(method.attr, scope) if isinstance(method, ast.Attribute) else scope
            self._read_container(state, container, inside if container.call in inside.containers else scope)
            return
        if container is not None:
            state.kind, state.locked = container.kind, state.locked or 'its container is used in several places'
        if not isinstance(made, ast.Call):
            return
        table = self._arguments(made)
        state.type_span = self._span(made.func)
        state.type = self.source(state.type_span)
        if isinstance(made.func, ast.Attribute) and made.func.attr == 'use_behavior' and made.args:
            state.kind, state.type_span = 'behavior', self._span(made.args[0])
            state.type = self.source(state.type_span)
            parameters, kept = table.find('parameters'), table.find('default_keys')
            if kept is not None:
                state.tables['default_keys'] = self._literal(kept.node)
            table = self._mapping(parameters.node, scope, []) if parameters else Table(locked='it has no parameters')
        table.locked = table.locked or locked
        if container is None:
            state.tables['parameters'] = table

    def _resolved(self, expression: ast.expr, scope: _Scope, made: list[ast.stmt]) -> tuple[ast.expr, str]:
        """Return the expression that a variable stands for, and the reason for which it cannot be edited here.

        The statement that sets the variable is appended to ``made`` if only this expression uses it.
        """
        values = scope.values.get(_code(expression), []) if _is_name(expression) else []
        if len(values) != 1 or self._container_of(expression, scope) is not None:
            return expression, ''
        value, statement, lock = values[0]
        near = scope.methods.values() if isinstance(expression, ast.Attribute) else [scope]  # that of an object in all
        if sum(one.uses[_code(expression)] for one in near) > 1 or len(getattr(statement, 'targets', ())) > 1:
            lock = lock or f'{_code(expression)} is used in several places'
        made += [] if lock else [statement]
        return value, lock

    def _mapping(self, expression: ast.expr, scope: _Scope, made: list[ast.stmt]) -> Table:
        expression, locked = self._resolved(expression, scope, made)
        table = self._literal(expression, ast.Dict)
        table.locked, table.node = table.locked or locked, expression
        return table

    def _literal(self, expression: ast.expr | None, kinds: type | tuple[type, ...] = (ast.List, ast.Tuple)) -> Table:
        """Return a list, a tuple or a mapping with constant keys as a table; other expressions are locked."""
        if not isinstance(expression, kinds):
            return Table(locked='it is computed; edit the text')
        span = self._span(expression)
        inner = Span(span.start + 1, span.end - 1)
        table = Table(inner=inner, span=span)
        keys = getattr(expression, 'keys', None)
        values = getattr(expression, 'values', None) or getattr(expression, 'elts', [])
        for key, value in zip(keys or values, values, strict=True):
            if key is None or isinstance(value, ast.Starred) or (keys and _text(key) is None):
                table.locked = 'a part of it is computed; edit the text'
                continue
            key_span, value_span = self._wide(key, inner), self._wide(value, inner)
            whole = Span(key_span.start, value_span.end)
            table.items.append(Item(whole, _text(key) or '', key_span, _text(value), value_span, value))
        return table

    def _arguments(self, call: ast.Call, names: Sequence[str] = ()) -> Table:
        """Return the arguments of a call, with the names of its positional ones."""
        end = self._span(call).end
        table = Table(inner=Span(self.text.index('(', self._span(call.func).end) + 1, end - 1))
        assert table.inner is not None
        for number, one in enumerate(call.args):
            key = '*' if isinstance(one, ast.Starred) else names[number] if number < len(names) else str(number)
            span = self._wide(one, table.inner)
            table.items.append(Item(span, key, value_span=span, value=_text(one), node=one))
        for given in call.keywords:
            value = self._wide(given.value, table.inner)
            start, key = self._span(given).start, given.arg or '**'
            key_span = Span(start, start + len(key))
            table.items.append(Item(Span(start, value.end), key, key_span, _text(given.value), value, given.value))
        table.items.sort(key=lambda item: item.span)
        return table

    def _behavior(self, owner: ast.ClassDef, root: str) -> dict[str, Any]:
        """Return name, description and parameters of a behavior, from its manifest or its constructor."""
        found: dict[str, Any] = {'name': owner.name, 'class': owner.name, 'name_span': None, 'parameters': []}
        found |= {'description': ast.get_docstring(owner) or '', 'span': self._span(owner), 'root': root}
        for node in _walk(owner):
            if isinstance(node, ast.Assign) and _code(node.targets[0]) == 'self.name' and _text(node.value):
                found['name'], found['name_span'] = _text(node.value), self._span(node.value)
            if not isinstance(node, ast.Call):
                continue
            name = self._name_of(node.func)
            if name == 'BehaviorManifest':
                for item in self._arguments(node, ('name', 'description', 'author')).items:
                    if item.key in ('name', 'description', 'author') and item.value is not None:
                        found[item.key], found[f'{item.key}_span'] = item.value, item.value_span
            elif name in ('BehaviorParameter', 'add_parameter'):
                texts: dict[str, Any] = {'description': ''}
                for item in self._arguments(node, ('name', 'default', 'description')).items:
                    is_code = item.key == 'default'
                    texts[item.key] = self.source(item.value_span) if is_code else self.value(item)[0]
                found['parameters'].append({**texts, 'span': self._span(node)})
        return found

    def value(self, item: Item) -> tuple[Any, bool]:
        try:
            return json_value(ast.literal_eval(item.node))
        except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
            return None, False

    def comments_of(self, state: State) -> list[str]:
        return [one for one in super().comments_of(state) if not _POSITION.match(f'# {one}')]

    def _span(self, node: Any) -> Span:
        return Span(self._at(node.lineno, node.col_offset), self._at(node.end_lineno, node.end_col_offset))

    def _at(self, line: int, column: int) -> int:
        """Return an offset; Python's columns count bytes."""
        start = self.lines.starts[line - 1] + (self._base if line == 1 else 0)
        if line not in self._widths:
            text = self.text[start : self.lines.end(start)]
            sizes = itertools.accumulate((len(letter.encode()) for letter in text), initial=0)
            self._widths[line] = [] if text.isascii() else list(sizes)
        widths = self._widths[line]
        return start + (bisect_left(widths, column) if widths else column)

    def _wide(self, node: Any, inner: Span) -> Span:
        """Return the span of an expression with the parentheses around it."""
        start, end = self._span(node)
        while True:
            before, behind = start, end
            while before > inner.start and self.text[before - 1].isspace():
                before -= 1
            while behind < inner.end and self.text[behind].isspace():
                behind += 1
            in_parentheses = self.text[before - 1] == '(' and before > inner.start
            if not in_parentheses or behind == inner.end or self.text[behind] != ')':
                return Span(start, end)
            start, end = before - 1, behind + 1

    def _name_of(self, function: ast.expr) -> str:
        name = _code(function).rpartition('.')[2] if _is_name(function) else ''
        return self._names.get(name, name)

    # -- writing -----------------------------------------------------------------------------------------------------

    def name(self, name: str, like: str = '') -> str:
        text = repr(name)
        if like[:1] == '"' and text[0] == "'" and '"' not in name:
            return f'"{text[1:-1]}"'
        return text

    def renamed(self, span: Span, name: str) -> TextEdit:
        return TextEdit(*span, name) if self.source(span).isidentifier() else super().renamed(span, name)

    def level(self, level: str, like: str) -> str:
        return str(LEVELS.index(level)) if like.isdigit() else f'Autonomy.{level.capitalize()}'

    def add_table(self, state: State, table: str, entry: str) -> list[TextEdit]:
        entries = state.tables['entries']
        index = sum(1 for item in entries.items if item.key in _ADD and _ADD.index(item.key) < _ADD.index(table))
        return self.insert_item(entries, f'{table}={{{entry}}}', index)

    def remove_last(self, state: State, table: str) -> list[TextEdit]:
        entries = state.tables['entries']
        index = next(number for number, item in enumerate(entries.items) if item.key == table)
        item = entries.items[index]
        if item.key_span.end == 0 and index + 1 < len(entries.items):
            return [TextEdit(*item.value_span, '{}')]
        return self.remove_items(entries, [index])

    def other_names(self, state: State, new: str) -> list[TextEdit]:
        """Rename the paths of embedded behaviors, and those of FlexBE's notes."""
        old = state.path.partition('/')[2]
        path = f'{old.rpartition("/")[0]}/{new}'.removeprefix('/')
        owners = (one for one in self._module.body if isinstance(one, ast.ClassDef))
        owner = next((one for one in owners if self._span(one).start <= state.span.start < self._span(one).end), None)
        edits = []
        for node in _walk(owner) if owner is not None else ():
            if isinstance(node, ast.Call) and self._name_of(node.func) in _EMBEDDING and len(node.args) > 1:
                text = _text(node.args[1])
                if text is not None and f'{text}/'.startswith(f'{old}/'):
                    span = self._span(node.args[1])
                    edits.append(TextEdit(*span, self.name(path + text[len(old) :], self.source(span))))
        within = self._span(owner) if owner is not None else Span(0, 0)
        for start, end in self.comments.items():
            found = _NOTE.match(self.text, start, end) if within.start <= start < within.end else None
            if found and f'{self.text[found.end() : end]}/'.startswith(f'{old}/'):
                edits.append(TextEdit(found.end(), found.end() + len(old), path))
        return edits

    def removed(self, state: State) -> list[TextEdit]:
        parent = state.parent
        assert parent is not None and state.item is not None
        is_alone = len(parent.rows.items) == 1 and parent.rows.inner is None
        need(not is_alone, f'{state.path} is the only state of its container; edit the text')
        edits = super().removed(state)
        waiting, spans = [state], [state.item.span]
        while waiting:
            one = waiting.pop()
            waiting += one.children
            for statement in self._statements.get(one, []):
                span = self._span(statement)
                if not any(other.start <= span.start and span.end <= other.end for other in spans):
                    spans.append(span)
                    edits += self._remove_row(Table([Item(span)]), 0)
        return edits

    def _refuse_hidden_names(self, state: State) -> None:
        super()._refuse_hidden_names(state)
        for child in state.parent.children if state.parent else ():
            if child.locked and child is not state and any(_text(node) == state.label for node in _walk(child.node)):
                raise GestureError(f'{child.path} names {state.path} and cannot be edited: {child.locked}')

    def refuse_computed(self, container: State, target: str, but: State | None = None) -> None:
        for child in container.children:
            ways = child.tables.get('transitions', Table())
            nodes = [*_walk(ways.node)] if ways.locked and child is not but else []
            keys = {id(key) for node in nodes if isinstance(node, ast.Dict) for key in node.keys}
            if any(_text(node) == target and id(node) not in keys for node in nodes):
                raise GestureError(f'{child.path} names {target} and cannot be edited: {ways.locked}')

    def _kept_above(self, state: State) -> int:
        above = self._comments_above(state.span.start)
        start = self.lines.start(state.span.start)
        is_position = bool(above) and _POSITION.match(self.text, above[-1].start) is not None
        return start - self.lines.start(above[-1].start) if is_position else 0

    @gesture
    def set_autonomy(self, state: str, outcome: str, level: str | None) -> list[TextEdit]:
        """Set the level of autonomy that an outcome requires: off, low, high or full; None removes it."""
        edits = super().set_autonomy(state, outcome, level)
        needs = any('Autonomy.' in one.text for one in edits)
        return [*edits, *(self._imported('', 'Autonomy') if needs else [])]

    @gesture
    def set_parameter(self, state: str, name: str, text: str | None) -> list[TextEdit]:
        """Set an argument of a state to a Python expression; None removes it."""
        one, _ = self._child(state)
        table = one.tables.get('parameters', Table(locked=f'it is a {one.kind}'))
        need(not table.locked, f'parameters of {state}: {table.locked}')
        item = table.find(name) if '*' not in name else None
        if text is None:
            if item is None or (name.isdigit() and item is not table.items[-1]):
                raise GestureError(f'{state} has no argument {short_repr(name)} that can be removed')
            return self.remove_items(table, [table.items.index(item)])
        written = _expression(text)
        if item is not None:
            return [TextEdit(*item.value_span, written)]
        need(one.kind == 'behavior' or _is_word(name), f'{short_repr(name)} cannot be the name of an argument')
        entry = f'{self.name(name)}: {written}' if one.kind == 'behavior' else f'{name}={written}'
        return self.insert_item(table, entry)

    @gesture
    def add_state(
        self, parent: str, label: str, type: str, parameters: dict[str, Any], transitions: dict[str, Any]
    ) -> list[TextEdit]:
        """Add a state behind the others of a container, in the form of its neighbor, and import it.

        ``type`` is a class that the file knows, or module and class, such as ``flexbt_states.WaitState``. Parameters
        that are texts are Python expressions; others are JSON values.
        """
        one = self.container(parent)
        self._check_label(one, label)
        module, _, made = type.rpartition('.')
        need(all(map(_is_word, type.split('.'))), f'{short_repr(type)} cannot be the class of a state')
        need(all(map(_is_word, parameters)), f'{short_repr(list(parameters))} are no names of parameters')
        for outcome, target in transitions.items():
            self.check_name(outcome, 'an outcome')
            if target != label:
                self._check_target(one, str(target))
        neighbor = self.neighbor(one)
        entries = neighbor.tables['entries']
        items, inner = entries.items, entries.inner or Span(0, 0)
        like = self.source(items[0].value_span)
        values = [f'{name}={_expression(x) if isinstance(x, str) else repr(x)}' for name, x in parameters.items()]
        arguments = [self.name(label, like), f'{made}({", ".join(values)})']
        edits = self._imported(module, made)
        if transitions:
            ways = ', '.join(f'{self.name(key, like)}: {self.name(str(way), like)}' for key, way in transitions.items())
            is_positional = any(item.key == 'transitions' and item.key_span.end == 0 for item in items)
            arguments.append(f'{{{ways}}}' if is_positional else f'transitions={{{ways}}}')
        head = self._position_below(neighbor)
        if head:  # FlexBE's editor writes the level of each outcome
            levels = ', '.join(f'{self.name(outcome, like)}: Autonomy.Off' for outcome in transitions)
            arguments += [f'autonomy={{{levels}}}'] if levels else []
            edits += self._imported('', 'Autonomy') if levels else []
        gaps = [Span(before.span.end, after.span.start) for before, after in itertools.pairwise(items)]
        gaps = [Span(inner.start, items[0].span.start), *gaps, Span(items[-1].span.end, inner.end)]
        begin, *between, end = (re.sub(r'#[^\r\n]*', '', self.source(gap)) for gap in gaps)
        text = begin + arguments[0]
        for number, argument in enumerate(arguments[1:]):
            text += f'{between[min(number, len(between) - 1)]}{argument}'
        function = self.source(self._span(neighbor.node.func))
        return [*edits, *self.insert_item(one.rows, f'{head}{function}({text}{end})')]

    def _position_below(self, neighbor: State) -> str:
        """Return the comment with the position of a new state in FlexBE's editor; empty if its neighbor has none."""
        above = self._comments_above(neighbor.span.start)
        found = _POSITION.match(self.text, above[-1].start) if above else None
        below = self.line_break + self._line_begin(neighbor.span.start)
        return f'# x:{found[1]} y:{int(found[2]) + 80}{below}' if found else ''

    @gesture
    def paste_state(self, parent: str, text: str) -> list[TextEdit]:
        """Add the state of a text, a call of ``add`` or ``Child``, behind the others of a container, in the form of its
        neighbor. A label that is taken gets a number."""
        one = self.container(parent)
        rows = re.sub(r'\A(\s*#.*\n)+', '', self.dedented(text)).strip().rstrip(',')
        other = PythonDocument(f'{rows}\n')
        body = [] if other.unreadable else other._module.body
        call = body[0].value if len(body) == 1 and isinstance(body[0], ast.Expr) else None
        arguments = other._arguments(call, _ADD) if isinstance(call, ast.Call) else Table()
        label = arguments.find('label')
        if label is None or label.value is None or arguments.inner is None or not arguments.find('state'):
            raise GestureError(f'{short_repr(text)} is no state; copy one')
        neighbor, new = self.neighbor(one), self.free_label(one, label.value)
        ways = arguments.find('transitions')
        targets = other._literal(ways.node, ast.Dict).items if ways else []
        edits = [other.renamed(item.value_span, new) for item in targets if item.value == label.value]
        inner = arguments.inner
        edits = [other.renamed(label.value_span, new), *edits] if new != label.value else []
        whole = applied(other.text, [TextEdit(0, inner.start, ''), *edits, TextEdit(inner.end, len(other.text), '')])
        indent = re.sub(r'\S.*', '', self._line_begin(neighbor.span.start))
        whole = LINE_BREAK.sub(lambda _: self.line_break, f'\n{indent}'.join(_code_lines(whole)))
        function = self.source(self._span(neighbor.node.func))
        return self.insert_item(one.rows, f'{self._position_below(neighbor)}{function}({whole})')

    def dedented(self, text: str) -> str:
        lines = _code_lines(text)
        margin = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
        return '\n'.join(line[margin:] for line in lines)

    # -- the head: name, texts and parameters of a behavior --------------------------------------------------

    def _head(self, behavior: int = 0) -> tuple[ast.ClassDef, Table | None, Table, dict[str, tuple[Item, Table]]]:
        """Return the class, the arguments of its manifest, the table of its parameters, and these by name, with the
        arguments of each."""
        need(
            behavior in range(len(self._owners)), 'the file has no such behavior whose class can be read; edit the text'
        )
        owner = self._owners[behavior]
        nodes = [*_walk(owner)]
        made = next((one for one in nodes if self._is_call(one, 'BehaviorManifest')), None)
        if isinstance(made, ast.Call):
            manifest = self._arguments(made, _MANIFEST)
            declared = manifest.find('parameters')
            table = Table(locked='it has no parameters yet') if declared is None else self._literal(declared.node)
        else:
            manifest = None
            rows = [one for one in nodes if isinstance(one, ast.Expr) and self._is_call(one.value, 'add_parameter')]
            table = Table([Item(self._span(one), node=one.value) for one in rows])
            table.locked = '' if rows else 'the first parameter has to be written in the text'
        found = {}
        for item in table.items:
            if isinstance(item.node, ast.Call):
                arguments = self._arguments(item.node, _PARAMETER)
                name = arguments.find('name')
                if name is not None and name.value is not None:
                    found[name.value] = item, arguments
        return owner, manifest, table, found

    def _is_call(self, node: ast.AST, name: str) -> bool:
        return isinstance(node, ast.Call) and self._name_of(node.func) == name

    @gesture
    def set_behavior(self, key: str, text: str | None) -> list[TextEdit]:
        """Set name, description or author of the behavior; None removes it."""
        need(key in _MANIFEST[:3], f'a manifest has no text {short_repr(key)}', key, _MANIFEST[:3])
        span = self.behaviors[0].get(f'{key}_span') if self.behaviors else None
        manifest = self._head()[1]
        if text is not None and span is not None:
            return [self.renamed(Span(*span), text)]
        if manifest is None:
            raise GestureError(f'the {key} of this behavior is not written as a text; edit it in the text')
        item = manifest.find(key)
        if text is None:
            if item is None or key == 'name' or item.key_span.end == 0:
                raise GestureError(f'the {key} of the behavior cannot be removed; edit the text')
            return self.remove_items(manifest, [manifest.items.index(item)])
        need(item is None, f'the {key} of the behavior is computed; edit the text')
        after = [n for n, one in enumerate(manifest.items) if one.key in _MANIFEST[: _MANIFEST.index(key)]]
        return self.insert_item(manifest, f'{key}={self.name(text)}', after[-1] + 1 if after else 0)

    def parameter_uses(self, behavior: int = 0) -> Iterator[tuple[str, Span, bool]]:
        if not self._owners:
            return
        owner, _, _, known = self._head(behavior)
        names = ((name, arguments.find('name')) for name, (_, arguments) in known.items())
        yield from ((name, item.value_span, True) for name, item in names if item is not None)
        for node in _walk(owner):
            if isinstance(node, ast.Attribute) and node.attr in known and _code(node.value) == 'self':
                yield node.attr, Span(self._span(node).end - len(node.attr), self._span(node).end), False
        for row in owner.body:
            if isinstance(row, ast.AnnAssign) and _code(row.target) in known:
                yield _code(row.target), self._span(row.target), True

    def parameter_removal(self, name: str) -> list[TextEdit]:
        owner, _, table, known = self._head()
        types = (one for one in owner.body if isinstance(one, ast.AnnAssign) and one.value is None)
        rows = [one for one in types if _code(one.target) == name]
        edits = [edit for one in rows for edit in self._remove_row(Table([Item(self._span(one))]), 0)]
        return [*edits, *self.remove_items(table, [table.items.index(known[name][0])])]

    def parameter_edits(self, name: str, fields: dict[str, Any]) -> list[TextEdit]:
        _, manifest, table, known = self._head()
        allowed = _PARAMETER[1:] if manifest is not None else _PARAMETER[1:2]
        need(set(fields) <= set(allowed), f'a parameter of this behavior has only {", ".join(allowed)}')
        texts = {key: self.name(one) if isinstance(one, str) else repr(one) for key, one in fields.items()}
        if fields.get('default') is not None:
            texts['default'] = _expression(str(fields['default']))
        if name in known:
            edits: list[TextEdit] = []
            arguments = known[name][1]
            for key, one in fields.items():
                item = arguments.find(key)
                if one is None and item is not None:
                    need(item.key_span.end, f'the {key} of {name} is given by its place; edit the text')
                    edits += self.remove_items(arguments, [arguments.items.index(item)])
                elif item is not None:
                    edits.append(TextEdit(*item.value_span, texts[key]))
                elif one is not None:
                    edits += self.insert_item(arguments, f'{key}={texts[key]}')
            return edits
        need(fields.get('default') is not None, f'the parameter {name} needs a default, which determines its type')
        rest = (f', {key}={text}' for key, text in texts.items() if key != 'default' and fields[key] is not None)
        new = f'({self.name(name)}, {texts["default"]}{"".join(rest)})'
        if manifest is None:
            return self.insert_item(table, f'self.add_parameter{new}')
        imports = (one for one in self._module.body if isinstance(one, ast.ImportFrom))
        modules = (str(one.module) for one in imports if any(part.name == 'BehaviorManifest' for part in one.names))
        edits = self._imported(next(modules, ''), 'BehaviorParameter')
        if manifest.find('parameters') is None:
            return [*edits, *self.insert_item(manifest, f'parameters=[BehaviorParameter{new}]')]
        return [*edits, *self.insert_item(table, f'BehaviorParameter{new}')]

    def _imported(self, module: str, name: str) -> list[TextEdit]:
        """Return the edits that import a name; from the module of the container classes if none is given."""
        if name in self._names:
            return []
        region = self.text.find('[MANUAL_IMPORT]')  # FlexBE's editor reads one name a line, and only before this region
        found = [one for one in self._module.body if isinstance(one, ast.ImportFrom) and one.module != '__future__']
        found = [one for one in found if region < 0 or self._span(one).start < region]
        if not module and name == 'Autonomy':
            module = next((str(one.module) for one in found if any(part.name in _CONTAINERS for part in one.names)), '')
        need(module and found, f'{name} is not imported; give its module too, as in flexbt_states.{name}')
        same = next((one for one in found if one.module == module and one.level == 0), None)
        if same is not None and region < 0:
            names = [part.name for part in same.names]
            spans = [self._span(part) for part in same.names]
            open_at = self.text.find('(', self._span(same).start, spans[0].start) + 1
            inner = Span(open_at, self._span(same).end - 1) if open_at else Span(spans[0].start, spans[-1].end)
            later = [n for n, other in enumerate(names) if other > name] if names == sorted(names) else []
            return self.insert_item(Table([Item(span) for span in spans], inner), name, later[0] if later else None)
        package = module.partition('.')[0]
        near = [one for one in found if str(one.module).partition('.')[0] == package] or found
        behind = next((one for one in near if str(one.module) > module), None)
        at = self.lines.starts[behind.lineno - 1] if behind else self.lines.end(self._span(near[-1]).end)
        return [TextEdit(at, at, f'from {module} import {name}{self.line_break}')]


def _code_lines(text: str) -> list[str]:
    """Return the lines of a code, each with those of a string that begins in it: their blanks are a part of it."""
    breaks = [one.span() for one in _TOKEN_OR_BREAK.finditer(text) if one.group()[0] in '\r\n']
    starts, ends = [0, *(end for _, end in breaks)], [*(start for start, _ in breaks), len(text)]
    return [text[start:end] for start, end in zip(starts, ends, strict=True)]


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all expressions and statements below it, in the order of ast.walk, which takes three times as
    long."""
    pending: list[Any] = [node]
    for one in pending:
        yield one
        for value in vars(one).values():
            if isinstance(value, list):
                pending += [part for part in value if isinstance(part, ast.AST)]
            elif isinstance(value, ast.AST) and not isinstance(value, ast.expr_context):
                pending.append(value)


def _code(node: ast.AST) -> str:
    """Return the code of an expression; that of a name quickly."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name | ast.Attribute):
        return f'{_code(node.value)}.{node.attr}'
    return node.id if isinstance(node, ast.Name) else ast.unparse(node)


def _is_name(node: ast.AST, context: type = ast.expr_context) -> bool:
    return isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, context)


def _is_word(name: str) -> bool:
    return name.isidentifier() and not keyword.iskeyword(name)


def _text(node: ast.AST) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _expression(text: str) -> str:
    """Return a text that is one Python expression in one line.

    Raises:
        GestureError: it is something else.
    """
    text = text.strip()
    try:
        call = ast.parse(f'f({text})', mode='eval').body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise GestureError(f'{short_repr(text)} is no Python expression: {error}') from error
    is_line = len(text.splitlines()) == 1 and all(one.group()[0] != '#' for one in _TOKENS.finditer(text))
    is_call = isinstance(call, ast.Call) and isinstance(call.func, ast.Name)  # and no call of what it returns
    given = [*call.args, *call.keywords] if isinstance(call, ast.Call) and is_call else []
    is_one = len(given) == 1 and not isinstance(given[0], ast.keyword | ast.Starred | ast.GeneratorExp)
    need(is_line and is_one, f'{short_repr(text)} is not one expression in one line')
    return text
