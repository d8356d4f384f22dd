# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``bt_tool`` and its commands. Needs no ROS."""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime
from pathlib import Path
from string import Template
from typing import Final

from flexbt_common.pictures.tree_picture import trees_as_dot, trees_as_mermaid
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import ScriptError
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.script.parser import parse_script
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import ConditionSensor, Predicate
from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_server.groot2.log_file import SUFFIX, LogContent, LogError, LoggedNode, read_log
from flexbt_server.groot2.protocol import models_document
from flexbt_tools.errors import ExitCode, UnfitError, UsageError
from flexbt_tools.files import read_skill_files
from flexbt_tools.mock_runs.mock_plan import read_plan
from flexbt_tools.mock_runs.mock_run import DEFAULT_RATE, BlackboardFile, MockRun, json_types, save_blackboard
from flexbt_tools.mock_runs.report import ended, result_as_json, result_lines, transition
from flexbt_tools.tree_checks.check import check_trees, joined
from flexbt_tools.tree_checks.diagnostics import REFUSED, RULES
from flexbt_tools.trees.files import read_library
from flexbt_tools.trees.outline import drawn_nodes, find_tree, is_main, items_of, tree_as_json, tree_lines
from flexbt_tools.trees.schema import schema_lines

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


def add_check_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    arguments.add_node_types(parser)
    arguments.add_inputs(parser)
    arguments.add_skills(parser)
    parser.add_argument('--shared', action='store_true', help='run all trees on one blackboard, as the server does')
    add_report_arguments(parser, [rule for rule in RULES if rule is not REFUSED])


def run_check(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=options.allow_unknown)
    skills = arguments.skill_library(options.skills, registry)
    found = check_trees(options.files, registry, options.input, shared=options.shared, skills=skills)
    reported = [Reported(one.rule, str(one), one.to_json()) for one in (found if options.json else joined(found))]
    return report_findings(options, reported, 'file', len(options.files))


# ``bt_tool show``: trees as text.

_WIDTH: Final = 120
"""Line length without a terminal, characters."""


def add_show_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    arguments.add_trees(parser)
    arguments.add_ports(parser, 'given')
    parser.add_argument('--ascii', action='store_true', help='use only ASCII characters')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def run_show(options: argparse.Namespace) -> ExitCode:
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    keys = arguments.chosen_trees(library, options)
    if options.json:
        print(json.dumps({'trees': [tree_as_json(library, key, expand=options.expand) for key in keys]}))
        return ExitCode.OK
    for index, key in enumerate(keys):
        if index:
            print()
        for line in _tree(library, key, options):
            print(line.encode('ascii', 'backslashreplace').decode() if options.ascii else line)
    return ExitCode.OK


def _tree(library: TreeLibrary, key: TreeKey, options: argparse.Namespace) -> Iterator[str]:
    tree = library.definition(key)
    main = ' (main)' if is_main(library, key) else ''
    place = f'{tree.source.file}:{tree.source.position(tree.offset)[0]}'
    yield one_line(f'{key.id}{main}  {place}')
    items = items_of(library, key, expand=options.expand)
    width = shutil.get_terminal_size((_WIDTH, 0)).columns
    yield from tree_lines(items, options.ports, ascii_only=options.ascii, width=width)


# ``bt_tool draw``: trees as a picture by Graphviz, or as Graphviz or Mermaid source.


def add_draw_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    arguments.add_trees(parser)
    add_picture_arguments(parser)
    arguments.add_ports(parser, 'none')
    arguments.add_node_types(parser, allow_unknown=False)


def run_draw(options: argparse.Namespace) -> ExitCode:
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    trees = [
        (key.id, drawn_nodes(items_of(library, key, expand=options.expand), options.ports))
        for key in arguments.chosen_trees(library, options)
    ]
    output_picture(options, lambda: trees_as_dot(trees), lambda: trees_as_mermaid(trees))
    return ExitCode.OK


# ``bt_tool model``: the available node types for editors, as a TreeNodesModel or an XML schema.


