# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``recorder``: writes what a robot and its operators say to each other into an MCAP file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rclpy.node import Node

from flexbt_common.cli import USER_DIRECTORY, home_path
from flexbt_common.runtime import NodeRuntime, ParameterDeclarer, run_node
from flexbt_common.values import resolve_type

from .run_file import RunWriter
from .topics import TOPICS

NODE_NAME: Final = 'recorder'


def declare_parameters(node: Node) -> Path:
    """Declare the parameters; gives the file to write."""
    description = f'file to write, which must not exist; empty for one in {USER_DIRECTORY}, named after the time'
    given = ParameterDeclarer(node).text('file', '', description)
    now = datetime.now(UTC).strftime('%Y%m%d_%H%M%S')
    return home_path(given or f'{USER_DIRECTORY}/run_{now}.mcap')


class Recorder:
    """Subscribes to the topics of a run and writes their messages as they come."""

    def __init__(self, runtime: NodeRuntime, writer: RunWriter) -> None:
        self._runtime = runtime
        self._writer = writer
        self._is_full = False
        node = runtime.node
        for name, topic in TOPICS.items():
            writer.add_topic(name, node.resolve_topic_name(name), topic.type)
            type = resolve_type(topic.type).message
            assert type is not None, 'topics have messages'
            node.create_subscription(type, name, self._hear(name), topic.qos, raw=True)

    def _hear(self, topic: str) -> Callable[[bytes, Mapping[str, int]], None]:
        def on_message(data: bytes, info: Mapping[str, int]) -> None:
            if self._is_full:
                return
            try:
                self._writer.add(topic, bytes(data), time.time_ns(), info['source_timestamp'])
            except OSError as error:
                self._is_full = True
                self._runtime.node.get_logger().error(f'nothing is recorded any more: {error}')

        return on_message


def setup(runtime: NodeRuntime) -> None:
    """Make the file, and begin."""
    file = runtime.call(lambda: declare_parameters(runtime.node))
    writer = RunWriter(file)
    runtime.on_close(writer.close)
    runtime.call(lambda: Recorder(runtime, writer))
    runtime.node.get_logger().info(f'records into {file}')


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; gives the exit code of the process."""
    return run_node(NODE_NAME, setup, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
