# SPDX-License-Identifier: BSD-3-Clause
"""The executive's side of the operator link: topics to the consoles, and commands from them.

Whoever joins late, and whoever has lost messages, has the whole picture with the next message: status, structure and
behaviors are complete and latched.
"""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Mapping
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.runtime import COMPLAINT_SECONDS, NodeRuntime, Received, ReceivedMessages, SenderRates, writer_name
from flexbt_common.values import LONG_TEXT, make_sendable
from flexbt_core.values import Place, one_line, sendable
from flexbt_msgs.msg import (
    BehaviorList,
    BehaviorStructure,
    DecisionSubjects,
    ExecutiveLog,
    ExecutiveStatus,
    PlaceList,
)
from flexbt_msgs.msg import Place as PlaceMessage

from .command_intake import CommandIntake, OnCommand

PING_BYTES: Final = 1_000
"""Bytes of a ping, at most; a larger one is not echoed."""

PING_RATE: Final = 50.0
PING_BURST: Final = 100
"""Pings of one process that are echoed: a second, and at once."""


class OperatorLink:
    """The topics of one executive; nothing is heard before :meth:`listen`."""

    def __init__(self, runtime: NodeRuntime, executive_id: str, heartbeat_period: float) -> None:
        self._runtime = runtime
        self._executive_id = executive_id
        self._heartbeat_period = heartbeat_period
        self._status_sequence = 0
        self._log_sequence = 0
        self._log_lock = threading.Lock()
        node = runtime.node
        self._status = node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, names.latched())
        self._subjects = node.create_publisher(DecisionSubjects, names.EXECUTIVE_SUBJECTS, names.latched())
        self._subjects_sent: list[tuple[str, int]] | None = None
        self._structure = node.create_publisher(BehaviorStructure, names.EXECUTIVE_STRUCTURE, names.latched())
        self._behaviors = node.create_publisher(BehaviorList, names.EXECUTIVE_BEHAVIORS, names.latched())
        self._places = node.create_publisher(PlaceList, names.PLACES, names.latched())
        self._log = node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, names.latched(names.LOG_DEPTH))
        # The time of sending of the echo, with that of the ping, tells a console how late a status may be.
        self._echo = node.create_publisher(Header, names.EXECUTIVE_PONG, names.unacknowledged())
        self._ping_rates = SenderRates(PING_RATE, PING_BURST, runtime.steady.now)
        self._pings = ReceivedMessages(
            node,
            Header,
            names.EXECUTIVE_PING,
            names.unacknowledged(),
            self._on_ping,
            PING_BYTES,
            on_ignored=functools.partial(self.log, ExecutiveLog.WARN),
        )

    def _on_ping(self, ping: Received) -> None:
        if not self._ping_rates.allows(ping.process):
            self._pings.blame(ping)
            return
        try:
            self._echo.publish(ping.unpack(Header))
        except ValueError as error:
            logger = self._runtime.node.get_logger()
            logger.error(
                f'{names.EXECUTIVE_PING}: left aside: {one_line(str(error))}', throttle_duration_sec=COMPLAINT_SECONDS
            )

    def listen(self, on_command: OnCommand) -> None:
        """Take commands from now on; ``on_command`` is called on the executor thread."""
        CommandIntake(self._runtime, on_command, self.log)

    def node_of(self, participant: bytes) -> str:
        """The node of a participant that can command; '' when there is none (any more)."""
        return writer_name(self._runtime.node, names.EXECUTIVE_COMMAND, participant)

    def publish_status(self, status: ExecutiveStatus) -> None:
        """Send a status; fills in sender, sequence, time and heartbeat period. On the executor thread."""
        self._status_sequence += 1
        status.stamp = self._runtime.clock.stamp()
        status.executive_id = self._executive_id
        status.sequence = self._status_sequence
        status.heartbeat_period = self._heartbeat_period
        make_sendable(status)
        self._status.publish(status)

    def publish_subjects(self, subjects: DecisionSubjects) -> bool:
        """Send what the decisions of the next status are about, if it has changed; whether it has. On the executor
        thread."""
        sent = [(subject.id, subject.number) for subject in subjects.subjects]
        if sent == self._subjects_sent:
            return False
        self._subjects_sent = sent
        subjects.executive_id = self._executive_id
        make_sendable(subjects)
        self._subjects.publish(subjects)
        return True

    def publish_structure(self, structure: BehaviorStructure) -> None:
        """Send the structure of a run, before the run's first status."""
        make_sendable(structure)
        self._structure.publish(structure)

    def publish_behaviors(self, behaviors: BehaviorList) -> None:
        """Send the list of behaviors."""
        behaviors.executive_id = self._executive_id
        make_sendable(behaviors)
        self._behaviors.publish(behaviors)

    def publish_places(self, places: Mapping[str, Place]) -> None:
        """Send the places that the robot knows by name."""
        message = PlaceList(
            places=[PlaceMessage(name=name, pose=_pose(place)) for name, place in sorted(places.items())]
        )
        make_sendable(message)
        self._places.publish(message)

    def log(self, severity: int, text: str, path: str = '', run_id: str = '') -> None:
        """Tell the operator a line, and the node's own log as well; from any thread."""
        text = sendable(text, LONG_TEXT)
        stamp = self._runtime.clock.stamp()  # without the lock: to ask for the time may call others
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
                make_sendable(message)
                self._log.publish(message)
        except InvalidHandle:
            return  # the executive has ended; a run was left behind
        _log_to_node(self._runtime.node, severity, f'{path}: {text}' if path else text)


def _pose(place: Place) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = place.frame
    pose.pose.position.x, pose.pose.position.y = place.x, place.y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(place.yaw / 2.0), math.cos(place.yaw / 2.0)
    return pose


def _log_to_node(node: Node, severity: int, line: str) -> None:
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
