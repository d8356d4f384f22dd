# SPDX-License-Identifier: BSD-3-Clause
"""Text for messages, terminals and documents: bounded, escaped, with suggestions for misspelled names."""

from __future__ import annotations

import re
import reprlib
import unicodedata
from collections.abc import Collection, Iterable
from enum import Enum
from itertools import islice
from typing import Any, Final

MAX_REPR: Final = 80
"""Maximum length of a value in a message, characters."""
_GAP: Final = ' ... '


def truncate_middle(text: str, most: int = MAX_REPR) -> str:
    """Return ``text``, with its middle left out if it has more than ``most`` characters."""
    if len(text) <= most:
        return text
    end = most // 3
    return f'{text[: most - end - len(_GAP)]}{_GAP}{text[-end:]}'


def short_repr(value: object) -> str:
    """Return the ``repr`` of a value, at most :data:`MAX_REPR` characters. Never raises; fast for large values."""
    try:
        return truncate_middle(_Repr().repr(value))
    except Exception:  # an integer with too many digits, or foreign code
        return f'a {type(value).__name__} that cannot be shown'


class _Repr(reprlib.Repr):
    """A writer of one value that stops where :func:`short_repr` cuts it: each part has at least one character.

    It also writes ROS messages and subclasses of collections and texts part by part.
    """

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = self.maxstring = self.maxother = self.maxlong = MAX_REPR
        self.maxlist = self.maxtuple = self.maxdeque = self.maxarray = MAX_REPR // 3
        self.maxdict = self.maxset = self.maxfrozenset = MAX_REPR // 3
        self._left = MAX_REPR

    def repr1(self, x: Any, level: int) -> str:
        self._left -= 1
        return super().repr1(x, level) if self._left >= 0 else '...'

    # The methods of the base class sort the entries.
    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        return super().repr_dict(dict(islice(x.items(), self.maxdict + 1)), level)

    def repr_set(self, x: set[Any], level: int) -> str:
        return super().repr_set(set(islice(x, self.maxset + 1)), level)

    def repr_frozenset(self, x: frozenset[Any], level: int) -> str:
        return super().repr_frozenset(frozenset(islice(x, self.maxfrozenset + 1)), level)

    def repr_bytes(self, x: Any, level: int) -> str:
        return self.repr_str(x, level)

    repr_bytearray = repr_bytes

    def repr_instance(self, x: Any, level: int) -> str:
        kind = type(x)
        if hasattr(kind, 'get_fields_and_field_types') and not isinstance(x, type):
            fields = islice(kind.get_fields_and_field_types(), self.maxdict)
            parts = ', '.join(f'{name}={self.repr1(getattr(x, name), level - 1)}' for name in fields)
            return f'{kind.__module__.rpartition(".")[0]}.{kind.__name__}({parts})'
        base: Any = next((base for base in _PARTED if isinstance(x, base)), None)
        if base is None or isinstance(x, Enum):
            return truncate_middle(repr(x), self.maxother)
        parts = getattr(self, f'repr_{base.__name__}')(x, level)
        return str(parts) if kind.__repr__ is base.__repr__ else f'{kind.__name__}({parts})'


_PARTED: Final = (str, bytes, bytearray, list, tuple, dict, set, frozenset)


# Text from the network or a file, made harmless for a terminal.
#
# Untrusted text may contain escape sequences that move the cursor, recolour the screen, set the window title or answer
# for the user; direction marks that show a text in another order; and invisible characters. All of them are shown in
# an escaped form.

_NAMED: Final = {'\n': '\\n', '\r': '\\r', '\t': '\\t', '\x1b': '\\e'}
_HIDDEN: Final = frozenset({'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'})
_MARKS: Final = frozenset({'Mn', 'Me'})
_STACKED_MARKS: Final = 3
"""Maximum number of combining marks in a row, enough for written languages; more would cover neighbouring lines."""

MAX_LINE: Final = 20_000
"""Maximum number of shown characters of a text: a program that shows 10 MB again and again could do nothing else."""


def one_line(text: str, width: int | None = None) -> str:
    """Return ``text`` on one line, without anything that a terminal interprets, cut to ``width`` characters.

    Without a width, only the first :data:`MAX_LINE` characters are shown, with the number of the others.
    """
    begin = text[: MAX_LINE if width is None else max(0, width) + 1]  # escaping never shortens a text
    shown = begin if begin.isascii() and begin.isprintable() else _escaped(begin)
    if width is None:
        return shown if len(text) <= MAX_LINE else f'{shown}… ({len(text) - MAX_LINE} more characters)'
    if len(shown) > width:
        return shown[: max(0, width - 1)] + '…' if width > 0 else ''
    return shown


