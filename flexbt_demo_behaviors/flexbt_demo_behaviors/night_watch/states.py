# SPDX-License-Identifier: BSD-3-Clause
"""The states of the night watch: choose a room, compare a scan, open a door, watch the partner."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceCall
from flexbt_common.files import resolve_file
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core import EventState, Outcome, Place, Predicate, Skill, UserData, load_places
from flexbt_onboard.behaviors.run_context import state_services
from flexbt_states.errors import StateParameterError
from flexbt_states.parameter_checks import checked_topic

ROOMS_LEFT = 'rooms_left'
"""Topic (std_msgs/String, latched) of the rooms that a robot has yet to look at, separated by spaces."""


class NextRoomState(EventState):
    """
    Choose the next room to check, and publish the rest of the round on the topic "rooms_left".

    -- rooms        string      Rooms of this robot, in the order of its round, separated by spaces
    -- places       string      File of the places, as package/path.yaml

    ># inherited    string[]    Rooms taken over from the partner
    ># checked      string[]    Rooms checked in this round
    ># postponed    string[]    Rooms to try again after all others

    #> room         string      The room
    #> goal         geometry_msgs/PoseStamped   Pose in the room from which the robot scans it
    #> entrance     geometry_msgs/PoseStamped   Pose at which the robot opens the door of the room, if there is one

    <= room                     The room has no door.
    <= door                     The room has a door: the file has a place ROOM_door.
    <= done                     All rooms are checked in this round.
    """

    is_instant = True

    def __init__(self, rooms: str, places: str) -> None:
        super().__init__(
            outcomes=['room', 'door', 'done'],
            input_keys=['inherited', 'checked', 'postponed'],
            output_keys=['room', 'goal', 'entrance'],
            desired_rate=None,
        )
        self._rooms = tuple(rooms.split())
        self._places = places_in(places)
        if not self._rooms:
            raise StateParameterError(self, 'rooms', 'there are none; give at least one')
        for room in self._rooms:
            if room not in self._places:
                raise StateParameterError(self, 'rooms', f'{room!r} is not a place of {places}')
        self._publisher: Publisher | None = None

    def on_start(self) -> None:
        runtime = state_services(self).runtime
        self._publisher = runtime.call(
            lambda: runtime.node.create_publisher(String, ROOMS_LEFT, names.transient_local_qos())
        )

    def execute(self, userdata: UserData) -> str:
        left = rooms_left([*self._rooms, *userdata.inherited], userdata.checked, userdata.postponed)
        assert self._publisher is not None
        self._publisher.publish(String(data=' '.join(left)))
        if not left:
            return 'done'
        room = left[0]
        entrance = self._places.get(f'{room}_door')
        userdata.room = room
        userdata.goal = pose_of(self._places[room])
        userdata.entrance = pose_of(entrance or self._places[room])
        return 'door' if entrance else 'room'

    def on_stop(self) -> None:
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_publisher(publisher))


def places_in(file: str) -> dict[str, Place]:
    """Return the places of a file package/path.yaml.

    Raises:
        ResourceError: the file does not exist.
        ValueError: it is not a file of places.
    """
    return load_places(resolve_file(file, allowed=[Path('/')]))


def rooms_left(rooms: Iterable[str], checked: Sequence[str], postponed: Sequence[str]) -> list[str]:
    """Return the rest of a round, in order: each room once, without checked rooms, postponed rooms last."""
    left = [room for room in dict.fromkeys(rooms) if room not in checked]
    return [room for room in left if room not in postponed] + [room for room in postponed if room in left]


def pose_of(place: Place) -> PoseStamped:
    """Return a place as a goal, with a zero stamp."""
    message = PoseStamped()
    message.header.frame_id = place.frame
    message.pose.position.x, message.pose.position.y = place.x, place.y
    message.pose.orientation.z, message.pose.orientation.w = math.sin(place.yaw / 2.0), math.cos(place.yaw / 2.0)
    return message


class PlaceState(EventState):
    """
    Write the pose of a place.

    -- place        string      Name of the place
    -- places       string      File of the places, as package/path.yaml

    #> pose         geometry_msgs/PoseStamped   The place

    <= done                     It was written.
    """

    is_instant = True

    def __init__(self, place: str, places: str) -> None:
        super().__init__(outcomes=['done'], output_keys=['pose'], desired_rate=None)
        known = places_in(places)
        if place not in known:
            raise StateParameterError(self, 'place', f'{place!r} is not a place of {places}')
        self._pose = pose_of(known[place])

    def execute(self, userdata: UserData) -> str:
        userdata.pose = self._pose
        return 'done'


class NoteRoomState(EventState):
    """
    Move a room to the end of a list.

    ># room         string      The room
    ># rooms        string[]    The list
    #> rooms        string[]    The list with the room at its end

    <= done                     It is the last one of the list.
    """

    is_instant = True

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], input_keys=['room'], io_keys=['rooms'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata.rooms = [*(other for other in userdata.rooms if other != userdata.room), userdata.room]
        return 'done'


class ForgetRoundState(EventState):
    """
    Begin a new round.

    #> checked      string[]    No rooms
    #> postponed    string[]    No rooms

    <= done                     Both lists are empty.
    """

    is_instant = True

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], output_keys=['checked', 'postponed'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata.checked, userdata.postponed = [], []
        return 'done'


# A state of the night watch that finds obstacles missing from the map.

OCCUPIED = 65
"""Occupancy from which a cell of the map counts as occupied, percent."""

TOLERANCE = 0.25
"""A beam that ends this near to something on the map has hit it, m."""

BEAMS = 5
"""Minimum number of beams that must end off the map's obstacles: fewer may be noise."""

