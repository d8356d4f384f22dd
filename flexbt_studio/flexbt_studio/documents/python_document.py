# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in Python as documents, also those that FlexBE's editor generates.

Python's own parser gives the place of each part. Calls that add a state by literals can be edited. What is added in a
loop, in a branch or by computed arguments is shown with a reason, and stays. The code is never run.

Positional parameters have the names ``0``, ``1``, …
"""

from __future__ import annotations

import ast
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

from flexbt_core.values.text import short_repr
from flexbt_studio.errors import GestureError

from .machine_document import LEVELS, Condition, Item, MachineDocument, State, Table, Wrapper, edit, json_value
from .text import Span, TextEdit

_TOKENS: Final = re.compile(
    r'#[^\r\n]*|\'\'\'(?:\\.|[^\\])*?\'\'\'|"""(?:\\.|[^\\])*?"""|\'(?:\\.|[^\'\\\r\n])*\'|"(?:\\.|[^"\\\r\n])*"',
    re.DOTALL,
)
_POSITION: Final = re.compile(r'# x:(-?\d+) y:(-?\d+)')
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
    containers: dict[ast.Call, _Container] = field(default_factory=dict)
    uses: Counter[str] = field(default_factory=Counter)
    returned: ast.expr | None = None


class PythonDocument(MachineDocument):
    """Behaviors in a Python file."""

    language: ClassVar[str] = 'python'

    # -- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> None:
        self.comments = {one.start(): one.end() for one in _TOKENS.finditer(self.text) if one.group()[0] == '#'}
        self._base = int(self.text.startswith('\ufeff'))
        self._statements: dict[State, list[ast.stmt]] = {}
        try:
            self._module = ast.parse(self.text[self._base :])
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            self.unreadable = True
            line = min(getattr(error, 'lineno', None) or 1, len(self._starts))
            start = min(self._starts[line - 1] + max((getattr(error, 'offset', None) or 1) - 1, 0), len(self.text))
            reason = getattr(error, 'msg', None) or str(error) or type(error).__name__
            self.problem(Span(start, min(start + 1, len(self.text))), f'no Python: {reason}')
            return
        self._names: dict[str, str] = {}  # that the module binds, with the names that they have where they come from
        for node in self._module.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                self._names.update((one.asname or one.name, one.name) for one in node.names)
            elif isinstance(node, ast.ClassDef | ast.FunctionDef):
                self._names[node.name] = node.name
        for scope, root in self._roots():
            state = State('', root.kind, None, self._span(root.call), self._span(root.call.func), node=root.call)
            self._read_container(state, root, scope)
            self.roots.append((scope.name, state))

    def _roots(self) -> Iterator[tuple[_Scope, _Container]]:
        """Read all functions. Yield the outermost containers, those that ``create`` returns first."""
        scopes: list[_Scope] = []
        classes: list[tuple[ast.ClassDef, _Scope]] = []
        owners: list[Any] = [self._module, *(one for one in ast.walk(self._module) if isinstance(one, ast.ClassDef))]
        for owner in owners:
            methods: dict[str, _Scope] = {}
            for function in [node for node in owner.body if isinstance(node, ast.FunctionDef)]:
                above = owner.name if isinstance(owner, ast.ClassDef) else ''
                name = above if above and function.name == 'create' else f'{above}.{function.name}'.strip('.')
                methods[function.name] = scope = _Scope(name, methods)
                scope.uses.update(ast.unparse(node) for node in ast.walk(function) if _is_name(node, ast.Load))
                self._read_block(function.body, scope, None, '')
                scopes.append(scope)
            if isinstance(owner, ast.ClassDef) and 'create' in methods:
                classes.append((owner, methods['create']))
            if owner is self._module:
                scopes.append(scope := _Scope('module', methods))
                self._read_block(
                    [one for one in owner.body if not isinstance(one, ast.ClassDef | ast.FunctionDef)], scope, None, ''
                )
        for owner, scope in classes:
            root = self._container_of(scope.returned, scope)
            if root is not None:
                self.behaviors.append(self._behavior(owner, '/' if not self.roots else f'{owner.name}:/'))
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
                    scope.values.setdefault(ast.unparse(target), []).append((one.value, one, lock))
                    if isinstance(target, ast.Attribute) and ast.unparse(target.value).endswith('.userdata'):
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
                            name = ast.unparse(item.optional_vars)
                            scope.values.setdefault(name, []).append((item.context_expr, one, lock))
            elif isinstance(one, ast.Expr) and isinstance(one.value, ast.Call):
                call = one.value
                if within is not None and isinstance(call.func, ast.Attribute) and call.func.attr == 'add':
                    within.adds.append((call, lock, one))
            elif isinstance(one, ast.For | ast.While | ast.If | ast.Try | ast.Match | ast.AsyncFor):
                kind = 'a loop' if isinstance(one, ast.For | ast.While | ast.AsyncFor) else 'a branch'
                why = lock or f'it is in {kind} (line {one.lineno})'
            for part in ('body', 'orelse', 'finalbody', 'handlers', 'cases'):
                blocks = getattr(one, part, [])
                inside = (
                    blocks
                    if not blocks or isinstance(blocks[0], ast.stmt)
                    else [s for each in blocks for s in each.body]
                )
                self._read_block(inside, scope, inner, why)

    def _made(self, expression: ast.expr, scope: _Scope) -> _Container | None:
        """Return the container that an expression makes; also read those that it makes in ``children``."""
        found = None
        for node in ast.walk(expression):
            kind = _CONTAINERS.get(self._name_of(node.func)) if isinstance(node, ast.Call) else None
            if isinstance(node, ast.Call) and kind is not None:
                scope.containers.setdefault(node, _Container(node, kind))
                found = scope.containers[node] if node is expression else found
        return found

    def _container_of(self, expression: ast.expr | None, scope: _Scope) -> _Container | None:
        """Return the container for which an expression stands: a call, a variable, or a method that returns it."""
        for _ in range(10):
            if isinstance(expression, ast.Call):
                if expression in scope.containers:
                    return scope.containers[expression]
                method = ast.unparse(expression.func).removeprefix('self.')
                if expression.args or expression.keywords or method not in scope.methods:
                    return None
                scope = scope.methods[method]
                expression = scope.returned
            values = scope.values.get(ast.unparse(expression), []) if expression is not None else []
            if isinstance(expression, ast.Call):
                continue
            if len(values) != 1:
                return None
            expression = values[0][0]
        return None

    def _read_container(self, state: State, container: _Container, scope: _Scope) -> None:
        container.is_used = True
        arguments = self._arguments(container.call, _CONTENT)
        for item in arguments.items:
            if item.key in ('outcomes', 'conditions'):
                state.tables[item.key] = self._list(item.node)
        for item in state.tables['conditions'].items if 'conditions' in state.tables else ():
            outcome = self._list(item.node)
            if len(outcome.items) == 2:
                pairs = self._list(outcome.items[1].node)
                for pair in pairs.items:
                    both = self._list(pair.node).items
                    if len(both) == 2:
                        pair.key, pair.key_span = both[0].key, both[0].span
                        pair.value, pair.value_span = both[1].value, both[1].span
                state.conditions.append(Condition(item, outcome.items[0], pairs))
        children = arguments.find('children')
        if children is not None:
            values = scope.values.get(ast.unparse(children.node), []) if _is_name(children.node) else []
            is_own = len(values) == 1 and scope.uses[ast.unparse(children.node)] == 1
            state.rows = self._list(values[0][0] if is_own else children.node)
            for item in state.rows.items:
                lock = state.rows.locked
                if not isinstance(item.node, ast.Call) or self._name_of(item.node.func) != 'Child':
                    lock = f'it is no call of Child (line {self._line(item.span.start) + 1})'
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
            text = self.text[slice(*(label.value_span if label else item.span))].split('\n')[0][:40]
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
                state.tables[table] = self._mapping(found.node, state, scope)
        for one in state.tables['autonomy'].items if 'autonomy' in state.tables else ():
            level = self.text[slice(*one.value_span)].rpartition('.')[2].lower()
            one.value = LEVELS[int(level)] if level in ('0', '1', '2', '3') else level
        made = arguments.find('state')
        if made is not None:
            self._read_state(state, made.node, scope)

    def _read_state(self, state: State, made: ast.expr, scope: _Scope) -> None:
        made, locked = self._resolved(made, state, scope)
        while isinstance(made, ast.Call) and self._name_of(made.func) in _WRAPPERS and made.args:
            kind, names = _WRAPPERS[self._name_of(made.func)]
            fields = {one.key: self.value(one)[0] for one in self._arguments(made, names).items[1:]}
            state.wrappers.append(Wrapper(kind, self._span(made), fields))
            made, why = self._resolved(made.args[0], state, scope)
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
        state.type = self.text[slice(*self._span(made.func))]
        if isinstance(made.func, ast.Attribute) and made.func.attr == 'use_behavior' and made.args:
            state.kind, state.type = 'behavior', self.text[slice(*self._span(made.args[0]))]
            parameters = table.find('parameters')
            table = self._mapping(parameters.node, state, scope) if parameters else Table(locked='it has no parameters')
        table.locked = table.locked or locked
        if container is None:
            state.tables['parameters'] = table

    def _resolved(self, expression: ast.expr, state: State, scope: _Scope) -> tuple[ast.expr, str]:
        """Return the expression that a variable stands for, and the reason for which it cannot be edited here."""
        values = scope.values.get(ast.unparse(expression), []) if _is_name(expression) else []
        if len(values) != 1 or self._container_of(expression, scope) is not None:
            return expression, ''
        value, statement, lock = values[0]
        uses = scope.uses[ast.unparse(expression)]
        if uses == 1 and not lock:
            self._statements[state].append(statement)
        return value, lock or ('' if uses == 1 else f'{ast.unparse(expression)} is used in several places')

    def _mapping(self, expression: ast.expr, state: State, scope: _Scope) -> Table:
        expression, locked = self._resolved(expression, state, scope)
        if not isinstance(expression, ast.Dict):
            return Table(locked='it is computed; edit the text')
        span = self._span(expression)
        inner = Span(span.start + 1, span.end - 1)
        table = Table(inner=inner, span=span, locked=locked)
        for key, value in zip(expression.keys, expression.values, strict=True):
            if key is None or not isinstance(key, ast.Constant) or not isinstance(key.value, str):
                table.locked = locked or 'it has computed keys; edit the text'
                continue
            key_span, value_span = self._wide(key, inner), self._wide(value, inner)
            whole = Span(key_span.start, value_span.end)
            table.items.append(Item(whole, key.value, key_span, _text(value), value_span, value))
        return table

    def _list(self, expression: ast.expr) -> Table:
        if not isinstance(expression, ast.List | ast.Tuple):
            return Table(locked='it is computed; edit the text')
        span = self._span(expression)
        inner = Span(span.start + 1, span.end - 1)
        table = Table(inner=inner, span=span)
        for one in expression.elts:
            text = one.value if isinstance(one, ast.Constant) and isinstance(one.value, str) else None
            table.items.append(
                Item(self._wide(one, inner), text or '', self._wide(one, inner), text, self._wide(one, inner), one)
            )
        if inner.start < inner.end and any(
            item.value is None and isinstance(item.node, ast.Starred) for item in table.items
        ):
            table.locked = 'it is computed; edit the text'
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
        for keyword in call.keywords:
            value = self._wide(keyword.value, table.inner)
            start, key = self._span(keyword).start, keyword.arg or '**'
            key_span = Span(start, start + len(key))
            table.items.append(Item(Span(start, value.end), key, key_span, _text(keyword.value), value, keyword.value))
        table.items.sort(key=lambda item: item.span)
        return table

    def _behavior(self, owner: ast.ClassDef, root: str) -> dict[str, Any]:
        """Return name, description and parameters of a behavior, from its manifest or its constructor."""
        found: dict[str, Any] = {
            'name': owner.name,
            'description': ast.get_docstring(owner) or '',
            'span': self._span(owner),
        }
        found |= {'name_span': None, 'root': root, 'parameters': []}
        for node in ast.walk(owner):
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'self.name' and _text(node.value):
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
                    texts[item.key] = self.text[slice(*item.value_span)] if is_code else self.value(item)[0]
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
        start = self._starts[line - 1] + (self._base if line == 1 else 0)
        text = self.text[start : start + column]
        return start + (column if text.isascii() else len(text.encode()[:column].decode(errors='ignore')))

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
        name = (
            function.attr
            if isinstance(function, ast.Attribute)
            else function.id
            if isinstance(function, ast.Name)
            else ''
        )
        return self._names.get(name, name)

    # -- writing -----------------------------------------------------------------------------------------------------

    def name(self, name: str, like: str = '') -> str:
        text = repr(name)
        if like[:1] == '"' and text[0] == "'" and '"' not in name:
            return f'"{text[1:-1]}"'
        return text

    def level(self, level: str, like: str, table: Table | None) -> str:
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
        for node in ast.walk(owner) if owner is not None else ():
            if isinstance(node, ast.Call) and self._name_of(node.func) in _EMBEDDING and len(node.args) > 1:
                text = _text(node.args[1])
                if text is not None and f'{text}/'.startswith(f'{old}/'):
                    span = self._span(node.args[1])
                    edits.append(TextEdit(*span, self.name(path + text[len(old) :], self.text[slice(*span)])))
        within = self._span(owner) if owner is not None else Span(0, 0)
        for start, end in self.comments.items():
            found = _NOTE.match(self.text, start, end) if within.start <= start < within.end else None
            if found and f'{self.text[found.end() : end]}/'.startswith(f'{old}/'):
                edits.append(TextEdit(found.end(), found.end() + len(old), path))
        return edits

    def removed(self, state: State) -> list[TextEdit]:
        parent = state.parent
        assert parent is not None and state.item is not None
        if len(parent.rows.items) == 1 and parent.rows.inner is None:
            raise GestureError(f'{state.path} is the only state of its container; edit the text')
        edits = self.remove_items(parent.rows, [parent.rows.items.index(state.item)])
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
            if child.locked and child is not state and any(_text(node) == state.label for node in ast.walk(child.node)):
                raise GestureError(f'{child.path} names {state.path} and cannot be edited: {child.locked}')

    def _kept_above(self, state: State) -> int:
        above = self._comments_above(state.span.start)
        start = self._starts[self._line(state.span.start)]
        is_position = bool(above) and _POSITION.match(self.text, above[-1].start) is not None
        return start - self._starts[self._line(above[-1].start)] if is_position else 0

    @edit
    def set_autonomy(self, state: str, outcome: str, level: str | None) -> list[TextEdit]:
        """Set the level of autonomy that an outcome requires: off, low, high or full; None removes it."""
        edits = super().set_autonomy(state, outcome, level)
        needs = any('Autonomy.' in one.text for one in edits)
        return [*edits, *(self._imported('', 'Autonomy') if needs else [])]

    @edit
    def set_parameter(self, state: str, name: str, text: str | None) -> list[TextEdit]:
        """Set an argument of a state to a Python expression; None removes it."""
        one = self._child(state)
        table = one.tables.get('parameters')
        if table is None or table.locked:
            raise GestureError(f'parameters of {state}: {table.locked if table else f"it is a {one.kind}"}')
        item = table.find(name) if '*' not in name else None
        if text is None:
            if item is None or (item.key.isdigit() and item is not table.items[-1]):
                raise GestureError(f'{state} has no argument {short_repr(name)} that can be removed')
            return self.remove_items(table, [table.items.index(item)])
        written = _expression(text)
        if item is not None:
            return [TextEdit(*item.value_span, written)]
        if one.kind != 'behavior' and not name.isidentifier():
            raise GestureError(f'{short_repr(name)} cannot be the name of an argument')
        return self.insert_item(
            table, f'{self.name(name)}: {written}' if one.kind == 'behavior' else f'{name}={written}'
        )

    @edit
    def add_state(
        self, parent: str, label: str, type: str, parameters: dict[str, Any], transitions: dict[str, Any]
    ) -> list[TextEdit]:
        """Add a state behind the others of a container, in the form of its neighbor, and import it.

        ``type`` is a class that the file knows, or module and class, such as ``flexbt_states.WaitState``. Parameters
        that are texts are Python expressions; others are JSON values.
        """
        one = self.container(parent)
        self._check_label(one, label)
        neighbor = next((child for child in reversed(one.children) if not child.locked), None)
        if neighbor is None or not all(part.isidentifier() for part in type.split('.')):
            what = (
                'has no state whose form a new one could have'
                if neighbor is None
                else f'cannot have {short_repr(type)}'
            )
            raise GestureError(f'{parent} {what}; edit the text')
        values = {name: _expression(text) if isinstance(text, str) else repr(text) for name, text in parameters.items()}
        for outcome, target in transitions.items():
            self._check_name(outcome, 'an outcome')
            if target != label:
                self._check_target(one, str(target))
        if not all(name.isidentifier() for name in values):
            raise GestureError(f'{short_repr(list(values))} are no names of parameters')
        module, _, class_name = type.rpartition('.')
        entries = neighbor.tables['entries']
        items, inner = entries.items, entries.inner
        assert inner is not None
        like = self.text[slice(*items[0].value_span)]
        ways = ', '.join(
            f'{self.name(outcome, like)}: {self.name(str(target), like)}' for outcome, target in transitions.items()
        )
        made = ', '.join(f'{name}={text}' for name, text in values.items())
        keyword = '' if any(item.key == 'transitions' and item.key_span.end == 0 for item in items) else 'transitions='
        arguments = [self.name(label, like), f'{class_name}({made})', *([f'{keyword}{{{ways}}}'] if ways else [])]
        above = self._comments_above(neighbor.span.start)
        position = _POSITION.match(self.text, above[-1].start) if above else None
        edits = self._imported(module, class_name)
        head = ''
        if position is not None:
            levels = ', '.join(f'{self.name(outcome, like)}: Autonomy.Off' for outcome in transitions)
            arguments += [f'autonomy={{{levels}}}'] if levels else []
            edits += self._imported('', 'Autonomy') if levels else []
            head = f'# x:{position[1]} y:{int(position[2]) + 80}{self.nl}{self._line_begin(neighbor.span.start)}'
        gaps = [self.text[before.span.end : after.span.start] for before, after in itertools.pairwise(items)]
        gaps = [re.sub(r'#[^\r\n]*', '', gap) for gap in (gaps or [', '])]
        begin, end = self.text[inner.start : items[0].span.start], self.text[items[-1].span.end : inner.end]
        assert isinstance(neighbor.node, ast.Call)
        text = arguments[0] + ''.join(f'{gaps[min(n, len(gaps) - 1)]}{one}' for n, one in enumerate(arguments[1:]))
        function = self.text[slice(*self._span(neighbor.node.func))]
        return [*edits, *self.insert_item(one.rows, f'{head}{function}({begin}{text}{re.sub("#.*", "", end)})')]

    def _imported(self, module: str, name: str) -> list[TextEdit]:
        """Return the edits that import a name; from the module of the container classes if none is given."""
        if name in self._names:
            return []
        found = [
            one
            for one in self._module.body
            if isinstance(one, ast.ImportFrom) and one.module and one.module != '__future__'
        ]
        if not module and name == 'Autonomy':
            module = next((str(one.module) for one in found if any(part.name in _CONTAINERS for part in one.names)), '')
        if not module or not found:
            raise GestureError(f'{name} is not imported; give its module too, as in flexbt_states.{name}')
        is_generated = '[MANUAL_IMPORT]' in self.text
        same = next((one for one in found if one.module == module and one.level == 0), None)
        if same is not None and not is_generated:
            names = [self._span(part) for part in same.names]
            open_at = self.text.find('(', self._span(same).start, names[0].start)
            table = Table([Item(span) for span in names], Span(names[0].start, names[-1].end))
            table.inner = Span(open_at + 1, self._span(same).end - 1) if open_at >= 0 else table.inner
            known = [part.name for part in same.names]
            later = [n for n, other in enumerate(known) if other > name] if known == sorted(known) else []
            return self.insert_item(table, name, later[0] if later else None)
        package = module.partition('.')[0]
        near = [one for one in found if str(one.module).partition('.')[0] == package] or found
        later_ones = [one for one in near if str(one.module) > module]
        row = f'from {module} import {name}{self.nl}'
        at = (
            self._starts[self._line(self._span(later_ones[0]).start)]
            if later_ones
            else self._line_end(self._span(near[-1]).end)
        )
        return [TextEdit(at, at, row)]


def _is_name(node: ast.AST, context: type = ast.expr_context) -> bool:
    return isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, context)


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
    comments = any(one.group()[0] == '#' for one in _TOKENS.finditer(text))
    if not isinstance(call, ast.Call) or len(call.args) != 1 or call.keywords or comments or len(text.splitlines()) > 1:
        raise GestureError(f'{short_repr(text)} is not one Python expression in one line')
    if isinstance(call.args[0], ast.Starred | ast.GeneratorExp) or not ast.unparse(call).startswith('f('):
        raise GestureError(f'{short_repr(text)} is not one Python expression')
    return text
