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
import keyword
import math
import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

from flexbt_core.skills.skill import LEVELS
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_studio.errors import GestureError

from .document import Document, Problem, gesture, need
from .text import LINE_BREAK, Span, TextEdit

MAX_CHARACTERS: Final = 1_000_000
"""Maximum length of a text that is read."""

CONTAINERS: Final = ('machine', 'concurrency', 'priority')
"""Kinds of states that contain others."""

_NAMES: Final = ('input_keys', 'output_keys', 'io_keys', 'default_keys')
"""Lists of names that a state may have."""
_NOWHERE: Final = Span(0, 0)
_LONG: Final = 1000  # characters before a state in its line: such a line is data, and has no comments of states
_COMMA: Final = re.compile(r'[ \t]*,')


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

    @property
    def name_span(self) -> Span:
        """Where the name is that it declares: its key, or itself in a list."""
        return self.key_span if self.key_span.end else self.span


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
    node: Any = None
    """The expression of transitions and the like in Python, which may be more than its items."""

    def find(self, key: str) -> Item | None:
        """Return the item with a key, or None."""
        return next((item for item in self.items if item.key == key), None)


@dataclass(slots=True)
class Condition:
    """A condition of a concurrency container: its outcome, and pairs of child and outcome."""

    item: Item
    outcome: Item
    pairs: Table


@dataclass(slots=True, eq=False)
class State:
    """A state or a container. Its parts that are entries of a mapping or a list are in ``tables``, by name."""

    label: str
    kind: str
    parent: State | None
    span: Span
    label_span: Span
    path: str = ''
    type: str = ''
    type_span: Span = _NOWHERE
    """Where its class or behavior is named."""
    children: list[State] = field(default_factory=list)
    rows: Table = field(default_factory=Table)
    """The items of the children; one for each that can be edited."""
    item: Item | None = None
    """Its own item in ``parent.rows``."""
    tables: dict[str, Table] = field(default_factory=dict)
    conditions: list[Condition] = field(default_factory=list)
    wrappers: list[dict[str, Any]] = field(default_factory=list)
    locked: str = ''
    level: str = ''
    """Autonomy of the states in a container that declare none, as it is written."""
    node: Any = None

    @property
    def outcomes(self) -> list[str] | None:
        """Names of the outcomes of a container; None if they are not written out."""
        table = self.tables.get('outcomes')
        return None if table is None or table.locked else [item.key for item in table.items]

    def find(self, table: str, key: str) -> Item | None:
        """Return the item of a table with a key; None if there is none."""
        return next((item for item in self.items(table) if item.key == key), None)

    def items(self, table: str) -> list[Item]:
        """Return the items of a table; none if there is no such table."""
        return self.tables[table].items if table in self.tables else []


