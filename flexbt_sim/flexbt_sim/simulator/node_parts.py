# SPDX-License-Identifier: BSD-3-Clause
"""What the services of the simulator need of it."""

from __future__ import annotations

import threading
from typing import Protocol

from builtin_interfaces.msg import Time

from flexbt_common.runtime import NodeRuntime
from flexbt_sim.world import Entity, Pacer, Pose, World

from .parameters import SimulatorParameters


class SimulatorParts(Protocol):
    """The simulator as its services see it. Methods are called on the executor thread, without the lock."""

    runtime: NodeRuntime
    parameters: SimulatorParameters
    lock: threading.Lock
    """Held while the world is stepped, looked at or changed; what is only read by one name need not."""
    world: World
    pacer: Pacer

    @property
    def namespaces(self) -> list[str]:
        """Where the topics of the robots are, within that of the node: '' or 'robot1/'."""

    def stamp(self) -> Time:
        """The time of the clock."""

    def spawned(self, entity: Entity, namespace: str) -> None:
        """Something has come: make what it needs, in a namespace of its own unless it is named."""

    def is_free_namespace(self, namespace: str) -> bool:
        """Whether no robot is there."""

    def remove(self, entity: Entity) -> None:
        """Take something away, and what it needed."""

    def remove_spawned(self) -> None:
        """Take away all that has come by service."""

    def move(self, entity: Entity, pose: Pose) -> None:
        """Put something somewhere. Raises SimulationError, as :meth:`World.move`."""

    def reset_state(self) -> None:
        """Everything is where it was at the start; the time goes on."""

    def reset_time(self) -> None:
        """The clock begins at 0."""

    def has_navigation(self, robot: str) -> bool:
        """Whether a node navigation carries out the faults of the servers of a robot."""

    def publish_faults(self) -> None:
        """Tell the navigation servers which faults they have."""

    def restart(self) -> None:
        """Begin anew, as if the simulator had been started. Raises SimulationError: the file cannot be read now."""
