# SPDX-License-Identifier: BSD-3-Clause
"""How a run has ended: what the client is told, whatever a tree or a leaf does."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace

from flexbt_core.behavior_tree import BehaviorTreeError, NodeExecutionError, NodeStatus, Tree
from flexbt_msgs.action import BtExecute


@dataclass(frozen=True)
class RunOutcome:
    """How a run has ended; ``code`` is a constant of BtExecute.Result.

    ``message`` names ``failed_node``, where there is one, as ``PATH: reason`` or ``[PATH]``.
    ``error_code`` is the lowest that a leaf of the run has left, as in Nav2; 0 for none.
    """

    code: int
    message: str = ''
    failed_node: str = ''
    reasons: tuple[str, ...] = ()
    error_code: int = 0


def outcome_of_tree(tree: Tree, status: NodeStatus) -> RunOutcome:
    """What the status means with which a tree has completed."""
    if status is NodeStatus.SUCCESS:
        return RunOutcome(BtExecute.Result.SUCCESS)
    if status is NodeStatus.SKIPPED:
        return RunOutcome(BtExecute.Result.FAILURE, 'the tree was skipped: no node had anything to do')
    failure = tree.failure
    assert failure is not None  # the engine gives one for every FAILURE
    return RunOutcome(BtExecute.Result.FAILURE, str(failure.steps[0]), failure.path, tuple(failure.lines()))


def outcome_after(step: Callable[[], None], outcome: RunOutcome) -> RunOutcome:
    """Take a step of halting; gives the outcome. A leaf that raises makes it an ERROR, and its error is told after what
    the run has ended by: the failed node stays the one that was first.
    """
    try:
        step()
    except NodeExecutionError as error:
        halting = _error(error)
        return replace(
            outcome if outcome.failed_node else halting,
            code=BtExecute.Result.ERROR,
            message='; '.join(filter(None, (outcome.message, f'while halting: {halting.message}'))),
        )
    return outcome


def _error(error: NodeExecutionError) -> RunOutcome:
    message = '; '.join((str(error), *getattr(error, '__notes__', ())))
    return RunOutcome(BtExecute.Result.ERROR, message, error.node_path, tuple(error.trace.lines()))


def outcome_of(step: Callable[[], RunOutcome]) -> RunOutcome:
    """What a step of a run gives, or the ERROR that it raises: whoever gave the goal has to hear of it."""
    try:
        return step()
    except NodeExecutionError as error:
        return _error(error)
    except BehaviorTreeError as error:
        return RunOutcome(BtExecute.Result.ERROR, str(error))
    except BaseException:  # a fault of ours
        return RunOutcome(BtExecute.Result.ERROR, f'fault in the BT server: {traceback.format_exc()}')
