# SPDX-License-Identifier: BSD-3-Clause
"""Goals whose results are computed: one after the other, on a thread of their own."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from flexbt_common.calls import ServedGoal
from flexbt_common.runtime import NodeRuntime

from .action_results import CANCELED, GoalEnd, end_by

T = TypeVar('T')


class Computation:
    """The thread. What a goal wants is computed in the order of the goals; what nobody wants any more is left out."""

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
        """The same for what is no goal: ``on_done`` is told the result, or the error that came in its way."""

        def work() -> None:
            result, reason = None, None
            try:
                result = compute()
            except Exception as error:
                reason = error
            self._runtime.post(lambda: on_done(result, reason))

        self._pool.submit(work)
