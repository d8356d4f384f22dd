# SPDX-License-Identifier: BSD-3-Clause
"""One line per step with the elapsed time; commands whose whole output goes into a log file."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from workspace.errors import CommandError, WorkspaceError

_LABEL_WIDTH = 34
_FIRST_NOTE_S = 5.0  # in a log file, and then
_NOTES_S = 10.0


class Step:
    """A step that is being done: what is shown while it lasts, and when it has ended.

    In a terminal that is one line, which changes. In a log file nothing is ever written over: a line for each note,
    and one for the end.
    """

    def __init__(self, label: str, *, alone: bool = True) -> None:
        """`alone`: nothing else is written meanwhile; otherwise a terminal is treated as a log file."""
        self.outcome = 'done'
        self._label = label
        self._live = alone and sys.stdout.isatty()
        self._start = time.monotonic()
        self._next_note = _FIRST_NOTE_S
        if self._live:
            self._write(self._head())

    def show(self, note: str) -> None:
        """Show what is being done now and how much is left: in a terminal at each call, in a log file every 10 s."""
        elapsed = time.monotonic() - self._start
        if self._live:
            head = f'{self._head()}{elapsed:5.0f} s  '
            room = shutil.get_terminal_size().columns - len(head) - 1
            self._write('\r' + head + note[: max(room, 0)] + '\x1b[K')
        elif elapsed >= self._next_note:
            self._next_note = elapsed + _NOTES_S
            self._write(f'  {self._label}, {elapsed:.0f} s{": " if note else ""}{note}\n')

    def end(self, outcome: str) -> None:
        elapsed = time.monotonic() - self._start
        self._write(('\r' if self._live else '') + f'{self._head()}{outcome}  {elapsed:.1f} s')
        self._write('\x1b[K\n' if self._live else '\n')

    def _head(self) -> str:
        return f'  {self._label} '.ljust(_LABEL_WIDTH, '.') + ' '

    def _write(self, text: str) -> None:
        sys.stdout.write(text)
        sys.stdout.flush()


@contextmanager
def step(label: str, *, alone: bool = True) -> Iterator[Step]:
    """Show `label`, and at the end how it went and how long it took. Set `outcome` for another word than done."""
    shown = Step(label, alone=alone)
    try:
        yield shown
    except BaseException as error:
        shown.end('interrupted' if isinstance(error, KeyboardInterrupt) else 'FAILED')
        raise
    shown.end(shown.outcome)


def last_line(log: Path) -> str:
    """Return the last line in `log` that is not empty."""
    with log.open('rb') as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - 500))
        lines = file.read().decode('utf-8', errors='replace').splitlines()
    return next((line.strip() for line in reversed(lines) if line.strip()), '')


def run_logged(
    command: Sequence[str | Path],
    log: Path,
    *,
    shown: Step,
    what: str,
    environment: Mapping[str, str],
    directory: Path,
    progress: Callable[[Path], str] = last_line,
    remedy: str = '',
    keep_open: Sequence[int] = (),
) -> None:
    """Run `command` with its output in `log`, and shows meanwhile what `progress` reads in it.

    The descriptors `keep_open` stay open in the command, so that a lock lasts as long as it does. When we are
    interrupted the command is too, with all that it started.

    Raises CommandError when the exit code is not 0.
    """
    process = start_logged(command, log, environment=environment, directory=directory, keep_open=keep_open)
    finish_logged(process, log, shown=shown, what=what, progress=progress, remedy=remedy)


def start_logged(
    command: Sequence[str | Path],
    log: Path,
    *,
    environment: Mapping[str, str],
    directory: Path,
    keep_open: Sequence[int] = (),
) -> subprocess.Popen[bytes]:
    """Start what `finish_logged` waits for: a command with its output in `log`, as `run_logged`."""
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open('wb') as output:
        return subprocess.Popen(
            [str(word) for word in command],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            cwd=directory,
            start_new_session=True,
            pass_fds=tuple(keep_open),
        )


def finish_logged(
    process: subprocess.Popen[bytes],
    log: Path,
    *,
    shown: Step,
    what: str,
    progress: Callable[[Path], str] = last_line,
    remedy: str = '',
) -> None:
    """Wait for the end of a command, as `run_logged`."""
    try:
        while True:
            try:
                code = process.wait(timeout=0.25)
                break
            except subprocess.TimeoutExpired:
                shown.show(progress(log))
    except BaseException:
        stop_group(process)
        raise
    if code != 0:
        raise CommandError(what, code, log, remedy)


def stop_group(process: subprocess.Popen[bytes] | subprocess.Popen[str], patience: float = 5.0) -> None:
    """End a process that leads its own group, and the group: by SIGINT, after `patience` seconds by SIGKILL."""
    for number, seconds in ((signal.SIGINT, patience), (signal.SIGKILL, patience)):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        try:
            process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            continue
    process.poll()


def report(error: WorkspaceError) -> None:
    """Say what went wrong on stderr: the end of the log where there is one, the message, the remedy."""
    lines = []
    if isinstance(error, CommandError):
        lines += [f'    {line}' for line in error.tail()]
    lines.append(f'error: {error.message}')
    if isinstance(error, CommandError):
        lines.append(f'log: {error.log}')
    if error.remedy:
        lines.append(f'remedy: {error.remedy}')
    sys.stdout.flush()
    print('\n'.join(lines), file=sys.stderr, flush=True)
