# SPDX-License-Identifier: BSD-3-Clause
"""Bounded reading of YAML from untrusted sources, part by part, with the line of each problem.

PyYAML's composer recurses for each level, an alias can repeat any amount of data, and numbers in base 60 take time
quadratic in their length. This module bounds all of them while it reads the text.

libyaml scans the text if PyYAML is built with it: PyYAML's own scanner takes 1 to 3 s for 100 kB, during which a node
does not respond. Its errors have more details, so it scans a short text again that libyaml refuses.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Collection, Mapping
from typing import Any, Final

import yaml

from .findings import FindingRecord, finding_record
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
    except UnicodeEncodeError as error:
        before = text[: error.start]
        mark = yaml.Mark('', error.start, before.count('\n'), error.start - before.rfind('\n') - 1, None, 0)
        raise YamlError(mark, f'no YAML: {short_repr(text[error.start])} is half of a character') from error
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
    """A reader of the parts of a text. It collects ``problems`` as ``source:line: problem`` and continues. ``records``
    are the same problems with their places; ``owner`` is the node of the next ones."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.problems: list[str] = []
        self.records: list[FindingRecord] = []
        self.owner = ''
        self._keys: dict[int, yaml.Node] = {}  # by the id of the value
        self._root: yaml.Node | None = None  # so that no id is used again

    def root(self, text: str, limit: int | None = None) -> yaml.Node | None:
        """Return the root node of the text. If it is empty, not YAML, or has more than ``limit`` characters, add a
        problem and return None."""
        if limit is not None and len(text) > limit:
            self._add(f'the text has {len(text)} characters; at most {limit} are read', (1, 1), (1, 1))
            return None
        try:
            self._root = compose_yaml(text)
        except YamlError as error:
            self._add(error.reason, (error.line, error.column), (error.line, error.column))
            return None
        if self._root is None:
            self._add('the text is empty', (1, 1), (1, 1))
        return self._root

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
            self._keys[id(value)] = key
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

    def truth(self, node: yaml.Node, what: str) -> bool | None:
        """Return a boolean; else add a problem and return None."""
        value = self.value(node, what)
        if not isinstance(value, bool):
            self.problem(node, f'{what} has to be true or false, not {short_repr(value)}')
            return None
        return value

    def values(self, node: yaml.Node, what: str) -> dict[str, Any]:
        """Return plain data by name."""
        return {name: self.value(one, f'{what}: {short_repr(name)}') for name, one in self.mapping(node, what).items()}

    def refuse_others(self, entries: dict[str, yaml.Node], known: Collection[str], what: str) -> None:
        """Add a problem for each entry whose name is not in ``known``."""
        for name, value in entries.items():
            if name not in known:
                self.problem(self.key_of(value), f'{what} cannot have {short_repr(name)}{did_you_mean(name, known)}')

    def problem(self, node: yaml.Node, text: str) -> None:
        """Add a problem at the place of a node."""
        mark = node.start_mark
        start = (1, 1) if mark is None else (mark.line + 1, mark.column + 1)
        self._add(text, start, end_of(node) or start)

    def key_of(self, value: yaml.Node) -> yaml.Node:
        """Return the key of a value in a mapping that was read; the value itself if there is none."""
        return self._keys.get(id(value), value)

    def _add(self, text: str, start: tuple[int, int], end: tuple[int, int]) -> None:
        record = finding_record('refused', 'error', text, file=self.source, start=start, end=end, node=self.owner)
        self.records.append(record)
        self.problems.append(f'{self.source}:{start[0]}: {text}')