THERE = 0.5
"""Maximum distance from a place at which the robot counts as there, m: twice the tolerance of the controller."""


class CompareScanState(EventState):
    """
    Compare a scan with the map to find objects around the robot that are not on the map.

    -- reach        float       Maximum distance of an object from the robot, m

    ># map          nav_msgs/OccupancyGrid      The map
    ># goal         geometry_msgs/PoseStamped   Pose at which the robot should be
    ># pose         geometry_msgs/PoseStamped   Pose of the robot on the map
    ># scan         sensor_msgs/LaserScan       Scan of the lidar

    #> finding      geometry_msgs/PoseStamped   Position of the object; ``goal``, if the outcome is beside

    <= found                    There is an object; the operator is told where.
    <= clear                    The scan shows nothing that is not on the map.
    <= elsewhere                The robot is not at ``goal``: it was driven away meanwhile.
    <= beside                   It is not there the second time either: an object may stand there.
    """

    is_instant = True

    def __init__(self, reach: float = 2.0) -> None:
        super().__init__(
            outcomes=['found', 'clear', 'elsewhere', 'beside'],
            input_keys=['map', 'goal', 'pose', 'scan'],
            output_keys=['finding'],
            desired_rate=None,
        )
        self._reach = reach
        self._missed: PoseStamped | None = None

    def execute(self, userdata: UserData) -> str:
        goal, missed = userdata.goal, self._missed
        self._missed = None
        frames = [message.header.frame_id for message in (userdata.map, goal, userdata.pose)]
        if len(set(frames)) > 1:
            raise ValueError(f'map, goal and pose have to be in one frame; they are in {", ".join(map(repr, frames))}')
        place, here = goal.pose.position, userdata.pose.pose.position
        away = math.hypot(here.x - place.x, here.y - place.y)
        if away > THERE and goal != missed:
            self._missed = goal
            self.log_info(f'the robot is {away:.1f} m from where it shall look: it was driven away meanwhile')
            return 'elsewhere'
        if away > THERE:
            userdata.finding = goal
            self.log_warn(f'the robot is {away:.1f} m from where it shall look, again: something may stand there')
            return 'beside'
        points = unexpected_points(userdata.map, userdata.pose, userdata.scan, self._reach)
        if len(points) < BEAMS:
            return 'clear'
        x, y = points.mean(axis=0)
        finding = PoseStamped(header=userdata.pose.header)
        finding.pose.position.x, finding.pose.position.y = float(x), float(y)
        userdata.finding = finding
        self.log_warn(f'{len(points)} beams end at something that is not on the map, near ({x:.1f}, {y:.1f})')
        return 'found'


def unexpected_points(
    grid: OccupancyGrid, pose: PoseStamped, scan: LaserScan, reach: float
) -> NDArray[np.float64]:  # fmt: skip
    """Return ends of beams in the map, m, as rows [x, y]: those within ``reach`` (m), not near an occupied cell."""
    ranges = np.asarray(scan.ranges, dtype=float)
    yaw = 2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w)
    angles = yaw + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    seen = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= reach)
    ends = np.stack([np.cos(angles[seen]), np.sin(angles[seen])], axis=1) * ranges[seen, None]
    ends += pose.pose.position.x, pose.pose.position.y

    info = grid.info
    cells = np.asarray(grid.data, dtype=np.int8).reshape(info.height, info.width) >= OCCUPIED
    rows, columns = np.nonzero(cells)
    origin = np.array([info.origin.position.x, info.origin.position.y])
    walls = origin + (np.stack([columns, rows], axis=1) + 0.5) * info.resolution
    near = walls[np.hypot(*(walls - (pose.pose.position.x, pose.pose.position.y)).T) <= reach + TOLERANCE]
    if not len(near) or not len(ends):
        return ends
    distances = np.hypot(*np.moveaxis(ends[:, None, :] - near[None, :, :], 2, 0)).min(axis=1)
    return np.asarray(ends[distances > TOLERANCE])


# A state of the night watch that has a door opened.

RESPONSE_SECONDS = 5.0
"""Time limit for an answer of the door controller, s of wall time."""


