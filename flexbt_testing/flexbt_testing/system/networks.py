# SPDX-License-Identifier: BSD-3-Clause
"""Separate networks for the processes of a test, and a bad cable between two of them."""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import Final, TypeVar

T = TypeVar('T')

CLONE_NEWNET: Final = 0x40000000
OWN_NETWORK: Final = '/proc/thread-self/ns/net'
NEEDED_PROGRAMS: Final = ('ip', 'nsenter')


class NetworkNamespace:
    """A network with only a loopback link. It exists as long as this object and the processes in it."""

    def __init__(self, *, loopback: bool = True) -> None:
        """Make a namespace. Without ``loopback`` its loopback link is down.

        Raises:
            OSError: this process lacks the permission, or the system has no network namespaces.
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
        """Path by which another process can :func:`enter` the namespace."""
        return f'/proc/{os.getpid()}/fd/{self._file}'

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the command line that runs a program in the namespace."""
        return ['nsenter', f'--net={self.path}', *words]

    def run(self, *words: str) -> None:
        """Run a program in the namespace.

        Raises:
            OSError: it failed; the message contains its output.
        """
        done = subprocess.run(self.command(words), capture_output=True, text=True)
        if done.returncode:
            raise OSError(f'{" ".join(words)}: {done.stderr.strip()}')

    def call(self, fn: Callable[[], T]) -> T:
        """Call ``fn`` in it, on another thread. A socket, device or thread created there stays in the namespace."""

        def inside() -> T:
            enter(self.path)
            return fn()

        return _on_a_thread(inside)


def enter(path: str) -> None:
    """Move the calling thread, and the threads that it starts from now on, into the namespace at ``path``.

    Raises:
        OSError: the namespace does not exist, or this process lacks the permission.
    """
    file = os.open(path, os.O_RDONLY)
    try:
        _check(_libc().setns(file, CLONE_NEWNET), f'enter the network namespace {path}')
    finally:
        os.close(file)


def missing() -> str:
    """Return why this machine does not support linked network namespaces; empty if it does."""
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


# A bad cable between two networks: it loses, delays, duplicates, reorders and counts packets.
#
# It consists of a TUN device in each network namespace, and a thread that carries packets between them. A seed and the
# order of the packets decide their fate.

DEVICE: Final = 'cable'
ADDRESSES: Final = ('10.77.1.1', '10.77.1.2')
"""IPv4 addresses of the two ends, in the order of the namespaces."""

TUNSETIFF: Final = 0x400454CA
IFF_TUN: Final = 0x0001
IFF_NO_PI: Final = 0x1000
LARGEST_PACKET: Final = 65536
UDP: Final = 17
FRAGMENT_OFFSET: Final = 0x1FFF


@dataclass(frozen=True)
class Weather:
    """The faults of a link: the probability that it loses or duplicates a packet, and its delay in s, evenly
    distributed.

    ``rate`` is the limit in each direction, bytes per second; None for no limit.
    """

    loss: float = 0.0
    doubled: float = 0.0
    delay: tuple[float, float] = (0.0, 0.0)
    rate: float | None = None


FAIR: Final = Weather()


class LossyLink:
    """The only link between two namespaces, while the context is open.

    Set ``weather`` at any time to change the faults of packets sent from then on. None: nothing gets through.
    """

    def __init__(self, first: NetworkNamespace, second: NetworkNamespace, seed: int = 0) -> None:
        self.weather: Weather | None = FAIR
        self._random = random.Random(seed)
        self._devices = tuple(
            _open_device(namespace, address) for namespace, address in zip((first, second), ADDRESSES, strict=True)
        )
        self._on_the_way: list[tuple[float, int, int, bytes]] = []
        self._numbers = itertools.count()
        self._free = [0.0, 0.0]
        self._sent: tuple[Counter[int], Counter[int]] = (Counter(), Counter())
        self._lock = threading.Lock()
        self._end = os.eventfd(0)
        self._thread = threading.Thread(target=self._carry, name='lossy_link', daemon=True)

    def __enter__(self) -> LossyLink:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.eventfd_write(self._end, 1)
        self._thread.join()
        for file in (*self._devices, self._end):
            os.close(file)

    def sent(self) -> tuple[Counter[int], Counter[int]]:
        """Return the bytes that each end has sent while the link was not cut, from the IP header on, by UDP port.

        Port 0 is everything else, such as the later fragments of a large datagram.
        """
        with self._lock:
            return self._sent[0].copy(), self._sent[1].copy()

    def _carry(self) -> None:
        while True:
            now = time.monotonic()
            while self._on_the_way and self._on_the_way[0][0] <= now:
                _, _, device, packet = heapq.heappop(self._on_the_way)
                os.write(device, packet)
            wait = max(0.0, self._on_the_way[0][0] - now) if self._on_the_way else None
            ready, _, _ = select.select([*self._devices, self._end], [], [], wait)
            if self._end in ready:
                return
            for end in (0, 1):
                if self._devices[end] in ready:
                    for packet in _packets(self._devices[end]):
                        self._send(end, packet)

    def _send(self, end: int, packet: bytes) -> None:
        weather = self.weather
        if weather is None:
            return
        with self._lock:
            self._sent[end][_port(packet)] += len(packet)
        leaves = time.monotonic()
        if weather.rate is not None:
            self._free[end] = leaves = max(self._free[end], leaves) + len(packet) / weather.rate
        if self._random.random() < weather.loss:
            return
        for _ in range(2 if self._random.random() < weather.doubled else 1):
            arrives = leaves + self._random.uniform(*weather.delay)
            heapq.heappush(self._on_the_way, (arrives, next(self._numbers), self._devices[1 - end], packet))


def _open_device(namespace: NetworkNamespace, address: str) -> int:
    def open_tun() -> int:
        file = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(file, TUNSETIFF, struct.pack('16sH', DEVICE.encode(), IFF_TUN | IFF_NO_PI))
        return file

    file = namespace.call(open_tun)
    namespace.run('ip', 'link', 'set', DEVICE, 'addrgenmode', 'none')  # no background traffic of IPv6
    namespace.run('ip', 'address', 'add', f'{address}/24', 'dev', DEVICE)
    namespace.run('ip', 'link', 'set', DEVICE, 'up')
    namespace.run('ip', 'route', 'add', '224.0.0.0/4', 'dev', DEVICE)
    return file


def _packets(device: int) -> Iterator[bytes]:
    while True:
        try:
            yield os.read(device, LARGEST_PACKET)
        except BlockingIOError:
            return


def _port(packet: bytes) -> int:
    """Return the UDP destination port of an IPv4 packet, or 0."""
    header = (packet[0] & 0xF) * 4
    (fragment,) = struct.unpack_from('!H', packet, 6)
    if packet[0] >> 4 != 4 or packet[9] != UDP or fragment & FRAGMENT_OFFSET or len(packet) < header + 8:
        return 0
    return int(struct.unpack_from('!H', packet, header + 2)[0])
