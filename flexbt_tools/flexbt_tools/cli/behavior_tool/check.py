# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool check``: everything that is wrong, or suspicious, in behaviors and between them and their trees."""

from __future__ import annotations

import argparse

from flexbt_tools.behaviors import REFUSED, RULES, behavior_entry, build, check_behavior, installed
from flexbt_tools.cli import Reported, arguments, report
from flexbt_tools.errors import ExitCode

from .behavior_arguments import add_parameters, add_tree_files, parameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'names',
        metavar='NAME',
        nargs='*',
        help='installed behavior, or file (.yaml) of a machine (default: all installed)',
    )
    add_parameters(parser)
    add_tree_files(parser)
    arguments.add_inputs(parser)
    arguments.add_node_types(parser)
    arguments.add_skills(parser)
    report.add_arguments(parser, [rule for rule in RULES if rule is not REFUSED])


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    skills = arguments.skill_library(options.skills, registry)
    entries = [behavior_entry(name) for name in options.names] or installed([])
    arguments_of = parameters(options)
    reported = [
        Reported(one.rule, one.text(entry.name), one.to_json(entry.name))
        for entry in entries
        for one in check_behavior(build(entry, arguments_of), options.trees, registry, skills, options.input)
    ]
    return report.report(options, reported, 'behavior', len(entries))
