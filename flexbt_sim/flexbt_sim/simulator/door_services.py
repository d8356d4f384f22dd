# SPDX-License-Identifier: BSD-3-Clause
"""Doors by command: ``simulator/doors/NAME`` (std_srvs/SetBool) for each door of the world; true opens it."""

from __future__ import annotations

from functools import partial
from typing import Any

from std_srvs.srv import SetBool

from .node_parts import SimulatorParts


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
