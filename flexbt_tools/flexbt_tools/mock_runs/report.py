# SPDX-License-Identifier: BSD-3-Clause
"""Reports of a run with mocks: each status change, and the end of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from enum import Enum
from typing import Any, Final

from flexbt_core.behavior_tree.model.errors import FailureTrace, NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.values.text import one_line, pluralize

from .mock_run import MockRun

_VALUE_WIDTH: Final = 200


def ended(mock_run: MockRun, timeout: float) -> dict[str, Any]:
    """Run a tree to its end, or for ``timeout`` seconds of its clock, and return the report.

    It contains the result, the reason, the chain from the node at fault up to the root, and the blackboards by the
    paths of their sub-trees.
    """
    result, reason, reasons = _outcome(mock_run, timeout)
    boards = {sub_tree.path: sub_tree.blackboard.snapshot() for sub_tree in mock_run.tree.subtrees}
    return {
        'result': result,
        'time': round(mock_run.time, 6),
        'ticks': mock_run.ticks,
        'reason': reason,
        'reasons': [] if reasons is None else reasons.lines(),
        'blackboard': {path: entries for path, entries in boards.items() if entries},
    }


def _outcome(mock_run: MockRun, timeout: float) -> tuple[str, str, FailureTrace | None]:
    """Return the result of the run, its reason, and the nodes involved."""
    tree = mock_run.tree
    try:
        status = mock_run.run(timeout)
    except NodeExecutionError as error:
        return 'ERROR', str(error), error.trace
    if status is not NodeStatus.RUNNING:
        failure = tree.failure
        return status.name, '' if failure is None else f'[{failure.path}] {failure.reason}', failure
    if mock_run.wakes_itself:
        return 'TIMEOUT', 'the tree wakes itself without end', None
    active = ', '.join(tree.active_nodes(leaves_only=True)) or 'no leaf'
    return 'TIMEOUT', f'still RUNNING: {active}', None


def transition(time: float, path: str, type: str, before: NodeStatus, after: NodeStatus, *, as_json: bool) -> str:
    """Return a status change of the node ``path`` as a line, for people or for programs."""
    if not as_json:
        return one_line(f'{time:10.3f}  {before.name:7} -> {after.name:7}  {path}')
    event = {'event': 'transition', 'time': round(time, 6), 'path': path, 'type': type}
    return json.dumps({**event, 'before': before.name, 'after': after.name})


def result_as_json(report: dict[str, Any]) -> str:
    """Return the end of a run as one line, for programs."""
    boards = {path: _plain(entries) for path, entries in report['blackboard'].items()}
    return json.dumps({'event': 'result', **report, 'blackboard': boards})


def result_lines(report: dict[str, Any]) -> Iterator[str]:
    """Yield the end of a run, for people."""
    yield f'{report["result"]} after {report["time"]:.3f} s and {pluralize(report["ticks"], "tick")}'
    if report['reason']:
        yield one_line(f'  reason: {report["reason"]}')
    for reason in report['reasons'][1:]:
        yield one_line(f'  so {reason}')
    for path, entries in report['blackboard'].items():
        yield one_line(f'blackboard{f" of {path}" if path else ""}:')
        for key, value in entries.items():
            yield one_line(f'  {key} = {value!r}', _VALUE_WIDTH)


def _plain(value: Any) -> Any:
    """Return the value as JSON, or as a text if JSON cannot express it."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str | int | None) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return repr(value)
