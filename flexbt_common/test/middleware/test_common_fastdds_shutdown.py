# SPDX-License-Identifier: BSD-3-Clause
"""The end of a participant: nothing of the middleware is under way."""

from __future__ import annotations

import ctypes
import os
from importlib.metadata import distributions

import pytest

from flexbt_common.middleware import fastdds
from flexbt_common.runtime.node_runtime import NodeRuntime

WHEEL = [*distributions(name='ros-fastrtps'), *distributions(name='ros-fastdds')]
GET_LISTENER = '_ZNK8eprosima7fastdds3dds17DomainParticipant12get_listenerEv'


@pytest.mark.dds('it is about Fast DDS')
@pytest.mark.skipif(not WHEEL, reason='the wheels of Fast DDS are not installed')
@pytest.mark.skipif(not fastdds.can_ignore(), reason='needs a known version of Fast DDS')
def test_the_listener_of_a_participant_is_taken_off_before_it_is_destroyed(monkeypatch: pytest.MonkeyPatch) -> None:
    listeners = []
    with NodeRuntime.open('ending') as runtime:
        participant = fastdds.participant_address(runtime.node)
        assert participant is not None
        get_listener = ctypes.CDLL(fastdds.loaded_library(), mode=os.RTLD_NOLOAD)[GET_LISTENER]
        get_listener.argtypes, get_listener.restype = [ctypes.c_void_p], ctypes.c_void_p
        listeners.append(get_listener(participant))
        destroy = runtime.node.destroy_node

        def look() -> None:
            listeners.append(get_listener(participant))
            destroy()

        monkeypatch.setattr(runtime.node, 'destroy_node', look)
    assert listeners[0] is not None
    assert listeners[1:] == [None]
