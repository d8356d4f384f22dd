# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``replay``: publishes a recorded run, so that the console shows it without a robot.

Commands are not published again, and those of a console find nobody. Each status says that it is one of a replay.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rclpy.duration import Duration

from flexbt_common import names
from flexbt_common.command_line import SuggestingArgumentParser, run_program
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.value_types import resolve_type
from flexbt_console.commands.operator_values import full_namespace
from flexbt_console.errors import ConsoleError, ExitCode, NoLinkError, UsageError
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import one_line

from .player import received
from .run_file import DAMAGED, going_on, read_run, recover_run
from .topics import NOT_REPLAYED, TOPICS, check_definition

DISCOVERY_SECONDS: Final = 1.0
"""Time for which a real executive is searched for before anything is published, s."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Replay a file and return the exit code."""
    return run_program('replay', lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    try:
        if options.recover is not None:
            print(one_line(f'{options.recover}: {recover_run(options.file, options.recover)} messages'))
        else:
            replay(options.file, rate=options.rate, namespace=options.namespace, start=options.start)
    except ConsoleError as error:
        print(one_line(f'replay: {error}'), file=sys.stderr)
        return error.exit_code
    return ExitCode.OK


def _parser() -> argparse.ArgumentParser:
    parser = SuggestingArgumentParser(prog='replay', description='Publish a recorded run for the console.')
    parser.add_argument('file', metavar='FILE', type=Path, help='MCAP file of the recorder')
    parser.add_argument('--rate', type=_rate, default=1.0, help='times as fast as it was (default: 1)')
    parser.add_argument('--start', metavar='SECONDS', type=_start, default=0.0, help='what was before is shown at once')
    parser.add_argument('--namespace', metavar='NAME', default='', help='namespace in which it is published')
    parser.add_argument(
        '--recover',
        metavar='NEW',
        type=Path,
        help='publish nothing; write what can be read of FILE, whose recorder was killed, into a whole file',
    )
    return parser


def _rate(text: str) -> float:
    rate = finite_number(text)
    if rate is None or rate <= 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a factor above 0')
    return rate


def _start(text: str) -> float:
    start = finite_number(text)
    if start is None or start < 0.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a time from 0 on, s')
    return start


def replay(file: Path, *, rate: float = 1.0, namespace: str = '', start: float = 0.0) -> int:
    """Publish a run without statuses that cannot be read, and return the number of messages.

    Raises:
        UsageError: the file cannot be used.
        NoLinkError: a real executive is there, which must not be mixed up with a recorded one.
    """

    def tell_damage() -> None:
        print(one_line(f'replay: {file}: {DAMAGED}'), file=sys.stderr)

    known = TOPICS.keys() - NOT_REPLAYED  # a black box records others, too
    messages = (one for one in going_on(read_run(file, tell_damage)) if one.topic in known)
    first = next(messages, None)
    if first is None:
        raise UsageError(f'{file}: has no messages of a run')
    with NodeRuntime.open('replay', namespace=full_namespace(namespace)) as runtime:
        stage = _Stage(runtime, f'replay of {file.name}')
        stage.refuse_executives()
        begin = runtime.steady.now() - start / rate
        count = 0
        for one in itertools.chain([first], messages):
            stage.wait_until(begin + (one.time - first.time) * 1e-9 / rate)
            with contextlib.suppress(ValueError):
                stage.publish(one)
                count += 1
        stage.flush()
    return count


class _Stage:
    """The publishers of a replay, made as they are needed; ``mark`` is shown with each status."""

    def __init__(self, runtime: NodeRuntime, mark: str) -> None:
        self._runtime = runtime
        self._wake_event = WakeEvent()
        self._mark = mark
        self._publishers: dict[str, Any] = {}

    def refuse_executives(self) -> None:
        """Raise NoLinkError if a status is published here."""
        node = self._runtime.node
        topic = node.resolve_topic_name(names.EXECUTIVE_STATUS)
        self.wait_until(self._runtime.steady.now() + DISCOVERY_SECONDS)
        if node.count_publishers(topic):
            raise NoLinkError(f'an executive publishes {topic} already; choose another --namespace or ROS_DOMAIN_ID')

    def wait_until(self, time: float) -> None:
        """Sleep until a time of the steady clock."""
        while self._runtime.steady.now() < time:
            self._wake_event.wait(self._runtime.steady, time)

    def publish(self, message: Any) -> None:
        """Publish the bytes of a message.

        Raises:
            UsageError: its type is not what is installed.
            ValueError: it is a status that cannot be read.
        """
        publisher = self._publishers.get(message.topic)
        if publisher is None:
            publisher = self._publishers[message.topic] = self._publisher(message)
        shown = self._marked(publisher.msg_type, message)
        self._runtime.call(lambda: publisher.publish(shown))

    def _marked(self, type: Any, message: Any) -> Any:
        if message.topic != names.EXECUTIVE_STATUS:
            return message.data
        status = received(message).unpack(type)
        status.message = f'{self._mark}: {status.message}' if status.message else self._mark
        return status

    def flush(self) -> None:
        """Wait until the subscribers have received everything."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=1))

    def _publisher(self, message: Any) -> Any:
        check_definition(message.topic, message.type, message.definition)
        node, qos = self._runtime.node, TOPICS[message.topic].qos
        type = resolve_type(message.type).message
        return self._runtime.call(lambda: node.create_publisher(type, message.topic, qos))


if __name__ == '__main__':
    sys.exit(main())
