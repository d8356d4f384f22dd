# SPDX-License-Identifier: BSD-3-Clause
"""Faults on command: the service ``set_fault`` for those of the table of faults (docs/reference/world_files.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexbt_common.values import check_limits, shown
from flexbt_core.errors import FlexbtError
from flexbt_core.values import YamlError, load_yaml
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError

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
            with self._simulator.lock:
                if request.clear:
                    response.message = f'{self._simulator.world.clear_fault(entity, request.fault)} faults ended'
                else:
                    self._simulator.world.set_fault(
                        entity, request.fault, _mapping(request.parameters), request.after, request.duration
                    )
            response.success = True
        except (FlexbtError, YamlError) as error:
            response.message = str(error)
        return response

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
