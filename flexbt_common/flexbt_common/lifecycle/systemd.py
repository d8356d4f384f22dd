# SPDX-License-Identifier: BSD-3-Clause
"""Reports of a process to systemd, by the datagrams of sd_notify(3). Needs no ROS."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from typing import Final

PERIOD: Final = 1.0
"""Time between two reports that the process is alive, s. ``WatchdogSec`` of a unit has to be several times as long."""


class SystemdReports:
    """Reports that a process is ready, alive, or about to end. Without a socket of systemd they go nowhere."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get('NOTIFY_SOCKET', '')
        self._address = f'\0{address[1:]}' if address.startswith('@') else address
        self._is_ready = False
        self._next = 0.0

    def beat(self) -> None:
        """Report that the process is alive. Called while all its threads answer."""
        if self._address and time.monotonic() >= self._next:
            self._next = time.monotonic() + PERIOD
            self._send('WATCHDOG=1')

    def ready(self, is_ready: bool) -> None:
        """Report once that the process is ready."""
        if is_ready and not self._is_ready:
            self._is_ready = True
            self._send('READY=1')

    def ending(self) -> None:
        """Report that the process is about to end."""
        self._send('STOPPING=1')

    def _send(self, state: str) -> None:
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as end:
                end.setblocking(False)
                end.sendto(state.encode(), self._address)
        except OSError:  # systemd is gone or busy: without reports it restarts the process
            return
