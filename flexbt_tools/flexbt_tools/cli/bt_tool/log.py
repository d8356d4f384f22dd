# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool log``: prints a log file (.btlog) of BehaviorTree.CPP, or of ours."""

from __future__ import annotations

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path

from flexbt_core.values import one_line
from flexbt_server.groot2 import Log, LogError, LoggedNode, Transition, read_log
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UsageError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('file', metavar='FILE', type=Path, help='the log file')
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> ExitCode:
    try:
        log = read_log(options.file)
    except OSError as error:
        raise UsageError(f'{options.file}: {error.strerror or error}') from error
    except LogError as error:
        print(one_line(str(error), 1000), file=sys.stderr)
        return ExitCode.REFUSED
    show = _json if options.json else _text
    if not options.json:
        print(f'{_when(log)}: {len(log.nodes)} nodes, {len(log.transitions)} transitions')
    for transition in log.transitions:
        print(show(transition, log.nodes.get(transition.uid, LoggedNode(f'uid {transition.uid}', '?'))))
    if log.left_over:
        print(f'{options.file}: the last {log.left_over} bytes are no whole transition', file=sys.stderr)
    return ExitCode.OK


def _when(log: Log) -> str:
    try:
        return datetime.fromtimestamp(log.epoch, UTC).isoformat(sep=' ', timespec='milliseconds')
    except (ValueError, OverflowError, OSError):
        return f'{log.epoch:.3f} s since 1970'


def _text(transition: Transition, node: LoggedNode) -> str:
    """As ``bt_tool run`` prints it."""
    before, after = transition.before.name, transition.after.name
    return one_line(f'{transition.time:10.3f}  {before:7} -> {after:7}  {node.path}')


def _json(transition: Transition, node: LoggedNode) -> str:
    return json.dumps(
        {
            'event': 'transition',
            'time': round(transition.time, 6),
            'path': node.path,
            'type': node.type,
            'before': transition.before.name,
            'after': transition.after.name,
        }
    )
