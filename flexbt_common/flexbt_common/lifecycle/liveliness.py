# SPDX-License-Identifier: BSD-3-Clause
"""Liveliness of nodes: a token that a node holds while it works, and a watch that notices its loss within a second.

A token is a publisher on ``<name>/alive``. The node asserts it several times a second, as long as all its threads
answer (see :class:`Health`). The middleware of a watcher receives the assertions without waking Python, and reports
when they stop: at once when the node ends normally, after the lease when the process is killed or a part of it hangs.
(A participant's own lease, on which the action clients' ``server_is_ready`` depends, lasts seconds.)

A watcher distinguishes three states:

- *alive*;
- *late*: the node was silent for the lease, or it reports that a part of it does not answer. It hangs, or its computer
  is busy. Nodes that it controls pause but end nothing, since it may return. A node that the middleware has discovered
  and that has sent nothing is late too: it can send goals before its token arrives (0.5 s were measured), and may be
  stopped or killed meanwhile;
- *gone*: the work that it has started must end. Proofs are that its token was removed, that another process has
  replaced it, or that its process on the watcher's computer no longer exists. A node also counts as gone if it is late
  for longer than the watcher's timeout. A replaced process that sends again has a namesake. Which of the two answers is
  unknown, so the node is late as long as both send.

Alive does not mean ready: a process lives for seconds before the last of its actions and services exists. The message
on the token's topic says whether the node is ready; late subscribers get it too. A node without a message is not ready.

The node asserts the token manually, because only its watchers receive that. Automatic DDS assertions go to every
process of the domain: with 12 robots they were half of the load of an idle executive, and they grow with each robot.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidHandle
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from flexbt_common.discovery import PROFILE
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import implementation, warn_of_losses
from flexbt_common.middleware.received_messages import (
    COMPLAINT_SECONDS,
    UNKNOWN_WRITER,
    Received,
    ReceivedMessages,
    guid_prefix_of,
)
from flexbt_common.names import alive_topic
from flexbt_common.runtime.clock_watch import clock_health
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.text import one_line, sanitize_for_message

from .systemd import SystemdReports

LEASE_SECONDS: Final = 0.5
"""Time after which a watcher notices that the token is no longer asserted, s."""

REPEAT_SECONDS: Final = 1.0
"""Period at which a token also publishes its status, s: it shows that the node is alive if the middleware has not
reported an assertion. (Fast DDS loses some of these events on a busy machine: measured.)

For this long after the discovery of a watcher, the token publishes the status with each assertion: every second watcher
misses an earlier status (measured; Fast DDS over shared memory)."""

PEER_TIMEOUT: Final = 5.0
"""Time after which a late node counts as gone, s of wall time, unless the watcher sets another one."""

PEER_TIMEOUT_TEXT: Final = 'time without a sign of life after which a node counts as gone, s of wall time'
"""Description of the parameter ``peer_timeout`` of nodes that watch others."""

START_SECONDS: Final = 5.0
"""Age of a process up to which it waits for the first assertion of a token, s: if it replaces a killed process, the
other processes cannot reach it for up to 2.5 s (measured; Fast DDS over shared memory)."""

_STARTED: Final = time.monotonic()
"""Time at which this process started, s: this module is loaded early."""

_LOOK_SECONDS: Final = 0.2
"""Period of the check whether the process of a late node exists, s."""

_STATUS_BYTES: Final = 10_000
"""Maximum size of a token's message, bytes; larger ones are dropped."""

_PROBLEM_CHARACTERS: Final = 1_000
"""Maximum number of characters of a problem: a failure may include its whole trace."""

_STATUS_RATE: Final = 50.0
_STATUS_BURST: Final = 100
"""Maximum rate of messages of a participant: per second, and at once."""

_WORDLESS_SECONDS: Final = 3.0 * REPEAT_SECONDS
"""Time for which an assertion counts as a message, s, where the middleware has not reported that assertions stopped."""

_PROCESSES: Final = 16
"""Maximum number of remembered processes that have held a token."""

_PID: Final = 'pid'
_BEGAN: Final = 'began'
_CLOCK: Final = 'clock'
"""The part of a node that is not ready while nothing publishes the simulated time."""


def _qos() -> QoSProfile:
    _check_profile()
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(nanoseconds=int(LEASE_SECONDS * 1e9)),
    )