class OpenDoorState(EventState):
    """
    Have the door of a room opened, and wait until it is. The controller of the doors has a service for each of them,
    SERVICES/ROOM_door (std_srvs/SetBool).

    -- services     string      Prefix of the services of doors
    -- seconds      float       Time that the door takes to open, s, on the node's clock

    ># room         string      The room

    <= open                     The door is open.
    <= jammed                   The door does not move, or its controller does not answer; the operator is told why.
    """

    skill = Skill.of(
        parameters={'room': 'room'},
        outcomes={'open': Outcome.of('completed', 'door_open(room)'), 'jammed': 'failed'},
        predicates=[Predicate('door_open', {'room': 'room'})],
    )

    def __init__(self, services: str = '/simulator/doors', seconds: float = 2.5) -> None:
        super().__init__(outcomes=['open', 'jammed'], input_keys=['room'], desired_rate=None)
        self._services = services
        self._seconds = seconds
        self._call: ServiceCall | None = None
        self._open_at: float | None = None

    def on_enter(self, userdata: UserData) -> None:
        self._open_at = None
        link = state_services(self).services.link(SetBool, f'{self._services}/{userdata.room}_door')
        self._call = ServiceCall(
            link,
            SetBool.Request(data=True),
            on_done=lambda _outcome: self.wake(),
            server_timeout=RESPONSE_SECONDS,
            response_timeout=RESPONSE_SECONDS,
        )

    def execute(self, userdata: UserData) -> str | None:
        if self._open_at is None:
            assert self._call is not None
            outcome = self._call.outcome
            if outcome is None:
                return None
            if outcome.response is None or not outcome.response.success:
                why = outcome.reason if outcome.response is None else outcome.response.message
                self.log_warn(f'the door of the {userdata.room} does not open: {why}')
                return 'jammed'
            self._open_at = self.clock.now() + self._seconds
        if self.clock.now() >= self._open_at:
            return 'open'
        self.wake_at(self._open_at)
        return None

    def on_exit(self, userdata: UserData) -> None:
        if self._call is not None and not self._call.done:
            self._call.cancel()


# A state of the night watch that detects the loss of the other robot.


class WatchPartnerState(EventState):
    """
    Wait until the executive of another robot is gone, which its liveness token on NAME/alive shows.

    -- partner      string      Namespace of the other robot; empty for none, which is never lost
    -- places       string      File of the places, as package/path.yaml; other rooms are ignored

    #> left_behind  string[]    Rooms that it still had to check, from its last message

    <= lost                     The executive was there, and is gone.
    """

    def __init__(self, partner: str, places: str) -> None:
        super().__init__(outcomes=['lost'], output_keys=['left_behind'], desired_rate=None)
        namespace = '/' + partner.strip('/')
        self._executive = checked_topic(self, 'partner', f'{namespace}/{names.ONBOARD_EXECUTIVE}') if partner else ''
        self._topic = f'{namespace}/{ROOMS_LEFT}'
        self._places = places_in(places)
        self._watch: LivelinessWatch | None = None
        self._subscription: Subscription | None = None
        self._changed: Callable[[], None] | None = None
        self._lock = threading.Lock()
        self._left: list[str] = []

    def on_start(self) -> None:
        if self._executive:
            services = state_services(self)
            self._changed = services.changed
            services.runtime.call(lambda: self._join(services.runtime))

    def execute(self, userdata: UserData) -> str | None:
        if self._watch is None or self._watch.alive is not False:
            return None
        with self._lock:
            userdata.left_behind = list(self._left)
        said = ', '.join(userdata.left_behind) or 'nothing'
        self.log_warn(f'{self._executive} is gone; of its rooms it had left: {said}')
        return 'lost'

    def activity(self) -> Sequence[str]:
        with self._lock:
            return [f'{self._topic}: {", ".join(self._left) or "nothing"}'] if self._executive else []

    def on_stop(self) -> None:
        watch, subscription = self._watch, self._subscription
        self._watch = self._subscription = None
        if watch is not None:
            watch.close()
        if subscription is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_subscription(subscription))

    def _join(self, runtime: Runtime) -> None:
        self._watch = LivelinessWatch(runtime, self._executive, self._tell)
        self._subscription = runtime.node.create_subscription(
            String, self._topic, self._on_message, names.transient_local_qos()
        )

    def _tell(self, _is_alive: bool) -> None:
        self.wake()

    def _on_message(self, message: Any) -> None:
        with self._lock:
            self._left = [room for room in dict.fromkeys(message.data.split()) if room in self._places]
        if self._changed is not None:  # a message may come after on_stop, when the state has no services any more
            self._changed()


class TakeOverState(EventState):
    """
    Take over the rooms of the other robot.

    ># left_behind  string[]    Rooms that it still had to check
    #> inherited    string[]    The same

    <= done                     They were taken over.
    """

    is_instant = True

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], input_keys=['left_behind'], output_keys=['inherited'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata.inherited = userdata.left_behind
        return 'done'
