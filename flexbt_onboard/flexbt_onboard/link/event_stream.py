# SPDX-License-Identifier: BSD-3-Clause
"""The stream of transitions and commands, numbered and latched, for the logs of the consoles.

A state machine may make thousands of transitions a second, more than a person can read: the number of transitions and
of messages sent is limited. Omitted events show as a gap in the numbers.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

from builtin_interfaces.msg import Time

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import ExecutiveEvent, ExecutiveEvents

EVENTS_OF_MESSAGE: Final = 50
"""Maximum events in a message; if more arrive before it is sent, the oldest are left out."""

PERIOD: Final = 0.2
"""Minimum wall time between two messages, s."""

TEXT_LENGTH: Final = 1000


class EventStream:
    """A publisher of the events of one executive. From any thread, but made on the executor thread."""

    def __init__(self, runtime: Runtime, executive_id: str) -> None:
        self._runtime = runtime
        self._executive_id = executive_id
        self._publisher = runtime.node.create_publisher(
            ExecutiveEvents, names.EXECUTIVE_EVENTS, names.transient_local_qos(names.EVENTS_DEPTH)
        )
        self._lock = threading.Lock()
        self._waiting: deque[tuple[Time, str, Mapping[str, Any]]] = deque(maxlen=EVENTS_OF_MESSAGE)
        self._run = self._behavior = ''  # the latest run
        self._count = 0
        self._is_planned = False
        self._next = 0.0

    def add(self, event: str, fields: Mapping[str, Any]) -> None:
        """Queue an event of the event log. Only transitions and decided commands are sent."""
        if event in ('started', 'resumed', 'switched'):
            with self._lock:
                self._run, self._behavior = str(fields['run']), str(fields['behavior'])
        if event != 'left' and not (event == 'command' and fields.get('effect') in ('applied', 'refused')):
            return
        stamp = self._runtime.clock.stamp()  # without the lock: reading the clock may call other code
        with self._lock:
            if event == 'command' and fields.get('run') == self._run and not fields.get('path'):
                fields = {'of': self._behavior, **fields}
            self._count += 1
            self._waiting.append((stamp, event, fields))
            if self._is_planned:
                return
            self._is_planned = True
            due = max(self._next, self._runtime.steady.now())
        self._runtime.post_at(due, self._publish)

    def _publish(self) -> None:
        with self._lock:
            self._is_planned = False
            self._next = self._runtime.steady.now() + PERIOD
            waiting = list(self._waiting)
            self._waiting.clear()
            first = self._count - len(waiting) + 1
        events = [_message(*one) for one in waiting]  # here, so that omitted events cost nothing
        self._publisher.publish(ExecutiveEvents(executive_id=self._executive_id, first=first, events=events))


def _message(stamp: Time, event: str, fields: Mapping[str, Any]) -> ExecutiveEvent:
    """Return the message of an event of the event log; see :mod:`flexbt_onboard.persistence.event_log` for its
    fields."""

    def text(name: str) -> str:
        return sanitize_for_message(str(fields.get(name, '')), TEXT_LENGTH)

    common: dict[str, Any] = {
        'stamp': stamp,
        'run_id': text('run'),
        'path': text('path'),
        'outcome': text('outcome'),
    }
    if event == 'left':
        return ExecutiveEvent(kind=ExecutiveEvent.TRANSITION, target=text('target'), reason=text('reason'), **common)
    return ExecutiveEvent(
        kind=ExecutiveEvent.COMMAND,
        operator_id=text('operator'),
        command=text('command') or f'kind {text("kind")}',
        decision_id=text('decision'),
        applied=fields['effect'] == 'applied',
        reason=text('why'),
        target=text('behavior') or text('grantee') or text('autonomy') or text('of'),
        text=text('text') or text('because'),
        **common,
    )
