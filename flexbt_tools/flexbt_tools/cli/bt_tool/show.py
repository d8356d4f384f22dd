# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool show``: trees as text."""

from __future__ import annotations

import argparse
import json
import shutil
from collections.abc import Iterator
from typing import Final

from flexbt_core.behavior_tree import TreeKey, TreeLibrary
from flexbt_core.values import one_line
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode
from flexbt_tools.trees import is_main, items_of, read_library, tree_as_json, tree_lines

_WIDTH: Final = 120
"""Characters of a line where there is no terminal."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    arguments.add_trees(parser)
    arguments.add_ports(parser, 'given')
    parser.add_argument('--ascii', action='store_true', help='only ASCII characters')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> ExitCode:
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    keys = arguments.chosen_trees(library, options)
    if options.json:
        print(json.dumps({'trees': [tree_as_json(library, key, expand=options.expand) for key in keys]}))
        return ExitCode.OK
    for index, key in enumerate(keys):
        if index:
            print()
        for line in _tree(library, key, options):
            print(line.encode('ascii', 'backslashreplace').decode() if options.ascii else line)
    return ExitCode.OK


def _tree(library: TreeLibrary, key: TreeKey, options: argparse.Namespace) -> Iterator[str]:
    tree = library.definition(key)
    main = ' (main)' if is_main(library, key) else ''
    place = f'{tree.source.file}:{tree.source.position(tree.offset)[0]}'
    yield one_line(f'{key.id}{main}  {place}')
    items = items_of(library, key, expand=options.expand)
    width = shutil.get_terminal_size((_WIDTH, 0)).columns
    yield from tree_lines(items, options.ports, ascii_only=options.ascii, width=width)
