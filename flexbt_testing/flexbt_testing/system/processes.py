# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a robot, started from the installed executables, and what a test does to them."""

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
}
"""Modules that the executables of a robot run, which tests start often."""

LOADED: Final = (
    *MODULES.values(),
    'flexbt_sim.world.world.prepare_world',
    'flexbt_navigation.preparation.prepare_navigation',
)
"""Modules and functions that the process from which they are all forked has loaded: most of it is the same for each."""

LAST_CHARACTERS: Final = 3000


def _thread_states(process: int) -> Iterator[str]:
    """Yield the state of each thread of a process, as in ``/proc``: 'T' for one that was stopped."""
    for thread in Path(f'/proc/{process}/task').iterdir():
        with contextlib.suppress(OSError):  # it has ended meanwhile
            yield (thread / 'stat').read_text().rpartition(')')[2].split()[0]


def executable(name: str) -> str:
    """Path of an installed executable."""
    package = PACKAGES[name]
    return str(Path(get_package_prefix(package)) / 'lib' / package / name)


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
    """Processes by the names of their executables; leaving the context kills those that are left."""

    def __init__(
        self,
        directory: Path,
        network: NetworkNamespace | None = None,
        *,
        can_be_held_up: bool = False,
        forked: bool = True,
    ) -> None:
        """``directory`` takes the logs; the processes are in ``network``, or in that of this process.

        ``can_be_held_up``: whether :meth:`hold_up` is to be used. ``forked``: whether they may be forks of a process
        that has loaded what they need (:mod:`.fork_server`), which spares most of the time of a start.
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
            # Shown by pytest when the test fails.
            print(f'--- {name}, {end}\n{self.output(name)[-LAST_CHARACTERS:]}')

    def start(
        self,
        name: str,
        parameters: Mapping[str, str] | None = None,
        environment: Mapping[str, str] | None = None,
        parameter_file: Path | None = None,
    ) -> None:
        """Start an executable, again if it has run before; ``robot/name`` runs in the namespace ``robot``.

        Everything but the simulator and the stop guard follows simulated time, unless the parameters say otherwise;
        what ``parameter_file`` says counts where they say nothing.
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
            # Modules read some of the environment as they are loaded: with another one, they are loaded again.
            if self._forked and base in MODULES and environment is None:
                server = fork_server.fork_server(*LOADED)
                pid = server.start(words, log.fileno(), os.environ, fifo, module=MODULES[base])
                self._processes[name] = fork_server.ForkedProcess(server, pid)
                return
            if fifo is not None:
                words = [sys.executable, '-m', 'flexbt_testing.system.hold_up', str(fifo), *words]
            if self._network is not None:
                words = self._network.command(words)
            variables = {**os.environ, **(environment or {})}
            self._processes[name] = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=variables
            )

    def start_all(
        self,
        simulator: Mapping[str, str] | None = None,
        bt_server: Mapping[str, str] | None = None,
        onboard_executive: Mapping[str, str] | None = None,
        *,
        in_one: bool = False,
    ) -> None:
        """Start everything but the console, with these parameters.

        ``in_one``: simulator and navigation are the one process ``simulation``, which spares processor time where a
        test has nothing to do to either of them.
        """
        self.start('simulation' if in_one else 'simulator', simulator)
        self.start('bt_server', bt_server)
        if not in_one:
            self.start('navigation')
        self.start('stop_guard')
        self.start('onboard_executive', onboard_executive)

    def kill(self, name: str) -> float:
        """kill -9; the uncontended time when."""
        process = self._processes[name]
        process.kill()
        killed = uncontended_time()
        process.wait()
        return killed

    def send_signal(self, name: str, number: signal.Signals) -> float:
        """Send a signal, as SIGSTOP and SIGCONT, by which a process hangs and goes on; the uncontended time when.

        With SIGSTOP, wait until every thread has stopped: on a busy computer they work on for up to 0.1 s.
        """
        process = self._processes[name]
        process.send_signal(number)
        if number == signal.SIGSTOP:
            wait_until(lambda: set(_thread_states(process.pid)) <= {'T'}, f'{name} has stopped')
        return uncontended_time()

    def hold_up(self, name: str, method: str, seconds: float) -> float:
        """Let the thread that calls a method hang for this time (:mod:`.hold_up`); the uncontended time when."""
        self._fifo(name).write_text(f'{method} {seconds}\n')
        return uncontended_time()

    def running(self) -> set[str]:
        """Return the names of those that run."""
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
        """Return the number of a process."""
        return self._processes[name].pid

    def output(self, name: str) -> str:
        """Everything that a process has said."""
        log = self._log(name)
        return log.read_text(errors='replace') if log.exists() else ''

    def _fifo(self, name: str) -> Path:
        return self._log(name).with_suffix('.fifo')

    def _log(self, name: str) -> Path:
        return self.directory / f'{name.replace("/", ".")}.log'


# Ports of TCP for servers that tests start, and that cannot be asked which port they got.

_PORTS: Final = range(10_000, 32_000, 2)
"""Below those that Linux gives to connections (32768 to 60999)."""


def free_pair() -> int:
    """Return a port of 127.0.0.1 that nobody has, of which the next one is free, too.

    They are drawn, so that tests that run side by side seldom want the same.
    """
    while True:
        port = random.choice(_PORTS)
        with contextlib.suppress(OSError), socket.socket() as first, socket.socket() as second:
            first.bind(('127.0.0.1', port))
            second.bind(('127.0.0.1', port + 1))
            return port
