# SPDX-License-Identifier: BSD-3-Clause
"""The action ``bt_loader``: files and XML text become trees that can be run."""

from __future__ import annotations

from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import WorkThread
from flexbt_core.values import sendable
from flexbt_msgs.action import BtLoad
from flexbt_msgs.msg import BtLoadError, BtLoadReport
from flexbt_server.trees import FileReport, TreeStore

Result = BtLoad.Result

MOST_LOADS: Final = 100
"""Goals that wait for their turn at most."""

ERRORS_SHOWN: Final = 20
"""Errors of one file that travel with the result; a hostile file has more than anyone reads."""


class LoadServer:
    """Serves BtLoad. Files are read on the thread of ``reader``, one goal after the other."""

    def __init__(self, runtime: NodeRuntime, store: TreeStore, reader: WorkThread, admission: GoalAdmission) -> None:
        self._runtime = runtime
        self._store = store
        self._reader = reader
        # A goal that is to be canceled ends at the next file.
        GoalServer(
            runtime,
            BtLoad,
            names.BT_LOADER,
            self._serve,
            refused=_refused,
            most=MOST_LOADS,
            admission=admission,
        )

    def _serve(self, goal: ServedGoal) -> None:
        request = goal.request
        total = len(request.files) + bool(request.xml)
        if not total:
            goal.abort(BtLoad.Result(code=Result.FAILURE, message='the goal names no file and has no XML text'))
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
        """A fault of ours goes to the client as well."""
        self._runtime.report_fault(fault, f'goal of {names.BT_LOADER}')
        goal.abort(BtLoad.Result(code=Result.ERROR, message=f'fault in the BT server: {fault!r}'))


def _refused(why: str) -> Any:
    return Result(code=Result.FAILURE, message=f'nothing was loaded: {why}')


def _finish(goal: ServedGoal, reports: list[FileReport]) -> None:
    messages = [_message(report) for report in reports]
    refused = [report for report in reports if report.code == BtLoadReport.REFUSED]
    if refused:
        first = str(refused[0].errors[0])
        count = sum(len(report.errors) for report in refused)
        message = first if count == 1 else f'{first} (and {count - 1} more errors)'
        goal.abort(BtLoad.Result(code=Result.FAILURE, message=f'nothing was loaded: {message}', reports=messages))
    elif all(report.code in (BtLoadReport.LOADED, BtLoadReport.UNCHANGED) for report in reports):
        notice = '; '.join(filter(None, [report.notice for report in reports]))
        goal.succeed(BtLoad.Result(code=Result.SUCCESS, message=sendable(notice), reports=messages))
    else:
        goal.canceled(BtLoad.Result(code=Result.CANCELED, message='canceled; nothing was loaded', reports=messages))


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
