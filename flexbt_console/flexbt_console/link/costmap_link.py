# SPDX-License-Identifier: BSD-3-Clause
"""The link that receives the costmaps of navigation, while somebody looks at them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.pace import Pace
from flexbt_common.transform_buffer import Rigid, TransformBuffer
from flexbt_common.transform_listener import BROADCASTERS, take_transforms
from flexbt_common.values.limits import check_limits
from flexbt_console.mirror.records import GridMap
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import one_line

from .messages import is_length
from .scan_link import REPORT_CHARACTERS, TF_DEPTH
from .surroundings_link import MAP_FRAME, MESSAGE_BYTES, MOST_CELLS, MOST_RESOLUTION, REPORT_SECONDS

MOST_SHOWN: Final = 250_000
"""Maximum number of cells of a costmap that is shown. Cells of a larger one are combined: the highest cost counts."""

UNKNOWN: Final = 255


@dataclass(frozen=True, slots=True)
class Costmap(GridMap):
    """A costmap in the frame of the map, with the direction of its rows, rad. Cells: 0 to 98 cost, 99 inscribed, 100
    lethal, :data:`UNKNOWN`."""

    yaw: float


class CostmapLink:
    """A link that receives the costmaps of a robot until :meth:`close`; :attr:`newest` has those that have come. On the
    executor thread.

    A costmap in another frame than the map, such as ``odom``, is placed by the transforms. Receiving takes a quarter of
    the executor's time at most.
    """

    def __init__(self, runtime: NodeRuntime, namespace: str) -> None:
        self.newest: dict[str, Costmap] = {}
        """By the names of :data:`.names.COSTMAPS`. Replaced, never changed; to be read on any thread."""
        self._runtime = runtime
        self._namespace = namespace
        self._pace = Pace(runtime)
        self._frames = TransformBuffer()
        self._hears_frames = False
        self._map_frame = MAP_FRAME
        self._subscriptions: list[Any] = []
        self._join()

    def close(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            self._runtime.node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _join(self) -> None:
        from nav_msgs.msg import OccupancyGrid

        for name in names.COSTMAPS:
            topic = names.of_robot(self._namespace, names.costmap_topics(name)[0])
            self._hear(OccupancyGrid, topic, names.transient_local_qos(), partial(self._on_costmap, name))

    def _hear(self, type: Any, topic: str, qos: Any, receive: Any) -> None:
        def read(received: Received) -> None:
            try:
                with self._pace.work():
                    receive(received.unpack(type))
            except (ValueError, FlexbtError) as error:
                text = f'{topic}: ignored: {one_line(str(error), REPORT_CHARACTERS)}'
                self._runtime.node.get_logger().error(text, throttle_duration_sec=REPORT_SECONDS)

        messages = ReceivedMessages(
            self._runtime.node, type, topic, qos, read, MESSAGE_BYTES, is_awaited=self._pace.is_over
        )
        self._subscriptions.append(messages.subscription)

    def _hear_frames(self) -> None:
        from tf2_msgs.msg import TFMessage

        self._hears_frames = True
        for topic, is_static in ((names.TF_STATIC, True), (names.TF, False)):
            qos = names.transient_local_qos(BROADCASTERS) if is_static else names.best_effort_qos(TF_DEPTH)
            self._hear(
                TFMessage, names.of_robot(self._namespace, topic), qos, partial(self._on_frames, is_static=is_static)
            )

    def _on_frames(self, message: Any, *, is_static: bool) -> None:
        check_limits(message)
        take_transforms(self._frames, message, is_static=is_static)

    def _on_costmap(self, name: str, message: Any) -> None:
        """Take a costmap. Raises ValueError if it is wrong, TransformError if its place on the map is not known."""
        check_limits(message.header)
        info, frame, count = message.info, message.header.frame_id, len(message.data)
        origin, turned = info.origin.position, info.origin.orientation
        is_somewhere = is_length(origin.x) and is_length(origin.y) and 0.0 < info.resolution <= MOST_RESOLUTION
        if info.width * info.height != count or not 0 < count <= MOST_CELLS or not is_somewhere:
            extent = f'{info.width} x {info.height} cells of {info.resolution:g} m'
            raise ValueError(f'a costmap of {extent} with {count} values')
        if name == names.COSTMAPS[0]:
            self._map_frame = frame or self._map_frame  # the global one is in the frame of the map
        where = Rigid.of((origin.x, origin.y, 0.0), (turned.x, turned.y, turned.z, turned.w))
        if frame not in ('', self._map_frame):
            if not self._hears_frames:
                self._hear_frames()
                return  # another one comes, and then they are known
            where = self._frames.lookup(self._map_frame, frame) @ where
        factor = math.ceil(math.sqrt(count / MOST_SHOWN)) if count > MOST_SHOWN else 1
        cells = combined(numpy.frombuffer(message.data, numpy.uint8).reshape(info.height, info.width), factor)
        ahead = where.apply((1.0, 0.0, 0.0))
        yaw = math.atan2(ahead[1] - where.translation[1], ahead[0] - where.translation[0])
        size, corner = (cells.shape[1], cells.shape[0], info.resolution * factor), where.translation[:2]
        self.newest = {**self.newest, name: Costmap(*size, *corner, cells.tobytes(), yaw)}


def combined(cells: Any, factor: int) -> Any:
    """Return costs with squares of this many cells as one: the highest cost counts, unknown only if all of it is."""
    if factor == 1:
        return cells
    height, width = (-(-size // factor) * factor for size in cells.shape)
    known = numpy.full((height, width), -1, numpy.int16)
    known[: cells.shape[0], : cells.shape[1]] = numpy.where(cells == UNKNOWN, -1, cells.astype(numpy.int16))
    blocks = known.reshape(height // factor, factor, width // factor, factor).max(axis=(1, 3))
    return numpy.where(blocks < 0, UNKNOWN, blocks).astype(numpy.uint8)


class CostmapLinks:
    """The links of the robots whose costmaps are shown."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._links: dict[str, tuple[int, CostmapLink]] = {}

    def open(self, robot: str) -> CostmapLink:
        """Return the link of a robot, until :meth:`close` was called as often. Not on the executor thread.

        Raises TimeoutError for a busy node."""

        def open() -> CostmapLink:
            count, link = self._links.get(robot) or (0, CostmapLink(self._runtime, robot))
            self._links[robot] = count + 1, link
            return link

        return self._runtime.call(open)

    def close(self, robot: str) -> None:
        """See :meth:`open`."""

        def close() -> None:
            count, link = self._links.pop(robot)
            if count > 1:
                self._links[robot] = count - 1, link
            else:
                link.close()

        self._runtime.post(close)
