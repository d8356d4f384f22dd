# SPDX-License-Identifier: BSD-3-Clause
"""Obstacles in a simulated world, by the standard services of simulators (simulation_interfaces)."""

from __future__ import annotations

import math
import time
from typing import Any, Final

from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.errors import NoAnswerError, RefusedError

RADIUS: Final = 0.2
"""Metres of an obstacle that is dropped."""

_SPAWN: Final = 'simulation_interfaces/srv/SpawnEntity'
_LOOK_SECONDS: Final = 2.0


class SimulatorLink:
    """A client that drops obstacles into the world of the simulator in the network, whatever its name is."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._links = ServiceLinks(runtime)
        self._found = ''
        self._look_at = -math.inf
        self._dropped: dict[str, tuple[float, float, float]] = {}

    @property
    def dropped(self) -> tuple[tuple[str, float, float, float], ...]:
        """Obstacles that were dropped here: name, centre (m) and radius (m) of each. None while the simulator is
        gone."""
        return tuple((name, *where) for name, where in list(self._dropped.items())) if self._found else ()

    def is_possible(self) -> bool:
        """Return whether a simulator was found, as of at most some seconds ago. From any thread."""
        now = time.monotonic()
        if now >= self._look_at:
            self._look_at = now + _LOOK_SECONDS
            self._runtime.post(self._look)
        return bool(self._found)

    def drop(self, x: float, y: float, timeout: float) -> str:
        """Put an obstacle at a point (m); return its name. Not on the executor thread.

        Raises:
            RefusedError: the simulator refuses it, e.g. because the space is occupied.
            NoAnswerError: the simulator does not answer within ``timeout`` seconds.
        """
        from simulation_interfaces.srv import SpawnEntity  # what only a simulation needs

        request = SpawnEntity.Request(name='dropped', allow_renaming=True)
        request.resource_string = f'obstacles: {{dropped: {{pose: [{x:.3f}, {y:.3f}, 0], shape: {RADIUS}}}}}'
        name = str(self._answer(SpawnEntity, 'spawn_entity', request, timeout).entity_name)
        self._dropped[name] = x, y, RADIUS
        return name

    def remove(self, name: str, timeout: float) -> None:
        """Remove an obstacle that was dropped here. Raises as :meth:`drop`."""
        from simulation_interfaces.msg import Result
        from simulation_interfaces.srv import DeleteEntity

        if name not in self._dropped:
            raise RefusedError(f'no obstacle {name!r} was dropped here')
        request = DeleteEntity.Request(entity=name)
        self._answer(DeleteEntity, 'delete_entity', request, timeout, Result.RESULT_NOT_FOUND)
        self._dropped.pop(name, None)

    def _answer(self, type: Any, name: str, request: Any, timeout: float, *accepted: int) -> Any:
        if not self._found:
            raise RefusedError('there is no simulator that serves simulation_interfaces')
        link = self._links.link(type, f'{self._found.rpartition("/")[0]}/{name}')
        outcome = service_outcome(link, request, timeout)
        if outcome.response is None:
            raise NoAnswerError(outcome.reason)
        result = outcome.response.result
        if result.result not in (result.RESULT_OK, *accepted):
            raise RefusedError(f'the simulator refuses: {result.error_message}')
        return outcome.response

    def _look(self) -> None:
        node = self._runtime.node
        known = [name for name, types in node.get_service_names_and_types() if _SPAWN in types]  # with our own client
        self._found = next((name for name in known if node.count_services(name) > 0), '')
