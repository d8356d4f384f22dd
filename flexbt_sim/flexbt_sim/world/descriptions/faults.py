# SPDX-License-Identifier: BSD-3-Clause
"""What can go wrong on command: one table of all faults, of the world, of messages and of navigation servers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.plane.geometry import Pose

from .specification import ModelSpecification, WorldProblem, key, keys_of, names, read


@dataclass(frozen=True)
class FaultModel(ModelSpecification):
    """Base of the parameters of a fault: ``name``, the kinds of entities that can have it, and who carries it out."""

    name: ClassVar[str]
    entities: ClassVar[tuple[str, ...]] = ('robot',)
    by: ClassVar[str] = 'world'
    needs: ClassVar[str] = ''

    @property
    def part(self) -> str:
        """What of its model an entity has to have for it; '' for nothing."""
        return self.needs

    @property
    def slot(self) -> str:
        """What an entity has one of at a time: another fault with the same takes its place."""
        return self.name

    def __str__(self) -> str:
        """For people, on one line: ``stuck_wheel (side: 'left')``."""
        values = names(f'{name}: {short_repr(getattr(self, name))}' for name in keys_of(type(self)))
        return f'{self.name} ({values})' if values else self.name


@dataclass(frozen=True)
class StuckWheel(FaultModel):
    """A wheel, or both, do not turn: the robot turns in a circle, or stays. The odometry sees it."""

    name: ClassVar[str] = 'stuck_wheel'
    side: str = key('which wheel', 'left', choices=('left', 'right', 'both'))


@dataclass(frozen=True)
class LocalizationLost(FaultModel):
    """The pose that the localization has jumps, and drifts on. It is right again at the end of the fault."""

    name: ClassVar[str] = 'localization_lost'
    jump: Pose = key('by how much it jumps at once', Pose(1.0, 0.0, 0.0))
    drift: float = key('how fast it goes on along x of the map', 0.0, unit='m/s', low=-10.0, high=10.0)


@dataclass(frozen=True)
class LidarFrozen(FaultModel):
    """Each scan is a copy of the last one before the fault, with a new time."""

    name: ClassVar[str] = 'lidar_frozen'
    needs: ClassVar[str] = 'lidar'


@dataclass(frozen=True)
class LidarBlinded(FaultModel):
    """Beams in a direction return nothing, as in glare."""

    name: ClassVar[str] = 'lidar_blinded'
    needs: ClassVar[str] = 'lidar'
    direction: float = key('the middle of it; 0 is straight ahead', 0.0, unit='rad', low=-math.pi, high=math.pi)
    width: float = key('how wide it is; 2 pi for all beams', math.tau, unit='rad', low=0.0, high=math.tau)


@dataclass(frozen=True)
class BatteryLow(FaultModel):
    """The battery falls to a level at once. It does not come back at the end of the fault."""

    name: ClassVar[str] = 'battery_low'
    needs: ClassVar[str] = 'battery'
    level: float = key('what is left, of 1', 0.1, low=0.0, high=1.0)


@dataclass(frozen=True)
class DoorJammed(FaultModel):
    """The door stays as it is, whatever it is told."""

    name: ClassVar[str] = 'door_jammed'
    entities: ClassVar[tuple[str, ...]] = ('door',)


TOPICS: Final[Mapping[str, str]] = {
    'amcl_pose': '', 'battery_state': 'battery', 'battery_status': 'battery', 'bumper': 'bumper', 'cmd_vel': '',
    'gripper_holds': 'gripper', 'odom': '', 'pose': '', 'scan': 'lidar', 'tf': '',
}  # fmt: skip
"""The topics of a robot whose messages may be lost or late, each with what of its model the robot has to have."""


@dataclass(frozen=True)
class MessagesFault(FaultModel):
    """Base of the faults of a topic of the robot."""

    by: ClassVar[str] = 'simulator'
    topic: str = key('its name in the namespace of the robot', 'scan', choices=tuple(TOPICS))

    @classmethod
    def slot_of(cls, topic: str) -> str:
        """Return each topic can have it."""
        return f'{cls.name} of {topic}'

    @property
    def slot(self) -> str:
        """That of its topic."""
        return self.slot_of(self.topic)

    @property
    def part(self) -> str:
        """What the topic comes from."""
        return TOPICS[self.topic]


@dataclass(frozen=True)
class MessagesDropped(MessagesFault):
    """Messages of a topic of the robot are lost."""

    name: ClassVar[str] = 'messages_dropped'
    probability: float = key('of each to be lost', 1.0, low=0.0, high=1.0)


@dataclass(frozen=True)
class MessagesLate(MessagesFault):
    """Messages of a topic of the robot arrive late, in their order."""

    name: ClassVar[str] = 'messages_late'
    delay: float = key('by how much, of simulated time', 0.5, unit='s', low=0.0, high=60.0)


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
        """Each server can have it."""
        return f'{self.name} of {self.server}'


@dataclass(frozen=True)
class ServerRefuses(ServerFault):
    """A navigation server rejects its goals. Those that it has accepted before go on."""

    name: ClassVar[str] = 'server_refuses'


@dataclass(frozen=True)
class ServerFails(ServerFault):
    """A navigation server aborts its goals, those that it works on too, with an error code and a message."""

    name: ClassVar[str] = 'server_fails'
    error_code: int = key('code of the result, one of the action; 0 is `NONE`', 0, low=0, high=65535)
    error_msg: str = key('message of the result', 'a fault on command')


@dataclass(frozen=True)
class ServerHangs(ServerFault):
    """A navigation server accepts goals, neither goes on with them nor ends them, and does not answer to a cancel. What
    it drives comes to rest. At the end of the fault its goals are begun anew, unless they are to be canceled.
    """

    name: ClassVar[str] = 'server_hangs'


@dataclass(frozen=True)
class ServerDies(ServerFault):
    """The process of a navigation server ends at once, as by SIGKILL, and so does each one that is started in its place
    until the end of the fault: give a duration for one that can be started again.
    """

    name: ClassVar[str] = 'server_dies'


_ALL: Final[tuple[type[FaultModel], ...]] = (
    StuckWheel, LocalizationLost, LidarFrozen, LidarBlinded, BatteryLow, DoorJammed, MessagesDropped, MessagesLate,
    ServerRefuses, ServerFails, ServerHangs, ServerDies,
)  # fmt: skip
FAULTS: Final[Mapping[str, type[FaultModel]]] = {one.name: one for one in _ALL}
"""Every fault by its name."""


@dataclass(frozen=True)
class Fault:
    """A fault of an entity that is to come or is there: from ``begins`` to ``ends``, simulated time, s."""

    entity: str
    parameters: FaultModel
    begins: float
    ends: float = math.inf

    @property
    def name(self) -> str:
        """Its name in the table."""
        return self.parameters.name


@dataclass(frozen=True)
class FaultTiming(ModelSpecification):
    """When a fault is there. It is an entry of the list ``faults`` of a world file."""

    title: ClassVar[str] = 'fault'

    entity: str = key('name of the robot or the door')
    fault: str = key('name of the fault', choices=tuple(FAULTS))
    after: float = key('simulated time until it begins', 0.0, unit='s', low=0.0)
    duration: float = key('simulated time until it ends by itself; 0: not', 0.0, unit='s', low=0.0)


def fault_parameters(fault: str, values: Mapping[str, Any]) -> FaultModel:
    """Return the parameters of a fault from plain data.

    Raises:
        SimulationError: there is no such fault, or a value is wrong.
    """
    if fault not in FAULTS:
        raise SimulationError(f"there is no fault '{fault}'{did_you_mean(fault, FAULTS)}")
    problems: list[WorldProblem] = []
    parameters = read(FAULTS[fault], values, (), problems)
    if parameters is None:
        raise SimulationError(f'{fault}: ' + names(f'{one.where}: {one.message}' for one in problems))
    return parameters
