# SPDX-License-Identifier: BSD-3-Clause
"""What happens in the building during a watch, by the services of the simulator; and what the robots say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_demo_behaviors.demonstration import DemoError, Pose, Simulation, Timeline
from flexbt_demo_night_watch.behavior import ROOMS_LEFT
from flexbt_msgs.srv import SetFault

DOOR: Final = 'archive_door'

LOW: Final = 0.25
FULL: Final = 0.85
"""Shares of the capacity at which a battery counts as low, and as charged."""


class Building:
    """Brings faults about, and hears of rooms and alarms. `on_change` is called, on another thread, when it has."""

    def __init__(
        self, runtime: NodeRuntime, robots: Sequence[str], timeline: Timeline, on_change: Callable[[], None]
    ) -> None:
        self._simulation = Simulation(runtime, timeline)
        self._timeline = timeline
        self._on_change = on_change
        self._left: dict[str, tuple[str, ...]] = {}
        self._alarms: list[tuple[str, Pose]] = []
        self._low: set[str] = set()
        self._charged: frozenset[str] = frozenset()
        runtime.call(lambda: self._subscribe(runtime, robots))

    @property
    def rooms_left(self) -> Mapping[str, tuple[str, ...]]:
        """The rooms that each robot has still to look at, as it said last."""
        return self._left

    @property
    def alarms(self) -> Sequence[tuple[str, Pose]]:
        """The alarms so far: the robot that has raised each, and the pose that it is about."""
        return self._alarms

    @property
    def charged(self) -> frozenset[str]:
        """The robots whose battery was low, and is not any more."""
        return self._charged

    def lower_battery(self, robot: str) -> None:
        """Leave little in the battery of a robot."""
        self._set(SetFault.Request(entity=robot, fault='battery_low', parameters='level: 0.1'))
        self._timeline.tell('building', f'the battery of {robot} runs low')

    def mend_door(self) -> None:
        """Have the jammed door mended."""
        self._set(SetFault.Request(entity=DOOR, fault='door_jammed', clear=True))
        self._timeline.tell('building', f'{DOOR} is mended')

    def _subscribe(self, runtime: NodeRuntime, robots: Sequence[str]) -> None:
        node = runtime.node
        for robot in robots:
            node.create_subscription(String, f'{robot}/{ROOMS_LEFT}', partial(self._on_left, robot), names.latched())
            battery = partial(self._on_battery, robot)
            node.create_subscription(BatteryState, f'{robot}/battery_state', battery, QoSProfile(depth=10))
            alarm = partial(self._on_alarm, robot)
            node.create_subscription(PoseStamped, f'{robot}/alarm', alarm, QoSProfile(depth=10))

    def _on_left(self, robot: str, message: String) -> None:
        self._left = {**self._left, robot: tuple(message.data.split())}
        self._on_change()

    def _on_battery(self, robot: str, message: BatteryState) -> None:
        if message.percentage <= LOW:
            self._low.add(robot)
        elif message.percentage >= FULL and robot in self._low:
            self._charged |= {robot}
            self._on_change()

    def _on_alarm(self, robot: str, message: PoseStamped) -> None:
        position = message.pose.position
        self._alarms = [*self._alarms, (robot, Pose(position.x, position.y, 0.0))]
        self._on_change()

    def _set(self, request: SetFault.Request) -> None:
        response = self._simulation.call(SetFault, 'set_fault', request)
        if not response.success:
            raise DemoError(f'the fault {request.fault} of {request.entity} was not set: {response.message}')
