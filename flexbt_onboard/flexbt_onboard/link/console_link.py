# SPDX-License-Identifier: BSD-3-Clause
"""The executive's side of the operator link: topics to the consoles, and a bounded intake of commands from any sender.

Status, structure and behaviors are complete and latched: a console that joins late or has lost messages is up to date
with the next message.
"""

from __future__ import annotations

import functools
import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, Received, ReceivedMessages, writer_name
from flexbt_common.runtime.health import SETTLE_SECONDS
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import LONG_TEXT, sanitize_message
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.places import Place
from flexbt_core.values.text import one_line, sanitize_for_message
from flexbt_msgs.msg import (
    BehaviorList,
    BehaviorStructure,
    DecisionSubjects,
    ExecutiveCommand,
    ExecutiveLog,
    ExecutiveStatus,
    MissionQueue,
    PlaceList,
)
from flexbt_msgs.msg import Place as PlaceMessage

PING_BYTES: Final = 1_000
"""Maximum bytes of a ping; a larger one is not echoed."""

PING_RATE: Final = 50.0
PING_BURST: Final = 100
"""Maximum number of echoed pings of one process: per second, and at once."""


class ConsoleLink:
    """The topics of one executive. It receives no commands before :meth:`listen`."""

    def __init__(self, runtime: Runtime, executive_id: str, heartbeat_period: float) -> None:
        self._runtime = runtime
        self._executive_id = executive_id
        self._heartbeat_period = heartbeat_period
        self._status_sequence = 0
        self._log_sequence = 0
        self._log_lock = threading.Lock()
        node = runtime.node
        self._publishers = {
            type: node.create_publisher(type, topic, names.transient_local_qos())
            for type, topic in (
                (ExecutiveStatus, names.EXECUTIVE_STATUS),
                (DecisionSubjects, names.EXECUTIVE_SUBJECTS),
                (MissionQueue, names.EXECUTIVE_QUEUE),
                (BehaviorStructure, names.EXECUTIVE_STRUCTURE),
                (BehaviorList, names.EXECUTIVE_BEHAVIORS),
                (PlaceList, names.PLACES),
            )
        }
        self._subjects_sent: list[tuple[str, int]] | None = None
        self._queue_sent: MissionQueue | None = None
        self._log = node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, names.transient_local_qos(names.LOG_DEPTH))
        # From the times when ping and echo were sent, a console estimates how late a status may be.
        self._echo = node.create_publisher(Header, names.EXECUTIVE_PONG, names.best_effort_qos())
        ReceivedMessages(
            node,
            Header,
            names.EXECUTIVE_PING,
            names.best_effort_qos(),
            self._on_ping,
            PING_BYTES,
            on_ignored=functools.partial(self.log, ExecutiveLog.WARN),
            rates=SenderRates(PING_RATE, PING_BURST, runtime.steady.now),
        )

    def _on_ping(self, ping: Received) -> None:
        try:
            self._echo.publish(ping.unpack(Header))
        except ValueError as error:
            logger = self._runtime.node.get_logger()
            logger.error(
                f'{names.EXECUTIVE_PING}: ignored: {one_line(str(error))}', throttle_duration_sec=COMPLAINT_SECONDS
            )

    def listen(self, on_command: OnCommand) -> None:
        """Start to receive commands; ``on_command`` is called on the executor thread."""
        CommandIntake(self._runtime, on_command, self.log)

    def node_of(self, participant: bytes) -> str:
        """Return the node of a participant that can send commands; '' if none is known, or it is gone."""
        return writer_name(self._runtime.node, names.EXECUTIVE_COMMAND, participant)

    def publish_status(self, status: ExecutiveStatus) -> None:
        """Send a status; fill in sender, sequence, time and heartbeat period. On the executor thread."""
        self._status_sequence += 1
        status.stamp = self._runtime.clock.stamp()
        status.sequence = self._status_sequence
        status.heartbeat_period = self._heartbeat_period
        self.publish(status)

    def publish_subjects(self, subjects: DecisionSubjects) -> bool:
        """Send the subjects of the decisions in the next status if they changed; return whether they did.
        On the executor thread."""
        sent = [(subject.id, subject.number) for subject in subjects.subjects]
        if sent == self._subjects_sent:
            return False
        self._subjects_sent = sent
        self.publish(subjects)
        return True

    def publish_queue(self, queue: MissionQueue) -> None:
        """Send the mission queue if it is another object than before. On the executor thread."""
        if queue is not self._queue_sent:
            self._queue_sent = queue
            self.publish(queue)

    def publish(self, message: Any) -> None:
        """Send the structure of a run, before the run's first status; or the list of behaviors."""
        if hasattr(message, 'executive_id'):
            message.executive_id = self._executive_id
        sanitize_message(message)
        self._publishers[type(message)].publish(message)

    def publish_places(self, places: Mapping[str, Place]) -> None:
        """Send the places that the robot knows by name."""
        known = [PlaceMessage(name=name, pose=_pose(place)) for name, place in sorted(places.items())]
        self.publish(PlaceList(places=known))

    def log(self, severity: int, text: str, path: str = '', run_id: str = '') -> None:
        """Send a line to the operators, and write it to the node's log. From any thread."""
        text = sanitize_for_message(text, LONG_TEXT)
        stamp = self._runtime.clock.stamp()  # without the lock: reading the clock may call other code
        try:
            with self._log_lock:  # numbers are published in their order
                self._log_sequence += 1
                message = ExecutiveLog(
                    stamp=stamp,
                    sequence=self._log_sequence,
                    executive_id=self._executive_id,
                    run_id=run_id,
                    severity=severity,
                    path=path,
                    text=text,
                )
                sanitize_message(message)
                self._log.publish(message)
        except InvalidHandle:
            return  # the executive has ended; a run was left behind
        log_to_node(self._runtime.node, severity, f'{path}: {text}' if path else text)


