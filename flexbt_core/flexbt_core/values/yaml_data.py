# SPDX-License-Identifier: BSD-3-Clause
"""Bounded reading of YAML from untrusted sources, part by part, with the line of each problem.

PyYAML's composer recurses for each level, an alias can repeat any amount of data, and numbers in base 60 take time
quadratic in their length. This module bounds all of them while it reads the text.

libyaml scans the text if PyYAML is built with it: PyYAML's own scanner takes 1 to 3 s for 100 kB, during which a node
does not respond. Its errors have more details, so it scans a short text again that libyaml refuses.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final

import yaml

from .text import did_you_mean, short_repr

MAX_YAML_DEPTH: Final = 100
"""Maximum nesting depth of mappings and lists."""

MAX_REPEATED: Final = 100_000
"""Maximum number of values of a text with all aliases expanded."""

RESCANNED: Final = 5_000
"""Maximum length of a refused text that PyYAML scans again for a better error, characters; this takes about 0.1 s."""

_MOST_DIGITS: Final = 1000
_SCANNER: Final[Any] = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
_NUMBERS: Final = ('tag:yaml.org,2002:int', 'tag:yaml.org,2002:float')


class YamlError(ValueError):
    """A text is not YAML, or contains unsupported YAML. ``line`` and ``column``, from 1, are the place (``mark``);
    ``reason`` is the problem."""

    def __init__(self, mark: Any, reason: str) -> None:
        self.line: int = 1 if mark is None else mark.line + 1
        self.column: int = 1 if mark is None else mark.column + 1
        self.reason = reason
        super().__init__(f'line {self.line}: {reason}')


def load_yaml(text: str, *, aliases: bool = False) -> Any:
    """Return the plain data of one document; None for an empty one. Allow ``aliases`` only for texts of trusted
    authors.

    Raises:
        YamlError: the text is not YAML, has aliases or other than plain data, is nested deeper than MAX_YAML_DEPTH,
            or expands to more than MAX_REPEATED values.
    """
    node = compose_yaml(text, aliases=aliases)
    return None if node is None else construct_yaml(node)


def compose_yaml(text: str, *, aliases: bool = False) -> yaml.Node | None:
    """Return the root node of one document, with places in the text; None for an empty one.

    Raises:
        YamlError: not YAML, aliases, nested deeper than MAX_YAML_DEPTH, or expanded to more than MAX_REPEATED values.
    """
    try:
        try:
            return _FastComposer(text, aliases=aliases).get_single_node()
        except yaml.YAMLError:
            if len(text) > RESCANNED:
                raise
            return _Composer(text, aliases=aliases).get_single_node()
    except (yaml.YAMLError, RecursionError) as error:
        raise YamlError(getattr(error, 'problem_mark', None), f'no YAML: {_problem(error)}') from error


def construct_yaml(node: yaml.Node) -> Any:
    """Return the plain data of a node.

    Raises:
        YamlError: a tag is not for plain data, or a scalar does not match its tag or form.
    """
    try:
        return _Constructor().construct_document(node)
    except (yaml.YAMLError, RecursionError) as error:
        raise YamlError(getattr(error, 'problem_mark', None) or node.start_mark, _problem(error)) from error


class _Bounds(yaml.composer.Composer):
    """A composer that makes nodes from the events of a scanner and checks the bounds."""

    peek_event: Any  # of the scanner

    def __init__(self, *, aliases: bool) -> None:
        yaml.composer.Composer.__init__(self)  # not of the next class: a loader, which is initialized already
        self._takes_aliases = aliases
        self._around: list[str | None] = []  # anchors of the open nodes, outermost first
        self._values = 0  # so far, with aliases expanded
        self._values_of: dict[str | None, int] = {}  # by anchor

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: yaml.NodeEvent = self.peek_event()
        tag = getattr(event, 'tag', None) or ''
        if tag.startswith('!'):  # plain data has no such tag; the text may be [!open]
            written = short_repr(tag.rstrip(',]}'))
            raise YamlError(event.start_mark, f'what begins with ! is a tag in YAML; put it in quotes: {written}')
        if isinstance(event, yaml.AliasEvent):
            if not self._takes_aliases:
                raise YamlError(event.start_mark, f'aliases (*{event.anchor}) are not supported; write it out')
            if event.anchor in self._around:
                raise YamlError(event.start_mark, f'*{event.anchor} is in what it stands for')
        if isinstance(event, yaml.CollectionStartEvent) and len(self._around) == MAX_YAML_DEPTH:
            raise YamlError(event.start_mark, f'nested more than {MAX_YAML_DEPTH} levels deep')
        before = self._values
        self._around.append(event.anchor)
        node = super().compose_node(parent, index)
        self._around.pop()
        if isinstance(event, yaml.AliasEvent):
            self._values += self._values_of[event.anchor]
            if self._values > MAX_REPEATED:
                raise YamlError(event.start_mark, f'*{event.anchor} makes it more than {MAX_REPEATED} values')
        else:
            self._values += 1
            if event.anchor is not None:
                self._values_of[event.anchor] = self._values - before
        return node


class _Composer(_Bounds, yaml.SafeLoader):
    def __init__(self, text: str, *, aliases: bool) -> None:
        yaml.SafeLoader.__init__(self, text)
        _Bounds.__init__(self, aliases=aliases)


class _FastComposer(_Bounds, _SCANNER):
    def __init__(self, text: str, *, aliases: bool) -> None:
        _SCANNER.__init__(self, text)
        _Bounds.__init__(self, aliases=aliases)


class _Constructor(yaml.constructor.SafeConstructor):
    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            return super().construct_object(node, deep)
        if node.tag in _NUMBERS and len(node.value) > _MOST_DIGITS:
            raise YamlError(node.start_mark, f'a number of more than {_MOST_DIGITS} characters')
        try:
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except Exception as error:  # PyYAML passes on exceptions of a conversion
            kind = node.tag.rpartition(':')[2]
            raise YamlError(node.start_mark, f'{short_repr(node.value)} is not a valid {kind}') from error


def _problem(error: Exception) -> str:
    problem = getattr(error, 'problem', None) or ' '.join(str(error).split())
    return f'{problem}; indent by blanks' if "'\\t' that cannot start" in problem else problem


# The parts of a YAML text, read as the required types; each problem has its line.
#
# Names are read literally: ``off`` is a name, not a boolean.


class YamlParts:
    """A reader of the parts of a text. It collects ``problems`` as ``source:line: problem`` and continues."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.problems: list[str] = []

    def root(self, text: str) -> yaml.Node | None:
        """Return the root node of the text. If it is empty or not YAML, add a problem and return None."""
        try:
            root = compose_yaml(text)
        except YamlError as error:
            self.problems.append(f'{self.source}:{error.line}: {error.reason}')
            return None
        if root is None:
            self.problems.append(f'{self.source}:1: the text is empty')
        return root

    def mapping(self, node: yaml.Node | None, what: str) -> dict[str, yaml.Node]:
        """Return the entries of a mapping by name; empty without a mapping."""
        if node is None:
            return {}
        if not isinstance(node, yaml.MappingNode):
            self.problem(node, f'{what} has to be a mapping, not {shown_node(node)}')
            return {}
        entries: dict[str, yaml.Node] = {}
        for key, value in node.value:
            name = self.name(key, f'a name in {what}')
            if name in entries:
                self.problem(key, f'{what} has {short_repr(name)} twice')
            entries[name] = value
        return entries

    def sequence(self, node: yaml.Node, what: str) -> list[yaml.Node]:
        """Return the entries of a list."""
        if not isinstance(node, yaml.SequenceNode):
            self.problem(node, f'{what} has to be a list, not {shown_node(node)}')
            return []
        return list(node.value)

    def names(self, node: yaml.Node, what: str) -> list[str]:
        """Return a list of names."""
        return [self.name(one, what) for one in self.sequence(node, what)]

    def name(self, node: yaml.Node, what: str, expected: str = 'a name') -> str:
        """Return a name, or another ``expected`` text, as written."""
        if not isinstance(node, yaml.ScalarNode):
            self.problem(node, f'{what} has to be {expected}, not {shown_node(node)}')
            return ''
        return str(node.value)

    def pairs(self, node: yaml.Node | None, what: str) -> dict[str, str]:
        """Return a mapping of names to names."""
        return {name: self.name(value, what) for name, value in self.mapping(node, what).items()}

    def value(self, node: yaml.Node, what: str) -> Any:
        """Return plain data: numbers, texts, booleans, lists, mappings. Else add a problem and return None."""
        try:
            return construct_yaml(node)
        except YamlError as error:
            self.problem(node, f'{what} is not a plain value: {error.reason}')
            return None

    def values(self, node: yaml.Node, what: str) -> dict[str, Any]:
        """Return plain data by name."""
        return {name: self.value(one, f'{what}: {short_repr(name)}') for name, one in self.mapping(node, what).items()}

    def refuse_others(self, entries: dict[str, yaml.Node], known: Collection[str], what: str) -> None:
        """Add a problem for each entry whose name is not in ``known``."""
        for name, value in entries.items():
            if name not in known:
                self.problem(value, f'{what} cannot have {short_repr(name)}{did_you_mean(name, known)}')

    def problem(self, node: yaml.Node, text: str) -> None:
        """Add a problem at the place of a node."""
        self.problems.append(f'{self.source}:{line_of(node)}: {text}')


def line_of(node: yaml.Node) -> int:
    """Return the line of a node, from 1."""
    return node.start_mark.line + 1 if node.start_mark is not None else 1


def shown_node(node: yaml.Node) -> str:
    """Return the text of a node for a message."""
    if isinstance(node, yaml.MappingNode):
        return 'a mapping'
    return 'a list' if isinstance(node, yaml.SequenceNode) else short_repr(node.value)
