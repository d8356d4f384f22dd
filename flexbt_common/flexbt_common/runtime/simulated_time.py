# SPDX-License-Identifier: BSD-3-Clause
"""The simulated time of a node, taken from the middleware when somebody wants to know it.

rclpy wakes the executor for each message of /clock, some dozens a second, and that was most of what a node at rest had
to do. The middleware keeps the newest message anyway. It is taken whenever the executor has come back from a wait, and
when :class:`flexbt_common.runtime.RosClock` is asked for the time, on any thread; and the executor is woken for it
while a timer waits for a time.

And how much of the time, simulated or not, a node was there to hear what others say.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator
from typing import Final

from builtin_interfaces.msg import Time
from rclpy.clock import ROSClock
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource

from flexbt_core.clock import Clock

LONGEST_WAIT: Final = 0.2
"""For so long at most the executor waits under simulated time, s of wall time: no more is the time old by which rclpy's
own clock goes, when it is read without a :class:`flexbt_common.runtime.RosClock`. Longer than the period by which a
node at rest is asked whether it answers (health.py), which wakes it anyway."""

_NANOSECONDS: Final = 1_000_000_000


class SimulatedTime:
    """Brings the newest message of /clock to rclpy's clocks. From any thread.

    ``subscription`` is rclpy's own one, which the executor finds; None while nobody but the executor is to take from
    it, or time is not simulated. ``post_fault`` gets what a callback of a jump of time lets escape: on the thread of
    whoever asks for the time, which may hold any lock, so it must only keep it for later.

    ``refused`` are messages that were no time, and were dropped; ``last_refused`` is the newest of them.
    """

    def __init__(self, post_fault: Callable[[Exception], object]) -> None:
        self._post_fault = post_fault
        self.subscription: Subscription | None = None
        self.refused = 0
        self.last_refused = Time()
        self._lock = threading.RLock()
        self._stands_still = False

    def take_newest(self) -> None:
        """Take the newest message, if there is one that was not taken yet.

        Where somebody is about that, or has the time stand still, it is left to them.
        """
        subscription = self.subscription
        if subscription is None or not self._lock.acquire(blocking=False):
            return
        try:
            if not self._stands_still:  # else it is this thread's own doing: a callback of a jump asks for the time
                with self.standing_still():
                    self._take(subscription)
        except InvalidHandle:
            self.subscription = None  # time is not simulated any more
        except Exception as error:
            self._post_fault(error)
        finally:
            self._lock.release()

    @contextlib.contextmanager
    def standing_still(self) -> Iterator[None]:
        """In the block, only this thread changes the time of rclpy's clocks, as far as it is simulated."""
        with self._lock:
            before, self._stands_still = self._stands_still, True
            try:
                yield
            finally:
                self._stands_still = before

    def _take(self, subscription: Subscription) -> None:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        time = taken[0].clock
        if time.sec < 0 or time.nanosec >= _NANOSECONDS:
            self.last_refused = time
            self.refused += 1
            return
        subscription.callback(taken[0])


class ListeningTime:
    """For how long a node has been there to hear what others say, s, on the executor thread.

    Time counts as far as both the wall's clock and that of the node have gone on from one look of the executor to the
    next. Whoever misses a message takes the difference of two such times: others have not been silent in a simulation
    that was paused, nor in one that is fast on a busy machine, nor to a node that was held up itself.
    """

    def __init__(self, steady: Clock, ros_clock: ROSClock) -> None:
        self._steady = steady
        self._ros_clock = ros_clock
        self._seen, self._simulated = steady.now(), 0
        self.looked = 0.0
        """Up to the last look at what has come."""
        self.handled = 0.0
        """Up to the last look after which all was handled that had come."""

    def sample(self) -> None:
        """What has come by now is about to be handled."""
        now, went_on = self._steady.now(), math.inf
        if self._ros_clock.ros_time_is_active:
            simulated = self._ros_clock.now().nanoseconds
            if simulated == self._simulated:
                # The next message of /clock is under way, or the simulation is paused.
                self._seen = max(self._seen, now - LONGEST_WAIT)
                return
            went_on, self._simulated = max(0, simulated - self._simulated) * 1e-9, simulated
        self.looked += min(now - self._seen, went_on)
        self._seen = now

    def all_handled(self) -> None:
        """Whatever had come when :meth:`sample` was called."""
        self.handled = self.looked


def watch_clock_publishers(node: Node, on_change: Callable[[], object]) -> None:
    """Have ``on_change`` called on the executor thread, within a second, when somebody who tells the simulated time has
    come or gone; never where time is not simulated when this is called, on the executor thread.
    """
    for subscription in filter(is_clock_subscription, node.subscriptions):
        callbacks = SubscriptionEventCallbacks(matched=lambda _event: on_change(), use_default_callbacks=False)
        handlers = callbacks.create_event_handlers(
            subscription.callback_group, subscription.handle, subscription.topic_name
        )
        for handler in handlers:
            subscription.event_handlers.append(handler)  # which ends with it
            node.add_waitable(handler)


def is_clock_subscription(subscription: Subscription) -> bool:
    """Whether it is the one by which rclpy's clocks get the simulated time."""
    return isinstance(getattr(subscription.callback, '__self__', None), TimeSource)
