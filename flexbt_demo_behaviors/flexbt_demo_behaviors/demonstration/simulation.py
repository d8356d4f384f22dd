# SPDX-License-Identifier: BSD-3-Clause
"""Events in the simulated world while a demonstration runs, caused by the services of the simulator."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from simulation_interfaces.msg import Result
from simulation_interfaces.srv import DeleteEntity, SpawnEntity

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.srv import SetFault
from flexbt_sim.world import ObstacleModel, Pose, box

from .report import DemoError, Timeline
from .scripted_operator import ANSWER_TIMEOUT_S

REAL_TIME: Final = 1.0


@dataclass(frozen=True)
class SimulatedBox:
    """A box in the way: its middle and sides, in m, parallel to the axes of the map."""

    x: float
    y: float
    length: float
    width: float

    @property
    def model(self) -> ObstacleModel:
        """Description in a world."""
        return ObstacleModel(Pose(self.x, self.y, 0.0), box(self.length, self.width))

    @property
    def description(self) -> dict[str, Any]:
        """Description in a world file."""
        return {'pose': [self.x, self.y, 0.0], 'shape': [self.length, self.width]}


class DemoSimulation:
    """A client of the simulator whose calls wait until they have taken effect. Raises DemoError if they do not.

    ``speed`` is how many seconds of the simulated world pass in one second.
    """

    def __init__(self, runtime: NodeRuntime, timeline: Timeline, speed: float = REAL_TIME) -> None:
        self._runtime = runtime
        self._timeline = timeline
        self._speed = speed
        self._boxes: dict[str, SimulatedBox] = {}

    @property
    def boxes(self) -> Mapping[str, SimulatedBox]:
        """Boxes that were placed, by their names; removed ones, too."""
        return self._boxes

    def put(self, name: str, box: SimulatedBox) -> None:
        """Put a box in the way."""
        self._boxes[name] = box
        described = json.dumps({'obstacles': {name: box.description}})
        self._ask(SpawnEntity, 'spawn_entity', SpawnEntity.Request(name=name, resource_string=described))
        self._timeline.tell('world', f'somebody leaves the {name} at ({box.x:.2f}, {box.y:.2f})')

    def take_away(self, name: str) -> None:
        """Remove a box."""
        self._ask(DeleteEntity, 'delete_entity', DeleteEntity.Request(entity=name))
        self._timeline.tell('world', f'somebody takes the {name} away')

    def in_real_time(self) -> contextlib.AbstractContextManager[None]:
        """Keep the world no faster than real time in this context, so that a busy computer can intervene in time."""
        return self.no_faster_than(REAL_TIME)

    def set_fault(self, entity: str, fault: str, parameters: str = '', *, clear: bool = False) -> None:
        """Bring about a fault of an entity, or end it."""
        request = SetFault.Request(entity=entity, fault=fault, parameters=parameters, clear=clear)
        response = self.call(SetFault, 'set_fault', request)
        if not response.success:
            raise DemoError(f'the fault {fault} of {entity} was not {"ended" if clear else "set"}: {response.message}')

    @contextlib.contextmanager
    def no_faster_than(self, factor: float) -> Iterator[None]:
        """Limit the speed of the world in this context, in seconds of the world per second."""
        before = self._speed
        self._set_speed(min(before, factor))
        try:
            yield
        finally:
            self._set_speed(before)

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Return the response of a service of the simulator."""
        return call_service(self._runtime, service_type, f'{names.SIMULATOR}/{name}', request)

    def _ask(self, service_type: Any, name: str, request: Any) -> None:
        result = self.call(service_type, name, request).result
        if result.result != Result.RESULT_OK:
            raise DemoError(f'the service {name} of the simulator refuses: {result.error_message}')

    def _set_speed(self, factor: float) -> None:
        value = Parameter('speed_factor', value=factor).to_parameter_msg()
        response = self.call(SetParameters, 'set_parameters', SetParameters.Request(parameters=[value]))
        if not response.results[0].successful:
            raise DemoError(f'the speed of the simulator was not set: {response.results[0].reason}')
        self._speed = factor


def call_service(runtime: NodeRuntime, service_type: Any, name: str, request: Any) -> Any:
    """Return the response of a service. Raises DemoError when there is none in time."""
    links = runtime.call(lambda: runtime.once('links to services', ServiceLinks))
    outcome = service_outcome(links.link(service_type, name), request, ANSWER_TIMEOUT_S)
    if outcome.response is None:
        raise DemoError(f'the service {name}: {outcome.reason}')
    return outcome.response
