# SPDX-License-Identifier: BSD-3-Clause
"""Configurations of running engines: saved, restored in place, and distinguished by their possible behavior.

A configuration holds the contents of all objects that are reachable from some roots. A walk over the objects collects
them, so it includes all memory of an engine, a node or a state. :class:`Layout` excludes the parts that never change
after a run is made (definitions, wiring, functions).

Two configurations have the same key if they differ only in parts that cannot affect later steps: the time that has
passed (only the distances of points in time from now count), messages for people, monotonic counters, the contents of
messages on a blackboard (only their presence counts).
"""

from __future__ import annotations

import marshal
import threading
import types
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field
from enum import Enum
from functools import cache, partial
from hashlib import blake2b
from operator import attrgetter, is_, length_hint
from typing import Any, Final

from .virtual_time import Instant, distance

_DIGEST: Final = 16
_PLAIN: Final = frozenset((type(None), bool, int, str, bytes, float))
_CONTAINERS: Final = frozenset((dict, list, deque, set))
_FIXED: Final = (
    type,
    types.FunctionType,
    types.BuiltinFunctionType,
    types.MethodType,
    types.ModuleType,
    types.MappingProxyType,
    type(threading.Lock()),
    type(threading.RLock()),
)
_ITERATORS: Final[tuple[type[Any], ...]] = (type(iter(())), type(iter([])))
_OURS: Final = 'flexbt_'
"""Prefix of the packages whose frozen objects hold nothing that an engine replaces to remember something."""
_ABSENT: Final = object()
"""Stands for the value of an unset slot."""


