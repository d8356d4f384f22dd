# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool check``: everything that is wrong, or suspicious, in behaviors and between them and their trees."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from flexbt_core.behavior_tree import NodeRegistry
from flexbt_tools.cli import arguments, report
from flexbt_tools.cli.report import Reported
from flexbt_tools.errors import ExitCode

from . import built_behavior as behaviors
from . import machine_rules, tree_rules
from . import used_trees as trees
from .built_behavior import BuiltBehavior
from .findings import REFUSED, RULES, Finding

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
    report.add_arguments(parser, [rule for rule in RULES if rule is not REFUSED])


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    entries = behaviors.installed(options.names)
    parameters = behaviors.parameters(options)
    reported = [
        Reported(one.rule, one.text(entry.name), one.to_json(entry.name))
        for entry in entries
        for one in check(behaviors.build(entry, parameters), options.trees, registry)
    ]
    return report.report(options, reported, 'behavior', len(entries))
