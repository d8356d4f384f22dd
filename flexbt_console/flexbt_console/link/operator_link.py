# SPDX-License-Identifier: BSD-3-Clause
"""The console's side of the operator link: topics into the mirror, and commands out of it."""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final, TypeVar

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received, ReceivedMessages, writer_name
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.pace import Pace
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import seconds_of
from flexbt_console.errors import NoAnswerError, NoLinkError, RefusedError
from flexbt_console.mirror.command_tracker import LONGEST_RESEND, CommandState, TrackedCommand
from flexbt_console.mirror.mirror import Change, Mirror, Transit
from flexbt_console.mirror.records import (
    CommandKind,
    OperatorCommand,
    Synthesis,
    SynthesisRequest,
    TreeBlackboard,
    UserdataScope,
)
from flexbt_console.mirror.view import View
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.text import one_line
from flexbt_msgs import msg

from .executive_sender import ExecutiveSender, Succession, interface_problem, senders_problem
from .messages import command_message, record_of
from .robot_link import RobotLink

if TYPE_CHECKING:
    from .queries import SynthesisQuery
    from .surroundings_link import SurroundingsLink

T = TypeVar('T')

MESSAGE_BYTES: Final = 16_000_000
"""Maximum bytes of a message of the executive."""

PONG_BYTES: Final = 1_000

STATUS_RATE: Final = 100.0
"""Maximum average rate of statuses accepted from one process, 1/s: five times the rate of an executive."""

STATUS_BURST: Final = 200
"""Maximum number of statuses accepted from one process at once after a quiet time."""

STATUS_DEPTH: Final = 20
"""Depth of the queue of statuses, from all participants: others must not drive the executive's own out."""

LIST_DEPTH: Final = 4
"""Depth of the queue of topics that are latched once, such as places, from all participants."""

STATUS_BYTES: Final = 4_000_000
"""Maximum bytes of a status."""

GUARD_RATE: Final = 20.0
GUARD_BURST: Final = 100
GUARD_BYTES: Final = 100_000
"""Limits of the messages of the stop guard, as of the status: it sends some bytes when it stops the robot."""

REPORT_SECONDS: Final = 10.0
"""Time between two lines about messages that cannot be read, s."""


