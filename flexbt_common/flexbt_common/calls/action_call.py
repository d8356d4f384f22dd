# SPDX-License-Identifier: BSD-3-Clause
"""One goal sent to an action server, with deadlines and exactly one outcome, and the shared connections to servers.

With rclpy alone, a caller waits forever if no server exists, if the server dies, if an answer is lost in an outage, or
if a goal is canceled before it is accepted. Here each of these ends with an outcome in bounded time, and no goal keeps
running without an owner:

- The call sends the goal when the server is available, and fails if the server does not appear.
- An acceptance also counts if only the server's list of goals shows it: the answer to the first goal after start-up is
  lost if the server has not discovered this client yet.
- A cancel before the acceptance is sent on acceptance. A goal accepted after the deadline is canceled too.
- The call watches the server from the moment it sends the goal. The goal is lost when the liveliness token of the
  server's node shows that its process has ended, was replaced, or is late for too long (:mod:`.links`). For a server
  without a token, the graph shows whether it exists. If it is gone longer than an outage may last, the goal is lost.
  When it returns, the call requests the result again. A server that no longer knows the goal answers with status 0,
  and the goal is lost.
- A server whose node hangs has not lost the goal: it may continue at any time. The call waits while the node is late,
  and sends a cancel when it is late for too long. If the goal was canceled without a timeout, the call waits until the
  process of the server is known to have ended, because the caller relies on the end.
- A goal that was canceled without a timeout before the server answered is also lost if the server twice reports it as
  unknown: its request, or the server that received it, was lost.
- Only that proves the loss. A cancel answered with "unknown" or "terminated" may have arrived after the end of the
  goal, whose result may still arrive.
"""

from __future__ import annotations

import math
import uuid
import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any, Final

from action_msgs.msg import GoalInfo, GoalStatusArray
from action_msgs.msg import GoalStatus as RosGoalStatus
from action_msgs.srv import CancelGoal
from rclpy.qos import QoSProfile, qos_profile_action_status_default
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from flexbt_common.names import service_qos
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.value_types import exact

from .links import WATCH_SECONDS, ServerCall, ServerLink, ServerLinks, ServerNodes

_ANSWER_LATE: Final = 0.1
"""Seconds after which an acceptance counts that only the list of goals shows."""
_RESULT_LATE: Final = 0.4
"""Seconds after which the result of a goal that is known to have ended is requested again."""
_RESULT_REPEAT: Final = (5.0, 60.0)
"""Intervals of repeated requests for the result, s, since the server may have been replaced unnoticed: first and last,
doubling in between. A server keeps every request until the goal has ended."""
_CANCEL_REPEAT: Final = (0.5, 8.0)
"""Intervals of repeated cancels, s: first and last, doubling in between."""
_MOST_UNANSWERED: Final = 1000
"""Number of goals and cancels of a link that wait for their answers, beyond which the oldest are given up: a server
that hangs never answers."""
_CANCEL_TOO_LATE: Final = frozenset(
    (CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID, CancelGoal.Response.ERROR_GOAL_TERMINATED)
)
"""Answers to the cancel of a goal that has ended: a server may forget a goal before its result arrives."""
_ENDED: Final = frozenset((RosGoalStatus.STATUS_SUCCEEDED, RosGoalStatus.STATUS_CANCELED, RosGoalStatus.STATUS_ABORTED))


class GoalStatus(Enum):
    """The final status of a goal. Only SUCCEEDED is success."""

    SUCCEEDED = 'succeeded'
    ABORTED = 'aborted'
    CANCELED = 'canceled'
    REJECTED = 'rejected'
    NO_SERVER = 'no server'
    LOST = 'lost'
    TIMEOUT = 'timeout'
    FAULT = 'fault'


@dataclass(frozen=True)
class GoalOutcome:
    """The end of a goal.

    ``result`` is the result message when the server sent one (SUCCEEDED, ABORTED, CANCELED by the server), otherwise
    None. ``reason`` is for a person; empty when SUCCEEDED.
    """

    status: GoalStatus
    result: Any | None
    reason: str


