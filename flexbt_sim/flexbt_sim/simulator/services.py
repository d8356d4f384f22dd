# SPDX-License-Identifier: BSD-3-Clause
"""The services of doors and of faults, and what all services need of the simulator."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from functools import partial
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError
from flexbt_sim.messages import check_fault
from flexbt_sim.world.descriptions.faults import ServerFault, fault_parameters
from flexbt_sim.world.pacing import Pacer
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.scenery import Entity
from flexbt_sim.world.world import World

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
        """Namespaces of the topics of the robots, within that of the node: '' or 'robot1/'."""

    def stamp(self) -> Time:
        """Return the time of the clock."""

    def spawned(self, entity: Entity, namespace: str) -> None:
        """Make the topics of a new entity, in its own namespace unless it is named."""

    def is_free_namespace(self, namespace: str) -> bool:
        """Return whether no robot is there."""

    def remove(self, entity: Entity) -> None:
        """Take something away, and what it needed."""

    def remove_spawned(self) -> None:
        """Take away all that has come by service."""

    def move(self, entity: Entity, pose: Pose) -> None:
        """Put something somewhere. Raises SimulationError, as :meth:`World.move`."""

    def reset_state(self) -> None:
        """Everything is where it was at the start; the time goes on."""

    def reset_time(self) -> None:
        """Set the clock to 0."""

    def has_navigation(self, robot: str) -> bool:
        """Return whether a node navigation carries out the faults of the servers of a robot."""

    def publish_faults(self) -> None:
        """Tell the navigation servers which faults they have."""

    def restart(self) -> None:
        """Restart, as if the simulator had been started. Raises SimulationError: the file cannot be read now."""


# Doors by command: ``simulator/doors/NAME`` (std_srvs/SetBool) for each door of the world; true opens it.


class DoorServices:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorParts) -> None:
        self._simulator = simulator
        self._services: dict[str, Any] = {}

    def update(self) -> None:
        """Have a service for each door that there is, and for no other."""
        node, doors = self._simulator.runtime.node, self._simulator.world.doors
        for name in self._services.keys() - doors.keys():
            node.destroy_service(self._services.pop(name))
        for name in doors.keys() - self._services.keys():
            self._services[name] = node.create_service(SetBool, f'~/doors/{name}', partial(self._command, name))

    def _command(self, name: str, request: Any, response: Any) -> Any:
        with self._simulator.lock:
            door = self._simulator.world.doors[name]
            door.command(bool(request.data))
            response.success = not door.is_jammed
        response.message = f'{name} is jammed' if not response.success else ''
        return response


# Faults on command: the service ``set_fault`` for those of the table of faults (docs/reference/world_files.md).


class FaultService:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorParts) -> None:
        self._simulator = simulator
        simulator.runtime.node.create_service(SetFault, '~/set_fault', self._set)

    def _set(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            entity = request.entity or self._only_robot()
            if not request.clear:
                self._check(entity, request)
            with self._simulator.lock:
                if request.clear:
                    response.message = f'{self._simulator.world.clear_fault(entity, request.fault)} faults ended'
                else:
                    self._simulator.world.set_fault(
                        entity, request.fault, _mapping(request.parameters), request.after, request.duration
                    )
            response.success = True
            self._simulator.runtime.post(self._simulator.publish_faults)  # when the answer has left: a process may die
        except (FlexbtError, YamlError) as error:
            response.message = str(error)
        return response

    def _check(self, entity: str, request: Any) -> None:
        """Check that a fault of a server is possible, and that a node carries it out. The world checks the rest."""
        parameters = fault_parameters(request.fault, _mapping(request.parameters))
        if isinstance(parameters, ServerFault) and entity in self._simulator.world.robots:
            check_fault(parameters)
            if not self._simulator.has_navigation(entity):
                raise SimulationError(
                    f"{request.fault}: nobody carries it out: '{entity}' has no node {names.NAVIGATION} of flexbt_sim "
                    '(other navigation servers know no faults on command)'
                )

    def _only_robot(self) -> str:
        robots = list(self._simulator.world.robots)
        if len(robots) != 1:
            raise SimulationError(f'no entity is named, and there are {len(robots)} robots; name one of the world')
        return robots[0]


def _mapping(text: str) -> Mapping[str, Any]:
    value = load_yaml(text) if text.strip() else {}
    if not isinstance(value, Mapping):
        raise SimulationError(f'parameters are a mapping, such as {{side: left}}, not {short_repr(text)}')
    if any(isinstance(one, float) and not math.isfinite(one) for one in value.values()):
        raise SimulationError('parameters have numbers that are none')
    return value
