# SPDX-License-Identifier: BSD-3-Clause
"""Reader of YAML files that collects all problems, each with its line."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import NamedTuple

import yaml

from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import YamlParts, line_of

from .errors import SynthesisError


class YamlEntry(NamedTuple):
    """A text of a user with its line in the file (from 1)."""

    text: str
    line: int


class YamlFile(YamlParts):
    """The text of a file, of which parts are taken as what they have to be; ``problems`` are those that are not."""

    def __init__(self, text: str, source: str) -> None:
        super().__init__(source)
        self._text = text

    def top(self, what: str, known: Collection[str] | None = None) -> dict[str, yaml.Node]:
        """Return the top-level entries."""
        root = self.root(self._text)
        self.end()
        return self.entries(root, what, known)

    def end(self) -> None:
        """Raise SynthesisError with all problems, if any."""
        if self.problems:
            raise SynthesisError(self.problems)

    def entries(self, node: yaml.Node | None, what: str, known: Collection[str] | None = None) -> dict[str, yaml.Node]:
        """Return the entries of a mapping by their names; empty when there is none. Others than ``known`` are
        problems."""
        found = self.mapping(None if node is None or is_null(node) else node, what)
        if known is not None:
            self.refuse_others(found, known, what)
        return found

    def words(self, node: yaml.Node | None, what: str) -> tuple[YamlEntry, ...]:
        """Return the texts of a list. A single text counts as a list of one; a null, as an empty list."""
        if node is None or is_null(node):
            return ()
        nodes = [node] if isinstance(node, yaml.ScalarNode) else self.sequence(node, what)
        return tuple(YamlEntry(self.word(one, f'an entry of {what}'), line_of(one)) for one in nodes)

    def word(self, node: yaml.Node, what: str) -> str:
        """Return a text as it is written."""
        return self.name(node, what).strip()

    def number(self, node: yaml.Node, text: str, what: str) -> int:
        """Return an integer from 0 that is written so: formulas have no others."""
        if re.fullmatch(r'0|[1-9]\d{0,8}', text, re.ASCII):
            return int(text)
        self.problem(node, f'{what} has to be an integer from 0 of at most 9 digits, not {short_repr(text)}')
        return 0

    def flag(self, node: yaml.Node, what: str) -> bool:
        """Return a truth value."""
        value = self.value(node, what)
        if not isinstance(value, bool | int):
            self.problem(node, f'{what} has to be true or false, not {short_repr(value)}')
        return bool(value)

    def note(self, line: int, text: str) -> None:
        """Record a problem with its line (from 1)."""
        self.problems.append(f'{self.source}:{line}: {text}')


def is_null(node: yaml.Node) -> bool:
    """Return whether the node is null."""
    return isinstance(node, yaml.ScalarNode) and node.tag.endswith(':null')
