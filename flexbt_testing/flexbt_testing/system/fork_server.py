# SPDX-License-Identifier: BSD-3-Clause
"""Repeated starts of executables, as forks of one process that has already loaded their modules.

Loading takes most of the processor time of a start, and is the same each time. A fork continues where :func:`run_main`
has loaded the module. It gets its arguments, environment and standard streams with the request, has the working
directory of the caller, and ends like the executable. Only the beginning differs: the interpreter, its options and the
entry point. Tests of these start the executable itself.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import json
import os
import pkgutil
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from flexbt_common.executables import load, run_main
from flexbt_testing.lock_order import watch_locks_if_asked

from .hold_up import listen

AVAILABLE: Final = hasattr(os, 'pidfd_open')
"""True on Linux, which forking requires."""

_MAX_REQUEST: Final = 1_000_000
_NODES: Final = ('flexbt_navigation.', 'flexbt_onboard.', 'flexbt_server.', 'flexbt_sim.')
"""Prefixes of modules whose programs no signal interrupts: their locks are watched."""
_KEEP_STACKS: Final = f'glibc.pthread.stack_cache_size={1 << 40}'
"""Setting that keeps the stacks of ended threads.

LTTng, which rclpy loads, cancels its threads as a process ends. A fork does not have these threads. If it has many
threads itself, the C library frees their memory, and the fork would crash with a segmentation fault.
"""
_READ_AS_MODULES_ARE_LOADED: Final = ('FLEXBT_', 'PYTHON', 'RMW_', 'RCUTILS_', 'ROS_PYTHON_', 'NUMBA_', 'LANG', 'LC_')
"""Prefixes of environment variables that modules read as they are loaded.

A process reads others, such as ROS_DOMAIN_ID, when it needs them.
"""


class ForkedProcess:
    """A process started by a :class:`ForkServer`. It has the useful part of :class:`subprocess.Popen`."""

    def __init__(self, server: ForkServer, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._server = server
        self._end = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal; None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end and return the exit code.

        Raises:
            subprocess.TimeoutExpired: it did not end within ``timeout`` seconds.
            RuntimeError: it has ended, but its exit code is unknown because the server has ended too.
        """
        if self.returncode is None:
            if not select.select([self._end], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
            self.returncode = self._server.exit_code(self.pid)
            os.close(self._end)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._end, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """The process that starts others. Each runs the ``main()`` of a module.

    ``modules`` are the names of those modules, of further modules that they would import, and of functions to call
    before forking that load more. Loading code that numba has compiled takes longer than all else.
    """

    def __init__(self, *modules: str) -> None:
        self._modules = modules
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            words = [sys.executable, '-m', __name__, str(other.fileno()), *modules]
            # In a separate session: Ctrl-C in the terminal reaches only the caller, which then ends the processes it
            # has started.
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                pass_fds=[other.fileno()],
                start_new_session=True,
                env={**os.environ, 'GLIBC_TUNABLES': _KEEP_STACKS},
            )

    def start(
        self,
        words: Sequence[str],
        output: int,
        environment: Mapping[str, str],
        fifo: Path | None = None,
        *,
        module: str = '',
        errors: int | None = None,
    ) -> int:
        """Start a process with this command line and its output in the file ``output``; return its process id.

        ``fifo`` is the file for commands that hold up its threads (:mod:`.hold_up`). ``module`` is the module to run,
        by default the first one of the server. ``errors`` is a separate file for standard error.
        """
        request = {
            'module': module or self._modules[0],
            'words': words,
            'environment': dict(environment),
            'directory': str(Path.cwd()),
            'fifo': str(fifo) if fifo else None,
        }
        return self._ask(request, [output, output if errors is None else errors])

    def exit_code(self, pid: int) -> int:
        """Return the exit code of a process that has ended."""
        return self._ask({'ended': pid})

    def close(self) -> None:
        """End the server, and the processes that it has started and that still run."""
        self._socket.close()
        self._process.wait()

    def _ask(self, request: Mapping[str, Any], files: Sequence[int] = ()) -> int:
        answer, cause = b'', None
        try:
            socket.send_fds(self._socket, [json.dumps(request).encode()], files)
            answer = self._socket.recv(_MAX_REQUEST)
        except OSError as error:
            cause = error
        finally:
            if not answer:  # maybe interrupted: a late answer would be taken for that of the next request
                self._socket.close()
        if not answer:
            code = self._process.wait()
            raise RuntimeError(f'the fork server of {", ".join(self._modules)} has ended, exit code {code}') from cause
        return int(answer)


def fork_server(*modules: str) -> ForkServer:
    """Return the server for these modules in this process. It starts on first use, and ends with the process.

    Each environment that modules read as they are loaded has a separate server.
    """
    environment = {name: value for name, value in os.environ.items() if name.startswith(_READ_AS_MODULES_ARE_LOADED)}
    return _fork_server(frozenset(environment.items()), *modules)


@cache
def _fork_server(_environment: frozenset[tuple[str, str]], *modules: str) -> ForkServer:
    server = ForkServer(*modules)
    atexit.register(server.close)
    return server


def _serve(connection: socket.socket) -> tuple[dict[str, Any], list[int]] | None:
    """Start processes and report their exit codes until the caller is gone; then kill the remaining ones, return None.

    In each fork, return the request and the files for its output.
    """
    left: set[int] = set()
    while True:
        data = b''
        with contextlib.suppress(ConnectionError):  # the caller is gone, with an answer on its way
            data, files, _, _ = socket.recv_fds(connection, _MAX_REQUEST, 2)
        if not data:
            for pid in left:
                os.kill(pid, signal.SIGKILL)
            return None
        request = json.loads(data)
        if 'ended' in request:
            answer = os.waitstatus_to_exitcode(os.waitpid(request['ended'], 0)[1])
            left.remove(request['ended'])
        else:
            answer = os.fork()
            if answer == 0:
                return request, files
            for file in files:
                os.close(file)
            left.add(answer)
        with contextlib.suppress(ConnectionError):
            connection.send(str(answer).encode())


def _become(request: Mapping[str, Any], files: Sequence[int]) -> str:
    """Set up the fork as a newly started process, and return the module to run."""
    sys.argv = request['words']
    os.environ.clear()
    os.environ.update(request['environment'])
    os.chdir(request['directory'])
    for stream, file in enumerate(files, 1):
        os.dup2(file, stream)
        os.close(file)
    # Create new streams, because those of the server remember whether its files are seekable.
    said, told = os.fdopen(1, 'w', closefd=False), os.fdopen(2, 'w', 1, errors='backslashreplace', closefd=False)
    vars(sys).update(stdout=said, __stdout__=said, stderr=told, __stderr__=told)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if request['fifo']:
        listen(Path(request['fifo']))
    return str(request['module'])


def main() -> int:
    """Load the modules and serve. A fork runs the ``main()`` of its module and returns its exit code."""
    descriptor, first, *others = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if first.startswith(_NODES):
        watch_locks_if_asked()
    load(first)
    gc.disable()  # like `load`
    for name in others:
        found = pkgutil.resolve_name(name)
        if callable(found):
            found()
    gc.freeze()
    gc.enable()
    with socket.socket(fileno=int(descriptor)) as connection:
        fork = _serve(connection)
    if fork is None:
        return 0
    return run_main(_become(*fork))


if __name__ == '__main__':
    sys.exit(main())
