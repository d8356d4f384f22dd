# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``recorder``: writes what a robot and its operators say to each other into an MCAP file."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_common.values.value_types import resolve_type
from flexbt_core.clock.rates import TokenBucket
from flexbt_core.values.text import pluralize

from .run_file import MOST_WAITING, RunWriter
from .topics import BUNDLED, TOPICS, full_definition

if TYPE_CHECKING:
    from .ring import Ring

MAX_SIZE: Final = 4_000_000_000
"""Default maximum size of a recording, bytes."""

DISCOVERY_SECONDS: Final = 1.0
"""Time for which the recorder searches for participants before it reports that it receives all of them, s."""

BUNDLE_SECONDS: Final = 0.25
"""Time between two looks at topics that are taken in bundles, s."""

_LOOK_SECONDS: Final = 0.1

TOPIC_BURST: Final = 5_000_000
TOPIC_RATE: Final = 500_000
"""Bytes of a topic that are recorded, at once and a second, at most; a message that begins within them is whole."""

_TELL_SECONDS: Final = 10.0


def declare_parameters(node: Node) -> tuple[Path, int]:
    """Declare the parameters; return the file to write, and its bytes at most."""
    declare = ParameterDeclarer(node)
    description = f'file to write, which must not exist; empty for one in {USER_DIRECTORY}, named after the time'
    given = declare.text('file', '', description)
    now = datetime.fromtimestamp(time.time(), UTC).strftime('%Y%m%d_%H%M%S')
    size = declare.integer('max_size', MAX_SIZE, 1_000_000, 10**13, 'bytes of the file after which the recording ends')
    return home_path(given or f'{USER_DIRECTORY}/run_{now}.mcap'), size


