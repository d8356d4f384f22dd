# SPDX-License-Identifier: BSD-3-Clause
"""A node on ``/diagnostics``, for tools that watch over whole robots: once a second, while somebody listens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

from flexbt_common.runtime import GOES_ON, NodeRuntime, clock_health
from flexbt_core.values import sendable

TOPIC: Final = '/diagnostics'
PERIOD: Final = 1.0


class DiagnosticsPublisher:
    """Publishes what ``entries`` gives; it is called on the executor thread. Made there, too.

    Where time is simulated, an entry says how that goes.
    """

    def __init__(self, runtime: NodeRuntime, entries: Callable[[], Sequence[DiagnosticStatus]]) -> None:
        self._runtime = runtime
        self._entries = entries
        self._publisher = runtime.node.create_publisher(DiagnosticArray, TOPIC, 10)
        runtime.node.create_timer(PERIOD, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _publish(self) -> None:
        if self._publisher.get_subscription_count() == 0:
            return
        array = DiagnosticArray(status=[*self._entries(), *self._clock()])
        array.header.stamp = self._runtime.clock.stamp()
        self._publisher.publish(array)

    def _clock(self) -> list[DiagnosticStatus]:
        if not self._runtime.node.get_clock().ros_time_is_active:
            return []
        problem = clock_health(self._runtime).problem
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        return [diagnostic_status(self._runtime, 'simulated time', level, problem or GOES_ON)]


def diagnostic_status(
    runtime: NodeRuntime, what: str, level: bytes, message: str, values: Mapping[str, str] | None = None
) -> DiagnosticStatus:
    """What is to be told of one thing of a node: ``level`` is one of the constants of DiagnosticStatus."""
    return DiagnosticStatus(
        level=level,
        name=f'{runtime.node.get_fully_qualified_name()}: {what}',
        message=sendable(message),
        values=[KeyValue(key=key, value=value) for key, value in (values or {}).items()],
    )
