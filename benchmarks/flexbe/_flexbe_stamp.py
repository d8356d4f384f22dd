# SPDX-License-Identifier: BSD-3-Clause
"""When states are entered, told to the benchmark in the same way by whatever engine runs them, and without ROS."""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from types import TracebackType
from typing import Final

ADDRESS: Final = 'FLEXBE_BENCHMARK_SOCKET'
"""Environment variable with the path of the socket."""


def entered(label: str) -> None:
    """Note the time at which a state is entered."""
    now = time.monotonic_ns()  # the same clock in all processes
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(f'{now} {label}'.encode(), os.environ[ADDRESS])


class Entries:
    """What the states have told, in order."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._path = Path(os.environ[ADDRESS])
        self._socket.bind(str(self._path))

    def __enter__(self) -> Entries:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._socket.close()
        self._path.unlink()

    def wait(self, label: str, timeout: float) -> int:
        """Return when the next state was entered, nanoseconds of the monotonic clock.

        Raises:
            TimeoutError: none was within ``timeout`` seconds.
            RuntimeError: it is another one.
        """
        self._socket.settimeout(timeout)
        try:
            at, _, told = self._socket.recv(100).decode().partition(' ')
        except TimeoutError:
            raise TimeoutError(f'state {label} was not entered within {timeout:g} s') from None
        if told != label:
            raise RuntimeError(f'state {told} was entered, and not {label}')
        return int(at)
