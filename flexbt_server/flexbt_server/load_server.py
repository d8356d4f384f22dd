# SPDX-License-Identifier: BSD-3-Clause
"""The action ``bt_loader``: files and XML text become trees that can be run."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.node_runtime import NodeRuntime
from flexbt_common.sendable import sendable
from flexbt_msgs.action import BtLoad
from flexbt_msgs.msg import BtLoadError, BtLoadReport
from flexbt_server.tree_store import FileReport, TreeStore

Result = BtLoad.Result

RESULT_TIMEOUT = 15.0
"""How long the result of a finished goal can be asked for again, s."""

ERRORS_SHOWN = 20
"""Errors of one file that travel with the result; a hostile file has more than anyone reads."""


class LoadServer:
    """Serves BtLoad. Files are read on the thread of ``reader``, one goal after the other."""

    def __init__(self, runtime: NodeRuntime, store: TreeStore, reader: ThreadPoolExecutor) -> None:
        self._runtime = runtime
        self._store = store
        self._reader = reader
        self._server = ActionServer(
            runtime.node,
            BtLoad,
            names.BT_LOADER,
            self._execute,
            goal_callback=lambda request: GoalResponse.ACCEPT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            result_timeout=int(RESULT_TIMEOUT),
            **names.deep_action_services(),
        )
        runtime.on_close(lambda: runtime.call(self._server.destroy))

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        request = handle.request
        total = len(request.files) + bool(request.xml)
        if not total:
            handle.abort()
            return BtLoad.Result(code=Result.FAILURE, message='the goal names no file and has no XML text')
        done = Future(executor=self._runtime.node.executor)

        def progress(file: str, count: int) -> bool:
            feedback = BtLoad.Feedback(file=file, done=count, total=total)
            self._runtime.post(lambda: handle.publish_feedback(feedback))
            return not handle.is_cancel_requested

        def work() -> None:
            try:
                reports = self._store.load(request.files, request.xml, progress)
            except Exception as error:
                failure = error
                self._runtime.post(lambda: done.set_exception(failure))
            else:
                self._runtime.post(lambda: done.set_result(reports))

        self._reader.submit(work)
        try:
            reports = await done
        except Exception as error:  # a fault of ours goes to the client as well
            self._runtime.report_fault(error, f'goal of {names.BT_LOADER}')
            handle.abort()
            return BtLoad.Result(code=Result.ERROR, message=f'fault in the BT server: {error!r}')
        return _finish(handle, reports)


def _finish(handle: ServerGoalHandle, reports: list[FileReport]) -> Any:
    messages = [_message(report) for report in reports]
    refused = [report for report in reports if report.code == BtLoadReport.REFUSED]
    if refused:
        handle.abort()
        first = str(refused[0].errors[0])
        count = sum(len(report.errors) for report in refused)
        message = first if count == 1 else f'{first} (and {count - 1} more errors)'
        return BtLoad.Result(code=Result.FAILURE, message=f'nothing was loaded: {message}', reports=messages)
    if all(report.code in (BtLoadReport.LOADED, BtLoadReport.UNCHANGED) for report in reports):
        handle.succeed()
        return BtLoad.Result(code=Result.SUCCESS, reports=messages)
    handle.canceled()
    return BtLoad.Result(code=Result.CANCELED, message='canceled; nothing was loaded', reports=messages)


def _message(report: FileReport) -> BtLoadReport:
    return BtLoadReport(
        file=report.file,
        code=report.code,
        trees=list(report.trees),
        errors=[
            BtLoadError(
                file=report.file,
                line=error.line,
                column=error.column,
                node=error.node,
                message=sendable(error.message),
            )
            for error in report.errors[:ERRORS_SHOWN]
        ],
    )
