# SPDX-License-Identifier: BSD-3-Clause
"""State machines as documents: what YAML and Python have in common.

Both languages write a machine as tables: states, transitions, parameters. A table is either in brackets, with commas
between its items, or it has rows, each on lines of its own. An edit adds, removes, moves or replaces items, in the form
of their neighbors. Comments directly above an item, and behind it, belong to it.

A state has a path such as ``/Drive/Left``; that of the outermost container is ``/``. If two states have one path, the
second one gets ``/Drive (2)``. A file with several machines has the paths ``/…`` for the first one and ``Name:/…`` for
the others.
"""

from __future__ import annotations

import functools
import itertools
import math
import re
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, TypeVar

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_studio.errors import GestureError

from .document import Document, Problem, gesture
from .text import Lines, Span, TextEdit, applied

LEVELS: Final = ('off', 'low', 'high', 'full')
"""Levels of autonomy, by their numbers."""

MAX_CHARACTERS: Final = 1_000_000
"""Maximum length of a text that is read."""

_NOWHERE: Final = Span(0, 0)
_LINE_BREAK: Final = re.compile(r'\r\n?|\n')
_CONTAINER_KINDS: Final = ('machine', 'concurrency', 'priority')

_Method = TypeVar('_Method', bound=Callable[..., list[TextEdit]])


@dataclass(slots=True)
class Item:
    """An entry of a mapping, an item of a list, an argument, or a statement."""

    span: Span
    key: str = ''
    key_span: Span = _NOWHERE
    value: str | None = None
    """A name or text; None for other values."""
    value_span: Span = _NOWHERE
    node: Any = None
    """Its value in the syntax tree of the language."""


@dataclass(slots=True)
class Table:
    """Items in order."""

    items: list[Item] = field(default_factory=list)
    inner: Span | None = None
    """What is between the brackets; None for rows."""
    mark: str = ''
    """What each row begins with, such as ``- ``."""
    locked: str = ''
    """Reason for which it cannot be edited; empty if it can."""
    span: Span = _NOWHERE

    def find(self, key: str) -> Item | None:
        """Return the item with a key, or None."""
        return next((item for item in self.items if item.key == key), None)


@dataclass(slots=True)
class Condition:
    """A condition of a concurrency container: its outcome, and pairs of child and outcome."""

    item: Item
    outcome: Item
    pairs: Table


@dataclass(slots=True)
class Wrapper:
    """A retry or a time limit around a state. ``fields`` are JSON values."""

    kind: str
    span: Span
    fields: dict[str, Any]


@dataclass(slots=True, eq=False)
class State:
    """A state or a container."""

    label: str
    kind: str
    parent: State | None
    span: Span
    label_span: Span
    path: str = ''
    type: str = ''
    children: list[State] = field(default_factory=list)
    rows: Table = field(default_factory=Table)
    """The items of the children; one for each that can be edited."""
    item: Item | None = None
    """Its own item in ``parent.rows``."""
    tables: dict[str, Table] = field(default_factory=dict)
    conditions: list[Condition] = field(default_factory=list)
    wrappers: list[Wrapper] = field(default_factory=list)
    locked: str = ''
    node: Any = None

    @property
    def outcomes(self) -> list[str] | None:
        """Names of the outcomes of a container; None if they are not written out."""
        table = self.tables.get('outcomes')
        return None if table is None or table.locked else [item.key for item in table.items]


def edit(method: _Method) -> _Method:
    """Mark a method as a gesture whose result is checked: the text has to be readable before and after it."""

    @functools.wraps(method)
    def checked(self: MachineDocument, *arguments: Any, **named: Any) -> list[TextEdit]:
        if self.unreadable:
            raise GestureError(f'{self.where(self.problems[0].span.start)}: {self.problems[0].message}')
        return self.checked(method(self, *arguments, **named))

    return gesture(checked)  # type: ignore[return-value]


