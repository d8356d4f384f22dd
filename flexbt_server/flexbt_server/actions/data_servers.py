# SPDX-License-Identifier: BSD-3-Clause
"""The actions ``BtLoad``, ``BtGetData`` and ``BtSetData``: load trees, read and write blackboards."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.entries import Encoding
from flexbt_core.behavior_tree.model.errors import BlackboardError
from flexbt_core.clock.work_thread import WorkThread
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.action import BtGetData, BtLoad, BtSetData
from flexbt_msgs.msg import BtLoadError, BtLoadReport
from flexbt_server.trees.blackboards import Blackboards, entries_of, write_all
from flexbt_server.trees.tree_store import FileReport, TreeStore, asked_name

from .tree_goals import MESSAGE_LIMIT, TreeGoals

LoadResult = BtLoad.Result

MOST_LOADS: Final = 100
"""Maximum number of goals that wait for their turn."""

ERRORS_SHOWN: Final = 20
"""Maximum number of errors of one file in the result; a hostile file has more than anyone reads."""


class LoadServer:
    """The server of BtLoad. The thread of ``reader`` reads the files, one goal after the other."""

    def __init__(self, runtime: Runtime, store: TreeStore, reader: WorkThread, admission: GoalAdmission) -> None:
        self._runtime = runtime
        self._store = store
        self._reader = reader
        # A cancel takes effect at the next file.
        GoalServer(
            runtime,
            BtLoad,
            names.BT_LOADER,
            self._serve,
            refused=_refused_load,
            most=MOST_LOADS,
            admission=admission,
        )

    def _serve(self, goal: ServedGoal) -> None:
        request = goal.request
        total = len(request.files) + bool(request.xml)
        if not total:
            goal.abort(BtLoad.Result(code=LoadResult.FAILURE, message='the goal names no file and has no XML text'))
            return

        def progress(file: str, count: int) -> bool:
            feedback = BtLoad.Feedback(file=file, done=count, total=total)
            self._runtime.post(lambda: goal.publish_feedback(feedback))
            return not goal.cancel_requested

        def work() -> None:
            try:
                reports = self._store.load(request.files, request.xml, progress)
            except BaseException as error:
                fault = error
                self._runtime.post(lambda: self._abort(goal, fault))
            else:
                for notice in filter(None, [report.notice for report in reports]):
                    self._runtime.node.get_logger().warning(notice)
                self._runtime.post(lambda: _finish(goal, reports))

        self._reader.submit(work, f'goal of {names.BT_LOADER}: its trees were not read')

    def _abort(self, goal: ServedGoal, fault: BaseException) -> None:
        """Report an internal fault to the client too."""
        self._runtime.report_fault(fault, f'goal of {names.BT_LOADER}')
        goal.abort(BtLoad.Result(code=LoadResult.ERROR, message=f'fault in the BT server: {fault!r}'))


def _refused_load(why: str) -> Any:
    return LoadResult(code=LoadResult.FAILURE, message=f'nothing was loaded: {why}')


def _finish(goal: ServedGoal, reports: list[FileReport]) -> None:
    messages = [_message(report) for report in reports]
    refused = [report for report in reports if report.code == BtLoadReport.REFUSED]
    if refused:
        first = str(refused[0].errors[0])
        count = sum(len(report.errors) for report in refused)
        message = first if count == 1 else f'{first} (and {count - 1} more errors)'
        goal.abort(BtLoad.Result(code=LoadResult.FAILURE, message=f'nothing was loaded: {message}', reports=messages))
    elif all(report.code in (BtLoadReport.LOADED, BtLoadReport.UNCHANGED) for report in reports):
        notice = '; '.join(filter(None, [report.notice for report in reports]))
        goal.succeed(BtLoad.Result(code=LoadResult.SUCCESS, message=sanitize_for_message(notice), reports=messages))
    else:
        goal.canceled(BtLoad.Result(code=LoadResult.CANCELED, message='canceled; nothing was loaded', reports=messages))


def _message(report: FileReport) -> BtLoadReport:
    return BtLoadReport(
        file=report.file,
        code=report.code,
        trees=list(report.trees),
        errors=[
            BtLoadError(
                file=asked_name(error.file),
                line=error.line,
                column=error.column,
                node=error.node,
                message=sanitize_for_message(error.message),
            )
            for error in report.errors[:ERRORS_SHOWN]
        ],
    )


# The actions ``bt_get_data`` and ``bt_set_data``, by which clients read and write blackboards.


class DataServers:
    """The servers of BtGetData and BtSetData. Written entries wake the trees among ``goals``.

    The thread of ``reader`` converts the values, in order with the values of goals for trees.
    """

    def __init__(
        self,
        runtime: Runtime,
        boards: Blackboards,
        reader: WorkThread,
        goals: TreeGoals,
        admission: GoalAdmission,
    ) -> None:
        self._runtime = runtime
        self._boards = boards
        self._reader = reader
        self._goals = goals
        for action, name, answer in (
            (BtGetData, names.BT_GET_DATA, self._get),
            (BtSetData, names.BT_SET_DATA, self._set),
        ):
            GoalServer(
                runtime,
                action,
                name,
                self._serve(action, answer),
                refused=functools.partial(_refused_data, action),
                admission=admission,
                cancelable=False,
            )

    def _serve(self, action: Any, answer: Callable[[Any], Any]) -> Callable[[ServedGoal], None]:
        def serve(goal: ServedGoal) -> None:
            def work() -> None:
                try:
                    result = answer(goal.request)
                except BaseException as error:  # the client gets a fault of the server too
                    fault = error
                    self._runtime.post(lambda: self._runtime.report_fault(fault, 'a goal for a blackboard'))
                    message = sanitize_for_message(f'fault in the BT server: {error!r}', MESSAGE_LIMIT)
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
        return BtGetData.Result(
            code=code, message=sanitize_for_message('; '.join(problems), MESSAGE_LIMIT), entries=entries
        )

    def _set(self, request: Any) -> Any:
        try:
            if not request.entries:
                raise FlexbtError('the goal has no entries')
            values = self._boards.receive(request.blackboard, request.entries)
            write_all(self._boards.get(request.blackboard), values)
        except (FlexbtError, BlackboardError) as error:
            message = sanitize_for_message(f'nothing was written: {error}', MESSAGE_LIMIT)
            return BtSetData.Result(code=BtSetData.Result.FAILURE, message=message)
        self._runtime.post(lambda: self._goals.wake(request.blackboard))
        return BtSetData.Result(code=BtSetData.Result.SUCCESS)


def _refused_data(action: Any, why: str) -> Any:
    return action.Result(code=action.Result.FAILURE, message=why)
