# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``behavior_tool`` and its commands."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Final

from flexbt_common.pictures.machine_picture import machine_as_dot, machine_as_mermaid
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import SkillError, parse_literals
from flexbt_core.skills.yaml_files import capability_file
from flexbt_core.values.text_files import read_text
from flexbt_tools.behaviors.built_behavior import (
    BuiltBehavior,
    UsedTrees,
    behavior_entries,
    behavior_entry,
    build,
    installed,
    machine_file,
    used_trees,
)
from flexbt_tools.behaviors.check import check_behavior
from flexbt_tools.behaviors.findings import REFUSED, RULES
from flexbt_tools.behaviors.rendering import graph_of, machine_lines, reasons, structure_as_json
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.files import read_skill_files

from . import arguments
from .command import ToolCommand, run_command
from .output import (
    Reported,
    add_picture_arguments,
    add_report_arguments,
    add_skill_arguments,
    chosen_skills,
    output_picture,
    print_skills,
    report_findings,
)


def add_behavior(parser: argparse.ArgumentParser) -> None:
    """Add ``options.name``: a behavior; and ``options.parameters``."""
    parser.add_argument('name', metavar='NAME', help='installed behavior, or file (.yaml, .py, .py:CLASS) of one')
    add_parameters(parser)


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add ``options.parameters``: values of the behavior's parameters."""
    parser.add_argument(
        '--param',
        metavar='NAME=VALUE',
        dest='parameters',
        action='append',
        default=[],
        help='value of a parameter of the behavior; repeatable (others keep their defaults)',
    )


def parameters(options: argparse.Namespace) -> list[tuple[str, str]]:
    """Return pairs of name and text. Raises UsageError."""
    pairs = []
    for text in options.parameters:
        name, equals, value = text.partition('=')
        if not equals:
            raise UsageError(f'--param {text}: write NAME=VALUE')
        pairs.append((name, value))
    return pairs


def add_tree_files(parser: argparse.ArgumentParser) -> None:
    """Add ``options.trees``: files that the behavior does not load itself."""
    arguments.add_list(parser, '--trees', 'FILE', 'tree file that the BT server has already loaded')


def built(options: argparse.Namespace, name: str) -> BuiltBehavior:
    """Return the behavior with this name or file. Raises UsageError if it cannot be built."""
    behavior = build(behavior_entry(name), parameters(options))
    if behavior.machine is None:
        raise UsageError('\n'.join(f'{behavior.name}: {problem}' for problem in behavior.problems))
    return behavior


# ``behavior_tool check``: errors and suspicious parts of behaviors, also between them and their trees.


def add_check_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'names',
        metavar='NAME',
        nargs='*',
        help='installed behavior, or file (.yaml, .py) of one (default: all installed); a Python file is imported',
    )
    add_parameters(parser)
    add_tree_files(parser)
    arguments.add_inputs(parser)
    arguments.add_node_types(parser)
    arguments.add_skills(parser)
    add_report_arguments(parser, [rule for rule in RULES if rule is not REFUSED])


def run_check(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    skills = arguments.skill_library(options.skills, registry)
    entries = [one for name in options.names for one in behavior_entries(name)] or installed([])
    arguments_of = parameters(options)
    reported = [
        Reported(one.rule, one.text(entry.name), one.to_json(entry.name))
        for entry in entries
        for one in check_behavior(build(entry, arguments_of), options.trees, registry, skills, options.input)
    ]
    return report_findings(options, reported, 'behavior', len(entries))


# ``behavior_tool show``: the state machine of a behavior as text.


def add_show_arguments(parser: argparse.ArgumentParser) -> None:
    add_behavior(parser)
    arguments.add_json(parser)


def run_show(options: argparse.Namespace) -> ExitCode:
    behavior = built(options, options.name)
    assert behavior.machine is not None
    if options.json:
        print(
            json.dumps(
                {'behavior': behavior.name, 'states': [structure_as_json(one) for one in behavior.machine.structure()]}
            )
        )
    else:
        for line in machine_lines(behavior):
            print(line)
    return ExitCode.OK


# ``behavior_tool skills``: check manifests of states in files, show them, or print capabilities for a synthesis.


def add_skills_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('files', metavar='FILE', nargs='+', help='YAML file of manifests')
    starts = 'literal that holds at the start, such as "at(kitchen)"; for --capabilities'
    arguments.add_list(parser, '--start', 'LITERAL', starts)
    add_skill_arguments(parser).add_argument(
        '--capabilities', metavar='NAME', help='print a capability file of this name, for behavior_tool synthesize'
    )


def run_skills(options: argparse.Namespace) -> ExitCode:
    library = chosen_skills(read_skill_files(options.files, SkillLibrary()), options)
    if options.capabilities is None:
        print_skills(library, options)
        return ExitCode.OK
    try:
        print(capability_file(library, parse_literals(options.start), options.capabilities), end='')
    except SkillError as error:
        raise UsageError(str(error)) from error
    return ExitCode.OK


# ``behavior_tool draw``: a behavior as a picture, including the trees of its states.


def add_draw_arguments(parser: argparse.ArgumentParser) -> None:
    add_behavior(parser)
    add_picture_arguments(parser)
    parser.add_argument('--no-trees', action='store_true', help='draw only the state machine')
    parser.add_argument('--expand', action='store_true', help='draw sub-trees in place')
    arguments.add_ports(parser, 'none')
    add_tree_files(parser)
    arguments.add_node_types(parser, allow_unknown=False)


def run_draw(options: argparse.Namespace) -> ExitCode:
    behavior = built(options, options.name)
    assert behavior.machine is not None
    used = UsedTrees()
    if not options.no_trees:
        used = used_trees(behavior.machine, options.trees, arguments.registry(options, allow_unknown=True))
    file = machine_file(options.name)
    why = {} if file is None else reasons(read_text(file))
    graph = graph_of(behavior.machine, used, expand=options.expand, ports=options.ports, reasons=why)
    output_picture(
        options, lambda: machine_as_dot(graph, behavior.name), lambda: machine_as_mermaid(graph, behavior.name)
    )
    return ExitCode.OK


# The executable ``behavior_tool``: its commands.

EXIT_CODES: Final = (
    ('0', 'nothing is wrong'),
    (
        '1',
        'check: there are errors, or with --strict warnings; prove: something is wrong; synthesize: no machine can do '
        'it',
    ),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('5', 'synthesize: no answer within the time limit; prove: nothing is wrong so far, but not all was followed'),
    ('6', 'prove: nothing goes wrong, but an outcome, a state, a node or the success of a tree can never be reached'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ToolCommand(
        'check',
        'find what is wrong, and what is suspicious, in behaviors and their trees',
        add_check_arguments,
        run_check,
    ),
    ToolCommand('show', 'show the state machine of a behavior as text', add_show_arguments, run_show),
    ToolCommand(
        'skills', 'check manifests of states, show them, or make capabilities of them', add_skills_arguments, run_skills
    ),
    ToolCommand('prove', 'follow all that can happen to a behavior, and tell what is wrong'),
    ToolCommand('draw', 'draw a behavior with its trees', add_draw_arguments, run_draw),
    ToolCommand('synthesize', 'make a state machine that reaches a goal, from capabilities, or tell why there is none'),
)


def main(words: Sequence[str] | None = None) -> int:
    """Run ``behavior_tool`` and return its exit code."""
    return run_command('behavior_tool', 'Behaviors, made and built but not run.', COMMANDS, EXIT_CODES, words)


# ``python3 -m flexbt_tools.cli.behavior_tool``, if the package is not installed as an executable.

if __name__ == '__main__':
    sys.exit(main())