class MachineDocument(Document):
    """A document of state machines. Its languages implement the methods that raise NotImplementedError."""

    reference: ClassVar[str]
    """What is written before the name of a parameter of the behavior where it is used."""

    def __init__(self, text: str, file: str = '') -> None:
        super().__init__(text, file)
        self.comments: dict[int, int] = {}
        """Begin and end of each comment."""
        self.fixed: list[tuple[Span, str]] = [(_NOWHERE, '')]
        """Parts that no gesture may change, in order and none in another one, with the reasons."""
        self.roots: list[tuple[str, State]] = []
        """The outermost containers, by the names of their machines."""
        self.behaviors: list[dict[str, Any]] = []
        self.unreadable = len(text) > MAX_CHARACTERS
        self.states: dict[str, State] = {}
        """All states by path, parents first."""
        if self.unreadable:
            self.problem(_NOWHERE, f'the text has {len(text)} characters; at most {MAX_CHARACTERS} are read')
            return
        self._read()
        for number, (name, root) in enumerate(self.roots):
            same = sum(1 for other, _ in self.roots[:number] if other == name)
            self._name_paths(root, '' if not number else f'{name} ({same + 1}):' if same else f'{name}:')

    # -- what the languages implement --------------------------------------------------------------------------------

    def _read(self) -> None:
        """Read the text: set the comments, roots, behaviors and problems."""
        raise NotImplementedError

    def value(self, item: Item) -> tuple[Any, bool]:
        """Return a value as JSON, and whether it is literal."""
        raise NotImplementedError

    def value_or_text(self, item: Item) -> Any:
        """Return a value as JSON; that of a reference or an expression as it is written."""
        value, is_literal = self.value(item)
        return value if is_literal else self.source(item.value_span)

    def name(self, name: str, like: str = '') -> str:
        """Return a name as it is written in the text, with the quotes of ``like``."""
        raise NotImplementedError

    def level(self, level: str, like: str) -> str:
        """Return a level of autonomy as it is written in the text."""
        raise NotImplementedError

    def add_table(self, state: State, table: str, entry: str) -> list[TextEdit]:
        """Return the edits that give a state a table with one entry."""
        raise NotImplementedError

    def remove_last(self, state: State, table: str) -> list[TextEdit]:
        """Return the edits that remove a table of which the last item goes."""
        raise NotImplementedError

    def removed(self, state: State) -> list[TextEdit]:
        """Return the edits that remove a state."""
        assert state.parent is not None and state.item is not None
        rows = state.parent.rows
        return self.remove_items(rows, [rows.items.index(state.item)])

    def parameter_uses(self, behavior: int = 0) -> Iterator[tuple[str, Span, bool]]:
        """Yield where parameters of a behavior are named, by its number in the file, and whether they are declared
        there."""
        return iter(())

    def parameter_edits(self, name: str, fields: dict[str, Any]) -> list[TextEdit]:
        """Return the edits that set fields of a parameter of the behavior, which may be a new one."""
        raise NotImplementedError

    def parameter_removal(self, name: str) -> list[TextEdit]:
        """Return the edits that remove a parameter of the behavior."""
        raise NotImplementedError

    def default_of(self, reference: str) -> Item | None:
        """Return the default of the parameter that a value such as ``$name`` refers to; None if it is no reference."""
        return None

    def other_names(self, state: State, new: str) -> list[TextEdit]:
        """Return the edits of a renaming that only this language needs."""
        return []

    # -- view --------------------------------------------------------------------------------------------------------

    def problem(self, span: Span, message: str) -> None:
        """Add a problem."""
        self.problems.append(Problem(span, message))

    def where(self, offset: int) -> str:
        """Return the place of an offset for a message."""
        return f'{self.file or self.language} line {self.lines.line(offset) + 1}'

    @functools.cached_property
    def _view(self) -> dict[str, Any]:
        return {
            'language': self.language,
            'behavior': self.behaviors[0] if self.behaviors else None,
            'behaviors': self.behaviors,
            'states': [self._state_view(state) for state in self.states.values()],
        }

    def comments_of(self, state: State) -> list[str]:
        """Return the texts of the comments that belong to a state."""
        if state.span.start - self.lines.start(state.span.start) > _LONG:
            return []
        behind = self._comment_on_line(state.label_span.end)
        spans = [*self._comments_above(state.span.start), *([behind] if behind else [])]
        return [self.source(span).lstrip('#').strip() for span in spans]

    def _state_view(self, state: State) -> dict[str, Any]:
        def rows(table: str, key: str, value: str) -> list[dict[str, Any]]:
            ways = ((one, one.value_span) for one in state.items(table))
            return [{key: one.key, value: one.value, 'span': one.span, f'{value}_span': span} for one, span in ways]

        def values(table: str) -> list[dict[str, Any]]:
            names, items = ('name', 'text', 'value', 'literal', 'span'), state.items(table)
            ways = ((one.key, self.source(one.value_span), *self.value(one), one.value_span) for one in items)
            return [dict(zip(names, one, strict=True)) for one in ways]

        parent = state.parent
        conditions = ((one, [[pair.key, pair.value] for pair in one.pairs.items]) for one in state.conditions)
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
            'conditions': [{'outcome': one.outcome.value, 'when': w, 'span': one.item.span} for one, w in conditions],
            'wrappers': state.wrappers,
            'default_autonomy': state.level,
            **{table: [one.key for one in state.items(table)] for table in _NAMES if table in state.tables},
            'comments': self.comments_of(state),
            'locked': state.locked,
        }

    def _name_paths(self, root: State, prefix: str) -> None:
        waiting = [root]
        while waiting:
            state = waiting.pop()
            above = state.parent
            path = state.path = f'{above.path.removesuffix("/")}/{state.label}' if above else f'{prefix}/'
            for count in itertools.count(2):
                if state.path not in self.states:
                    break
                state.path = f'{path} ({count})'
                state.locked = state.locked or f'another state has the label {short_repr(state.label)}'
            self.states[state.path] = state
            waiting += reversed(state.children)

    # -- gestures ----------------------------------------------------------------------------------------------------

    @gesture
    def set_target(self, state: str, outcome: str, target: str | None) -> list[TextEdit]:
        """Let an outcome lead to a state beside it or to an outcome of its container; None removes the transition."""
        one, parent = self._child(state)
        if target is not None:
            self._check_target(parent, target)
            own = one.outcomes or ()
            is_own = one.outcomes is None or outcome in own
            need(is_own, f'{state} has no outcome {short_repr(outcome)}', outcome, own)
        return self.put(one, 'transitions', outcome, target, self.name)

    @gesture
    def set_autonomy(self, state: str, outcome: str, level: str | None) -> list[TextEdit]:
        """Set the level of autonomy that an outcome requires: off, low, high or full; None removes it."""
        need(level is None or level in LEVELS, f'{short_repr(level)} is none of the levels {", ".join(LEVELS)}')
        return self.put(self._child(state)[0], 'autonomy', outcome, level, self.level)

    @gesture
    def set_remapping(self, state: str, key: str, name: str | None) -> list[TextEdit]:
        """Set the key of the container's userdata that a key of the state stands for; None removes it."""
        return self.put(self._child(state)[0], 'remapping', key, name, self.name)

    @gesture
    def rename_state(self, state: str, label: str) -> list[TextEdit]:
        """Rename a state, and all that names it in its container."""
        one, parent = self._child(state)
        if label == one.label:
            return []
        self._check_label(parent, label)
        self._refuse_hidden_names(one)
        self.refuse_computed(parent, one.label)
        spans = [one.label_span, *(item.value_span for _, item in self.transitions_to(parent, one.label))]
        pairs = (pair for condition in parent.conditions for pair in condition.pairs.items)
        spans += [pair.key_span for pair in pairs if pair.key == one.label]
        return [*(self.renamed(span, label) for span in spans), *self.other_names(one, label)]

    @gesture
    def rename_outcome(self, container: str, outcome: str, name: str) -> list[TextEdit]:
        """Rename an outcome of a container, and all that names it."""
        one, place, spans, pairs = self.uses_of_outcome(container, outcome)
        if name == outcome:
            return []
        self.check_outcome(one, name)
        tables = (item for table in ('transitions', 'autonomy') for item in one.items(table))
        spans += [item.key_span for item in tables if item.key == outcome]
        return [self.renamed(span, name) for span in [one.tables['outcomes'].items[place].span, *spans, *pairs]]

    def uses_of_outcome(self, container: str, outcome: str) -> tuple[State, int, list[Span], list[Span]]:
        """Return a container, the place of an outcome in its list, what leads to it, and what needs it."""
        one = self.container(container)
        known = one.outcomes or []
        need(outcome in known, f'{container} has no outcome {short_repr(outcome)}', outcome, known)
        for child, _ in self.transitions_to(one, outcome):
            locked = child.tables['transitions'].locked
            need(not locked, f'{child.path} leads to {outcome} and cannot be edited: {locked}')
        self.refuse_computed(one, outcome)
        spans = [item.value_span for _, item in self.transitions_to(one, outcome)]
        spans += [each.outcome.value_span for each in one.conditions if each.outcome.value == outcome]
        around = one.parent.conditions if one.parent else []
        pairs = [pair for condition in around for pair in condition.pairs.items if pair.key == one.label]
        return one, known.index(outcome), spans, [pair.value_span for pair in pairs if pair.value == outcome]

    def check_outcome(self, container: State, outcome: str) -> None:
        self.check_name(outcome, 'an outcome')
        taken = [*(container.outcomes or ()), *(child.label for child in container.children)]
        need(outcome not in taken, f'{container.path} has an outcome or a state {short_repr(outcome)} already')

    @gesture
    def remove_state(self, state: str, instead: str | None = None) -> list[TextEdit]:
        """Remove a state with its comments. Transitions that lead to it lead to ``instead``, if it is given."""
        one, parent = self._child(state)
        self._refuse_hidden_names(one)
        self.refuse_computed(parent, one.label, but=one)
        transitions = [pair for pair in self.transitions_to(parent, one.label) if pair[0] is not one]
        sources = ', '.join(f'{source.path} ({item.key})' for source, item in transitions)
        need(instead or not sources, f'transitions lead to {state}: {sources}; name a target that replaces it')
        if instead is not None:
            self._check_target(parent, instead)
            need(instead != one.label, f'{state} is removed, so {short_repr(instead)} cannot replace it')
        edits = [self.renamed(item.value_span, instead or '') for _, item in transitions]
        gone = []
        for number, condition in enumerate(parent.conditions):
            named = [index for index, pair in enumerate(condition.pairs.items) if pair.key == one.label]
            if named and len(named) == len(condition.pairs.items):
                gone.append(number)
            elif named:
                edits += self.remove_items(condition.pairs, named)
        edits += self.remove_items(parent.tables['conditions'], gone) if gone else []
        return [*edits, *self.removed(one)]

    @gesture
    def move_state(self, state: str, index: int) -> list[TextEdit]:
        """Move a state to another place among the states of its container, from 0."""
        return self._moved(*self._child(state), index)

    @gesture
    def set_initial(self, state: str) -> list[TextEdit]:
        """Let a state be the first one of its container, with which it begins."""
        one, parent = self._child(state)
        need(parent.kind != 'concurrency', f'{parent.path} is a concurrency container: all its states begin at once')
        return self._moved(one, parent, 0)

    @gesture
    def set_comment(self, state: str, text: str) -> list[TextEdit]:
        """Set the comment above a state, line by line; an empty text removes it."""
        one, _ = self._child(state)
        need(all(line.isprintable() for line in text.replace('\t', ' ').splitlines()), 'a comment needs printable text')
        indent = self._line_begin(one.span.start)
        need(not indent.strip(), f'{state} does not begin its line; write the comment in the text')
        start = self.lines.start(one.span.start)
        above = self._comments_above(one.span.start)
        begin = self.lines.start(above[0].start) if above else start
        lines = [f'{indent}# {line}'.rstrip() + self.line_break for line in text.splitlines()] if text.strip() else []
        return [TextEdit(begin, start - self._kept_above(one), ''.join(lines))]

    def _kept_above(self, state: State) -> int:
        """Return the number of characters directly above a state that are no comment of its author."""
        return 0

    def clip(self, state: str) -> str:
        """Return the text of a state with its comments, without indentation, for a clipboard. Raises GestureError."""
        one, parent = self._child(state)
        assert one.item is not None
        lines = self._own_lines(parent.rows, parent.rows.items.index(one.item))
        text = self.source(lines or one.item.span)
        return self.dedented(LINE_BREAK.sub('\n', text)).strip('\n')

    def dedented(self, text: str) -> str:
        """Return the lines of a state without its indentation; comments, too, that have less of it."""
        lines = text.split('\n')
        begin = next((one for one in lines if one.strip() and one.lstrip()[0] != '#'), '')
        margin = re.compile(f' {{0,{len(begin) - len(begin.lstrip(" "))}}}')
        return '\n'.join(margin.sub('', line, count=1) for line in lines)

    def neighbor(self, parent: State) -> State:
        """Return the last state of a container that can be edited. Raises GestureError if there is none."""
        for child in reversed(parent.children):
            if not child.locked:
                return child
        raise GestureError(f'{parent.path} has no state whose form a new one could have; write the first in the text')

    def free_label(self, parent: State, label: str) -> str:
        """Return a label that no state and no outcome of a container has: this one, or with a number."""
        taken = {*(child.label for child in parent.children), *(parent.outcomes or ())}
        numbered = (f'{label}{number}' for number in itertools.count(2))
        return next(one for one in itertools.chain([label], numbered) if one not in taken)

    # -- parameters of the behavior ----------------------------------------------------------------------------------

    @gesture
    def set_behavior_parameter(self, name: str, fields: dict[str, Any] | None) -> list[TextEdit]:
        """Set a parameter of the behavior, or add it: default, description, label, unit, limits, choices; None removes
        it. YAML takes all its fields, and values; Python those that change (None removes one), and expressions."""
        if fields is not None:
            self._check_parameter(name)
            return self.parameter_edits(name, fields)
        uses = self._uses_of_parameter(name)
        used = ', '.join(sorted({self.where(span.start) for span, is_own in uses if not is_own}))
        need(not used, f'{self.reference}{name} is used in {used}; replace it there before')
        return self.parameter_removal(name)

    @gesture
    def rename_behavior_parameter(self, name: str, new: str, behavior: int = 0) -> list[TextEdit]:
        """Rename a parameter of a behavior, by its number in the file, and all references to it."""
        uses = self._uses_of_parameter(name, behavior)
        self._check_parameter(new)
        taken = any(one == new for one, _, _ in self.parameter_uses(behavior))
        need(not taken, f'the behavior has a parameter {short_repr(new)} already')
        for span, _ in uses:  # Python before 3.12 errs about places in nested f-strings
            need(
                name in self.source(span),
                f'{self.where(span.start)}: the place of {name} in the text is not certain; edit the text',
            )
        return [self.renamed(span, new) for span, _ in uses]

    def _uses_of_parameter(self, name: str, behavior: int = 0) -> list[tuple[Span, bool]]:
        need(self.behaviors, 'the file has no behavior whose parameters can be read; edit the text')
        uses = [*self.parameter_uses(behavior)]
        known = {one for one, _, _ in uses}
        need(name in known, f'the behavior has no parameter {short_repr(name)}', name, known)
        return [(span, is_own) for one, span, is_own in uses if one == name]

    def _check_parameter(self, name: str) -> None:
        fits = name.isidentifier() and name[0] != '_' and not keyword.iskeyword(name)
        need(fits, f'{short_repr(name)} cannot be the name of a parameter; use letters, digits and _')

    # -- checks of gestures ------------------------------------------------------------------------------------------

    def gesture(self, name: str, arguments: dict[str, Any]) -> list[TextEdit]:
        if self.unreadable:
            raise GestureError(f'{self.where(self.problems[0].span.start)}: {self.problems[0].message}')
        return super().gesture(name, arguments)

    def checked(self, edits: Iterable[TextEdit]) -> list[TextEdit]:
        """Return the edits that change something, in the order of their places.

        Raises:
            GestureError: they change a fixed part, or the text could not be read after them.
        """
        made = [one for one in edits if self.text[one.start : one.end] != one.text]
        for start, end, _ in made:
            span, reason = self.fixed[bisect_right(self.fixed, end, key=lambda one: one[0].start + (start < end)) - 1]
            inside = span.start < start < span.end if start == end else span.start < end and start < span.end
            need(not inside, f'{self.where(span.start)}: {reason}')
        return super().checked(made)

    def state(self, path: str) -> State:
        """Return the state with a path that can be edited."""
        need(path in self.states, f'there is no state {short_repr(path)}', path, self.states)
        one = self.states[path]
        need(not one.locked, f'{path} cannot be edited: {one.locked}')
        return one

    def container(self, path: str) -> State:
        """Return the container with a path that can be edited."""
        one = self.state(path)
        need(one.kind in CONTAINERS, f'{path} is not a container, but a {one.kind}')
        return one

    def _child(self, path: str) -> tuple[State, State]:
        """Return a state that can be edited, and its container."""
        one = self.state(path)
        if one.parent is None:
            raise GestureError(f'{path} is the outermost container; this applies to the states in it')
        return one, one.parent

    def check_name(self, name: str, what: str = 'a name') -> None:
        """Raise unless a text can be a name."""
        fits = name and name.isprintable() and name == name.strip()
        need(fits, f'{short_repr(name)} cannot be {what}: it is empty, or has blanks around it or control characters')

    def _check_label(self, parent: State, label: str) -> None:
        self.check_name(label, 'a label')
        need('/' not in label, f"{short_repr(label)} cannot be a label: it contains '/'")
        taken = [*(child.label for child in parent.children), *(parent.outcomes or ())]
        need(label not in taken, f'{parent.path} has a state or an outcome {short_repr(label)} already')

    def targets(self, container: State) -> list[str]:
        """Return the names to which transitions of the states in a container can lead."""
        labels = [] if container.kind == 'concurrency' else [child.label for child in container.children]
        return [*labels, *(container.outcomes or ())]

    def _check_target(self, parent: State, target: str) -> None:
        self.check_name(target, 'a target')
        known = self.targets(parent)
        fits = target in known or parent.outcomes is None
        need(fits, f'a transition in {parent.path} does not lead to {short_repr(target)}', target, known)

    def transitions_to(self, parent: State, target: str) -> Iterator[tuple[State, Item]]:
        """Yield the transitions of the children that lead to a target, with their states."""
        for child in parent.children:
            yield from ((child, item) for item in child.items('transitions') if item.value == target)

    def _refuse_hidden_names(self, state: State) -> None:
        """Raise if a part of the container that cannot be edited names a state."""
        for child, _ in self.transitions_to(state.parent, state.label) if state.parent else ():
            locked = child.locked or child.tables['transitions'].locked
            need(child is state or not locked, f'{child.path} leads to {state.path} and cannot be edited: {locked}')

    def refuse_computed(self, container: State, target: str, but: State | None = None) -> None:
        """Raise if computed transitions of a child, ``but`` for one, seem to lead to a target."""

    # -- edits of tables ---------------------------------------------------------------------------------------------

    def put(
        self, state: State, table: str, key: str, value: str | None, written: Callable[[str, str], str]
    ) -> list[TextEdit]:
        """Set, add or (None) remove an entry of a table; ``written`` makes text of a value and one that it is like."""
        self.check_name(key)
        self.check_name('-' if value is None else value)
        found = state.tables.get(table)
        need(found is None or not found.locked, f'{table} of {state.path}: {found.locked if found else ""}')
        item = found.find(key) if found is not None else None
        if value is None:
            if found is None or item is None:
                near = did_you_mean(key, [one.key for one in state.items(table)])
                raise GestureError(f'{state.path} has no {table} of {short_repr(key)}{near}')
            is_last = len(found.items) == 1
            return self.remove_last(state, table) if is_last else self.remove_items(found, [found.items.index(item)])
        if item is not None:
            need(item.value is not None, f'{table} of {state.path}: {short_repr(key)} is computed; edit the text')
            like = self.source(item.value_span)
            return [TextEdit(*item.value_span, f'{"" if like else " "}{written(value, like)}')]
        near_by = found.items[-1] if found is not None and found.items else Item(_NOWHERE)
        entry = f'{self.name(key, self.source(near_by.key_span))}: {written(value, self.source(near_by.value_span))}'
        return self.add_table(state, table, entry) if found is None else self.insert_item(found, entry)

    def renamed(self, span: Span, name: str) -> TextEdit:
        """Return the edit that writes another name, with the same quotes."""
        return TextEdit(*span, self.name(name, self.source(span)))

    def insert_item(self, table: Table, new: str, index: int | None = None) -> list[TextEdit]:
        """Insert an item into a table, before the item ``index`` or at the end.

        Lines of ``new`` after its first one are indented already.
        """
        need(not table.locked, table.locked)
        items, last, inner = table.items, len(table.items), table.inner
        index = last if index is None else index
        if inner is None and not items:  # nothing is written yet
            return [TextEdit(*table.span, f' {{{new}}}' if not table.mark else f' [{new}]')]
        if inner is None:
            return self._insert_row(table, new, index)
        if not items:
            return [TextEdit(inner.start, inner.start if self.source(inner).strip() else inner.end, new)]
        if index < last:
            at = items[index].span.start
            begin = self._line_begin(at)
            return [TextEdit(at, at, f'{new},{" " if begin.strip() else self.line_break + begin}')]
        comma = self._comma_behind(table, last - 1)
        end = items[-1].span.end if comma is None else comma + 1
        comment = self._comment_on_line(end, inner.end)
        begin = self._line_begin(items[-1].span.start)
        if comment is None and begin.strip():
            return [TextEdit(end, end, f', {new}' if comma is None else f' {new},')]
        if begin.strip(' \t,'):  # in one line with other items, and a comment behind it
            begin = re.sub(r'[^\t]', ' ', self._line_begin(items[0].span.start))
        indent = self.line_break + begin.partition(',')[0]
        at = comment.end if comment else end
        if comma is not None:
            return [TextEdit(at, at, f'{indent}{new},')]
        comma_first = comment is not None or ',' in begin
        return [TextEdit(at, at, f'{indent}, {new}' if comma_first else f',{indent}{new}')]

    def remove_items(self, table: Table, indices: list[int]) -> list[TextEdit]:
        """Remove items of a table, with their comments."""
        need(not table.locked, table.locked)
        if table.inner is None:
            return [one for index in indices for one in self._remove_row(table, index)]
        if len(indices) == len(table.items):
            return [TextEdit(*table.inner, '')]
        left = max(set(range(len(table.items))) - set(indices))
        return [one for index in indices for one in self._remove_flow(table, index, left < index)]

    def _remove_flow(self, table: Table, index: int, is_last: bool) -> list[TextEdit]:
        items, span, inner = table.items, table.items[index].span, table.inner
        assert inner is not None
        comma = self._comma_behind(table, index)
        rows = self._own_lines(table, index)
        if rows is not None and inner.start <= rows.start and rows.end <= inner.end:
            before = self._comma_behind(table, index - 1) if index else None
            ends = is_last and index == len(items) - 1 and comma is None and before is not None and before < rows.start
            return [TextEdit(*rows, ''), *([TextEdit(before, before + 1, '')] if ends and before is not None else [])]
        if not is_last:
            return [TextEdit(span.start, items[index + 1].span.start, '')]
        start = items[index - 1].span.end
        comments = [one for one in self.comments if start <= one < span.start]
        if comments:  # it belongs to the item before; the line break behind it has to stay
            ended = self.comments[comments[-1]]
            comma_before = self.text.find(',', ended, span.start)
            start = comma_before if comma_before >= 0 else self.lines.end(ended)
        behind = self._comment_on_line(span.end, inner.end) if comma is None else None
        return [TextEdit(start, behind.end if behind is not None else span.end, '')]

    def _moved(self, state: State, parent: State, to: int) -> list[TextEdit]:
        """Return the edits that move a child; each child keeps its comments."""
        many = len(parent.children)
        need(0 <= to < many, f'{parent.path} has {many} states; {to} is none of their places')
        index = parent.children.index(state)
        low, high = sorted((to, index))
        moved = parent.children[low : high + 1]
        for child in moved:
            need(not child.locked and child.item is not None, f'{child.path} cannot be moved: {child.locked}')
        table = parent.rows
        first = next(n for n, item in enumerate(table.items) if item is moved[0].item)
        places = range(first, first + len(moved))
        slots = [self._own_lines(table, place) for place in places]
        commas = table.inner is None or all(self._comma_behind(table, place) is not None for place in places)
        need(table.inner is not None or all(slots), f'{state.path} shares a line with others; edit the text')
        taken = [slot for slot in slots if slot is not None]
        spans = [Span(slot.start, slot.start + len(self.source(slot).rstrip('\r\n'))) for slot in taken]
        if not commas or len(spans) < len(slots):
            spans = [table.items[place].span for place in places]
        elif any(self._code_between(before.end, after.start) for before, after in itertools.pairwise(spans)):
            raise GestureError(f'{state.path}: there are other statements in between; edit the text')
        texts = [self.source(span) for span in spans]
        texts.insert(to - low, texts.pop(index - low))
        return [TextEdit(*span, text) for span, text in zip(spans, texts, strict=True)]

    def _insert_row(self, table: Table, new: str, index: int) -> list[TextEdit]:
        last = len(table.items)
        spans = [self.row(table, one) for one in range(max(0, index - 2), index)]
        first = self._line_begin(table.items[min(index, last - 1)].span.start)
        indent = first[: len(first) - len(first.lstrip())] if table.mark else re.sub(r'\S', ' ', first)
        at = self.row(table, index).start if index < last else spans[-1].end
        gap = Span(spans[0].end, spans[1].start) if len(spans) == 2 else _NOWHERE
        blank = '' if self.source(gap).strip() else self.line_break * min(len(self.source(gap).splitlines()), 2)
        row, end = f'{indent}{table.mark}{new}', self.line_break
        if at == len(self.text) and not self.text.endswith(('\n', '\r')):
            return [TextEdit(at, at, f'{end}{blank}{row}')]
        return [TextEdit(at, at, f'{row}{end}{blank}' if index < last else f'{blank}{row}{end}')]

    def _remove_row(self, table: Table, index: int) -> list[TextEdit]:
        start, end = span = self.row(table, index)
        if index or len(table.items) == 1:
            while start > 0 and not self.text[self.lines.start(start - 1) : start].strip():
                start = self.lines.start(start - 1)
        else:
            while end < len(self.text) and not self.text[end : self.lines.end(end)].strip():
                end = self.lines.end(end)
        if span.end == len(self.text) and not self.text.endswith(('\n', '\r')) and start:
            start = len(self.text[:start].removesuffix('\n').removesuffix('\r'))
        return [TextEdit(start, end, '')]

    # -- lines and comments ------------------------------------------------------------------------------------------

    def _line_begin(self, offset: int) -> str:
        """Return what is before an offset in its line."""
        return self.text[self.lines.start(offset) : offset].lstrip('\ufeff')

    def _comment_on_line(self, offset: int, limit: int | None = None) -> Span | None:
        """Return the comment behind an offset in its line; None also if it ends behind ``limit``."""
        line_end = self.lines.end(offset)
        start = self.text.find('#', offset, line_end)
        while start >= 0 and start not in self.comments:
            start = self.text.find('#', start + 1, line_end)
        found = start >= 0 and (limit is None or self.comments[start] <= limit)
        return Span(start, self.comments[start]) if found else None

    def _comments_above(self, offset: int) -> list[Span]:
        """Return the comments in the lines directly above an item, which begin in its column."""
        begin = self._line_begin(offset)
        column = len(begin) - len(begin.lstrip())
        found: list[Span] = []
        for line in range(self.lines.line(offset) - 1, -1, -1):
            start = self.lines.starts[line] + column
            if start not in self.comments or self.text[self.lines.starts[line] : start].strip():
                break
            found.append(Span(start, self.comments[start]))
        return found[::-1]

    def row(self, table: Table, index: int) -> Span:
        """Return the lines of an item with its comments; raise if it shares a line with something else."""
        span = self._own_lines(table, index)
        if span is None:
            raise GestureError(f'{self.where(table.items[index].span.start)}: it shares a line; edit the text')
        return span

    def _own_lines(self, table: Table, index: int) -> Span | None:
        """Return the lines of an item with its comments; None if it shares a line with something else."""
        start, end = table.items[index].span
        begin = self._line_begin(start)
        if begin.strip(' \t-' if table.mark else ' \t,' if table.inner is not None else None):
            return None
        comma = self._comma_behind(table, index) if table.inner is not None else None
        end = end if comma is None else comma + 1
        comment = self._comment_on_line(end)
        if self.text[end : comment.start if comment else self.lines.end(end)].strip():
            return None
        above = self._comments_above(start)
        last = position = self.lines.end(end)
        while table.inner is None and position < len(self.text):  # comments that are indented more belong to the row
            line = self.text[position : self.lines.end(position)]
            column = len(line) - len(line.lstrip())
            deeper = position + column in self.comments and column > len(begin) - len(begin.lstrip())
            if line.strip() and not deeper:
                break
            position = self.lines.end(position)
            last = position if line.strip() else last
        return Span(self.lines.start(above[0].start if above else start), last)

    def _comma_behind(self, table: Table, index: int) -> int | None:
        """Return the place of the comma directly behind an item of a table in brackets."""
        found = _COMMA.match(self.text, table.items[index].span.end, table.inner.end if table.inner else 0)
        return found.end() - 1 if found else None

    def _code_between(self, start: int, end: int) -> bool:
        """Return whether there is something else than blanks and comments."""
        lines = (self.text[at : self.comments.get(at, at)] for at in range(start, end) if at in self.comments)
        return len(''.join(lines).strip().split()) < len(self.text[start:end].split())


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
