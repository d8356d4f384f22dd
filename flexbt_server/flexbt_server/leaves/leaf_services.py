# SPDX-License-Identifier: BSD-3-Clause
"""The services of the BT server for the leaves of its trees: connections, frames of the robot, requests, and canceled
goals."""

from __future__ import annotations

import queue
import threading
import time
import weakref
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger

from flexbt_common.calls.action_call import ActionLinks
from flexbt_common.calls.links import ServerLink
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.errors import TransformError
from flexbt_common.lifecycle.liveliness import ProcessIdentity
from flexbt_common.runtime.node_runtime import CALL_SECONDS, Runtime
from flexbt_common.transform_listener import TransformListener
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.clock.clock import Timer
from flexbt_server.trees.tree_store import TreeStore

from .topic_cache import SubscribedTopic, TopicCache, TopicCaches

MOST_TOLD: Final = 1_000
"""Maximum number of warnings that are logged only once: trees may have any names."""


@dataclass(frozen=True)
class LeafServices:
    """The services that all leaves of a server share; ``node.services`` of a leaf.

    ``runtime`` owns the node and the thread on which all of rclpy runs. ``actions`` and ``services`` are the shared
    clients, ``topics`` the shared subscriptions, and ``triggers`` the services that nodes of trees offer. ``ending``
    has the canceled goals that may continue, ``frames`` the pose of the robot. ``trees`` has the node types and reads
    files. ``server_timeout`` and ``cancel_timeout`` are the deadlines for acceptance and for the confirmation of a
    cancel, s of wall time. Up to the age ``start_timeout`` of this process, leaves wait for their servers.
    ``goal_reached_tol`` is Nav2's parameter of this name, m.
    """

    runtime: Runtime
    actions: ActionLinks
    services: ServiceLinks
    topics: TopicCaches
    triggers: TriggerServices
    ending: EndingGoals
    frames: RobotFrames
    trees: TreeStore
    server_timeout: float
    cancel_timeout: float
    start_timeout: float = 0.0
    goal_reached_tol: float = 0.25
    _told: set[str] = field(default_factory=set)

    def appear_timeout(self, timeout: float, link: ServerLink | None = None) -> float:
        """Return how long to wait for a server to appear, at least ``timeout``, s of wall time.

        The processes of a robot start together, in any order. While this process is young, the server may be starting,
        unless it is known to be gone.
        """
        left = self.start_timeout - (time.monotonic() - ProcessIdentity.started())
        if left <= timeout or (link is not None and self.runtime.call(link.is_gone)):
            return timeout
        return left

    @property
    def first_timeout(self) -> float:
        """Time to wait now for a server or for the pose of the robot, s of wall time."""
        return self.appear_timeout(self.server_timeout)

    def warn_once(self, message: str) -> None:
        """Log a warning once in the life of the server, about something that a tree requests and cannot have."""
        if message not in self._told and len(self._told) < MOST_TOLD:
            self._told.add(message)
            self.runtime.node.get_logger().warning(message)


class ServerNode(TreeNode):
    """A node that uses the services of the BT server."""

    __slots__ = ()

    @property
    def host(self) -> LeafServices:
        """Services of the BT server."""
        services: LeafServices = self.services
        return services

    def subscribe(self, topic: SubscribedTopic) -> TopicCache:
        """Return the cache of a topic, named by its port. Its messages tick the tree."""
        cache = self.host.topics.cache(topic.of(self))
        cache.on_message(self.context)
        return cache


# Where the robot is, and poses in other frames, for the leaves of a server.

FIRST_TIMEOUT: Final = 0.5
TRANSFORM_TOLERANCE: Final = 0.1
"""Time for which a leaf waits for a transform, s of wall time, as in Nav2. The first transform of a server may take
longer, since the node starts to receive tf then. Must be too short for the thread of the tree to count as hanging."""

_IMPATIENT_SECONDS: Final = 1.0
"""Time for which leaves do not wait again for a transform for which one has waited in vain, s of wall time: a tick of
many leaves would take many times as long as that of one."""


