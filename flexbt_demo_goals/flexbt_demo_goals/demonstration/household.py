# SPDX-License-Identifier: BSD-3-Clause
"""What others do in the flat while the robot works, by the services of the simulator; and what is seen of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from sensor_msgs.msg import JointState
from simulation_interfaces.msg import EntityState, Result
from simulation_interfaces.srv import GetEntityState, SetEntityState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_demo_behaviors.demonstration import DemoError, Pose, Simulation, Timeline
from flexbt_demo_goals.leaves import room_at
from flexbt_msgs.srv import SetFault

DOOR: Final = 'kitchen_door'
CUP: Final = 'cup'

MESSAGES: Final = 1000
"""Of a topic that may wait: each counts."""


class Household:
    """Shuts doors and moves cups. `on_change` is called, on another thread, when something is seen to have changed."""

    def __init__(self, runtime: NodeRuntime, timeline: Timeline, speed: float, on_change: Callable[[], None]) -> None:
        self.times_opened = 0
        """How often the door of the kitchen came to be open all the way."""
        self.times_held = 0
        """How often the robot came to hold the cup."""
        self.held = ''
        """What the robot holds; '' for nothing."""
        self._opening: float | None = None
        self._is_gripper_seen = False
        self._simulation = Simulation(runtime, timeline, speed)
        self._timeline = timeline
        self._on_change = on_change
        runtime.call(lambda: self._subscribe(runtime))

    @property
    def door_is_shut(self) -> bool:
        """Whether the door of the kitchen is shut all the way."""
        return self._opening is not None and self._opening <= 0.0

    @property
    def is_seen(self) -> bool:
        """Whether it is known how the door and the gripper are; what happens to them from then on is not missed."""
        return self._opening is not None and self._is_gripper_seen

    def in_real_time(self) -> AbstractContextManager[None]:
        """Has the world be as fast as the wall for the time of the context."""
        return self._simulation.in_real_time()

    def shut_door(self) -> None:
        """Have somebody shut the door of the kitchen."""
        response = self._simulation.call(SetBool, f'doors/{DOOR}', SetBool.Request(data=False))
        if not response.success:
            raise DemoError(f'{DOOR} was not shut: {response.message}')
        self._timeline.tell('household', 'somebody shuts the door of the kitchen')

    def jam_door(self, jammed: bool) -> None:
        """Have the door jam, or mend it."""
        request = SetFault.Request(entity=DOOR, fault='door_jammed', clear=not jammed)
        response = self._simulation.call(SetFault, 'set_fault', request)
        if not response.success:
            raise DemoError(f'the door could not be jammed or mended: {response.message}')
        self._timeline.tell('household', 'the door of the kitchen jams' if jammed else 'the door is mended')

    def move_cup(self, x: float, y: float) -> None:
        """Have somebody put the cup elsewhere, out of the gripper of the robot if need be."""
        state = EntityState()
        state.pose.position.x, state.pose.position.y = x, y
        response = self._simulation.call(
            SetEntityState, 'set_entity_state', SetEntityState.Request(entity=CUP, state=state)
        )
        if response.result.result != Result.RESULT_OK:
            raise DemoError(f'the cup was not moved: {response.result.error_message}')
        self._timeline.tell('household', f'somebody puts the cup to ({x:g}, {y:g}), in the {room_at(x, y)}')

    def cup(self) -> Pose:
        """Where the cup is."""
        response = self._simulation.call(GetEntityState, 'get_entity_state', GetEntityState.Request(entity=CUP))
        position = response.state.pose.position
        return Pose(position.x, position.y, 0.0)

    def _subscribe(self, runtime: NodeRuntime) -> None:
        runtime.node.create_subscription(JointState, 'simulator/doors', self._on_doors, names.latched(MESSAGES))
        runtime.node.create_subscription(String, names.GRIPPER_HOLDS, self._on_holds, names.latched(MESSAGES))

    def _on_doors(self, message: JointState) -> None:
        before, self._opening = self._opening, message.position[message.name.index(DOOR)]
        self.times_opened += before is not None and before < 1.0 <= self._opening
        self._on_change()

    def _on_holds(self, message: String) -> None:
        self.times_held += message.data == CUP != self.held
        self.held = message.data
        self._is_gripper_seen = True
        self._on_change()