def has_liveliness_protocol() -> bool:
    """Return whether the middleware of this process reports liveliness; Fast DDS of a console on a radio does not."""
    if implementation() != FAST_DDS:
        return True
    file = Path(os.environ.get(PROFILE, ''))
    return not (file.is_file() and '<use_WriterLivelinessProtocol>false<' in file.read_text(errors='replace'))


def _check_profile() -> None:
    """Check the Fast DDS profile, since Fast DDS would end the process silently.

    Raises:
        RuntimeError: the profile in use turns off the protocol that reports liveliness.
    """
    if not has_liveliness_protocol():
        file = os.environ[PROFILE]
        raise RuntimeError(
            f'{file} turns the liveliness protocol off, which the nodes of a robot need; '
            f'set {PROFILE} to another profile (radio_robot.xml beside radio_console.xml)'
        )


class LivelinessToken:
    """A token that shows that this process is alive, as long as the node exists and all its threads answer.

    All parts of a node share one token, which outlives the part that requests it.
    """

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._held = runtime.call(lambda: runtime.once('liveliness token', _HeldToken))

    def set_ready(self, is_ready: bool, part: str = '', why: str = '') -> None:
        """Report whether the interfaces of the node exist and work, or why not. From any thread.

        A ``part`` may report for itself. The node is ready when all parts that have reported are ready.
        """
        self._held.set_ready(is_ready, part, why)

    def add_name(self, name: str) -> None:
        """Also hold a token for the node ``name`` (fully qualified), which this node replaces. From any thread."""
        self._runtime.call(lambda: self._held.add_name(name))

    def remove_name(self, name: str) -> None:
        """Release the token of ``name``: for its watchers, that node has ended. From any thread."""
        self._runtime.call(lambda: self._held.remove_name(name))


class _HeldToken:
    def __init__(self, runtime: Runtime) -> None:
        self._node = runtime.node
        self._identity = ProcessIdentity.own()
        self._lock = threading.Lock()
        self._unready = {'': ''}  # by part that is not ready: the reason for people, or ''
        self._problem = ''
        self._publishers: dict[str, Any] = {}
        self._said_at = self._watcher_found_at = -math.inf
        self._systemd = SystemdReports()
        warn_of_losses(self._node.get_logger().warning)
        self.add_name(self._node.get_fully_qualified_name())
        self._clock = clock_health(runtime)
        self._clock.add_listener(self._clock_changed)
        runtime.health.on_late(self._tell_late)
        runtime.health.on_beat(self._assert)
        runtime.health.on_beat(self._systemd.beat)
        runtime.on_close(self._systemd.ending)
        runtime.on_close(lambda: self._publish(has_ended=True))

    def add_name(self, name: str) -> None:
        made = self._publishers.get(name)
        if made is None:  # create it without the lock: the clock's thread needs the lock, and all deadlines would wait
            made = self._node.create_publisher(
                DiagnosticStatus,
                alive_topic(name),
                _qos(),
                event_callbacks=PublisherEventCallbacks(matched=self._watcher_found),
            )
        with self._lock:
            self._publishers[name] = made
            self._publish()  # also for watchers that have not noticed the end of the process that this one replaces

    def remove_name(self, name: str) -> None:
        with self._lock:
            publisher = self._publishers.pop(name)
            publisher.publish(self._status(name, has_ended=True))
        self._node.destroy_publisher(publisher)

    def set_ready(self, is_ready: bool, part: str, why: str) -> None:
        with self._lock:
            self._unready.pop(part, None)
            if not is_ready:
                self._unready[part] = why
            self._publish()
        self._systemd.ready(not self._unready)

    def _clock_changed(self) -> None:
        if self._clock.is_missing is not (_CLOCK in self._unready):
            self.set_ready(not self._clock.is_missing, _CLOCK, self._clock.problem)

    def _watcher_found(self, _event: Any) -> None:
        self._watcher_found_at = time.monotonic()

    def _tell_late(self, problem: str) -> None:
        with self._lock:
            self._problem = problem
            self._publish()

    def _publish(self, has_ended: bool = False) -> None:
        self._said_at = time.monotonic()
        for name, publisher in self._publishers.items():
            with contextlib.suppress(InvalidHandle):  # the node is gone
                publisher.publish(self._status(name, has_ended))

    def _status(self, name: str, has_ended: bool) -> DiagnosticStatus:
        level, message = DiagnosticStatus.OK, ''
        if self._unready:
            level, message = DiagnosticStatus.WARN, '; '.join(filter(None, self._unready.values()))
        if self._problem:
            level, message = DiagnosticStatus.STALE, self._problem
        return DiagnosticStatus(
            level=DiagnosticStatus.ERROR if has_ended else level,
            name=name,
            message=sanitize_for_message(message)[:_PROBLEM_CHARACTERS],
            hardware_id=self._identity.host,
            values=[
                KeyValue(key=_PID, value=str(self._identity.pid)),
                KeyValue(key=_BEGAN, value=self._identity.began),
            ],
        )

    def _assert(self) -> None:
        with self._lock:
            now = time.monotonic()
            if now >= self._said_at + REPEAT_SECONDS or now < self._watcher_found_at + REPEAT_SECONDS:
                self._publish()
                return
            for publisher in self._publishers.values():
                with contextlib.suppress(InvalidHandle):
                    publisher.assert_liveliness()


