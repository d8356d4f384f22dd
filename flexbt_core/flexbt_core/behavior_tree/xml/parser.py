# SPDX-License-Identifier: BSD-3-Clause
"""A small XML parser: elements and attributes with their places in the file, and as lenient as the files are.

Behavior-tree files in the wild hold ``&&`` and ``<`` in attribute values, which strict XML refuses and the parser of
BehaviorTree.CPP (tinyxml2) accepts; line breaks in values are kept. What could harm is refused: DOCTYPE (entities that
expand), too large or too deep documents, control characters, text that is not UTF-8.
"""

from __future__ import annotations

import re
from typing import Final

from flexbt_core.behavior_tree.model.errors import LoadError, Source, TreeLoadError

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 256
"""Nesting of elements below <BehaviorTree>, the limit of BehaviorTree.CPP."""

_NAME = r'[A-Za-z_:\u0080-\U0010ffff][\w:.\-\u00b7\u0080-\U0010ffff]*'
_START = re.compile(rf'<({_NAME})')
_ATTRIBUTE = re.compile(rf'\s*({_NAME})\s*=\s*(?:"([^"]*)"|\'([^\']*)\')')
_TAG_END = re.compile(r'\s*(/?)>')
_END = re.compile(rf'</({_NAME})\s*>')
_SPACE = re.compile(r'\s*')
_BAD_CHARACTER = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]')
_ENTITY = re.compile(r'&(?:(lt|gt|amp|quot|apos)|#([0-9]{1,7})|#[xX]([0-9a-fA-F]{1,6}));')
_FOLDED = re.compile(rf'\r\n|{_ENTITY.pattern}')
_NAMED_ENTITIES = {'lt': '<', 'gt': '>', 'amp': '&', 'quot': '"', 'apos': "'"}


class Element:
    """An element: tag, attributes in document order, children, and offsets into the source."""

    __slots__ = ('attributes', 'children', 'offset', 'offsets', 'tag')

    def __init__(self, tag: str, offset: int) -> None:
        self.tag = tag
        self.offset = offset
        self.attributes: dict[str, str] = {}
        self.offsets: dict[str, int] = {}
        self.children: list[Element] = []

    def __str__(self) -> str:
        name = self.attributes.get('name') or self.attributes.get('ID')
        return f'<{self.tag} {name!r}>' if name else f'<{self.tag}>'


def value_offset(source: Source, attribute: int, value: str, index: int) -> int:
    """Return where the character ``index`` of the value is written of the attribute that begins at ``attribute``.

    The attribute itself when its value is not the one that is written there.
    """
    match = _ATTRIBUTE.match(source.text, attribute)
    if match is None:
        return attribute
    group = 2 if match.group(2) is not None else 3
    written = match.group(group)
    if _unescape(written) != value:
        return attribute
    for folded in _FOLDED.finditer(written):
        if folded.start() >= index:
            break
        index += len(folded.group()) - len(_unescape(folded.group()))
    return match.start(group) + index


def decode(data: bytes, file: str, max_bytes: int = MAX_BYTES) -> str:
    """Return the text of a file. Raises TreeLoadError when it is too large, or not UTF-8."""
    _check_size(len(data), file, max_bytes)
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b'\n') + 1
        # What precedes the first bad byte is valid, so the column can be counted in characters.
        column = len(before[before.rfind(b'\n') + 1 :].decode('utf-8', 'replace')) + 1
        message = f'byte 0x{data[error.start]:02x} is not UTF-8; save the file in the encoding UTF-8'
        raise TreeLoadError([LoadError(file, line, column, '', message)]) from error


def parse(source: Source, *, max_bytes: int = MAX_BYTES, max_depth: int = MAX_DEPTH) -> Element:
    """Return the root element. Raises TreeLoadError at the first place where the text is no XML, or is refused."""
    text = source.text
    _check_size(len(text), source.file, max_bytes)
    bad = _BAD_CHARACTER.search(text)
    if bad is not None:
        message = f'the character U+{ord(bad.group()):04X} is not allowed in XML; remove it'
        raise TreeLoadError([source.error(bad.start(), message)])
    _check_size(len(text.encode()), source.file, max_bytes)
    return _Parser(source, max_depth).parse()


def _check_size(size: int, file: str, max_bytes: int) -> None:
    if size > max_bytes:
        message = f'the document has more than {max_bytes} bytes, which is the limit; split it, or raise the limit'
        raise TreeLoadError([LoadError(file, 1, 1, '', message)])


