# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool run``: runs a tree with mocks, and prints what happens."""

from __future__ import annotations

import argparse
import json
import math
import sys
from enum import Enum
from pathlib import Path
from typing import Any, Final

from flexbt_core.behavior_tree import NodeExecutionError, NodeStatus, Reasons, TreeKey, TreeLibrary, TreeNode
from flexbt_core.values import one_line
from flexbt_server.groot2.log_file import SUFFIX
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.trees.blackboard_file import BlackboardFile, json_types, save_blackboard
from flexbt_tools.trees.files import read_library
from flexbt_tools.trees.outline import find_tree

from .mock_plan import read_plan
from .trial import DEFAULT_RATE, Trial

_DEFAULT_TIMEOUT: Final = 600.0
_VALUE_WIDTH: Final = 200
_EXIT_CODES: Final = {'SUCCESS': ExitCode.OK, 'ERROR': ExitCode.NODE_ERROR, 'TIMEOUT': ExitCode.UNFINISHED}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    parser.add_argument('--tree', metavar='ID', help='the tree to run (default: the main one of the first file)')
    parser.add_argument(
        '--mock',
        metavar='FILE|NODE=STATUS,...',
        action='append',
        default=[],
        help='what leaves do that need a robot: a YAML file, or what the leaf of this type, name or path gives, '
        'activation by activation; with * in it, all leaves that need a mock; repeatable',
    )
    parser.add_argument(
        '--set', metavar='KEY=VALUE', action='append', default=[], help='an entry of the blackboard, YAML; repeatable'
    )
    parser.add_argument(
        '--blackboard', metavar='FILE', help='entries of the blackboard, JSON as --save-blackboard writes it'
    )
    parser.add_argument('--save-blackboard', metavar='FILE', help='write the blackboard, as it is at the end, as JSON')
    parser.add_argument('--read-inputs', action='store_true', help='mocks raise when an input is missing, as nodes do')
    parser.add_argument(
        '--rate', metavar='HZ', type=_positive, default=DEFAULT_RATE, help='least rate of ticks (default: 10)'
    )
    parser.add_argument(
        '--timeout',
        metavar='SECONDS',
        type=_positive,
        default=_DEFAULT_TIMEOUT,
        help='end of the run, on the clock of the tree (default: 600)',
    )
    parser.add_argument('--real-time', action='store_true', help='wait, instead of jumping from event to event')
    parser.add_argument(
        '--btlog', metavar='FILE', type=_log_file, help='write a log file, which Groot2 and bt_tool log open'
    )
    parser.add_argument('--quiet', action='store_true', help='only the result')
    arguments.add_node_types(parser, allow_unknown=False)
    arguments.add_json(parser)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is no number above 0')
    return value


def _log_file(text: str) -> Path:
    path = Path(text)
    if path.suffix != SUFFIX:
        raise argparse.ArgumentTypeError(f'{text!r} does not end with {SUFFIX}, and Groot2 opens no other files')
    return path


def run(options: argparse.Namespace) -> ExitCode:
    plan = read_plan(options.mock, options.set)
    registry = arguments.registry(options, allow_unknown=True)
    library = read_library(options.files, registry)
    printer = _Json() if options.json else _Text()
    types = json_types(registry)
    trial = Trial(
        library,
        find_tree(library, options.tree) if options.tree is not None else _main_tree(library),
        plan,
        real_time=options.real_time,
        rate=options.rate,
        read_inputs=options.read_inputs,
        blackboard=BlackboardFile(options.blackboard, types),
        on_transition=None if options.quiet else printer.transition,
        log=options.btlog,
    )
    try:
        result, reason, reasons = _outcome(trial, options.timeout)
        printer.result(_report(trial, result, reason, reasons))
        if options.save_blackboard is not None:
            for problem in save_blackboard(trial.tree.blackboard, options.save_blackboard, types):
                print(one_line(f'not saved: {problem}'), file=sys.stderr)
    finally:
        trial.close()
    return _EXIT_CODES.get(result, ExitCode.NEGATIVE)


def _main_tree(library: TreeLibrary) -> TreeKey:
    document = next(iter(library.documents.values()))
    if document.main is None:
        trees = ', '.join(document.trees)
        raise UsageError(f'{document.file} does not name its main tree; say --tree ID, one of: {trees}')
    return TreeKey(document.file, document.main)


def _outcome(trial: Trial, timeout: float) -> tuple[str, str, Reasons | None]:
    """How the run has ended; why; and the nodes that had a part in that."""
    tree = trial.tree
    try:
        status = trial.run(timeout)
    except NodeExecutionError as error:
        return 'ERROR', str(error), error.trace
    if status is not NodeStatus.RUNNING:
        failure = tree.failure
        return status.name, '' if failure is None else f'[{failure.path}] {failure.reason}', failure
    if tree.wake_pending:
        return 'TIMEOUT', 'the tree wakes itself without end', None
    active = ', '.join(tree.active_nodes(leaves_only=True)) or 'no leaf'
    return 'TIMEOUT', f'still RUNNING: {active}', None


def _report(trial: Trial, result: str, reason: str, reasons: Reasons | None) -> dict[str, Any]:
    """Result, reason, what led to it from the node at fault up to the root, and the blackboards by the paths of their
    sub-trees."""
    boards = {sub_tree.path: sub_tree.blackboard.snapshot() for sub_tree in trial.tree.subtrees}
    return {
        'result': result,
        'time': round(trial.time, 6),
        'ticks': trial.ticks,
        'reason': reason,
        'reasons': [] if reasons is None else reasons.lines(),
        'blackboard': {path: entries for path, entries in boards.items() if entries},
    }


class _Text:
    """Prints for people: a line for each change of a status, and then the result."""

    def transition(self, time: float, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        print(one_line(f'{time:10.3f}  {before.name:7} -> {after.name:7}  {node.path}'))

    def result(self, report: dict[str, Any]) -> None:
        ticks = report['ticks']
        print(f'{report["result"]} after {report["time"]:.3f} s and {ticks} tick{"" if ticks == 1 else "s"}')
        if report['reason']:
            print(one_line(f'  reason: {report["reason"]}'))
        for reason in report['reasons'][1:]:
            print(one_line(f'  so {reason}'))
        for path, entries in report['blackboard'].items():
            print(one_line(f'blackboard{f" of {path}" if path else ""}:'))
            for key, value in entries.items():
                print(one_line(f'  {key} = {value!r}', _VALUE_WIDTH))


class _Json:
    """Prints for programs: an object a line."""

    def transition(self, time: float, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        event = {
            'event': 'transition',
            'time': round(time, 6),
            'path': node.path,
            'type': node.id,
            'before': before.name,
            'after': after.name,
        }
        print(json.dumps(event))

    def result(self, report: dict[str, Any]) -> None:
        boards = {path: _plain(entries) for path, entries in report['blackboard'].items()}
        print(json.dumps({'event': 'result', **report, 'blackboard': boards}))


def _plain(value: Any) -> Any:
    """The value as JSON has it, and as a text where JSON has nothing like it."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str | int | None) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return repr(value)
