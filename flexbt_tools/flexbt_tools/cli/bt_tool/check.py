# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check``: everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

import argparse

from flexbt_tools.cli import Reported, arguments, report
from flexbt_tools.errors import ExitCode
from flexbt_tools.tree_checks import REFUSED, RULES, check_trees, joined


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    arguments.add_node_types(parser)
    arguments.add_inputs(parser)
    arguments.add_skills(parser)
    parser.add_argument('--shared', action='store_true', help='all trees run on one blackboard, as the server does it')
    report.add_arguments(parser, [rule for rule in RULES if rule is not REFUSED])


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    skills = arguments.skill_library(options.skills, registry)
    found = check_trees(options.files, registry, options.input, shared=options.shared, skills=skills)
    reported = [Reported(one.rule, str(one), one.to_json()) for one in (found if options.json else joined(found))]
    return report.report(options, reported, 'file', len(options.files))
