# SPDX-License-Identifier: BSD-3-Clause
"""The costmaps of the robot: the global one, on which plans are made, and the local one, on which it drives.

Both are made of the map, what the lidar sees, and inflation. Nav2's topics show them, and its services clear them.
Their parameters have Nav2's names. The keepout filter finds the mask of areas to keep out of.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy
from geometry_msgs.msg import Point32, PolygonStamped
from geometry_msgs.msg import Polygon as PolygonMessage
from nav2_msgs import srv
from nav2_msgs.msg import Costmap as CostmapMessage
from nav2_msgs.msg import CostmapFilterInfo
from nav2_msgs.srv import (
    ClearCostmapAroundPose,
    ClearCostmapAroundRobot,
    ClearCostmapExceptRegion,
    ClearEntireCostmap,
    GetCostmap,
)
from nav_msgs.msg import OccupancyGrid
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.errors import TransformError, UnfitParameterError
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, Received
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_common.transform_buffer import TransformBuffer
from flexbt_common.transform_listener import take_transforms
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_core.values.json_data import load_json
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_navigation.common.demand import Demand
from flexbt_navigation.common.requests import MapFrame, RobotParameters, asked_pose, bounded, check_frame, set_success
from flexbt_navigation.errors import NavigationError
from flexbt_sim.errors import SimulationError
from flexbt_sim.messages import grid_info, map_of
from flexbt_sim.world.plane.geometry import Circle, Polygon, Pose, compose, drive, wrap
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .costmap import LETHAL, CellBox, Costmap, Inflation
from .layers import KNOWN_TOLERANCE, MOST_TOLERANCE, LayeredCostmap, Observation, local_size

MOST_RADIUS: Final = 50.0
"""Maximum radius of a robot, m, as in a world file."""


@dataclass(frozen=True)
class CostmapParameters:
    """Parameters of the costmaps."""

    inflation: Inflation
    filter_info_topic: str = parameter(
        'filter_info_topic',
        names.KEEPOUT_FILTER_INFO,
        'topic that names the mask of areas to keep out of, nav2_msgs/CostmapFilterInfo',
    )
    scan_topic: str = parameter('scan_topic', names.SCAN, 'topic of the lidar, sensor_msgs/LaserScan')
    tolerance: float = parameter(
        'known_obstacle_tolerance',
        KNOWN_TOLERANCE,
        'how near to a wall of the map what the lidar sees is the wall, m: five standard deviations of its noise',
        0.0,
        MOST_TOLERANCE,
    )


def declare_inflation(declare: ParameterDeclarer, inflation: Inflation) -> Inflation:
    """Declare the parameters of the footprint and the inflation. ``inflation`` has the defaults for the robot.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    return _inflation(
        declare.text(
            'footprint', _written(inflation.corners), 'corners of a robot that is not a circle, m: [[x, y], ...]'
        ),
        declare.real('robot_radius', inflation.robot_radius, 0.001, MOST_RADIUS, 'radius of the robot, m'),
        declare.real('inflation_radius', inflation.radius, 0.0, 10.0, 'how far costs reach round obstacles, m'),
        declare.real('cost_scaling_factor', inflation.scaling, 0.1, 100.0, 'how fast costs fall off, 1/m'),
    )


def _written(corners: Collection[tuple[float, float]]) -> str:
    return json.dumps([[x, y] for x, y in corners]) if corners else ''


def _inflation(corners: str, radius: float, *fall: float) -> Inflation:
    """For the footprint of the parameters ``footprint`` and ``robot_radius``. Raises UnfitParameterError."""
    try:
        polygon = tuple((float(x), float(y)) for x, y in load_json(corners)) if corners else ()
        return Inflation.of(Polygon(polygon) if polygon else Circle(radius), *fall)
    except (ValueError, TypeError, OverflowError, RecursionError, SimulationError) as error:
        raise UnfitParameterError('footprint', f'{short_repr(corners)}: {error}; give [[x, y], ...] in m') from None


GLOBAL, LOCAL = names.COSTMAPS
PERIODS: Final = {GLOBAL: 1.0, LOCAL: 0.2}
"""Time from update to update, s: Nav2's update_frequency of 1 and 5 Hz."""

MOST_RESET_DISTANCE: Final = 1e6
POSES: Final = 200
"""Poses that are kept: what a lidar saw is placed by the pose at that time."""