class ActionCall(ServerCall['ActionServerLink', GoalOutcome]):
    """A goal sent to a server. Thread-safe; may be created on any thread."""

    def __init__(
        self,
        link: ActionServerLink,
        goal: Any,
        *,
        on_done: Callable[[GoalOutcome], None],
        on_feedback: Callable[[Any], None] | None = None,
        on_accepted: Callable[[], None] | None = None,
        server_timeout: float = 1.0,
        accept_timeout: float = 1.0,
        outage_timeout: float = 0.5,
    ) -> None:
        """Send ``goal`` as soon as the server is available.

        All callbacks are called on the executor thread; ``on_done`` exactly once. All times are wall time in seconds:
        ``server_timeout`` for the server to appear, ``accept_timeout`` from sending to acceptance,
        ``outage_timeout`` during which the server may be out of reach while the goal runs.
        """
        self._goal = goal
        self._on_feedback = on_feedback
        self._on_accepted = on_accepted
        self._accept_timeout = accept_timeout
        self._outage_timeout = outage_timeout
        self._goal_id = UUID(uuid=list(uuid.uuid4().bytes))
        self._accepted = False
        self._status = RosGoalStatus.STATUS_UNKNOWN
        self._sent = False
        self._cancel_requested = False
        self._cancel_timeout: float | None = None
        self._cancel_waits = False
        self._cancel_repeat = _CANCEL_REPEAT[0]
        self._asked: list[Future] = []  # requests for the result, or to cancel, some of which may never be answered
        self._result_asked = 0.0
        self._result_repeat = _RESULT_REPEAT[0]
        self._ended_seen: float | None = None
        self._gone_since: float | None = None
        self._was_silent = False
        self._unknown_since = math.inf
        super().__init__(link, on_done, server_timeout)  # starts the call

    @property
    def goal_id(self) -> bytes:
        """Identifier of the goal on the server; 16 bytes."""
        return bytes(self._goal_id.uuid)

    @property
    def accepted(self) -> bool:
        """True if the server has accepted the goal."""
        return self._accepted

    @property
    def cancel_requested(self) -> bool:
        """True if :meth:`cancel` was called."""
        return self._cancel_requested

    def cancel(self, timeout: float | None = 2.0) -> None:
        """Ask the server to cancel the goal; from any thread. A second call, or one after the end, has no effect.

        The server determines the outcome, or it is TIMEOUT if the goal has not ended within ``timeout`` seconds. With
        None, the call repeats the cancel until the goal has ended or the server is gone. A goal that was not sent yet
        is never sent.
        """
        if not self._cancel_requested:
            self._cancel_timeout = timeout
            self._cancel_requested = True
            self._runtime.post(self._cancel)

    # -------------------------------------------------- everything below runs on the executor thread

    def _wait_for_server(self, deadline: float) -> None:
        if self._cancel_requested:
            self._finish(GoalStatus.CANCELED, 'canceled before it was sent')
        else:
            super()._wait_for_server(deadline)

    def _not_there(self, why: str) -> None:
        self._finish(GoalStatus.NO_SERVER, why)

    def _send(self) -> None:
        try:
            future = self._link.send_goal(self._goal_id, exact(self._goal))
        except Exception as error:
            self._finish(GoalStatus.FAULT, f'the goal for {self._link} cannot be sent: {error or type(error).__name__}')
            return
        self._sent = True
        self._link.listeners[self.goal_id] = GoalListener(self._on_status, self._feedback)
        future.add_done_callback(partial(_goal_answered, weakref.ref(self), self._link, self._goal_id))
        self._after('accept', self._accept_timeout, self._not_accepted)
        self._after('watch', WATCH_SECONDS, self._await_acceptance)

    def _not_accepted(self) -> None:
        if self.done or self.accepted:
            return
        # The server may still have the goal: its answer may be late or lost.
        asked, answer = self._runtime.steady.now(), self._link.cancel(self._goal_id)
        if self._is_relied_on:
            self._when_answered(answer, lambda future: self._early_cancel_answered(future, asked))
            self._after('accept', self._next_cancel(), self._not_accepted)
            return
        self._finish(
            GoalStatus.TIMEOUT,
            f'{self._link} did not answer the goal within {self._accept_timeout:g} s; '
            'is it overloaded, or built from other interface definitions?',
        )

    def _await_acceptance(self) -> None:
        """Wait for the server's answer. Until then the server may start the goal at any time."""
        if self.done or self.accepted:
            return
        if self._is_gone():
            self._lose(f'{self._link} went away without an answer to the goal')
            return
        if self._has_returned() and self._is_relied_on:
            self._cancel_repeat = _CANCEL_REPEAT[0]
            self._drop('accept')
            self._not_accepted()
        self._after('watch', WATCH_SECONDS, self._await_acceptance)

    def _early_cancel_answered(self, future: Any, asked: float) -> None:
        """Handle the answer to a cancel that was sent at the time ``asked``, before the acceptance was known."""
        response = future.result()
        if self.accepted or response is None:
            return
        if response.return_code != CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            self._accepted_unheard()
        elif asked > self._unknown_since:
            self._finish(GoalStatus.LOST, f'{self._link} does not know the goal: its request was lost')
        elif self._unknown_since == math.inf:  # the cancel may have overtaken the goal
            self._unknown_since = self._runtime.steady.now()
            self._drop('accept')
            self._after('accept', _CANCEL_REPEAT[0], self._not_accepted)

    def goal_answered(self, is_accepted: bool) -> None:
        """Handle the server's answer to the goal of a call that is not done; for :func:`_goal_answered`."""
        if self.accepted:
            return  # the list of goals was faster
        if not is_accepted:
            self._finish(GoalStatus.REJECTED, f'{self._link} rejected the goal; is its node active?')
            return
        self._on_acceptance()

    def _on_status(self, status: int) -> None:
        self._status = status
        if not self.accepted and not self.done and 'answer' not in self._timers:
            self._after('answer', _ANSWER_LATE, self._accepted_unheard)

    def _accepted_unheard(self) -> None:
        if not self.accepted and not self.done:
            self._on_acceptance()

    def _on_acceptance(self) -> None:
        for purpose in ('accept', 'answer', 'watch'):
            self._drop(purpose)
        self._accepted = True
        self._ask_for_result()
        if self._cancel_requested:
            self._cancel()
        self._after('watch', WATCH_SECONDS, self._watch)
        if self._on_accepted is not None:
            self._guarded(self._on_accepted)

    def _ask_for_result(self) -> None:
        self._result_asked = self._runtime.steady.now()
        self._when_answered(self._link.ask_for_result(self._goal_id), self._result_arrived)

    def _when_answered(self, future: Future, handle: Callable[[Any], None]) -> None:
        """Call ``handle`` with the future when it is answered before the end of this call."""
        self._asked = [one for one in self._asked if not one.done()]
        self._asked.append(future)
        future.add_done_callback(lambda done: None if self.done or done.cancelled() else handle(done))

    def _result_arrived(self, future: Any) -> None:
        response = future.result()
        if response is None:
            return
        if response.status == RosGoalStatus.STATUS_SUCCEEDED:
            self._finish(GoalStatus.SUCCEEDED, '', response.result)
        elif response.status == RosGoalStatus.STATUS_CANCELED:
            by_us = 'as asked' if self._cancel_requested else 'by somebody else'
            self._finish(GoalStatus.CANCELED, f'the goal was canceled {by_us} at {self._link}', response.result)
        elif response.status == RosGoalStatus.STATUS_ABORTED:
            told = getattr(response.result, 'error_msg', '') or getattr(response.result, 'message', '')
            self._finish(
                GoalStatus.ABORTED,
                f'{self._link} aborted the goal' + (f': {told}' if told else ''),
                response.result,
            )
        else:
            self._finish(
                GoalStatus.LOST,
                f'{self._link} does not know the goal any more (status {response.status}); '
                'it was restarted, or dropped the result',
            )

    def _watch(self) -> None:
        if self.done:
            return
        now, was_gone = self._runtime.steady.now(), self._has_returned() or self._gone_since is not None
        if self._is_gone():
            self._lose(f'{self._link} is gone: its process ended, or is out of reach')
            return
        if self._gone_since is None:
            if self._status in _ENDED and self._ended_seen is None:
                self._ended_seen = now
            is_late = self._ended_seen is not None and now - max(self._ended_seen, self._result_asked) > _RESULT_LATE
            is_due = now - self._result_asked > self._result_repeat
            if is_due:
                self._result_repeat = min(2.0 * self._result_repeat, _RESULT_REPEAT[1])
            if was_gone or is_late or is_due:
                self._ask_for_result()
            if was_gone and self._cancel_requested:
                self._when_answered(self._link.cancel(self._goal_id), self._cancel_answered)
        self._after('watch', WATCH_SECONDS, self._watch)

    def _lose(self, reason: str) -> None:
        """Give the goal up, since the server is gone. If it was only late, it finds a cancel when it returns."""
        if self._servers is not None and self._servers.are_silent:
            self._link.cancel(self._goal_id)
        self._finish(GoalStatus.LOST, reason)

    def _is_gone(self) -> bool:
        """Return whether the server is known to be gone, or out of reach for longer than an outage may last."""
        if self._servers is not None and self._servers.are_gone:
            return not self._may_come_back()
        now = self._runtime.steady.now()
        if self._link.is_ready():
            self._gone_since = None
            return False
        self._gone_since = now if self._gone_since is None else self._gone_since
        return now - self._gone_since >= self._outage_timeout and not self._may_come_back()

    @property
    def _is_relied_on(self) -> bool:
        """True if the goal was canceled by a caller that waits for its end without a time limit."""
        return self._cancel_requested and self._cancel_timeout is None

    def _has_returned(self) -> bool:
        """Return whether the server was silent at the last call, and is not now.

        Another process may have taken its place: if the first one died before its token was heard, nothing else shows
        that.
        """
        was_silent = self._was_silent
        self._was_silent = self._servers is not None and self._servers.are_silent
        return was_silent and not self._was_silent

    def _may_come_back(self) -> bool:
        """Return whether a server that cannot be reached may still work on the goal."""
        servers = self._servers
        if servers is None:
            return False
        return servers.are_silent if self._is_relied_on else servers.are_late and not servers.are_gone

    def _cancel(self) -> None:
        if self.done:
            return
        if not self._sent:
            self._finish(GoalStatus.CANCELED, 'canceled before it was sent')
            return
        if not self._cancel_waits:
            self._cancel_waits = True
            if self._cancel_timeout is not None:
                self._after('cancel', self._cancel_timeout, self._not_canceled)
        if self.accepted and 'repeat' not in self._timers:  # the acceptance may have come with the cancel
            self._repeat_cancel()

    def _repeat_cancel(self) -> None:
        if not self.done:
            self._when_answered(self._link.cancel(self._goal_id), self._cancel_answered)
            self._after('repeat', self._next_cancel(), self._repeat_cancel)

    def _next_cancel(self) -> float:
        seconds = self._cancel_repeat
        self._cancel_repeat = min(2.0 * seconds, _CANCEL_REPEAT[1])
        return seconds

    def _cancel_answered(self, future: Any) -> None:
        response = future.result()
        if response is not None and response.return_code in _CANCEL_TOO_LATE:
            self._ask_for_result()  # the answer to the first request may be late or lost

    def _not_canceled(self) -> None:
        if self.done:
            return
        if not self.accepted:
            self._link.cancel(self._goal_id)
        self._finish(
            GoalStatus.TIMEOUT,
            f'{self._link} did not end the goal within {self._cancel_timeout:g} s of the cancel',
        )

    def _feedback(self, feedback: Any) -> None:
        if not self.done and self._on_feedback is not None:
            on_feedback = self._on_feedback
            self._guarded(lambda: on_feedback(feedback))

    def _finish(self, status: GoalStatus, reason: str, result: Any | None = None) -> None:
        if self.done:
            return
        self._link.listeners.pop(self.goal_id, None)
        for future in self._asked:
            future.cancel()  # removes it from rclpy's table
        self._asked.clear()
        self._end(GoalOutcome(status, result, reason))