class RobotFrames:
    """The pose of the robot, by the topic of the pose or by tf, and poses in other frames, by tf. From any thread.

    ``global_frame`` and ``robot_base_frame`` are the defaults for nodes that name no frame.
    """

    def __init__(self, runtime: Runtime, pose: TopicCache, global_frame: str, robot_base_frame: str) -> None:
        self._runtime = runtime
        self._pose = pose
        self._timeout = FIRST_TIMEOUT
        self._in_vain: dict[tuple[str, str], float] = {}  # ends of waits for frames, on the steady clock
        self.global_frame = global_frame
        self.robot_base_frame = robot_base_frame

    def robot_pose(self, frame: str = '', base: str = '') -> PoseStamped:
        """Return the pose of the robot's frame ``base`` in ``frame``.

        The pose of the robot's base comes from the pose topic, transformed by tf if needed. tf alone gives it if that
        topic has no message yet, and gives the poses of other frames of the robot.

        Raises:
            TransformError: the pose is unknown.
        """
        base = base or self.robot_base_frame
        pose = self._pose.latest if base == self.robot_base_frame else None
        if pose is None:
            pose = PoseStamped()
            pose.header.frame_id = base
            pose.pose.orientation.w = 1.0
            try:
                return self.pose_in(pose, frame or self.global_frame)
            except TransformError as error:
                if base != self.robot_base_frame:
                    raise
                raise TransformError(self._pose.without_message(str(error))) from None
        return self.pose_in(pose, frame or self.global_frame)

    def pose_in(self, pose: PoseStamped, frame: str) -> PoseStamped:
        """Return ``pose`` in ``frame``. A pose without a frame is in the global frame.

        Raises:
            TransformError: no transform between the frames is known, even after a short wait.
        """
        source = pose.header.frame_id or self.global_frame
        if source == frame:
            return pose
        asked = PoseStamped(pose=pose.pose)
        asked.header.frame_id = source  # no stamp: use the newest transforms, as Nav2 does
        answers: queue.SimpleQueue[PoseStamped | TransformError] = queue.SimpleQueue()
        since = self._runtime.steady.now() - _IMPATIENT_SECONDS
        timeout = 0.0 if self._in_vain.get((source, frame), since) > since else self._timeout
        self._runtime.post(
            lambda: TransformListener.of(self._runtime).transform_pose(asked, frame, answers.put, answers.put, timeout)
        )
        try:
            answer = answers.get(timeout=timeout + CALL_SECONDS)
        except queue.Empty:
            raise TransformError(f'the node did not look for the transform of {source!r} to {frame!r}') from None
        self._timeout = TRANSFORM_TOLERANCE
        if isinstance(answer, TransformError):
            if timeout:
                kept = self._in_vain.copy()  # other trees may add theirs meanwhile
                self._in_vain = {frames: end for frames, end in kept.items() if end > since}
                self._in_vain[source, frame] = self._runtime.steady.now()
            raise answer
        answer.header.stamp = pose.header.stamp
        return answer


# The goals that leaves have canceled and whose end is not confirmed: a server may ignore cancels.

_MOST_TOLD: Final = 16


@dataclass(frozen=True, eq=False)
class EndingGoal:
    """A canceled goal of the action ``action``, which uses the actuators ``resources``. ``server`` is the full name of
    the action, which trees may also write in other forms. ``since`` is on the steady clock, ``time_of_day`` for
    people."""

    action: str
    server: str
    resources: frozenset[str]
    since: float
    time_of_day: str

    @property
    def description(self) -> str:
        """Description of the goal for a person."""
        return f'canceling the goal of {self.action}'


