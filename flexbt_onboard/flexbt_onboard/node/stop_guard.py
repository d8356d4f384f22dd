# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``stop_guard``: a small process that stops the robot when the executive does not answer a STOP.

It receives the STOPs of operators on a separate topic. If the executive does not report within :data:`GRACE_SECONDS`
that it has applied one, because it hangs or is dead, the guard cancels all goals that move the robot, no matter who
sent them, and commands zero velocity. It keeps the robot stopped, and repeats the STOP to the executive, until an
executive has applied it. From then on the executive is responsible for the stop, and the next start works as usual. If
it ends or hangs within :data:`FOLLOW_SECONDS`, before it has stopped everything, the STOP counts as unanswered. The
guard needs neither the executive nor a simulator, and runs alongside Nav2 on a real robot.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import uuid
from collections import OrderedDict
from typing import Any, Final, NamedTuple

from rclpy.event_handler import PublisherEventCallbacks

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import LargeQueueNode, NodeRuntime, run_node
from flexbt_common.values.limits import sanitize_message
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import RepeatedReports, SenderRates
from flexbt_core.values.text import one_line
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus, StopGuardStatus
from flexbt_onboard.commands.command_bounds import COMMAND_LENGTHS
from flexbt_onboard.link.console_link import CommandIntake, log_to_node
from flexbt_onboard.link.robot_state import RobotPose
from flexbt_onboard.runs.motion_stop import MotionParameters, MotionStop

from .executive_parameters import declare_motion

GRACE_SECONDS: Final = 0.15
"""Time within which the executive must confirm a STOP, s. After it, the guard stops the robot itself."""

FOLLOW_SECONDS: Final = 1.5
"""Time after the answer to a STOP within which the guard takes over from an executive that ends or hangs, s. The
executive's cancels take up to half a second, and its end shows after the lease of its token."""

PRIORITY: Final = -10
"""Nice value of the process, if the system allows values below 0, so that it is scheduled early on a busy computer."""

REPEAT_SECONDS: Final = 0.5
"""Time between two status messages, and between two STOPs to the executive, while the guard holds the robot, s."""

STATUS_RATE: Final = 100.0
STATUS_BURST: Final = 200
"""Maximum number of statuses taken from one process: per second, and at once. An executive sends 20 per second."""

STATUS_BYTES: Final = 4_000_000
"""Maximum bytes of a status of the executive."""

STATUS_DEPTH: Final = 20
"""Depth of the queue of statuses from all participants. Others must not displace those of the executive."""

TELL_SECONDS: Final = 0.05
"""Delay before a further STOP is reported, s, since many may arrive at once."""

_OPEN_STOPS: Final = 32
"""Maximum number of unanswered STOPs that are remembered. Beyond it, the robot is still held."""

_KNOWN_STOPS: Final = 1024


