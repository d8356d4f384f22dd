# SPDX-License-Identifier: BSD-3-Clause
"""Calls into Cyclone DDS that rclpy does not offer: find the identifier of the writer of a message.

rmw_cyclonedds reports a handle that is only valid in this process, in place of the writer's GUID
(https://github.com/ros2/rmw_cyclonedds/issues/377). The graph of ROS has GUIDs, so no writer would be found there.
"""

from __future__ import annotations

import ctypes
from collections import OrderedDict
from typing import Any, Final

from rclpy.subscription import Subscription

from .fastdds import loaded_function

_LIBRARY: Final = 'librmw_cyclonedds_cpp.so'  # and what it is linked with
_HANDLE_SIZE: Final = 8  # dds_instance_handle_t
_GUID_SIZE: Final = 16

_MOST_WRITERS: Final = 256
"""Maximum number of writers of a subscription whose GUIDs are kept: those heard last."""


class _RmwSubscription(ctypes.Structure):
    """The first members of rmw_subscription_t; ``data`` is rmw_cyclonedds's, which begins with a dds_entity_t."""

    _fields_ = (('implementation', ctypes.c_char_p), ('data', ctypes.POINTER(ctypes.c_int32)))


class WriterGuids:
    """The GUIDs of the writers that one subscription hears. The middleware must be Cyclone DDS."""

    def __init__(self) -> None:
        """Find the functions.

        Raises:
            OSError, AttributeError: this version lacks them.
        """
        self._known: OrderedDict[bytes, bytes] = OrderedDict()
        self._rmw_subscription = loaded_function(
            'librcl.so', 'rcl_subscription_get_rmw_handle', ctypes.POINTER(_RmwSubscription), ctypes.c_void_p
        )
        # Its result is a dds_builtintopic_endpoint_t, which begins with the GUID.
        self._publication = loaded_function(
            _LIBRARY, 'dds_get_matched_publication_data', ctypes.c_void_p, ctypes.c_int32, ctypes.c_uint64
        )
        self._free = loaded_function(_LIBRARY, 'dds_builtintopic_free_endpoint', None, ctypes.c_void_p)

    def guid(self, subscription: Subscription, writer: bytes) -> bytes:
        """Return the GUID of a writer that rmw_cyclonedds reports; ``writer`` itself if it was never matched."""
        if writer in self._known:
            self._known.move_to_end(writer)
            return self._known[writer]
        with subscription.handle:
            data: Any = self._rmw_subscription(subscription.handle.pointer).contents.data
            found = self._publication(data[0], int.from_bytes(writer[:_HANDLE_SIZE], 'little'))
        if not found:
            return writer
        try:
            guid = self._known[writer] = ctypes.string_at(found, _GUID_SIZE)
        finally:
            self._free(found)
        if len(self._known) > _MOST_WRITERS:
            self._known.popitem(last=False)
        return guid
