# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool run``: runs a tree with mocks, and prints what happens."""

from __future__ import annotations

import argparse
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree import TreeKey, TreeLibrary
from flexbt_core.values import one_line
from flexbt_server.groot2 import SUFFIX
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.mock_runs import DEFAULT_RATE, JsonPrinter, MockRun, TextPrinter, ended, read_plan
from flexbt_tools.trees import BlackboardFile, find_tree, json_types, read_library, save_blackboard

_DEFAULT_TIMEOUT: Final = 600.0
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
        '--rate', metavar='HZ', type=arguments.positive, default=DEFAULT_RATE, help='least rate of ticks (default: 10)'
    )
    parser.add_argument(
        '--timeout',
        metavar='SECONDS',
        type=arguments.positive,
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


def _log_file(text: str) -> Path:
    path = Path(text)
    if path.suffix != SUFFIX:
        raise argparse.ArgumentTypeError(f'{text!r} does not end with {SUFFIX}, and Groot2 opens no other files')
    return path


def run(options: argparse.Namespace) -> ExitCode:
    with _default_context():
        return _run(options)


def _default_context() -> AbstractContextManager[None]:
    """Return what leaves that run themselves need for rclpy. Without ROS there are none that use it."""
    try:
        from flexbt_common.runtime import offline_default_context
    except ModuleNotFoundError:
        return nullcontext()
    return offline_default_context()


def _run(options: argparse.Namespace) -> ExitCode:
    plan = read_plan(options.mock, options.set)
    registry = arguments.registry(options, allow_unknown=True)
    library = read_library(options.files, registry)
    printer = JsonPrinter() if options.json else TextPrinter()
    types = json_types(registry)
    mock_run = MockRun(
        library,
        find_tree(library, options.tree) if options.tree is not None else _main_tree(library),
        plan,
        real_time=options.real_time,
        rate=options.rate,
        read_inputs=options.read_inputs,
        blackboard=BlackboardFile(options.blackboard, types),
        on_status=None if options.quiet else printer.transition,
        log=options.btlog,
    )
    try:
        report = ended(mock_run, options.timeout)
        printer.result(report)
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
