# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a robot, started from the installed executables, and operations on them for tests."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final

from ament_index_python.packages import get_package_prefix

from flexbt_testing.waiting import contended_time, uncontended_time, wait_until

from . import fork_server
from .networks import NetworkNamespace

PACKAGES: Final[Mapping[str, str]] = {
    'simulator': 'flexbt_sim',
    'simulation': 'flexbt_navigation',
    'navigation': 'flexbt_navigation',
    'bt_server': 'flexbt_server',
    'onboard_executive': 'flexbt_onboard',
    'console': 'flexbt_console',
    'recorder': 'flexbt_console',
    'black_box': 'flexbt_console',
    'stop_guard': 'flexbt_onboard',
    'run_report': 'flexbt_onboard',
}
"""The package of each executable."""

MODULES: Final[Mapping[str, str]] = {
    'simulator': 'flexbt_sim.simulator.node',
    'navigation': 'flexbt_navigation.node',
    'simulation': 'flexbt_navigation.simulation',
    'bt_server': 'flexbt_server.bt_server',
    'onboard_executive': 'flexbt_onboard.node.onboard_executive',
    'stop_guard': 'flexbt_onboard.node.stop_guard',
    'recorder': 'flexbt_console.recording.recorder',
    'black_box': 'flexbt_console.recording.black_box',
}
"""Modules of the robot's executables that tests start often."""

LOADED: Final = (
    *MODULES.values(),
    'flexbt_sim.world.world.prepare_world',
    'flexbt_navigation.preparation.prepare_navigation',
)
"""Modules and functions loaded by the common parent of all forks: most of them are the same for each."""

LAST_CHARACTERS: Final = 3000


def _thread_states(process: int) -> Iterator[str]:
    """Yield the state of each thread of a process, from ``/proc``: 'T' for a stopped one."""
    for thread in Path(f'/proc/{process}/task').iterdir():
        with contextlib.suppress(OSError):  # the process may have ended meanwhile
            yield (thread / 'stat').read_text().rpartition(')')[2].split()[0]


def executable(name: str) -> str:
    """Return the path of an installed executable."""
    package = PACKAGES[name]
    return str(Path(get_package_prefix(package)) / 'lib' / package / name)


def _start(
    words: list[str],
    log: int,
    environment: Mapping[str, str] | None,
    fifo: Path | None,
    network: NetworkNamespace | None,
) -> subprocess.Popen[bytes]:
    if fifo is not None:
        words = [sys.executable, '-m', 'flexbt_testing.system.hold_up', str(fifo), *words]
    if network is not None:
        words = network.command(words)
    variables = {**os.environ, **(environment or {})}
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=variables)


def _hold_up(_process: object, fifo: Path, method: str, seconds: float) -> None:
    fifo.write_text(f'{method} {seconds}\n')


@dataclass(frozen=True)
class Ending:
    """The end of a process: its exit code, the (uncontended) seconds since the signal, and its output.

    ``held_up`` are the additional seconds in which the machine was too busy.
    """

    exit_code: int
    seconds: float
    output: str
    held_up: float