class Recorder:
    """A recorder that subscribes to the topics of a run and writes their messages as they arrive.

    ``tell_ready`` is called with True once everything that current publishers send is recorded, and with False while
    messages wait for the disk or are no longer recorded. ``also`` gets each recorded message, and its topic. Executor
    thread only.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        writer: RunWriter | Ring,
        tell_ready: Callable[[bool], None],
        max_size: int = MAX_SIZE,
        also: Callable[[str, Received], object] = lambda topic, message: None,
    ) -> None:
        self._runtime, self._writer, self._max_size, self._also = runtime, writer, max_size, also
        self._hears_all = self._waits = self._is_full = False
        self._left_out = 0
        self._messages: list[ReceivedMessages] = []
        self._bundled: list[ReceivedMessages] = []
        self._heard = []
        node = runtime.node
        for name, topic in TOPICS.items():
            writer.add_topic(name, node.resolve_topic_name(name), topic.type, full_definition(topic.type))
            self._heard.append(self.hear(topic.type, name, topic.qos, self._callback_of(name), name in BUNDLED))
        # The last one: a console that knows of it knows of those before, and says a word then.
        self._consoles = PresenceWatch(runtime)
        self._tell_ready = tell_ready
        self._begin = runtime.steady.now()
        self._readiness = node.create_timer(_LOOK_SECONDS, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._take_bundles()

    def hear(
        self, type: str, topic: str, qos: QoSProfile, on_message: Callable[[Received], object], in_bundles: bool
    ) -> Any:
        """Subscribe to a topic, and return the subscription. In bundles, what has come is taken each
        :data:`BUNDLE_SECONDS` only, so that it does not wake the executor for each message.

        Raises what :func:`resolve_type` does.
        """
        kind = resolve_type(type).message
        if kind is None:
            raise LookupError(f'{type} is no message')
        is_awaited = (lambda: False) if in_bundles else None
        messages = ReceivedMessages(
            self._runtime.node, kind, topic, qos, on_message, sys.maxsize, is_awaited=is_awaited
        )
        self._messages.append(messages)
        if in_bundles:
            self._bundled.append(messages)
        return messages.subscription

    def _take_bundles(self) -> None:
        self._runtime.call_near(self._runtime.steady.now() + BUNDLE_SECONDS, BUNDLE_SECONDS / 5.0, self._take_bundles)
        for one in self._bundled:
            one.take()

    def finish(self) -> None:
        """Record what has arrived, and nothing that comes later."""
        for one in self._messages:
            one.take()
        self._is_full = True

    def _look(self) -> None:
        """Report that recording is complete, once all publishers and consoles in the graph have found this node."""
        node = self._runtime.node
        unheard = [one.topic for one in self._heard if one.get_publisher_count() < node.count_publishers(one.topic)]
        consoles = node.count_publishers(names.EXECUTIVE_PRESENCE)
        if unheard or self._consoles.tokens < consoles or self._runtime.steady.now() < self._begin + DISCOVERY_SECONDS:
            return
        self._readiness.cancel()
        self._hears_all = True
        self._tell_ready(not self._waits)

    def _look_at_file(self) -> None:
        problem = self._writer.problem
        if self._waits is (problem is not None):
            return
        self._waits = problem is not None
        tell = self._runtime.node.get_logger()
        if self._waits:
            tell.error(
                f'the recording cannot be written: {problem}; up to {MOST_WAITING // 10**6} MB wait for the disk'
            )
        else:
            tell.info('the recording is written again, and lacks nothing')
        self._tell_ready(self._hears_all and not self._waits)

    def _callback_of(self, topic: str) -> Callable[[Received], None]:
        due, kept = -math.inf, TOPICS[topic]
        bucket = TokenBucket(TOPIC_RATE, TOPIC_BURST, self._runtime.steady.now)

        def on_message(message: Received) -> None:
            nonlocal due
            now = self._runtime.steady.now()
            if self._is_full or now < due or message.size > kept.bytes or message.data is None:
                return
            due = now + kept.period
            if bucket.left <= 0.0:
                self._report_left_out(topic)
                return
            bucket.take(message.size)
            try:
                self._writer.add(topic, bytes(message.data), message.arrived, int(message.sent * 1e9))
            except OSError as error:
                self._end(f'{error}; what was is whole, but for its index')
            else:
                self._look_at_file()
                self._also(topic, message)
                if self._writer.size > self._max_size:
                    self._end(f'the file has more than {self._max_size} bytes (parameter max_size)')

        return on_message

    def _report_left_out(self, topic: str) -> None:
        self._left_out += 1
        self._runtime.node.get_logger().warning(
            f'{pluralize(self._left_out, "message")} not recorded so far, the last of {topic}: more than '
            f'{TOPIC_RATE // 1000} kB a second of one topic',
            throttle_duration_sec=_TELL_SECONDS,
        )

    def _end(self, why: str) -> None:
        self._is_full = True
        self._readiness.cancel()
        self._tell_ready(False)
        self._runtime.fail(f'nothing is recorded any more: {why}')


def setup(runtime: NodeRuntime) -> None:
    """Create the file, and start recording."""
    file, max_size = runtime.call(lambda: declare_parameters(runtime.node))
    writer = RunWriter(file)
    runtime.on_close(lambda: _close(writer, runtime))
    token = LivelinessToken(runtime)
    logger = runtime.node.get_logger()

    def tell_ready(is_ready: bool) -> None:
        token.set_ready(is_ready)
        if is_ready:
            logger.info(f'ready: hears all who are there; records into {file}')

    recorder = runtime.call(lambda: Recorder(runtime, writer, tell_ready, max_size))
    runtime.on_close(lambda: runtime.call(recorder.finish))
    logger.info(f'begins to record into {file}')


def _close(writer: RunWriter, runtime: NodeRuntime) -> None:
    try:
        writer.close()
    except OSError as error:
        runtime.fail(
            f'the recording may lack its end, and has no index: {error}; `replay --recover NEW FILE` makes one'
        )


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, and return the exit code of the process."""
    return run_node(names.RECORDER, setup, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
