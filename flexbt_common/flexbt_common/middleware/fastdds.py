# SPDX-License-Identifier: BSD-3-Clause
"""Calls into Fast DDS that rclpy does not offer: end a participant, ignore one, and return memory of large messages."""

from __future__ import annotations

import ctypes
import os
import threading
from functools import cache
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from flexbt_core.values.text_files import open_regular


def loaded_function(library: str, name: str, result: Any, *arguments: Any, is_short: bool = False) -> Any:
    """Return a public function of rcl, rcutils, rmw_fastrtps or Fast DDS, by its name in the library that is loaded.

    One that ``is_short`` keeps the lock of the interpreter, as rclpy's own calls do: to get it back may take longer.

    Raises:
        OSError: the library is not loaded.
        AttributeError: it has no such function.
    """
    function = (ctypes.PyDLL if is_short else ctypes.CDLL)(library, mode=os.RTLD_NOLOAD)[name]
    function.argtypes, function.restype = arguments, result
    return function


# The end of a DDS participant that hangs in some builds of Fast DDS 2.14, and what prevents it.
#
# Before rmw_fastrtps destroys a participant, it takes the participant's listener off, and waits as long as it takes for
# a callback that is under way just then, since endpoints of others have appeared or gone. Fast DDS waits until the
# greatest time of the steady clock. A C++ library that can wait by the system clock only (that of a glibc before 2.30,
# for which the PyPI wheels are built) converts this time, which overflows: each wait comes back at once, as invalid,
# with the mutex still held that the callback needs. The process spins forever, and as rclpy keeps the lock of the
# interpreter meanwhile, no code of Python runs any more, no timer and no signal handler.

CALLBACK_SECONDS: Final = 1

_RMW: Final = 'rmw_fastrtps_cpp'
_FASTDDS_LIBRARY: Final = 'libfastrtps.so.2.14'
_RETCODE_OK: Final = 0
_GET_PARTICIPANT: Final = '_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s'
_SET_LISTENER: Final = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant12set_listener'
    'EPNS1_25DomainParticipantListenerENSt6chrono8durationIlSt5ratioILl1ELl1EEEE'
)


def end_callbacks(node: Node) -> None:
    """Stop the participant of a node from publishing its graph; call this before the node is destroyed.

    Waits at most CALLBACK_SECONDS for a callback that is under way: a time that can be converted. Nothing is done where
    another middleware, or another version of it, is in use.
    """
    participant = participant_address(node)
    if participant is None:
        return
    set_listener = loaded_function(
        _FASTDDS_LIBRARY, _SET_LISTENER, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long
    )
    if set_listener(participant, None, CALLBACK_SECONDS) != _RETCODE_OK:
        node.get_logger().warning(f'a callback of the middleware did not end within {CALLBACK_SECONDS} s')


def participant_address(node: Node) -> int | None:
    """Address of the DomainParticipant of a node; None when it is not one of Fast DDS 2.14."""
    if get_rmw_implementation_identifier() != _RMW:
        return None
    try:
        loaded_function(_FASTDDS_LIBRARY, _SET_LISTENER, ctypes.c_int)
        get_rmw_node = loaded_function('librcl.so', 'rcl_node_get_rmw_handle', ctypes.c_void_p, ctypes.c_void_p)
        get_participant = loaded_function(f'lib{_RMW}.so', _GET_PARTICIPANT, ctypes.c_void_p, ctypes.c_void_p)
    except (OSError, AttributeError):
        return None
    with node.handle:
        address: int | None = get_participant(get_rmw_node(node.handle.pointer))
    return address


# To hear nothing more of a participant of the domain: the middleware drops what it sends as it comes in.
#
# What a node does not want to have still costs it memory: the middleware puts large messages together and keeps
# them until they are taken. (DDS has ``ignore_participant`` for this, DDS 1.4, 2.2.2.2.1.14; rmw does not offer
# it.)

_IGNORE: Final = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant18ignore_participantERKNS_8fastrtps4rtps16InstanceHandle_tE'
)
_PREFIX_SIZE: Final = 12
_PARTICIPANT_ENTITY: Final = b'\x00\x00\x01\xc1'  # ENTITYID_PARTICIPANT (DDSI-RTPS 9.3.1.3)


class _InstanceHandle(ctypes.Structure):
    _fields_ = (('value', ctypes.c_uint8 * 16), ('has_value', ctypes.c_bool))


def ignore_participant(node: Node, participant: bytes) -> bool:
    """Ignore a participant (see :class:`Received`) for good, on all topics of the process of ``node``.

    False, and nothing has been done, where the middleware is not Fast DDS 2.14.
    """
    own = participant_address(node)
    if own is None or len(participant) != _PREFIX_SIZE:
        return False
    try:
        ignore = loaded_function(
            _FASTDDS_LIBRARY, _IGNORE, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(_InstanceHandle)
        )
    except (OSError, AttributeError):
        return False
    value = (ctypes.c_uint8 * 16)(*participant, *_PARTICIPANT_ENTITY)
    return bool(ignore(own, ctypes.byref(_InstanceHandle(value, True))) == _RETCODE_OK)


def ignore_each_other(first: Node, second: Node) -> None:
    """Keep two nodes, each with its own process or context, from discovering each other: neither sees the entities of
    the other in the graph, nor receives anything that it sends. Best done before either has much in it. Where the
    middleware is not Fast DDS 2.14, nothing is done."""
    for node, other in ((first, second), (second, first)):
        ignore_participant(node, _prefix_of(other))


def _prefix_of(node: Node) -> bytes:
    """Return what the identifiers of all that is in the participant of a node begin with; empty when it is not known,
    or when several nodes have this name."""
    own = node.get_name(), node.get_namespace()
    endpoints = node.get_publishers_info_by_topic('/parameter_events')  # each node publishes it
    found = [bytes(one.endpoint_gid) for one in endpoints if (one.node_name, one.node_namespace) == own]
    return found[0][:_PREFIX_SIZE] if len(found) == 1 else b''


# Return memory of large messages to the OS: otherwise a process keeps it forever, once for each topic and service.
#
# Two others keep it. Fast DDS, as rmw_fastrtps sets it up, keeps for each place in the queue of an endpoint the largest
# message that has been there; a profile may tell it not to (``historyMemoryPolicy`` DYNAMIC), which rmw_fastrtps heeds
# when RMW_FASTRTPS_USE_QOS_FROM_XML is 1. And malloc of glibc takes large pieces from the heap once it has seen one of
# them freed; there they are given back only when nothing above them is in use.

_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of mallopt; larger allocations are separate mappings, which free returns to the OS."""

_LARGE: Final = 2_000_000
_HEEDS: Final = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_SIDES: Final = ({'data_writer', 'publisher'}, {'data_reader', 'subscriber'})
"""Possible element names of the profiles of each side."""

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
    """Return whether this file of Fast DDS returns the memory of every topic.

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
