# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool check``: everything that is wrong, or suspicious, in behaviors and between them and their trees."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from flexbt_desk import behaviors, machine_rules, tree_rules, trees
from flexbt_desk.behaviors import BuiltBehavior
from flexbt_desk.findings import REFUSED, RULES, Finding
from flexbt_server.behavior_tree import NodeRegistry
from flexbt_server.desk import arguments
from flexbt_server.desk.diagnostics import Severity
from flexbt_server.desk.errors import ExitCode

_ORDER = {rule.name: index for index, rule in enumerate(RULES)}


def check(behavior: BuiltBehavior, files: Sequence[str], registry: NodeRegistry) -> list[Finding]:
    """What is found in a behavior: errors first. ``files`` are tree files that the BT server has besides."""
    if behavior.machine is None:
        return [Finding(REFUSED, '', problem) for problem in behavior.problems]
    used = trees.used_trees(behavior.machine, files, registry)
    found = [*used.findings, *machine_rules.findings_of(behavior.machine), *tree_rules.findings_of(used)]
    return sorted(dict.fromkeys(found), key=lambda one: _ORDER[one.rule.name])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('names', metavar='NAME', nargs='*', help='installed behavior (default: all)')
    behaviors.add_arguments(parser)
    trees.add_arguments(parser)
    arguments.add_node_types(parser)
    parser.add_argument(
        '--ignore',
        metavar='RULE',
        action='append',
        default=[],
        choices=[rule.name for rule in RULES if rule is not REFUSED],
        help='do not look for this; repeatable: %(choices)s',
    )
    parser.add_argument('--strict', action='store_true', help='warnings count as errors do for the exit code')
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    entries = behaviors.installed(options.names)
    parameters = behaviors.parameters(options)
    found = [
        (entry.name, one)
        for entry in entries
        for one in check(behaviors.build(entry, parameters), options.trees, registry)
        if one.rule.name not in options.ignore
    ]
    counts = {severity: sum(one.rule.severity is severity for _, one in found) for severity in Severity}
    if options.json:
        summary = {'behaviors': len(entries), **{severity.value: count for severity, count in counts.items()}}
        print(json.dumps({'findings': [one.to_json(name) for name, one in found], 'summary': summary}))
    else:
        for name, one in found:
            print(one.text(name))
        print(_summary(len(entries), counts), file=sys.stderr)
    bad = counts[Severity.ERROR] + (counts[Severity.WARNING] if options.strict else 0)
    return ExitCode.NEGATIVE if bad else ExitCode.OK


def _summary(behaviors: int, counts: dict[Severity, int]) -> str:
    found = ', '.join(f'{count} {severity.value}' for severity, count in counts.items() if count)
    return f'{behaviors} behavior{"" if behaviors == 1 else "s"}: {found or "nothing to complain about"}'
