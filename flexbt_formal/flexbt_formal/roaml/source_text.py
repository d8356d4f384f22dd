# SPDX-License-Identifier: BSD-3-Clause
"""XML elements that know their file, and errors with file and line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Final, NoReturn

from flexbt_core.behavior_tree.model.errors import LoadError, Source, TreeLoadError
from flexbt_core.behavior_tree.xml.parser import MAX_BYTES, Element, decode, parse
from flexbt_core.values.text import did_you_mean
from flexbt_core.values.text_files import open_regular

_TAG: Final = re.compile(r"""<("[^"]*"|'[^']*'|[^"'>])*>""")


class ModelError(TreeLoadError):
    """An error in a file of a model: file, line, the problem, and the remedy."""


class ModelFault(Exception):
    """A model that cannot continue: an expression has no value, or the model loops forever. Names file, line and
    value."""


class SourceElement:
    """An XML element with its file. Its tag has no namespace prefix."""

    __slots__ = ('children', 'element', 'source', 'tag')

    def __init__(self, element: Element, source: Source) -> None:
        self.element = element
        self.source = source
        self.tag = element.tag.rpartition(':')[2]
        self.children = tuple(SourceElement(child, source) for child in element.children)

    @property
    def place(self) -> str:
        """File and line, for messages."""
        return f'{self.source.file}:{self.source.position(self.element.offset)[0]}'

    def fail(self, message: str, attribute: str = '') -> NoReturn:
        """Raise ModelError for this element, or for one of its attributes."""
        raise ModelError([self.source.error(self.element.offset_of(attribute), message, f'<{self.tag}>')])

    def get(self, name: str) -> str | None:
        return self.element.attributes.get(name)

    def need(self, name: str) -> str:
        """Return a required attribute. Raises ModelError if it is missing or empty."""
        value = self.get(name)
        if value is None or not value.strip():
            self.fail(f'the attribute [{name}] is missing or empty; write {name}="..."', name)
        return value

    def number(self, name: str, most: float = 1e9) -> float:
        """Return an attribute as a number above 0 and up to ``most``. Raises ModelError."""
        text = self.need(name)
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if not 0.0 < value <= most:
            self.fail(f'{text!r} is not a number above 0, up to {most:g}', name)
        return value

    def find(self, tag: str) -> SourceElement | None:
        """Return the only child with this tag. Raises ModelError if several exist."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            found[1].fail(f'<{tag}> is given twice; remove one of them')
        return found[0] if found else None

    def all(self, *tags: str) -> Iterator[SourceElement]:
        return (child for child in self.children if child.tag in tags)

    def only(self, tags: Iterable[str]) -> None:
        """Raise ModelError if a child has another tag."""
        known = tuple(tags)
        for child in self.children:
            if child.tag not in known:
                child.fail(f'this element is not known in <{self.tag}>{did_you_mean(child.tag, known)}')

    @property
    def text(self) -> str:
        """The text within the element, up to its first child."""
        text = self.source.text
        match = _TAG.match(text, self.element.offset)
        if match is None or match.group().endswith('/>'):
            return ''
        return text[match.end() : text.find('<', match.end())].strip()


def read_text(path: str, asked: SourceElement | None = None) -> str:
    """Return the text of a file of the model. Raises ModelError, which names the element that asked for it."""
    try:
        with open(path, 'rb', opener=open_regular) as content:
            return decode(content.read(MAX_BYTES + 1), path, MAX_BYTES)
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        message = f'the file {path} cannot be read: {reason}; correct the path, which is relative to this file'
        if asked is not None:
            asked.fail(message, 'src')
        raise ModelError([LoadError(path, 1, 1, '', f'the file cannot be read: {reason}')]) from error


def read_xml(path: str, asked: SourceElement | None = None) -> SourceElement:
    """Return the root element of a file of the model. Raises TreeLoadError."""
    source = Source(path, read_text(path, asked))
    return SourceElement(parse(source), source)
