# SPDX-License-Identifier: BSD-3-Clause
"""A group of child processes: started together, watched, and always ended."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from .report import DemoError

# Time limit for a process to end on request, s, before it is killed. FlexBT's nodes end well before that.
END_TIMEOUT_S = 1.7
LAST_LINES = 15

RESPAWN_DELAY_S = 1.0
RESPAWNS = 3
RESPAWN_WINDOW_S = 60.0
"""Time window that limits restarts, s.

A process that died is restarted after the delay, a limited number of times within the window: more restarts of a
process that dies repeatedly would not help.
"""

_PR_SET_PDEATHSIG = 1  # prctl(2)


@dataclass(frozen=True)
class EndedProcess:
    """A process that ended unexpectedly."""

    name: str
    exit_code: int
    log: Path
    is_respawned: bool = False
    may_end: bool = True
    """True if it is a program that is expected to end and is not restarted."""

    def report(self) -> str:
        """Return a report for a person: the process, how it ended, and the end of its output."""
        how = f'signal {-self.exit_code}' if self.exit_code < 0 else f'exit code {self.exit_code}'
        lines = self.log.read_text(errors='replace').splitlines()[-LAST_LINES:] if self.log.exists() else []
        said = '\n'.join(f'    {line}' for line in lines) or '    (it said nothing)'
        then = 'it is started again; ' if self.is_respawned else ''
        return f'process {self.name} ended with {how}; {then}the end of {self.log}:\n{said}'


@dataclass
class ProcessGroup:
    """The processes of one demonstration. Leaving the context ends all of them.

    Each process writes to a separate log file in `log_directory` and runs in a separate session. So Ctrl-C in the
    terminal reaches only the demonstration, which then ends the processes in order. If the demonstration itself is
    killed, the kernel ends them.
    """

    log_directory: Path
    _processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)
    _watchers: list[threading.Thread] = field(default_factory=list)
    _ending: threading.Event = field(default_factory=threading.Event)
    _ended: list[EndedProcess] = field(default_factory=list)
    _taken: int = 0
    _killed: set[str] = field(default_factory=set)
    _listener: Callable[[EndedProcess], None] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> ProcessGroup:
        """Create the log directory. Raises DemoError if it is not writable."""
        try:
            self.log_directory.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=self.log_directory).close()
        except OSError as error:
            remedy = 'name another directory: make demo OUTPUT=DIR, or --output DIR'
            raise DemoError(f'{self.log_directory}: {error.strerror}; {remedy}') from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End every process."""
        self.end()

    def start(
        self,
        name: str,
        command: Sequence[str],
        environment: Mapping[str, str] | None = None,
        respawn: bool = False,
    ) -> None:
        """Start `command` under `name`, also the name of its log file.

        With `respawn`, restart it whenever it has died, up to a limit.
        """
        log = self.log_directory / f'{name}.log'
        log.write_bytes(b'')

        def launch() -> subprocess.Popen[bytes]:
            with log.open('ab') as output:
                return _start(list(command), output.fileno(), environment)

        self._processes[name] = launch()
        watcher = threading.Thread(
            target=self._watch, args=(name, log, launch if respawn else None), name=f'watch {name}', daemon=True
        )
        self._watchers.append(watcher)
        watcher.start()

    def watch(self, listener: Callable[[EndedProcess], None]) -> None:
        """Call `listener`, on another thread, for each unexpected end; at once for earlier ones."""
        with self._lock:
            self._listener = listener
            ended = list(self._ended)
        for process in ended:
            listener(process)

    def take_ended(self) -> list[EndedProcess]:
        """Return the processes that ended unexpectedly since the last call, each with its last end or crash."""
        with self._lock:
            ended, self._taken = self._ended[self._taken :], len(self._ended)
        return list({process.name: process for process in sorted(ended, key=lambda one: one.exit_code != 0)}.values())

    def pid(self, name: str) -> int:
        """Return the process id of the process last started as `name`."""
        return self._processes[name].pid

    def kill(self, *names: str) -> None:
        """Kill processes without respawn or report, as in a power failure of their computer."""
        with self._lock:
            self._killed.update(names)
            for name in names:
                _signal(self._processes[name], signal.SIGKILL)

    def end(self) -> list[str]:
        """End every process with SIGINT, or SIGKILL after the time limit. Return the names of the killed ones."""
        with self._lock:
            self._ending.set()
        deadline = time.monotonic() + END_TIMEOUT_S
        for process in self._processes.values():
            _signal(process, signal.SIGINT)
        killed = []
        for name, process in self._processes.items():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                _signal(process, signal.SIGKILL)
                process.wait()
                killed.append(name)
        for watcher in self._watchers:
            watcher.join()
        self._processes.clear()
        self._watchers.clear()
        return killed

    def _watch(self, name: str, log: Path, launch: Callable[[], subprocess.Popen[bytes]] | None) -> None:
        respawns: list[float] = []
        while True:
            exit_code = self._processes[name].wait()
            with self._lock:
                if self._ending.is_set() or name in self._killed:
                    return
                now = time.monotonic()
                respawns = [then for then in respawns if now - then < RESPAWN_WINDOW_S]
                is_respawned = launch is not None and len(respawns) < RESPAWNS
                ended = EndedProcess(name, exit_code, log, is_respawned, may_end=launch is None)
                self._ended.append(ended)
                listener = self._listener
            if listener is not None:
                listener(ended)
            if launch is None or not is_respawned or self._ending.wait(RESPAWN_DELAY_S):
                return
            with self._lock:
                if self._ending.is_set() or name in self._killed:
                    return
                respawns.append(now)
                self._processes[name] = launch()


def _start(words: list[str], log: int, environment: Mapping[str, str] | None) -> subprocess.Popen[bytes]:
    return subprocess.Popen(  # noqa: S603 - the command comes from the process table
        words,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        env=None if environment is None else dict(environment),
        start_new_session=True,
        preexec_fn=_end_with_parent,
    )


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Send a signal to the process and its children: the process leads a session, and so a process group."""
    if process.poll() is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)


def _load_prctl() -> Callable[..., int] | None:
    try:
        return ctypes.CDLL(None, use_errno=True).prctl
    except (OSError, AttributeError):
        return None  # not Linux: the processes survive if the demonstration is killed


_prctl = _load_prctl()


def _end_with_parent() -> None:
    """Let the kernel end the process when the demonstration dies. Runs in the child before its program."""
    if _prctl is not None:
        _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
