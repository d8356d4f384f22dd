# SPDX-License-Identifier: BSD-3-Clause
"""That the room of large messages is given back: else a process keeps it for ever, once for each topic and service.

Two others keep it. Fast DDS, as rmw_fastrtps sets it up, keeps for each place in the queue of an endpoint the largest
message that has been there; a profile may tell it not to (``historyMemoryPolicy`` DYNAMIC), which rmw_fastrtps heeds
when RMW_FASTRTPS_USE_QOS_FROM_XML is 1. And malloc of glibc takes large pieces from the heap once it has seen one of
them freed; there they are given back only when nothing above them is in use.
"""

from __future__ import annotations

import ctypes
import os
import threading
from functools import cache
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from flexbt_core.values import open_regular

__all__ = ['is_dynamic', 'release_large_messages']

_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of mallopt; what is larger is a mapping of its own, which free gives back."""

_LARGE: Final = 2_000_000
_HEEDS: Final = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_SIDES: Final = ({'data_writer', 'publisher'}, {'data_reader', 'subscriber'})
"""What the profiles of the two sides may be called."""

_lock: Final = threading.Lock()


def release_large_messages() -> None:
    """Call it before a node is made: the room of the messages that it receives is given back.

    It is decided once for the process, by the profile that FASTRTPS_DEFAULT_PROFILES_FILE names then, if that
    :func:`is_dynamic`; Fast DDS reads it once, too.
    """
    with _lock:
        _decide()


@cache
def _decide() -> None:
    libc = ctypes.CDLL(None)
    mallopt = getattr(libc, 'mallopt', None)  # of glibc
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)
    if _HEEDS not in os.environ and is_dynamic(Path(os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', ''))):
        # It stays, since each participant looks for it, and other threads may read the environment while one is made.
        # os.environ does not know of it: a process that is given another profile is not given this.
        libc.setenv(_HEEDS.encode(), b'1', 0)


def is_dynamic(profile: Path) -> bool:
    """Whether this file of Fast DDS has the room given back for every topic.

    Each profile of writers and readers in it must say so, and there must be a default one of each: heeded without a
    word of it, Fast DDS refuses messages that are larger than the first. The profile of a topic has the topic's name.
    """
    try:
        with open(profile, 'rb', opener=open_regular) as content:
            root = ElementTree.parse(content).getroot()  # noqa: S314  # of the user; expat bounds its entities
    except (OSError, ElementTree.ParseError, ValueError, LookupError):  # the last two: of unknown encodings
        return False
    elements = list(root.iter())
    for tags in _SIDES:
        profiles = [element for element in elements if _name(element) in tags and 'profile_name' in element.attrib]
        policies = [_policy(element) for element in profiles]
        is_default = [element.get('is_default_profile') == 'true' for element in profiles]
        if not any(is_default) or set(policies) != {'DYNAMIC'}:
            return False
    return True


def _policy(profile: ElementTree.Element) -> str:
    texts = [element.text or '' for element in profile if _name(element) == 'historyMemoryPolicy']
    return texts[-1].strip() if texts else ''


def _name(element: ElementTree.Element) -> str:
    return element.tag.rpartition('}')[2]
