# SPDX-License-Identifier: BSD-3-Clause
"""The action ``follow_waypoints``: it sends each pose in turn as a goal of ``navigate_to_pose``, and runs a task at
each waypoint (Nav2's waypoint task executors).

A newer goal takes over: the robot continues to its first waypoint without a stop.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from copy import deepcopy
from typing import Any, Final, Protocol

from nav2_msgs.action import FollowWaypoints, NavigateToPose
from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, GoalOutcome, GoalStatus
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_server.leaves.leaf_services import LeafServices
from flexbt_server.nav2.branches import missed

FollowWaypointsResult = FollowWaypoints.Result

MOST_MISSED: Final = 1000
"""Maximum number of missed waypoints in a result; it has the last ones. A goal may have billions of loops."""


_MAY_DRIVE: Final = (GoalStatus.ABORTED, GoalStatus.LOST, GoalStatus.TIMEOUT)
"""Ends of a canceled goal after which its robot may not be at rest."""


class WaypointFollower:
    """The server of FollowWaypoints. On the executor thread."""

    def __init__(
        self, runtime: Runtime, services: LeafServices, task: WaypointTask, stop_on_failure: bool, refusal: str
    ) -> None:
        """``task`` runs at each waypoint."""
        self.runtime = runtime
        self.services = services
        self.task = task
        self.stop_on_failure = stop_on_failure
        self.calls: list[ActionCall] = []
        """The calls that drive the robot, oldest first: the navigator replaces one by the next."""
        self._tour: _Tour | None = None
        self._admission = GoalAdmission(names.WAYPOINT_FOLLOWER, refusal)
        GoalServer(
            runtime, FollowWaypoints, names.FOLLOW_WAYPOINTS, self._serve, self._cancel, admission=self._admission
        )

    def admit(self, refusal: str) -> None:
        """Refuse goals for this reason, which follows a subject, and end the active goal; '' to accept goals."""
        if not refusal:
            self._admission.open()
            return
        self._admission.close(refusal)
        if self._tour is not None:
            self._tour.stop(f'{names.WAYPOINT_FOLLOWER} {refusal}')

    def _serve(self, served: ServedGoal) -> None:
        poses, first = served.request.poses, served.request.goal_index
        if first >= len(poses):
            why = f'there is no waypoint {first} among the {len(poses)} of the goal' if poses else 'it has no waypoints'
            served.abort(_result(f'the goal cannot be followed: {why}', 'NO_VALID_WAYPOINTS'))
            return
        older, newer = self._tour, _Tour(self, served)
        self._tour = newer
        if older is not None:
            older.replaced()
        newer.drive()

    def _cancel(self, served: ServedGoal) -> None:
        if self._tour is not None and self._tour.served is served:
            self._tour.cancel()

    def call_ended(self, outcome: GoalOutcome) -> None:
        """Continue the active goal after the end of a call, its own or that of a goal before it."""
        if self._tour is not None:
            self._tour.call_ended(outcome)

    def forget(self, tour: _Tour) -> None:
        """Remove a goal that has ended."""
        if self._tour is tour:
            self._tour = None


class _Tour:
    """The tour of one goal through its waypoints."""

    def __init__(self, follower: WaypointFollower, served: ServedGoal) -> None:
        self.served = served
        self._follower = follower
        self._index = int(served.request.goal_index)
        self._loops = int(served.request.number_of_loops)
        self._missed: deque[Any] = deque(maxlen=MOST_MISSED)
        self._reached = False
        self._call: ActionCall | None = None
        self._is_canceled = False

    def replaced(self) -> None:
        """End this goal since a newer one has arrived, whose call replaces the present one."""
        self._end(self.served.abort, 'a newer goal has taken over')

    def cancel(self) -> None:
        """Cancel for the client; the goal ends when the robot has stopped."""
        self._is_canceled = True
        if self._call is not None:
            self._call.cancel(self._follower.services.cancel_timeout)
        else:
            self._end(self.served.canceled)

    def stop(self, why: str) -> None:
        """Cancel the call that drives the robot, and abort the goal at once."""
        if self._call is not None:
            self._call.cancel(self._follower.services.cancel_timeout)
        self._end(self.served.abort, why)

    def drive(self) -> None:
        """Drive to the next waypoint."""
        self.served.publish_feedback(FollowWaypoints.Feedback(current_waypoint=self._index))
        pose = deepcopy(self.served.request.poses[self._index])
        pose.header.stamp = self._follower.runtime.clock.stamp()
        calls = self._follower.calls

        def ended(outcome: GoalOutcome) -> None:
            for older in calls[: calls.index(call)]:
                older.cancel(self._follower.services.cancel_timeout)  # the navigator may have refused to replace it
            calls.remove(call)
            self._follower.call_ended(outcome)

        call = self._call = ActionCall(
            self._follower.services.actions.link(NavigateToPose, names.NAVIGATE_TO_POSE),
            NavigateToPose.Goal(pose=pose),
            on_done=ended,
            on_feedback=lambda _: self.served.publish_feedback(FollowWaypoints.Feedback(current_waypoint=self._index)),
            server_timeout=self._follower.services.first_timeout,
            accept_timeout=self._follower.services.server_timeout,
        )
        calls.append(call)

    def call_ended(self, outcome: GoalOutcome) -> None:
        """Continue after the end of a call, unless the present one, or an older one after a cancel, still drives."""
        drives_on = self._is_canceled and self._follower.calls and outcome.status not in _MAY_DRIVE
        if self._call is not None and self._call.done and not drives_on:
            self._call = None
            self._arrived(outcome)

    def _arrived(self, outcome: GoalOutcome) -> None:
        if self._is_canceled and outcome.status in _MAY_DRIVE:
            self._end(self.served.abort, f'the goal was canceled, and the robot may still drive: {outcome.reason}')
        elif self._is_canceled:
            self._end(self.served.canceled)
        elif outcome.status is GoalStatus.SUCCEEDED:
            self._reached = True
            self._follower.task.begin(self._task_ended)
        else:
            code = getattr(outcome.result, 'error_code', 0) or FollowWaypointsResult.UNKNOWN
            self._miss('was not reached', outcome.reason, code, 'STOP_ON_MISSED_WAYPOINT')

    def _task_ended(self, why: str) -> None:
        if why:
            self._miss(
                'was reached and its task failed',
                why,
                FollowWaypointsResult.TASK_EXECUTOR_FAILED,
                'TASK_EXECUTOR_FAILED',
            )
        else:
            self._go_on()

    def _miss(self, how: str, why: str, code: int, end_code: str) -> None:
        self._missed.append(missed(self._index, self.served.request.poses[self._index], code, why))
        text = f'waypoint {self._index} {how}: {why}'
        self._follower.runtime.node.get_logger().warning(text)
        if self._follower.stop_on_failure:
            self._end(self.served.abort, text, end_code)
        else:
            self._go_on()

    def _go_on(self) -> None:
        """Continue to the next waypoint, or end the goal after the last."""
        self._index += 1
        if self._index == len(self.served.request.poses) and self._loops:
            if not self._reached:
                self._end(self.served.abort, 'no waypoint was reached in a whole loop')
                return
            self._index = 0
            self._loops -= 1
            self._reached = False
        if self._index < len(self.served.request.poses):
            self.drive()
        else:
            self._end(self.served.succeed)

    def _end(self, how: Callable[[Any], None], why: str = '', code: str = 'UNKNOWN') -> None:
        self._follower.task.cancel()
        how(_result(why, code, self._missed))
        self._follower.forget(self)


def _result(why: str, code: str, those_missed: Iterable[Any] = ()) -> Any:
    """Return the result. ``code`` is the name of the error code, if the action has it; Jazzy's has only UNKNOWN."""
    error_code = (
        getattr(FollowWaypointsResult, code, FollowWaypointsResult.UNKNOWN) if why else FollowWaypointsResult.NONE
    )
    return FollowWaypointsResult(error_code=error_code, error_msg=why, missed_waypoints=list(those_missed))