class _Parser:
    def __init__(self, source: Source, max_depth: int) -> None:
        self._source = source
        self._text = source.text
        # <root> and <BehaviorTree> come on top of the nesting that is allowed below <BehaviorTree>.
        self._max_open = max_depth + 2

    def _fail(self, offset: int, message: str, node: str = '') -> TreeLoadError:
        return TreeLoadError([self._source.error(min(offset, len(self._text)), message, node)])

    def parse(self) -> Element:
        text = self._text
        position = 1 if text.startswith('\ufeff') else 0
        root: Element | None = None
        opened: list[Element] = []
        while True:
            start = text.find('<', position)
            if not opened:
                end = start if start >= 0 else len(text)
                match = _SPACE.match(text, position)
                assert match is not None
                if match.end() < end:
                    raise self._fail(match.end(), 'text outside of the root element')
            if start < 0:
                break
            if text.startswith('</', start):
                position = self._close(start, opened)
            elif text.startswith('<!--', start):
                position = self._skip(start, '-->', 'comment')
            elif text.startswith('<?', start):
                position = self._skip(start, '?>', 'processing instruction')
            elif text.startswith('<![CDATA[', start):
                position = self._skip(start, ']]>', 'CDATA section')
            elif text.startswith('<!', start):
                raise self._fail(
                    start, 'DOCTYPE and other declarations are refused, entities could expand without bound; remove it'
                )
            else:
                element, position, empty = self._open(start)
                if opened:
                    opened[-1].children.append(element)
                elif root is None:
                    root = element
                # Elements after the root are read, and ignored.
                if len(opened) >= self._max_open:
                    raise self._fail(
                        start,
                        f'elements are nested more than {self._max_open - 2} deep; move a part into a sub-tree',
                        str(element),
                    )
                if not empty:
                    opened.append(element)
        if opened:
            raise self._fail(opened[-1].offset, f'<{opened[-1].tag}> is never closed', str(opened[-1]))
        if root is None:
            raise self._fail(0, 'the document has no element; a behavior tree begins with <root BTCPP_format="4">')
        return root

    def _open(self, start: int) -> tuple[Element, int, bool]:
        text = self._text
        match = _START.match(text, start)
        if match is None:
            raise self._fail(start, "'<' is not followed by the name of an element; write &lt; in text")
        element = Element(match.group(1), start)
        position = match.end()
        attributes = element.attributes
        while True:
            match = _ATTRIBUTE.match(text, position)
            if match is None:
                break
            if match.start(1) == position:
                raise self._fail(position, f'space is missing before attribute [{match.group(1)}]', str(element))
            name, value, quoted = match.groups()
            if value is None:
                value = quoted
            if name in attributes:
                raise self._fail(match.start(1), f'attribute [{name}] is given twice', str(element))
            attributes[name] = _unescape(value)
            element.offsets[name] = match.start(1)
            position = match.end()
        match = _TAG_END.match(text, position)
        if match is None:
            raise self._bad_tag(element, position)
        return element, match.end(), bool(match.group(1))

    def _bad_tag(self, element: Element, position: int) -> TreeLoadError:
        """Return what is wrong at ``position``, where neither an attribute nor the end of the tag follows."""
        text = self._text
        match = _SPACE.match(text, position)
        assert match is not None
        at = match.end()
        if at >= len(text):
            return self._fail(element.offset, 'the document ends within this tag', str(element))
        match = re.compile(rf'({_NAME})\s*(=?)\s*(["\']?)').match(text, at)
        if match is None:
            return self._fail(at, f'unexpected {text[at]!r} within a tag', str(element))
        name, equals, quote = match.groups()
        if not equals:
            return self._fail(at, f'attribute [{name}] has no value; write {name}="..."', str(element))
        if not quote:
            return self._fail(at, f'the value of attribute [{name}] is not quoted; write {name}="..."', str(element))
        return self._fail(at, f'the value of attribute [{name}] has no closing quote', str(element))

    def _close(self, start: int, opened: list[Element]) -> int:
        match = _END.match(self._text, start)
        if match is None:
            raise self._fail(start, 'this end tag is malformed')
        if not opened:
            raise self._fail(start, f'</{match.group(1)}> closes nothing')
        element = opened.pop()
        if match.group(1) != element.tag:
            line, column = self._source.position(element.offset)
            raise self._fail(
                start, f'</{match.group(1)}> does not close <{element.tag}>, opened at line {line}, column {column}'
            )
        return match.end()

    def _skip(self, start: int, end: str, what: str) -> int:
        found = self._text.find(end, start + 2)
        if found < 0:
            raise self._fail(start, f'this {what} is never closed')
        return found + len(end)


def _unescape(value: str) -> str:
    if '\r' in value:
        value = value.replace('\r\n', '\n').replace('\r', '\n')
    return _ENTITY.sub(_entity, value) if '&' in value else value


def _entity(match: re.Match[str]) -> str:
    name, decimal, hexadecimal = match.groups()
    if name is not None:
        return _NAMED_ENTITIES[name]
    code = int(decimal) if decimal is not None else int(hexadecimal, 16)
    # References to what no XML may hold stay as they are, as unknown entities do.
    if code > 0x10FFFF or _BAD_CHARACTER.match(chr(code)):
        return match.group()
    return chr(code)
