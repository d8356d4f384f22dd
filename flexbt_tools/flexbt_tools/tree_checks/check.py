# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check``: everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from flexbt_core.behavior_tree import NodeRegistry
from flexbt_tools.cli import arguments, report
from flexbt_tools.cli.report import Reported
from flexbt_tools.errors import ExitCode, RefusedError
from flexbt_tools.trees.files import read_library, shown_name

from .diagnostics import REFUSED, RULES, Diagnostic, Severity
from .lint import findings


def check(
    files: Sequence[str], registry: NodeRegistry, inputs: Sequence[str] = (), *, shared: bool = False
) -> list[Diagnostic]:
    """What is found in the files, in the order of files and places. Findings that are no errors are looked for when
    there are no errors."""
    try:
        library = read_library(files, registry)
    except RefusedError as error:
        found = [Diagnostic(REFUSED, reason) for reason in error.errors]
    else:
        found = list(dict.fromkeys(findings(library, inputs, shared=shared)))
    order = {shown_name(file): index for index, file in enumerate(files)}
    return sorted(
        found,
        key=lambda one: (order.get(one.place.file, len(order)), one.place.file, one.place.line, one.place.column),
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    arguments.add_node_types(parser)
    parser.add_argument(
        '--input',
        metavar='KEY',
        action='append',
        default=[],
        help='a key that is written from outside; repeatable',
    )
    parser.add_argument('--shared', action='store_true', help='all trees run on one blackboard, as the server does it')
    report.add_arguments(parser, [rule for rule in RULES if rule.severity is not Severity.ERROR])


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    found = check(options.files, registry, options.input, shared=options.shared)
    reported = [Reported(one.rule, str(one), one.to_json()) for one in found]
    return report.report(options, reported, 'file', len(options.files))