SCANS: Final = 50
"""Scans that wait for a pose at least as new: as many as in a message filter of Nav2."""

GREATEST_STEP: Final = 0.5
"""Farther than this, m, from the pose before, and from where the robot would be at its last velocity, a pose is not on
one way with it: the robot was put somewhere else."""

LIDAR_FRAME_SECONDS: Final = 5.0
"""Time that the frame of a lidar may arrive after its scans without a warning, s."""

_SHOWN: Final = numpy.array([0, *(1 + 97 * (cost - 1) // 251 for cost in range(1, 253)), 99, 100, -1], numpy.int8)
"""The occupancy that shows a cost, as Nav2 shows it: 99 for inscribed, 100 for lethal, -1 for unknown."""


@dataclass
class _Kept:
    """A costmap, with what is known of its updates. ``shared`` is a copy for other threads, after this many changes."""

    layers: LayeredCostmap
    updated: float = -math.inf
    shared: tuple[int, Costmap] | None = None


class CostmapServer:
    """On the executor thread."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: CostmapParameters,
        robot: RobotParameters,
        map_frame: MapFrame,
        robot_pose: Callable[[], Pose],
        demand: Demand,
    ) -> None:
        """``robot_pose()`` returns the pose of the robot, or raises NavigationError."""
        self._demand = demand
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._map_frame = map_frame
        self._robot_pose = robot_pose
        self._kept: dict[str, _Kept] = {}
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=POSES)
        self._velocity = (0.0, 0.0)
        """From the last pose but one to the last one, m/s in the map."""
        self._scans: deque[LaserScan] = deque(maxlen=SCANS)
        self._unplaced_since = math.inf
        self._observation: tuple[float, Observation, Pose] | None = None
        self._frames = TransformBuffer()
        node = runtime.node
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        demand.subscribe(LaserScan, parameters.scan_topic, newest, self._receive_scan)
        demand.reasons.append(self._is_shown)
        node.create_subscription(TFMessage, names.TF_STATIC, self._receive_frames, names.transient_local_qos(100))
        self._publishers: dict[str, tuple[Any, ...]] = {}
        for name, entirely in ((GLOBAL, names.CLEAR_GLOBAL_COSTMAP), (LOCAL, names.CLEAR_LOCAL_COSTMAP)):
            shown, raw, footprint = names.costmap_topics(name)
            self._publishers[name] = (
                node.create_publisher(OccupancyGrid, shown, names.transient_local_qos()),
                node.create_publisher(CostmapMessage, raw, names.transient_local_qos()),
                node.create_publisher(PolygonStamped, footprint, 1),
            )
            except_region, around_robot, around_pose, get, get_cost = names.costmap_services(name)
            node.create_service(
                ClearEntireCostmap, entirely, partial(self._clear, name, lambda _request, layers: layers.clear())
            )
            clears = {
                ClearCostmapExceptRegion: partial(self._clear, name, self._clear_except),
                ClearCostmapAroundRobot: partial(self._clear, name, self._clear_around_robot),
                ClearCostmapAroundPose: partial(self._clear_around_pose, name),
            }
            for services in [(except_region, around_robot, around_pose), *([names.COMMANDER_CLEARS] * (name == LOCAL))]:
                for service, (service_type, clear) in zip(services, clears.items(), strict=True):
                    node.create_service(service_type, service, clear)
            node.create_service(GetCostmap, get, partial(self._get, name))
            if hasattr(srv, 'GetCosts'):  # as in main
                node.create_service(srv.GetCosts, get_cost, partial(self._get_costs, name))
            else:
                node.create_service(srv.GetCost, get_cost, partial(self._get_cost, name))

    # -- for the other servers ---------------------------------------------------------------------------------------

    @property
    def local(self) -> Costmap:
        """The local costmap, which follows what is seen: for the executor thread only.

        Raises:
            NavigationError: UNKNOWN while no map is loaded.
        """
        return self._known(LOCAL).layers.costmap

    @property
    def shared(self) -> Costmap:
        """The global costmap as it is now, for any thread. Raises as :attr:`local`."""
        kept = self._known(GLOBAL)
        self._update(GLOBAL, kept)
        if kept.shared is None or kept.shared[0] != kept.layers.changes:
            kept.shared = kept.layers.changes, kept.layers.costmap.copy()
        return kept.shared[1]

    def _known(self, name: str) -> _Kept:
        self._demand.take()
        try:
            return self._kept[name]
        except KeyError:
            raise NavigationError('UNKNOWN', f'there is no map: nothing on {self._robot.map_topic}') from None

    # -- what comes in -----------------------------------------------------------------------------------------------

    def set_map(self, world: OccupancyMap) -> None:
        """Use a new map. Keep what was seen; if the new grid is another one, only the newest scan."""
        static = Costmap(world, self._parameters.inflation)
        before = self._kept
        # The local one keeps obstacles in a square around the robot: a rolling window as in Nav2.
        windows = {GLOBAL: math.inf, LOCAL: local_size(static.inflation)}
        tolerance = self._parameters.tolerance
        self._kept = {name: _Kept(LayeredCostmap(static, windows[name], tolerance)) for name in names.COSTMAPS}
        for name, kept in before.items():
            self._kept[name].layers.continue_from(kept.layers)
        for name in names.COSTMAPS:
            self._publish(name)

    def add_pose(self, time: float, pose: Pose) -> None:
        """Record the pose of the robot at a time, s."""
        if self._poses:
            (before, last), (x, y) = self._poses[-1], self._velocity
            passed = time - before
            expected = last._replace(x=last.x + x * passed, y=last.y + y * passed)
            if passed <= 0.0 or min(pose.distance(last), pose.distance(expected)) > GREATEST_STEP:
                self._poses.clear()
            if passed > 0.0:
                self._velocity = (pose.x - last.x) / passed, (pose.y - last.y) / passed
        self._poses.append((time, pose))
        self._observe()

    def _receive_scan(self, received: Received) -> None:
        try:
            scan = received.unpack(LaserScan)
            check_limits(scan)
            numbers = (scan.angle_min, scan.angle_increment, scan.range_max)
            if math.isnan(sum(numbers)) or not all(map(math.isfinite, numbers[:2])):
                raise NavigationError('UNKNOWN', f'a scan with angles or a range that are not numbers: {numbers}')
        except (FlexbtError, ValueError) as error:
            self._complain(error)
            return
        if self._scans and seconds_of(scan.header.stamp) <= seconds_of(self._scans[-1].header.stamp):
            self._scans.clear()  # time was set back
        self._take_due()  # a scan that waits for the frame of the lidar: the new one takes its place
        self._scans.append(scan)
        self._observe()

    def _receive_frames(self, message: TFMessage) -> None:
        try:
            check_limits(message)
            take_transforms(self._frames, message, is_static=True)
        except FlexbtError as error:
            self._complain(error)
        self._observe()

    def _complain(self, error: FlexbtError | ValueError) -> None:
        self._runtime.node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)

    def _take_due(self) -> LaserScan | None:
        """Take the newest scan that a pose at least as new is known for, if any."""
        scan, newest = None, self._poses[-1][0] if self._kept and self._poses else -math.inf
        while self._scans and seconds_of(self._scans[0].header.stamp) <= newest:
            scan = self._scans.popleft()
        return scan

    def _observe(self) -> None:
        """Add the newest scan for which the frame of the lidar and a pose at least as new are known: they arrive on
        different topics."""
        scan = self._take_due()
        if scan is None:
            return
        time = seconds_of(scan.header.stamp)
        after = bisect_left(self._poses, time, key=lambda known: known[0])
        if after == 0 and self._poses[0][0] > time:
            return  # the scan is from before the robot was put there
        robot = _between(self._poses[max(0, after - 1)], self._poses[after], time)
        try:
            mounted, side = self._mounted(scan.header.frame_id)
        except TransformError as error:
            now = self._runtime.steady.now()
            self._unplaced_since = min(self._unplaced_since, now)
            if error.is_early and now - self._unplaced_since < LIDAR_FRAME_SECONDS:
                self._scans.appendleft(scan)
            else:
                self._complain(error)
            return
        self._unplaced_since = math.inf
        ranges = numpy.array(scan.ranges, numpy.float64)
        ranges[(ranges < scan.range_min) | (numpy.isfinite(ranges) & (ranges > scan.range_max))] = math.nan
        angles = side * (scan.angle_min + scan.angle_increment * numpy.arange(len(ranges)))
        observation = Observation(compose(robot, mounted), angles, ranges, float(scan.range_max))
        self._observation = (time, observation, robot)
        for name, kept in self._kept.items():
            if not 0.0 <= time - kept.updated < PERIODS[name] - 0.01:
                self._update(name, kept)
                self._publish(name)

    def _mounted(self, frame: str) -> tuple[Pose, float]:
        """Return where a lidar is on the robot, and -1 if it hangs upside down, else 1. Raises TransformError."""
        base = self._robot.base_frame
        if frame in ('', base):
            return Pose(0.0, 0.0, 0.0), 1.0
        (x, y, _), (i, j, k, w) = self._frames.lookup(base, frame)
        ahead = math.atan2(2.0 * (w * k + i * j), w * w + i * i - j * j - k * k)
        return Pose(x, y, ahead), math.copysign(1.0, w * w + k * k - i * i - j * j)

    def _update(self, name: str, kept: _Kept) -> None:
        if self._observation is not None and self._observation[0] != kept.updated:
            kept.updated, observation, robot = self._observation
            kept.layers.observe(observation, robot)

    # -- what goes out -----------------------------------------------------------------------------------------------

    def _is_shown(self) -> bool:
        return any(shown.get_subscription_count() for publishers in self._publishers.values() for shown in publishers)

    def _publish(self, name: str) -> None:
        """Publish for current subscribers. A later subscriber gets the last message."""
        shown, raw, footprint = self._publishers[name]
        if shown.get_subscription_count():
            box, info = self._shown_part(name)
            grid = OccupancyGrid(info=info, header=self._header())
            grid.data.frombytes(_SHOWN.take(self._kept[name].layers.costmap.costs[box.cells]).tobytes())
            shown.publish(grid)
        if raw.get_subscription_count():
            raw.publish(self._message(name))
        if self._poses and footprint.get_subscription_count():
            footprint.publish(self._footprint(self._poses[-1][1]))

    def _header(self) -> Header:
        return Header(frame_id=self._robot.map_frame, stamp=self._runtime.clock.stamp())

    def _part(self, name: str) -> CellBox:
        """Return the cells that are part of a costmap as others see it: of the local one those in the window."""
        layers = self._kept[name].layers
        world = layers.costmap.world
        if name == LOCAL and self._poses:
            return layers.window(self._poses[-1][1])
        return CellBox(0, world.height, 0, world.width)

    def _shown_part(self, name: str) -> tuple[CellBox, Any]:
        box, world = self._part(name), self._kept[name].layers.costmap.world
        corner = Pose(*world.point(box.bottom - 0.5, box.left - 0.5), world.origin.yaw)
        size = (box.right - box.left, box.top - box.bottom)
        return box, grid_info(corner, world.resolution, size, self._runtime.clock.stamp())

    def _message(self, name: str) -> CostmapMessage:
        box, info = self._shown_part(name)
        message = CostmapMessage(header=self._header())
        meta = message.metadata
        meta.map_load_time = meta.update_time = info.map_load_time
        meta.layer, meta.resolution, meta.origin = 'master', info.resolution, info.origin
        meta.size_x, meta.size_y = info.width, info.height
        message.data.frombytes(self._kept[name].layers.costmap.costs[box.cells].tobytes())
        return message

    def _footprint(self, pose: Pose) -> PolygonStamped:
        """Return a circle as Nav2 shows it: a polygon of 16 corners."""
        inflation = self._parameters.inflation
        circle = [drive(Pose(0.0, 0.0, math.tau * n / 16.0), inflation.robot_radius, 0.0, 1.0)[:2] for n in range(16)]
        corners = [
            Point32(x=corner.x, y=corner.y)
            for corner in (compose(pose, Pose(x, y, 0.0)) for x, y in inflation.corners or circle)
        ]
        return PolygonStamped(header=self._header(), polygon=PolygonMessage(points=corners))

    # -- services ----------------------------------------------------------------------------------------------------

    def _clear(self, name: str, clear: Callable[[Any, LayeredCostmap], None], request: Any, response: Any) -> Any:
        """Jazzy's services return no error: problems are logged."""
        try:
            check_limits(request)
            clear(request, self._known(name).layers)
        except FlexbtError as error:
            self._not_cleared(name, error)
        else:
            set_success(response)
            self._publish(name)
        return response

    def _not_cleared(self, name: str, error: FlexbtError) -> None:
        self._runtime.node.get_logger().error(
            f'{name} is not cleared: {error}', throttle_duration_sec=COMPLAINT_SECONDS
        )

    def _clear_except(self, request: Any, layers: LayeredCostmap) -> None:
        layers.clear_except_square(self._robot_pose(), _distance(request))

    def _clear_around_robot(self, request: Any, layers: LayeredCostmap) -> None:
        layers.clear_square(self._robot_pose(), _distance(request))

    async def _clear_around_pose(self, name: str, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            (pose,) = await self._map_frame.known([asked_pose(request.pose, 'the pose', 'INVALID_INPUT')])
        except FlexbtError as error:
            self._not_cleared(name, error)
            return response
        return self._clear(
            name, lambda request, layers: layers.clear_square(pose, _distance(request)), request, response
        )

    def _get(self, name: str, _request: Any, response: Any) -> Any:
        self._demand.take()
        if name in self._kept:
            response.map = self._message(name)
        return response

    def _get_cost(self, name: str, request: Any, response: Any) -> Any:
        """Return the cost as Nav2 jazzy does: -1 outside the costmap."""
        pose = Pose(request.x, request.y, request.theta)
        cost = self._cost_of(name, pose, use_footprint=request.use_footprint) if pose.is_place else None
        response.cost = -1.0 if cost is None else cost
        return response

    async def _get_costs(self, name: str, request: Any, response: Any) -> Any:
        """Return the costs as Nav2 main does: lethal outside the costmap, without success."""
        try:
            check_limits(request)
            poses = await self._map_frame.known([asked_pose(one, 'a pose', 'INVALID_INPUT') for one in request.poses])
        except FlexbtError as error:
            self._runtime.node.get_logger().error(
                f'no costs of {name}: {error}', throttle_duration_sec=COMPLAINT_SECONDS
            )
            return response
        costs = [self._cost_of(name, pose, use_footprint=request.use_footprint) for pose in poses]
        response.costs = [float(LETHAL) if cost is None else cost for cost in costs]
        response.success = None not in costs
        return response

    def _cost_of(self, name: str, pose: Pose, *, use_footprint: bool) -> float | None:
        """None beside the costmap; the footprint has the greatest cost on its outline, and is lethal there."""
        self._demand.take()
        if name not in self._kept:
            return None
        box, costmap = self._part(name), self._kept[name].layers.costmap

        def cost_at(x: float, y: float) -> float | None:
            row, column = costmap.world.cell(x, y)
            is_inside = box.bottom <= row < box.top and box.left <= column < box.right
            return float(costmap.costs[row, column]) if is_inside else None

        if not use_footprint:
            return cost_at(pose.x, pose.y)
        corners = [(corner.x, corner.y) for corner in self._footprint(pose).polygon.points]
        costs = [
            cost_at(*place)
            for start, end in pairwise([*corners, corners[0]])
            for place in numpy.linspace(
                start, end, 1 + math.ceil(2.0 * math.dist(start, end) / costmap.world.resolution)
            )
        ]
        return float(max(LETHAL if cost is None else cost for cost in costs))


def _distance(request: Any) -> float:
    return abs(bounded(request.reset_distance, 'reset_distance', MOST_RESET_DISTANCE))


def _between(before: tuple[float, Pose], after: tuple[float, Pose], time: float) -> Pose:
    """Return where the robot was between two poses."""
    share = (time - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 1.0
    a, b = before[1], after[1]
    return Pose(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), wrap(a.yaw + share * wrap(b.yaw - a.yaw)))


# The mask of areas to keep out of, found as Nav2's KeepoutFilter finds it: a CostmapFilterInfo names its topic.

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
            CostmapFilterInfo, parameters.filter_info_topic, self._receive_info, names.transient_local_qos()
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
                OccupancyGrid, info.filter_mask_topic, self._receive_mask, names.transient_local_qos()
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
            check_frame(grid.header.frame_id, self._map_frame, f'the mask {short_repr(self._topic)}')
            mask = map_of(grid)
        except FlexbtError as error:
            self._complain(error)
            return
        self._on_mask(mask)

    def _complain(self, error: Exception) -> None:
        self._node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