@dataclass(frozen=True)
class Layout:
    """Rules for walking objects by their classes; a rule also applies to derived classes.

    ``fixed``: objects that never change, or hold nothing relevant. ``constant``: attributes that never change.
    ``ignored``: attributes that are saved and restored, but excluded from the key. ``views``: functions that return a
    replacement for an attribute in the key. ``idle``: functions that return the dictionaries and lists to save of an
    inactive object, or None if it is active. The key excludes them, since the object sets them when it begins.
    """

    fixed: tuple[type[Any], ...] = ()
    constant: Mapping[type[Any], frozenset[str]] = field(default_factory=dict)
    ignored: Mapping[type[Any], frozenset[str]] = field(default_factory=dict)
    views: Mapping[type[Any], Mapping[str, Callable[[Any], Any]]] = field(default_factory=dict)
    idle: Mapping[type[Any], Callable[[Any], Iterable[Any] | None]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Configuration:
    """The contents of objects, from which they are restored. ``key`` (128 bit) distinguishes configurations."""

    parts: tuple[tuple[Any, Any, Any], ...]
    key: bytes

    def known_by(self, rest: Any) -> Configuration:
        """Return this configuration with a key made only from ``rest``, a value that :mod:`marshal` supports."""
        return Configuration(self.parts, _digest(rest))


def _digest(text: Any) -> bytes:
    return blake2b(marshal.dumps(text, 2), digest_size=_DIGEST).digest()


class _Kind:
    """The walk through objects of one class."""

    def __init__(self, layout: Layout, packages: frozenset[str], kind: type[Any]) -> None:
        self.name = kind.__qualname__
        parameters = getattr(kind, '__dataclass_params__', None)
        self.idle = next((idle for base, idle in layout.idle.items() if issubclass(kind, base)), None)
        self.is_fixed = (
            issubclass(kind, (*_FIXED, *layout.fixed))
            or (parameters is not None and parameters.frozen and _package(kind).startswith(_OURS))
            or _package(kind) not in packages
        )
        constant = _of_bases(kind, layout.constant)
        ignored = _of_bases(kind, layout.ignored)
        slots = [name for base in kind.__mro__ for name in _slots_of(base)]
        self.names = tuple(
            dict.fromkeys(name for name in slots if name not in constant and name not in ('__weakref__', '__dict__'))
        )
        self._get: Callable[[Any], tuple[Any, ...]] | None = attrgetter(*self.names) if len(self.names) > 1 else None
        self.constant = constant
        self.seen = frozenset(ignored | constant)
        views = {name: view for base in kind.__mro__ for name, view in layout.views.get(base, {}).items()}
        self.views = {
            name: view for name, view in views.items() if not name or name in self.names or kind.__dictoffset__
        }

    def values(self, one: Any) -> tuple[Any, ...]:
        """Return the values of the slots of an object."""
        if self._get is not None:
            try:
                return self._get(one)
            except AttributeError:  # a slot is not set yet
                pass
        return tuple(getattr(one, name, _ABSENT) for name in self.names)

    def restore(self, one: Any, held: tuple[Any, ...]) -> None:
        """Set the slots of an object to these values."""
        if all(map(is_, self.values(one), held)):
            return
        for name, value in zip(self.names, held, strict=True):
            if value is not _ABSENT:
                object.__setattr__(one, name, copy(value) if type(value) in _ITERATORS else value)
            elif hasattr(one, name):
                delattr(one, name)


def _package(kind: type[Any]) -> str:
    return kind.__module__.partition('.')[0]


def _of_bases(kind: type[Any], table: Mapping[type[Any], frozenset[str]]) -> frozenset[str]:
    return frozenset(name for base in kind.__mro__ for name in table.get(base, ()))


def _slots_of(kind: type[Any]) -> tuple[str, ...]:
    slots = vars(kind).get('__slots__', ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


_Part = tuple[Any, Any, Any]
_Fragments = list[dict[tuple[int, ...], tuple[_Part, bytes]]]
"""Fragments of each root, by the ids of its slot values: the data that restores it, and its text in the key. Only roots
whose data and text do not depend on the configuration have fragments."""
_MOST_FRAGMENTS: Final = 1000
"""Maximum number of fragments of a root."""
_QUIET: Final = b''
"""The text of an object that the key excludes."""


class StateSnapshotter:
    """A snapshotter that saves and restores the configurations of the objects that can be reached from ``roots``.

    Objects are inspected if their class is of the same package as a root, or as one of ``classes``. Objects that are
    only reached from ``unread`` roots are restored but, like these roots, have no part in the key.
    """

    def __init__(
        self,
        roots: Iterable[Any],
        clock: Any,
        layout: Layout,
        classes: Iterable[type[Any]] = (),
        unread: Iterable[Any] = (),
    ) -> None:
        self._roots = tuple({id(root): root for root in roots}.values())
        self._unread = frozenset(map(id, unread))
        self._clock = clock
        packages = frozenset(map(_package, (*map(type, self._roots), *classes)))
        self._kind_of: Callable[..., _Kind] = cache(partial(_Kind, layout, packages))
        self._root_numbers = {id(root): number for number, root in enumerate(self._roots)}
        self._fragments: _Fragments = [{} for _ in self._roots]

    def capture(self) -> Configuration:
        """Return the current contents of all reachable objects."""
        self._begin_walk()
        ahead, parts, text = self._ahead, self._parts, self._text
        for place, fragments in enumerate(self._fragments):
            one = ahead[place]
            if fragments:  # most objects have contents that were seen before
                known = fragments.get(tuple(map(id, self._kind_of(type(one)).values(one))))
                if known is not None:
                    parts.append(known[0])
                    text.append(known[1])
                    continue
            self._visit_any(one)
        place = len(self._roots)
        while place < len(ahead):
            self._visit_any(ahead[place])
            place += 1
        now = self._clock.now()
        for at, when in self._instants:
            self._text[at] = distance(when, now)
        return Configuration(tuple(self._parts), _digest(self._text))

    @staticmethod
    def restore(configuration: Configuration) -> None:
        """Restore the contents of every object. Objects that were made later become unreachable."""
        for one, how, held in configuration.parts:
            if how.__class__ is _Kind:
                how.restore(one, held)
            elif how is list:
                one[:] = held
            elif how is deque:
                one.clear()
                one.extend(held)
            else:
                one.clear()
                one.update(held)

    def _begin_walk(self) -> None:
        self._numbers = self._root_numbers.copy()
        self._ahead = list(self._roots)
        self._quiet = set(self._unread)  # and objects that only these reach
        self._instants: list[tuple[int, float]] = []
        self._text: list[Any] = []
        self._parts: list[_Part] = []

    def _reach(self, one: Any) -> int:
        number = self._numbers.get(id(one))
        if number is None:
            number = self._numbers[id(one)] = len(self._ahead)
            self._ahead.append(one)
        return number

    def _visit_any(self, one: Any) -> None:
        if id(one) in self._quiet:
            self._quietly(self._visit, one)
            self._text.append(_QUIET)
        else:
            self._visit(one)

    def _visit(self, one: Any) -> None:
        kind = type(one)
        text = self._text
        if kind is dict:
            self._parts.append((one, dict, dict(one)))
            text.append(len(one))
            items = one.items()
            if all(type(key) is str for key in one):
                items = sorted(items)
            for key, value in items:
                self._encode(key)
                self._encode(value)
        elif kind is list or kind is deque:
            self._parts.append((one, kind, list(one)))
            text.append(len(one))
            for value in one:
                self._encode(value)
        elif kind is set:
            self._parts.append((one, set, set(one)))
            text.append(sorted(map(str, one)))
        else:
            self._visit_instance(one, self._kind_of(kind))

    def _visit_instance(self, one: Any, kind: _Kind) -> None:
        kept = None if kind.idle is None else kind.idle(one)
        if kept is not None:
            self._parts += [(each, type(each), copy(each)) for each in kept]
            self._text.append('idle')
            return
        held = kind.values(one)
        if any(type(value) in _ITERATORS for value in held):
            held = tuple(copy(value) if type(value) in _ITERATORS else value for value in held)
        part = (one, kind, held)
        if held:
            self._parts.append(part)
        text, instants, reached = len(self._text), len(self._instants), len(self._ahead)
        self._text.append(kind.name)
        for name, value in zip(kind.names, held, strict=True):
            self._attribute(one, kind, name, value)
        attributes = getattr(one, '__dict__', None)
        if attributes is not None:
            self._parts.append((attributes, dict, dict(attributes)))
            for name, value in attributes.items():
                if name not in kind.constant:
                    self._attribute(one, kind, name, value)
            return
        # Cache the text of objects that only refer to roots and constants: it is the same in all configurations.
        number = self._numbers[id(one)]
        is_lasting = (
            number < len(self._roots)
            and not kind.views
            and len(self._instants) == instants
            and len(self._ahead) == reached
            and all(self._is_lasting(value) for value in held)
        )
        if is_lasting:
            fragment = _QUIET if id(one) in self._quiet else marshal.dumps(self._text[text:], 2)
            self._text[text:] = [fragment]
            fragments = self._fragments[number]
            if len(fragments) >= _MOST_FRAGMENTS:  # for example, of a counter
                fragments.clear()
            fragments[tuple(map(id, held))] = part, fragment

    def _is_lasting(self, value: Any) -> bool:
        """Return whether the encoding of a value is the same in all configurations."""
        if type(value) in _PLAIN or isinstance(value, Enum):
            return True
        number = self._numbers.get(id(value))
        return self._kind_of(type(value)).is_fixed if number is None else number < len(self._roots)

    def _attribute(self, one: Any, kind: _Kind, name: str, value: Any) -> None:
        view = kind.views.get(name)
        if view is not None:
            self._encode(view(one))
        elif name in kind.seen:
            if type(value) not in _PLAIN:
                self._quietly(self._encode, value)
        else:
            self._encode(value)

    def _quietly(self, walk: Callable[[Any], None], one: Any) -> None:
        """Walk over objects that are restored, but excluded from the key."""
        text, instants, reached = len(self._text), len(self._instants), len(self._ahead)
        walk(one)
        del self._text[text:]
        del self._instants[instants:]
        self._quiet.update(map(id, self._ahead[reached:]))

    def _encode(self, value: Any) -> None:
        kind = type(value)
        text = self._text
        if kind in _PLAIN:
            text.append(value)
        elif kind is Instant:
            self._instants.append((len(text), value))
            text.append(0)
        elif kind in _CONTAINERS:
            text.append(self._reach(value))
        elif isinstance(value, tuple):
            text.append(len(value))
            for inner in value:
                self._encode(inner)
        elif kind in _ITERATORS:
            text.append(length_hint(value))
        elif isinstance(value, Enum):
            text.append(value.name)
        elif value is _ABSENT:
            text.append('absent')
        elif isinstance(value, frozenset):
            text.append(sorted(map(str, value)))
        else:
            known = self._kind_of(kind)
            if known.views.get('') is not None:
                self._encode(known.views[''](value))
            elif known.is_fixed:
                text.append(known.name)
            else:
                text.append(self._reach(value))
