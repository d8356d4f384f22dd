# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool plan``: a goal, from manifests and a start, as a reactive tree."""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import textwrap
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree import LoadError
from flexbt_core.behavior_tree.model import tree_name_problem
from flexbt_core.skills import SkillError, clashes, parse_literal
from flexbt_core.values import lines, one_line, open_regular, shown
from flexbt_formal.missions import mission_problems, mission_skills, read_mission_file
from flexbt_formal.planning import (
    Outcome,
    Plan,
    PlanningError,
    Problem,
    Progress,
    Team,
    TeamPlan,
    conditions,
    parse_goal,
    plan,
    plan_team,
    read_scene,
    skill_problem,
    team_problem,
    team_xml,
    tree_xml,
)
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, RefusedError, UsageError
from flexbt_tools.text_files import read_text, write_text

from .plan_picture import draw_plan
from .plan_text import plan_document, plan_summary

_MOST_BYTES: Final = 100_000_000
_WIDTH: Final = 120
"""Characters of a line of the summary."""
_EXIT_CODES: Final = {
    Outcome.SOLVED: ExitCode.OK,
    Outcome.UNSOLVABLE: ExitCode.NEGATIVE,
    Outcome.TIME_LIMIT: ExitCode.UNFINISHED,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'mission',
        metavar='FILE',
        help='mission (YAML: skills, start, goal, disturbances; robots), or scene of BTPG (JSON, beside its actions)',
    )
    parser.add_argument('--goal', metavar='GOAL', help="instead of the file's: '(on(cup, table) | held) & !open(door)'")
    parser.add_argument(
        '--start', metavar='LITERAL', action='append', help="holds at the start, instead of the file's; repeatable"
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='the tree (default: the standard output)')
    parser.add_argument(
        '--draw', metavar='FILE', help='draw what is done in which states, and what may come: SVG, .dot or .mmd'
    )
    parser.add_argument(
        '--name', metavar='ID', type=_tree_id, default='Plan', help='of the tree (default: %(default)s)'
    )
    parser.add_argument(
        '--time-limit',
        metavar='SECONDS',
        type=arguments.positive,
        default=60.0,
        help='for planning (default: %(default)g)',
    )
    parser.add_argument(
        '--disturbed',
        metavar='NUMBER',
        type=_number,
        default=1,
        help='times that others may disturb, for which the tree is planned and tried (default: %(default)s)',
    )
    parser.add_argument('--quiet', action='store_true', help='no progress, and no summary')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def _tree_id(text: str) -> str:
    problem = tree_name_problem(text)
    if problem:
        raise argparse.ArgumentTypeError(problem)
    return text


def _number(text: str) -> int:
    if not text.isdecimal() or len(text) > 3:
        raise argparse.ArgumentTypeError(f'{shown(text)} is no number from 0 to 999')
    return int(text)


def run(options: argparse.Namespace) -> ExitCode:
    report = None if options.quiet else _show_progress
    found: Plan | TeamPlan
    text: str | None = None
    try:
        problem = _problem(options)
        if isinstance(problem, Team):
            found = plan_team(problem, time_limit=options.time_limit, disturbed=options.disturbed, report=report)
            text = team_xml(found, options.name) if found.policy is not None else None
        else:
            found = plan(problem, time_limit=options.time_limit, disturbed=options.disturbed, report=report)
            text = tree_xml(found, options.name) if found.policy is not None else None
    except PlanningError as error:
        raise RefusedError([LoadError(options.mission, 1, 1, '', str(error))]) from error
    if options.output is not None and text is not None:
        write_text(options.output, text)
    if options.draw is not None and text is not None:
        draw_plan(options.draw, found)
    if options.json:
        print(json.dumps(plan_document(found, text)))
    elif text is not None and options.output is None:
        print(text, end='')
    if not options.quiet and not options.json:
        for line in plan_summary(found):
            for row in lines(line):
                print(textwrap.fill(row, _WIDTH, break_on_hyphens=False, subsequent_indent='  '), file=sys.stderr)
    if found.coverage is not None and not found.coverage.complete:
        return ExitCode.UNFINISHED
    return _EXIT_CODES[found.outcome]


def _problem(options: argparse.Namespace) -> Problem | Team:
    if options.mission.endswith('.json'):
        return _scene(options)
    mission = read_mission_file(options.mission)
    known = arguments.registry(options, allow_unknown=False)
    library = mission_skills(options.mission, mission, arguments.skill_library([], known))
    goal = mission.goal if options.goal is None else options.goal
    if not goal:
        raise UsageError(f"{options.mission} names no goal; add it there (goal: ...), or say --goal 'on(cup, table)'")
    start = mission.start if options.start is None else options.start
    try:
        for one, other in clashes(library, map(parse_literal, start)):
            raise SkillError([f'start: {one} and {other} cannot hold at once ({one.predicate} is exclusive): name one'])
        if mission.robots:
            return team_problem(library, start, goal, mission.robots, mission.disturbances)
        return skill_problem(library, start, goal, mission.disturbances)
    except (PlanningError, SkillError) as error:
        given = [name for name in ('goal', 'start') if getattr(options, name) is not None]
        located, words = mission_problems(options.mission, mission, error, given)
        if words:
            raise UsageError('\n'.join(f'--{one}' for one in words)) from error
        raise RefusedError(located) from error


def _scene(options: argparse.Namespace) -> Problem:
    actions = Path(options.mission.removesuffix('.json') + '.actions.jsonl.gz')
    try:
        with open(actions, 'rb', opener=open_regular) as file, gzip.open(file) as packed:
            data = packed.read(_MOST_BYTES + 1)
        text = data.decode()
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise UsageError(f'{actions}: cannot be read: {error}') from error
    if len(data) > _MOST_BYTES:
        raise UsageError(f'{actions}: longer than {_MOST_BYTES} bytes; give a smaller scene')
    if options.goal is None:
        raise UsageError("a scene has no goal; say one: --goal 'IsOn(milk,kitchentable) & IsClean(stove)'")
    found, initial = read_scene(read_text(options.mission, _MOST_BYTES), text.splitlines(), options.mission)
    start = initial if options.start is None else frozenset(options.start)
    return Problem(found, start, conditions(parse_goal(options.goal)))


def _show_progress(progress: Progress) -> None:
    best = 'none yet' if progress.best is None else f'{progress.best:g}'
    print(
        one_line(
            f'{progress.seconds:.1f} s: no plan costs less than {progress.bound:g}, the best so far: {best}; '
            f'{progress.expanded} conditions'
        ),
        file=sys.stderr,
    )
