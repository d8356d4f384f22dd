# SPDX-License-Identifier: BSD-3-Clause
"""The end of a DDS participant that hangs in some builds of Fast DDS 2.14, and what prevents it.

Before rmw_fastrtps destroys a participant, it takes the participant's listener off, and waits as long as it takes for
a callback that is under way just then, since endpoints of somebody else have come or gone. Fast DDS waits until the
greatest time of the steady clock. A C++ library that can wait by the system clock only (that of a glibc before 2.30,
for which the PyPI wheels are built) converts this time, which overflows: each wait comes back at once, as invalid, with
the mutex still held that the callback needs. The process spins for ever, and as rclpy keeps the lock of the interpreter
meanwhile, no code of Python runs any more, no timer and no signal handler.
"""

from __future__ import annotations

import ctypes
from typing import Final

from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from .loaded_library import loaded_function

__all__ = ['end_callbacks', 'participant_of']

CALLBACK_SECONDS: Final = 1

_RMW: Final = 'rmw_fastrtps_cpp'
_DDS: Final = 'libfastrtps.so.2.14'
_OK: Final = 0
_GET_PARTICIPANT: Final = '_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s'
_SET_LISTENER: Final = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant12set_listener'
    'EPNS1_25DomainParticipantListenerENSt6chrono8durationIlSt5ratioILl1ELl1EEEE'
)


def end_callbacks(node: Node) -> None:
    """Have the participant of a node tell nobody of the graph any more; to be called before the node is destroyed.

    Waits at most CALLBACK_SECONDS for a callback that is under way: a time that can be converted. Nothing is done where
    another middleware, or another version of it, is in use.
    """
    participant = participant_of(node)
    if participant is None:
        return
    set_listener = loaded_function(_DDS, _SET_LISTENER, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long)
    if set_listener(participant, None, CALLBACK_SECONDS) != _OK:
        node.get_logger().warning(f'a callback of the middleware did not end within {CALLBACK_SECONDS} s')


def participant_of(node: Node) -> int | None:
    """Address of the DomainParticipant of a node; None when it is not one of Fast DDS 2.14."""
    if get_rmw_implementation_identifier() != _RMW:
        return None
    try:
        loaded_function(_DDS, _SET_LISTENER, ctypes.c_int)
        get_rmw_node = loaded_function('librcl.so', 'rcl_node_get_rmw_handle', ctypes.c_void_p, ctypes.c_void_p)
        get_participant = loaded_function(f'lib{_RMW}.so', _GET_PARTICIPANT, ctypes.c_void_p, ctypes.c_void_p)
    except (OSError, AttributeError):
        return None
    with node.handle:
        address: int | None = get_participant(get_rmw_node(node.handle.pointer))
    return address
