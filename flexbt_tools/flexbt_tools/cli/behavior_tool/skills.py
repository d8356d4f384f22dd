# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool skills``: manifests of states in files: checked, shown, and as capabilities for a synthesis."""

from __future__ import annotations

import argparse

from flexbt_core.skills import SkillError, SkillLibrary, capability_file, literals
from flexbt_tools.cli import skill_output
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.skills import read_skill_files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('files', metavar='FILE', nargs='+', help='YAML file of manifests')
    parser.add_argument(
        '--start',
        metavar='LITERAL',
        action='append',
        default=[],
        help='what holds at the start, as in "at(kitchen)"; for --capabilities; repeatable',
    )
    skill_output.add_arguments(parser).add_argument(
        '--capabilities', metavar='NAME', help='print a capability file of this name, for behavior_tool synthesize'
    )


def run(options: argparse.Namespace) -> ExitCode:
    library = skill_output.chosen(read_skill_files(options.files, SkillLibrary()), options)
    if options.capabilities is None:
        skill_output.show(library, options)
        return ExitCode.OK
    try:
        print(capability_file(library, literals(options.start), options.capabilities), end='')
    except SkillError as error:
        raise UsageError(str(error)) from error
    return ExitCode.OK
