# SPDX-License-Identifier: BSD-3-Clause
"""Goals of the navigation actions: their ends and results, and goals whose results are computed on their own thread."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

from nav_msgs.msg import Path

from flexbt_common.calls.goal_server import ServedGoal, set_error
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.errors import NavigationError


@dataclass(frozen=True)
class GoalEnd:
    """The end of a goal: succeeded, canceled, or failed with the name of an error code."""

    succeeded: bool = False
    canceled: bool = False
    code: str = 'NONE'
    message: str = ''


class OnPathEnd(Protocol):
    """A callback that ends a goal, with a path if there is one."""

    def __call__(self, end: GoalEnd, path: Path | None = None) -> None: ...


SUCCEEDED: Final = GoalEnd(succeeded=True)
CANCELED: Final = GoalEnd(canceled=True, message='canceled by the client')


def end_by(runtime: NodeRuntime, error: Exception, what: str) -> GoalEnd:
    """Return the end of a goal that an error came in the way of; a fault of ours is reported as one of ``what``."""
    if isinstance(error, NavigationError):
        return GoalEnd(code=error.code, message=str(error))
    runtime.report_fault(error, what)
    return GoalEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}')


def finish(goal: ServedGoal, result: Any, end: GoalEnd) -> None:
    """Fill in error code and message, and end the goal.

    Not every action has every code: one that it lacks becomes its UNKNOWN. (Wait has none at all, only the message;
    the actions of routes have none.)
    """
    set_error(result, int(getattr(result, end.code, getattr(result, 'UNKNOWN', 0))), end.message)
    if end.succeeded:
        goal.succeed(result)
    elif end.canceled:
        goal.canceled(result)
    else:
        goal.abort(result)


# Goals whose results are computed: one after the other, on a thread of their own.

T = TypeVar('T')


class Computation:
    """The thread. Results are computed in the order of the goals; what nobody wants any more is left out."""

    def __init__(self, runtime: NodeRuntime, name: str) -> None:
        self._runtime = runtime
        self._name = name
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        self._pool.submit(lambda: None)  # its thread begins now: for a goal, there might be none left
        runtime.on_close(lambda: self._pool.shutdown(wait=False, cancel_futures=True))

    def run(
        self,
        goal: ServedGoal,
        compute: Callable[[], T],
        on_result: Callable[[T], None],
        on_end: Callable[[GoalEnd], None],
    ) -> None:
        """``compute()`` on the thread, then ``on_result`` with what it returns, on that of the executor.

        When it raises, or the goal was canceled meanwhile, ``on_end`` instead.
        """

        def deliver(result: T) -> None:
            if goal.cancel_requested:
                on_end(CANCELED)
            else:
                on_result(result)

        def work() -> None:
            if goal.cancel_requested:
                self._runtime.post(lambda: on_end(CANCELED))
                return
            try:
                result = compute()
            except Exception as error:
                end = CANCELED if goal.cancel_requested else end_by(self._runtime, error, self._name)
                self._runtime.post(lambda: on_end(end))
            else:
                self._runtime.post(lambda: deliver(result))

        self._pool.submit(work)

    def ask(self, compute: Callable[[], T], on_done: Callable[[T | None, Exception | None], None]) -> None:
        """Do the same for what is not a goal: ``on_done`` gets the result, or the error that came in its way."""

        def work() -> None:
            result, reason = None, None
            try:
                result = compute()
            except Exception as error:
                reason = error
            self._runtime.post(lambda: on_done(result, reason))

        self._pool.submit(work)
