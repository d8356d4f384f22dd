# SPDX-License-Identifier: BSD-3-Clause
"""The timing of a status: sent soon after a change, as a heartbeat while nothing changes, and at a limited rate."""

from __future__ import annotations

import threading
from typing import Final

from rclpy.clock import Clock, ClockType

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import TokenBucket

MAXIMUM_RATE: Final = 20.0
"""Maximum average rate of messages, 1/s."""

BURST: Final = 4
"""Messages that may be sent at once after a quiet time, so that the answer to a command is not delayed."""


class StatusPublisher:
    """A publisher that calls :meth:`send` on the executor thread.

    It sends soon after :meth:`changed`, and ``period`` seconds of wall time after the last message. Changes that come
    faster than the rate allows are combined into one message.
    """

    def __init__(self, runtime: Runtime, period: float) -> None:
        self._runtime = runtime
        self._lock = threading.Lock()
        self._is_due = False
        self._delay: Timer | None = None
        self._allowance = TokenBucket(MAXIMUM_RATE, BURST, runtime.steady.now)
        # On wall time, so that the heartbeat continues while simulated time is paused or has not begun.
        self._heartbeat = runtime.node.create_timer(
            period, self._send_now, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def send(self) -> None:
        """Send the status."""
        raise NotImplementedError

    def changed(self) -> None:
        """Request sending, since something in the status has changed. From any thread."""
        with self._lock:
            if self._is_due:
                return
            self._is_due = True
        self._runtime.post(self._send_when_allowed)

    def flush(self) -> None:
        """Send now if there is a change that was not sent yet. On the executor thread."""
        if self._is_due:
            self._send_now()

    def _send_when_allowed(self) -> None:
        if not self._is_due:
            return
        wait = (1.0 - self._allowance.left) / MAXIMUM_RATE
        if wait <= 0.0:
            self._send_now()
        elif self._delay is None:
            self._delay = self._runtime.post_in(wait, self._delay_is_over)

    def _delay_is_over(self) -> None:
        self._delay = None
        self._send_when_allowed()

    def _send_now(self) -> None:
        if self._delay is not None:
            self._delay.cancel()
            self._delay = None
        with self._lock:
            self._is_due = False  # before sending: later changes need another message
        self._allowance.take(min(1.0, self._allowance.left))
        self._heartbeat.reset()
        self.send()
