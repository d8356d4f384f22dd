# SPDX-License-Identifier: BSD-3-Clause
"""The services of doors and of faults, and the no-go zones for navigation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from nav2_msgs.msg import CostmapFilterInfo
from nav_msgs.msg import OccupancyGrid
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import time_message
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError
from flexbt_sim.messages import check_fault, grid_message
from flexbt_sim.world.descriptions.faults import ServerFault, fault_parameters
from flexbt_sim.world.plane.geometry import Pose, Shape
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .core import SimulatorCore

# Doors by command: ``simulator/doors/NAME`` (std_srvs/SetBool) for each door of the world; true opens it.


class DoorServices:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorCore) -> None:
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

    def __init__(self, simulator: SimulatorCore) -> None:
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


# The no-go zones, published as Nav2's map_server and costmap_filter_info_server publish the mask of a KeepoutFilter.


class KeepoutServer:
    """The no-go zones as a mask, in the namespace of each robot: as soon as there are any. On the executor thread."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        self._publishers: dict[str, tuple[Any, Any]] = {}
        self._told: tuple[OccupancyMap | None, tuple[tuple[Shape, Pose], ...]] = None, ()

    def update(self) -> None:
        """Tell of the zones as they are now; robots that have come, too."""
        world, no_go = self._simulator.world.map, self._simulator.world.no_go
        node, there = self._simulator.runtime.node, set(self._simulator.namespaces)
        for namespace in self._publishers.keys() - there:
            for publisher in self._publishers.pop(namespace):
                node.destroy_publisher(publisher)
        is_news = self._told[0] is not world or self._told[1] != no_go
        to_tell = there if is_news else there - self._publishers.keys()
        self._told = world, no_go
        if world is None or not to_tell or not (no_go or self._publishers):
            return
        mask = grid_message(world.mask(no_go), self._simulator.parameters.map_frame, time_message(0.0))
        for namespace in to_tell:
            if namespace not in self._publishers:
                self._publishers[namespace] = (
                    node.create_publisher(
                        OccupancyGrid, f'{namespace}{names.KEEPOUT_FILTER_MASK}', names.transient_local_qos()
                    ),
                    node.create_publisher(
                        CostmapFilterInfo, f'{namespace}{names.KEEPOUT_FILTER_INFO}', names.transient_local_qos()
                    ),
                )
            masks, infos = self._publishers[namespace]
            masks.publish(mask)
            infos.publish(CostmapFilterInfo(header=mask.header, filter_mask_topic=masks.topic_name, multiplier=1.0))
