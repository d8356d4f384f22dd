# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool model``: what node types there are, for editors: a TreeNodesModel, or an XML schema."""

from __future__ import annotations

import argparse

from flexbt_core.behavior_tree import NodeKind, builtin_registry
from flexbt_server.groot2 import models_document
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode
from flexbt_tools.trees import schema_lines


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--builtin', action='store_true', help='also the nodes of BehaviorTree.CPP, which Groot2 knows')
    parser.add_argument(
        '--xsd',
        action='store_true',
        help='an XML schema of tree files instead, of all node types, for any XML editor',
    )
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=False)
    manifests = sorted(
        (manifest for manifest in registry if manifest.kind is not NodeKind.SUBTREE), key=lambda manifest: manifest.id
    )
    if options.xsd:
        lines = schema_lines(manifests)
    else:
        known = builtin_registry()
        lines = models_document(manifest for manifest in manifests if options.builtin or manifest.id not in known)
    for line in lines:
        print(line)
    return ExitCode.OK
