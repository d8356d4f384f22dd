# SPDX-License-Identifier: BSD-3-Clause
"""The command ``run-tree``: a behavior tree on the BT server, without a behavior, until it ends or is canceled."""

from __future__ import annotations

import html
import json
import re
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, Final, TextIO

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome
from flexbt_common.errors import ValueConversionError
from flexbt_common.lifecycle.liveliness import ProcessIdentity
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import text_to_value, to_entry
from flexbt_console.commands.operator_values import start_input, value_text
from flexbt_console.commands.spec import CommandLine
from flexbt_console.errors import ExitCode, NoAnswerError, RefusedError, UsageError
from flexbt_console.mirror.records import FramedPose
from flexbt_core.values.text import escape_lines, sanitize_for_message
from flexbt_msgs.action import BtExecute, BtLoad

POSE: Final = 'geometry_msgs/msg/PoseStamped'
_MAIN_TREE: Final = re.compile(r'main_tree_to_execute\s*=\s*(["\'])(.*?)\1', re.DOTALL)
_COMMENT: Final = re.compile('<!--.*?-->', re.DOTALL)
MOST_BYTES: Final = 1_000_000
"""Maximum size of a file that is sent, bytes."""
_CANCEL_SECONDS: Final = 5.0
"""Time for the end of a tree that was canceled, s."""
_CODES: Final = {getattr(BtExecute.Result, name): name for name in ('SUCCESS', 'FAILURE', 'CANCELED', 'ERROR')}


def run_tree(line: CommandLine, runtime: NodeRuntime, timeout: float, places: Mapping[str, FramedPose]) -> ExitCode:
    """Load the tree of a file, run it, and print its active nodes and its result.

    The exit code is 0 if the tree has succeeded, and 3 if it has not. ``timeout`` in seconds is for each answer of the
    server, but not for the tree.

    Raises:
        ConsoleError: the file or an input is wrong, or the server does not answer.
    """
    links = ActionLinks(runtime)
    inputs = [_entry(text, places) for text in line.values('--input')]
    goals = [text_to_value(value_text(text, POSE, places), POSE) for text in line.values('--goal')]
    tree = _load(links, line.first_word, timeout)
    as_json = line.has('--json')
    done: Future[GoalOutcome] = Future()
    active: list[str] = []

    def on_feedback(feedback: Any) -> None:
        if feedback.active_nodes != active and not as_json:
            active[:] = feedback.active_nodes
            _print(f'  {active[-1] if active else "..."}', sys.stderr)

    goal = BtExecute.Goal(
        behavior_tree=line.value('--tree') or tree,
        goals=goals,
        inputs=inputs,
        outputs=list(line.values('--output')),
        output_encoding=BtExecute.Goal.TEXT,
        blackboard=line.value('--blackboard') or 'console',
        owner=runtime.node.get_fully_qualified_name(),
        owner_process=str(ProcessIdentity.own()),
    )
    link = links.link(BtExecute, names.BT_EXECUTOR)
    call = ActionCall(
        link, goal, on_done=done.set_result, on_feedback=on_feedback, server_timeout=timeout, accept_timeout=timeout
    )
    try:
        outcome = done.result()
    except KeyboardInterrupt:
        call.cancel()
        _print('canceling the tree ...', sys.stderr)
        try:
            _report(done.result(_CANCEL_SECONDS), as_json)
        except TimeoutError:
            _print('the tree has not ended yet', sys.stderr)
        return ExitCode.INTERRUPTED
    return _report(outcome, as_json)


def _entry(text: str, places: Mapping[str, FramedPose]) -> Any:
    value = start_input(text, places)
    try:
        return to_entry(value.key, text_to_value(value.text, value.type), value.type)
    except ValueConversionError as error:
        raise RefusedError(f'--input {sanitize_for_message(text)}: {error}') from error


def _load(links: ActionLinks, file: str, timeout: float) -> str:
    """Load a file of this computer as text, or package/path.xml of the robot; return what the server calls its tree."""
    path = Path(file)
    text = ''
    if path.is_file():
        if path.stat().st_size > MOST_BYTES:
            raise UsageError(f'{file} has more than {MOST_BYTES} bytes')
        try:
            text = path.read_text(encoding='utf-8')
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f'{file} cannot be read: {error}') from error
    elif not file.endswith('.xml'):
        return file  # the ID of a tree that the server knows
    elif path.is_absolute() or '/' not in file:
        raise UsageError(f'{file}: no such file on this computer; a file of the robot is package/path.xml')
    done: Future[GoalOutcome] = Future()
    link = links.link(BtLoad, names.BT_LOADER)
    goal = BtLoad.Goal(xml=text) if text else BtLoad.Goal(files=[file])
    ActionCall(link, goal, on_done=done.set_result, server_timeout=timeout, accept_timeout=timeout)
    try:
        result = done.result(3.0 * timeout).result
    except TimeoutError:
        raise NoAnswerError(f'the BT server did not load the tree within {3.0 * timeout:g} s') from None
    if result is None:
        raise NoAnswerError(done.result().reason)
    if result.code != BtLoad.Result.SUCCESS:
        raise RefusedError(result.message)
    return _main_tree(text, result.reports[-1].trees) if text else file


def _main_tree(text: str, trees: Sequence[str]) -> str:
    """Return the ID of the tree of a file that is executed by default."""
    named = _MAIN_TREE.search(_COMMENT.sub('', text))
    if named is not None:
        return html.unescape(named[2])
    if len(trees) != 1:
        raise UsageError(f'the file does not name its main tree; choose one by --tree: {", ".join(trees)}')
    return trees[0]


def _report(outcome: GoalOutcome, as_json: bool) -> ExitCode:
    result = outcome.result
    if result is None:
        raise NoAnswerError(outcome.reason)
    code = _CODES.get(result.code, 'UNKNOWN')
    outputs = {entry.key: entry.text for entry in result.outputs}
    if as_json:
        report = {
            'result': code,
            'message': result.message,
            'failed_node': result.failed_node,
            'reasons': list(result.reasons),
            'outputs': outputs,
        }
        print(json.dumps(report))
    else:
        _print(f'{code}{f": {result.message}" if result.message else ""}')
        for line in (*result.reasons, *(f'{key} = {text}' for key, text in outputs.items())):
            _print(f'  {line}')
    return ExitCode.OK if result.code == BtExecute.Result.SUCCESS else ExitCode.REFUSED


def _print(text: str, file: TextIO | None = None) -> None:
    print('\n'.join(escape_lines(text)), file=file or sys.stdout, flush=True)
