# SPDX-License-Identifier: BSD-3-Clause
"""A document: a text, the graph that it describes, and the gestures that edit it.

The text is the document, and the graph is a view of it. A gesture is an edit of the graph, such as moving a node. It is
carried out as the fewest edits of the text; everything else stays as it was written.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final, TypeVar

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_studio.errors import GestureError

from .text import Span, TextEdit

Gesture = Callable[..., list[TextEdit]]
_Method = TypeVar('_Method', bound=Gesture)

_MARK: Final = '_is_gesture'


def gesture(method: _Method) -> _Method:
    """Mark a method of a :class:`Document` as a gesture.

    Its arguments are JSON values, with types as annotated. It returns the edits of the text, and raises GestureError if
    it does not apply.
    """
    setattr(method, _MARK, True)
    return method


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

    @property
    def problems(self) -> list[Problem]:
        """What prevents the text from being read; the rest of it is read nevertheless."""
        raise NotImplementedError

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
        """Return the edits that carry out a gesture.

        Raises:
            GestureError: there is no such gesture, its arguments are wrong, or it does not apply.
        """
        known = list(self.gestures())
        if name not in known:
            raise GestureError(f'{self.language} has no edit {short_repr(name)}{did_you_mean(name, known)}')
        method: Gesture = getattr(self, name)
        try:
            bound = inspect.signature(method).bind(**arguments)
        except TypeError as error:
            raise GestureError(f'{name}: {error}; it takes {inspect.signature(method)}') from error
        for argument, value in bound.arguments.items():
            expected = inspect.signature(method).parameters[argument].annotation
            if not _fits(value, expected):
                raise GestureError(f'{name}: [{argument}] must be {expected}, not {short_repr(value)}')
        return method(**arguments)


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
