# SPDX-License-Identifier: BSD-3-Clause
"""The data that a screen shows in addition to the executive: trees of the BT server, map, plan and scan; into the
mirror.

A console that only sends commands does not need them: they are several times the data of the operator link.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final

from rclpy.event_handler import SubscriptionEventCallbacks

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.middleware.received_messages import Received, ReceivedMessages, endpoint_of, writer_name
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.pace import Pace
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import yaw_of_quaternion
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import OCCUPIED, GridMap
from flexbt_core.values.text import one_line
from flexbt_msgs.msg import RobotPlan, TreeStatus, TreeStructure

from .messages import is_length, record_of
from .scan_link import REPORT_CHARACTERS, ScanLink

MAP_FRAME: Final = 'map'
"""Frame as long as no map has arrived (REP 105)."""

MOST_CELLS: Final = 16_000_000
"""Cells of a map at most, which is 4,000 in a row and as many rows."""

MOST_RESOLUTION: Final = 100.0
"""Maximum size of a cell, m."""

MOST_TREE_NODES: Final = 5_000
"""Nodes of a tree that are kept; the number of further ones is reported to the operator."""

MESSAGE_BYTES: Final = 32_000_000
STATUS_DEPTH: Final = 16
REPORT_SECONDS: Final = 10.0

_SERVERS: Final = 16
"""Maximum number of writers of trees whose nodes are remembered."""


class SurroundingsLink:
    """A link that feeds a mirror with trees, map, plan and scan of a robot; ``namespace`` defaults to the node's own.

    With a ``scan_period`` of 0 s there is no scan, and neither scans nor transforms come over the link. Trees, map and
    plan take a quarter of the executor's time at most, whatever is sent: the picture of the executive comes first.
    """

    def __init__(self, runtime: NodeRuntime, mirror: Mirror, namespace: str = '', scan_period: float = 0.0) -> None:
        self._runtime = runtime
        self._node = runtime.node
        self._mirror = mirror
        self._namespace = namespace
        self._scan_period = scan_period
        self._pace = Pace(runtime)
        self._subscriptions: list[Any] = []
        self._servers: OrderedDict[bytes, str] = OrderedDict()  # the node of each writer of trees
        self._left: set[bytes] = set()  # those writers that have left
        self._scan: ScanLink | None = None
        try:
            runtime.call(self._join)
        except TimeoutError:
            runtime.post(self._leave)  # it may be done later
            raise

    def close(self) -> None:
        """Stop listening."""
        self._runtime.call(self._leave)

    def _leave(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        if self._scan is not None:
            self._scan.close()

    def _join(self) -> None:
        from nav_msgs.msg import OccupancyGrid  # what only a screen needs

        feed = SurroundingsFeed(self._mirror)
        for type, topic, qos in (
            (TreeStructure, names.TREE_STRUCTURE, names.transient_local_qos(STATUS_DEPTH)),
            (TreeStatus, names.TREE_STATUS, names.transient_local_qos(STATUS_DEPTH)),
            (OccupancyGrid, names.MAP, names.transient_local_qos()),
            (RobotPlan, names.EXECUTIVE_PLAN, names.transient_local_qos()),
        ):
            name = names.of_robot(self._namespace, topic)
            read = self._reader(type, name, feed.receivers[topic])
            messages = ReceivedMessages(
                self._node,
                type,
                name,
                qos,
                read,
                MESSAGE_BYTES,
                event_callbacks=SubscriptionEventCallbacks(matched=self._trees_matched) if type is TreeStatus else None,
                is_awaited=self._pace.is_over,
            )
            self._subscriptions.append(messages.subscription)
        if self._scan_period > 0.0:
            self._scan = ScanLink(
                self._runtime, self._mirror, self._namespace, self._scan_period, lambda: feed.map_frame
            )

    def _reader(self, type: Any, topic: str, receive: Any) -> Any:
        def read(received: Received) -> None:
            try:
                with self._pace.work():
                    told_by = (self._server(topic, received.writer),) if type is TreeStatus else ()
                    receive(received.unpack(type), *told_by)
                    if received.writer in self._left:  # the message had waited: its server is not back
                        self._tell_departure(self._publishers())
            except (ValueError, LimitExceededError) as error:
                text = f'{topic}: ignored: {one_line(str(error), REPORT_CHARACTERS)}'
                self._node.get_logger().error(text, throttle_duration_sec=REPORT_SECONDS)

        return read

    def _server(self, topic: str, writer: bytes) -> str:
        """Return the node of a writer that publishes trees; '' while it is not known."""
        if writer not in self._servers:
            name = writer_name(self._node, topic, writer)
            if not name.startswith('/'):
                return ''
            self._servers[writer] = name
            if len(self._servers) > _SERVERS:
                self._servers.popitem(last=False)
        return self._servers[writer]

    def _trees_matched(self, event: Any) -> None:
        if event.total_count_change > event.current_count_change:  # as many have come as have left, it may be
            self._tell_departure(self._publishers() if event.current_count > 0 else [])

    def _publishers(self) -> list[Any]:
        topic = names.of_robot(self._namespace, names.TREE_STATUS)
        return self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic))

    def _tell_departure(self, there: list[Any]) -> None:
        """Report to the mirror which publishers of trees are still there, and note which writers have left."""
        self._left = {writer for writer in self._servers if endpoint_of(there, writer) is None}
        self._mirror.tree_servers_left(set(map(names.node_of, there)))


class SurroundingsFeed:
    """Messages of trees, map and plan into a mirror, by the names of their topics.

    Each receiver raises ValueError for a message that is wrong, LimitExceededError for one with too much in it.
    """

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self.map_frame = MAP_FRAME
        """The frame of the map."""
        self.receivers: dict[str, Callable[..., None]] = {
            names.TREE_STRUCTURE: self._on_structure,
            names.TREE_STATUS: self._on_status,
            names.MAP: self._on_map,
            names.EXECUTIVE_PLAN: self._on_plan,
        }

    def _on_structure(self, message: Any) -> None:
        left_out = max(0, len(message.nodes) - MOST_TREE_NODES)
        del message.nodes[MOST_TREE_NODES:]
        check_limits(message)
        record = record_of(message, left_out=left_out)
        if [node.uid for node in record.nodes] != list(range(1, len(record.nodes) + 1)):
            raise ValueError(f'the nodes of tree {record.tree!r} are not in the order of their identifiers')
        if stray := next((node for node in record.nodes if node.parent >= node.uid), None):
            raise ValueError(
                f'node {stray.uid} of tree {record.tree!r} has the parent {stray.parent}, which does not come before it'
            )
        self._mirror.receive_tree_structure(record)

    def _on_status(self, message: Any, server: str = '') -> None:
        check_limits(message)
        del message.statuses[MOST_TREE_NODES:]
        self._mirror.receive_tree_status(record_of(message, server=server))

    def _on_map(self, message: Any) -> None:
        check_limits(message.header)  # a console takes more cells than a robot does
        info = message.info
        cells = message.data.tobytes()
        origin = info.origin.position
        yaw = yaw_of_quaternion(info.origin.orientation)
        is_somewhere = is_length(origin.x) and is_length(origin.y) and math.isfinite(yaw)
        is_somewhere = is_somewhere and 0.0 < info.resolution <= MOST_RESOLUTION
        if info.width * info.height != len(cells) or not 0 < len(cells) <= MOST_CELLS or not is_somewhere:
            raise ValueError(
                f'a map of {info.width} x {info.height} cells of {info.resolution:g} m from ({origin.x:g}, '
                f'{origin.y:g}) on, with {len(cells)} values; at most {MOST_CELLS} of at most {MOST_RESOLUTION:g} m '
                'are taken'
            )
        grid = upright(GridMap(info.width, info.height, info.resolution, origin.x, origin.y, cells), yaw)
        self.map_frame = message.header.frame_id or MAP_FRAME
        self._mirror.receive_map(grid)

    def _on_plan(self, message: Any) -> None:
        check_limits(message)
        if len(message.x) != len(message.y):
            raise ValueError(f'a plan with {len(message.x)} x and {len(message.y)} y')
        points = tuple(zip(message.x.tolist(), message.y.tolist(), strict=True))
        if not all(is_length(x) and is_length(y) for x, y in points):
            raise ValueError('a plan with a point that is nowhere')
        self._mirror.receive_plan(points, message.frame_id)


def upright(map: GridMap, yaw: float) -> GridMap:
    """Return a map whose rows are turned by ``yaw`` (rad) around its origin as one whose rows are along the x axis.

    Outside of the given map, it is unknown. Raises ValueError if it has too many cells.
    """
    width, height, step = map.width, map.height, map.resolution
    if abs(yaw) * math.hypot(width, height) < 0.5:
        return map  # no cell is turned by half of its size
    import numpy  # here, because few maps need it

    cos, sin = math.cos(yaw), math.sin(yaw)  # below, a length is in cells, and the origin is that of the map
    corners = [(cos * x - sin * y, sin * x + cos * y) for x in (0, width) for y in (0, height)]
    (left, right), (bottom, top) = (
        (math.floor(min(side)), math.ceil(max(side))) for side in zip(*corners, strict=True)
    )
    columns, rows = right - left, top - bottom
    if columns * rows > 2 * MOST_CELLS:
        raise ValueError(f'a map that is turned by {yaw:g} rad needs {columns} x {rows} cells')
    given = numpy.frombuffer(map.cells, numpy.uint8).reshape(height, width)
    cells = numpy.full((rows, columns), 255, numpy.uint8)
    x = left + 0.5 + numpy.arange(columns)
    block = max(1, 100_000 // columns)  # rows at once: a map may have a million of them
    for row in range(0, rows, block):
        y = bottom + 0.5 + numpy.arange(row, min(row + block, rows))[:, None]
        column, line = numpy.floor((cos * x + sin * y, cos * y - sin * x)).astype(int)
        inside = (column >= 0) & (column < width) & (line >= 0) & (line < height)
        cells[row : row + block][inside] = given[line[inside], column[inside]]
    line, column = numpy.nonzero((given >= OCCUPIED) & (given <= 100))  # a wall of one cell would have gaps
    x, y = column + 0.5, line + 0.5
    cells[(sin * x + cos * y - bottom).astype(int), (cos * x - sin * y - left).astype(int)] = given[line, column]
    return GridMap(columns, rows, step, map.x + left * step, map.y + bottom * step, cells.tobytes())
