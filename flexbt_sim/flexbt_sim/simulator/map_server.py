# SPDX-License-Identifier: BSD-3-Clause
"""The map as Nav2's map_server provides it: a latched topic, and the services ``map_server/map`` and ``load_map``.

It is the robot's knowledge of the world, not the world: another map changes plans, but no wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

from nav2_msgs.srv import LoadMap
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap

from flexbt_common import names
from flexbt_common.files import resolve_file
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import time_message
from flexbt_core.errors import FlexbtError
from flexbt_sim.errors import MapImageError
from flexbt_sim.messages import grid_message
from flexbt_sim.world.plane.occupancy_map import OccupancyMap, load_map


class MapServer:
    """The map in one namespace. On the executor thread."""

    def __init__(
        self,
        runtime: NodeRuntime,
        namespace: str,
        frame: str,
        world: OccupancyMap | None,
        allowed_directories: Sequence[Path],
    ) -> None:
        """``world`` is None if there is no map. Then a service call must load one.

        The service loads maps from ``allowed_directories`` and from the shares of packages only.
        """
        node = self._node = runtime.node
        self._allowed = allowed_directories
        self._frame = frame
        self._grid: OccupancyGrid | None = None
        server = f'{namespace}{names.MAP_SERVER}'
        self._publisher = node.create_publisher(OccupancyGrid, f'{namespace}{names.MAP}', names.transient_local_qos())
        self._services = (
            node.create_service(GetMap, f'{server}/map', self._give),
            node.create_service(LoadMap, f'{server}/load_map', self._load),
        )
        self._part = LifecycleSubnode(runtime, server)
        if world is not None:
            self._publish(world)

    def restart(self, world: OccupancyMap | None) -> None:
        """Publish the map of a new world, unless it is the one that was published last."""
        if world is not None and grid_message(world, self._frame, time_message(0.0)) != self._grid:
            self._publish(world)

    def close(self) -> None:
        """Destroy the topic and the services."""
        self._part.close()
        for service in self._services:
            self._node.destroy_service(service)
        self._node.destroy_publisher(self._publisher)

    def _publish(self, world: OccupancyMap) -> OccupancyGrid:
        self._grid = grid_message(world, self._frame, time_message(0.0))
        self._publisher.publish(self._grid)
        return self._grid

    def _give(self, request: Any, response: Any) -> Any:
        if self._part.is_active and self._grid is not None:
            response.map = self._grid
        return response

    def _load(self, request: Any, response: Any) -> Any:
        response.result = LoadMap.Response.RESULT_UNDEFINED_FAILURE
        url = str(request.map_url)
        try:
            check_limits(request)
            if not self._part.is_active:
                raise FlexbtError(f'{names.MAP_SERVER} is not active')
            response.result = LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST
            file = resolve_file(unquote(urlparse(url).path) if url.startswith('file:') else url, self._allowed)
            response.result = LoadMap.Response.RESULT_INVALID_MAP_METADATA
            response.map = self._publish(load_map(file))
            response.result = LoadMap.Response.RESULT_SUCCESS
        except (FlexbtError, OSError, ValueError) as error:
            if isinstance(error, MapImageError):
                response.result = LoadMap.Response.RESULT_INVALID_MAP_DATA
            self._node.get_logger().error(f'load_map: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
        return response
