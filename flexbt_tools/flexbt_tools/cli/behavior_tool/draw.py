# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool draw``: a behavior as a picture, the trees of its states included."""

from __future__ import annotations

import argparse

from flexbt_common.pictures import machine_as_dot, machine_as_mermaid
from flexbt_core.values import read_text
from flexbt_tools.behaviors import UsedTrees, graph_of, machine_file, reasons, used_trees
from flexbt_tools.cli import arguments, picture_output
from flexbt_tools.errors import ExitCode

from .behavior_arguments import add_parameters, add_tree_files, built


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('name', metavar='NAME', help='installed behavior, or file (.yaml) of a machine')
    add_parameters(parser)
    picture_output.add_arguments(parser)
    parser.add_argument('--no-trees', action='store_true', help='only the state machine')
    parser.add_argument('--expand', action='store_true', help='sub-trees in their place')
    arguments.add_ports(parser, 'none')
    add_tree_files(parser)
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    behavior = built(options, options.name)
    assert behavior.machine is not None
    used = UsedTrees()
    if not options.no_trees:
        used = used_trees(behavior.machine, options.trees, arguments.registry(options, allow_unknown=True))
    file = machine_file(options.name)
    why = {} if file is None else reasons(read_text(file))
    graph = graph_of(behavior.machine, used, expand=options.expand, ports=options.ports, reasons=why)
    picture_output.write(
        options, lambda: machine_as_dot(graph, behavior.name), lambda: machine_as_mermaid(graph, behavior.name)
    )
    return ExitCode.OK
