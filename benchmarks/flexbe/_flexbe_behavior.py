# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE runs for the benchmark, and FlexBT by its layer for FlexBE's code: an action, then a decision, in turns.

FlexBE takes the first class of the module, in the order of the names, for the behavior.
"""

from __future__ import annotations

from typing import Any

from _flexbe_stamp import entered
from flexbe_core import Autonomy, Behavior, EventState, OperatableStateMachine
from flexbe_core.proxy import ProxyActionClient
from nav2_msgs.action import Wait


class FlexbeProbe(Behavior):
    """Calls the action, waits for the operator, and so on."""

    def __init__(self, node: Any) -> None:
        super().__init__()
        self.name = 'FlexBE probe'
        self.add_parameter('rate', 10.0)
        OperatableStateMachine.initialize_ros(node)
        ProbeCall.initialize_ros(node)
        ProbeDecide.initialize_ros(node)
        ProxyActionClient.initialize(node)

    def create(self) -> Any:
        """Two states that follow each other."""
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add(
                'Call',
                ProbeCall(self.rate),
                transitions={'done': 'Decide'},
                autonomy={'done': Autonomy.Off},
            )
            OperatableStateMachine.add(
                'Decide',
                ProbeDecide(self.rate),
                transitions={'again': 'Call', 'finish': 'finished'},
                autonomy={'again': Autonomy.Full, 'finish': Autonomy.Full},
            )
        return machine


class ProbeCall(EventState):
    """
    Sends a goal, and ends when there is a result.

    -- rate     float   How often it looks, Hz

    <= done             There is one.
    """

    def __init__(self, rate: float) -> None:
        super().__init__(outcomes=['done'], desired_rate=rate)
        self._action = 'flexbe_benchmark/wait'
        self._client = ProxyActionClient({self._action: Wait}, wait_duration=5.0)

    def on_enter(self, userdata: Any) -> None:
        entered('Call')
        self._client.send_goal(self._action, Wait.Goal(), wait_duration=5.0)

    def execute(self, userdata: Any) -> str | None:
        if not self._client.has_result(self._action):
            return None
        self._client.get_result(self._action)
        self._client.remove_result(self._action)
        return 'done'


class ProbeDecide(EventState):
    """
    Waits until the operator decides.

    -- rate     float   How often it is executed, Hz

    <= again            The operator wants it again.
    <= finish           The operator has seen enough.
    """

    def __init__(self, rate: float) -> None:
        super().__init__(outcomes=['again', 'finish'], desired_rate=rate)

    def on_enter(self, userdata: Any) -> None:
        entered('Decide')

    def execute(self, userdata: Any) -> str | None:
        return None
