# SPDX-License-Identifier: BSD-3-Clause
"""Commands as they come in: from anybody, as many as anybody sends, and of any size.

A stop comes on a topic of its own as well, so that no flood of commands drives it out of a queue. All that has come is
taken at once, and what one process sends above a rate, however many participants it has, or is too large, is dropped
before it is unpacked: so the operators' commands are found among any number of others, and cost and memory stay
bounded. Who goes on with that is ignored by the middleware. A console sends a command again until it is answered.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime, Received, ReceivedMessages, SenderRates, writer_name
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog

COMMAND_RATE: Final = 50.0
"""Commands a second that are taken from one process on average, and as many stops."""

COMMAND_BURST: Final = 100
"""Commands that are taken from one process at once after a quiet time."""

COMMAND_BYTES: Final = 2_000_000
"""Bytes of a command, at most."""

_PROCESSES: Final = 256
_TELL_SECONDS: Final = 10.0

OnCommand = Callable[[ExecutiveCommand, bytes], object]
"""Takes a command and the participant that has sent it; b'' when the middleware does not tell."""


class CommandIntake:
    """Takes commands, or ``only_stops``. Made and used on the executor thread; ``tell`` gets a severity and a line for
    the operators."""

    def __init__(
        self,
        runtime: NodeRuntime,
        on_command: OnCommand,
        tell: Callable[[int, str], None],
        *,
        only_stops: bool = False,
    ) -> None:
        self._runtime = runtime
        self._on_command = on_command
        self._tell = tell
        self._messages: dict[str, ReceivedMessages] = {}
        self._told: dict[bytes, float] = {}  # processes, and until when nothing more is told of each
        commands = () if only_stops else ((names.EXECUTIVE_COMMAND, names.command()),)
        for topic, qos in ((names.EXECUTIVE_STOP, names.stop()), *commands):
            rates = SenderRates(COMMAND_RATE, COMMAND_BURST, runtime.steady.now)
            receive = functools.partial(self._receive, topic, rates)
            self._messages[topic] = ReceivedMessages(
                runtime.node,
                ExecutiveCommand,
                topic,
                qos,
                receive,
                COMMAND_BYTES,
                on_ignored=functools.partial(tell, ExecutiveLog.WARN),
            )

    def _receive(self, topic: str, rates: SenderRates, received: Received) -> None:
        if not rates.allows(received.process):
            self._messages[topic].blame(received)
            self._drop(topic, received, f'it sends more than {COMMAND_RATE:g} a second')
            return
        if received.data is None:
            self._drop(topic, received, f'a command has at most {COMMAND_BYTES} bytes')
            return
        try:
            command = received.unpack(ExecutiveCommand)
        except ValueError as error:
            self._drop(topic, received, f'what it sends is no command: {error}')
            return
        if topic == names.EXECUTIVE_COMMAND or command.kind == ExecutiveCommand.STOP:
            self._on_command(command, received.participant)
        else:
            self._drop(topic, received, f'kind {command.kind} is no STOP, and belongs on {names.EXECUTIVE_COMMAND}')

    def _drop(self, topic: str, received: Received, why: str) -> None:
        """Tell it, once in a while."""
        now, process = self._runtime.steady.now(), received.process
        if now < self._told.get(process, now):
            return
        self._told = {key: until for key, until in self._told.items() if now < until}
        if len(self._told) >= _PROCESSES:
            return
        self._told[process] = now + _TELL_SECONDS
        who = writer_name(self._runtime.node, topic, received.participant) if process else 'somebody'
        self._tell(ExecutiveLog.WARN, f'commands of {who or "a node that is gone"} were dropped: {why}')
