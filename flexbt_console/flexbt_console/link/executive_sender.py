# SPDX-License-Identifier: BSD-3-Clause
"""The executive to which the console listens, and the check that both sides were built from the same interfaces."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum
from itertools import takewhile
from typing import Any, Final

from flexbt_common.middleware.received_messages import UNKNOWN_NODE, UNKNOWN_WRITER
from flexbt_common.names import node_of

RETURN_SECONDS: Final = 15.0
"""Time for which an executive that was replaced is still expected, s: its computer was busy, or its process was
stopped."""

_LOOK_SECONDS: Final = 0.2
_MOST_REPLACED: Final = 16


class Succession(Enum):
    """The sender of a status, compared with the sender before.

    SAME: the same one. NEXT: another one, which replaces it. INSTEAD: the actual executive; earlier messages came from
    a participant that was not the executive.
    """

    SAME = 'same'
    NEXT = 'next'
    INSTEAD = 'instead'


class ExecutiveSender:
    """A filter that separates the messages of the executive from those of other nodes on its topics.

    If the executive is silent, the next participant with a status replaces it: it may be the restarted executive, and
    the middleware notices the end of a killed process late. If the old one soon sends again, it was only late, and
    becomes the executive again. A participant that answers a STOP which the current executive has not answered is the
    executive.

    ``is_there`` returns whether a participant of the domain still publishes statuses, ``is_silent`` whether a message
    of the current executive is overdue; ``now`` returns the time, s.
    """

    def __init__(
        self, is_there: Callable[[bytes], bool], is_silent: Callable[[], bool], now: Callable[[], float]
    ) -> None:
        self._participant = UNKNOWN_WRITER
        self._early: set[bytes] = set()  # senders heard before the executive was known
        self._replaced: dict[bytes, float] = {}  # time until which each may return, in the order of replacement
        self._is_there = is_there
        self._is_silent = is_silent
        self._now = now
        self._there_until = now()

    def has_sent(self, participant: bytes) -> bool:
        """Return whether a message of this participant is the executive's, as far as is known."""
        if self._participant == UNKNOWN_WRITER and len(self._early) < _MOST_REPLACED:
            self._early.add(participant)
        if UNKNOWN_WRITER in (participant, self._participant) or participant == self._participant:
            return True
        if self._now() < self._replaced.get(participant, 0.0):
            return True
        return self._is_silent() or not self._is_still_there()

    def follow(self, participant: bytes, *, answers: bool = False) -> Succession:
        """Follow a participant that has sent a status as the executive, or that ``answers`` a STOP in its place."""
        before, self._participant = self._participant, participant
        if before == UNKNOWN_WRITER:
            return Succession.INSTEAD if self._early - {participant} else Succession.SAME
        if participant in (before, UNKNOWN_WRITER):
            return Succession.SAME
        now = self._now()
        self._there_until = now
        self._replaced = {one: until for one, until in self._replaced.items() if now < until}
        if answers or participant in self._replaced:  # those that came after it replaced it wrongly
            self._replaced = dict(takewhile(lambda entry: entry[0] != participant, self._replaced.items()))
            return Succession.INSTEAD
        if len(self._replaced) < _MOST_REPLACED:
            self._replaced[before] = now + RETURN_SECONDS
        return Succession.NEXT

    def _is_still_there(self) -> bool:
        """Return whether it still publishes. A check costs as much as a message, so check only a few times a second."""
        if self._now() < self._there_until:
            return True
        is_there = self._is_there(self._participant)
        self._there_until = self._now() + (_LOOK_SECONDS if is_there else 0.0)
        return is_there


# Check that both sides of a topic were built from the same interfaces.
#
# The middleware connects topics by the name of the type. When the definitions differ, messages are lost or misread
# without an error; the hash of the definition, which each side announces, shows it (REP 2016).


def interface_problem(node: Any, topic: str) -> str:
    """Return the problem with the other endpoints of a topic that ``node`` publishes or subscribes to; '' if none."""
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    subscriptions = node.get_subscriptions_info_by_topic(resolved)
    own = _hashes(endpoint for endpoint in publishers + subscriptions if _is_of(node, endpoint))
    others = _hashes(subscriptions if any(_is_of(node, endpoint) for endpoint in publishers) else publishers)
    different = sorted(others - own) if own else []
    if not different:
        return ''
    return (
        f'the executive and this console were built from different versions of flexbt_msgs '
        f'({resolved} is {_short(different[0])} there and {_short(min(own))} here); build both from the same one'
    )


def senders_problem(node: Any, topic: str, senders: int) -> str:
    """Return the problem that several nodes publish on ``topic``; '' if only one does. ``senders`` are connected."""
    if senders <= 1:
        return ''
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    names = [node_of(one) for one in publishers if one.node_name != UNKNOWN_NODE]
    who = f' ({", ".join(sorted(names))})' if names else ''
    remedy = 'end all but one (a killed one leaves within 30 s), or give each a namespace of its own'
    return f'{senders} executives publish on {resolved}{who}; {remedy}'


def _is_of(node: Any, endpoint: Any) -> bool:
    return (endpoint.node_name, endpoint.node_namespace) == (node.get_name(), node.get_namespace())


def _hashes(endpoints: Iterable[Any]) -> set[str]:
    """Return the type hashes, without those of older ROS versions, which have none to compare."""
    return {str(endpoint.topic_type_hash) for endpoint in endpoints} - {'INVALID'}


def _short(type_hash: str) -> str:
    version, _, value = type_hash.partition('_')
    return f'{version}_{value[:8]}'
