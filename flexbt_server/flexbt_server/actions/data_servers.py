# SPDX-License-Identifier: BSD-3-Clause
"""The actions ``bt_get_data`` and ``bt_set_data``: blackboards, read and written from outside."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import Encoding
from flexbt_core.behavior_tree import BlackboardError
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import BtGetData, BtSetData
from flexbt_server.trees import Blackboards, entries_of, read_values, write_all


class DataServers:
    """Serves BtGetData and BtSetData. ``on_write(blackboard)`` is told when entries were written."""

    def __init__(
        self, runtime: NodeRuntime, boards: Blackboards, on_write: Callable[[str], None], admission: GoalAdmission
    ) -> None:
        self._boards = boards
        self._on_write = on_write
        servers = [
            GoalServer(runtime, action, name, admission.guard(serve, refused), refused=refused)
            for action, name, serve, refused in (
                (BtGetData, names.BT_GET_DATA, self._get, functools.partial(_refused, BtGetData)),
                (BtSetData, names.BT_SET_DATA, self._set, functools.partial(_refused, BtSetData)),
            )
        ]

        def close() -> None:
            for server in servers:
                server.close()

        runtime.on_close(lambda: runtime.call(close))

    def _get(self, goal: ServedGoal) -> None:
        request = goal.request
        board = self._boards.get(request.blackboard)
        keys = list(request.keys) or sorted(board.snapshot())
        encoding = Encoding.BINARY if request.encoding == BtGetData.Goal.BINARY else Encoding.TEXT
        entries, missing, problems = entries_of(board, keys, encoding)
        where = f'blackboard {request.blackboard!r}' if request.blackboard else 'the shared blackboard'
        problems = [f'{where} has no value for {key!r}' for key in missing] + problems
        if problems:
            goal.abort(BtGetData.Result(code=BtGetData.Result.FAILURE, message='; '.join(problems), entries=entries))
            return
        goal.succeed(BtGetData.Result(code=BtGetData.Result.SUCCESS, entries=entries))

    def _set(self, goal: ServedGoal) -> None:
        request = goal.request
        try:
            if not request.entries:
                raise FlexbtError('the goal has no entries')
            write_all(self._boards.get(request.blackboard), read_values(request.entries))
        except (FlexbtError, BlackboardError) as error:
            goal.abort(BtSetData.Result(code=BtSetData.Result.FAILURE, message=f'nothing was written: {error}'))
            return
        self._on_write(request.blackboard)
        goal.succeed(BtSetData.Result(code=BtSetData.Result.SUCCESS))


def _refused(action: Any, why: str) -> Any:
    return action.Result(code=action.Result.FAILURE, message=why)
