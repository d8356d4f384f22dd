# SPDX-License-Identifier: BSD-3-Clause
"""Commands of the tools on copies of files as they are open, saved or not: each in a process of its own, with limits.

The process (:mod:`flexbt_tools.cli.confined`) writes only into its folder of copies, starts no other one, has no
connection, and ends with the studio. So it may also import what the user edits.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from flexbt_core.values.findings import finding_record
from flexbt_core.values.text_files import TextFileError, read_text
from flexbt_studio.errors import StudioError

from .documents.project import MOST_BYTES, MOST_FILES, Project

CHECK_SECONDS: Final = 60.0
"""Time for the check of a behavior in Python, s; to start takes one second of a processor."""
MOST_OUTPUT: Final = 32 << 20
"""Maximum size of what a process writes, bytes."""
_DATA: Final = ('.py', '.xml', '.yaml', '.yml', '.json')
"""Endings of the files that are copied with a behavior."""
_SKIPPED: Final = ('__pycache__', 'build', 'install', 'log', 'node_modules')


@dataclass(frozen=True)
class ToolCopy:
    """A copy of files for one process: the ``tool`` that is run in ``folder``, and its arguments ``words``.

    ``nodes`` are the file and the path in its view of each node, by the path of the node in a run. ``files`` are the
    files of the project that the result is about: an edit of one makes it old.
    """

    folder: tempfile.TemporaryDirectory[str]
    tool: str
    words: list[str]
    nodes: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    files: Sequence[str] = ()

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


def behavior_copy(project: Project, file: str) -> tuple[str, dict[str, str], dict[str, str]]:
    """Return what belongs to a behavior in Python: its name among the copies, and texts by name, as edited and saved.

    These are the files of the outermost package around it; without one, of its folder and the packages in that. Raises
    StudioError.
    """
    own = project.path(file)
    top = own.parent
    while (top / '__init__.py').is_file():
        top = top.parent
    package = top / own.relative_to(top).parts[0] if top != own.parent else top
    now: dict[str, str] = {}
    for folder, folders, names in os.walk(package):
        kept = [one for one in folders if one not in _SKIPPED and not one.startswith('.')]
        folders[:] = kept if package != top else [one for one in kept if Path(folder, one, '__init__.py').is_file()]
        for name in names:
            path = Path(folder, name)
            if path.suffix in _DATA and len(now) < MOST_FILES:
                with contextlib.suppress(TextFileError):  # what is no text is not copied
                    now[path.relative_to(top).as_posix()] = read_text(path, MOST_BYTES)
    saved = dict(now)
    for name, opened in project.open_files.items():
        path = project.root / name
        if path.is_relative_to(package):
            now[path.relative_to(top).as_posix()] = opened.document.text
            saved[path.relative_to(top).as_posix()] = opened.saved_text
    return own.relative_to(top).as_posix(), now, saved


def check_copy(project: Project, file: str) -> tuple[str, ToolCopy]:
    """Return the name of a behavior in Python among the copies, and the copy for its check. Raises StudioError."""
    name, texts, _ = behavior_copy(project, file)
    return name, ToolCopy(new_folder(texts), 'behavior_tool', ['check', '--json', '--', name])


async def checked(copy: ToolCopy) -> list[dict[str, Any]]:
    """Return the records of what the check of a behavior in Python finds; if it fails, one with the reason."""
    try:
        found: list[dict[str, Any]] = (await run_tool(copy, CHECK_SECONDS))[-1]['findings']
        return found
    except TimeoutError:
        reason = f'it took more than {CHECK_SECONDS:g} s and was ended'
    except (OSError, StudioError, LookupError) as error:
        reason = str(error)
    return [{**finding_record('not-checked', 'warning', f'it could not be checked: {reason}')}]


async def run_tool(copy: ToolCopy, seconds: float) -> list[dict[str, Any]]:
    """Run a tool and return the lines of JSON that it prints. The copy is removed.

    Raises:
        TimeoutError: it took more than this many ``seconds``, and was ended.
        StudioError: it printed no result; the message has the reason.
        OSError: it could not be started.
    """
    confined = ['-P', '-B', '-m', 'flexbt_tools.cli.confined', str(os.getpid()), str(max(int(seconds), 1))]
    pipe, nothing = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    command = [sys.executable, *confined, copy.tool, *copy.words]
    folder = copy.folder.name
    starting = asyncio.create_task(
        asyncio.create_subprocess_exec(*command, stdin=nothing, stdout=pipe, stderr=pipe, cwd=folder)
    )
    try:
        process = await asyncio.shield(starting)  # one that is cancelled while it starts is ended below
        async with asyncio.timeout(seconds):
            out, error = await asyncio.gather(_read(process.stdout), _read(process.stderr))
            code = await process.wait()
        try:
            result = [json.loads(line) for line in copy.shown(out).splitlines() if line.startswith('{')]
        except ValueError as fault:
            raise StudioError(f'the result cannot be read: {fault}') from fault
        if not result:
            how = f'ended with code {code}' if code >= 0 else f'was ended by signal {-code}: time, memory, or a fault'
            raise StudioError(copy.shown((error.strip().splitlines() or [f'the process {how}'])[-1][-1000:]))
        return result
    finally:
        with contextlib.suppress(OSError):
            process = await starting
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
        copy.folder.cleanup()


async def _read(stream: asyncio.StreamReader | None) -> str:
    """Return what a process writes, at most MOST_OUTPUT of it. Raises StudioError if it is more."""
    assert stream is not None
    parts: list[bytes] = []
    size = 0
    while part := await stream.read(1 << 16):
        parts.append(part)
        size += len(part)
        if size > MOST_OUTPUT:
            raise StudioError('the result of the job is too large to be shown')
    return b''.join(parts).decode(errors='replace')