class EndingGoals:
    """The canceled goals of all trees of a server that have not ended. From any thread.

    A tree ends when its time to halt is over, but its goals may continue. As long as a goal may move an actuator, no
    tree sends another goal for that actuator or for the same server.

    A goal that has not ended ``patience`` seconds after its cancel is logged as a warning, and so is its later end.
    """

    def __init__(self, runtime: Runtime, patience: float) -> None:
        self._node = runtime.node
        self._steady = runtime.steady
        self._patience = patience
        self._alarms: dict[EndingGoal, Timer] = {}
        self._overdue: set[EndingGoal] = set()
        self._waiting: set[Callable[[], None]] = set()
        self._lock = threading.Lock()

    def add(self, action: str, resources: Collection[str]) -> EndingGoal:
        """Add a canceled goal. Pass the returned object to :meth:`remove` once the goal has ended."""
        goal = EndingGoal(
            action, self._resolve(action), frozenset(resources), self._steady.now(), time.strftime('%H:%M:%S')
        )
        with self._lock:
            self._alarms[goal] = self._steady.call_at(goal.since + self._patience, lambda: self._late(goal))
        return goal

    def _resolve(self, action: str) -> str:
        return str(self._node.resolve_service_name(f'{action}/_action/send_goal'))

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)

    def remove(self, goal: EndingGoal) -> None:
        """Remove a goal that has ended, and wake the leaves that wait for it."""
        with self._lock:
            self._alarms.pop(goal).cancel()
            was_overdue = goal in self._overdue
            self._overdue.discard(goal)
            waiting = tuple(self._waiting)
        if was_overdue:
            self._warn(f'{goal.action}: the goal has ended {self._steady.now() - goal.since:.1f} s after its cancel')
        for wake in waiting:
            wake()

    def overdue(self, given_up: Collection[str] = ()) -> list[str]:
        """Return the 16 oldest goals that did not end within ``patience``, and what to do, as text for people.

        ``given_up``: descriptions of goals that a tree has stopped waiting for, which count too.
        """
        with self._lock:
            late = (goal for goal in self._alarms if goal in self._overdue or goal.description in given_up)
            goals = list(islice(late, _MOST_TOLD))
        return [
            f'{goal.action}: its server has not ended the goal canceled at {goal.time_of_day}: '
            f'{"the robot may move; STOP keeps it at rest," if goal.resources else "what it does continues;"} restart '
            'a server that hangs'
            for goal in goals
        ]

    def in_the_way_of(self, action: str, resources: Collection[str]) -> tuple[str, ...]:
        """Return the goals that must end before a goal for this action with these actuators is sent."""
        if not self._alarms:
            return ()
        server = self._resolve(action)
        with self._lock:
            return tuple(
                goal.description
                for goal in self._alarms
                if goal.server == server or not goal.resources.isdisjoint(resources)
            )

    def wait(self, wake: Callable[[], None]) -> None:
        """Call ``wake()`` whenever a goal has ended, until :meth:`stop_waiting`."""
        with self._lock:
            self._waiting.add(wake)

    def stop_waiting(self, wake: Callable[[], None]) -> None:
        """Undo :meth:`wait`. No effect if ``wake`` does not wait."""
        with self._lock:
            self._waiting.discard(wake)

    def _late(self, goal: EndingGoal) -> None:
        with self._lock:
            if goal not in self._alarms:
                return
            self._overdue.add(goal)
        held = ', '.join(sorted(goal.resources))
        self._warn(
            f'{goal.action}: its server has not ended the goal {self._patience:g} s after its cancel, so what it does '
            f'continues. It is asked again and again; no other goal is sent to it{f" or to {held}" if held else ""} '
            'before. To stop the robot: STOP at the executive; restart the server if it hangs'
        )


# Services of the type std_srvs/Trigger through which nodes of running trees receive requests.

Handler = Callable[[], bool]


MOST_SERVICES: Final = 100
"""Maximum number of unused services that are kept."""


class TriggerServices:
    """The services of a server, by name, kept for later trees.

    A service calls every handler that was offered under its name, as long as the object of the handler exists. The
    request succeeds if one of them returns True.
    """

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._handlers: dict[str, list[weakref.WeakMethod[Handler]]] = {}
        self._services: dict[str, Any] = {}

    def offer(self, name: str, handler: Handler) -> None:
        """Call ``handler``, a bound method, on each request to the service ``name``. From any thread."""
        reference = weakref.WeakMethod(handler)
        self._runtime.call(lambda: self._add(name, reference))

    def _add(self, name: str, reference: weakref.WeakMethod[Handler]) -> None:
        name = self._runtime.node.resolve_service_name(name)
        if name not in self._handlers:
            self._forget_unused()
            self._handlers[name] = []
            self._services[name] = self._runtime.node.create_service(
                Trigger, name, lambda _, response: self._answer(name, response)
            )
        self._handlers[name] = [known for known in self._handlers[name] if known() is not None] + [reference]

    def _forget_unused(self) -> None:
        unused = [name for name, handlers in self._handlers.items() if not any(handler() for handler in handlers)]
        for name in unused[: max(0, len(self._handlers) + 1 - MOST_SERVICES)]:
            del self._handlers[name]
            self._runtime.node.destroy_service(self._services.pop(name))

    def _answer(self, name: str, response: Any) -> Any:
        handlers = [handler for reference in self._handlers[name] if (handler := reference()) is not None]
        # Call each handler, whatever the others return.
        taken = [handler() for handler in handlers]
        response.success = any(taken)
        if not response.success:
            response.message = 'no running tree has a node that takes this request now'
        return response
