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
"""Characters of a value in a message."""
_GAP: Final = ' ... '


def truncate_middle(text: str, most: int = MAX_REPR) -> str:
    """``text``, of which the middle is left out where it has more than ``most`` characters."""
    if len(text) <= most:
        return text
    end = most // 3
    return f'{text[: most - end - len(_GAP)]}{_GAP}{text[-end:]}'


def short_repr(value: object) -> str:
    """``value`` as Python writes it, in :data:`MOST` characters at most. Never raises; a large one takes no time."""
    try:
        return truncate_middle(_Repr().repr(value))
    except Exception:  # an integer of too many digits, code of others
        return f'a {type(value).__name__} that cannot be shown'


class _Repr(reprlib.Repr):
    """A writer of one value, up to the length from which :func:`shown` cuts it: each part has at least one character.

    Messages of ROS and what is derived from a collection or a text are written part by part, too.
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

    # They sort what they are given.
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


# Text from the network or from a file, made harmless for a terminal.
#
# What others have written may contain escape sequences that move the cursor, recolour the screen, set the window title
# or answer for the user; direction marks that show a text in another order; invisible characters. All of them are
# shown as what they are.

_NAMED: Final = {'\n': '\\n', '\r': '\\r', '\t': '\\t', '\x1b': '\\e'}
_HIDDEN: Final = frozenset({'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'})
_MARKS: Final = frozenset({'Mn', 'Me'})
_STACKED_MARKS: Final = 3
"""Marks in a row that a written language may need; more of them are stacked over the lines around."""

MAX_LINE: Final = 20_000
"""Maximum number of shown characters of a text: a program that keeps showing 10 MB of text does nothing else."""


def one_line(text: str, width: int | None = None) -> str:
    """``text`` on one line without anything that a terminal interprets, cut to ``width`` characters.

    Without a width, what is behind the first :data:`MAX_LINE` characters is counted.
    """
    begin = text[: MAX_LINE if width is None else max(0, width) + 1]  # escaping makes nothing shorter
    shown = begin if begin.isascii() and begin.isprintable() else _escaped(begin)
    if width is None:
        return shown if len(text) <= MAX_LINE else f'{shown}… ({len(text) - MAX_LINE} more characters)'
    if len(shown) > width:
        return shown[: max(0, width - 1)] + '…' if width > 0 else ''
    return shown


def escape_lines(text: str, limit: int = 50) -> list[str]:
    """``text`` as harmless lines, at most ``limit`` of them; what is left out is said in the last."""
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


# Names that are not known, and what may have been meant.

_LONGEST: Final = 100
_MOST: Final = 20


def similar_names(name: str, known: Iterable[str], most: int = 1) -> list[str]:
    """Return the known names that ``name`` may be a slip of, best first."""
    import difflib  # rarely needed

    # The comparison takes quadratic time, and hostile files have long names.
    return difflib.get_close_matches(name, list(known), n=most) if len(name) <= _LONGEST else []


def did_you_mean(name: object, known: Collection[str], otherwise: str | None = None) -> str:
    """Return what may have been meant by a name that is not known; where nothing is near, ``otherwise``, or what there
    is."""
    if near := similar_names(str(name), known):
        return f'; did you mean {near[0]!r}?'
    if otherwise is not None:
        return otherwise
    more = f', and {len(known) - _MOST} more' if len(known) > _MOST else ''
    return f' ({", ".join(sorted(known)[:_MOST])}{more})' if known else ''


# Numbers of things in messages to people.


def pluralize(count: int, noun: str, plural: str = '') -> str:
    """``1 tree``, ``2 trees``; ``1 recovery``, ``2 recoveries`` where the plural is given."""
    return f'{count} {noun if count == 1 else plural or f"{noun}s"}'


# Text of unknown origin, made fit for a field of a message.

_UNSENDABLE: Final = re.compile('[\0\ud800-\udc7f\udd00-\udfff]')
"""NUL, and surrogates that stand for no byte."""


def sanitize_for_message(text: str, limit: int | None = None) -> str:
    """``text`` as the middleware can send it: without NUL, which would cut it off on the other side, and without lone
    surrogates, with which no message can be sent at all.

    Python makes surrogates of the bytes of a terminal or a file name that its encoding lacks: of all but ASCII, where
    the locale has nothing else. They are taken for UTF-8, and replaced where they are none.

    Of a text of more than ``limit`` characters the middle is left out, and it is said how much that is.
    """
    if limit is not None and len(text) > limit:
        half = limit // 2
        text = f'{text[:half]} ... ({len(text) - 2 * half} characters left out) ... {text[-half:]}'
    return _UNSENDABLE.sub('\ufffd', text).encode('utf-8', 'surrogateescape').decode('utf-8', 'replace')


# Text as part of an XML document. Python's own functions for it load a client of HTTP first: 0.1 s of a start.

_TEXT: Final = str.maketrans({'&': '&amp;', '<': '&lt;', '>': '&gt;'})
_ATTRIBUTE: Final = {**_TEXT, **str.maketrans({'"': '&quot;', '\n': '&#10;', '\r': '&#13;', '\t': '&#9;'})}


def xml_text(text: str) -> str:
    """Return what stands for a text between two tags."""
    return text.translate(_TEXT)


def xml_attribute(text: str) -> str:
    """Return what stands for the value of an attribute, its ampes included; line breaks and tabs stay what they are."""
    return f'"{text.translate(_ATTRIBUTE)}"'
