# SPDX-License-Identifier: BSD-3-Clause
"""Ports of TCP for servers that tests start, and that cannot be asked which port they got."""

from __future__ import annotations

import contextlib
import random
import socket
from typing import Final

_PORTS: Final = range(10_000, 32_000, 2)
"""Below those that Linux gives to connections (32768 to 60999)."""


def free_pair() -> int:
    """A port of 127.0.0.1 that nobody has, of which the next one is free, too.

    They are drawn, so that tests that run side by side seldom want the same.
    """
    while True:
        port = random.choice(_PORTS)
        with contextlib.suppress(OSError), socket.socket() as first, socket.socket() as second:
            first.bind(('127.0.0.1', port))
            second.bind(('127.0.0.1', port + 1))
            return port
