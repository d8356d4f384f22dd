# SPDX-License-Identifier: BSD-3-Clause
"""What reads short texts of others: YAML, values of any type, scripts of trees."""

from __future__ import annotations

import collections
import math
from collections.abc import Hashable
from typing import Any

from flexbt_common.values import Encoding, from_entry, text_to_value, to_entry, value_to_text
from flexbt_core.behavior_tree import BehaviorTreeError, Blackboard
from flexbt_core.behavior_tree.script import ScriptLibrary
from flexbt_core.errors import FlexbtError
from flexbt_core.values import YamlError, load_yaml
from flexbt_testing.pytest_plugin import HOSTILE_YAML
from flexbt_testing.random_trees import scripts

from .fuzzer import Target

YAML_WORDS = r"""
    - ? : , [ ] { } & * ! !! | > ' " % @ ` # --- ... &a *a << ~ null true yes 0x1F 0o17 1_000 1:30 .inf .nan -.inf 1e999
    !!binary !!set !!omap !!timestamp !!int !!float !!python/name:os.system 2026-02-30 key: "\x00" "\ud800"
""".split()  # noqa: SIM905

SCRIPT_WORDS = """
    a b c := = == != < > <= >= && || ! ~ + - * / .. & | ^ ? : ; ( ) 'x' '' true false 1 0x1F 1e999 2.5 -1
    99999999999999999999 += -= *= /= SUCCESS RUNNING @g
""".split()  # noqa: SIM905

VALUE_TYPES = (
    'bool', 'int8', 'uint64', 'int64', 'float32', 'float64', 'string', 'wstring', 'byte', 'float64[]', 'string[]',
    'uint8[]', 'geometry_msgs/PoseStamped', 'geometry_msgs/PoseStamped[]', 'nav_msgs/Path', 'std_msgs/ColorRGBA',
    'builtin_interfaces/Duration', 'nonsense/Type',
)  # fmt: skip
VALUE_TEXTS = (
    'true', '-1', '18446744073709551615', '1.5', 'nan', '[1, 2, 3]', '{x: 1, y: 2}', '"text"', 'a: {b: [c, {d: 1}]}',
    '{header: {frame_id: map}, pose: {position: {x: 3.8, y: 1.2}}}', '[{pose: {position: {x: 1}}}, {}]',
    '{sec: 1, nanosec: 5}', '{"poses": [{"pose": {"orientation": {"w": 1.0}}}]}', 'json:[1, 2]', '1 2 0.5',
)  # fmt: skip


class YamlTarget(Target):
    """:func:`flexbt_core.values.load_yaml`, with and without aliases."""

    words = tuple(YAML_WORDS)

    def seeds(self) -> list[str]:
        return [*HOSTILE_YAML.values(), *VALUE_TEXTS]

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        text = data.decode('utf-8', 'replace')
        kinds: list[Hashable] = []
        for aliases in (False, True):
            try:
                value = load_yaml(text, aliases=aliases)
            except YamlError as error:
                counts['refused'] += 1
                kinds.append(str(error).rsplit(':', 1)[-1][:40])
            else:
                counts['read'] += 1
                kinds.append(_shape(value))
        return tuple(kinds)


class ValueTarget(Target):
    """Typed values as text and as binary data; the first line of a text is the type, unless it is one of ours."""

    words = (*YAML_WORDS, *VALUE_TYPES)

    def seeds(self) -> list[str]:
        return [f'{type}\n{text}' for type in VALUE_TYPES for text in VALUE_TEXTS]

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        type, _, text = data.decode('utf-8', 'replace').partition('\n')
        try:
            value = text_to_value(text, type)
        except FlexbtError as error:
            counts['refused'] += 1
            return type[:40], str(error).split(':')[0][:30]
        counts['read'] += 1
        again = text_to_value(value_to_text(value, type), type)
        assert _same(again, value), (value, again)
        assert _same(from_entry(to_entry('key', value, type, Encoding.BINARY)), value)
        return type[:40], _shape(value)


class ScriptTarget(Target):
    """Scripts: read, and run with a blackboard of some entries."""

    words = tuple(SCRIPT_WORDS)

    def __init__(self) -> None:
        self._scripts = ScriptLibrary()

    def seeds(self) -> list[str]:
        texts = [scripts.make_case(seed)['xml'] for seed in range(60)]
        quoted = [part for text in texts for part in text.split('"')[1::2]]
        return sorted(
            {part.replace('&lt;', '<').replace('&gt;', '>').replace('&amp;', '&') for part in quoted if ' ' in part}
        )

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        board = Blackboard()
        for key, value in {'a': 1, 'b': 2.5, 'c': 'text', 'd': True}.items():
            board.set(key, value)
        try:
            script = self._scripts.script(data.decode('utf-8', 'replace'))
            script.bind(board).run()
        except BehaviorTreeError as error:
            counts['refused'] += 1
            return str(error).split(':')[-1][:40]
        counts['read'] += 1
        return tuple(sorted(board.keys()))[:6]


def _shape(value: Any, depth: int = 3) -> Hashable:
    """The types that a value consists of, to some depth."""
    if depth and isinstance(value, dict):
        return ('dict', *sorted({str(_shape(one, depth - 1)) for one in value.values()}))
    if depth and isinstance(value, list | tuple):
        return ('list', *sorted({str(_shape(one, depth - 1)) for one in value}))
    return type(value).__name__


def _same(one: Any, other: Any) -> bool:
    """Whether two values are equal; NaN is NaN."""
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other):
        return True
    if hasattr(one, 'get_fields_and_field_types'):
        return all(_same(getattr(one, name), getattr(other, name)) for name in one.get_fields_and_field_types())
    if isinstance(one, list | tuple) or hasattr(one, 'tolist'):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)