def add_model_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--builtin', action='store_true', help='include the nodes of BehaviorTree.CPP, which Groot2 knows'
    )
    parser.add_argument(
        '--xsd',
        action='store_true',
        help='print an XML schema of tree files instead, with all node types, for any XML editor',
    )
    arguments.add_node_types(parser, allow_unknown=False)


def run_model(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=False)
    manifests = sorted(
        (manifest for manifest in registry if manifest.kind is not NodeKind.SUBTREE), key=lambda manifest: manifest.id
    )
    if options.xsd:
        lines = schema_lines(manifests)
    else:
        known = builtin_registry()
        lines = models_document(manifest for manifest in manifests if options.builtin or manifest.id not in known)
    for line in lines:
        print(line)
    return ExitCode.OK


# ``bt_tool skills``: requirements, effects and failures of leaves.


def add_skills_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'files', metavar='FILE', nargs='*', help='YAML file of manifests, which adds to what the classes declare'
    )
    arguments.add_node_types(parser, allow_unknown=False)
    add_skill_arguments(parser)


def run_skills(options: argparse.Namespace) -> ExitCode:
    known = arguments.registry(options, allow_unknown=False)
    base = arguments.skill_library([], known)
    library = read_skill_files(options.files, base)
    print_skills(chosen_skills(library, options), options)
    for line in unreached_ports(library, base, known):
        print(one_line(f'note: {line}'), file=sys.stderr)
    doubtful = list(unknown_names(library, base, known))
    for line in doubtful:
        print(one_line(f'warning: {line}'), file=sys.stderr)
    return ExitCode.NEGATIVE if doubtful else ExitCode.OK


# Check that the names in skills exist: the condition leaves of sensors, and the ports that are given.


def unknown_names(library: SkillLibrary, base: SkillLibrary, registry: NodeRegistry) -> Iterator[str]:
    """Yield a line for each unknown name in a library, except those of ``base``.

    A class that is not a leaf on this computer counts as known if the library has a skill for it.
    """
    conditions = {manifest.id for manifest in registry if manifest.kind.value == 'Condition'}
    for predicate in library.predicates.values():
        sensor = predicate.sensor
        if predicate == base.predicates.get(predicate.name):
            continue
        if sensor is None:
            yield f'predicate {predicate.name} has no sensor: it is only remembered, so no tree can test it'
        elif isinstance(sensor, ConditionSensor):
            yield from _unknown_ports(sensor.id, sensor.ports, registry, f'sensor of predicate {predicate.name}')
            if sensor.id not in registry and sensor.id not in library.skills:
                near = did_you_mean(sensor.id, conditions)
                yield f'sensor of predicate {predicate.name}: there is no leaf {short_repr(sensor.id)}{near}'
        else:
            yield from _wrong_script(predicate, sensor.test)
    for skill in library.skills.values():
        if skill != base.skills.get(skill.name):
            yield from _unknown_ports(skill.name, skill.arguments, registry, f'arguments of skill {skill.name}')


def _wrong_script(predicate: Predicate, test: str) -> Iterator[str]:
    try:
        parse_script(Template(test).safe_substitute(dict.fromkeys(predicate.parameters, 'x')))
    except ScriptError as error:
        yield f'sensor of predicate {predicate.name}: {short_repr(test)} is not a script: {error}'


def unreached_ports(library: SkillLibrary, base: SkillLibrary, registry: NodeRegistry) -> Iterator[str]:
    """Yield problems of skills that differ from ``base``: no port of the installed leaf receives their parameters."""
    for skill in library.skills.values():
        manifest = registry.get(skill.name)
        if manifest is None or not manifest.ports or not skill.parameters:
            continue
        if skill.name in base.skills and skill.parameters == base.skills[skill.name].parameters:
            continue
        told = {name for text in skill.arguments.values() for name in Template(text).get_identifiers()}
        if skill.parameters.keys().isdisjoint(told | manifest.ports.keys()):
            yield (
                f'skill {skill.name}: the installed leaf of this name learns of no parameter '
                f'({", ".join(skill.parameters)}); say how by arguments (its ports: {", ".join(manifest.ports)}), '
                'or give the skill another name if another leaf is meant'
            )


