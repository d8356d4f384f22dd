# SPDX-License-Identifier: BSD-3-Clause
"""TreeStatus messages as the middleware sends them, without an object for each of their changes.

Making the objects and serializing them takes about 3 microseconds for a change. But ``changes`` is the last field of
the message and its elements have a fixed size, so they can be appended to what the middleware makes of the rest.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, Final

from rclpy.serialization import serialize_message

from flexbt_msgs import msg

_CHANGE: Final = struct.Struct('=iIHBB')
_COUNT: Final = struct.Struct('=I')

encoded_change: Final = _CHANGE.pack
"""A TreeStatusChange: seconds and nanoseconds of the stamp, uid, previous status, status."""


def serialized(message: msg.TreeStatus, changes: Sequence[bytes]) -> bytes:
    """The serialized ``message``, which has no changes, with these."""
    data: Any = serialize_message(message)
    if not changes:
        return bytes(data)
    # The last that is there is the number of changes, 0.
    return b''.join((data[: -_COUNT.size], _COUNT.pack(len(changes)), *changes))
