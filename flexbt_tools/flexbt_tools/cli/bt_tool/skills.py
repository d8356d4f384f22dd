# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool skills``: what leaves need, what they bring about, and how they may fail."""

from __future__ import annotations

import argparse
import sys

from flexbt_core.values import one_line
from flexbt_tools.cli import arguments, skill_output
from flexbt_tools.errors import ExitCode
from flexbt_tools.skills import read_skill_files, unknown_names, unreached_ports


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'files', metavar='FILE', nargs='*', help='YAML file of manifests, which adds to what the classes declare'
    )
    arguments.add_node_types(parser, allow_unknown=False)
    skill_output.add_arguments(parser)


def run(options: argparse.Namespace) -> ExitCode:
    known = arguments.registry(options, allow_unknown=False)
    base = arguments.skill_library([], known)
    library = read_skill_files(options.files, base)
    skill_output.show(skill_output.chosen(library, options), options)
    for line in unreached_ports(library, base, known):
        print(one_line(f'note: {line}'), file=sys.stderr)
    doubtful = list(unknown_names(library, base, known))
    for line in doubtful:
        print(one_line(f'warning: {line}'), file=sys.stderr)
    return ExitCode.NEGATIVE if doubtful else ExitCode.OK