class GuardNode(LargeQueueNode):
    """A node without parameter services: its parameters keep their values from the start.

    Unpacking a request for 200,000 parameters takes seconds, in which the node would receive no STOP.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, start_parameter_services=False, **options)


class _AppliedStop(NamedTuple):
    """The newest STOP that an executive has applied, its id, its run then, and until when the guard follows it."""

    stop: ExecutiveCommand
    executive_id: str
    run_id: str
    until: float


class StopGuard:
    """The guard on one node. Made and used on the executor thread."""

    def __init__(self, runtime: NodeRuntime, parameters: MotionParameters) -> None:
        self._runtime = runtime
        self._id = uuid.uuid4().hex
        self._sequence = 0
        self._open: OrderedDict[str, ExecutiveCommand] = OrderedDict()  # STOPs that no executive has applied, in order
        self._known: OrderedDict[str, None] = OrderedDict()
        self._carried_out: OrderedDict[str, None] = OrderedDict()
        self._applied: _AppliedStop | None = None
        self._timer: Timer | None = None
        self._is_told_soon = False
        self._reports = RepeatedReports(COMPLAINT_SECONDS, runtime.steady.now)
        self._is_reported = False  # the log has that the guard holds the robot
        self._newest: Received | None = None  # newest status of the executive
        node = runtime.node
        self._status = node.create_publisher(StopGuardStatus, names.STOP_GUARD_STATUS, names.transient_local_qos())
        self._stops = node.create_publisher(
            ExecutiveCommand,
            names.EXECUTIVE_STOP,
            names.stop_qos(),
            # A new executive gets the STOP before an operator can start a behavior.
            event_callbacks=PublisherEventCallbacks(matched=lambda _: self._repeat()),
        )
        self._motion = MotionStop(
            runtime,
            ServiceLinks(runtime),
            RobotPose(runtime, parameters.pose_topic, parameters.frames),
            parameters,
        )
        self._motion.prepare()
        ReceivedMessages(
            node,
            ExecutiveStatus,
            names.EXECUTIVE_STATUS,
            names.transient_local_qos(STATUS_DEPTH),
            self._on_status,
            STATUS_BYTES,
            rates=SenderRates(STATUS_RATE, STATUS_BURST, runtime.steady.now),
        )
        LivelinessWatch(
            runtime,
            names.ONBOARD_EXECUTIVE,
            on_change=lambda is_alive: None if is_alive else self._executive_has_gone(),
            on_late=lambda is_late: self._take_over() if is_late else None,
        )
        CommandIntake(runtime, self._on_stop, functools.partial(log_to_node, node), only_stops=True)
        LivelinessToken(runtime).set_ready(True)
        self._publish()
        # Log once now, since the first log call is slow: rclpy looks up the caller in the sources of all modules.
        runtime.node.get_logger().info(f'ready; guards {", ".join(parameters.motion_actions)}')

    @property
    def is_open(self) -> bool:
        """True while the guard waits for an executive to apply a STOP. From any thread."""
        return bool(self._open)

    def _on_stop(self, stop: ExecutiveCommand, _writer: bytes, _arrived: float) -> None:
        """Handle a STOP of an operator: a new one, a resend, or one that the guard has repeated itself."""
        stop_id = str(stop.id)
        if not 0 < len(stop_id) <= COMMAND_LENGTHS['id']:
            stop.id = stop_id = uuid.uuid4().hex  # apply the STOP anyway, although its result cannot be reported
        if stop_id in self._known:
            return
        operator = one_line(stop.operator_id, COMMAND_LENGTHS['operator_id'])
        self._add(
            ExecutiveCommand(
                id=stop_id,
                stamp=stop.stamp,
                kind=ExecutiveCommand.STOP,
                operator_id=operator,
                run_id=stop.run_id[: COMMAND_LENGTHS['run_id']],
                reason=stop.reason[: COMMAND_LENGTHS['reason']],
            )
        )
        if len(self._open) > _OPEN_STOPS:
            self._open.popitem(last=False)
        if self._timer is None:
            self._repeat()  # the console may not have discovered or reached the executive
            self._motion.prepare()  # for servers that have started since
            self._timer = self._runtime.post_in(GRACE_SECONDS, self._hold)
        elif self._motion.is_holding and not self._is_told_soon:
            self._is_told_soon = True
            self._plan(TELL_SECONDS)
        self._take_answers()  # the answer may have arrived before the STOP

    def _add(self, stop: ExecutiveCommand) -> None:
        stop_id = str(stop.id)
        self._open[stop_id], self._known[stop_id] = stop, None
        while len(self._known) > _KNOWN_STOPS:
            self._known.popitem(last=False)

    def _add_anew(self, stop: ExecutiveCommand) -> None:
        """Add a STOP under another id: the next executive may know the result of the old one from its journal."""
        stop.id = uuid.uuid4().hex
        self._add(stop)

    def _on_status(self, received: Received) -> None:
        self._newest = received
        if self._open or self._applied is not None:
            self._take_answers()

    def _take_answers(self) -> None:
        if self._newest is None:
            return
        try:
            status = self._newest.unpack(ExecutiveStatus)
        except ValueError as error:
            text = f'{names.EXECUTIVE_STATUS}: ignored: {one_line(str(error))}'
            self._runtime.node.get_logger().error(text, throttle_duration_sec=COMPLAINT_SECONDS)
            return
        followed = self._applied
        if followed is not None and status.executive_id != followed.executive_id:
            self._take_over()
        elif followed is not None and (status.run_id != followed.run_id or self._runtime.steady.now() > followed.until):
            self._applied = None  # a run that has begun since may move the robot
        applied = {result.command_id for result in status.results if result.code == CommandResult.APPLIED}
        answered = next((stop_id for stop_id in reversed(self._open) if stop_id in applied), None)
        if answered is None:
            return
        until = self._runtime.steady.now() + FOLLOW_SECONDS
        self._applied = _AppliedStop(self._open[answered], status.executive_id, status.run_id, until)
        while answered in self._open:  # an executive that has applied a STOP has applied those before it
            self._open.popitem(last=False)
        if not self._open:
            self._release()

    def _take_over(self) -> None:
        """Carry out the STOP that an executive has just applied: it has ended, or hangs."""
        applied, self._applied = self._applied, None
        if applied is None or self._runtime.steady.now() > applied.until:
            return
        self._add_anew(applied.stop)
        self._hold()

    def _executive_has_gone(self) -> None:
        """Ask the next executive for all that this one has not answered, or has just applied."""
        waiting = list(self._open.values())
        self._open.clear()
        for stop in waiting:
            self._add_anew(stop)
        self._take_over()

    def _hold(self) -> None:
        self._motion.hold()
        self._carry_out()

    def _report(self) -> None:
        """Log once that the guard holds the robot. If answers to STOPs are repeatedly late, log it less often."""
        if self._is_reported or self._reports.held_before('hold') is None:
            return
        self._is_reported = True
        who = self._latest.operator_id or 'nobody'
        self._runtime.node.get_logger().error(
            f'STOP of {who!r}: the executive has not answered, or has ended since. The stop guard keeps the robot at '
            'rest until an executive answers'
        )

    def _carry_out(self) -> None:
        """Note that the guard carries out the unanswered STOPs, report it, and repeat the STOP to the executive."""
        for stop_id in self._open:
            self._carried_out[stop_id] = None
        while len(self._carried_out) > _OPEN_STOPS:
            self._carried_out.popitem(last=False)
        self._is_told_soon = False
        self._report()
        self._publish()
        self._repeat()
        self._plan(REPEAT_SECONDS)

    def _plan(self, seconds: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._runtime.post_in(seconds, self._carry_out)

    def _repeat(self) -> None:
        if self._open:
            self._stops.publish(self._latest)

    def _release(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._is_told_soon = False
        if self._motion.is_holding:
            self._motion.drop_cancels()
            self._motion.release()
            if self._is_reported:
                self._is_reported = False
                self._runtime.node.get_logger().info(
                    'an executive has applied the STOP: the stop guard lets the robot go'
                )
            self._publish()

    @property
    def _latest(self) -> ExecutiveCommand:
        return self._open[next(reversed(self._open))]

    def _publish(self) -> None:
        """Send a status on each change, and periodically while holding the robot, so that its death is noticed."""
        is_holding = self._motion.is_holding
        operator = self._latest.operator_id if is_holding else ''
        going_on = sorted({*self._motion.going_on.values()}) if is_holding else []
        self._sequence += 1
        status = StopGuardStatus(
            stamp=self._runtime.clock.stamp(),
            guard_id=self._id,
            sequence=self._sequence,
            holding=is_holding,
            operator_id=operator,
            results=[CommandResult(command_id=one, code=CommandResult.APPLIED) for one in self._carried_out],
            going_on=going_on,
        )
        sanitize_message(status)
        self._status.publish(status)


def open_stop_guard(runtime: NodeRuntime) -> StopGuard:
    """Make the guard from the parameters of the node."""
    return runtime.call(lambda: StopGuard(runtime, declare_motion(runtime.node)))


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code of the process."""
    with contextlib.suppress(OSError):  # without permission, keep the default priority
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    return run_node(names.STOP_GUARD, open_stop_guard, args, GuardNode, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