def _goal_answered(known: weakref.ref[ActionCall], link: ActionServerLink, goal_id: UUID, future: Any) -> None:
    """Handle the server's answer to a goal, which may never come and so does not keep the call."""
    response, call = future.result(), known()
    if response is None:
        return
    if call is not None and not call.done:
        call.goal_answered(response.accepted)
    elif response.accepted:
        link.cancel(goal_id)  # no caller waits for this goal any more


# The connections of a node to action servers.


@dataclass(frozen=True)
class GoalListener:
    """A listener for one goal. It gets the feedback, and the status each time the server publishes its goals."""

    on_status: Callable[[int], None]
    on_feedback: Callable[[Any], None]


class ActionServerLink(ServerLink):
    """The connection of this node to one action server. :class:`ActionLinks` creates it on the executor thread; use it
    there. ``name`` is the server's name as the caller wrote it.

    The link uses the three services and two topics of the action directly: rclpy's client cannot request the result of
    a goal whose acceptance it does not know. It reads the topics while a goal is active.
    """

    kind = 'action server'

    def __init__(self, runtime: Runtime, action_type: Any, name: str, nodes: ServerNodes) -> None:
        status = runtime.node.resolve_topic_name(f'{name}/_action/status')
        super().__init__(runtime, action_type, name, nodes, f'rt{status}')
        self.impl: Any = action_type.Impl
        self.listeners: dict[bytes, GoalListener] = {}
        """Listeners by goal ID."""
        node, impl, qos = runtime.node, self.impl, service_qos()
        self._goals = node.create_client(impl.SendGoalService, f'{name}/_action/send_goal', qos_profile=qos)
        self._cancels = node.create_client(impl.CancelGoalService, f'{name}/_action/cancel_goal', qos_profile=qos)
        self._results = node.create_client(impl.GetResultService, f'{name}/_action/get_result', qos_profile=qos)
        listeners = self.listeners  # the callbacks must not hold the link

        def on_feedback(message: Any) -> None:
            listener = listeners.get(bytes(message.goal_id.uuid))
            if listener is not None:
                listener.on_feedback(message.feedback)

        def on_status(message: GoalStatusArray) -> None:
            for goal in message.status_list:
                listener = listeners.get(bytes(goal.goal_info.goal_id.uuid))
                if listener is not None:
                    listener.on_status(goal.status)

        for callback in (on_feedback, on_status):
            callback.is_awaited = lambda: bool(listeners)  # type: ignore[attr-defined]  # see node_executor.NodeExecutor
        self._topics = tuple(
            node.create_subscription(message_type, f'{name}/_action/{topic}', callback, profile)
            for message_type, topic, callback, profile in (
                (impl.FeedbackMessage, 'feedback', on_feedback, QoSProfile(depth=10)),
                (GoalStatusArray, 'status', on_status, qos_profile_action_status_default),
            )
        )
        self._unanswered: deque[Future] = deque()
        self._has_topics = False  # they have appeared; they go with the services
        self.entities = (self._goals, self._cancels, self._results, *self._topics)

    def send_goal(self, goal_id: UUID, goal: Any) -> Future:
        """Send a goal. Return the future answer."""
        return self._bounded(self._goals.call_async(self.impl.SendGoalService.Request(goal_id=goal_id, goal=goal)))

    def cancel(self, goal_id: UUID) -> Future:
        """Request the cancel of a goal. Return the future answer."""
        request = self.impl.CancelGoalService.Request(goal_info=GoalInfo(goal_id=goal_id))
        return self._bounded(self._cancels.call_async(request))

    def _bounded(self, asked: Future) -> Future:
        """Return a request, and give up the oldest ones beyond a limit."""
        waiting = self._unanswered
        while waiting and (waiting[0].done() or waiting[0].cancelled() or len(waiting) >= _MOST_UNANSWERED):
            waiting.popleft().cancel()  # removes it from rclpy's table
        waiting.append(asked)
        return asked

    def ask_for_result(self, goal_id: UUID) -> Future:
        """Request the result of a goal. Return the future answer."""
        return self._results.call_async(self.impl.GetResultService.Request(goal_id=goal_id))

    def is_shown(self) -> bool:
        """See :meth:`ServerLink.is_shown`."""
        clients = (self._goals, self._cancels, self._results)
        self._has_topics = all(client.service_is_ready() for client in clients) and (
            self._has_topics or all(self.runtime.node.count_publishers(topic.topic_name) for topic in self._topics)
        )
        return self._has_topics


class ActionLinks(ServerLinks[ActionServerLink]):
    """The links of one node to action servers."""

    link_class = ActionServerLink
