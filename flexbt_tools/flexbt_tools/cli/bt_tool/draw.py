# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool draw``: trees as a picture, by Graphviz, or as its source or that of Mermaid."""

from __future__ import annotations

import argparse

from flexbt_common.pictures import trees_as_dot, trees_as_mermaid
from flexbt_tools.cli import arguments, picture_output
from flexbt_tools.errors import ExitCode
from flexbt_tools.trees import drawn_nodes, items_of, read_library


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    arguments.add_trees(parser)
    picture_output.add_arguments(parser)
    arguments.add_ports(parser, 'none')
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    trees = [
        (key.id, drawn_nodes(items_of(library, key, expand=options.expand), options.ports))
        for key in arguments.chosen_trees(library, options)
    ]
    picture_output.write(options, lambda: trees_as_dot(trees), lambda: trees_as_mermaid(trees))
    return ExitCode.OK