class ExecutiveLink(RobotLink):
    """A link that feeds a mirror from an executive's topics, and sends the mirror's commands until they are answered.

    The link only moves messages: what they mean is the mirror's business. A command is sent as soon as the
    executive's subscription is discovered, and again with the same identifier until there is an answer.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        mirror: Mirror,
        operator: str | None = '',
        namespace: str = '',
        *,
        only_status: bool = False,
    ) -> None:
        """Join the topics; ``mirror`` has to use the runtime's steady clock, ``operator`` is the user.

        None is an observer, who is not reported as present, and cannot send commands, as if not allowed to.
        ``namespace`` is that of the robot, by default the node's own. With ``only_status`` nothing else is subscribed
        to until :meth:`hear_all`: one among many robots costs little, whatever it sends.
        """
        self._only_status = only_status
        self._pace = Pace(runtime)
        self._is_closed = False
        self._namespace = namespace
        self._operator = operator
        self._synthesis: SynthesisQuery | None = None
        self._surroundings: SurroundingsLink | None = None
        self._surrounded = 0
        self._status_topic = self._topic(names.EXECUTIVE_STATUS)
        self._command_topic = self._topic(names.EXECUTIVE_COMMAND)
        self._runtime = runtime
        self.mirror = mirror
        self._waiting: set[SimpleQueue[None]] = set()
        self._waits_end = False
        self._resend: Timer | None = None
        self._executives = 0
        self._reachable = False
        self._id = uuid.uuid4().hex
        self._epoch = time.time() - mirror.now()
        self._heard = 0.0
        self._picture: list[ReceivedMessages] = []
        self._sender = ExecutiveSender(
            lambda participant: bool(writer_name(runtime.node, self._status_topic, participant)),
            lambda: mirror.is_silent(runtime.listening_time.handled - self._heard),
            runtime.steady.now,
        )
        self._status_rates = SenderRates(STATUS_RATE, STATUS_BURST, runtime.steady.now)
        mirror.add_listener(self._note_change)
        runtime.on_close(self._end_waits)
        runtime.call(lambda: self._join(gives_commands=operator is not None))
        # The executive detects by this whether anybody watches, and whether the holder of the authority does.
        self._presence = PresenceToken(runtime, operator, namespace) if operator is not None else None

    def close(self) -> None:
        """Leave the topics: stop receiving from this robot and commanding it. Executor thread only."""
        node = self._runtime.node
        self._is_closed = True
        self._runtime.cancel_on_close(self._end_waits)
        self._end_waits()
        self._leave_picture()
        node.destroy_subscription(self._pongs.subscription)
        node.destroy_subscription(self._guards.subscription)
        node.destroy_subscription(self._incidents.subscription)
        node.destroy_publisher(self._pings)
        if self._resend is not None:
            self._resend.cancel()
            self._resend = None
        if self._presence is not None:
            self._presence.close()
            node.destroy_publisher(self._stops)
            node.destroy_publisher(self._commands)

    def hear_all(self) -> None:
        """Subscribe to the executive's topics other than its status, too. Executor thread only."""
        if self._only_status:
            self._only_status = False
            self._hear_picture()

    def send(self, command: OperatorCommand, timeout: float, label: str = '') -> TrackedCommand:
        """Send a command, called ``label``, to the executive; the mirror follows its result. From any thread."""

        def send() -> None:
            if command.kind is CommandKind.STOP:  # from this thread: the executor may be busy with what others send
                self._publish(command)
            self._runtime.post(self._send_due)

        return self.mirror.give(command, timeout, label, send)

    def wait_for(
        self, inspect: Callable[[View], T | None], timeout: float | None, every: float | None = None
    ) -> T | None:
        """Wait until ``inspect`` returns a true value for the view, and return it; None after ``timeout`` seconds, or
        when the node ends.

        It is called after each change, also when the picture gets stale, and at least every ``every`` seconds if
        that is given. Not on the executor thread.
        """
        clock = self._runtime.steady
        deadline = None if timeout is None else clock.now() + timeout
        # Not a condition: the exception of a signal handler at any point would leave it without its lock.
        changed: SimpleQueue[None] = SimpleQueue()
        self._waiting.add(changed)
        try:
            while True:
                found = inspect(self.mirror.view())
                if found is not None:
                    return found
                now = clock.now()
                if self._waits_end or (deadline is not None and now >= deadline):
                    return None
                times = (deadline, self.mirror.next_link_change(), None if every is None else now + every)
                limits = [time for time in times if time is not None]
                with contextlib.suppress(Empty):
                    changed.get(timeout=max(0.0, min(limits) - now) if limits else None)
        finally:
            self._waiting.discard(changed)

    def live_view(self, timeout: float) -> View:
        """Return the view as soon as it is live.

        Raises:
            NoLinkError: it was not live within ``timeout`` seconds, also of sleep; the message reports what is known.
        """
        until = self.mirror.now() + timeout
        view = self.wait_for(lambda view: view if view.live else None, timeout)
        if view is None:
            raise NoLinkError(no_link_text(self.mirror.view(), f'within {timeout:g} s'))
        if self.mirror.now() > until:
            raise NoLinkError(f'no link within {timeout:g} s: this computer or process stood still; try again')
        return view

    def settled(self, command_id: str, timeout: float) -> TrackedCommand | None:
        """Wait for the answer to a command, or its timeout."""

        def settled(_: View) -> TrackedCommand | None:
            tracked = self.mirror.command(command_id)
            return None if tracked is None or tracked.state is CommandState.PENDING else tracked

        return self.wait_for(settled, timeout)

    def userdata(self, path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
        """See :class:`RobotLink`. Raises what :func:`.queries.userdata` raises."""
        from .queries import userdata  # what only this command needs

        return userdata(self._runtime, self._namespace, path, keys, timeout)

    def blackboard(self, run_id: str, keys: Sequence[str], timeout: float) -> TreeBlackboard:
        """See :class:`RobotLink`. Raises what :func:`.queries.blackboard` raises."""
        from .queries import blackboard  # what only this command needs

        return blackboard(self._runtime, self._namespace, run_id, keys, timeout)

    def write_incident(self, timeout: float) -> str:
        """See :class:`RobotLink`. Raises what :func:`.queries.write_incident` raises."""
        from .queries import write_incident  # what only this command needs

        return write_incident(self._runtime, self._namespace, timeout)

    def synthesis(
        self, request: SynthesisRequest, timeout: float, tell: Callable[[str], None], left: Future[None] | None = None
    ) -> Synthesis:
        """See :class:`RobotLink`. Raises what :meth:`SynthesisQuery.ask` raises, and RefusedError for an observer."""
        return self._synthesis_query().ask(request, timeout, tell, left)

    def cancel_synthesis(self, timeout: float) -> int:
        """See :class:`RobotLink`. Raises what :meth:`SynthesisQuery.cancel` does, and RefusedError for an observer."""
        return self._synthesis_query().cancel(timeout)

    def surroundings(self, has_arrived: Callable[[View], bool], timeout: float, scan_period: float = 0.0) -> View:
        """See :class:`RobotLink`. All of it is received meanwhile only, unless it is shown: :meth:`open_surroundings`.

        Raises:
            NoAnswerError: the console itself is too busy to listen.
        """
        try:
            self.open_surroundings(scan_period)
            try:
                return self.wait_for(lambda view: view if has_arrived(view) else None, timeout) or self.mirror.view()
            finally:
                self.close_surroundings()
        except TimeoutError as error:
            raise NoAnswerError(f'the console is too busy to listen to trees and map: {error}') from error

    def open_surroundings(self, scan_period: float = 0.0) -> None:
        """Receive trees, map, plan and scan until :meth:`close_surroundings` was called equally often.

        The first caller sets the period of the scan. Not on the executor thread. Raises TimeoutError when that thread
        is busy for too long.
        """
        from .surroundings_link import SurroundingsLink  # what only this needs

        def open() -> None:
            if self._surroundings is None:
                self._surroundings = SurroundingsLink(self._runtime, self.mirror, self._namespace, scan_period)
            self._surrounded += 1

        self._runtime.call(open)

    def close_surroundings(self) -> None:
        """See :meth:`open_surroundings`. From any thread; it waits for nothing."""

        def close() -> None:
            self._surrounded -= 1
            if self._surrounded == 0 and self._surroundings is not None:
                link, self._surroundings = self._surroundings, None
                link.close()
                self.mirror.forget_surroundings()

        self._runtime.post(close)

    def _synthesis_query(self) -> SynthesisQuery:
        from .queries import SynthesisQuery  # what only this command needs

        if self._operator is None:
            raise RefusedError('an observer cannot synthesize; omit --observer')
        operator = self._operator

        def query() -> SynthesisQuery:
            if self._synthesis is None:
                self._synthesis = SynthesisQuery(self._runtime, self._namespace, operator)
            return self._synthesis

        return self._runtime.call(query)

    def _join(self, gives_commands: bool) -> None:
        node = self._runtime.node
        # The statuses of all robots that nobody has opened share a pace; other messages have a separate one.
        self._pace_of_others: Pace = self._runtime.once('robots that nobody has opened', Pace)
        self._hear_picture()
        quick, latched = names.best_effort_qos(), names.transient_local_qos(LIST_DEPTH)
        rates = SenderRates(GUARD_RATE, GUARD_BURST, self._runtime.steady.now)
        guard, pong = self._topic(names.STOP_GUARD_STATUS), self._topic(names.EXECUTIVE_PONG)
        self._pings = node.create_publisher(Header, self._topic(names.EXECUTIVE_PING), quick)
        self._guards = ReceivedMessages(
            node, msg.StopGuardStatus, guard, latched, self._on_guard, GUARD_BYTES, rates=rates
        )
        self._pongs = ReceivedMessages(node, Header, pong, quick, self._on_pong, PONG_BYTES)
        self._incidents = ReceivedMessages(
            node, DiagnosticArray, self._topic(names.INCIDENTS), latched, self._on_incidents, GUARD_BYTES, rates=rates
        )
        if gives_commands:
            self._open_commands()

    def _hear_picture(self) -> None:
        """Subscribe to the status, and to the executive's other topics: again, if they were received before."""
        if self._is_closed:
            return
        node = self._runtime.node
        self._leave_picture()
        # Messages that wake the executor together are handled in this order: a state reports something, and then wants
        # something.
        mirror = self.mirror
        for type, name, receive, depth in (
            (msg.BehaviorStructure, names.EXECUTIVE_STRUCTURE, mirror.receive_structure, LIST_DEPTH),
            (msg.BehaviorList, names.EXECUTIVE_BEHAVIORS, mirror.receive_behaviors, LIST_DEPTH),
            (msg.PlaceList, names.PLACES, mirror.receive_places, LIST_DEPTH),
            (msg.DecisionSubjects, names.EXECUTIVE_SUBJECTS, mirror.receive_subjects, LIST_DEPTH),
            (msg.MissionQueue, names.EXECUTIVE_QUEUE, mirror.receive_queue, LIST_DEPTH),
            (msg.ExecutiveEvents, names.EXECUTIVE_EVENTS, mirror.receive_events, names.EVENTS_DEPTH),
            (msg.ExecutiveLog, names.EXECUTIVE_LOG, mirror.receive_log, names.LOG_DEPTH),
        ):
            if not self._only_status:
                topic, qos = self._topic(name), names.transient_local_qos(depth)
                read, awaited = self._forward(type, topic, receive), self._pace.is_over
                messages = ReceivedMessages(node, type, topic, qos, read, MESSAGE_BYTES, is_awaited=awaited)
                self._picture.append(messages)
        self._statuses = ReceivedMessages(
            node,
            msg.ExecutiveStatus,
            self._status_topic,
            names.transient_local_qos(STATUS_DEPTH),
            self._on_status,
            STATUS_BYTES,
            event_callbacks=SubscriptionEventCallbacks(matched=self._on_status_matched),
            is_awaited=self._pace_of_others.is_over if self._only_status else None,
        )
        self._picture.append(self._statuses)

    def _leave_picture(self) -> None:
        for one in self._picture:
            self._runtime.node.destroy_subscription(one.subscription)
        self._picture.clear()

    def _open_commands(self) -> None:
        commands = names.command_qos()
        # The middleware must not deliver after an interruption a command that was reported to the operator as
        # unanswered.
        commands.lifespan = Duration(nanoseconds=int(LONGEST_RESEND * 1e9))
        stops = names.stop_qos()
        stops.lifespan = commands.lifespan
        self._stops = self._runtime.node.create_publisher(
            msg.ExecutiveCommand,
            self._topic(names.EXECUTIVE_STOP),
            stops,
            event_callbacks=PublisherEventCallbacks(matched=self._on_stop_matched),
        )
        self._commands = self._runtime.node.create_publisher(
            msg.ExecutiveCommand,
            self._command_topic,
            commands,
            event_callbacks=PublisherEventCallbacks(matched=self._on_command_matched),
        )

    def _topic(self, name: str) -> str:
        return names.of_robot(self._namespace, name)

    def _forward(self, message_type: Any, topic: str, receive: Callable[[Any], object]) -> Callable[[Received], None]:
        def on_message(received: Received) -> None:
            if not self._sender.has_sent(received.participant):
                return  # several senders are reported when they appear, see _find_problems
            with self._pace.work():
                message = self._unpacked(received, message_type, topic)
                if message is not None:
                    receive(record_of(message))

        return on_message

    def _unpacked(self, received: Received, message_type: Any, topic: str) -> Any | None:
        """Return a decoded message; None if it is invalid or exceeds the limits."""
        try:
            message = received.unpack(message_type)
            check_limits(message)
        except (ValueError, LimitExceededError) as error:
            text = f'{topic}: ignored: {one_line(str(error))}'
            self._runtime.node.get_logger().error(text, throttle_duration_sec=REPORT_SECONDS)
            return None
        return message

    def _on_status(self, received: Received) -> None:
        with self._pace_of_others.work() if self._only_status else contextlib.nullcontext():
            self._take_status(received)

    def _take_status(self, received: Received) -> None:
        participant = received.participant
        if received.writer != UNKNOWN_WRITER and not self._status_rates.allows(received.process):
            self._statuses.blame(received)
            return
        answers = not self._sender.has_sent(participant)
        unanswered = self.mirror.passed_over_stops() if answers else frozenset()
        if answers and not unanswered:
            return
        message = self._unpacked(received, msg.ExecutiveStatus, self._status_topic)
        if message is None or (answers and unanswered.isdisjoint(one.command_id for one in message.results)):
            return
        succession = self._sender.follow(participant, answers=answers)
        if succession is not Succession.SAME:
            self.mirror.sender_replaced(was_executive=succession is Succession.NEXT)
            self._runtime.post(self._hear_picture)  # messages that it sent before it was known were lost
        self._heard = self._runtime.listening_time.looked
        transit = Transit(received.sent, self._own_time()) if received.sent > 0.0 else None
        self.mirror.receive_snapshot(record_of(message), transit)
        if self.mirror.wants_ping():
            seconds, nanoseconds = divmod(int(self._own_time() * 1e9), 10**9)
            self._pings.publish(Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=self._id))

    def _own_time(self) -> float:
        """Return the time on this computer's wall clock, s, as if nobody had set it since the link was created."""
        return self._epoch + self.mirror.now()

    def _on_guard(self, received: Received) -> None:
        message = self._unpacked(received, msg.StopGuardStatus, names.STOP_GUARD_STATUS)
        if message is not None:
            self.mirror.receive_guard(record_of(message))

    def _on_incidents(self, received: Received) -> None:
        message = self._unpacked(received, DiagnosticArray, names.INCIDENTS)
        if message is not None:
            self.mirror.receive_incidents(record_of(message))

    def _on_pong(self, received: Received) -> None:
        with contextlib.suppress(ValueError):  # not from the executive
            echo = received.unpack(Header)
            if echo.frame_id == self._id and received.sent > 0.0:
                self.mirror.receive_pong(received.sent - seconds_of(echo.stamp))

    def _on_status_matched(self, status: Any) -> None:
        self._executives = status.current_count
        if self._executives == 0:
            self.mirror.sender_gone()
        self._find_problems()

    def _on_stop_matched(self, status: Any) -> None:
        if status.total_count_change > 0:
            self.mirror.send_stops_again()
            self._send_due()

    def _on_command_matched(self, status: Any) -> None:
        self._reachable = status.current_count > 0
        self._send_due()
        self._find_problems()

    def _find_problems(self) -> None:
        node = self._runtime.node
        self.mirror.set_problem(
            interface_problem(node, self._status_topic)
            or interface_problem(node, self._command_topic)
            or senders_problem(node, self._status_topic, self._executives)
        )

    def _send_due(self) -> None:
        try:
            for command in self.mirror.due_commands(self._reachable):
                self._publish(command)
        finally:  # whatever one of them has, time-outs are noted, and what is due later is sent
            self._plan_resend()

    def _publish(self, command: OperatorCommand) -> None:
        """Send a command. What fails is reported, and does not keep others back."""
        # A STOP also has a separate topic, which no flood of commands fills.
        publishers = (self._stops, self._commands) if command.kind is CommandKind.STOP else (self._commands,)
        for publisher in publishers:
            try:
                message = command_message(command, time.time())
                if self._is_wanted(command):
                    publisher.publish(message)
            except Exception as error:
                self._runtime.report_fault(error, f'sending {command.kind.name}')

    def _is_wanted(self, command: OperatorCommand) -> bool:
        """Return whether a command is still to be sent: not if a STOP was given since it was due."""
        tracked = self.mirror.command(command.id)
        return command.kind is CommandKind.STOP or (tracked is not None and tracked.state is CommandState.PENDING)

    def _plan_resend(self) -> None:
        if self._resend is not None:
            self._resend.cancel()
            self._resend = None
        due = self.mirror.next_command_time(self._reachable)
        if due is not None:
            self._resend = self._runtime.post_at(due, self._send_due)

    def _end_waits(self) -> None:
        self._waits_end = True
        self._note_change(Change.LINK)

    def _note_change(self, change: Change) -> None:
        for changed in tuple(self._waiting):
            if changed.empty():
                changed.put(None)


def no_link_text(view: View, when: str) -> str:
    """Reason why there is no link, and the remedy."""
    if view.problem:
        return f'no link: {view.problem}'
    held = f'. {view.guard.told}' if view.guard.told else ''
    if view.snapshot is None:
        return (
            f'no link: no executive was heard {when}{held}. Is it running, in the same namespace '
            '(--namespace) and the same ROS_DOMAIN_ID?'
        )
    return f'no link: the executive was last heard {view.age or 0.0:.1f} s ago, and not again {when}{held}'