class LivelinessWatch:
    """A watch on the token of the node ``node_name`` (relative to this node's namespace, or fully qualified).

    The executor thread calls ``on_change`` with the new value of :attr:`alive`, ``on_ready`` with that of
    :attr:`ready`, and ``on_late`` with that of :attr:`late`. A node that is gone is not late: ``on_late(False)``
    precedes ``on_change(False)``. ``on_change(True)`` precedes all other calls, except for a discovered but silent
    node, which becomes late, and gone, without having been alive.

    ``timeout`` is the time for which the node may be late before it counts as gone, s of wall time.
    """

    def __init__(
        self,
        runtime: Runtime,
        node_name: str,
        on_change: Callable[[bool], None] = lambda _is_alive: None,
        on_ready: Callable[[bool], None] = lambda _is_ready: None,
        on_late: Callable[[bool], None] = lambda _is_late: None,
        timeout: float = PEER_TIMEOUT,
    ) -> None:
        self.node_name = node_name
        self._runtime = runtime
        self._timeout = timeout
        self._on_change = on_change
        self._on_ready = on_ready
        self._on_late = on_late
        self._was_there = self._told_alive = False
        self._told_ready = False
        self._told_late = False
        self._timed_out = False  # late for too long, until it sends again
        self._end: Timer | None = None
        # On the executor thread, so that no event arrives before the set-up is complete.
        runtime.call(self._open)
        runtime.on_close(self.close)

    def _open(self) -> None:
        topic = self._runtime.node.resolve_topic_name(alive_topic(self.node_name))
        token = self._token = self._runtime.once(_key(topic), lambda runtime: _SeenToken(runtime, topic))
        token.listeners.append(self._tell)
        if token.is_there:
            self._runtime.post(lambda: self._tell() if token.is_there and self._tell in token.listeners else None)

    @property
    def alive(self) -> bool | None:
        """True while the node is alive or late, False after it is gone, None if it was never seen."""
        return False if self._timed_out else self._token.alive

    @property
    def late(self) -> bool:
        """True if a node that is alive or discovered was silent for longer than the lease, or if a part of it hangs."""
        return self._token.late_since is not None and not self._timed_out

    @property
    def silent(self) -> bool:
        """True if the node is silent and not known to have ended: it is late, or was late for too long."""
        return self._token.late_since is not None

    @property
    def age(self) -> float:
        """Time for which a late node has been silent, s of wall time; 0.0 if it is not late."""
        since = self._token.late_since
        return self._runtime.steady.now() - since if self.late and since is not None else 0.0

    @property
    def problem(self) -> str:
        """Problem of a node that is alive or was late for too long, as text for people; '' if it is ready, or if the
        problem is unknown."""
        if self._timed_out:
            return self._token.problem
        if self.late:
            if not self.alive:
                return 'it was found, and has not been heard yet'
            return self._token.problem or 'it hangs, was stopped, or its computer is busy'
        return self._token.why_unready or 'it is starting, or inactive' if self.alive and not self.ready else ''

    @property
    def ready(self) -> bool:
        """True if the node is alive, not late, and has reported that it is ready."""
        return self.alive is True and not self.late and self._token.says_ready

    def has_ended(self, writer: bytes) -> bool:
        """Return whether a writer of this node, on any topic, belongs to a process that has certainly ended. The
        middleware reports that only after the lease of the participant."""
        process = self._token.process_of(writer)
        return process is not None and process.has_ended()

    def is_held_by(self, process: ProcessIdentity) -> bool:
        """Return whether the node is alive and is this process."""
        return self.alive is True and self._token.holder == process

    def is_gone_process(self, process: ProcessIdentity) -> bool:
        """Return whether a process of this node's name counts as gone: it has ended, was replaced, or is late for too
        long. A process that has not sent yet does not count as gone.
        """
        is_late = self._timed_out and self._token.holder == process
        return is_late or self._token.has_left(process) or process.has_ended()

    def is_gone(self, writer: bytes) -> bool:
        """Return whether a writer of this node, on any topic, belongs to a process that counts as gone: it has ended,
        was replaced, or is late for too long. A process that has not sent yet does not count as gone.
        """
        process = self._token.process_of(writer)
        return process is not None and (self.alive is False or self.is_gone_process(process))

    def close(self) -> None:
        """Stop watching and calling. From any thread."""
        self._runtime.post(self._close)

    def _close(self) -> None:
        self._runtime.cancel_on_close(self.close)
        self._keep_time(None)
        if self._tell in self._token.listeners:
            self._token.listeners.remove(self._tell)
            self._token.release()

    def _tell(self) -> None:
        since = self._token.late_since
        self._timed_out = self._timed_out and since is not None
        self._keep_time(since if self.late else None)
        if not self.late:
            self._tell_late()
        is_there = self._token.is_there and not self._timed_out
        if self.alive and not self._told_alive:
            self._told_alive = True
            self._on_change(True)
        elif self._was_there and not is_there:
            self._told_alive = False
            self._on_change(False)
        self._was_there = is_there
        self._tell_late()
        if self.ready is not self._told_ready:
            self._told_ready = not self._told_ready
            self._on_ready(self._told_ready)

    def _tell_late(self) -> None:
        if self.late is not self._told_late:
            self._told_late = not self._told_late
            self._on_late(self._told_late)

    def _keep_time(self, late_since: float | None) -> None:
        if (late_since is None) is (self._end is None):
            return
        if self._end is not None:
            self._end.cancel()
            self._end = None
        if late_since is not None:
            self._end = self._runtime.post_at(late_since + self._timeout, self._on_timeout)

    def _on_timeout(self) -> None:
        if self._end is not None:
            self._timed_out = True
            self._tell()


