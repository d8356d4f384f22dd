# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's tests of states and behaviors: YAML files, of the ending ``.test``, that say what goes in and comes out."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from flexbt_common.values import from_plain, resolve_type
from flexbt_core.errors import FlexbtError
from flexbt_core.values import YamlError, compose_yaml, construct_yaml, read_text, shown

_KEYS: Final = frozenset({'path', 'class', 'name', 'import_only', 'params', 'input', 'output', 'outcome'})
_NEEDS: Final = frozenset({'launch', 'data', 'wait_cond', 'require_launch_success'})
"""What a test needs that is not made here."""

_SEQUENCE: Final = 'tag:yaml.org,2002:seq'
_MAPPING: Final = 'tag:yaml.org,2002:map'
_OBJECT: Final = 'tag:yaml.org,2002:python/object/new:'
_NO_WORD: Final = re.compile(r'\W')
_MESSAGE: Final = re.compile(r'(?P<package>\w+)\.msg\._\w+\.(?P<name>\w+)')


class StateTestError(FlexbtError):
    """A file of FlexBE's tests cannot be used."""


@dataclass(frozen=True)
class StateTest:
    """What a file says: the class under test, and what is expected of it. ``outcome`` is '' for ``import_only``."""

    file: Path
    module: str
    class_name: str
    import_only: bool
    parameters: Mapping[str, Any]
    inputs: Mapping[str, Any]
    outputs: Mapping[str, Any]
    outcome: str


def read_state_test(file: Path) -> StateTest:
    """Read a test.

    A text that begins with ``lambda`` is a function, ``None`` is None, and ``//x`` is the text ``/x``. Of Python's
    objects only ROS messages are made, in the form in which PyYAML writes them.

    Raises:
        StateTestError: no such file, no YAML, unknown keys, something missing, or something that is not made here.
    """
    try:
        node = compose_yaml(read_text(file), aliases=True)
        content = {} if node is None else _plain(node)
    except (OSError, FlexbtError, ValueError) as error:
        raise StateTestError(f'{file}: {error}') from None
    if not isinstance(content, dict):
        raise StateTestError(f'{file}: a test is a mapping of {", ".join(sorted(_KEYS))}, not {shown(content)}')
    if needed := sorted(_NEEDS & content.keys()):
        raise StateTestError(
            f'{file}: {", ".join(needed)}: nodes and data that a test needs are not started here; '
            'write it in Python, with the action servers and publishers of flexbt_testing.nodes.state_bench'
        )
    if unknown := sorted(map(str, content.keys() - _KEYS)):
        raise StateTestError(f'{file}: unknown keys {", ".join(unknown)}; known are {", ".join(sorted(_KEYS))}')
    import_only = content.get('import_only', False) is True
    module, class_name = _subject(file, content)
    if 'outcome' not in content and not import_only:
        raise StateTestError(f'{file}: outcome is missing; name the one that is expected')
    values = {
        key: {name: _value(file, value) for name, value in _mapping(file, content, key).items()}
        for key in ('params', 'input', 'output')
    }
    outcome = str(content.get('outcome', ''))
    return StateTest(
        file, module, class_name, import_only, values['params'], values['input'], values['output'], outcome
    )


def _subject(file: Path, content: Mapping[str, Any]) -> tuple[str, str]:
    """Module and class; a behavior's name stands for both, as FlexBE's editor derives them."""
    path = content.get('path')
    if not isinstance(path, str):
        raise StateTestError(f'{file}: path is missing; give the module of the class')
    if 'class' in content:
        return path, str(content['class'])
    if 'name' not in content:
        raise StateTestError(f'{file}: class is missing; give it, or the name of a behavior')
    name = str(content['name'])
    return f'{path}.{_NO_WORD.sub("_", name.lower())}_sm', f'{_NO_WORD.sub("", name)}SM'


def _mapping(file: Path, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key) or {}
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        raise StateTestError(f'{file}: {key} has to be a mapping of names to values, not {shown(value)}')
    return value


def _value(file: Path, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value == 'None':
        return None
    if value.startswith('//'):
        return value[1:]
    return _function(file, value) if value.startswith('lambda ') else value


def _function(file: Path, text: str) -> Any:
    """A function that is written in a test, which is code of the same author as what it tests."""
    try:
        tree = ast.parse(text, mode='eval')
    except SyntaxError as error:
        raise StateTestError(f'{file}: {shown(text)} is no function: {error.msg}') from None
    if not isinstance(tree.body, ast.Lambda):
        raise StateTestError(f'{file}: {shown(text)} is no function')
    return eval(compile(tree, str(file), 'eval'), {})  # noqa: S307


def _plain(node: yaml.Node) -> Any:
    """Plain data, and the messages in it."""
    if node.tag.startswith(_OBJECT):
        found = _MESSAGE.fullmatch(node.tag.removeprefix(_OBJECT))
        if found is None:
            raise YamlError(node.start_mark, f'{node.tag.removeprefix(_OBJECT)} is no ROS message; no other is made')
        return from_plain(_fields(node), resolve_type(f'{found["package"]}/msg/{found["name"]}'))
    if isinstance(node, yaml.SequenceNode) and node.tag == _SEQUENCE:
        return [_plain(item) for item in node.value]
    if isinstance(node, yaml.MappingNode) and node.tag == _MAPPING:
        return {key: _plain(value) for key, value in _entries(node).items()}
    return construct_yaml(node)


def _fields(node: yaml.Node) -> Any:
    """The fields of a message, plain: the second item of its state, each with an underscore in front."""
    if isinstance(node, yaml.SequenceNode):
        return [_fields(item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        return construct_yaml(node)
    entries = _entries(node)
    if node.tag.startswith(_OBJECT):
        state = entries.get('state')
        if not isinstance(state, yaml.SequenceNode) or len(state.value) != 2:
            raise YamlError(node.start_mark, 'a message has a state: None, and a mapping of its fields')
        return _fields(state.value[1])
    return {str(key).removeprefix('_'): _fields(value) for key, value in entries.items() if key != '_check_fields'}


def _entries(node: yaml.MappingNode) -> dict[Any, yaml.Node]:
    entries: dict[Any, yaml.Node] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise YamlError(key.start_mark, 'a key has to be a name')
        name = construct_yaml(key)
        if name in entries:
            raise YamlError(key.start_mark, f'{name!r} is there twice')
        entries[name] = value
    return entries
