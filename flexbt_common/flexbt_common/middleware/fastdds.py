# SPDX-License-Identifier: BSD-3-Clause
"""Calls into Fast DDS that rclpy does not offer: end a participant, ignore one, and return memory of large messages."""

from __future__ import annotations

import ctypes
import os
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from flexbt_common.discovery import PROFILE
from flexbt_core.values.text_files import open_regular


def loaded_function(library: str, name: str, result: Any, *arguments: Any, is_short: bool = False) -> Any:
    """Return a public function of rcl, rcutils, rmw_fastrtps or Fast DDS, by its name in the library that is loaded.

    A function that ``is_short`` keeps the interpreter lock, as rclpy's calls do: getting it back may take longer.

    Raises:
        OSError: the library is not loaded.
        AttributeError: the library has no such function.
    """
    function = (ctypes.PyDLL if is_short else ctypes.CDLL)(library, mode=os.RTLD_NOLOAD)[name]
    function.argtypes, function.restype = arguments, result
    return function


# Destroying a DDS participant hangs in some builds of Fast DDS 2.14. This code prevents that.
#
# Before rmw_fastrtps destroys a participant, it removes the participant's listener, and waits without limit for a
# running callback about new or lost endpoints of other participants. Fast DDS waits until the greatest time of the
# steady clock. A C++ library that can wait only by the system clock (that of a glibc before 2.30, for which the PyPI
# wheels are built) converts this time, which overflows: each wait returns at once, as invalid, and still holds the
# mutex that the callback needs. The process spins forever. As rclpy keeps the interpreter lock meanwhile, no Python
# code runs any more, no timer and no signal handler.

CALLBACK_SECONDS: Final = 1

FAST_DDS: Final = 'rmw_fastrtps_cpp'
_IGNORE: Final = {
    f'lib{name}': f'_ZN8eprosima7fastdds3dds17DomainParticipant18ignore_participantERK{scope}4rtps16InstanceHandle_tE'
    for name, scope in (('fastrtps.so.2.14', 'NS_8fastrtps'), ('fastdds.so.3.2', 'NS0_'))
}
"""Libraries of the known versions of Fast DDS (of ROS 2 Jazzy and Kilted), with the name of ignore_participant."""

_RETCODE_OK: Final = 0
_GET_PARTICIPANT: Final = '_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s'
_SET_LISTENER: Final = (
    '_ZN8eprosima7fastdds3dds17DomainParticipant12set_listener'
    'EPNS1_25DomainParticipantListenerENSt6chrono8durationIlSt5ratioILl1ELl1EEEE'
)


def end_callbacks(node: Node) -> None:
    """Stop the participant of a node from publishing its graph; call this before the node is destroyed.

    Wait at most CALLBACK_SECONDS for a running callback: a time that can be converted. No effect with another
    middleware, or another version of it.
    """
    participant = participant_address(node)
    if participant is None:
        return
    set_listener = loaded_function(
        loaded_library(), _SET_LISTENER, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long
    )
    if set_listener(participant, None, CALLBACK_SECONDS) != _RETCODE_OK:
        node.get_logger().warning(f'a callback of the middleware did not end within {CALLBACK_SECONDS} s')


def loaded_library() -> str:
    """Return the name of the library of Fast DDS that is loaded. Raises OSError if it is not of a known version."""
    for name in _IGNORE:
        with suppress(OSError):
            ctypes.CDLL(name, mode=os.RTLD_NOLOAD)
            return name
    raise OSError(f'none of {", ".join(_IGNORE)} is loaded')


def participant_address(node: Node) -> int | None:
    """Return the address of the DomainParticipant of a node, or None if it is not one of a known Fast DDS."""
    if get_rmw_implementation_identifier() != FAST_DDS:
        return None
    try:
        loaded_function(loaded_library(), _SET_LISTENER, ctypes.c_int)
        get_rmw_node = loaded_function('librcl.so', 'rcl_node_get_rmw_handle', ctypes.c_void_p, ctypes.c_void_p)
        get_participant = loaded_function(f'lib{FAST_DDS}.so', _GET_PARTICIPANT, ctypes.c_void_p, ctypes.c_void_p)
    except (OSError, AttributeError):
        return None
    with node.handle:
        address: int | None = get_participant(get_rmw_node(node.handle.pointer))
    return address


# Ignoring a participant of the domain: the middleware drops its data on arrival.
#
# Unwanted messages would still cost a node memory: the middleware assembles large messages and keeps them until they
# are taken. (DDS has ``ignore_participant`` for this, DDS 1.4, 2.2.2.2.1.14; rmw does not offer it.)

