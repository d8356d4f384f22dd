# SPDX-License-Identifier: BSD-3-Clause
"""Publishers and subscriptions of a topic that exchange no messages, since their QoS is incompatible.

The middleware reports an incompatible endpoint to each side, with the policy. This module finds that endpoint and its
QoS in the graph, so that users see what to change, instead of only missing messages.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from copy import copy
from typing import Any, Final, TypeVar

from rclpy.action.server import RCLError
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_policy_name_from_kind,
)

from flexbt_common.names import node_of
from flexbt_core.clock.rates import RepeatedReports
from flexbt_core.values.text import one_line

from .received_messages import COMPLAINT_SECONDS, UNKNOWN_NODE

_MOST_SHOWN: Final = 3
"""Maximum number of endpoints of a topic that a report lists."""

_NAME_CHARACTERS: Final = 100

Events = TypeVar('Events', PublisherEventCallbacks, SubscriptionEventCallbacks)


class QosMisfits:
    """The QoS mismatches of one node, by topic (resolved name). Used on the executor thread, except for :meth:`of`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._tell: Callable[[str], object] | None = None
        self._texts: dict[str, str] = {}
        self._reports = RepeatedReports(COMPLAINT_SECONDS, time.monotonic)

    def on_found(self, tell: Callable[[str], object] | None) -> None:
        """Call ``tell`` for each topic whose messages the node cannot receive, instead of logging it; None to log it.
        Topics of which other nodes cannot receive this node's messages are always logged.
        """
        self._tell = tell

    def of(self, topic: str) -> str:
        """Return the known reason why a topic exchanges no messages, or ''. From any thread."""
        return self._texts.get(topic, '')

    def watched(self, events: Events, topic: str) -> Events:
        """Return the event callbacks for an endpoint, with ours unless it has its own or uses no default callbacks."""
        if events.incompatible_qos is not None or not events.use_default_callbacks:
            return events
        watched = copy(events)
        watched.incompatible_qos = lambda event: self._found(self._node.resolve_topic_name(topic), event)
        return watched

    def check(self, topic: str) -> str:
        """Check the graph again, and return the new result of :meth:`of`."""
        try:
            found = list(self._misfits(topic))
        except (RCLError, InvalidHandle):  # the node is ending, or an endpoint is being destroyed
            return self.of(topic)
        more = f' And {len(found) - _MOST_SHOWN} more.' if len(found) > _MOST_SHOWN else ''
        self._texts.pop(topic, None)
        if found:
            self._texts[topic] = ' '.join(found[:_MOST_SHOWN]) + more
        return self.of(topic)

    def _found(self, topic: str, event: Any) -> None:
        before = self.of(topic)
        text = self.check(topic)
        if not text:  # the graph does not know that endpoint yet
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            text = self._texts[topic] = f'No messages on {topic!r}: another node has another {policy} there.'
        if text != before and self._reports.held_before(topic) is not None:
            is_ours = any(one.topic_name == topic for one in self._node.subscriptions)
            (self._tell if self._tell and is_ours else self._node.get_logger().warning)(text)

    def _misfits(self, topic: str) -> Iterator[str]:
        me = self._node.get_fully_qualified_name()
        for subscription in (one for one in self._node.subscriptions if one.topic_name == topic):
            for other in self._node.get_publishers_info_by_topic(topic):
                if why := why_misfit(other.qos_profile, subscription.qos_profile, 'it', me):
                    yield f'No messages on {topic!r} from {_name_of(other)}: {why}'
        for publisher in (one for one in self._node.publishers if one.topic_name == topic):
            for other in self._node.get_subscriptions_info_by_topic(topic):
                if why := why_misfit(publisher.qos_profile, other.qos_profile, me, 'it'):
                    yield f'No messages on {topic!r} to {_name_of(other)}: {why}'


def why_misfit(offered: QoSProfile, wanted: QoSProfile, publisher: str, subscriber: str) -> str:
    """Return why no messages arrive and what to do; '' if the two are compatible."""
    compatibility, reason = qos_check_compatible(offered, wanted)
    if compatibility != QoSCompatibility.ERROR:
        return ''
    own, others = [], []
    if (offered.reliability, wanted.reliability) == (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE):
        own.append('BEST_EFFORT')
        others.append('RELIABLE')
    if (offered.durability, wanted.durability) == (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL):
        own.append('VOLATILE')
        others.append('TRANSIENT_LOCAL')
    if not own:
        return f'{reason.removeprefix("ERROR: ").rstrip("; ")}. Give both the same quality of service.'
    less, more = ' and '.join(own), ' and '.join(others)
    return (
        f'{publisher} publishes {less}, {subscriber} subscribes {more}. Subscribe with {less}, or publish with {more}.'
    )


def _name_of(endpoint: Any) -> str:
    if endpoint.node_name == UNKNOWN_NODE:
        return 'a node that is not known yet'
    return one_line(node_of(endpoint), _NAME_CHARACTERS)
