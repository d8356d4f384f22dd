# SPDX-License-Identifier: BSD-3-Clause
"""Who tells the simulated time. When several do, it jumps from one to the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime, Received, ReceivedMessages, watch_clock_publishers, writer_name
from flexbt_core.clock import Timer
from flexbt_msgs.msg import ExecutiveLog

LISTEN_SECONDS: Final = 2.0
"""For so long it is listened who publishes, s: one that was killed is in the graph for longer, and sends nothing."""

PAUSE_SECONDS: Final = 3.0
"""From there to the next time, while there are several, s."""

_CLOCK_BYTES: Final = 100


class ClockPublishers:
    """Tells operators while several publish ``/clock``, where time is simulated, and the middleware tells who sends.

    Used on the executor thread; ``changed`` is called when :attr:`problem` is another one.
    """

    def __init__(self, runtime: NodeRuntime, tell: Callable[[int, str], None], changed: Callable[[], None]) -> None:
        self.problem = ''
        """Who they are and what to do, for people; '' while there is one."""
        self._runtime = runtime
        self._tell = tell
        self._changed = changed
        self._writers: set[bytes] = set()
        self._messages: ReceivedMessages | None = None
        self._timer: Timer | None = None
        watch_clock_publishers(runtime.node, self._look)

    def _look(self) -> None:
        """Publishers have come or gone, or the pause is over."""
        if self._messages is not None:
            return  # it is looked again
        if self._timer is not None:
            self._timer.cancel()
        node = self._runtime.node
        if node.count_publishers(names.CLOCK) < 2:
            self._set_problem('')
            return
        self._writers.clear()
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._messages = ReceivedMessages(node, Clock, names.CLOCK, qos, self._on_message, _CLOCK_BYTES)
        self._after(LISTEN_SECONDS, self._judge)

    def _on_message(self, received: Received) -> None:
        self._writers.add(received.writer)

    def _judge(self) -> None:
        assert self._messages is not None
        node = self._runtime.node
        node.destroy_subscription(self._messages.subscription)
        self._messages = None
        problem = ''
        if len(self._writers) > 1:
            found = Counter(writer_name(node, names.CLOCK, writer) or 'a node that is gone' for writer in self._writers)
            who = ', '.join(name if count == 1 else f'{count} x {name}' for name, count in sorted(found.items()))
            problem = (
                f'{len(self._writers)} publishers of {names.CLOCK} ({who}): the simulated time jumps between them; end '
                'all but one, or start the others in another ROS_DOMAIN_ID'
            )
        self._set_problem(problem)
        self._after(PAUSE_SECONDS, self._look)

    def _after(self, seconds: float, then: Callable[[], None]) -> None:
        self._timer = self._runtime.post_in(seconds, then)

    def _set_problem(self, problem: str) -> None:
        before, self.problem = self.problem, problem
        if problem == before:
            return
        if problem:
            self._tell(ExecutiveLog.WARN, problem)
        else:
            self._tell(ExecutiveLog.INFO, f'one publisher of {names.CLOCK} is left')
        self._changed()
