# SPDX-License-Identifier: BSD-3-Clause
"""Two versions of a file as graphs: which parts are the same, and what was added, removed, changed or moved.

Equal sub-trees are paired first, as in Falleri et al., Fine-grained and Accurate Source Code Differencing (GumTree),
2014; then parts whose children are paired with one another; then what is alike in rows of children.
"""

from __future__ import annotations

import json
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any, Final

_MOST_IN_ROW: Final = 400
"""Children of one part that are compared in their order; more are paired by what they are."""
_MOST_ABOVE: Final = 8
"""Ancestors of a part that may be the counterpart of its former parent."""
_LEAST, _LEAST_OF_TYPE = 0.5, 0.1
"""Least share of two parts that is common below them for which they are paired; and if they have one type."""
_NOT_CONTENT: Final = frozenset(
    {'path', 'parent', 'tree', 'tag', 'type', 'name', 'id', 'kind', 'label', 'attributes', 'transitions', 'collapsed'}
    | {'trees', 'nodes', 'states', 'language', 'open', 'note', 'locked', 'fault'}
)
_DERIVED: Final = ('span', 'value', 'literal')
_LABELS: Final = ('outcome', 'key', 'id', 'name', 'path')


@dataclass(slots=True, eq=False)
class Part:
    """A tree, node or state of one version; the first part is the file itself. ``twin`` is it in the other version."""

    path: str
    type: str = ''
    name: str = ''
    content: dict[str, str] = field(default_factory=dict)
    data: Mapping[str, Any] = field(default_factory=dict)
    parent: Part | None = None
    children: list[Part] = field(default_factory=list)
    twin: Part | None = None
    depth: int = 0
    size: int = 1
    whole: int = -1

    @property
    def title(self) -> str:
        """Its name, or its type."""
        return self.name or self.type

    @property
    def own(self) -> tuple[Hashable, ...]:
        """What it is without the parts below it. Where the transitions of a state lead says nothing about it."""
        return (self.type, self.name, *sorted(self.content.items()))

    def all(self) -> Iterator[Part]:
        """Yield it and the parts below it, parents first, in order."""
        pending = [self]
        while pending:
            part = pending.pop()
            yield part
            pending += reversed(part.children)


def parts(view: Mapping[str, Any]) -> list[Part]:
    """Return the parts of a view, parents first."""
    file = Part('', 'file', content=dict(_content(view)))
    found: dict[str | None, Part] = {None: file}
    for data in (*view.get('trees', ()), *view.get('nodes', ()), *view.get('states', ())):
        above = data.get('parent') or data.get('tree')
        kind = (data['type'] or data.get('kind', '')) if 'type' in data else 'tree'
        kind = f'{data["tag"]} {data["type"]}' if data.get('tag', '').startswith('SubTree') else kind
        name = next(data[key] for key in ('label', 'name', 'id') if key in data)
        part = Part(data['path'], kind, name, dict(_content(data)), data, found[above])
        assert part.parent is not None
        part.depth = part.parent.depth + 1
        part.parent.children.append(part)
        found[data['path']] = part
    return list(file.all())