class _SeenToken:
    """The state of a token for its watchers on one node.

    All watchers share one subscription. It stays as long as it has watchers and as long as the token is alive: Fast DDS
    does not report to a later subscription that the token is already asserted, and then counts wrongly.
    """

    def __init__(self, runtime: Runtime, topic: str) -> None:
        self.topic = topic
        self.alive: bool | None = None
        self._unheard = False  # discovered, but it has sent nothing yet
        self.late_since: float | None = None
        self.says_ready = False
        self.why_unready = ''
        self.problem = self._hang = ''
        self.listeners: list[Callable[[], None]] = []
        self.holder: ProcessIdentity | None = None
        self._processes: OrderedDict[bytes, ProcessIdentity] = OrderedDict()  # by participant
        self._left: OrderedDict[ProcessIdentity, None] = OrderedDict()  # replaced, or gone, and not heard since
        self._namesakes: dict[ProcessIdentity, float] = {}  # with the times of their last messages
        self._is_asserted = False
        self._heard_at = self._silent_since = 0.0
        self._runtime = runtime
        self._timer: Timer | None = None
        try:
            self._messages = self._subscribe(liveliness=self._liveliness_changed, matched=self._matched)
        except UnsupportedEventTypeError:  # Zenoh; the messages show the same, later
            self._messages = self._subscribe(matched=self._matched)

    def _subscribe(self, **callbacks: Callable[[Any], None]) -> ReceivedMessages:
        return ReceivedMessages(
            self._runtime.node,
            DiagnosticStatus,
            self.topic,
            _qos(),
            self._receive,
            _STATUS_BYTES,
            event_callbacks=SubscriptionEventCallbacks(**callbacks),
            rates=SenderRates(_STATUS_RATE, _STATUS_BURST, self._runtime.steady.now),
        )

    @property
    def is_there(self) -> bool:
        """True if the token is alive or was discovered."""
        return self.alive is True or self._unheard

    def process_of(self, writer: bytes) -> ProcessIdentity | None:
        """Return the process of a writer, on any topic; None if it has sent no message with its token."""
        return self._processes.get(guid_prefix_of(writer))

    def has_left(self, process: ProcessIdentity) -> bool:
        """Return whether a process has held the token, and was replaced or is gone."""
        return process in self._left

    def _receive(self, received: Received) -> None:
        try:
            status = received.checked(DiagnosticStatus)
        except ValueError as error:
            logger = self._runtime.node.get_logger()
            logger.error(f'{self.topic}: ignored: {one_line(str(error))}', throttle_duration_sec=COMPLAINT_SECONDS)
            return
        identity = _identity_of(status)
        if received.participant != UNKNOWN_WRITER:
            self._processes[received.participant] = identity
            self._processes.move_to_end(received.participant)
            if len(self._processes) > _PROCESSES:
                self._processes.popitem(last=False)
        self._on_status(status, identity)

    def _on_status(self, status: DiagnosticStatus, identity: ProcessIdentity) -> None:
        now = self._runtime.steady.now()
        holder = self.holder if self.alive else None
        if status.level == DiagnosticStatus.ERROR:
            if self.is_there and holder in (None, identity):
                self._leave()
            elif self._namesakes.pop(identity, None) is not None:
                self._review()
            return
        if holder is not None and identity != holder:
            if identity in self._left and now < self._heard_at + _WORDLESS_SECONDS and not holder.has_ended():
                self._namesakes[identity] = now
                self._review()
                return
            self._leave()  # before it was missed
            if not self.listeners:
                return  # no watcher was left
        if not self.alive and not self._is_asserted:
            self._await_first_word()
        hangs = status.level == DiagnosticStatus.STALE
        if not (hangs or self._namesakes or self._is_asserted):
            self._silent_since = max(self._silent_since, now + REPEAT_SECONDS)
        self._heard_at = now
        self.alive, self._unheard, self.holder = True, False, identity
        self._left.pop(identity, None)
        self.says_ready = status.level == DiagnosticStatus.OK
        self._hang = status.message if hangs else ''
        self.why_unready = '' if hangs else status.message
        self._review()

    def _several(self) -> str:
        """Return the problem while several processes claim the token, or ''."""
        since = self._runtime.steady.now() - _WORDLESS_SECONDS
        self._namesakes = {
            one: heard for one, heard in self._namesakes.items() if heard > since and not one.has_ended()
        }
        if not self._namesakes or self.holder is None:
            return ''
        found = sorted(f'{one.pid}{"" if one.is_here else " elsewhere"}' for one in (self.holder, *self._namesakes))
        return f'{len(found)} nodes have this name: end all but one of the processes {", ".join(found)}'

    def _await_first_word(self) -> None:
        self._silent_since = max(self._runtime.steady.now(), ProcessIdentity.started() + START_SECONDS - LEASE_SECONDS)

    def _matched(self, event: Any) -> None:
        if event.current_count > 0:
            if event.total_count_change > 0 and not self.alive:
                self._unheard, self._heard_at = True, self._runtime.steady.now()
                self._await_first_word()
                self._review()
            return
        if not self.is_there:
            return
        if self.holder is not None and self.holder.is_here:
            self._is_asserted = False  # it may only have been stopped for longer than the middleware waits
            self._review()
        else:
            self._leave()

    def _liveliness_changed(self, event: Any) -> None:
        is_asserted = event.alive_count > 0
        if self._is_asserted and not is_asserted:
            self._silent_since = self._runtime.steady.now() - LEASE_SECONDS
        self._is_asserted = is_asserted
        # After the message of the assertion: a report that a part hangs also asserts the token.
        self._runtime.post(self._review)

    def _leave(self) -> None:
        if self.holder is not None:
            self._left[self.holder] = None
            if len(self._left) > _PROCESSES:
                self._left.popitem(last=False)
        self.alive, self._unheard, self.holder = False, False, None
        self._namesakes.clear()
        self.late_since, self.says_ready = None, False
        self.problem = self._hang = ''
        self._inform()
        self.release()

    def release(self) -> None:
        """Stop listening if no watcher is left and the token is not alive."""
        if not self.listeners and not self.alive:
            self._unheard = False  # ends the reviews
            self._runtime.forget(_key(self.topic))
            self._runtime.node.destroy_subscription(self._messages.subscription)

    def _review(self) -> None:
        """Update whether the node is late, and whether it is gone."""
        if not self.is_there:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        now = self._runtime.steady.now()
        problem = self._hang or self._several()
        if problem and not self.problem:
            self._silent_since = now - LEASE_SECONDS
        self.problem = problem
        late_from = self._silent_since + LEASE_SECONDS
        if self._is_asserted and not self.problem:
            late_from = max(late_from, self._heard_at + _WORDLESS_SECONDS)
        if now < late_from:
            self.late_since = None
            next_look = late_from
        elif self.holder is not None and self.holder.has_ended():
            self._leave()
            return
        else:
            self.late_since = late_from - LEASE_SECONDS if self.late_since is None else self.late_since
            next_look = now + _LOOK_SECONDS
        self._timer = self._runtime.post_at(next_look, self._review)
        self._inform()

    def _inform(self) -> None:
        for listener in list(self.listeners):
            listener()


