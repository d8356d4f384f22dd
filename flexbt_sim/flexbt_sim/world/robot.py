# SPDX-License-Identifier: BSD-3-Clause
"""A robot in the world: its drive, odometry and localization, and the devices that it carries."""

from __future__ import annotations

import math
from typing import Final, TypeVar

from flexbt_sim.world.device import Carrier, Device, DeviceFault, Sensor
from flexbt_sim.world.devices import Battery, Lidar, Scan
from flexbt_sim.world.faults import LocalizationLost, StuckWheel
from flexbt_sim.world.models import DEVICES, OdometryModel, RobotModel
from flexbt_sim.world.plane.geometry import Pose, compose, drive, inverse, wrap
from flexbt_sim.world.plane.space import Normals, WorldView, generator
from flexbt_sim.world.specification import FaultModel

COMMAND_PERIOD: Final = 0.05
"""Time between commands, s, of a program that steps the world itself: 20 Hz, as Nav2's controller server."""

CONVERGENCE: Final = (1.0, 0.8)
"""Maximum error, m and rad, of an initial pose that corrects the localization."""

D = TypeVar('D', bound=Device)


class Robot(Carrier):
    """A robot. Its state depends only on the seed, its name, the commands and the world.

    ``pose`` is its true pose; ``odometry`` the pose by its wheels, relative to its start; ``estimate`` the pose by its
    localization. ``linear`` and ``angular`` are the speeds of its wheels, m/s and rad/s. ``in_contact`` is True if a
    contact has ended its last movement; the robot then stops. ``devices`` are the devices that it carries, by name;
    ``sensors`` those that measure.
    """

    def __init__(self, name: str, model: RobotModel, pose: Pose, seed: int = 0) -> None:
        super().__init__(name, model.footprint, pose, seed)
        self.model = model
        self.top_speed = model.drive.linear_speed + model.drive.angular_speed * model.footprint.turning_radius
        self.faults: dict[str, FaultModel] = {}
        self.zones: tuple[str, ...] = ()
        self.speed_limit = math.inf
        """Speed limit, m/s, of the slow zones that it is in."""
        self.violations = 0
        """Number of times that it entered a no-go zone."""
        self.contacts = 0
        """Number of collisions."""
        carried = [(kind, getattr(model, kind.name)) for kind in DEVICES]
        self.devices: dict[str, Device] = {kind.name: kind(self, one) for kind, one in carried if one}
        self.sensors = tuple(one for one in self.devices.values() if isinstance(one, Sensor))
        self.battery = self.device(Battery)
        self._is_exact = model.odometry == OdometryModel() and not model.drive.slip
        """If True, the odometry follows the pose instead of being integrated."""
        self.reset()

    def reset(self) -> None:
        """Return to the state at the start, random numbers included. Faults continue, and have their effect again."""
        for device in self.devices.values():
            device.reset()
        self._odometry_noise = Normals(generator(self.seed, self.name, 'odometry'))
        self._slip = generator(self.seed, self.name, 'slip')
        self.violations = self.contacts = 0
        self.zones, self.speed_limit, self.in_shadow = (), math.inf, False
        self._odometry = Pose(0.0, 0.0, 0.0)
        self.pose, self._measured = self.start, inverse(self.start)
        self.place(self.start)
        for slot, fault in tuple(self.faults.items()):
            self.begin(slot, fault)

    def place(self, pose: Pose) -> None:
        """Put the robot at a pose and stop it. Its odometry does not notice; its localization is corrected."""
        self._measured = compose(self.odometry, inverse(pose))
        self.pose = pose
        self.linear = self.angular = self._linear = self._angular = 0.0
        self._grip = 1.0
        self.in_contact = False
        self._wanted = (0.0, 0.0)
        self._until = -math.inf
        self._error = Pose(0.0, 0.0, 0.0)
        self._correction = self._by_map if self.in_shadow else None

    def command(self, linear: float, angular: float, now: float) -> None:
        """Follow a velocity command, m/s and rad/s, received at a simulated time, s.

        The command is clipped to the limits. A command with a value that is not finite stops the robot.
        """
        model = self.model.drive
        if not (math.isfinite(linear) and math.isfinite(angular)):
            linear = angular = 0.0
        linear = max(-model.linear_speed, min(model.linear_speed, linear))
        self._wanted = (linear, max(-model.angular_speed, min(model.angular_speed, angular)))
        self._until = now + model.watchdog

    @property
    def odometry(self) -> Pose:
        """Pose by its wheels, from its start."""
        return compose(self._measured, self.pose) if self._is_exact else self._odometry

    @property
    def twist(self) -> tuple[float, float]:
        """Velocity over ground, m/s and rad/s. Slipping wheels do not measure it."""
        return self.linear * self._grip, self.angular * self._grip

    def is_driven(self, now: float) -> bool:
        """Return whether it moves or has a command, even one to stop, that its watchdog has not ended."""
        return bool(self.linear or self.angular or now < self._until)

    def device(self, kind: type[D]) -> D | None:
        """Return its device of this class, or None."""
        one = self.devices.get(kind.name)
        return one if isinstance(one, kind) else None

    @property
    def scan(self) -> Scan | None:
        """The last scan of its lidar."""
        lidar = self.device(Lidar)
        return None if lidar is None else lidar.scan

    @property
    def is_powered(self) -> bool:
        """True if it has no battery or its battery is not empty."""
        return self.battery is None or self.battery.level > 0.0

    # -- localization ------------------------------------------------------------------------------------------------

    @property
    def _by_map(self) -> Pose:
        """The true transform from the frame map to the frame odom."""
        return compose(self.pose, inverse(self.odometry))

    @property
    def _tracked(self) -> Pose:
        """The pose of the localization without its error: in a sensor shadow, by odometry alone."""
        return self.pose if self._correction is None else compose(self._correction, self.odometry)

    @property
    def map_to_odom(self) -> Pose:
        """The transform from the frame map to the frame odom, by the localization."""
        return compose(compose(self._error, self._tracked), inverse(self.odometry))

    @property
    def estimate(self) -> Pose:
        """The pose of the robot in the map, by the localization."""
        return compose(self.map_to_odom, self.odometry)

    def localize(self, pose: Pose) -> bool:
        """Set the pose of the localization (initialpose); return whether that localizes the robot."""
        distance, turn = CONVERGENCE
        found = pose.distance(self.pose) <= distance and abs(wrap(pose.yaw - self.pose.yaw)) <= turn
        if found and self._correction is not None:
            self._correction = compose(pose, inverse(self.odometry))
        self._error = Pose(0.0, 0.0, 0.0) if found else compose(pose, inverse(self._tracked))
        return found

    # -- faults ------------------------------------------------------------------------------------------------------

    def begin(self, slot: str, parameters: FaultModel) -> None:
        """Start a fault."""
        self.faults[slot] = parameters
        if isinstance(parameters, DeviceFault) and parameters.part in self.devices:
            self.devices[parameters.part].begin(slot, parameters)
        if isinstance(parameters, LocalizationLost):
            there = self.estimate
            x, y, yaw = parameters.jump
            jumped = Pose(there.x + x, there.y + y, wrap(there.yaw + yaw))
            self._error = compose(jumped, inverse(self._tracked))

    def end(self, slot: str) -> None:
        """End a fault. A lost localization is corrected."""
        ended = self.faults.pop(slot, None)
        if isinstance(ended, LocalizationLost):
            self._error = Pose(0.0, 0.0, 0.0)
        if isinstance(ended, DeviceFault):
            self.devices[ended.part].faults.pop(slot, None)

    # -- movement ----------------------------------------------------------------------------------------------------

    def tick(self, surroundings: WorldView, duration: float) -> None:
        """Move for a short time, s, at constant speeds."""
        model = self.model.drive
        linear, angular = self._wanted if surroundings.time < self._until else (0.0, 0.0)
        if self.battery is not None:
            driving = self.battery.model.driving * abs(self.linear) / model.linear_speed
            self.battery.run(self.battery.model.idle + driving, duration)
            if self.battery.level <= 0.0:
                linear = angular = 0.0
        if abs(linear) > self.speed_limit:  # on the same arc
            linear, angular = (part * self.speed_limit / abs(linear) for part in (linear, angular))
        if self.faults:
            self._get_lost(duration)
        if linear == angular == self._linear == self._angular == 0.0:
            self.linear = self.angular = 0.0
            return  # the robot stays where it is
        self._linear = self.linear = _approach(self._linear, linear, model.linear_acceleration * duration)
        angular = _approach(self._angular, angular, model.angular_acceleration * duration)
        if model.turning_radius:  # the front wheels of a car turn no farther, however fast it is
            greatest = abs(self.linear) / model.turning_radius
            angular = max(-greatest, min(greatest, angular))
        self._angular = self.angular = angular
        if self.faults and isinstance(stuck := self.faults.get(StuckWheel.name), StuckWheel):
            self._drag(stuck)
        self._move(surroundings, duration)

    def _drag(self, stuck: StuckWheel) -> None:
        """Apply the fault of wheels that do not turn."""
        model = self.model.drive
        left = 0.0 if stuck.side != 'right' else self.linear - self.angular * model.wheel_separation / 2.0
        right = 0.0 if stuck.side != 'left' else self.linear + self.angular * model.wheel_separation / 2.0
        self.linear = max(-model.linear_speed, min(model.linear_speed, (left + right) / 2.0))
        turning = (right - left) / model.wheel_separation
        self.angular = max(-model.angular_speed, min(model.angular_speed, turning))

    def _get_lost(self, duration: float) -> None:
        lost = self.faults.get(LocalizationLost.name)
        if isinstance(lost, LocalizationLost) and lost.drift:
            there = self.estimate
            moved = Pose(there.x + lost.drift * duration, there.y, there.yaw)
            self._error = compose(moved, inverse(self._tracked))

    def _move(self, surroundings: WorldView, duration: float) -> None:
        linear, angular = self.linear, self.angular
        slip = self.model.drive.slip
        self._grip = grip = 1.0 - 2.0 * slip * self._slip.random() if slip else 1.0
        start = self.pose
        reach = abs(linear) + abs(angular) * self.shape.turning_radius
        if reach == 0.0 or surroundings.time + duration <= self.clear_until:
            self.pose = drive(start, linear * grip, angular * grip, duration)
            moved = duration
        else:
            moved = surroundings.advance(
                self, lambda time: drive(start, linear * grip, angular * grip, time), reach, duration
            )
        self._measure(linear, angular, moved)
        was_in_contact, self.in_contact = self.in_contact, moved < duration or (self.in_contact and linear == 0.0)
        if moved < duration:
            self.contacts += not was_in_contact
            self.linear = self._linear = 0.0
            if self.model.drive.turning_radius:  # a car turns only while it drives
                self.angular = self._angular = 0.0
            else:
                self._turn_on(surroundings, angular, duration - moved)

    def _turn_on(self, surroundings: WorldView, angular: float, duration: float) -> None:
        """Turn a blocked robot as far as possible."""
        start, grip = self.pose, self._grip
        reach = abs(angular) * self.shape.turning_radius
        moved = surroundings.advance(self, lambda time: drive(start, 0.0, angular * grip, time), reach, duration)
        self._measure(0.0, angular, moved)
        if moved < duration:
            self.angular = self._angular = 0.0

    def _measure(self, linear: float, angular: float, duration: float) -> None:
        """Update the odometry by a movement of the wheels."""
        if self._is_exact:
            return
        model = self.model.odometry
        if model.linear_noise or model.angular_noise or model.drift or model.scale != 1.0:
            way, turn = abs(linear) * duration, abs(angular) * duration
            noise, other = self._odometry_noise.next(), self._odometry_noise.next()
            linear = linear * model.scale + noise * model.linear_noise * math.sqrt(way) / max(duration, 1e-9)
            angular += model.drift * linear + other * model.angular_noise * math.sqrt(turn) / max(duration, 1e-9)
        self._odometry = drive(self._odometry, linear, angular, duration)

    def enter(self, zones: tuple[str, ...], speed_limit: float, forbidden: int, *, in_shadow: bool) -> None:
        """Record the zones that it is in; ``forbidden`` is the number of no-go zones that it was not in before."""
        if in_shadow != self.in_shadow:
            self._correction = self._by_map if in_shadow else None
        self.zones, self.speed_limit, self.in_shadow = zones, speed_limit, in_shadow
        self.violations += forbidden


def _approach(value: float, target: float, step: float) -> float:
    return min(target, value + step) if value < target else max(target, value - step)
