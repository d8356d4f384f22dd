# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool skills``: what leaves need, what they bring about, and how they may fail."""

from __future__ import annotations

import argparse

from flexbt_tools.cli import arguments, skill_output
from flexbt_tools.errors import ExitCode


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'files', metavar='FILE', nargs='*', help='YAML file of manifests, which adds to what the classes declare'
    )
    arguments.add_node_types(parser, allow_unknown=False)
    skill_output.add_arguments(parser)


def run(options: argparse.Namespace) -> ExitCode:
    known = arguments.registry(options, allow_unknown=False)
    skill_output.show(skill_output.chosen(arguments.skill_library(options.files, known), options), options)
    return ExitCode.OK
