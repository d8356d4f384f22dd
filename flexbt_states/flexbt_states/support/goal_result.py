# SPDX-License-Identifier: BSD-3-Clause
"""From the end of a BT server's action to the outcome of a state.

Three things have to agree before anything counts as done: the goal was accepted, it ended as succeeded, and the
server wrote the result code SUCCESS. A default value never means success.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from flexbt_common.calls import GoalOutcome, GoalStatus
from flexbt_common.values import check_value, from_entry
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import BtExecute


def state_outcome(outcome: GoalOutcome, what: str) -> tuple[str, str]:
    """The state's outcome (done, failed or canceled) and the reason for a person; the reason is empty when done.

    ``what`` was to be done. The result codes UNKNOWN 0, SUCCESS 1, FAILURE 2, CANCELED 3 and ERROR 4 are the same in
    BtLoad, BtExecute, BtGetData and BtSetData.
    """
    code = outcome.result.code if outcome.result is not None else BtExecute.Result.UNKNOWN
    message = outcome.result.message if outcome.result is not None else ''
    detail = message or outcome.reason
    if outcome.status is GoalStatus.SUCCEEDED:
        if code == BtExecute.Result.SUCCESS:
            return 'done', ''
        if code == BtExecute.Result.UNKNOWN:
            detail = 'the server ended the goal without filling in the result'
    elif code == BtExecute.Result.SUCCESS:
        detail = f'the goal ended as {outcome.status.name} although its result says success; {outcome.reason}'
    ended_by_cancel = outcome.status is GoalStatus.CANCELED or code == BtExecute.Result.CANCELED
    reached_its_end = outcome.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED)
    if ended_by_cancel and reached_its_end and code in (BtExecute.Result.CANCELED, BtExecute.Result.UNKNOWN):
        return 'canceled', f'{what}: canceled: {detail}' if detail else f'{what}: canceled'
    return 'failed', f'{what}: {detail or "failed without a reason"}'


def read_values(entries: Iterable[Any], types: Mapping[str, str]) -> dict[str, Any]:
    """The values of a result by key, each checked against the type that the state declared.

    Raises:
        FlexbtError: a value cannot be read, has another type, or is missing.
    """
    received = {entry.key: entry for entry in entries}
    values = {}
    for key, type in types.items():
        if key not in received:
            raise FlexbtError(f'the server did not send {key!r}')
        entry = received[key]
        try:
            values[key] = check_value(from_entry(entry), type)
        except FlexbtError as error:
            raise FlexbtError(f'key {key!r}, received as {entry.type}: {error}') from error
    return values