def _content(data: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield what a part says besides type and name, by names."""
    for one in data.get('attributes', ()):
        if one['name'] not in ('name', 'ID'):
            yield one['name'], one['value']
    counts: Counter[str] = Counter()
    for key, value in _plain({name: one for name, one in data.items() if name not in _NOT_CONTENT}).items():
        if not value:
            continue
        if key == 'comments':
            yield 'note', '\n'.join(value)
        elif isinstance(value, list) and all(isinstance(one, dict) for one in value):
            for number, one in enumerate(value, 1):
                label = f'{key} {one.pop(next((name for name in _LABELS if name in one), ""), number)}'
                counts[label] += 1  # several conditions may have one outcome
                label += f' ({counts[label]})' if counts[label] > 1 else ''
                yield label, _text(next(iter(one.values())) if len(one) == 1 else one)
        else:
            yield key, _text(value)


def _plain(value: Any) -> Any:
    """Return a value of a view without places, and without what is derived from the text of it."""
    if isinstance(value, dict):
        kept = {key: one for key, one in value.items() if key not in _DERIVED and not key.endswith('_span')}
        return {key: _plain(one) for key, one in kept.items()}
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def match(before: Sequence[Part], after: Sequence[Part]) -> None:
    """Pair the parts of two versions: ``twin`` of each that is in both."""
    known: dict[Hashable, int] = {}
    for part in (*reversed(before), *reversed(after)):
        part.size = 1 + sum(one.size for one in part.children)
        part.whole = known.setdefault((*part.own, *(one.whole for one in part.children)), len(known))
    _pair(before[0], after[0])
    _pair_alike(before, after, lambda one: one.whole, only=True)
    _pair_rows(before)
    _pair_by_children(before)
    _pair_rows(before)
    _pair_alike(before, after, lambda one: one.whole)
    _pair_by_children(before)
    _pair_alike(before, after, lambda one: (one.type, one.name) if one.name else None, only=True)
    _pair_alike(before, after, lambda one: one.whole)
    _pair_rows(before, weakly=True)


def _pair(old: Part, new: Part) -> None:
    """Pair two parts; if they are equal, with all that is below them."""
    both = zip(old.all(), new.all(), strict=True) if old.whole == new.whole else [(old, new)]
    for one, other in both:
        if one.twin is None and other.twin is None:
            one.twin, other.twin = other, one


def _pair_alike(
    before: Iterable[Part],
    after: Iterable[Part],
    key: Callable[[Part], Hashable],
    *,
    only: bool = False,
    below: bool = False,
) -> None:
    """Pair the parts with equal keys in their order; with ``only`` those whose key no other part has, ``below`` if they
    have something in common below them, and not two names."""
    rows: dict[Hashable, tuple[list[Part], list[Part]]] = defaultdict(lambda: ([], []))
    for side, version in enumerate((before, after)):
        for part in version:
            if part.twin is None and (found := key(part)) is not None:
                rows[found][side].append(part)
    for olds, news in rows.values():
        if not only or len(olds) == len(news) == 1:
            for old, new in zip(olds, news, strict=False):
                are_free = old.twin is None and new.twin is None
                has_one_name = not (old.name and new.name) or old.name == new.name
                if are_free and (not below or (has_one_name and _likeness(old, new))):
                    _pair(old, new)


def _pair_by_children(before: Sequence[Part]) -> None:
    """Pair parts that have much in common below them, those first of which that is most, and whose types are equal."""
    votes: dict[Part, Counter[Part]] = {}
    for old in reversed(before):
        if old.twin is not None or not old.children:
            continue
        counts = votes[old] = Counter()
        for child in old.children:
            counts.update(dict(votes[child].most_common(_MOST_ABOVE)) if child in votes else {})
            above = None if child.twin is None else child.twin.parent
            for _ in range(_MOST_ABOVE):
                if above is None or above.twin is not None:
                    break
                counts[above] += child.size
                above = above.parent
    ranked = []
    for number, old in enumerate(reversed(votes)):  # outer parts come first
        for new, count in votes[old].items():
            share = 2 * count / (old.size + new.size - 2)
            is_same = old.type == new.type
            named = 1 if not (old.name and new.name) else 2 if old.name == new.name else 0.5
            may_differ = named >= 1 and 'tree' not in (old.type, new.type)
            if share > (_LEAST_OF_TYPE if is_same else _LEAST) and (is_same or may_differ):
                kept = count / (old.size - 1) * (1 + is_same) * named
                ranked.append((kept, -abs(old.depth - new.depth), share, -number, old, new))
    for *_, old, new in sorted(ranked, key=lambda one: one[:4], reverse=True):
        is_in_place = old.parent is not None and old.parent.twin is new.parent
        if old.twin is None and new.twin is None and (is_in_place or old.type == new.type):
            _pair(old, new)


def _pair_rows(before: Iterable[Part], *, weakly: bool = False) -> None:
    """Pair children of paired parts that are equal or have one type and name; ``weakly``, also what is alike."""
    for old in before:
        if old.twin is None:
            continue
        olds, news = old.children, old.twin.children
        _pair_row(olds, news, lambda one: one.whole)
        _pair_row(olds, news, lambda one: (one.type, one.name) if one.name else None)
        _pair_alike(olds, news, lambda one: one.type if one.children else None, only=True, below=True)
        if weakly:
            _pair_likest(olds, news)
            _pair_gaps(olds, news)


def _pair_row(olds: Sequence[Part], news: Sequence[Part], key: Callable[[Part], Hashable]) -> None:
    one, other = ([part for part in row if part.twin is None and key(part) is not None] for row in (olds, news))
    if one and other and max(len(one), len(other)) <= _MOST_IN_ROW:
        matcher = SequenceMatcher(None, [*map(key, one)], [*map(key, other)], autojunk=False)
        for at, to, length in matcher.get_matching_blocks():
            for step in range(length):
                _pair(one[at + step], other[to + step])
    _pair_alike(olds, news, key)


def _pair_likest(olds: Sequence[Part], news: Sequence[Part]) -> None:
    """Pair the parts of one type in two rows, those with the most in common first."""
    types: dict[str, tuple[list[Part], list[Part]]] = defaultdict(lambda: ([], []))
    for side, row in enumerate((olds, news)):
        for part in row:
            if part.twin is None:
                types[part.type][side].append(part)
    for one, other in types.values():
        if len(one) * len(other) <= _MOST_IN_ROW:
            ranked = [(-_likeness(a, b), abs(i - j), i, j) for i, a in enumerate(one) for j, b in enumerate(other)]
            for _, _, i, j in sorted(ranked):
                if one[i].twin is None and other[j].twin is None:
                    _pair(one[i], other[j])
        rest = ([part for part in row if part.twin is None] for row in (one, other))
        for old, new in zip(*rest, strict=False):
            _pair(old, new)


def _likeness(one: Part, other: Part) -> int:
    own, others = (Counter((part.type, part.name) for part in row.children) for row in (one, other))
    return len(one.content.items() & other.content.items()) + (own & others).total()


def _pair_gaps(olds: Sequence[Part], news: Sequence[Part]) -> None:
    """Pair parts of different types that are between the same neighbours: the type was changed."""
    places = {part: index for index, part in enumerate(news)}
    at = 0
    for index, old in enumerate(olds):
        if old.twin is not None:
            at = places.get(old.twin, at - 1) + 1
        elif at < len(news) and news[at].twin is None:
            new, behind = news[at], (*olds[index + 1 : index + 2], *news[at + 1 : at + 2])
            is_alike = bool(old.children) == bool(new.children) and 'tree' not in (old.type, new.type)
            if is_alike and old.name == new.name and (old.name or all(one.twin is not None for one in behind)):
                _pair(old, new)
                at += 1


# What has changed.


def moved(after: Iterable[Part]) -> set[Part]:
    """Return the parts of the later version that are below another part than before, or elsewhere among its others.

    What was put around a part, or taken away from around it, does not move it.
    """
    found: set[Part] = set()
    rows: dict[Part, list[Part]] = defaultdict(list)
    for new in after:
        if new.twin is not None and new.parent is not None:
            above = _paired_above(new)
            if _paired_above(new.twin).twin is above:
                rows[above].append(new)
            else:
                found.add(new)
    for above, row in rows.items():
        assert above.twin is not None
        order = {part: number for number, part in enumerate(above.twin.all())} if len(row) > 1 else {}
        places = [order.get(part.twin, 0) for part in row if part.twin is not None]
        found.update(row[index] for index in set(range(len(row))) - _rising(places))
    return found


def _paired_above(part: Part) -> Part:
    above = part.parent
    while above is not None and above.twin is None:
        above = above.parent
    assert above is not None
    return above


def _rising(numbers: Sequence[int]) -> set[int]:
    """Return the indices of a longest rising selection of different numbers."""
    ends: list[int] = []
    at: list[int] = []
    before: list[int] = []
    for index, number in enumerate(numbers):
        place = bisect_left(ends, number)
        if place == len(ends):
            ends.append(number)
            at.append(index)
        ends[place], at[place] = number, index
        before.append(at[place - 1] if place else -1)
    chosen: set[int] = set()
    index = at[-1] if at else -1
    while index >= 0:
        chosen.add(index)
        index = before[index]
    return chosen


def compared(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return what has changed between two views.

    ``view`` is the later one, with what was removed where it was, under paths that begin with ``-``. ``marks`` has the
    kinds of change (added, removed, changed, moved) by path, also of transitions (``STATE#OUTCOME``). ``changes`` lists
    them: ``path``, ``kinds``, ``title``, ``lines`` that say more, and the spans ``before`` and ``after``; of a removed
    or added sub-tree only its first part. What belongs to no part of the graph has the path ``''``.
    """
    old_parts, new_parts = parts(before), parts(after)
    match(old_parts, new_parts)
    moves = moved(new_parts)
    union = _Union(old_parts, new_parts, moves)
    for part in union.parts:
        twin = part.twin
        if part in union.ghosts or twin is None:
            is_first = part.parent is not None and part.parent.twin is not None
            inside = sum(one.twin is None for one in part.all()) - 1 if is_first else 0
            lines = [f'with {inside} inside'] if inside else []
            union.note(part, ['removed' if part in union.ghosts else 'added'], lines, is_listed=is_first)
            continue
        kinds, lines = [], []
        if part in moves and part.parent is not None and twin.parent is not None:
            kinds.append('moved')
            is_within = _paired_above(part).twin is _paired_above(twin)
            lines.append('within ' * is_within + f'from {twin.parent.title} to ' * (not is_within) + part.parent.title)
        told = [*_changed(twin, part)]
        union.note(part, [*kinds, *(['changed'] if told else [])], lines + told)
        union.note_transitions(part, twin)
    return {'view': union.view(after), 'marks': union.marks, 'changes': union.changes}


def _changed(old: Part, new: Part) -> Iterator[str]:
    for key, was, now in (('type', old.type, new.type), ('name', old.name, new.name)):
        if was != now:
            yield f'{key}: {was or "none"} → {now or "none"}'
    for key in dict.fromkeys((*old.content, *new.content)):
        if old.content.get(key) != new.content.get(key):
            yield f'{key}: {old.content.get(key, "none")} → {new.content.get(key, "none")}'


class _Union:
    """The parts of the later version, with those that were removed at their places, and the changes."""

    def __init__(self, before: Sequence[Part], after: Sequence[Part], moves: set[Part]) -> None:
        self.ghosts = {part for part in before if part.twin is None}
        self.marks: dict[str, list[str]] = {}
        self.changes: list[dict[str, Any]] = []
        self._hosts: dict[Part, Part] = {}
        behind: dict[tuple[Part, Part | None], list[Part]] = defaultdict(list)
        for parent in before:
            host, last = parent.twin or parent, None
            for part in parent.children:
                if part.twin is None:
                    self._hosts[part] = host
                    behind[host, last].append(part)
                elif part.twin.parent is host and part.twin not in moves:
                    last = part.twin
        self.parts: list[Part] = []
        pending = [after[0]]
        while pending:
            part = pending.pop()
            self.parts.append(part)
            below = () if part in self.ghosts else part.children
            row = [*behind[part, None], *(one for child in below for one in (child, *behind[part, child]))]
            pending += reversed(row)
        self._shown = {part: dict(part.data) for part in self.parts}
        for part in self.ghosts:
            self._shown[part] |= self._ghost(part)

    def path(self, part: Part) -> str:
        """Return the path of a part in the union."""
        return f'-{part.path}' if part in self.ghosts else part.path

    def _ghost(self, part: Part) -> dict[str, Any]:
        """Return what a removed part has otherwise in the union: its path and those around it, where it leads."""
        host, data = self._hosts[part], part.data
        changed: dict[str, Any] = {'path': self.path(part)}
        if 'label' in data:
            ways = self._led(part, data['transitions'])
            changed |= {'parent': self.path(host), 'initial': False, 'transitions': ways}
        elif 'tree' in data:
            above = host
            while above.parent is not None and above.parent.path:
                above = self._hosts.get(above, above.parent) if above in self.ghosts else above.parent
            changed |= {'tree': self.path(above), 'parent': self.path(host) if 'tree' in host.data else None}
        return changed

    def _led(self, part: Part, ways: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """Return transitions of a part of the earlier version, with the present labels of their targets."""
        siblings = () if part.parent is None else part.parent.children
        labels = {one.name: one.twin.name for one in reversed(siblings) if one.twin is not None}
        return [{**way, 'target': labels.get(way['target'], way['target'])} for way in ways]

    def note(self, part: Part, kinds: list[str], lines: list[str], *, is_listed: bool = True) -> None:
        """Note changes of a part."""
        span = part.data.get('span')
        twin = None if part.twin is None else part.twin.data.get('span')
        if kinds:
            self.marks[self.path(part)] = kinds
            before, after = (span, None) if part in self.ghosts else (twin, span)
            if is_listed:
                self._list(self.path(part), kinds, part.title, lines, before, after)

    def _list(self, path: str, kinds: list[str], title: str, lines: list[str], before: Any, after: Any) -> None:
        entry = {'path': path, 'kinds': kinds, 'title': title, 'lines': lines, 'before': before, 'after': after}
        self.changes.append(entry)

    def note_transitions(self, new: Part, old: Part) -> None:
        """Note what has changed of the transitions of a state, and add those that it has no longer."""
        now = {way['outcome']: way for way in new.data.get('transitions', ())}
        was = {way['outcome']: way for way in self._led(old, old.data.get('transitions', ()))}
        for outcome in dict.fromkeys((*was, *now)):
            one, other = was.get(outcome), now.get(outcome)
            if one is not None and other is not None and one['target'] == other['target']:
                continue
            kind = 'added' if one is None else 'removed' if other is None else 'changed'
            targets = [way['target'] or 'none' for way in (one, other) if way is not None]
            path = f'{new.path}#{outcome}'
            self.marks[path] = [kind]
            title = f'{new.title}: {outcome}'
            spans = [way and way['span'] for way in (one, other)]
            self._list(path, [kind], title, [f'target: {" → ".join(targets)}'], *spans)
        gone = [way for outcome, way in was.items() if outcome not in now]
        if gone:
            self._shown[new]['transitions'] = [*new.data['transitions'], *gone]
        if 'outcomes' in new.data:
            outcomes = dict.fromkeys((*new.data['outcomes'], *old.data['outcomes']))
            self._shown[new]['outcomes'] = [*outcomes]

    def view(self, after: Mapping[str, Any]) -> dict[str, Any]:
        """Return the later view with the removed parts. Paths of states end with their labels, which differ."""
        shown = [self._shown[part] for part in self.parts[1:]]
        states = [one for one in shown if 'label' in one]
        labels: set[tuple[Any, str]] = {(one['parent'], one['label']) for one in states if one['path'][:1] != '-'}
        for one in states:
            while one['path'].startswith('-') and (one['parent'], one['label']) in labels:
                one['label'] += ' (removed)'
            labels.add((one['parent'], one['label']))
        trees = [one for one in shown if 'label' not in one and 'tree' not in one]
        rows = {'trees': trees, 'nodes': [one for one in shown if 'tree' in one], 'states': states}
        return {**after, **{key: row for key, row in rows.items() if key in after}}
