# SPDX-License-Identifier: BSD-3-Clause
"""Faults on command: the table of the faults of the world, of messages and of navigation servers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from flexbt_core.values.text import did_you_mean
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.device import DeviceFault, Sensor
from flexbt_sim.world.devices import BatteryLow, LidarBlinded, LidarFrozen
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.specification import FaultModel, ModelSpecification, WorldProblem, key, names, read

from .models import DEVICES


@dataclass(frozen=True)
class StuckWheel(FaultModel):
    """One or both wheels do not turn: the robot drives in a circle or stands still. The odometry measures this."""

    name: ClassVar[str] = 'stuck_wheel'
    side: str = key('which wheel', 'left', choices=('left', 'right', 'both'))


@dataclass(frozen=True)
class LocalizationLost(FaultModel):
    """The localized pose jumps and then drifts. It is correct again when the fault ends."""

    name: ClassVar[str] = 'localization_lost'
    jump: Pose = key('initial jump of the estimated pose', Pose(1.0, 0.0, 0.0))
    drift: float = key('speed of the drift along x of the map', 0.0, unit='m/s', low=-10.0, high=10.0)


@dataclass(frozen=True)
class DoorJammed(FaultModel):
    """The door ignores commands and stays where it is, or closes or opens first."""

    name: ClassVar[str] = 'door_jammed'
    entities: ClassVar[tuple[str, ...]] = ('door',)
    where: str = key('where it stays', 'anywhere', choices=('anywhere', 'closed', 'open'))


SENSORS: Final = tuple(one for one in DEVICES if issubclass(one, Sensor))


@dataclass(frozen=True)
class SensorFault(DeviceFault):
    """Base of the faults that every sensor can have."""

    sensor: str = key('which sensor', 'lidar', choices=tuple(one.name for one in SENSORS))

    @property
    def slot(self) -> str:
        """Slot: one for each sensor."""
        return f'{self.name} of {self.sensor}'

    @property
    def part(self) -> str:
        """The sensor."""
        return self.sensor


@dataclass(frozen=True)
class SensorFrozen(SensorFault):
    """Each reading is a copy of the last one before the fault, with a new time."""

    name: ClassVar[str] = 'sensor_frozen'
    freezes: ClassVar[bool] = True


@dataclass(frozen=True)
class SensorSilent(SensorFault):
    """The sensor publishes nothing."""

    name: ClassVar[str] = 'sensor_silent'
    silences: ClassVar[bool] = True


@dataclass(frozen=True)
class SensorNoisy(SensorFault):
    """The noise of the sensor is greater."""

    name: ClassVar[str] = 'sensor_noisy'
    sensor: str = key('which sensor', 'lidar', choices=tuple(one.name for one in SENSORS if one.samples))
    factor: float = key('factor by which the noise is multiplied', 10.0, low=0.0, high=1e6)

    @property
    def noise_factor(self) -> float:
        """Factor by which the noise of a sensor is multiplied."""
        return self.factor


TOPICS: Final[Mapping[str, str]] = dict(
    sorted(
        [(topic, '') for topic in ('amcl_pose', 'cmd_vel', 'odom', 'pose', 'tf')]
        + [(topic, one.name) for one in DEVICES for topic in one.topics]
    )
)
"""The topics of a robot whose messages can be lost or late, each with its device ('' for none)."""


@dataclass(frozen=True)
class MessagesFault(FaultModel):
    """Base of the faults of a topic of the robot."""

    by: ClassVar[str] = 'simulator'
    topic: str = key('topic name in the namespace of the robot', 'scan', choices=tuple(TOPICS))

    @classmethod
    def slot_of(cls, topic: str) -> str:
        """Return the slot of a topic."""
        return f'{cls.name} of {topic}'

    @property
    def slot(self) -> str:
        """Slot: one for each topic."""
        return self.slot_of(self.topic)

    @property
    def part(self) -> str:
        """The device of the topic."""
        return TOPICS[self.topic]


@dataclass(frozen=True)
class MessagesDropped(MessagesFault):
    """Messages of a topic of the robot are lost."""

    name: ClassVar[str] = 'messages_dropped'
    probability: float = key('probability that each message is lost', 1.0, low=0.0, high=1.0)


@dataclass(frozen=True)
class MessagesLate(MessagesFault):
    """Messages of a topic of the robot arrive late, in order."""

    name: ClassVar[str] = 'messages_late'
    delay: float = key('delay in simulated time', 0.5, unit='s', low=0.0, high=60.0)


NAVIGATION_SERVERS: Final = (
    'assisted_teleop', 'backup', 'compute_and_track_route', 'compute_path_through_poses', 'compute_path_to_pose',
    'compute_route', 'dock_robot', 'drive_on_heading', 'follow_path', 'smooth_path', 'spin', 'undock_robot', 'wait',
)  # fmt: skip
"""The actions of the node navigation."""


@dataclass(frozen=True)
class ServerFault(FaultModel):
    """Base of the faults of a navigation server of the robot."""

    by: ClassVar[str] = 'navigation'
    server: str = key('name of the action', 'follow_path', choices=NAVIGATION_SERVERS)

    @property
    def slot(self) -> str:
        """Slot: one for each server."""
        return f'{self.name} of {self.server}'


@dataclass(frozen=True)
class ServerRefuses(ServerFault):
    """A navigation server rejects new goals. Goals that it has already accepted continue."""

    name: ClassVar[str] = 'server_refuses'


@dataclass(frozen=True)
class ServerFails(ServerFault):
    """A navigation server aborts all goals, including active ones, with an error code and a message."""

    name: ClassVar[str] = 'server_fails'
    error_code: int = key('error code of the result, as the action defines it; 0 is `NONE`', 0, low=0, high=65535)
    error_msg: str = key('error message of the result', 'a fault on command')


@dataclass(frozen=True)
class ServerHangs(ServerFault):
    """A navigation server accepts goals but neither executes nor ends them, and ignores cancel requests. The robot that
    it drives stops. When the fault ends, the server restarts its goals, except those with a cancel request.
    """

    name: ClassVar[str] = 'server_hangs'


@dataclass(frozen=True)
class ServerDies(ServerFault):
    """The process of a navigation server ends immediately, as by SIGKILL. Each process started in its place ends
    too, until the fault ends. Set a duration so that the server can be restarted.
    """

    name: ClassVar[str] = 'server_dies'


_ALL: Final[tuple[type[FaultModel], ...]] = (
    StuckWheel, LocalizationLost, LidarFrozen, LidarBlinded, SensorFrozen, SensorSilent, SensorNoisy, BatteryLow,
    DoorJammed, MessagesDropped, MessagesLate, ServerRefuses, ServerFails, ServerHangs, ServerDies,
)  # fmt: skip
FAULTS: Final[Mapping[str, type[FaultModel]]] = {one.name: one for one in _ALL}
"""Every fault by its name."""


@dataclass(frozen=True)
class Fault:
    """A pending or active fault of an entity: from ``begins`` to ``ends``, simulated time, s."""

    entity: str
    parameters: FaultModel
    begins: float
    ends: float = math.inf

    @property
    def name(self) -> str:
        """Name of the fault in the table."""
        return self.parameters.name


@dataclass(frozen=True)
class FaultTiming(ModelSpecification):
    """The timing of a fault: an entry of the list ``faults`` in a world file."""

    title: ClassVar[str] = 'fault'

    entity: str = key('name of the robot or door')
    fault: str = key('name of the fault', choices=tuple(FAULTS))
    after: float = key('simulated time before it starts', 0.0, unit='s', low=0.0)
    duration: float = key('simulated time after which it ends; 0: never', 0.0, unit='s', low=0.0)


def check_fault_name(fault: str) -> None:
    """Raise SimulationError if no fault has this name."""
    if fault not in FAULTS:
        raise SimulationError(f"there is no fault '{fault}'{did_you_mean(fault, FAULTS)}")


def fault_parameters(fault: str, values: Mapping[str, Any]) -> FaultModel:
    """Return the parameters of a fault from plain data.

    Raises:
        SimulationError: the fault does not exist, or a value is wrong.
    """
    check_fault_name(fault)
    problems: list[WorldProblem] = []
    parameters = read(FAULTS[fault], values, (), problems)
    if parameters is None:
        raise SimulationError(f'{fault}: ' + names(f'{one.where}: {one.message}' for one in problems))
    return parameters