def escape_lines(text: str, limit: int = 50) -> list[str]:
    """Return ``text`` as harmless lines, at most ``limit`` of them; the last one reports what is left out."""
    parts = text.split('\n')
    shown = [one_line(part) for part in parts[:limit]]
    if len(parts) > limit:
        shown.append(f'… {len(parts) - limit} more lines')
    return shown


def _escaped(text: str) -> str:
    shown = []
    marks = 0
    for character in text:
        category = unicodedata.category(character)
        marks = marks + 1 if category in _MARKS else 0
        if character in _NAMED:
            shown.append(_NAMED[character])
        elif category in _HIDDEN or marks > _STACKED_MARKS or (category == 'Zs' and character != ' '):
            code = ord(character)
            shown.append(f'\\x{code:02x}' if code < 0x100 else f'\\u{{{code:x}}}')
        else:
            shown.append(character)
    return ''.join(shown)


# Suggestions for unknown names.

_LONGEST: Final = 100
_MOST: Final = 20


def similar_names(name: str, known: Iterable[str], most: int = 1, cutoff: float = 0.6) -> list[str]:
    """Return the known names that are similar to ``name``, best first. ``cutoff``: the least similarity, 0 to 1."""
    import difflib  # rarely needed

    # The comparison takes quadratic time, and hostile files may have long names.
    return difflib.get_close_matches(name, list(known), most, cutoff) if len(name) <= _LONGEST else []


def did_you_mean(name: object, known: Collection[str], otherwise: str | None = None) -> str:
    """Return a hint for an unknown name: a similar known one, else ``otherwise`` if set, else a list of the known
    names."""
    if near := similar_names(str(name), known):
        return f'; did you mean {near[0]!r}?'
    if otherwise is not None:
        return otherwise
    more = f', and {len(known) - _MOST} more' if len(known) > _MOST else ''
    return f' ({", ".join(sorted(known)[:_MOST])}{more})' if known else ''


# Counted nouns in messages.


def pluralize(count: int, noun: str, plural: str = '') -> str:
    """Return a counted noun: ``1 tree``, ``2 trees``, or with ``plural``: ``1 recovery``, ``2 recoveries``."""
    return f'{count} {noun if count == 1 else plural or f"{noun}s"}'


# Untrusted text, made valid for a field of a message.

_UNSENDABLE: Final = re.compile('[\0\ud800-\udc7f\udd00-\udfff]')
"""NUL, and surrogates that do not represent a byte."""


def sanitize_for_message(text: str, limit: int | None = None) -> str:
    """Return ``text`` as the middleware can send it: without NUL, at which the receiver would cut it off, and without
    lone surrogates, which the middleware cannot send.

    Python reads undecodable bytes of a terminal or a file name as surrogates; in an ASCII locale these are all other
    characters. They are decoded as UTF-8, and replaced if they are not UTF-8.

    A text of more than ``limit`` characters loses its middle, with a note of how many characters are left out.
    """
    if limit is not None and len(text) > limit:
        half = limit // 2
        text = f'{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}'
    if text.isascii() and '\0' not in text:
        return text
    return _UNSENDABLE.sub('\ufffd', text).encode('utf-8', 'surrogateescape').decode('utf-8', 'replace')


# Text in an XML document. Python's own functions import an HTTP client first, which adds 0.1 s to a start.

_TEXT: Final = str.maketrans({'&': '&amp;', '<': '&lt;', '>': '&gt;'})
_ATTRIBUTE: Final = {**_TEXT, **str.maketrans({'"': '&quot;', '\n': '&#10;', '\r': '&#13;', '\t': '&#9;'})}


def printable(text: str) -> str:
    """Return a text with a space in place of each character that is not printable; XML may not allow some of them."""
    return ''.join(character if character.isprintable() else ' ' for character in text)


def xml_text(text: str) -> str:
    """Return a text escaped for XML content."""
    return text.translate(_TEXT)


def xml_attribute(text: str) -> str:
    """Return a text as a quoted XML attribute value, with line breaks and tabs preserved."""
    return f'"{text.translate(_ATTRIBUTE)}"'