def _unknown_ports(id: str, ports: Iterable[str], registry: NodeRegistry, what: str) -> Iterator[str]:
    manifest = registry.get(id)
    if manifest is not None:
        for name in ports:
            if name not in manifest.ports:
                yield f'{what}: {id} has no port {short_repr(name)}{did_you_mean(name, manifest.ports)}'


# ``bt_tool run``: run a tree with mocks, and print its progress.

_DEFAULT_TIMEOUT: Final = 600.0
_EXIT_CODES: Final = {'SUCCESS': ExitCode.OK, 'ERROR': ExitCode.NODE_ERROR, 'TIMEOUT': ExitCode.UNFINISHED}


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    parser.add_argument('--tree', metavar='ID', help='tree to run (default: the main tree of the first file)')
    mocks = (
        'what leaves do that need a robot: a YAML file, or what the leaf of this type, name or path gives, '
        'activation by activation; with * in it, all leaves that need a mock'
    )
    arguments.add_list(parser, '--mock', 'FILE|NODE=STATUS,...', mocks)
    arguments.add_list(parser, '--set', 'KEY=VALUE', 'an entry of the blackboard, YAML')
    parser.add_argument(
        '--blackboard', metavar='FILE', help='entries of the blackboard, JSON as --save-blackboard writes it'
    )
    parser.add_argument('--save-blackboard', metavar='FILE', help='write the final blackboard, as JSON')
    parser.add_argument(
        '--read-inputs', action='store_true', help='let mocks raise when an input is missing, as nodes do'
    )
    arguments.add_number(parser, '--rate', 'HZ', DEFAULT_RATE, 'minimum tick rate')
    ends = "end the run at this time on the tree's clock"
    arguments.add_number(parser, '--timeout', 'SECONDS', _DEFAULT_TIMEOUT, ends)
    parser.add_argument(
        '--real-time', action='store_true', help='run in real time, instead of jumping from event to event'
    )
    parser.add_argument('--btlog', metavar='FILE', type=_log_file, help='write a log file for Groot2 and bt_tool log')
    parser.add_argument('--quiet', action='store_true', help='print only the result')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def _log_file(text: str) -> Path:
    path = Path(text)
    if path.suffix != SUFFIX:
        raise argparse.ArgumentTypeError(f'{text!r} does not end with {SUFFIX}, and Groot2 opens no other files')
    return path


def run_with_mocks(options: argparse.Namespace) -> ExitCode:
    with _default_context():
        return _run(options)


def _default_context() -> AbstractContextManager[None]:
    """Return the rclpy context for leaves that really run. Without ROS no leaf uses it."""
    try:
        from flexbt_common.middleware.default_context import offline_default_context
    except ModuleNotFoundError:
        return nullcontext()
    return offline_default_context()


