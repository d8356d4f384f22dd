# SPDX-License-Identifier: BSD-3-Clause
"""That the room of large messages is given back: else a process keeps it for ever, once for each topic and service.

Two others keep it. Fast DDS, as rmw_fastrtps sets it up, keeps for each place in the queue of an endpoint the largest
message that has been there; a profile may tell it not to (``historyMemoryPolicy`` DYNAMIC), which rmw_fastrtps heeds
when RMW_FASTRTPS_USE_QOS_FROM_XML is 1. And malloc of glibc takes large pieces from the heap once it has seen one of
them freed; there they are given back only when nothing above them is in use.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

__all__ = ['large_messages_given_back']

_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of mallopt; what is larger is a mapping of its own, which free gives back."""

_LARGE: Final = 2_000_000
_HEEDS: Final = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_DYNAMIC: Final = '<historyMemoryPolicy>DYNAMIC<'


@contextlib.contextmanager
def large_messages_given_back() -> Iterator[None]:
    """Make a node within it, the first of its context: the room of the messages that it receives is given back.

    The profile counts that FASTRTPS_DEFAULT_PROFILES_FILE names, and only if it says something of the room: without a
    word of it, Fast DDS would refuse messages that are larger than the first. Processes that this one starts may have
    another profile, so the environment is as before in the end.
    """
    mallopt = getattr(ctypes.CDLL(None), 'mallopt', None)  # of glibc
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)
    profile = Path(os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', ''))
    is_ours = profile.is_file() and _DYNAMIC in profile.read_text(errors='replace')
    if not is_ours or _HEEDS in os.environ:
        yield
        return
    os.environ[_HEEDS] = '1'
    try:
        yield
    finally:
        os.environ.pop(_HEEDS, None)
