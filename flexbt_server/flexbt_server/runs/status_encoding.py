# SPDX-License-Identifier: BSD-3-Clause
"""TreeStatus messages as the middleware sends them, without an object for each of their changes.

Making the objects and serializing them takes about 3 microseconds for a change. But ``changes`` is the last field of
the message, and its elements have a fixed size: they can be appended to what the middleware makes of the rest. All of
one round have the same stamp; what follows it is the *end* of a change.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import Any, Final

from rclpy.serialization import serialize_message

from flexbt_core.behavior_tree import TreeNode, log_reader
from flexbt_msgs import msg

_MOST_REMEMBERED: Final = 20_000
"""Ends of changes that are remembered; about 2 MB."""

_STAMP: Final = struct.Struct('=iI')
_END: Final = struct.Struct('=HBB')
_COUNT: Final = struct.Struct('=I')


class RoundReader:
    """Makes the ends of changes of the marks of rounds.

    It remembers what it has read: most trees do the same in most rounds, and that is found ten times as fast as read.
    """

    def __init__(self, nodes: Sequence[TreeNode]) -> None:
        self._reader = log_reader(nodes, _END.pack)
        self._rounds: dict[tuple[bytes, tuple[int, ...]], tuple[list[bytes], bytes]] = {}
        self._remembered = 0

    @property
    def statuses(self) -> bytes:
        """The statuses of all nodes after what was read; the index is uid - 1."""
        return bytes(self._reader.statuses[1:])

    def read(self, marks: Sequence[int]) -> list[bytes]:
        """The ends of the changes that these marks, which follow those that were read before, mean."""
        reader = self._reader
        key = bytes(reader.statuses), tuple(marks)
        known = self._rounds.get(key)
        if known is not None:
            ends, reader.statuses[:] = known
            return ends
        ends = reader.read(marks)
        self._remembered += len(ends)
        if self._remembered > _MOST_REMEMBERED:
            self._rounds.clear()
            self._remembered = len(ends)
        self._rounds[key] = ends, bytes(reader.statuses)
        return ends


def encoded(seconds: int, nanoseconds: int, ends: Iterable[bytes]) -> bytes:
    """TreeStatusChanges with this stamp and these ends, one after the other."""
    return _STAMP.pack(seconds, nanoseconds).join([b'', *ends])


def apply(ends: Iterable[bytes], statuses: bytearray) -> None:
    """Makes these changes to the statuses, whose index is uid - 1."""
    for end in ends:
        uid, _, after = _END.unpack(end)
        statuses[uid - 1] = after


def serialized(message: msg.TreeStatus, count: int, changes: Sequence[bytes]) -> bytes:
    """The serialized ``message``, which has no changes, with so many encoded ones."""
    data: Any = serialize_message(message)
    # The last that is there is the number of changes, 0.
    return b''.join((data[: -_COUNT.size], _COUNT.pack(count), *changes))
