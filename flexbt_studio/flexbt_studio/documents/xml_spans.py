# SPDX-License-Identifier: BSD-3-Clause
"""The elements of an XML text with the spans of all their parts, read as far as the text allows.

The grammar is that of the engine's parser, which stops at the first problem; this one continues behind it. Both find
the same elements in a text without problems.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.errors import Source
from flexbt_core.behavior_tree.xml.parser import (
    ATTRIBUTE,
    BAD_CHARACTER,
    END_TAG,
    FOLDED,
    MAX_BYTES,
    MAX_DEPTH,
    TAG,
    Element,
    tag_fault,
    unescape,
)

from .document import Document, Problem
from .text import Span, TextEdit

MOST_PROBLEMS: Final = 1000
"""Maximum number of problems that are reported for a text."""

_BRACKET: Final = re.compile('[<>]')
_WORD: Final = re.compile(r'</?[^\s<>]{0,80}|[^\s<>]{1,80}|')
_TAG_ON_NEW_LINE: Final = re.compile(r'[\r\n][ \t]*(?=<[A-Za-z_:/!?\u0080-\U0010ffff])')
_OTHER_MARKUP: Final = (
    ('<!--', '-->', 'comment'),
    ('<?', '?>', 'processing instruction'),
    ('<![CDATA[', ']]>', 'CDATA section'),
)


class Attribute(NamedTuple):
    """An attribute: its value, and where its name and its value (within the quotes) are."""

    value: str
    start: int
    value_start: int
    value_end: int

    @property
    def end(self) -> int:
        return self.value_end + 1

    def view(self, name: str) -> dict[str, Any]:
        """Return the attribute as JSON values."""
        span, whole = [self.value_start, self.value_end], [self.start, self.end]
        return {'name': name, 'value': self.value, 'span': span, 'whole': whole}


class XmlElement(Element):
    """An element with its spans.

    An element without an end tag has ``open_end == close == end``. ``fault`` is the reason for which its start tag or
    its end cannot be read; '' if both can.
    """

    __slots__ = ('close', 'end', 'fault', 'open_end', 'parent', 'parts')

    def __init__(self, tag: str, start: int, parts: dict[str, Attribute], open_end: int) -> None:
        values = {name: part.value for name, part in parts.items()}
        super().__init__(tag, start, values, {name: part.start - start for name, part in parts.items()})
        self.children: list[XmlElement] = []  # type: ignore[assignment]
        self.parts = parts
        self.parent: XmlElement | None = None
        self.open_end = open_end
        """End of the start tag."""
        self.close = open_end
        """Start of the end tag."""
        self.end = open_end
        self.fault = ''

    @property
    def span(self) -> Span:
        """The whole element."""
        return Span(self.offset, self.end)

    @property
    def is_empty(self) -> bool:
        """Whether it is written as ``<A/>``."""
        return self.close == self.end

    def value_span(self, name: str) -> Span:
        """Return where the value of an attribute is; the end of the start tag if there is none."""
        part = self.parts.get(name)
        return Span(self.open_end, self.open_end) if part is None else Span(part.value_start, part.value_end)

    def renamed(self, name: str, new: str) -> TextEdit:
        """Return the edit that gives an attribute another name."""
        start = self.parts[name].start
        return TextEdit(start, start + len(name), new)

    def all(self) -> Iterator[XmlElement]:
        """Yield this element and all below it, in document order."""
        pending = [self]
        while pending:
            element = pending.pop()
            yield element
            pending += reversed(element.children)


class Markup(Document):
    """The elements, comments and problems of a text.

    After a tag that cannot be read, reading continues at the next tag. An element whose end tag is missing ends with
    the element around it.
    """

    language = 'xml'

    def __init__(self, text: str, file: str = '') -> None:
        super().__init__(text, file)
        self.tops: list[XmlElement] = []
        """Elements that are in no other: the first is the root."""
        self.comments: dict[int, int] = {}
        """End of each comment by its start."""
        self.solids: list[Span] = []
        """Values with line breaks, texts and CDATA sections, in the order of places: their blanks have a meaning."""
        self._damages: list[tuple[int, str]] = []
        self._opened: list[XmlElement] = []
        self._opened_tags: Counter[str] = Counter()
        self._hidden = 0
        """Number of open elements that are nested too deeply."""
        self._missing: set[str] = set()
        self._reread = 0
        if len(text) > MAX_BYTES or (not text.isascii() and len(text.encode(errors='replace')) > MAX_BYTES):
            self._problem(0, f'the document has more than {MAX_BYTES} bytes, which is the limit; split it')
            return
        for bad in islice(BAD_CHARACTER.finditer(text), MOST_PROBLEMS + 1):
            self._problem(bad.start(), f'the character U+{ord(bad.group()):04X} is not allowed in XML; remove it')
        self._places = Source('', text)
        self._read()
        self.problems.sort(key=lambda one: one.span)
        self._damages.sort()
        self.solids.sort()

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and column of an offset, from 1."""
        return self._places.position(offset)

    def problem_in(self, start: int, end: int) -> str:
        """Return what cannot be read within these characters; '' if all can. Of too many problems any counts."""
        if len(self.problems) > MOST_PROBLEMS:
            return self.problems[-1].message
        index = bisect_left(self._damages, (start, ''))
        found = self._damages[index : index + 1]
        return found[0][1] if found and found[0][0] < end else ''

    def _problem(self, offset: int, message: str, tag: int | None = None) -> None:
        """Add a problem. ``tag`` is where the tag begins that cannot be read; it may be far before the problem."""
        if len(self.problems) == MOST_PROBLEMS:
            message = f'there are more than {MOST_PROBLEMS} problems; this is one of the others: {message}'
        elif len(self.problems) > MOST_PROBLEMS:
            return
        found = _WORD.match(self.text, offset)
        end = max(found.end() if found else offset, offset + 1)
        self.problems.append(Problem(Span(offset, min(end, len(self.text))), message))
        self._damages.append((offset if tag is None else tag, message))

    def _read(self) -> None:
        text = self.text
        position = 1 if text.startswith('\ufeff') else 0
        while True:
            start = text.find('<', position)
            self._read_text(position, start if start >= 0 else len(text))
            if start < 0:
                break
            if (tag := TAG.match(text, start)) is not None:
                position = tag.end()
                self._open(start, tag.group(1), tag.end(2), position, is_empty=bool(tag.group(3)))
            elif (end_tag := END_TAG.match(text, start)) is not None:
                position = end_tag.end()
                self._close(start, end_tag.group(1), position)
            elif text.startswith(('<!', '<?', '</'), start):
                position = self._read_other(start)
            else:
                position = self._read_bad_tag(start)
        for element in self._opened:
            self._end_by_force(element, len(text), f'<{element.tag}> is never closed')
            self._problem(element.offset, element.fault)
        if not self.tops:
            self._problem(0, 'the document has no element; a behavior tree begins with <root BTCPP_format="4">')

    def _read_text(self, start: int, end: int) -> None:
        written = self.text[start:end]
        if written and not written.isspace():
            self.solids.append(Span(start, start + len(written.rstrip())))
            if not self._opened:
                self._problem(end - len(written.lstrip()), 'text outside of the root element')

    def _attributes(self, position: int, end: int) -> tuple[dict[str, Attribute], bool]:
        """Return the attributes from ``position`` on, and whether one is given twice."""
        parts: dict[str, Attribute] = {}
        is_twice = False
        while (match := ATTRIBUTE.match(self.text, position, end)) is not None:
            position = match.end()
            value_start, value_end = match.span(2 if match.group(2) is not None else 3)
            written = self.text[value_start:value_end]
            if '\n' in written or '\r' in written:
                self.solids.append(Span(value_start, value_end))
            if match.group(1) in parts:
                is_twice = True
                continue
            parts[match.group(1)] = Attribute(unescape(written), match.start(1), value_start, value_end)
        return parts, is_twice

    def _open(
        self, start: int, tag: str, attributes_end: int, open_end: int, *, is_empty: bool, fault: str = ''
    ) -> None:
        parts, is_twice = self._attributes(start + 1 + len(tag), attributes_end)
        element = XmlElement(tag, start, parts, open_end)
        element.fault = fault
        if is_twice and not fault:
            offset, element.fault, _ = tag_fault(self.text, start)
            self._problem(offset, element.fault, start)
        opened = self._opened
        if len(opened) >= MAX_DEPTH + 2:
            if not opened[-1].fault:
                opened[-1].fault = f'elements are nested more than {MAX_DEPTH} deep; move a part into a sub-tree'
                self._problem(start, opened[-1].fault)
            self._hidden += not is_empty
            return
        element.parent = opened[-1] if opened else None
        (opened[-1].children if opened else self.tops).append(element)
        if not is_empty:
            opened.append(element)
            self._opened_tags[tag] += 1

    def _close(self, start: int, tag: str, end: int) -> None:
        opened = self._opened
        if self._hidden:
            self._hidden -= 1
            return
        if not opened:
            self._problem(start, f'</{tag}> closes nothing')
            return
        if opened[-1].tag != tag:
            line, column = self.position(opened[-1].offset)
            message = f'</{tag}> does not close <{opened[-1].tag}>, opened at line {line}, column {column}'
            self._problem(start, message)
            if not self._opened_tags[tag]:
                return
            while opened[-1].tag != tag:
                self._opened_tags[opened[-1].tag] -= 1
                self._end_by_force(opened.pop(), start, message)
        self._opened_tags[tag] -= 1
        element = opened.pop()
        element.close, element.end = start, end

    def _end_by_force(self, element: XmlElement, end: int, reason: str) -> None:
        element.close = element.end = end
        element.fault = element.fault or reason

    def _read_other(self, start: int) -> int:
        """Read a comment or other markup; return where to continue."""
        text = self.text
        for begin, end, what in _OTHER_MARKUP:
            if text.startswith(begin, start):
                found = -1 if end in self._missing else text.find(end, start + 2)
                if found < 0:
                    self._missing.add(end)
                    self._problem(start, f'this {what} is never closed')
                    return start + len(begin)
                if begin == '<!--':
                    self.comments[start] = found + len(end)
                else:
                    self.solids.append(Span(start, found + len(end)))
                return found + len(end)
        if text.startswith('<!', start):
            message = 'DOCTYPE and other declarations are refused, entities could expand without bound; remove it'
        else:
            message = 'this end tag is malformed'
        self._problem(start, message)
        bracket = _BRACKET.search(text, start + 1)
        return len(text) if bracket is None else bracket.end() if bracket.group() == '>' else bracket.start()

    def _read_bad_tag(self, start: int) -> int:
        """Read what can be read of a start tag; return where to continue."""
        text = self.text
        offset, message, read = tag_fault(text, start)
        self._problem(offset, message, start)
        if read is None:
            return start + 1
        name_end = start + 1 + len(read.tag)
        stop = max(offset, name_end)
        # A quote that is not closed takes in the tags of the next lines. The limit keeps the time linear.
        self._reread += stop - start
        next_line = _TAG_ON_NEW_LINE.search(text, start, stop) if self._reread <= len(text) else None
        bracket = None if next_line is not None else _BRACKET.search(text, stop)
        if bracket is not None and bracket.group() == '>':
            end = bracket.end()
            self._open(start, read.tag, stop, end, is_empty=text[end - 2] == '/', fault=message)
            return end
        if next_line is not None:
            stop = end = next_line.start()
        else:
            end = len(text) if bracket is None else bracket.start()
        self._open(start, read.tag, stop, start + len(text[start:end].rstrip()), is_empty=True, fault=message)
        return end


@lru_cache(maxsize=16)
def raw_places(written: str) -> list[int]:
    """Return where each character of the value of an attribute is in its text as written, and the end of the text."""
    places: list[int] = []
    position = 0
    for folded in FOLDED.finditer(written):
        if len(unescape(folded.group())) == 1:
            places += [*range(position, folded.start()), folded.start()]
            position = folded.end()
    return [*places, *range(position, len(written) + 1)]
