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
from flexbt_core.clock import WorkThread
from flexbt_core.errors import FlexbtError
from flexbt_core.values import sendable
from flexbt_msgs.action import BtGetData, BtSetData
from flexbt_server.goals import MESSAGE_LIMIT
from flexbt_server.trees import Blackboards, entries_of, write_all


class DataServers:
    """Serves BtGetData and BtSetData. ``on_write(blackboard)`` is told when entries were written.

    Values are converted on the thread of ``reader``, as those of goals for trees: in the order of all these goals.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        boards: Blackboards,
        reader: WorkThread,
        on_write: Callable[[str], None],
        admission: GoalAdmission,
    ) -> None:
        self._runtime = runtime
        self._boards = boards
        self._reader = reader
        self._on_write = on_write
        for action, name, answer in (
            (BtGetData, names.BT_GET_DATA, self._get),
            (BtSetData, names.BT_SET_DATA, self._set),
        ):
            GoalServer(
                runtime,
                action,
                name,
                self._serve(action, answer),
                refused=functools.partial(_refused, action),
                admission=admission,
                cancelable=False,
            )

    def _serve(self, action: Any, answer: Callable[[Any], Any]) -> Callable[[ServedGoal], None]:
        def serve(goal: ServedGoal) -> None:
            def work() -> None:
                try:
                    result = answer(goal.request)
                except BaseException as error:  # a fault of ours goes to the client as well
                    fault = error
                    self._runtime.post(lambda: self._runtime.report_fault(fault, 'a goal for a blackboard'))
                    message = sendable(f'fault in the BT server: {error!r}', MESSAGE_LIMIT)
                    result = action.Result(code=action.Result.ERROR, message=message)
                self._runtime.post(lambda: end(result))

            def end(result: Any) -> None:
                if result.code == result.SUCCESS:
                    goal.succeed(result)
                else:
                    goal.abort(result)

            self._reader.submit(work, 'a goal for a blackboard was not done')

        return serve

    def _get(self, request: Any) -> Any:
        board = self._boards.find(request.blackboard)
        keys = list(request.keys) or sorted(board.snapshot())
        encoding = Encoding.BINARY if request.encoding == BtGetData.Goal.BINARY else Encoding.TEXT
        entries, missing, problems = entries_of(board, keys, encoding)
        where = f'blackboard {request.blackboard!r}' if request.blackboard else 'the shared blackboard'
        problems = [f'{where} has no value for {key!r}' for key in missing] + problems
        code = BtGetData.Result.FAILURE if problems else BtGetData.Result.SUCCESS
        return BtGetData.Result(code=code, message=sendable('; '.join(problems), MESSAGE_LIMIT), entries=entries)

    def _set(self, request: Any) -> Any:
        try:
            if not request.entries:
                raise FlexbtError('the goal has no entries')
            values = self._boards.receive(request.blackboard, request.entries)
            write_all(self._boards.get(request.blackboard), values)
        except (FlexbtError, BlackboardError) as error:
            message = sendable(f'nothing was written: {error}', MESSAGE_LIMIT)
            return BtSetData.Result(code=BtSetData.Result.FAILURE, message=message)
        self._runtime.post(lambda: self._on_write(request.blackboard))
        return BtSetData.Result(code=BtSetData.Result.SUCCESS)


def _refused(action: Any, why: str) -> Any:
    return action.Result(code=action.Result.FAILURE, message=why)