class Stack:
    """Processes by the names of their executables. Leaving the context kills the remaining ones.

    In tests that run in one process they are processes of the simulated world.
    """

    def __init__(
        self,
        directory: Path,
        network: NetworkNamespace | None = None,
        *,
        can_be_held_up: bool = False,
        forked: bool = True,
    ) -> None:
        """Prepare the processes. Their logs go to ``directory``; they run in ``network``, or in that of this process.

        ``can_be_held_up`` enables :meth:`hold_up`. With ``forked`` they may be forks of a process that has loaded their
        modules (:mod:`.fork_server`), which saves most of the time of a start.
        """
        self.directory = directory
        self._network = network
        self._can_be_held_up = can_be_held_up
        self._forked = forked and fork_server.AVAILABLE and network is None
        self._processes: dict[str, subprocess.Popen[bytes] | fork_server.ForkedProcess] = {}

    def __enter__(self) -> Stack:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for process in self._processes.values():
            process.kill()
        for name, process in self._processes.items():
            try:
                end = f'exit code {process.wait()}'
            except RuntimeError as unknown:
                end = str(unknown)
            # pytest shows this output if the test fails.
            print(f'--- {name}, {end}\n{self.output(name)[-LAST_CHARACTERS:]}')

    def start(
        self,
        name: str,
        parameters: Mapping[str, str] | None = None,
        environment: Mapping[str, str] | None = None,
        parameter_file: Path | None = None,
    ) -> None:
        """Start an executable, also a second time; ``robot/name`` runs in the namespace ``robot``.

        By default all except the simulator and the stop guard follow simulated time. ``parameters`` override that; they
        also take precedence over ``parameter_file``.
        """
        namespace, _, base = name.rpartition('/')
        settings = {} if base in ('simulator', 'simulation', 'stop_guard') else {'use_sim_time': 'true'}
        if base == 'onboard_executive':
            settings['event_log_directory'] = str(self.directory)
        words = [executable(base), '--ros-args', '-r', f'__ns:=/{namespace}']
        words += [] if parameter_file is None else ['--params-file', str(parameter_file)]
        for key, value in {**settings, **(parameters or {})}.items():
            words += ['-p', f'{key}:={value}']
        fifo = self._fifo(name) if self._can_be_held_up else None
        if fifo is not None and not fifo.exists():
            os.mkfifo(fifo)
        with self._log(name).open('ab') as log:
            # Modules read some environment variables when they are loaded, so another environment needs a new load.
            if self._forked and base in MODULES and environment is None:
                server = fork_server.fork_server(*LOADED)
                pid = server.start(words, log.fileno(), os.environ, fifo, module=MODULES[base])
                self._processes[name] = fork_server.ForkedProcess(server, pid)
                return
            self._processes[name] = _start(words, log.fileno(), environment, fifo, self._network)

    def start_all(
        self,
        simulator: Mapping[str, str] | None = None,
        bt_server: Mapping[str, str] | None = None,
        onboard_executive: Mapping[str, str] | None = None,
        *,
        in_one: bool = False,
    ) -> None:
        """Start everything but the console, with these parameters.

        With ``in_one``, simulator and navigation run in one process, ``simulation``. This saves processor time if a
        test does not act on either of them separately.
        """
        self.start('simulation' if in_one else 'simulator', simulator)
        self.start('bt_server', bt_server)
        if not in_one:
            self.start('navigation')
        self.start('stop_guard')
        self.start('onboard_executive', onboard_executive)

    def kill(self, name: str) -> float:
        """Send SIGKILL and return the uncontended time."""
        process = self._processes[name]
        process.kill()
        killed = uncontended_time()
        process.wait()
        return killed

    def send_signal(self, name: str, number: signal.Signals) -> float:
        """Send a signal, such as SIGSTOP to make a process hang and SIGCONT to resume it. Return the uncontended time.

        After SIGSTOP, wait until every thread has stopped: on a busy computer threads run on for up to 0.1 s.
        """
        process = self._processes[name]
        process.send_signal(number)
        if number == signal.SIGSTOP:
            wait_until(lambda: set(_thread_states(process.pid)) <= {'T'}, f'{name} has stopped')
        return uncontended_time()

    def hold_up(self, name: str, method: str, seconds: float) -> float:
        """Make the thread that calls a method hang for this time (:mod:`.hold_up`). Return the uncontended time."""
        _hold_up(self._processes[name], self._fifo(name), method, seconds)
        return uncontended_time()

    def running(self) -> set[str]:
        """Return the names of the running processes."""
        return {name for name, process in self._processes.items() if process.poll() is None}

    def end(self, name: str, number: signal.Signals, timeout: float) -> Ending:
        """Send a signal and wait for the end.

        Raises:
            subprocess.TimeoutExpired: it did not end within ``timeout`` seconds.
        """
        process = self._processes[name]
        sent, held_up = uncontended_time(), contended_time()
        process.send_signal(number)
        exit_code = process.wait(timeout)
        return Ending(exit_code, uncontended_time() - sent, self.output(name), contended_time() - held_up)

    def process_id(self, name: str) -> int:
        """Return the id of a process."""
        return self._processes[name].pid

    def output(self, name: str) -> str:
        """Return all output of a process."""
        log = self._log(name)
        return log.read_text(errors='replace') if log.exists() else ''

    def _fifo(self, name: str) -> Path:
        return self._log(name).with_suffix('.fifo')

    def _log(self, name: str) -> Path:
        return self.directory / f'{name.replace("/", ".")}.log'


# TCP ports for servers of tests that cannot report which port they use.

_PORTS: Final = range(10_000, 32_000, 2)
"""Ports below the ephemeral range of Linux (32768 to 60999)."""


def free_pair() -> int:
    """Return a free port of 127.0.0.1 whose next port is free too.

    It is drawn at random, so that tests that run in parallel rarely choose the same one.
    """
    while True:
        port = random.choice(_PORTS)
        with contextlib.suppress(OSError), socket.socket() as first, socket.socket() as second:
            first.bind(('127.0.0.1', port))
            second.bind(('127.0.0.1', port + 1))
            return port
