# SPDX-License-Identifier: BSD-3-Clause
"""The parts of a YAML text that somebody has written: taken by what they have to be, each problem with its line.

Names are taken as they are written: ``off`` is a name, and no truth value.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import yaml

from .excerpts import shown
from .nested_yaml import YamlError, compose_yaml, construct_yaml
from .similar_names import hint


class YamlParts:
    """Takes a text apart. Whatever is wrong is kept in ``problems``, as ``source:line: what``, and reading goes on."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.problems: list[str] = []

    def root(self, text: str) -> yaml.Node | None:
        """The node of the whole text; None, and a problem, when it is no YAML or empty."""
        try:
            root = compose_yaml(text)
        except YamlError as error:
            self.problems.append(f'{self.source}:{error.line}: {error.reason}')
            return None
        if root is None:
            self.problems.append(f'{self.source}:1: the text is empty')
        return root

    def mapping(self, node: yaml.Node | None, what: str) -> dict[str, yaml.Node]:
        """The entries of a mapping by their names; empty when there is none."""
        if node is None:
            return {}
        if not isinstance(node, yaml.MappingNode):
            self.problem(node, f'{what} has to be a mapping, not {shown_node(node)}')
            return {}
        entries: dict[str, yaml.Node] = {}
        for key, value in node.value:
            name = self.name(key, f'a name in {what}')
            if name in entries:
                self.problem(key, f'{what} has {shown(name)} twice')
            entries[name] = value
        return entries

    def sequence(self, node: yaml.Node, what: str) -> list[yaml.Node]:
        """The entries of a list."""
        if not isinstance(node, yaml.SequenceNode):
            self.problem(node, f'{what} has to be a list, not {shown_node(node)}')
            return []
        return list(node.value)

    def names(self, node: yaml.Node, what: str) -> list[str]:
        """A list of names."""
        return [self.name(one, what) for one in self.sequence(node, what)]

    def name(self, node: yaml.Node, what: str, expected: str = 'a name') -> str:
        """A name, or what else is ``expected``, as it is written."""
        if not isinstance(node, yaml.ScalarNode):
            self.problem(node, f'{what} has to be {expected}, not {shown_node(node)}')
            return ''
        return str(node.value)

    def pairs(self, node: yaml.Node | None, what: str) -> dict[str, str]:
        """A mapping of names to names."""
        return {name: self.name(value, what) for name, value in self.mapping(node, what).items()}

    def value(self, node: yaml.Node, what: str) -> Any:
        """Plain data: numbers, texts, truth values, lists, mappings; None, and a problem, when it is something else."""
        try:
            return construct_yaml(node)
        except YamlError as error:
            self.problem(node, f'{what} is no plain value: {error.reason}')
            return None

    def values(self, node: yaml.Node, what: str) -> dict[str, Any]:
        """Plain data by names."""
        return {name: self.value(one, f'{what}: {shown(name)}') for name, one in self.mapping(node, what).items()}

    def refuse_others(self, entries: dict[str, yaml.Node], known: Collection[str], what: str) -> None:
        """A problem for each entry that has none of the names that are ``known``."""
        for name, value in entries.items():
            if name not in known:
                self.problem(value, f'{what} cannot have {shown(name)}{hint(name, known)}')

    def problem(self, node: yaml.Node, text: str) -> None:
        """Something is wrong at this place."""
        self.problems.append(f'{self.source}:{line_of(node)}: {text}')


def line_of(node: yaml.Node) -> int:
    """The line of a node, from 1."""
    return node.start_mark.line + 1 if node.start_mark is not None else 1


def shown_node(node: yaml.Node) -> str:
    """A node in a message."""
    if isinstance(node, yaml.MappingNode):
        return 'a mapping'
    return 'a list' if isinstance(node, yaml.SequenceNode) else shown(node.value)