def _run(options: argparse.Namespace) -> ExitCode:
    plan = read_plan(options.mock, options.set)
    registry = arguments.registry(options, allow_unknown=True)
    library = read_library(options.files, registry)

    def on_status(time: float, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        print(transition(time, node.path, node.id, before, after, as_json=options.json))

    types = json_types(registry)
    mock_run = MockRun(
        library,
        find_tree(library, options.tree) if options.tree is not None else _main_tree(library),
        plan,
        real_time=options.real_time,
        rate=options.rate,
        read_inputs=options.read_inputs,
        blackboard=BlackboardFile(options.blackboard, types),
        on_status=None if options.quiet else on_status,
        log=options.btlog,
    )
    try:
        report = ended(mock_run, options.timeout)
        print(*([result_as_json(report)] if options.json else result_lines(report)), sep='\n')
        if options.save_blackboard is not None:
            for problem in save_blackboard(mock_run.tree.blackboard, options.save_blackboard, types):
                print(one_line(f'not saved: {problem}'), file=sys.stderr)
    finally:
        mock_run.close()
    return _EXIT_CODES.get(report['result'], ExitCode.NEGATIVE)


def _main_tree(library: TreeLibrary) -> TreeKey:
    document = next(iter(library.documents.values()))
    if document.main is None:
        trees = ', '.join(document.trees)
        raise UsageError(f'{document.file} does not name its main tree; say --tree ID, one of: {trees}')
    return TreeKey(document.file, document.main)


# ``bt_tool log``: print a log file (.btlog) of BehaviorTree.CPP or FlexBT.


def add_log_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('file', metavar='FILE', type=Path, help='log file')
    arguments.add_json(parser)


def run_log(options: argparse.Namespace) -> ExitCode:
    try:
        log = read_log(options.file)
    except OSError as error:
        raise UsageError(f'{options.file}: {error.strerror or error}') from error
    except LogError as error:
        raise UnfitError(one_line(str(error), 1000)) from error
    if not options.json:
        print(f'{_when(log)}: {len(log.nodes)} nodes, {len(log.transitions)} transitions')
    for one in log.transitions:
        node = log.nodes.get(one.uid, LoggedNode(f'uid {one.uid}', '?'))
        print(transition(one.time, node.path, node.type, one.before, one.after, as_json=options.json))
    if log.left_over:
        print(f'{options.file}: the last {log.left_over} bytes are not a whole transition', file=sys.stderr)
    return ExitCode.OK


def _when(log: LogContent) -> str:
    try:
        return datetime.fromtimestamp(log.epoch, UTC).isoformat(sep=' ', timespec='milliseconds')
    except (ValueError, OverflowError, OSError):
        return f'{log.epoch:.3f} s since 1970'


# ``bt_tool mcp``: the tools for language models.


def add_mcp_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'folder', metavar='FOLDER', nargs='?', type=Path, default=Path(), help='folder of the missions (default: .)'
    )
    arguments.add_number(parser, '--seconds', 'S', 45.0, 'time limit of a call')


def run_mcp(options: argparse.Namespace) -> ExitCode:
    if not options.folder.is_dir():
        raise UsageError(f'{options.folder} is not a folder; create it, or give another one')
    try:
        from .mcp_server import serve
    except ModuleNotFoundError as error:
        raise UsageError(
            f"bt_tool mcp needs the SDK of the protocol ({error}); pip install 'flexbt_tools[mcp]'"
        ) from error
    serve(options.folder, math.ceil(options.seconds))
    return ExitCode.OK


# The executable ``bt_tool``: its commands.

EXIT_CODES: Final = (
    ('0', 'nothing is wrong; the tree succeeded'),
    (
        '1',
        'check: there are errors, or with --strict warnings; prove, skills: something is wrong; run: the tree did not '
        'succeed; plan: there is no plan',
    ),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('4', 'run: a node raised an exception, or broke the rules'),
    ('5', 'run, plan: not done in time; prove: nothing is wrong so far, but not all was followed'),
    ('6', 'prove: nothing goes wrong, but the tree can never succeed, or a node can never be reached'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ToolCommand('check', 'find what is wrong, and what is suspicious, in tree files', add_check_arguments, run_check),
    ToolCommand('show', 'show the trees of a file as text', add_show_arguments, run_show),
    ToolCommand('draw', 'draw the trees of a file', add_draw_arguments, run_draw),
    ToolCommand('model', 'describe the node types that are known here, for editors', add_model_arguments, run_model),
    ToolCommand(
        'skills',
        'show what leaves need and bring about, and check files of manifests',
        add_skills_arguments,
        run_skills,
    ),
    ToolCommand('prove', 'follow all that can happen to a tree, or in a model, and tell what is wrong'),
    ToolCommand('run', 'run a tree with mocks, and print what happens', add_run_arguments, run_with_mocks),
    ToolCommand('plan', 'plan a goal, and write a reactive tree that reaches it'),
    ToolCommand('log', 'print a log file (.btlog) of a run', add_log_arguments, run_log),
    ToolCommand('mcp', 'serve check, run, prove, plan and others to language models (MCP)', add_mcp_arguments, run_mcp),
)


def main(words: Sequence[str] | None = None) -> int:
    """Run ``bt_tool`` and return its exit code, see :class:`ExitCode`."""
    return run_command('bt_tool', 'Behavior-tree files, without ROS running.', COMMANDS, EXIT_CODES, words)


# ``python3 -m flexbt_tools.cli.bt_tool``, if the package is not installed as an executable.

if __name__ == '__main__':
    sys.exit(main())
