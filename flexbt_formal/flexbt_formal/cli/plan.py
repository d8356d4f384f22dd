# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool plan``: plan a goal from manifests and a start; write a reactive tree, a report or a map."""

from __future__ import annotations

import argparse
import gzip
import io
import json
import math
import sys
import textwrap
import zlib
from pathlib import Path
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import tree_name_problem
from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.skills.literals import SkillError
from flexbt_core.values.findings import finding_record
from flexbt_core.values.text import escape_lines, one_line, pluralize, short_repr
from flexbt_core.values.text_files import open_regular
from flexbt_formal.planning.goal import conditions, parse_goal
from flexbt_formal.planning.missions import check_start, skill_problem
from flexbt_formal.planning.planner import Plan, plan
from flexbt_formal.planning.problem import PlanningError, PlanningProblem, read_scene
from flexbt_formal.planning.search import SearchOutcome, SearchProgress
from flexbt_formal.planning.team import Team, TeamPlan, plan_team, team_problem
from flexbt_formal.planning.tree_xml import tree_xml
from flexbt_formal.requests.missions import mission_problems, mission_skills, read_mission_file
from flexbt_tools.cli import arguments
from flexbt_tools.cli.output import PICTURES
from flexbt_tools.errors import ExitCode, RefusedError, UsageError
from flexbt_tools.files import read_text_file, write_text_file

from .region_picture import draw_plan

