# SPDX-License-Identifier: BSD-3-Clause
"""A document: a text, the graph that it describes, and the gestures that edit it.

The text is the document, and the graph is a view of it. A gesture is an edit of the graph, such as moving a node. It is
carried out as the fewest edits of the text; everything else stays as it was written.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, Self, TypeVar

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_studio.errors import GestureError

from .text import Lines, Span, TextEdit, applied

Gesture = Callable[..., list[TextEdit]]
_Method = TypeVar('_Method', bound=Gesture)

_MARK: Final = '_is_gesture'
_MOST_SUGGESTED: Final = 1000  # names among which a similar one is looked for: it takes long


def gesture(method: _Method) -> _Method:
    """Mark a method of a :class:`Document` as a gesture.

    Its arguments are JSON values, with types as annotated. It returns the edits of the text, and raises GestureError if
    it does not apply.
    """
    setattr(method, _MARK, True)
    return method


def need(condition: object, message: str, name: str | None = None, known: Collection[str] = ()) -> None:
    """Raise GestureError unless the condition holds; the message suggests what is like ``name``."""
    if not condition:
        near = did_you_mean(name, known) if name is not None and len(known) < _MOST_SUGGESTED else ''
        raise GestureError(message + near)


@dataclass(frozen=True, slots=True)
class Problem:
    """A reason for which a text, or a part of it, cannot be read. The message says what to do."""

    span: Span
    message: str


class Document:
    """A text and what it describes. A document never changes: the next version is a new one."""

    language: ClassVar[str]
    """``xml``, ``yaml`` or ``python``."""

    def __init__(self, text: str, file: str = '') -> None:
        self.text = text
        self.file = file
        """Its name in messages."""
        self.problems: list[Problem] = []
        """What prevents the text from being read; the rest of it is read nevertheless."""
        self._after: Self | None = None

    def after(self, text: str) -> Self:
        """Return the document of the text after an edit. It is kept: what a gesture would make is read before it is."""
        if self._after is None or self._after.text != text:
            self._after = type(self)(text, self.file)
        return self._after

    @cached_property
    def lines(self) -> Lines:
        """The lines of the text."""
        return Lines(self.text)

    @cached_property
    def line_break(self) -> str:
        """The line break of the text; that of its first line if it has several."""
        return self.lines.line_break()

    def source(self, span: Span) -> str:
        """Return the text of a span."""
        return self.text[span.start : span.end]

    def renamed(self, span: Span, name: str) -> TextEdit:
        """Return the edit that writes another name, in the form of that which is there."""
        return TextEdit(*span, name)

    def view(self) -> dict[str, Any]:
        """Return the graph as JSON values, with the span of each part as ``[start, end]``. It is made once."""
        return self._view

    @cached_property
    def _view(self) -> dict[str, Any]:
        raise NotImplementedError

    def gestures(self) -> Iterator[str]:
        """Yield the names of the gestures that documents of this language have."""
        return (name for name, member in inspect.getmembers(type(self)) if hasattr(member, _MARK))

    def gesture(self, name: str, arguments: dict[str, Any]) -> list[TextEdit]:
        """Return the edits that carry out a gesture, in the order of their places.

        Raises:
            GestureError: there is no such gesture, its arguments are wrong, it does not apply, or the text could not be
                read after it.
        """
        known = list(self.gestures())
        need(name in known, f'{self.language} has no edit {short_repr(name)}', name, known)
        method: Gesture = getattr(self, name)
        try:
            bound = inspect.signature(method).bind(**arguments)
        except TypeError as error:
            raise GestureError(f'{name}: {error}; it takes {inspect.signature(method)}') from error
        for argument, value in bound.arguments.items():
            expected = inspect.signature(method).parameters[argument].annotation
            need(_fits(value, expected), f'{name}: [{argument}] must be {expected}, not {short_repr(value)}')
        return self.checked(method(**arguments))

    def checked(self, edits: Iterable[TextEdit]) -> list[TextEdit]:
        """Return the edits that change something, in the order of their places.

        Raises:
            GestureError: the text could not be read after them.
        """
        made = [one for one in edits if self.text[one.start : one.end] != one.text]
        made.sort(key=lambda one: (one.start, one.end))
        try:
            after = self.after(applied(self.text, made)).problems
        except ValueError as error:
            raise GestureError('two parts of this edit overlap; edit the text instead') from error
        reason = after[-1].message if after else ''
        need(len(after) <= len(self.problems), f'the text could not be read after this edit: {reason}; edit the text')
        return made


_TYPES: Final[dict[str, type]] = {
    'str': str,
    'int': int,
    'float': float,
    'bool': bool,
    'list': list,
    'dict': dict,
    'None': type(None),
}


def _fits(value: Any, annotation: str) -> bool:
    """Return whether a JSON value is of the annotated type, such as ``str | None`` or ``list[str]``."""
    for one in annotation.split('|'):
        kind = _TYPES.get(one.strip().partition('[')[0])
        if kind is None or type(value) is kind or (kind is float and type(value) is int):
            return True
    return False