# The task at each waypoint of follow_waypoints: Nav2's waypoint task executors.


class WaypointTask(Protocol):
    """A task at a waypoint. Executor thread only; one run at a time."""

    def begin(self, on_end: Callable[[str], None]) -> None:
        """Start the task. ``on_end`` is called on the executor thread with the reason of a failure, or ''."""

    def cancel(self) -> None:
        """End the task without calling ``on_end``. No effect if it has not started."""


class WaitAtWaypoint:
    """``wait_at_waypoint``: a task that waits, in s on the clock of the node."""

    def __init__(self, runtime: Runtime, pause: float) -> None:
        self._runtime = runtime
        self._pause = pause
        self._timer: Timer | None = None

    def begin(self, on_end: Callable[[str], None]) -> None:
        """See WaypointTask."""
        if not self._pause:
            on_end('')
            return
        clock = self._runtime.clock
        self._timer = clock.call_at(clock.now() + self._pause, lambda: on_end(''))

    def cancel(self) -> None:
        """See WaypointTask."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class InputAtWaypoint:
    """``input_at_waypoint``: a task that waits for a message on a topic, and fails if none arrives in time."""

    def __init__(self, runtime: Runtime, topic: str, timeout: float) -> None:
        self._late = f'nothing has come on {topic} within {timeout:g} s'
        self._timeout = WaitAtWaypoint(runtime, timeout)
        self._on_end: Callable[[str], None] | None = None
        runtime.node.create_subscription(Empty, topic, lambda _: self._end(''), names.INPUT_DEPTH)

    def begin(self, on_end: Callable[[str], None]) -> None:
        """See WaypointTask."""
        self._on_end = on_end
        self._timeout.begin(lambda _: self._end(self._late))

    def cancel(self) -> None:
        """See WaypointTask."""
        self._timeout.cancel()
        self._on_end = None

    def _end(self, why: str) -> None:
        on_end = self._on_end
        if on_end is not None:
            self.cancel()
            on_end(why)