class MachineDocument(Document):
    """A document of state machines. Its languages implement the methods that raise NotImplementedError."""

    def __init__(self, text: str, file: str = '') -> None:
        super().__init__(text, file)
        self._starts = [0, *(match.end() for match in _LINE_BREAK.finditer(text))]
        self.nl = Lines(text).line_break()
        self.comments: dict[int, int] = {}
        """Begin and end of each comment."""
        self.fixed: list[tuple[Span, str]] = []
        """Parts that no gesture may change, with the reasons."""
        self.roots: list[tuple[str, State]] = []
        """The outermost containers, by the names of their machines."""
        self.behaviors: list[dict[str, Any]] = []
        self.unreadable = False
        self._problems: list[Problem] = []
        self._states: dict[str, State] = {}
        if len(text) > MAX_CHARACTERS:
            self.problem(Span(0, 0), f'the text has {len(text)} characters; at most {MAX_CHARACTERS} are read')
            self.unreadable = True
            return
        self._read()
        for number, (name, root) in enumerate(self.roots):
            same = sum(1 for other, _ in self.roots[:number] if other == name)
            self._name_paths(root, '' if not number else f'{name} ({same + 1}):' if same else f'{name}:')

    # -- what the languages implement --------------------------------------------------------------------------------

    def _read(self) -> None:
        """Read the text: set the comments, roots, behaviors and problems."""
        raise NotImplementedError

    def name(self, name: str, like: str = '') -> str:
        """Return a name as it is written in the text, with the quotes of ``like``."""
        raise NotImplementedError

    def level(self, level: str, like: str, table: Table | None) -> str:
        """Return a level of autonomy as it is written in the text."""
        raise NotImplementedError

    def add_table(self, state: State, table: str, entry: str) -> list[TextEdit]:
        """Return the edits that give a state a table with one entry."""
        raise NotImplementedError

    def remove_last(self, state: State, table: str) -> list[TextEdit]:
        """Return the edits that remove a table of which the last item goes."""
        raise NotImplementedError

    def other_names(self, state: State, new: str) -> list[TextEdit]:
        """Return the edits of a renaming that only this language needs."""
        return []

    def removed(self, state: State) -> list[TextEdit]:
        """Return the edits that remove a state."""
        raise NotImplementedError

    # -- view --------------------------------------------------------------------------------------------------------

    @property
    def problems(self) -> list[Problem]:
        return list(self._problems)

    def problem(self, span: Span, message: str) -> None:
        """Add a problem."""
        self._problems.append(Problem(span, message))

    def where(self, offset: int) -> str:
        """Return the place of an offset for a message."""
        return f'{self.file or self.language} line {self._line(offset) + 1}'

    def view(self) -> dict[str, Any]:
        return {
            'language': self.language,
            'behavior': self.behaviors[0] if self.behaviors else None,
            'behaviors': self.behaviors,
            'states': [self._state_view(state) for state in self._states.values()],
        }

    def state(self, path: str) -> State:
        """Return the state with a path.

        Raises:
            GestureError: there is none.
        """
        if path not in self._states:
            raise GestureError(f'there is no state {short_repr(path)}{did_you_mean(path, self._states)}')
        return self._states[path]

    def value(self, item: Item) -> tuple[Any, bool]:
        """Return a value as JSON, and whether it is literal."""
        raise NotImplementedError

    def comments_of(self, state: State) -> list[str]:
        """Return the texts of the comments that belong to a state."""
        spans = self._comments_above(state.span.start)
        behind = self._comment_on_line(state.label_span.end)
        return [
            self.text[span.start : span.end].lstrip('#').strip() for span in (*spans, *([behind] if behind else []))
        ]

    def _state_view(self, state: State) -> dict[str, Any]:
        def rows(name: str, key: str, value: str) -> list[dict[str, Any]]:
            items = state.tables[name].items if name in state.tables else []
            return [
                {key: one.key, value: one.value, 'span': one.span, f'{value}_span': one.value_span} for one in items
            ]

        def values(name: str) -> list[dict[str, Any]]:
            found = []
            for one in state.tables[name].items if name in state.tables else []:
                value, literal = self.value(one)
                text = self.text[one.value_span.start : one.value_span.end]
                found.append(
                    {'name': one.key, 'text': text, 'value': value, 'span': one.value_span, 'literal': literal}
                )
            return found

        parent = state.parent
        return {
            'path': state.path,
            'parent': parent.path if parent else None,
            'kind': state.kind,
            'label': state.label,
            'label_span': state.label_span,
            'type': state.type,
            'span': state.span,
            'initial': bool(parent and parent.kind != 'concurrency' and parent.children[0] is state),
            'outcomes': state.outcomes or [],
            'parameters': values('parameters'),
            'userdata': values('userdata'),
            'transitions': rows('transitions', 'outcome', 'target'),
            'autonomy': rows('autonomy', 'outcome', 'level'),
            'remapping': rows('remapping', 'key', 'name'),
            'conditions': [
                {
                    'outcome': one.outcome.value,
                    'when': [[p.key, p.value] for p in one.pairs.items],
                    'span': one.item.span,
                }
                for one in state.conditions
            ],
            'wrappers': [{'kind': one.kind, 'span': one.span, **one.fields} for one in state.wrappers],
            'comments': self.comments_of(state),
            'locked': state.locked,
        }

    def _name_paths(self, root: State, prefix: str) -> None:
        waiting = [root]
        while waiting:
            state = waiting.pop()
            above = state.parent
            state.path = path = f'{above.path.removesuffix("/")}/{state.label}' if above else f'{prefix}/'
            count = 1
            while state.path in self._states:
                count += 1
                state.path = f'{path} ({count})'
            if count > 1 and not state.locked:
                state.locked = f'another state has the label {short_repr(state.label)}; rename one of them in the text'
            self._states[state.path] = state
            waiting += reversed(state.children)

    # -- gestures ----------------------------------------------------------------------------------------------------

    @edit
    def set_target(self, state: str, outcome: str, target: str | None) -> list[TextEdit]:
        """Let an outcome lead to a state beside it or to an outcome of its container; None removes the transition."""
        one = self._child(state)
        if target is not None:
            self._check_target(one.parent, target)
        own = one.outcomes
        if target is not None and own is not None and outcome not in own:
            raise GestureError(f'{state} has no outcome {short_repr(outcome)}{did_you_mean(outcome, own)}')
        return self._put(one, 'transitions', outcome, target, self.name)

    @edit
    def set_autonomy(self, state: str, outcome: str, level: str | None) -> list[TextEdit]:
        """Set the level of autonomy that an outcome requires: off, low, high or full; None removes it."""
        one = self._child(state)
        if level is not None and level not in LEVELS:
            raise GestureError(f'{short_repr(level)} is none of the levels {", ".join(LEVELS)}')
        table = one.tables.get('autonomy')
        return self._put(one, 'autonomy', outcome, level, lambda text, like: self.level(text, like, table))

    @edit
    def set_remapping(self, state: str, key: str, name: str | None) -> list[TextEdit]:
        """Set the key of the container's userdata that a key of the state stands for; None removes it."""
        return self._put(self._child(state), 'remapping', key, name, self.name)

    @edit
    def rename_state(self, state: str, label: str) -> list[TextEdit]:
        """Rename a state, and all that names it in its container."""
        one = self._child(state)
        parent = one.parent
        assert parent is not None
        if label == one.label:
            return []
        self._check_label(parent, label)
        self._refuse_hidden_names(one)
        edits = [self._renamed(one.label_span, label)]
        edits += [self._renamed(item.value_span, label) for _, item in self._transitions_to(parent, one.label)]
        for condition in parent.conditions:
            edits += [self._renamed(pair.key_span, label) for pair in condition.pairs.items if pair.key == one.label]
        return [*edits, *self.other_names(one, label)]

    @edit
    def remove_state(self, state: str, instead: str | None = None) -> list[TextEdit]:
        """Remove a state with its comments. Transitions that lead to it lead to ``instead``, if it is given."""
        one = self._child(state)
        parent = one.parent
        assert parent is not None
        self._refuse_hidden_names(one)
        transitions = [pair for pair in self._transitions_to(parent, one.label) if pair[0] is not one]
        if transitions and instead is None:
            sources = ', '.join(f'{source.path} ({item.key})' for source, item in transitions)
            raise GestureError(f'transitions lead to {state}: {sources}; name a target that replaces it')
        if instead is not None:
            self._check_target(parent, instead)
            if instead == one.label:
                raise GestureError(f'{state} is removed, so {short_repr(instead)} cannot replace it')
        edits = [self._renamed(item.value_span, instead or '') for _, item in transitions]
        gone = []
        for number, condition in enumerate(parent.conditions):
            named = [index for index, pair in enumerate(condition.pairs.items) if pair.key == one.label]
            if named and len(named) == len(condition.pairs.items):
                gone.append(number)
            elif named:
                edits += self.remove_items(condition.pairs, named)
        if gone:
            table = parent.tables['conditions']
            edits += self.remove_items(table, gone)
        return [*edits, *self.removed(one)]

    @edit
    def move_state(self, state: str, index: int) -> list[TextEdit]:
        """Move a state to another place among the states of its container, from 0."""
        one = self._child(state)
        return self._moved(one, index)

    @edit
    def set_initial(self, state: str) -> list[TextEdit]:
        """Let a state be the first one of its container, with which it begins."""
        one = self._child(state)
        if one.parent is not None and one.parent.kind == 'concurrency':
            raise GestureError(f'{one.parent.path} is a concurrency container: all its states begin at once')
        return self._moved(one, 0)

    @edit
    def set_comment(self, state: str, text: str) -> list[TextEdit]:
        """Set the comment above a state, line by line; an empty text removes it."""
        one = self._child(state)
        if any(ord(letter) < 32 and letter not in '\n\t' for letter in text):
            raise GestureError('a comment cannot have control characters')
        line = self._line(one.span.start)
        start = self._starts[line]
        above = self._comments_above(one.span.start)
        indent = self.text[start : one.span.start]
        if indent.strip():
            raise GestureError(f'{state} does not begin its line; write the comment in the text')
        lines = [f'{indent}# {one_line}'.rstrip() for one_line in text.splitlines()] if text.strip() else []
        begin = self._starts[self._line(above[0].start)] if above else start
        return [TextEdit(begin, start - self._kept_above(one), ''.join(f'{one_line}{self.nl}' for one_line in lines))]

    def _kept_above(self, state: State) -> int:
        """Return the number of characters directly above a state that are no comment of its author."""
        return 0

    # -- checks of gestures ------------------------------------------------------------------------------------------

    def checked(self, edits: list[TextEdit]) -> list[TextEdit]:
        """Return the edits that change something.

        Raises:
            GestureError: they change a fixed part, or the text could not be read afterwards.
        """
        edits = [one for one in edits if self.text[one.start : one.end] != one.text]
        edits.sort(key=lambda one: (one.start, one.end))
        for one in edits:
            for span, reason in self.fixed:
                if (
                    (span.start < one.end and one.start < span.end)
                    if one.end > one.start
                    else span.start < one.start < span.end
                ):
                    raise GestureError(f'{self.where(span.start)}: {reason}')
        try:
            after = type(self)(applied(self.text, edits), self.file)
        except ValueError as error:
            raise GestureError('two parts of this edit overlap; edit the text instead') from error
        if len(after.problems) > len(self.problems):
            new = after.problems[-1]
            raise GestureError(f'the text could not be read after this edit: {new.message}; edit the text instead')
        return edits

    def editable(self, path: str) -> State:
        """Return the state with a path that can be edited."""
        one = self.state(path)
        if one.locked:
            raise GestureError(f'{path} cannot be edited: {one.locked}')
        return one

    def container(self, path: str) -> State:
        """Return the container with a path that can be edited."""
        one = self.editable(path)
        if one.kind not in _CONTAINER_KINDS:
            raise GestureError(f'{path} is not a container, but a {one.kind}')
        return one

    def _child(self, path: str) -> State:
        one = self.editable(path)
        if one.parent is None:
            raise GestureError(f'{path} is the outermost container; this applies to the states in it')
        return one

    def _check_name(self, name: str, what: str) -> None:
        if not name or not name.isprintable() or name != name.strip():
            raise GestureError(
                f'{short_repr(name)} cannot be {what}: it is empty, or has blanks around it or control characters'
            )

    def _check_label(self, parent: State, label: str) -> None:
        self._check_name(label, 'a label')
        if '/' in label:
            raise GestureError(f"{short_repr(label)} cannot be a label: it contains '/'")
        if any(child.label == label for child in parent.children):
            raise GestureError(f'{parent.path} has a state {short_repr(label)} already')
        if label in (parent.outcomes or ()):
            raise GestureError(f'{short_repr(label)} is an outcome of {parent.path}; a state needs another label')

    def _check_target(self, parent: State | None, target: str) -> None:
        assert parent is not None
        labels = [] if parent.kind == 'concurrency' else [child.label for child in parent.children]
        known = [*labels, *(parent.outcomes or ())]
        self._check_name(target, 'a target')
        if target not in known and parent.outcomes is not None:
            kinds = 'an outcome' if parent.kind == 'concurrency' else 'a state or an outcome'
            raise GestureError(f'{short_repr(target)} is not {kinds} of {parent.path}{did_you_mean(target, known)}')

    def _transitions_to(self, parent: State, target: str) -> Iterator[tuple[State, Item]]:
        """Yield the transitions of the children that lead to a target, with their states."""
        for child in parent.children:
            for item in child.tables['transitions'].items if 'transitions' in child.tables else ():
                if item.value == target:
                    yield child, item

    def _refuse_hidden_names(self, state: State) -> None:
        """Raise if a part of the container that cannot be edited names a state."""
        parent = state.parent
        assert parent is not None
        for child in parent.children:
            table = child.tables.get('transitions')
            locked = child.locked or (table.locked if table else '')
            if (
                locked
                and child is not state
                and any(item.value == state.label for item in (table.items if table else ()))
            ):
                raise GestureError(f'{child.path} leads to {state.path} and cannot be edited: {locked}')

    # -- edits of tables ---------------------------------------------------------------------------------------------

    def _put(
        self, state: State, table: str, key: str, value: str | None, written: Callable[[str, str], str]
    ) -> list[TextEdit]:
        """Set, add (None: remove) an entry of a table of a state."""
        self._check_name(key, 'a name')
        if value is not None:
            self._check_name(value, 'a name')
        found = state.tables.get(table)
        if found is not None and found.locked:
            raise GestureError(f'{table} of {state.path}: {found.locked}')
        item = found.find(key) if found is not None else None
        if value is None:
            if found is None or item is None:
                known = [one.key for one in found.items] if found else []
                raise GestureError(f'{state.path} has no {table} of {short_repr(key)}{did_you_mean(key, known)}')
            if len(found.items) == 1:
                return self.remove_last(state, table)
            return self.remove_items(found, [found.items.index(item)])
        if item is not None:
            if item.value is None:
                raise GestureError(f'{table} of {state.path}: {short_repr(key)} is computed; edit the text')
            like = self.text[item.value_span.start : item.value_span.end]
            blank = '' if like else ' '
            return [TextEdit(*item.value_span, blank + written(value, like))]
        neighbor = found.items[-1] if found is not None and found.items else None
        like = self.text[neighbor.value_span.start : neighbor.value_span.end] if neighbor else ''
        like_key = self.text[neighbor.key_span.start : neighbor.key_span.end] if neighbor else ''
        entry = f'{self.name(key, like_key)}: {written(value, like)}'
        return self.add_table(state, table, entry) if found is None else self.insert_item(found, entry)

    def _renamed(self, span: Span, name: str) -> TextEdit:
        return TextEdit(*span, self.name(name, self.text[span.start : span.end]))

    def insert_item(self, table: Table, new: str, index: int | None = None) -> list[TextEdit]:
        """Insert an item into a table, before the item ``index`` or at the end.

        Lines of ``new`` after its first one are indented already.
        """
        if table.locked:
            raise GestureError(table.locked)
        items, last = table.items, len(table.items)
        index = last if index is None else index
        if table.inner is None:
            return self._insert_row(table, new, index)
        if not items:
            blank = not self.text[table.inner.start : table.inner.end].strip()
            return [TextEdit(table.inner.start, table.inner.end if blank else table.inner.start, new)]
        if index < last:
            one = items[index].span
            begin = self._line_begin(one.start)
            behind = ' ' if begin.strip() else self.nl + begin
            return [TextEdit(one.start, one.start, f'{new},{behind}')]
        span = items[-1].span
        comma = self._comma_behind(table, last - 1)
        end = comma + 1 if comma is not None else span.end
        comment = self._comment_on_line(end)
        if comment is not None and comment.end > table.inner.end:
            comment = None
        begin = self._line_begin(span.start)
        if comment is None and begin.strip():
            return [TextEdit(end, end, f' {new},' if comma is not None else f', {new}')]
        if begin.strip(' \t,'):  # in one line with other items, and a comment behind it
            begin = re.sub(r'[^\t]', ' ', self._line_begin(items[0].span.start))
        indent = begin.partition(',')[0]
        if comma is not None:
            at = comment.end if comment else end
            return [TextEdit(at, at, f'{self.nl}{indent}{new},')]
        if comment is not None or ',' in begin:
            at = comment.end if comment else end
            return [TextEdit(at, at, f'{self.nl}{indent}, {new}')]
        return [TextEdit(end, end, f',{self.nl}{indent}{new}')]

    def remove_items(self, table: Table, indices: list[int]) -> list[TextEdit]:
        """Remove items of a table, with their comments. One has to be left, or the table may be empty."""
        if table.locked:
            raise GestureError(table.locked)
        edits: list[TextEdit] = []
        if table.inner is not None and len(indices) == len(table.items):
            return [TextEdit(*table.inner, '')]
        left = [index for index in range(len(table.items)) if index not in indices]
        for index in indices:
            edits += self._remove_row(table, index) if table.inner is None else self._remove_flow(table, index, left)
        return edits

    def _remove_flow(self, table: Table, index: int, left: list[int]) -> list[TextEdit]:
        assert table.inner is not None
        items, span = table.items, table.items[index].span
        is_last = not any(other > index for other in left)  # of those that stay, none is behind it
        comma = self._comma_behind(table, index)
        rows = self._own_lines(table, index)
        if rows is not None and table.inner.start <= rows.start and rows.end <= table.inner.end:
            edits = [TextEdit(*rows, '')]
            before = self._comma_behind(table, index - 1) if index else None
            if is_last and index == len(items) - 1 and comma is None and before is not None and before < rows.start:
                edits.append(TextEdit(before, before + 1, ''))
            return edits
        if not is_last:
            return [TextEdit(span.start, items[index + 1].span.start, '')]
        start = items[index - 1].span.end
        comments = [one for one in self.comments if start <= one < span.start]
        if comments:  # it belongs to the item before; the line break behind it has to stay
            ended = self.comments[comments[-1]]
            comma_before = self.text.find(',', ended, span.start)
            start = comma_before if comma_before >= 0 else self._line_end(ended)
        behind = self._comment_on_line(span.end)
        end = behind.end if behind is not None and behind.end <= table.inner.end and comma is None else span.end
        return [TextEdit(start, end, '')]

    def move_item(self, table: Table, index: int, to: int) -> list[TextEdit]:
        """Move an item of a table to another place; each item keeps its comments."""
        if table.locked:
            raise GestureError(table.locked)
        if index == to:
            return []
        low, high = min(index, to), max(index, to)
        spans = [self._own_lines(table, one) for one in range(low, high + 1)]
        commas = table.inner is None or all(self._comma_behind(table, one) is not None for one in range(low, high + 1))
        if not commas or any(span is None for span in spans):
            if table.inner is None:
                raise GestureError(f'{self.where(table.items[index].span.start)}: items share a line; edit the text')
            texts = [self.text[one.span.start : one.span.end] for one in table.items]
            texts.insert(to, texts.pop(index))
            return [TextEdit(*table.items[one].span, texts[one]) for one in range(low, high + 1)]
        rows = [span for span in spans if span is not None]
        for before, after in itertools.pairwise(rows):
            if self._code_between(before.end, after.start):
                raise GestureError(f'{self.where(before.end)}: there are other statements in between; edit the text')
        here, there = (rows[0], rows[-1]) if index < to else (rows[-1], rows[0])
        gap = Span(rows[0].end, rows[1].start) if index < to else Span(rows[-2].end, rows[-1].start)
        chunk, blank = self.text[here.start : here.end], self.text[gap.start : gap.end]
        if blank.strip():  # a comment that belongs to neither stays
            gap, blank = Span(here.end, here.end) if index < to else Span(here.start, here.start), ''
        cut = Span(here.start, max(gap.end, here.end)) if index < to else Span(min(gap.start, here.start), here.end)
        unended = not self.text.endswith(('\n', '\r')) and max(here.end, there.end) == len(self.text)
        if unended and index < to:
            return [TextEdit(*cut, ''), TextEdit(there.end, there.end, self.nl + blank + chunk[: -len(self.nl)])]
        if unended:
            cut = Span(cut.start - len(self.nl), cut.end)
            chunk += self.nl
        at = there.end if index < to else there.start
        return [TextEdit(*cut, ''), TextEdit(at, at, blank + chunk if index < to else chunk + blank)]

    def _moved(self, state: State, to: int) -> list[TextEdit]:
        parent, item = state.parent, state.item
        assert parent is not None
        if not 0 <= to < len(parent.children):
            raise GestureError(f'{parent.path} has {len(parent.children)} states; {to} is none of their places')
        low, high = sorted((to, parent.children.index(state)))
        for child in parent.children[low : high + 1]:
            if child.locked or child.item is None:
                raise GestureError(f'{child.path} cannot be moved: {child.locked}')
        assert item is not None
        other = parent.children[to].item
        index, places = (next(at for at, row in enumerate(parent.rows.items) if row is one) for one in (item, other))
        return self.move_item(parent.rows, index, places)

    def _insert_row(self, table: Table, new: str, index: int) -> list[TextEdit]:
        last = len(table.items)
        spans = [self._row(table, one) for one in range(max(0, min(index, last) - 2), min(index, last))]
        anchor = self._row(table, index) if index < last else spans[-1]
        first = table.items[min(index, last - 1)].span.start
        indent = re.sub(r'[^\s]', ' ', self._line_begin(first)) if not table.mark else self._line_begin(first)
        if table.mark:
            indent = indent[: len(indent) - len(indent.lstrip())]
        at = anchor.start if index < last else anchor.end
        blank = ''
        if len(spans) == 2 and not self.text[spans[0].end : spans[1].start].strip(' \t\r\n'):
            blank = self.text[spans[0].end : spans[1].start]
        row = f'{indent}{table.mark}{new}'
        if at == len(self.text) and not self.text.endswith(('\n', '\r')):
            return [TextEdit(at, at, f'{self.nl}{blank}{row}')]
        return [TextEdit(at, at, f'{row}{self.nl}{blank}' if index < last else f'{blank}{row}{self.nl}')]

    def _remove_row(self, table: Table, index: int) -> list[TextEdit]:
        span = self._row(table, index)
        start, end = span
        if index or len(table.items) == 1:
            while start > 0 and not self.text[self._starts[self._line(start - 1)] : start].strip():
                start = self._starts[self._line(start - 1)]
        else:
            while end < len(self.text) and not self.text[end : self._line_end(end)].strip():
                end = self._line_end(end)
        if span.end == len(self.text) and not self.text.endswith(('\n', '\r')) and start:
            start -= len(_LINE_BREAK.findall(self.text[start - 2 : start])[-1])
        return [TextEdit(start, end, '')]

    # -- lines and comments ------------------------------------------------------------------------------------------

    def _line(self, offset: int) -> int:
        return bisect_right(self._starts, offset) - 1

    def _line_end(self, offset: int) -> int:
        """Return the end of the line of an offset, with its line break."""
        line = self._line(offset) + 1
        return self._starts[line] if line < len(self._starts) else len(self.text)

    def _line_begin(self, offset: int) -> str:
        """Return what is before an offset in its line."""
        return self.text[self._starts[self._line(offset)] : offset].lstrip('\ufeff')

    def _comment_on_line(self, offset: int) -> Span | None:
        """Return the comment behind an offset in its line."""
        line_end = self._line_end(offset)
        start = self.text.find('#', offset, line_end)
        while start >= 0 and start not in self.comments:
            start = self.text.find('#', start + 1, line_end)
        return Span(start, self.comments[start]) if start >= 0 else None

    def _comments_above(self, offset: int) -> list[Span]:
        """Return the comments in the lines directly above an item, which begin in its column."""
        found: list[Span] = []
        line = self._line(offset) - 1
        begin = self._line_begin(offset)
        column = len(begin) - len(begin.lstrip())
        while line >= 0:
            start = self._starts[line] + column
            if start not in self.comments or self.text[self._starts[line] : start].strip():
                break
            found.insert(0, Span(start, self.comments[start]))
            line -= 1
        return found

    def _row(self, table: Table, index: int) -> Span:
        span = self._own_lines(table, index)
        if span is None:
            raise GestureError(f'{self.where(table.items[index].span.start)}: it shares a line; edit the text')
        return span

    def _own_lines(self, table: Table, index: int) -> Span | None:
        """Return the lines of an item with its comments; None if it shares a line with something else."""
        start, end = table.items[index].span
        begin = self._line_begin(start)
        if begin.strip(' \t,-' if table.mark else ' \t,') or (table.inner is None and ',' in begin):
            return None
        comma = self._comma_behind(table, index) if table.inner is not None else None
        end = end if comma is None else comma + 1
        comment = self._comment_on_line(end)
        if self.text[end : comment.start if comment else self._line_end(end)].strip():
            return None
        above = self._comments_above(start)
        column = len(begin) - len(begin.lstrip())
        last = self._line_end(end)
        position = last
        while table.inner is None and position < len(self.text):  # comments that are indented more belong to the row
            line = self.text[position : self._line_end(position)]
            first = len(line) - len(line.lstrip())
            if line.strip() and not (position + first in self.comments and first > column):
                break
            position = self._line_end(position)
            last = position if line.strip() else last
        return Span(self._starts[self._line(above[0].start if above else start)], last)

    def _comma_behind(self, table: Table, index: int) -> int | None:
        """Return the place of the comma directly behind an item."""
        assert table.inner is not None
        end = table.items[index].span.end
        after = table.items[index + 1].span.start if index + 1 < len(table.items) else table.inner.end
        found = re.compile(r'[ \t]*,').match(self.text, end, after)
        return found.end() - 1 if found else None

    def _code_between(self, start: int, end: int) -> bool:
        """Return whether there is something else than blanks and comments."""
        position = start
        while position < end:
            if self.text[position].isspace():
                position += 1
            elif position in self.comments:
                position = self.comments[position]
            else:
                return True
        return False


def json_value(value: Any) -> tuple[Any, bool]:
    """Return a value as JSON, and True; None and False if it is none."""
    if value is None or isinstance(value, bool | str) or (isinstance(value, int | float) and math.isfinite(value)):
        return value, True
    if isinstance(value, list | tuple):
        found = [json_value(one) for one in value]
        return ([one for one, _ in found], True) if all(literal for _, literal in found) else (None, False)
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        pairs = {key: json_value(one) for key, one in value.items()}
        if all(literal for _, literal in pairs.values()):
            return {key: one for key, (one, _) in pairs.items()}, True
    return None, False
