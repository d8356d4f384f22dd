# SPDX-License-Identifier: BSD-3-Clause
"""The mask of areas to keep out of, found as Nav2's KeepoutFilter finds it: a CostmapFilterInfo names its topic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from nav2_msgs.msg import CostmapFilterInfo
from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import InvalidTopicNameException

from flexbt_common import names
from flexbt_common.runtime import COMPLAINT_SECONDS, NodeRuntime
from flexbt_common.values import check_limits
from flexbt_core.errors import FlexbtError
from flexbt_core.values import shown
from flexbt_sim.errors import SimulationError
from flexbt_sim.ros_messages import map_of
from flexbt_sim.world import OccupancyMap

from .costmap_parameters import CostmapParameters
from .request_checks import check_frame

KEEPOUT: Final = 0
"""Type of a CostmapFilterInfo: keep-out zones and preferred lanes."""


class KeepoutFilter:
    """On the executor thread. ``on_mask`` gets each mask that comes."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: CostmapParameters,
        map_frame: str,
        on_mask: Callable[[OccupancyMap], None],
    ) -> None:
        self._node = runtime.node
        self._map_frame = map_frame
        self._on_mask = on_mask
        self._topic = ''
        self._masks: Any = None
        self._node.create_subscription(
            CostmapFilterInfo, parameters.filter_info_topic, self._receive_info, names.latched()
        )

    def _receive_info(self, info: CostmapFilterInfo) -> None:
        try:
            check_limits(info)
            if info.type != KEEPOUT:
                raise SimulationError(
                    f'a costmap filter of type {info.type}: of masks only those of keep-out zones count'
                )
            if info.filter_mask_topic == self._topic:
                return
            masks = self._node.create_subscription(
                OccupancyGrid, info.filter_mask_topic, self._receive_mask, names.latched()
            )
        except (FlexbtError, InvalidTopicNameException) as error:
            self._complain(error)
            return
        if self._masks is not None:
            self._node.destroy_subscription(self._masks)
        self._topic, self._masks = info.filter_mask_topic, masks

    def _receive_mask(self, grid: OccupancyGrid) -> None:
        try:
            check_limits(grid)
            check_frame(grid.header.frame_id, self._map_frame, f'the mask {shown(self._topic)}')
            mask = map_of(grid)
        except FlexbtError as error:
            self._complain(error)
            return
        self._on_mask(mask)

    def _complain(self, error: Exception) -> None:
        self._node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
