# SPDX-License-Identifier: BSD-3-Clause
"""The messages between Groot2 and a running tree: frames of ZeroMQ, little endian.

The client asks (REQ), the server answers (REP); each message begins with a header. On the port that follows, the server
tells of breakpoints that were reached (PUB). Source: groot2_protocol.h of BehaviorTree.CPP 4.10.
"""

from __future__ import annotations

import random
import struct
from enum import IntEnum
from typing import Final

from flexbt_core.behavior_tree import NodeStatus

PROTOCOL: Final = 2
DEFAULT_PORT: Final = 1667
HEADER_BYTES: Final = 6
RECORD_BYTES: Final = 9
MAX_UID: Final = 0xFFFF
"""The protocol, and the log files, have two bytes for the uid of a node."""

_HEADER: Final = struct.Struct('<BBI')
_RECORD: Final = struct.Struct('<IHHB')
_STATUS: Final = struct.Struct('<HB')
_WENT_IDLE: Final = 10


class RequestType(IntEnum):
    """The second byte of a header."""

    FULL_TREE = ord('T')
    STATUS = ord('S')
    BLACKBOARD = ord('B')
    HOOK_INSERT = ord('I')
    HOOK_REMOVE = ord('R')
    BREAKPOINT_REACHED = ord('N')
    BREAKPOINT_UNLOCK = ord('U')
    HOOKS_DUMP = ord('D')
    REMOVE_ALL_HOOKS = ord('A')
    DISABLE_ALL_HOOKS = ord('X')
    TOGGLE_RECORDING = ord('r')
    GET_TRANSITIONS = ord('t')


def request_header(type: RequestType, id: int | None = None) -> bytes:
    """The first frame of a request, and of a notification. A random ``id`` will do."""
    return _HEADER.pack(PROTOCOL, type, random.getrandbits(32) if id is None else id)


def reply_header(request: bytes, tree: bytes) -> bytes:
    """The first frame of a reply: the header of the request, in our protocol, and the 16 bytes that name the tree."""
    return bytes((PROTOCOL,)) + request[1:HEADER_BYTES] + tree


def status_bytes(uid: int, status: NodeStatus) -> bytes:
    """A node in the reply to a request for statuses."""
    return _STATUS.pack(uid, status)


def status_byte(before: int, after: int) -> int:
    """The number of a status as clients see it; of a node that is IDLE again they see what it was before."""
    return after or _WENT_IDLE + before


def record(microseconds: int, uid: int, status: int) -> bytes:
    """A transition in a recording or a log file; ``microseconds`` since its beginning, 48 bits of them."""
    return _RECORD.pack(microseconds & 0xFFFFFFFF, microseconds >> 32 & 0xFFFF, uid, status)


def read_record(data: bytes, offset: int) -> tuple[int, int, int]:
    """Microseconds, uid and status of a transition."""
    low, high, uid, status = _RECORD.unpack_from(data, offset)
    return high << 32 | low, uid, status