class StrictYamlParts(YamlParts):
    """A reader that refuses values which readers of YAML 1.1 and 1.2 read in different ways, and duplicate names in
    values. Its values are texts, numbers, truth values, None, lists and mappings of them.

    The text ``$name`` stands for a copy of a value in ``references``. A text that begins with ``$$`` means one that
    begins with ``$``.
    """

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self.references: Mapping[str, Any] = {}

    def value(self, node: yaml.Node, what: str) -> Any:
        if isinstance(node, yaml.SequenceNode) and node.tag == _LIST:
            return [self.value(one, what) for one in node.value]
        if not isinstance(node, yaml.MappingNode) or node.tag != _MAPPING:
            value = self._scalar(node, what)
            return self._referred(node, value, what) if isinstance(value, str) else value
        entries: dict[Any, Any] = {}
        for key, value in node.value:
            name = self._scalar(key, f'a name in {what}')
            if name in entries:
                self.problem(key, f'{what} has {short_repr(name)} twice')
            entries[name] = self.value(value, what)
        return entries

    def _referred(self, node: yaml.Node, text: str, what: str) -> Any:
        if text.startswith('$$') or not _REFERENCE.fullmatch(text):
            return text.removeprefix('$') if text.startswith('$$') else text
        if text[1:] not in self.references:
            near = did_you_mean(text[1:], self.references, f'; write ${text} for the text')
            self.problem(node, f'{what}: there is no parameter {short_repr(text[1:])}{near}')
        return copy.deepcopy(self.references.get(text[1:]))

    def _scalar(self, node: yaml.Node, what: str) -> Any:
        tag = node.tag.rpartition(':')[2]
        if not isinstance(node, yaml.ScalarNode) or tag not in (*_PLAIN, *_OLD):
            self.problem(node, f'{what} is not a plain value: {shown_node(node)} of the type {short_repr(tag)}')
        elif tag in _OLD or (not node.style and _AMBIGUOUS.fullmatch(node.value)):
            advice = 'for a text write it in quotes, else write true or false, or a number such as 90, 0.01 or 1.0e+3'
            self.problem(node, f'{what}: versions of YAML read {short_repr(node.value)} in different ways; {advice}')
        else:
            return super().value(node, what)
        return None


_REFERENCE: Final = re.compile(r'\$[^\W\d][\w.-]*')
_LIST: Final = 'tag:yaml.org,2002:seq'
_MAPPING: Final = 'tag:yaml.org,2002:map'
_PLAIN: Final = ('str', 'int', 'float', 'bool', 'null')
_OLD: Final = ('timestamp', 'merge', 'value')  # types that YAML 1.2 does not have
_AMBIGUOUS: Final = re.compile(
    r'(?i:yes|no|on|off)|[-+]?(0b?[0-9_]+|0o[0-7]+|[0-9]+_[0-9_.]*|[0-9]+(:[0-5]?[0-9])+(\.[0-9_]*)?'
    r'|[0-9]+[eE][-+]?[0-9]+|([0-9]+\.[0-9]*|\.[0-9]+)[eE][0-9]+)'
)


class _StrictDumper(yaml.SafeDumper):
    def represent_str(self, text: str) -> yaml.ScalarNode:
        has_lines = not _LINE_BREAKS.isdisjoint(text)  # in other quotes they would be line breaks of the YAML, too
        return self.represent_scalar(_TEXT, text, '"' if has_lines else "'" if _AMBIGUOUS.fullmatch(text) else None)

    def ignore_aliases(self, data: Any) -> bool:
        return True


_LINE_BREAKS: Final = frozenset('\n\r\x85\u2028\u2029')
_TEXT: Final = 'tag:yaml.org,2002:str'
_StrictDumper.add_representer(str, _StrictDumper.represent_str)


def yaml_line(value: Any) -> str:
    """Return plain data on one line, which all versions of YAML read as the same value."""
    text: str = yaml.dump(
        value, None, _StrictDumper, default_flow_style=True, width=10**9, sort_keys=False, allow_unicode=True
    )
    return text.removesuffix('\n').removesuffix('\n...')


def strict_yaml(value: Any) -> str:
    """Return a value on one line, as :class:`StrictYamlParts` reads it."""
    return yaml_line(_doubled(value))


def _doubled(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _doubled(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_doubled(one) for one in value]
    return f'${value}' if isinstance(value, str) and value.startswith('$') else value


def end_of(node: yaml.Node) -> tuple[int, int] | None:
    """Return line and column behind the last character of a node, from 1. PyYAML ends a block behind the comments that
    follow it."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        node = last[1] if isinstance(last, tuple) else last
    return None if node.end_mark is None else (node.end_mark.line + 1, node.end_mark.column + 1)


def line_of(node: yaml.Node) -> int:
    """Return the line of a node, from 1."""
    return node.start_mark.line + 1 if node.start_mark is not None else 1


def shown_node(node: yaml.Node) -> str:
    """Return the text of a node for a message."""
    if isinstance(node, yaml.MappingNode):
        return 'a mapping'
    return 'a list' if isinstance(node, yaml.SequenceNode) else short_repr(node.value)
