# SPDX-License-Identifier: BSD-3-Clause
"""The text of an XML file: its elements with the spans of all their parts, and the edits that keep its layout.

The grammar is that of the engine's parser, which stops at the first problem; this one continues behind it. Both find
the same elements in a text without problems.

New text follows the text around it: its line breaks, its unit of indentation, its way of closing empty elements. A
comment belongs to the element below it if it begins a line and no empty line is between the two, and to the element
before it on its line.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property, lru_cache
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
from flexbt_core.values.text import short_repr
from flexbt_studio.errors import GestureError

from .document import Document, Problem, need
from .text import LINE_BREAK, Span, TextEdit, applied, difference

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
_BLANKS: Final = re.compile(r'[ \t]*')
_REST_OF_LINE: Final = re.compile(r'[ \t]*(?:\r\n?|\n|\Z)')
_STRICT: Final = re.compile('&(?:amp|lt);')
_ESCAPES: Final = {'\n': '&#10;', '\r': '&#13;', '"': '&quot;', "'": '&apos;', '&': '&amp;', '<': '&lt;'}

Written = Callable[[str], str]
"""A function that returns the text of new elements for an indentation; the first line is not indented."""


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
                found = -1 if end in self._missing else text.find(end, start + len(begin))
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


class Layout(Markup):
    """The elements of a text and their places on its lines."""

    # Lines.

    def indentation(self, offset: int) -> str:
        """Return the blanks with which the line of this offset begins."""
        return self.blanks(self.lines.start(offset), offset)

    def blanks(self, offset: int, end: int | None = None) -> str:
        """Return the blanks that follow an offset, up to ``end``."""
        found = _BLANKS.match(self.text, offset, len(self.text) if end is None else end)
        return found.group() if found else ''

    def begins_line(self, offset: int) -> bool:
        """Return whether only blanks are before this offset on its line."""
        return self.lines.start(offset) + len(self.indentation(offset)) == offset

    def rest_of_line(self, offset: int) -> int | None:
        """Return where the next line begins if only blanks are behind this offset on its line; None if not."""
        found = _REST_OF_LINE.match(self.text, offset)
        return None if found is None else found.end()

    @cached_property
    def unit(self) -> str:
        """One level of indentation: what most elements have more than the element around them."""
        return self._units[0] if self._units else '  '

    @cached_property
    def _units(self) -> list[str]:
        found: Counter[str] = Counter()
        for element in (one for top in self.tops for one in top.all()):
            if element.parent is not None and self.begins_line(element.offset):
                outer, inner = self.indentation(element.parent.offset), self.indentation(element.offset)
                if inner.startswith(outer) and inner != outer and self.begins_line(element.parent.offset):
                    found[inner[len(outer) :]] += 1
        return [unit for unit, _ in found.most_common(1)]

    @cached_property
    def empty_end(self) -> str:
        """What most elements without content end with: ``/>`` or `` />``."""
        blanks = len(re.findall(r'[ \t]/>', self.text))
        return ' />' if 2 * blanks > self.text.count('/>') else '/>'

    # Comments, and what else belongs to an element.

    @cached_property
    def _comment_starts(self) -> dict[int, int]:
        return {end: start for start, end in self.comments.items()}

    def comments_above(self, element: XmlElement) -> list[Span]:
        """Return the comments above an element that belong to it, from top to bottom."""
        found: list[Span] = []
        at = element.offset
        while True:
            end = at
            while end and self.text[end - 1] in ' \t\r\n':
                end -= 1
            start = self._comment_starts.get(end)
            if start is None or not self.begins_line(start) or len(LINE_BREAK.findall(self.text, end, at)) > 1:
                return found[::-1]
            found.append(Span(start, end))
            at = start

    def comments_behind(self, offset: int) -> list[Span]:
        """Return the comments that follow on the line of a tag that ends at this offset."""
        found: list[Span] = []
        while (start := offset + len(self.blanks(offset))) in self.comments:
            offset = self.comments[start]
            found.append(Span(start, offset))
        return found

    def block(self, element: XmlElement) -> Span:
        """Return the span of an element with the comments that belong to it."""
        spans = [*self.comments_above(element), element.span, *self.comments_behind(element.end)]
        return Span(spans[0].start, spans[-1].end)

    def opening_end(self, element: XmlElement) -> int:
        """Return the end of a start tag with the comments behind it on its line."""
        return [Span(0, element.open_end), *self.comments_behind(element.open_end)][-1].end

    # Edits of elements.

    def removal(self, element: XmlElement) -> list[TextEdit]:
        """Return the edits that take out an element with its comments, and with its line if nothing else is on it."""
        text, block, parent = self.text, self.block(element), element.parent
        if parent is not None and not (text[parent.open_end : block.start] + text[block.end : parent.close]).strip():
            return [self._emptied(parent)]
        line, next_line = self.lines.start(block.start), self.rest_of_line(block.end)
        after = block.end + len(self.blanks(block.end))
        if not self.begins_line(block.start):
            return [TextEdit(len(text[: block.start].rstrip(' \t')), block.end, '')]
        if next_line is not None:
            above = self._empty_lines_above(line)
            is_last = text.startswith('</', text.find('<', next_line))
            if above < line and (is_last or self._is_empty_line(next_line)):
                line = above
            return [TextEdit(line, next_line, '')]
        if text.startswith('</', after):
            return [TextEdit(len(text[: block.start].rstrip()), block.end, '')]
        return [TextEdit(block.start, after, '')]

    def _empty_lines_above(self, line: int) -> int:
        index = bisect_left(self.lines.starts, line)
        while index and self._is_empty_line(self.lines.starts[index - 1]):
            index -= 1
        return self.lines.starts[index]

    def _is_empty_line(self, line: int) -> bool:
        return line < len(self.text) and self.rest_of_line(line) is not None

    def _emptied(self, element: XmlElement) -> TextEdit:
        """Return the edit that turns ``<A>…</A>`` into ``<A/>``."""
        before = self.text[element.offset : element.open_end - 1].rstrip(' \t')
        end = '/>' if before.endswith(('\n', '\r')) else self.empty_end
        return TextEdit(element.offset + len(before), element.end, end)

    def insertion(
        self, parent: XmlElement, index: int, written: Written, *, without: XmlElement | None = None, gap: str = ''
    ) -> list[TextEdit]:
        """Return the edits that put new text among the children of ``parent``, ``without`` one of them.

        ``gap`` is put between the line break and the indentation of a new line.
        """
        text, line_break = self.text, self.line_break
        outer = self.indentation(parent.offset)
        siblings = [child for child in parent.children if child is not without]
        if not text[parent.open_end : parent.close].strip():
            inner = line_break + outer + self.unit + written(outer + self.unit) + line_break + outer
            if not parent.is_empty:
                return [TextEdit(parent.open_end, parent.close, inner)]
            before = text[parent.offset : parent.open_end - 2].rstrip(' \t')
            return [TextEdit(parent.offset + len(before), parent.open_end, f'>{inner}</{parent.tag}>')]
        at = self.block(siblings[index - 1]).end if index else self.opening_end(parent)
        near = [self.block(sibling).start for sibling in siblings[max(index - 1, 0) : index + 1]]
        own_lines = [self.indentation(start) for start in near if self.begins_line(start)]
        indentation = own_lines[0] if own_lines else outer + self.unit
        new = written(indentation)
        blanks = self.blanks(at)
        end = at + len(blanks)
        if self.rest_of_line(at) is not None:
            return [TextEdit(end, end, line_break + gap + indentation + new)]
        if LINE_BREAK.search(new) is None:
            return [TextEdit(at, at, blanks + new)]
        after = outer if text.startswith('</', end) else indentation
        return [TextEdit(at, end, line_break + indentation + new + line_break + after)]

    def gap(self, parent: XmlElement) -> str:
        """Return a line break if the children of ``parent`` are separated by empty lines, else ''."""
        starts = (self.lines.start(self.block(child).start) for child in parent.children[1:])
        return self.line_break if any(self._empty_lines_above(start) < start for start in starts) else ''

    def reindented(self, span: Span, base: str, new: str, units: tuple[str, str] = ('', '')) -> Iterator[TextEdit]:
        """Yield the edits that move the lines of a span, after its first one, from one indentation to another.

        ``units`` are the levels of indentation before and after. Lines within values and texts stay, and lines that do
        not begin with ``base``.
        """
        before, after = units
        lines = self.lines.starts
        for line in lines[bisect_right(lines, span.start) : bisect_left(lines, span.end)]:
            blanks = self.blanks(line)
            if not blanks.startswith(base) or self.rest_of_line(line) is not None:
                continue
            solid = bisect_left(self.solids, Span(line, 0)) - 1
            if solid >= 0 and self.solids[solid].end > line:
                continue
            deeper = blanks[len(base) :]
            levels = 0
            while before and deeper.startswith(before, levels * len(before)):
                levels += 1
            moved = new + levels * after + deeper[levels * len(before) :]
            if moved != blanks:
                yield TextEdit(line, line + len(blanks), moved)

    def lifted(
        self, span: Span, base: str, new: str, *, units: tuple[str, str] = ('', ''), edits: Iterable[TextEdit] = ()
    ) -> str:
        """Return the text of a span after further edits within it, moved from one indentation to another."""
        moved = (*self.reindented(span, base, new, units), *edits)
        return applied(
            self.text[span.start : span.end],
            [TextEdit(start - span.start, end - span.start, text) for start, end, text in moved],
        )

    # Edits of attributes.

    def escaped(self, value: str, quote: str, *, line_break: str = '') -> str:
        """Return a value as it is written between these quotes.

        Only what must be is escaped; ``&`` and ``<`` everywhere if the text does it elsewhere. ``line_break`` is
        written for line breaks, else a reference.

        Raises:
            GestureError: the value has a character that XML does not allow.
        """
        bad = BAD_CHARACTER.search(value)
        if bad is not None:
            raise GestureError(f'the character U+{ord(bad.group()):04X} is not allowed in XML; remove it')
        if self._is_strict:
            value = value.replace('&', '&amp;').replace('<', '&lt;')
        else:
            value = FOLDED.sub(lambda found: found.group().replace('&', '&amp;'), value)
        for character in quote, '\r', '\n':
            value = value.replace(character, line_break if character == '\n' and line_break else _ESCAPES[character])
        return value

    @cached_property
    def _is_strict(self) -> bool:
        return _STRICT.search(self.text) is not None

    def value_edits(self, element: XmlElement, values: dict[str, str | None]) -> list[TextEdit]:
        """Return the edits that set attributes; None removes one. An attribute that is not there comes last."""
        edits: list[TextEdit] = []
        ends = [element.offset + 1 + len(element.tag), *(part.end for part in element.parts.values())]
        before = dict(zip(element.parts, ends, strict=False))
        for name, value in values.items():
            part = element.parts.get(name)
            if part is None:
                if value is not None:
                    edits.append(self._new_attribute(element, ends[-1], name, value))
            elif value is None:
                edits.append(TextEdit(before[name], part.end, ''))
            elif value != part.value:
                edits.append(self._changed_value(element, name, value))
        return edits

    def _changed_value(self, element: XmlElement, name: str, value: str) -> TextEdit:
        part = element.parts[name]
        written = self.text[part.value_start : part.value_end]
        quote = self.text[part.value_end]
        line_break = self.line_break if LINE_BREAK.search(written) else ''
        places = raw_places(written)
        (change,) = difference(part.value, value)
        start, end = places[change.start], places[change.end]
        new = self.escaped(change.text, quote, line_break=line_break)
        if unescape(written[:start] + new + written[end:]) != value:
            start, end, new = 0, len(written), self.escaped(value, quote, line_break=line_break)
        return TextEdit(part.value_start + start, part.value_start + end, new)

    def _new_attribute(self, element: XmlElement, at: int, name: str, value: str) -> TextEdit:
        last = list(element.parts.values())[-1:]
        quote = self.text[last[0].value_end] if last else '"'
        space = ' '
        if last and self.begins_line(last[0].start):
            space = self.line_break + self.indentation(last[0].start)
        return TextEdit(at, at, f'{space}{name}={quote}{self.escaped(value, quote)}{quote}')

    def start_tag(self, tag: str, values: dict[str, str], end: str = '>') -> str:
        """Return a new start tag."""
        return f'<{tag}{"".join(f" {name}={self.quoted(value)}" for name, value in values.items())}{end}'

    def quoted(self, value: str) -> str:
        """Return a value between quotes."""
        return f'"{self.escaped(value, chr(34))}"'

    # New text.

    def snippet(self, xml: str) -> tuple[list[XmlElement], Written]:
        """Return the elements of an XML text, and the text to be inserted into this one.

        Raises:
            GestureError: it has no element, or cannot be read.
        """
        new = Layout(LINE_BREAK.sub(lambda _: self.line_break, xml.strip('\ufeff')))
        need(new.tops, f'{short_repr(xml)} is no XML of a node; write an element such as <Sequence/>')
        if new.problems:
            line, column = new.position(new.problems[0].span.start)
            place = f'line {line}, column {column} of the new text'
            raise GestureError(f'{place} cannot be read: {new.problems[0].message}')
        start = len(new.text) - len(new.text.lstrip())
        span = Span(start, len(new.text.rstrip()))
        last_line = new.lines.start(span.end)
        base = new.indentation(start)
        if not base and new.text.startswith('</', last_line + len(new.indentation(span.end))):
            base = new.indentation(span.end)
        units = (new._units[0], self.unit) if new._units else ('', '')
        return new.tops, lambda indentation: new.lifted(span, base, indentation, units=units)


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