def _key(topic: str) -> Hashable:
    """Return the key of a seen token for :meth:`Runtime.once`."""
    return 'liveliness', topic


def _identity_of(status: DiagnosticStatus) -> ProcessIdentity:
    values = {value.key: value.value for value in status.values}
    pid = values.get(_PID, '')
    return ProcessIdentity(status.hardware_id, int(pid) if pid.isdecimal() else 0, values.get(_BEGAN, ''))


# The identity of a process and its computer, and the check whether a process on this computer has ended.

_BOOT_ID: Final = Path('/proc/sys/kernel/random/boot_id')
_PID_NAMESPACE: Final = Path('/proc/self/ns/pid')
_STATE, _START_TIME = 0, 19  # fields 3 and 22 of proc_pid_stat(5), counted after the name


@dataclass(frozen=True)
class ProcessIdentity:
    """The identity of a process. ``host`` identifies the computer, its boot, and the namespace in which ``pid`` is
    valid; '' if that is not known. ``began`` distinguishes the process from others with the same number.
    """

    host: str
    pid: int
    began: str

    def __str__(self) -> str:
        return f'{self.host} {self.pid} {self.began}'

    @staticmethod
    def parse(text: str) -> ProcessIdentity:
        """Return the identity that ``str`` has written.

        Raises:
            ValueError: the text is not an identity.
        """
        host, pid, began = text.rsplit(' ', 2)
        return ProcessIdentity(host, int(pid), began)

    @staticmethod
    def own() -> ProcessIdentity:
        """Return the identity of this process."""
        pid = os.getpid()
        try:
            return _own(pid)
        except OSError:  # not Linux
            return ProcessIdentity('', pid, '')

    @staticmethod
    def started() -> float:
        """Return the time at which this process started, s of the steady clock."""
        return _STARTED

    @property
    def is_here(self) -> bool:
        """True if the process is on this computer, so that its end can be detected."""
        return bool(self.host) and self.host == ProcessIdentity.own().host

    def has_ended(self) -> bool:
        """Return whether the process has certainly ended."""
        if not self.is_here:
            return False
        try:
            fields = _stat(str(self.pid))
        except (FileNotFoundError, ProcessLookupError):
            return True
        except OSError:  # unknown, for example if this process has no file descriptor left
            return False
        return fields[_START_TIME] != self.began or fields[_STATE] in ('Z', 'X')


@functools.lru_cache(maxsize=1)
def _own(pid: int) -> ProcessIdentity:
    """Return the identity of the process ``pid``, the cache key: a fork is another process with another number."""
    host = f'{_BOOT_ID.read_text().strip()} {_PID_NAMESPACE.readlink()}'
    return ProcessIdentity(host, pid, _stat('self')[_START_TIME])


def _stat(process: str) -> list[str]:
    # The name of the program is in brackets and may contain any characters.
    return Path('/proc', process, 'stat').read_text().rpartition(')')[2].split()
