# SPDX-License-Identifier: BSD-3-Clause
"""To hear nothing more of a participant of the domain: the middleware drops what it sends as it comes in.

What a node does not want to have costs it memory all the same: the middleware puts large messages together and keeps
them until somebody takes them. (DDS has ``ignore_participant`` for this, DDS 1.4, 2.2.2.2.1.14; rmw does not offer it.)
"""

from __future__ import annotations

import ctypes
from typing import Final

from rclpy.node import Node

from .fastdds_shutdown import participant_of
from .loaded_library import loaded_function

__all__ = ['ignore_each_other', 'ignore_participant']

_DDS: Final = 'libfastrtps.so.2.14'
_IGNORE: Final = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant18ignore_participantERKNS_8fastrtps4rtps16InstanceHandle_tE'
)
_GUID: Final = '_ZNK8eprosima7fastdds3dds17DomainParticipant4guidEv'
_PREFIX_SIZE: Final = 12
_PARTICIPANT_ENTITY: Final = b'\x00\x00\x01\xc1'  # ENTITYID_PARTICIPANT (DDSI-RTPS 9.3.1.3)
_OK: Final = 0


class _InstanceHandle(ctypes.Structure):
    _fields_ = (('value', ctypes.c_uint8 * 16), ('has_value', ctypes.c_bool))


def ignore_participant(node: Node, participant: bytes) -> bool:
    """Ignore a participant (see :class:`Received`) for good, on all topics of the process of ``node``.

    False, and nothing has been done, where the middleware is not Fast DDS 2.14.
    """
    own = participant_of(node)
    if own is None or len(participant) != _PREFIX_SIZE:
        return False
    try:
        ignore = loaded_function(_DDS, _IGNORE, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(_InstanceHandle))
    except (OSError, AttributeError):
        return False
    value = (ctypes.c_uint8 * 16)(*participant, *_PARTICIPANT_ENTITY)
    return bool(ignore(own, ctypes.byref(_InstanceHandle(value, True))) == _OK)


def ignore_each_other(first: Node, second: Node) -> None:
    """Have two nodes, each with a process or a context of its own, not discover each other: neither hears of what the
    other has in the graph, nor anything that it sends. Best done before either has much in it. Where the middleware is
    not Fast DDS 2.14, nothing is done."""
    for node, other in ((first, second), (second, first)):
        ignore_participant(node, _prefix_of(other))


def _prefix_of(node: Node) -> bytes:
    """What the identifiers of all that is in the participant of a node begin with; empty when it is not known."""
    participant = participant_of(node)
    if participant is None:
        return b''
    try:
        guid = loaded_function(_DDS, _GUID, ctypes.POINTER(ctypes.c_uint8 * _PREFIX_SIZE), ctypes.c_void_p)
    except AttributeError:
        return b''
    return bytes(guid(participant).contents)
