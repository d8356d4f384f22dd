# SPDX-License-Identifier: BSD-3-Clause
"""Devices of robots: measurements and actions of sensors and other devices, their timing and their messages. Without
ROS.

A device is one class. Its name is its key in the description of a robot; its topics are described as values, which the
simulator fills messages with. ``DEVICES`` in ``flexbt_sim.world.models`` lists all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from flexbt_sim.world.plane.geometry import ORIGIN, Pose, Shape
from flexbt_sim.world.plane.ray_casting import Beams, Floats
from flexbt_sim.world.plane.space import Body, generator
from flexbt_sim.world.specification import FaultModel


@dataclass(frozen=True)
class DeviceFault(FaultModel):
    """Base of the faults of a device. ``part`` is the name of the device.

    A sensor whose fault ``freezes`` it repeats its last reading with a new time; one whose fault ``silences`` it
    publishes nothing.
    """

    freezes: ClassVar[bool] = False
    silences: ClassVar[bool] = False

    @property
    def noise_factor(self) -> float:
        """Factor by which the noise of a sensor is multiplied."""
        return 1.0


class Carrier(Body):
    """A robot as its devices see it."""

    is_mobile = True
    in_contact = False
    in_shadow = False

    def __init__(self, name: str, shape: Shape, pose: Pose, seed: int) -> None:
        super().__init__(name, shape, pose)
        self.seed = seed

    @property
    def twist(self) -> tuple[float, float]:
        """Velocity over ground, m/s and rad/s."""
        return 0.0, 0.0

    @property
    def is_powered(self) -> bool:
        """True if its devices have power."""
        return True


class Device:
    """Base of the devices of a robot. ``model`` is its description; ``is_read`` may be false while nobody reads it.

    Each message has the fixed values :meth:`constants`, and at ``fields`` the values :meth:`values`. A field is a code
    of ``struct`` ('d', 'f'), or '' for a value that is not a number of this kind, and the path to it in the message.
    ``array`` is the path to a list of float32, whose values are :meth:`array_values`.
    """

    name: ClassVar[str]
    topics: ClassVar[tuple[str, ...]] = ()
    message: ClassVar[str] = ''
    """Type of the messages, such as ``sensor_msgs/Range``."""
    frame: ClassVar[str] = ''
    """Frame of the device, at the pose of its model; '' if it has none."""
    fields: ClassVar[tuple[tuple[str, str], ...]] = ()
    array: ClassVar[str] = ''
    casts: ClassVar[bool] = False
    """True if it is a sensor that casts beams, which takes the world some time."""
    is_latched: ClassVar[bool] = False
    is_prompt: ClassVar[bool] = True
    """True if its messages are sent at once, not with the next pose of the robot."""

    def __init__(self, robot: Carrier, model: Any) -> None:
        self.robot = robot
        self.model = model
        self.is_read = True
        self.faults: dict[str, DeviceFault] = {}

    def reset(self) -> None:
        """Return to the state at the start, random numbers included."""

    def begin(self, slot: str, fault: DeviceFault) -> None:
        """Start a fault."""
        self.faults[slot] = fault

    @property
    def news(self) -> Any:
        """A value that changes with each message to send; None before the first."""
        return None

    @property
    def state(self) -> Any:
        """State of the device in a snapshot of the world, or None. It does not depend on the reader."""
        return None

    def constants(self) -> Mapping[str, Any]:
        """Return the values that all messages share, by their paths."""
        return {}

    def values(self) -> tuple[Any, ...]:
        """Return the values of the ``fields`` for the next message."""
        return ()

    def array_values(self) -> Any:
        """Return the values of the ``array`` for the next message, float32; always the same number of values."""


class Sensor(Device):
    """A device that measures ``rate`` times a second, in steps of the world, with its own noise.

    Each due reading draws its noise, even if nobody reads it, the robot has no power or a fault hides it.
    So neither readers nor faults change the noise of later readings.
    """

    samples: ClassVar[int] = 1
    """Normal numbers that a reading draws."""
    needs_power: ClassVar[bool] = True

    def __init__(self, robot: Carrier, model: Any) -> None:
        super().__init__(robot, model)
        self.time: float | None = None
        """Time of the last reading, s."""
        self.due = 0.0
        """Time of the next one, s."""

    def reset(self) -> None:
        self._random = generator(self.robot.seed, self.robot.name, self.name)
        self.time, self.due = None, 0.0

    @property
    def rate(self) -> float:
        """Readings per second."""
        return float(self.model.rate)

    @property
    def pose(self) -> Pose:
        """Pose on the robot: that of its model, if this has one."""
        pose: Pose = getattr(self.model, 'pose', ORIGIN)
        return pose

    @property
    def news(self) -> float | None:
        return self.time

    @property
    def noise_factor(self) -> float:
        """Factor by which faults multiply its noise."""
        return math.prod(one.noise_factor for one in self.faults.values()) if self.faults else 1.0

    def comes_due(self, now: float) -> bool:
        """Return whether to :meth:`take` a reading now, and schedule the next one."""
        if now + 1e-9 < self.due:
            return False
        period = 1.0 / self.rate
        self.due = period * (math.floor(now / period + 1e-6) + 1)
        if self.is_read and (self.robot.is_powered or not self.needs_power):
            return True
        self.draw()
        return False

    def take(self, now: float, ranges: Floats | None = None) -> None:
        """Take a reading. ``ranges`` are the exact distances along :meth:`beams`, m, infinite without a hit."""
        drawn = self.draw()
        if self.faults and any(one.silences for one in self.faults.values()):
            return
        if self.time is None or not (self.faults and any(one.freezes for one in self.faults.values())):
            self.measure(drawn, ranges)
        self.time = now

    def draw(self) -> Any:
        """Return the random numbers of one reading."""
        return self._random.standard_normal(self.samples)

    def beams(self, number: int) -> Beams:
        """Return its beams where it is now; ``number`` is that of the robot, which they do not meet."""
        raise NotImplementedError

    def measure(self, drawn: Any, ranges: Any) -> None:
        """Store a reading, from the numbers that :meth:`draw` returned and the ranges along the beams, if any."""
