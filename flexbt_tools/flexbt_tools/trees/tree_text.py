# SPDX-License-Identifier: BSD-3-Clause
"""Trees as text, and as JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree import NodeKind, TreeKey, TreeLibrary
from flexbt_core.values import one_line

from .outline import Item, is_main, items_of


class _Lines(NamedTuple):
    """What the branches of a tree are drawn with."""

    child: str
    last_child: str
    past: str
    past_last: str


_UNICODE: Final = _Lines('├─ ', '└─ ', '│  ', '   ')
_ASCII: Final = _Lines('|- ', '`- ', '|  ', '   ')


def tree_lines(items: Iterable[Item], ports: str, *, ascii_only: bool, width: int) -> Iterator[str]:
    """A line for each node, or several where it has more than ``width`` characters; ``ports`` as in
    :meth:`.Item.attributes`."""
    lines = _ASCII if ascii_only else _UNICODE
    # What stands in front of the children of each node of the path to the current one.
    margins: list[str] = []
    all_items = list(items)
    for item, following in zip_longest(all_items, all_items[1:]):
        del margins[max(item.depth - 1, 0) :]
        margin = ''.join(margins)
        if item.depth:
            branch = lines.last_child if item.last else lines.child
            margins.append(lines.past_last if item.last else lines.past)
        else:
            branch = ''
        below = ''.join(margins) + (lines.past if following and following.depth > item.depth else lines.past_last)
        words = [_title(item), *item.attributes(ports, ascii_only=ascii_only)]
        first, *others = _wrapped(words, max(width - len(below), _LEAST_WIDTH))
        yield f'{margin}{branch}{first}'
        yield from (f'{below}{other}' for other in others)


_LEAST_WIDTH: Final = 40
"""Characters of a node in a line, however deep it is."""


def _wrapped(words: Iterable[str], width: int) -> Iterator[str]:
    """Words in lines; what does not fit into one is broken."""
    line = ''
    for word in words:
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ''
        if len(word) > width:
            *rows, word = textwrap.wrap(word, width, break_on_hyphens=False, subsequent_indent='  ')
            yield from rows
        line = f'{line}  {word}' if line else word
    yield line


def _title(item: Item) -> str:
    sub_tree = 'SubTree ' if item.kind is NodeKind.SUBTREE else ''
    name = f' "{one_line(item.name)}"' if item.name else ''
    return f'{sub_tree}{one_line(item.type)}{name}'


def tree_as_json(library: TreeLibrary, key: TreeKey, *, expand: bool) -> dict[str, Any]:
    """A tree as a list of nodes, parents first; ``parent`` is the index in it."""
    tree = library.definition(key)
    return {
        'id': key.id,
        'file': tree.source.file,
        'line': tree.source.position(tree.offset)[0],
        'main': is_main(library, key),
        'nodes': [_node_as_json(item) for item in items_of(library, key, expand=expand)],
    }


def _node_as_json(item: Item) -> dict[str, Any]:
    line, column = item.tree.source.position(item.node.offset)
    return {
        'parent': item.parent,
        'depth': item.depth,
        'kind': item.kind.value,
        'type': item.type,
        'name': item.node.name,
        'ports': {
            port: {
                'direction': direction.value if (direction := item.direction(port)) else None,
                'text': value.text,
                'key': value.key,
                'given': port in item.node.offsets,
            }
            for port, value in item.node.values.items()
        },
        'autoremap': item.node.autoremap,
        'conditions': {attribute: script.text for attribute, script in item.node.conditions.items()},
        'file': item.tree.source.file,
        'line': line,
        'column': column,
    }
