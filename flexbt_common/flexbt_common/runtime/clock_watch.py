# SPDX-License-Identifier: BSD-3-Clause
"""The check of a node's simulated time, for all parts that report it.

A node under ``use_sim_time`` waits forever if nothing publishes ``/clock``, and its waits end at random times if two
nodes do. Apart from that it seems to work, so it reports problems of its time everywhere: in its log, liveliness token,
diagnostics, feedback, and the status of the executive.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

from rclpy.clock import JumpThreshold
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received, ReceivedMessages, reports_writers, writer_name
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import RepeatedReports

from .node_runtime import NodeRuntime, Runtime
from .ros_clock import watch_clock_publishers

STILL_SECONDS: Final = 3.0
"""Time without progress after which simulated time counts as stopped, s of wall time."""

SHOWN_SECONDS: Final = 10.0
"""Time for which a jump or an invalid time is shown, s of wall time; within it, a recurring problem is logged once."""

SLOW: Final = 0.05
"""Share of wall time below which simulated time is slow."""

LISTEN_SECONDS: Final = 2.0
"""Time spent listening for the publishers, s: a killed one stays in the graph for longer, but sends nothing."""

PAUSE_SECONDS: Final = 3.0
"""Pause until the next check while several publishers exist, s."""

GOES_ON: Final = 'the clock of this node works as it should'
"""Report when the clock works, or works again."""

_LOOK_SECONDS: Final = 1.0
_LOOK_TOLERANCE: Final = 0.25
_WINDOW_SECONDS: Final = 5.0
_MOST_NAMES: Final = 5
_CLOCK_BYTES: Final = 100


def clock_health(runtime: Runtime) -> ClockHealth:
    """Return the object that watches the time of a node, one for each node. Executor thread only."""
    return runtime.once(ClockHealth, ClockHealth)


class ClockHealth:
    """The health of a node's simulated time. Used on the executor thread.

    ``problem`` describes the problem and what to do; '' without a problem, or if time is not simulated.
    ``is_missing``: no node publishes the time or has published it.
    """

    def __init__(self, runtime: NodeRuntime) -> None:
        self.problem = ''
        self.is_missing = False
        self._runtime = runtime
        self._clock = runtime.node.get_clock()
        self.report: Callable[[str], object] = self.log
        """Function that reports a problem, or '' for its end; a recurring one is reported once."""
        self._listeners: list[Callable[[], object]] = []
        self._reports = RepeatedReports(SHOWN_SECONDS, runtime.steady.now)
        self._reported: tuple[str, ...] = ()
        self._is_watching = False
        self._several = ''
        self._writers: set[bytes] = set()
        self._messages: ReceivedMessages | None = None
        self._timer: Timer | None = None
        self._seen = self._went_on_at = self._window_began = 0.0
        self._window_from = 0.0
        self._is_slow = False
        self._jumps = runtime.clock.jumps
        self._jumped_at = self._refused_at = -SHOWN_SECONDS
        self._refused = runtime.simulated_time.refused
        self._jump_handle = self._clock.create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=None, on_clock_change=True),
            post_callback=lambda _jump: runtime.post(self._clock_changed),
        )
        self._clock_changed()

    def add_listener(self, listener: Callable[[], object]) -> None:
        """Call ``listener`` when the problem changes or ends."""
        self._listeners.append(listener)

    def remove_listener(self, listener: Callable[[], object]) -> None:
        """Stop calling ``listener``."""
        self._listeners.remove(listener)

    def log(self, problem: str) -> None:
        """Report a problem, or its end, in the log of the node."""
        logger = self._runtime.node.get_logger()
        if problem:
            logger.warning(problem)
        else:
            logger.info(GOES_ON)

    # -- the time ----------------------------------------------------------------------------------------------------

    def _clock_changed(self) -> None:
        """Handle a change between simulated and system time."""
        if not self._clock.ros_time_is_active:
            self._several = ''
            self._set_problem({})
            return
        self._seen = self._now()
        self._went_on_at = self._runtime.steady.now()
        self._begin_window()
        watch_clock_publishers(self._runtime.node, self._look_for_publishers)
        if not self._is_watching:
            self._is_watching = True
            self._runtime.repeat_near(_LOOK_SECONDS, _LOOK_TOLERANCE, self._look)

    def _look(self) -> None:
        if not self._clock.ros_time_is_active:
            return
        now, time = self._runtime.steady.now(), self._now()
        if time != self._seen:
            self._seen, self._went_on_at = time, now
        if self._runtime.clock.jumps != self._jumps:
            self._jumps, self._jumped_at = self._runtime.clock.jumps, now
            self._begin_window()
        if self._runtime.simulated_time.refused != self._refused:
            self._refused, self._refused_at = self._runtime.simulated_time.refused, now
        if now - self._went_on_at >= STILL_SECONDS:
            self._begin_window()
        elif now - self._window_began >= _WINDOW_SECONDS:
            self._is_slow = time - self._window_from < SLOW * (now - self._window_began)
            self._begin_window()
        self._judge()

    def _begin_window(self) -> None:
        self._window_began, self._window_from = self._runtime.steady.now(), self._now()

    def _now(self) -> float:
        return float(self._clock.now().nanoseconds) * 1e-9

    # -- who publishes -----------------------------------------------------------------------------------------------

    def _look_for_publishers(self) -> None:
        """Check the publishers again, after one appeared or disappeared, or after the pause."""
        if self._messages is not None or not reports_writers():
            return  # check again, or the sender cannot be known
        if self._timer is not None:
            self._timer.cancel()
        node = self._runtime.node
        if node.count_publishers(names.CLOCK) < 2 or not self._clock.ros_time_is_active:
            self._several = ''
            self._judge()
            return
        self._writers.clear()
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._messages = ReceivedMessages(node, Clock, names.CLOCK, qos, self._on_message, _CLOCK_BYTES)
        self._timer = self._runtime.post_in(LISTEN_SECONDS, self._heard)

    def _on_message(self, received: Received) -> None:
        self._writers.add(received.writer)

    def _heard(self) -> None:
        assert self._messages is not None
        self._runtime.node.destroy_subscription(self._messages.subscription)
        self._messages = None
        self._several = ''
        if len(self._writers) > 1:
            self._several = (
                f'{len(self._writers)} publishers of {names.CLOCK} ({self._named(self._writers)}): the simulated time '
                'jumps between them; end all but one, or start the others in another ROS_DOMAIN_ID'
            )
        self._timer = self._runtime.post_in(PAUSE_SECONDS, self._look_for_publishers)
        self._judge()

    def _publishers(self) -> str:
        endpoints = self._runtime.node.get_publishers_info_by_topic(names.CLOCK)
        return self._named({bytes(endpoint.endpoint_gid) for endpoint in endpoints})

    def _named(self, writers: set[bytes]) -> str:
        node = self._runtime.node
        found = Counter(writer_name(node, names.CLOCK, writer) or 'a node that is gone' for writer in writers)
        shown = [name if count == 1 else f'{count} x {name}' for name, count in sorted(found.items())]
        return ', '.join(shown[:_MOST_NAMES]) + (', ...' if len(shown) > _MOST_NAMES else '')

    # -- reports ----------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        if not self._clock.ros_time_is_active:
            return  # it has no problem since that change
        found: dict[str, str] = {}
        now = self._runtime.steady.now()
        if self._several:
            found['several'] = self._several
        if now - self._refused_at < SHOWN_SECONDS:
            refused = self._runtime.simulated_time.last_refused
            found['none'] = (
                f'{names.CLOCK} has times that are none, such as {refused.sec} s and {refused.nanosec} ns, which are '
                f'ignored; end the program that publishes them ({self._publishers()})'
            )
        if now - self._went_on_at >= STILL_SECONDS:
            found['still'] = self._why_still()
        elif now - self._jumped_at < SHOWN_SECONDS and not self._several:
            found['jump'] = f'simulated time has jumped by {self._runtime.clock.last_jump:+.9g} s'
        elif self._is_slow:
            found['slow'] = f'simulated time is slow: it advances by less than {SLOW:g} s in a second'
        self._set_problem(found)

    def _why_still(self) -> str:
        publishers = self._publishers()
        if publishers:
            return f'simulated time stands still at {self._seen:.1f} s: {publishers} is paused, or hangs'
        if self._seen:
            return f'simulated time stands still at {self._seen:.1f} s: nobody publishes {names.CLOCK} any more'
        return (
            f'nobody publishes {names.CLOCK}, and use_sim_time is set: time stands still at 0 s; start the simulator, '
            'or set use_sim_time to false'
        )

    def _set_problem(self, found: dict[str, str]) -> None:
        kinds, problem = tuple(found), '; '.join(found.values())
        self.is_missing = 'still' in found and not self._seen and not self._publishers()
        if kinds != self._reported and self._reports.held_before(kinds) is not None:  # else with a later look
            self._reported = kinds
            self.report(problem)
        if problem == self.problem:
            return
        self.problem = problem
        for listener in tuple(self._listeners):
            listener()
