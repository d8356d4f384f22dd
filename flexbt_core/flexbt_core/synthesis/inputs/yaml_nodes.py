# SPDX-License-Identifier: BSD-3-Clause
"""Files of YAML, read with all that is wrong in them, each with its line."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import yaml

from flexbt_core.synthesis.errors import SynthesisError
from flexbt_core.values import YamlError, compose_yaml, construct_yaml, hint


class Entry(NamedTuple):
    """What somebody wrote, and in which line of the file (from 1)."""

    text: str
    line: int


class YamlFile:
    """The text of a file, of which parts are taken as what they have to be; ``problems`` are those that are not."""

    def __init__(self, text: str, source: str) -> None:
        self.source = source
        self.problems: list[str] = []
        self._text = text

    def entries(self, what: str, known: Iterable[str] | None = None) -> dict[str, yaml.Node]:
        """The top-level entries."""
        try:
            root = compose_yaml(self._text, aliases=True)
        except YamlError as error:
            raise SynthesisError([f'{self.source}:{error.line}: {error.reason}']) from error
        if root is None:
            raise SynthesisError([f'{self.source}:1: the file is empty'])
        return self.mapping(root, what, known)

    def problem(self, at: yaml.Node | int, text: str) -> None:
        """Notes what is wrong."""
        line = at if isinstance(at, int) else line_of(at)
        self.problems.append(f'{self.source}:{line}: {text}')

    def end(self) -> None:
        """Raises SynthesisError with all problems, if there are any."""
        if self.problems:
            raise SynthesisError(self.problems)

    def mapping(self, node: yaml.Node | None, what: str, known: Iterable[str] | None = None) -> dict[str, yaml.Node]:
        """The entries of a mapping by their names; empty when there is none. Others than ``known`` are problems."""
        if node is None or is_null(node):
            return {}
        if not isinstance(node, yaml.MappingNode):
            self.problem(node, f'{what} has to be a mapping')
            return {}
        entries: dict[str, yaml.Node] = {}
        allowed = None if known is None else list(known)
        for key, value in node.value:
            name = self.word(key, f'a name in {what}').text
            if name in entries:
                self.problem(key, f"{what} has '{name:.80}' twice")
            if allowed is not None and name not in allowed:
                self.problem(key, f"{what} cannot have '{name:.80}'{hint(name[:80], allowed)}")
            entries[name] = value
        return entries

    def words(self, node: yaml.Node | None, what: str) -> tuple[Entry, ...]:
        """The texts of a list; of one text by itself."""
        if node is None or is_null(node):
            return ()
        if isinstance(node, yaml.ScalarNode):
            return (self.word(node, what),)
        if not isinstance(node, yaml.SequenceNode):
            self.problem(node, f'{what} has to be a list')
            return ()
        return tuple(self.word(one, f'an entry of {what}') for one in node.value)

    def word(self, node: yaml.Node, what: str) -> Entry:
        """A text as it is written."""
        if not isinstance(node, yaml.ScalarNode):
            self.problem(node, f'{what} has to be a text')
            return Entry('', line_of(node))
        return Entry(str(node.value).strip(), line_of(node))

    def number(self, node: yaml.Node | Entry, what: str) -> int:
        """An integer."""
        entry = node if isinstance(node, Entry) else self.word(node, what)
        try:
            return int(entry.text[:20])
        except ValueError:
            self.problem(entry.line, f"{what} has to be an integer, not '{entry.text:.40}'")
            return 0

    def flag(self, node: yaml.Node, what: str) -> bool:
        """A truth value."""
        value = self.value(node, what)
        if not isinstance(value, bool | int):
            self.problem(node, f'{what} has to be true or false, not {value!r:.40}')
        return bool(value)

    def value(self, node: yaml.Node, what: str) -> Any:
        """Plain data."""
        try:
            return construct_yaml(node)
        except YamlError as error:
            self.problem(error.line, f'{what} is no plain value: {error.reason}')
            return None


def is_null(node: yaml.Node) -> bool:
    """Whether nothing is written there."""
    return isinstance(node, yaml.ScalarNode) and node.tag.endswith(':null')


def line_of(node: yaml.Node) -> int:
    """The line of a node, from 1."""
    return node.start_mark.line + 1 if node.start_mark is not None else 1
