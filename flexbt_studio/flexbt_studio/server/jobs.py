# SPDX-License-Identifier: BSD-3-Clause
"""Jobs: proofs, comparisons and dry runs of open files, each in a process that can be ended.

A job runs a command of the tools on a copy of the project's trees and machines as they are open, saved or not.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import count
from typing import Any, Final

from flexbt_studio.errors import StudioError
from flexbt_studio.tool_process import ToolCopy, run_tool

JOB_SECONDS: Final = 180.0
"""Time after which a job is ended, s."""
MOST_JOBS: Final = 4
"""Jobs at the same time; more are refused."""

Tell = Callable[[dict[str, Any]], None]


class Jobs:
    """The jobs that run. Used on the thread of the loop. ``tell`` sends an event to all pages."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._numbers = count(1)
        self._running: dict[int, asyncio.Task[None]] = {}

    async def close(self) -> None:
        """End all jobs and wait for their processes."""
        for task in self._running.values():
            task.cancel()
        await asyncio.gather(*self._running.values(), return_exceptions=True)

    def start(self, job: str, file: str, version: int, copy: ToolCopy) -> dict[str, Any]:
        """Start a job, and return its number and the files that it is about.

        An event ``job`` follows with its ``state``: done, failed or canceled. Raises StudioError if too many run.
        """
        if len(self._running) >= MOST_JOBS:
            copy.folder.cleanup()
            raise StudioError(f'{MOST_JOBS} jobs run already; wait for one, or cancel one')
        number = next(self._numbers)
        event = {
            'event': 'job',
            'number': number,
            'job': job,
            'file': file,
            'version': version,
            'nodes': dict(copy.nodes),
        }
        task = asyncio.create_task(self._run(event, copy))
        self._running[number] = task
        task.add_done_callback(lambda _: self._running.pop(number, None))
        return {'number': number, 'files': list(copy.files)}

    def cancel(self, number: int) -> None:
        """End a job. One that has ended stays as it is."""
        task = self._running.get(number)
        if task is not None:
            task.cancel()

    async def _run(self, event: dict[str, Any], copy: ToolCopy) -> None:
        ended: dict[str, Any] = {'state': 'canceled'}
        try:
            ended = {'state': 'done', 'result': await run_tool(copy, JOB_SECONDS)}
        except TimeoutError:
            ended = {'state': 'failed', 'message': f'it took more than {JOB_SECONDS:g} s and was ended'}
        except (OSError, StudioError) as error:
            ended = {'state': 'failed', 'message': str(error)}
        finally:
            self._tell({**event, **ended})  # only now: its process is gone