_MOST_BYTES: Final = 100_000_000
_WIDTH: Final = 120
"""Maximum line length of the summary."""
_EXIT_CODES: Final = {
    SearchOutcome.SOLVED: ExitCode.OK,
    SearchOutcome.UNSOLVABLE: ExitCode.NEGATIVE,
    SearchOutcome.TIME_LIMIT: ExitCode.UNFINISHED,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'mission',
        metavar='FILE',
        help='mission (YAML: skills, start, goal, disturbances; robots), or scene of BTPG (JSON, beside its actions)',
    )
    parser.add_argument('--goal', metavar='GOAL', help="replaces the file's: '(on(cup, table) | held) & !open(door)'")
    parser.add_argument(
        '--start',
        metavar='LITERAL',
        action='append',
        help="literal that holds at the start; replaces the file's; repeatable",
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write the tree to (default: standard output)')
    parser.add_argument(
        '--draw',
        metavar='FILE',
        type=arguments.picture(*PICTURES),
        help='draw the plan as a map of states and actions: SVG, .dot or .mmd',
    )
    parser.add_argument(
        '--name', metavar='ID', type=_tree_id, default='Plan', help='ID of the tree (default: %(default)s)'
    )
    arguments.add_number(parser, '--time-limit', 'SECONDS', 60.0, 'time for planning')
    disturbed = 'number of disturbances that the tree is planned and tested for'
    arguments.add_number(parser, '--disturbed', 'NUMBER', 1, disturbed, _number)
    parser.add_argument('--quiet', action='store_true', help='print no progress and no summary')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def _tree_id(text: str) -> str:
    problem = tree_name_problem(text)
    if problem:
        raise argparse.ArgumentTypeError(problem)
    return text


def _number(text: str) -> int:
    if not text.isdecimal() or len(text) > 3:
        raise argparse.ArgumentTypeError(f'{short_repr(text)} is not a number from 0 to 999')
    return int(text)


def run(options: argparse.Namespace) -> ExitCode:
    report = None if options.quiet else _show_progress
    found: Plan
    try:
        problem = _problem(options)
        if isinstance(problem, Team):
            found = plan_team(problem, time_limit=options.time_limit, disturbed=options.disturbed, report=report)
        else:
            found = plan(problem, time_limit=options.time_limit, disturbed=options.disturbed, report=report)
        text = tree_xml(found, options.name) if found.policy is not None else None
    except PlanningError as error:
        raise RefusedError([LoadError(options.mission, 1, 1, '', str(error))]) from error
    if options.output is not None and text is not None:
        write_text_file(options.output, text)
    if options.draw is not None and text is not None:
        draw_plan(options.draw, found)
    if options.json:
        print(json.dumps(plan_document(found, text)))
    elif text is not None and options.output is None:
        print(text, end='')
    if not options.quiet and not options.json:
        for line in plan_summary(found):
            for row in escape_lines(line):
                print(textwrap.fill(row, _WIDTH, break_on_hyphens=False, subsequent_indent='  '), file=sys.stderr)
    if found.coverage is not None and not found.coverage.complete:
        return ExitCode.UNFINISHED
    return _EXIT_CODES[found.outcome]


def _problem(options: argparse.Namespace) -> PlanningProblem | Team:
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
        check_start(library, start)
        if mission.robots:
            return team_problem(library, start, goal, mission.robots, mission.disturbances)
        return skill_problem(library, start, goal, mission.disturbances)
    except (PlanningError, SkillError) as error:
        given = [name for name in ('goal', 'start') if getattr(options, name) is not None]
        located, words = mission_problems(options.mission, mission, error, given)
        if words:
            raise UsageError('\n'.join(f'--{one}' for one in words)) from error
        raise RefusedError(located) from error


def _scene(options: argparse.Namespace) -> PlanningProblem:
    actions = Path(options.mission.removesuffix('.json') + '.actions.jsonl.gz')
    try:
        with open(actions, 'rb', opener=open_regular) as file, gzip.open(file) as packed:
            data = packed.read(_MOST_BYTES + 1)
        text = data.decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise UsageError(f'{actions}: cannot be read: {error}') from error
    if len(data) > _MOST_BYTES:
        raise UsageError(f'{actions}: longer than {_MOST_BYTES} bytes; give a smaller scene')
    if options.goal is None:
        raise UsageError("a scene has no goal; say one: --goal 'IsOn(milk,kitchentable) & IsClean(stove)'")
    found, initial = read_scene(read_text_file(options.mission, _MOST_BYTES), io.StringIO(text), options.mission)
    start = initial if options.start is None else frozenset(options.start)
    return PlanningProblem(found, start, conditions(parse_goal(options.goal)))


def _show_progress(progress: SearchProgress) -> None:
    best = 'none yet' if progress.best is None else f'{progress.best:g}'
    print(
        one_line(
            f'{progress.seconds:.1f} s: no plan costs less than {progress.bound:g}, the best so far: {best}; '
            f'{progress.expanded} conditions'
        ),
        file=sys.stderr,
    )


# The result of planning, as text for people and as a document for programs.

_MOST_WAYS: Final = 5


def plan_summary(found: Plan) -> list[str]:
    """Return the lines of a summary: the plan and the coverage of its test, or the reason why no plan was found."""
    spent = f'{found.expanded} conditions, {found.seconds:.2f} s'
    if found.policy is None or found.coverage is None:
        if found.outcome is SearchOutcome.TIME_LIMIT:
            return [f'no plan within the time limit; none costs less than {found.bound:g} ({spent})']
        return [f'there is no plan: {found.reason} ({spent})']
    coverage = found.coverage
    shown = _team(found) if isinstance(found, TeamPlan) else _robot(found)
    tried = f'tried in {coverage.states} states ({"all" if coverage.complete else "not all"} that may come with'
    times = pluralize(coverage.disturbed, 'disturbance')
    if isinstance(found, TeamPlan):
        times += ', a lost robot among them' if coverage.disturbed and len(found.team.robots) > 1 else ''
        times += ', whichever action ends first'
    shown.append(
        f'{len(found.policy.branches)} branches; {tried} {times}): '
        f'the goal is {coverage.longest} actions away at most ({spent})'
    )
    ways = sorted(found.hopeless, key=len)
    shown += [f'no way to the goal after: {", ".join(way)}' for way in ways[:_MOST_WAYS]]
    if len(ways) > _MOST_WAYS:
        shown.append(f'... and after {len(ways) - _MOST_WAYS} more, which --json lists')
    return shown


def plan_document(found: Plan, text: str | None) -> dict[str, Any]:
    """Return the result of planning as plain data for JSON; ``text`` is the XML of the tree."""
    team: dict[str, Any] = {}
    if isinstance(found, TeamPlan):
        team = {
            'duration': found.duration,
            'least_duration': None if found.least_duration == math.inf else found.least_duration,
            'alone': found.alone,
            'tasks': [task._asdict() for task in found.tasks],
            'unlimited': found.unlimited,
        }
    coverage = found.coverage
    problem = found.reason or ('no plan within the time limit' if found.policy is None else '')
    return {
        'findings': [finding_record('no-plan', 'error', problem)] if problem else [],
        'outcome': found.outcome.value,
        'cost': found.cost,
        'bound': None if found.bound == math.inf else found.bound,
        'actions': found.actions,
        **team,
        'reason': found.reason,
        'branches': 0 if found.policy is None else len(found.policy.branches),
        'expanded': found.expanded,
        'seconds': found.seconds,
        'coverage': coverage
        and {
            'disturbances': coverage.disturbed,
            'states': coverage.states,
            'complete': coverage.complete,
            'longest': coverage.longest,
        },
        'hopeless': found.hopeless,
        'tree': text,
    }


def _robot(found: Plan) -> list[str]:
    optimal = (
        'the least'
        if found.outcome is SearchOutcome.SOLVED
        else f'not proved to be the least, {found.bound:g} at least'
    )
    return [f'cost {found.cost:g} ({optimal}), {len(found.actions)} actions: {", ".join(found.actions) or "none"}']


def _team(found: TeamPlan) -> list[str]:
    alone = ', '.join(f'{robot} alone: {_cost(cost)}' for robot, cost in (found.alone or {}).items())
    shown = [
        f'done after {found.duration:g} ({found.least_duration:g} at least; {alone}), '
        f'cost {found.cost:g} together ({found.bound:g} at least), {len(found.tasks)} actions'
    ]
    for robot in found.team.robots:
        tasks = [f'{task.begins:g}–{task.ends:g} {task.action}' for task in found.tasks if task.robot == robot]
        shown.append(f'{robot}: {", ".join(tasks) or "nothing"}')
    if found.unlimited and len(found.team.robots) > 1:
        shown.append(
            f'no deadline: {", ".join(found.unlimited)}; where one of these never ends, the others wait for its robot: '
            'give it a deadline (s) in its manifest, after which they do without the robot'
        )
    return shown


def _cost(cost: float | None) -> str:
    return 'no way' if cost is None else f'{cost:g}'
