# SPDX-License-Identifier: BSD-3-Clause
"""A small, lenient XML parser: elements and attributes with their positions in the file.

Real behavior-tree files contain ``&&`` and ``<`` in attribute values. Strict XML forbids these, but the parser of
BehaviorTree.CPP (tinyxml2) accepts them. Line breaks in values are kept. Dangerous input is rejected: DOCTYPE (entities
that expand), documents that are too large or too deep, control characters, and text that is not UTF-8.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.model.errors import LoadError, Source, TreeLoadError

MAX_BYTES: Final = 1 << 20
MAX_DEPTH: Final = 256
"""Maximum nesting of elements below <BehaviorTree>, as in BehaviorTree.CPP."""

NAME = r'[A-Za-z_:\u0080-\U0010ffff][\w:.\-\u00b7\u0080-\U0010ffff]*'
START = re.compile(rf'<({NAME})')
ATTRIBUTE = re.compile(rf'\s*({NAME})\s*=\s*(?:"([^"]*)"|\'([^\']*)\')')
TAG = re.compile(rf'<({NAME})((?:\s+{NAME}\s*=\s*(?:"[^"]*"|\'[^\']*\'))*)\s*(/?)>')
END_TAG = re.compile(rf'</({NAME})\s*>')
_SPACE = re.compile(r'\s*')
_UNFINISHED = re.compile(rf'({NAME})\s*(=?)\s*(["\']?)')
BAD_CHARACTER = re.compile('[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]')
_ENTITY = re.compile(r'&(?:(lt|gt|amp|quot|apos)|#([0-9]{1,7})|#[xX]([0-9a-fA-F]{1,6}));')
FOLDED = re.compile(rf'\r\n|{_ENTITY.pattern}')
_NAMED_ENTITIES = {'lt': '<', 'gt': '>', 'amp': '&', 'quot': '"', 'apos': "'"}


class Element:
    """An element: tag, attributes in document order, children, and offsets into the source.

    Elements with identical text share their attributes: copy them before you change them.
    """

    __slots__ = ('attributes', 'children', 'offset', 'places', 'tag')

    def __init__(self, tag: str, offset: int, attributes: dict[str, str], places: dict[str, int]) -> None:
        self.tag = tag
        self.offset = offset
        self.attributes = attributes
        self.places = places
        """Offset of each attribute from the beginning of the element."""
        self.children: list[Element] = []

    def offset_of(self, attribute: str | None) -> int:
        """Return the offset of an attribute; that of the element for None and for an absent attribute."""
        return self.offset if attribute is None else self.offset + self.places.get(attribute, 0)

    @property
    def offsets(self) -> dict[str, int]:
        """Offset of each attribute in the source."""
        return {name: self.offset + place for name, place in self.places.items()}

    def __str__(self) -> str:
        name = self.attributes.get('name') or self.attributes.get('ID')
        return f'<{self.tag} {name!r}>' if name else f'<{self.tag}>'


def value_offset(source: Source, attribute: int, value: str, index: int) -> int:
    """Return the source offset of the character ``index`` in the value of the attribute at ``attribute``.

    Return the offset of the attribute if its value differs from the text in the source.
    """
    match = ATTRIBUTE.match(source.text, attribute)
    if match is None:
        return attribute
    group = 2 if match.group(2) is not None else 3
    written = match.group(group)
    if unescape(written) != value:
        return attribute
    for folded in FOLDED.finditer(written):
        if folded.start() >= index:
            break
        index += len(folded.group()) - len(unescape(folded.group()))
    return match.start(group) + index


def decode(data: bytes, file: str, max_bytes: int = MAX_BYTES) -> str:
    """Return the text of a file. Raises TreeLoadError if it is too large or not UTF-8."""
    _check_size(len(data), file, max_bytes)
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b'\n') + 1
        # The bytes before the first bad one are valid, so the column can count characters.
        column = len(before[before.rfind(b'\n') + 1 :].decode('utf-8', 'replace')) + 1
        message = f'byte 0x{data[error.start]:02x} is not UTF-8; save the file in the encoding UTF-8'
        raise TreeLoadError([LoadError(file, line, column, '', message)]) from error


def parse(source: Source, *, max_bytes: int = MAX_BYTES, max_depth: int = MAX_DEPTH) -> Element:
    """Return the root element. Raises TreeLoadError at the first position that is not valid XML or is rejected."""
    text = source.text
    _check_size(len(text), source.file, max_bytes)
    bad = BAD_CHARACTER.search(text)
    if bad is not None:
        message = f'the character U+{ord(bad.group()):04X} is not allowed in XML; remove it'
        raise TreeLoadError([source.error(bad.start(), message)])
    if not text.isascii():
        _check_size(len(text.encode()), source.file, max_bytes)
    return _Parser(source, max_depth).parse()


def _check_size(size: int, file: str, max_bytes: int) -> None:
    if size > max_bytes:
        message = f'the document has more than {max_bytes} bytes, which is the limit; split it, or raise the limit'
        raise TreeLoadError([LoadError(file, 1, 1, '', message)])


_Tag = tuple[str, 'dict[str, str] | None', dict[str, int], bool]
"""Name, attributes (None for an end tag), their positions, and whether the element is empty."""


class _Parser:
    def __init__(self, source: Source, max_depth: int) -> None:
        self._source = source
        self._text = source.text
        # <root> and <BehaviorTree> add to the nesting allowed below <BehaviorTree>.
        self._most_open = max_depth + 2
        # Cached by text: most tags of a file occur several times.
        self._tags: dict[str, _Tag] = {}

    def _fail(self, offset: int, message: str, node: str = '') -> TreeLoadError:
        return TreeLoadError([self._source.error(min(offset, len(self._text)), message, node)])

    def parse(self) -> Element:
        text = self._text
        position = 1 if text.startswith('\ufeff') else 0
        root: Element | None = None
        opened: list[Element] = []
        tags = self._tags
        most_open = self._most_open
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
            position = text.find('>', start) + 1
            tag = tags.get(text[start:position])
            if tag is None:
                match = TAG.match(text, start) or END_TAG.match(text, start)
                if match is None:
                    position = self._skip_other(start)
                    continue
                position = match.end()
                tag = tags.get(match.group()) or self._read_tag(match)
            name, attributes, places, is_empty = tag
            if attributes is None:
                if not opened:
                    raise self._fail(start, f'</{name}> closes nothing')
                element = opened.pop()
                if element.tag != name:
                    raise self._bad_end(start, name, element)
                continue
            element = Element(name, start, attributes, places)
            if opened:
                opened[-1].children.append(element)
            elif root is None:
                root = element
            # Elements after the root are read, and ignored.
            if len(opened) >= most_open:
                raise self._fail(
                    start,
                    f'elements are nested more than {most_open - 2} deep; move a part into a sub-tree',
                    str(element),
                )
            if not is_empty:
                opened.append(element)
        if opened:
            raise self._fail(opened[-1].offset, f'<{opened[-1].tag}> is never closed', str(opened[-1]))
        if root is None:
            raise self._fail(0, 'the document has no element; a behavior tree begins with <root BTCPP_format="4">')
        return root

    def _read_tag(self, tag: re.Match[str]) -> _Tag:
        """Return the parsed tag, and cache it for identical tags."""
        attributes: dict[str, str] | None = None
        places: dict[str, int] = {}
        if tag.re is TAG:
            attributes = {}
            for match in ATTRIBUTE.finditer(self._text, tag.start(2), tag.end(2)):
                name, value, quoted = match.groups()
                if name in attributes:
                    raise self._bad_element(tag.start())
                attributes[name] = unescape(quoted if value is None else value)
                places[name] = match.start(1) - tag.start()
        read = tag.group(1), attributes, places, tag.group().endswith('/>')
        self._tags[tag.group()] = read
        return read

    def _skip_other(self, start: int) -> int:
        """Return the end of the markup at ``start``, which is not a tag."""
        text = self._text
        for begin, end, what in (
            ('<!--', '-->', 'comment'),
            ('<?', '?>', 'processing instruction'),
            ('<![CDATA[', ']]>', 'CDATA section'),
        ):
            if text.startswith(begin, start):
                found = text.find(end, start + len(begin))
                if found < 0:
                    raise self._fail(start, f'this {what} is never closed')
                return found + len(end)
        if text.startswith('<!', start):
            raise self._fail(
                start, 'DOCTYPE and other declarations are refused, entities could expand without bound; remove it'
            )
        if text.startswith('</', start):
            raise self._fail(start, 'this end tag is malformed')
        raise self._bad_element(start)

    def _bad_element(self, start: int) -> TreeLoadError:
        offset, message, element = tag_fault(self._text, start)
        return self._fail(offset, message, '' if element is None else str(element))

    def _bad_end(self, start: int, tag: str, element: Element) -> TreeLoadError:
        line, column = self._source.position(element.offset)
        return self._fail(start, f'</{tag}> does not close <{element.tag}>, opened at line {line}, column {column}')


class TagFault(NamedTuple):
    """The offset and the reason of a fault in a tag, and the element as far as it was read; None without a name."""

    offset: int
    message: str
    element: Element | None


def tag_fault(text: str, start: int) -> TagFault:
    """Return what is wrong with the start tag at ``start``, which is not valid."""
    match = START.match(text, start)
    if match is None:
        return TagFault(start, "'<' is not followed by the name of an element; write &lt; in text", None)
    element = Element(match.group(1), start, {}, {})
    position = match.end()
    while True:
        match = ATTRIBUTE.match(text, position)
        if match is None:
            return TagFault(*_bad_tag(text, element, position), element)
        name, value, quoted = match.groups()
        if match.start(1) == position:
            return TagFault(position, f'space is missing before attribute [{name}]', element)
        if name in element.attributes:
            return TagFault(match.start(1), f'attribute [{name}] is given twice', element)
        element.attributes[name] = unescape(quoted if value is None else value)
        position = match.end()


def _bad_tag(text: str, element: Element, position: int) -> tuple[int, str]:
    """Return the fault at ``position``, where neither an attribute nor the end of the tag follows."""
    match = _SPACE.match(text, position)
    assert match is not None
    at = match.end()
    if at >= len(text):
        return element.offset, 'the document ends within this tag'
    match = _UNFINISHED.match(text, at)
    if match is None:
        return at, f'unexpected {text[at]!r} within a tag'
    name, equals, quote = match.groups()
    if not equals:
        return at, f'attribute [{name}] has no value; write {name}="..."'
    if not quote:
        return at, f'the value of attribute [{name}] is not quoted; write {name}="..."'
    return at, f'the value of attribute [{name}] has no closing quote'


def unescape(value: str) -> str:
    """Return the characters of a value or text as written: references are replaced, and line breaks are ``\\n``."""
    if '\r' in value:
        value = value.replace('\r\n', '\n').replace('\r', '\n')
    return _ENTITY.sub(_entity, value) if '&' in value else value


def _entity(match: re.Match[str]) -> str:
    name, decimal, hexadecimal = match.groups()
    if name is not None:
        return _NAMED_ENTITIES[name]
    code = int(decimal) if decimal is not None else int(hexadecimal, 16)
    # References to characters not allowed in XML stay unchanged, as unknown entities do.
    if code > 0x10FFFF or BAD_CHARACTER.match(chr(code)):
        return match.group()
    return chr(code)
