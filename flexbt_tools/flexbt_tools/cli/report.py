# SPDX-License-Identifier: BSD-3-Clause
"""How a command that checks tells what it has found: as lines or as JSON, with a summary and an exit code."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from typing import Any, NamedTuple

from flexbt_core.values import counted
from flexbt_tools.errors import ExitCode
from flexbt_tools.tree_checks import Rule, Severity

from . import arguments


class Reported(NamedTuple):
    """A finding as it is reported: as a line of text, or as an object of JSON."""

    rule: Rule
    line: str
    document: dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser, ignorable: Iterable[Rule]) -> None:
    """What counts and how it is told: ``options.ignore``, ``options.remarks``, ``options.strict``, ``options.json``."""
    parser.add_argument(
        '--ignore',
        metavar='RULE',
        action='append',
        default=[],
        choices=[rule.name for rule in ignorable],
        help='do not look for this; repeatable: %(choices)s',
    )
    parser.add_argument('--remarks', action='store_true', help='print what is only a remark, too (info)')
    parser.add_argument('--strict', action='store_true', help='warnings count as errors do for the exit code')
    arguments.add_json(parser)


def report(options: argparse.Namespace, found: Iterable[Reported], noun: str, number: int) -> ExitCode:
    """Print what was found in a ``number`` of things, for each of which the ``noun`` stands: errors first, and remarks
    only where they are asked for."""
    kept = [one for one in found if one.rule.name not in options.ignore]
    order = list(Severity)
    shown = sorted(kept, key=lambda one: order.index(one.rule.severity))
    counts = {severity: sum(one.rule.severity is severity for one in shown) for severity in Severity}
    if options.json:
        summary = {f'{noun}s': number, **{severity.value: count for severity, count in counts.items()}}
        print(json.dumps({'findings': [one.document for one in shown], 'summary': summary}))
    else:
        for one in shown:
            if options.remarks or one.rule.severity is not Severity.INFO:
                print(one.line)
        parts = [_counted(count, severity) for severity, count in counts.items() if count]
        more = '; --remarks prints the info' if counts[Severity.INFO] and not options.remarks else ''
        print(f'{counted(number, noun)}: {", ".join(parts) or "no problems found"}{more}', file=sys.stderr)
    bad = counts[Severity.ERROR] + (counts[Severity.WARNING] if options.strict else 0)
    return ExitCode.NEGATIVE if bad else ExitCode.OK


def _counted(count: int, severity: Severity) -> str:
    return f'{count} {severity.value}' if severity is Severity.INFO else counted(count, severity.value)
