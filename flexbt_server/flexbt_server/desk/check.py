# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check``: everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from flexbt_server.behavior_tree import NodeRegistry
from flexbt_server.desk import arguments
from flexbt_server.desk.diagnostics import REFUSED, RULES, Diagnostic, Severity
from flexbt_server.desk.errors import ExitCode, RefusedError
from flexbt_server.desk.files import read_library, shown_name
from flexbt_server.desk.lint import findings


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
    parser.add_argument(
        '--ignore',
        metavar='RULE',
        action='append',
        default=[],
        choices=[rule.name for rule in RULES if rule.severity is not Severity.ERROR],
        help='do not look for this; repeatable: %(choices)s',
    )
    parser.add_argument('--strict', action='store_true', help='warnings count as errors do for the exit code')
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    found = check(options.files, registry, options.input, shared=options.shared)
    found = [one for one in found if one.rule.name not in options.ignore]
    counts = {severity: sum(one.rule.severity is severity for one in found) for severity in Severity}
    if options.json:
        summary = {'files': len(options.files), **{severity.value: count for severity, count in counts.items()}}
        print(json.dumps({'findings': [one.to_json() for one in found], 'summary': summary}))
    else:
        for one in found:
            print(one)
        print(_summary(len(options.files), counts), file=sys.stderr)
    bad = counts[Severity.ERROR] + (counts[Severity.WARNING] if options.strict else 0)
    return ExitCode.NEGATIVE if bad else ExitCode.OK


def _summary(files: int, counts: dict[Severity, int]) -> str:
    found = ', '.join(
        f'{count} {severity.value}{"s" if count != 1 and severity is not Severity.INFO else ""}'
        for severity, count in counts.items()
        if count
    )
    return f'{files} file{"" if files == 1 else "s"}: {found or "nothing to complain about"}'
