# SPDX-License-Identifier: BSD-3-Clause
"""Faults of navigation servers on command; the simulator announces them."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable
from typing import Final

from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalFault, goal_servers, set_error
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.errors import FlexbtError
from flexbt_core.values.yaml_data import YamlError
from flexbt_sim.messages import action_type, faults_of
from flexbt_sim.world.descriptions.faults import ServerDies, ServerFails, ServerFault, ServerHangs, ServerRefuses

FAULTS_DEPTH: Final = 10
"""Messages that wait to be taken: at many times real time a short fault is over soon."""


class ServerFaults:
    """An agent that carries out the faults of a node's servers. On the executor thread."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        runtime.node.create_subscription(
            String, names.SERVER_FAULTS, self._receive, names.transient_local_qos(FAULTS_DEPTH)
        )

    def _receive(self, message: String) -> None:
        try:
            faults = faults_of(message)
        except (FlexbtError, YamlError) as error:
            self._runtime.node.get_logger().error(
                f'{names.SERVER_FAULTS}: ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS
            )
            return
        for dying in faults:
            if isinstance(dying, ServerDies):
                self._runtime.node.get_logger().fatal(
                    f'{dying.server} dies, by a fault on command (simulator/set_fault ends it)'
                )
                os.kill(os.getpid(), signal.SIGKILL)
        for name, server in goal_servers(self._runtime).items():
            fault = _merged([one for one in faults if one.server == name])
            if fault != server.fault:
                self._runtime.node.get_logger().warning(f'{name}: {_told(fault)}')
                server.fault = fault


def _merged(faults: Iterable[ServerFault]) -> GoalFault:
    """Return what several faults of one server come to."""
    refusal, failure, hangs = '', None, False
    for one in faults:
        match one:
            case ServerRefuses():
                refusal = 'a fault on command'
            case ServerFails():
                failure = action_type(one.server).Result()
                set_error(failure, one.error_code, one.error_msg)
            case ServerHangs():
                hangs = True
    return GoalFault(refusal, failure, hangs)


def _told(fault: GoalFault) -> str:
    said = [
        *(['refuses goals'] if fault.refusal else []),
        *(['hangs'] if fault.hangs else []),
        *([f'fails with error code {fault.failure.error_code}'] if fault.failure is not None else []),
    ]
    return f'{" and ".join(said)}, by a fault on command' if said else 'works again: its fault has ended'
