# SPDX-License-Identifier: BSD-3-Clause
"""Networks of their own for the processes of a test: what `ip netns` does, without names that could be left behind."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Final, TypeVar

T = TypeVar('T')

CLONE_NEWNET: Final = 0x40000000
OWN_NETWORK: Final = '/proc/thread-self/ns/net'
NEEDED_PROGRAMS: Final = ('ip', 'nsenter')


class NetworkNamespace:
    """A network without any link but its loopback; it is gone with this object and the last process in it."""

    def __init__(self, *, loopback: bool = True) -> None:
        """Make one. Without ``loopback`` that is there, but down.

        Raises:
            OSError: this process may not, or the system has no network namespaces.
        """

        def make() -> int:
            _check(_libc().unshare(CLONE_NEWNET), 'make a network namespace')
            return os.open(OWN_NETWORK, os.O_RDONLY)

        self._file = _on_a_thread(make)
        if loopback:
            self.run('ip', 'link', 'set', 'lo', 'up')

    def __enter__(self) -> NetworkNamespace:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.close(self._file)

    @property
    def path(self) -> str:
        """Where another process finds it, see :func:`enter`."""
        return f'/proc/{os.getpid()}/fd/{self._file}'

    def command(self, words: Sequence[str]) -> list[str]:
        """The command line that runs a program in it."""
        return ['nsenter', f'--net={self.path}', *words]

    def run(self, *words: str) -> None:
        """Run a program in it.

        Raises:
            OSError: it failed; says what it said.
        """
        done = subprocess.run(self.command(words), capture_output=True, text=True)
        if done.returncode:
            raise OSError(f'{" ".join(words)}: {done.stderr.strip()}')

    def call(self, fn: Callable[[], T]) -> T:
        """Call ``fn`` in it, on another thread: a socket, device or thread that is made there stays there."""

        def inside() -> T:
            enter(self.path)
            return fn()

        return _on_a_thread(inside)


def enter(path: str) -> None:
    """Take the calling thread, and the threads that it makes from now on, into the namespace of that path.

    Raises:
        OSError: there is none, or this process may not.
    """
    file = os.open(path, os.O_RDONLY)
    try:
        _check(_libc().setns(file, CLONE_NEWNET), f'enter the network namespace {path}')
    finally:
        os.close(file)


def missing() -> str:
    """Why there are no network namespaces with a link between them on this machine; empty when there are."""
    absent = [program for program in NEEDED_PROGRAMS if shutil.which(program) is None]
    if absent:
        return f'not installed: {", ".join(absent)} (iproute2, util-linux)'
    try:
        os.close(os.open('/dev/net/tun', os.O_RDWR))
        with NetworkNamespace():
            return ''
    except OSError as error:
        return f'no network namespaces here (they need Linux, CAP_SYS_ADMIN, CAP_NET_ADMIN and /dev/net/tun): {error}'


def _on_a_thread(fn: Callable[[], T]) -> T:
    with ThreadPoolExecutor(max_workers=1) as thread:
        return thread.submit(fn).result()


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check(result: int, what: str) -> None:
    if result:
        number = ctypes.get_errno()
        raise OSError(number, f'cannot {what}: {os.strerror(number)}')
