# SPDX-License-Identifier: BSD-3-Clause
"""Faults on command: the service ``set_fault`` for those of the table of faults (docs/reference/world_files.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexbt_common import names
from flexbt_common.values import check_limits
from flexbt_core.errors import FlexbtError
from flexbt_core.values import YamlError, load_yaml, shown
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError
from flexbt_sim.fault_messages import check_fault
from flexbt_sim.world import ServerFault, fault_parameters

from .node_parts import SimulatorParts


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
        """Whether a fault of a server can be carried out, and somebody does. The world checks the rest."""
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
        raise SimulationError(f'parameters are a mapping, such as {{side: left}}, not {shown(text)}')
    if any(isinstance(one, float) and not math.isfinite(one) for one in value.values()):
        raise SimulationError('parameters have numbers that are none')
    return value
