# SPDX-License-Identifier: BSD-3-Clause
"""A bridge between a world in one process and the middleware, so that a console can operate a robot of the world.

The program is the end on the middleware; the world has the other one. Each hears topics of the operator link, and
publishes what the other one has heard. The services of a robot (userdata, blackboards) are not bridged.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, Final

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.value_types import resolve_type
from flexbt_console.recording.topics import NOT_REPLAYED, TOPICS, Topic

_HEADER: Final = 'std_msgs/msg/Header'

OF_ROBOT: Final[Mapping[str, Topic]] = {
    **{name: topic for name, topic in TOPICS.items() if name not in NOT_REPLAYED},
    names.EXECUTIVE_PONG: Topic(_HEADER, names.best_effort_qos()),
}
"""What consoles hear."""

OF_OPERATOR: Final[Mapping[str, Topic]] = {
    names.EXECUTIVE_COMMAND: TOPICS[names.EXECUTIVE_COMMAND],
    names.EXECUTIVE_STOP: TOPICS[names.EXECUTIVE_STOP],
    names.EXECUTIVE_PING: Topic(_HEADER, names.best_effort_qos()),
    names.EXECUTIVE_PRESENCE: Topic('flexbt_msgs/msg/PeerStatus', names.best_effort_qos()),
}
"""What consoles publish."""


class BridgeEnd:
    """The topics of one end, for the robots of these namespaces. Executor thread only."""

    def __init__(
        self,
        node: Any,
        robots: Sequence[str],
        heard: Mapping[str, Topic],
        told: Mapping[str, Topic],
        send: Callable[[tuple[str, bytes]], object],
    ) -> None:
        self._publishers: dict[str, Any] = {}
        for robot in robots:
            for name, topic in told.items():
                full = names.of_robot(f'/{robot}', name)
                kind = resolve_type(topic.type).message
                self._publishers[full] = node.create_publisher(kind, full, topic.qos)
            for name, topic in heard.items():
                full = names.of_robot(f'/{robot}', name)
                kind = resolve_type(topic.type).message
                node.create_subscription(kind, full, partial(_forward, send, full), topic.qos, raw=True)

    def publish(self, message: tuple[str, bytes]) -> None:
        """Publish what the other end has heard: name of the topic, and the message in CDR."""
        topic, data = message
        self._publishers[topic].publish(data)


def _forward(send: Callable[[tuple[str, bytes]], object], topic: str, data: bytes) -> None:
    with contextlib.suppress(OSError):  # the other end has left
        send((topic, data))


def main(words: Sequence[str]) -> int:
    """Bridge until the world ends: the descriptor of its connection, and the namespaces of its robots."""
    connection = Connection(int(words[0]))
    with NodeRuntime.open('world_bridge') as runtime:
        end = runtime.call(lambda: BridgeEnd(runtime.node, words[1:], OF_OPERATOR, OF_ROBOT, connection.send))
        with contextlib.suppress(EOFError):
            while True:
                message = connection.recv()
                runtime.call(partial(end.publish, message))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
