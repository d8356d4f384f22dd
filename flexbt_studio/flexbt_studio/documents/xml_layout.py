# SPDX-License-Identifier: BSD-3-Clause
"""How XML is laid out on lines: what belongs to an element, and the edits that put it in, take it out and indent it.

New text follows the text around it: its line breaks, its unit of indentation, its way of closing empty elements. A
comment belongs to the element below it if it begins a line and no empty line is between the two, and to the element
before it on its line.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from typing import Final

from flexbt_core.behavior_tree.xml.parser import BAD_CHARACTER, FOLDED, unescape
from flexbt_core.values.text import short_repr
from flexbt_studio.errors import GestureError

from .document import need
from .text import LINE_BREAK, Span, TextEdit, applied, difference
from .xml_spans import Markup, XmlElement, raw_places

_BLANKS: Final = re.compile(r'[ \t]*')
_REST_OF_LINE: Final = re.compile(r'[ \t]*(?:\r\n?|\n|\Z)')
_STRICT: Final = re.compile('&(?:amp|lt);')
_ESCAPES: Final = {'\n': '&#10;', '\r': '&#13;', '"': '&quot;', "'": '&apos;', '&': '&amp;', '<': '&lt;'}

Written = Callable[[str], str]
"""A function that returns the text of new elements for an indentation; the first line is not indented."""


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
            raise GestureError(
                f'line {line}, column {column} of the new text cannot be read: {new.problems[0].message}'
            )
        start = len(new.text) - len(new.text.lstrip())
        span = Span(start, len(new.text.rstrip()))
        last_line = new.lines.start(span.end)
        base = new.indentation(start)
        if not base and new.text.startswith('</', last_line + len(new.indentation(span.end))):
            base = new.indentation(span.end)
        units = (new._units[0], self.unit) if new._units else ('', '')
        return new.tops, lambda indentation: new.lifted(span, base, indentation, units=units)