_PREFIX_SIZE: Final = 12
_PARTICIPANT_ENTITY: Final = b'\x00\x00\x01\xc1'  # ENTITYID_PARTICIPANT (DDSI-RTPS 9.3.1.3)


def can_ignore() -> bool:
    """Return whether the middleware of this process is a known version of Fast DDS, which can ignore a participant."""
    if get_rmw_implementation_identifier() != FAST_DDS:
        return False
    try:
        _ignore_function()
    except (OSError, AttributeError):
        return False
    return True


def _ignore_function() -> Any:
    library = loaded_library()
    return loaded_function(library, _IGNORE[library], ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(_InstanceHandle))


class _InstanceHandle(ctypes.Structure):
    _fields_ = (('value', ctypes.c_uint8 * 16), ('has_value', ctypes.c_bool))


def ignore_participant(node: Node, participant: bytes) -> bool:
    """Ignore a participant (see :class:`Received`) permanently, on all topics of the process of ``node``.

    Return False, without an effect, if the middleware is not a known version of Fast DDS.
    """
    own = participant_address(node)
    if own is None or len(participant) != _PREFIX_SIZE:
        return False
    try:
        ignore = _ignore_function()
    except (OSError, AttributeError):
        return False
    value = (ctypes.c_uint8 * 16)(*participant, *_PARTICIPANT_ENTITY)
    return bool(ignore(own, ctypes.byref(_InstanceHandle(value, True))) == _RETCODE_OK)


def ignore_each_other(first: Node, second: Node) -> None:
    """Prevent two nodes of different processes or contexts from discovering each other: neither sees the other in the
    graph, or receives its messages. Call this before the nodes have many entities. No effect if the middleware is not
    a known version of Fast DDS."""
    for node, other in ((first, second), (second, first)):
        ignore_participant(node, _prefix_of(other))


def _prefix_of(node: Node) -> bytes:
    """Return the common prefix of the identifiers in a node's participant; empty if it is unknown, or if several nodes
    have this name."""
    own = node.get_name(), node.get_namespace()
    endpoints = node.get_publishers_info_by_topic('/parameter_events')  # each node publishes it
    found = [bytes(one.endpoint_gid) for one in endpoints if (one.node_name, one.node_namespace) == own]
    return found[0][:_PREFIX_SIZE] if len(found) == 1 else b''


# Return memory of large messages to the OS: otherwise a process keeps it forever, once for each topic and service.
#
# Two libraries keep it. Fast DDS, as rmw_fastrtps configures it, keeps memory for the largest message so far in each
# place of an endpoint's queue. A profile can change that (``historyMemoryPolicy`` DYNAMIC), if
# RMW_FASTRTPS_USE_QOS_FROM_XML is 1. And glibc's malloc allocates large blocks on the heap after the first of them was
# freed; it returns such memory only when nothing above it is in use.

_MMAP_THRESHOLD: Final = -3
"""M_MMAP_THRESHOLD of mallopt; larger allocations are separate mappings, which free returns to the OS."""

_LARGE: Final = 2_000_000
_HEEDS: Final = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_SIDES: Final = ({'data_writer', 'publisher'}, {'data_reader', 'subscriber'})
"""Possible element names of the profiles of each side."""

_lock: Final = threading.Lock()


def release_large_messages() -> None:
    """Make the process return the memory of received messages. Call this before the first node is created.

    The profile in the variable PROFILE decides once for the process, if it :func:`is_dynamic`; Fast DDS also
    reads it only once.
    """
    with _lock:
        _decide()


@cache
def _decide() -> None:
    libc = ctypes.CDLL(None)
    mallopt = getattr(libc, 'mallopt', None)  # of glibc
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _LARGE)
    if _HEEDS not in os.environ and is_dynamic(Path(os.environ.get(PROFILE, ''))):
        # The variable stays: each participant reads it, and other threads may read the environment meanwhile.
        # It is not in os.environ, so that child processes with another profile do not inherit it.
        libc.setenv(_HEEDS.encode(), b'1', 0)


def is_dynamic(profile: Path) -> bool:
    """Return whether this profile file of Fast DDS returns the memory of every topic.

    Each profile of writers and readers must set it, and the file must have default profiles of both kinds: without the
    setting, Fast DDS would refuse messages larger than the first. The profile of a topic has the topic's name.
    """
    try:
        with open(profile, 'rb', opener=open_regular) as content:
            root = ElementTree.parse(content).getroot()  # noqa: S314  # of the user; expat bounds its entities
    except (OSError, ElementTree.ParseError, ValueError, LookupError):  # the last two: unknown encodings
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