def _pose(place: Place) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = place.frame
    pose.pose.position.x, pose.pose.position.y = place.x, place.y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(place.yaw / 2.0), math.cos(place.yaw / 2.0)
    return pose


def log_to_node(node: Node, severity: int, line: str) -> None:
    """Write a line to the log of a node; ``severity`` is one of ExecutiveLog."""
    logger = node.get_logger()
    # rclpy's logger refuses two severities from one place of the code.
    if severity >= ExecutiveLog.ERROR:
        logger.error(line)
    elif severity == ExecutiveLog.WARN:
        logger.warning(line)
    elif severity == ExecutiveLog.DEBUG:
        logger.debug(line)
    else:
        logger.info(line)


# Commands as they come in: from anybody, as many as anybody sends, and of any size.
#
# A stop also has a separate topic, so that no flood of commands drives it out of a queue. All that has come is taken at
# once, and what one process sends above a rate, however many participants it has, or is too large, is dropped before it
# is unpacked: so the operators' commands are found among any number of others, and cost and memory stay bounded. The
# middleware ignores a participant that continues to exceed them. A console sends a command again until it is answered.

COMMAND_RATE: Final = 50.0
"""Maximum average commands per second from one process; the same limit applies to stops."""

COMMAND_BURST: Final = 100
"""Maximum commands from one process at once after a quiet time."""

COMMAND_BYTES: Final = 2_000_000
"""Maximum bytes of a command."""

_PROCESSES: Final = 256
_TELL_SECONDS: Final = 10.0

OnCommand = Callable[[ExecutiveCommand, bytes, float], object]
"""A receiver of a command, of the participant that sent it (b'' if the middleware does not report it), and of the time
of its arrival on the steady clock, s."""


class CommandIntake:
    """A receiver of commands, or ``only_stops``. Made and used on the executor thread; ``tell`` gets a severity and a
    line for the operators.

    Commands, except stops, that come as the process goes on after a long stop are dropped: operators may have been told
    long ago that there was no answer. A console that still waits for one sends it again.
    """

    def __init__(
        self,
        runtime: Runtime,
        on_command: OnCommand,
        tell: Callable[[int, str], None],
        *,
        only_stops: bool = False,
    ) -> None:
        self._runtime = runtime
        self._on_command = on_command
        self._tell = tell
        self._messages: dict[str, ReceivedMessages] = {}
        self._told: dict[bytes, float] = {}  # processes, and until when nothing more is reported of each
        commands = () if only_stops else ((names.EXECUTIVE_COMMAND, names.command_qos()),)
        for topic, qos in ((names.EXECUTIVE_STOP, names.stop_qos()), *commands):
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
        if received.is_oversized:
            self._drop(topic, received, f'a command has at most {COMMAND_BYTES} bytes')
            return
        try:
            command = received.unpack(ExecutiveCommand)
        except ValueError as error:
            self._drop(topic, received, f'what it sends is not a command: {error}')
            return
        is_stop = command.kind == ExecutiveCommand.STOP
        if not is_stop and self._runtime.steady.now() < self._runtime.health.returned_at + SETTLE_SECONDS:
            self._drop(topic, received, 'they may have waited while the executive was stopped; give them again')
        elif topic == names.EXECUTIVE_COMMAND or is_stop:
            waited = max(0.0, time.time() - received.arrived * 1e-9)
            self._on_command(command, received.participant, self._runtime.steady.now() - waited)
        else:
            self._drop(topic, received, f'kind {command.kind} is not a STOP, and belongs on {names.EXECUTIVE_COMMAND}')

    def _drop(self, topic: str, received: Received, why: str) -> None:
        """Report a dropped command, at most once in ``_TELL_SECONDS`` for each process."""
        now, process = self._runtime.steady.now(), received.process
        if now < self._told.get(process, now):
            return
        self._told = {key: until for key, until in self._told.items() if now < until}
        if len(self._told) >= _PROCESSES:
            return
        self._told[process] = now + _TELL_SECONDS
        who = writer_name(self._runtime.node, topic, received.writer) if process else 'somebody'
        self._tell(ExecutiveLog.WARN, f'commands of {who or "a node that is gone"} were dropped: {why}')
