# SPDX-License-Identifier: BSD-3-Clause
"""Jobs: proofs, comparisons and dry runs of open files, each in a process that can be ended.

A job runs a command of the tools on a copy of the project's trees and machines as they are open, saved or not.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Final

from flexbt_studio.errors import StudioError

JOB_SECONDS: Final = 180.0
"""Time after which a job is ended, s."""
MOST_JOBS: Final = 4
"""Jobs at the same time; more are refused."""
MOST_BYTES: Final = 32 << 20
"""Maximum size of the result of a job, bytes."""
_CALL: Final = 'import sys; from flexbt_tools.executables import {0}; sys.exit({0}())'

Tell = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class JobCopy:
    """A copy of the project for one job: the ``tool`` that is run in ``folder``, and its arguments ``words``.

    ``nodes`` are the file and the path in its view of each node, by the path of the node in a run.
    """

    folder: tempfile.TemporaryDirectory[str]
    tool: str
    words: list[str]
    nodes: Mapping[str, tuple[str, str]]

    def shown(self, text: str) -> str:
        """Return a message of the tool without the name of the folder."""
        return text.replace(f'{self.folder.name}/', '')


def new_folder(texts: Mapping[str, str]) -> tempfile.TemporaryDirectory[str]:
    """Return a new folder with files of these names and texts. Raises StudioError if they cannot be written."""
    folder = tempfile.TemporaryDirectory(prefix='flexbt_studio_', ignore_cleanup_errors=True)
    try:
        for file, text in texts.items():
            path = Path(folder.name, file)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding='utf-8', newline='')
    except OSError as error:
        folder.cleanup()
        raise StudioError(f'the copy of the project for this job cannot be written: {error}') from error
    return folder


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

    def start(self, job: str, file: str, version: int, copy: JobCopy) -> int:
        """Start a job, and return its number. An event ``job`` follows with its ``state``: done, failed or canceled.

        Raises StudioError if too many run.
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
        return number

    def cancel(self, number: int) -> None:
        """End a job. One that has ended stays as it is."""
        task = self._running.get(number)
        if task is not None:
            task.cancel()

    async def _run(self, event: dict[str, Any], copy: JobCopy) -> None:
        command = [sys.executable, '-P', '-c', _CALL.format(copy.tool), *copy.words]
        pipe = asyncio.subprocess.PIPE
        starting = asyncio.create_task(
            asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe, cwd=copy.folder.name
            )
        )
        ended: dict[str, Any] = {'state': 'canceled'}
        try:
            process = await asyncio.shield(starting)  # one that is cancelled while it starts is ended below
            async with asyncio.timeout(JOB_SECONDS):
                out, error = await asyncio.gather(_read(process.stdout), _read(process.stderr))
                code = await process.wait()
            result = [json.loads(line) for line in out.splitlines() if line.startswith('{')]
            if not result:
                told = error.strip().splitlines()[-1:] or [f'the tool ended with code {code}']
                raise StudioError(copy.shown(told[0]))
            ended = {'state': 'done', 'result': result}
        except TimeoutError:
            ended = {'state': 'failed', 'message': f'it took more than {JOB_SECONDS:g} s and was ended'}
        except (OSError, ValueError, StudioError) as error:
            ended = {'state': 'failed', 'message': str(error)}
        finally:
            with contextlib.suppress(OSError):
                process = await starting
                if process.returncode is None:
                    with contextlib.suppress(ProcessLookupError):
                        process.kill()
                    await process.wait()
            copy.folder.cleanup()
            self._tell({**event, **ended})  # only now: its process is gone


async def _read(stream: asyncio.StreamReader | None) -> str:
    """Return what a process writes, at most MOST_BYTES of it. Raises StudioError if it is more."""
    assert stream is not None
    parts: list[bytes] = []
    size = 0
    while part := await stream.read(1 << 16):
        parts.append(part)
        size += len(part)
        if size > MOST_BYTES:
            raise StudioError('the result of the job is too large to be shown')
    return b''.join(parts).decode(errors='replace')
