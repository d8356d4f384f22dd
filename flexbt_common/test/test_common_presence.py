# SPDX-License-Identifier: BSD-3-Clause
"""Presence: lost words are no harm, a silence of a lease is, and an orderly end is noticed at once."""

from __future__ import annotations

import queue
import time
from collections.abc import Iterator

import pytest
from std_msgs.msg import Empty

from flexbt_common import presence
from flexbt_common.names import alive_topic
from flexbt_common.node_runtime import NodeRuntime
from flexbt_common.presence import PresenceToken, PresenceWatch

DEADLINE = 20.0
LEASE = 1.0
EARLIEST, LATEST = LEASE - 0.1, LEASE + 0.5


class Watcher:
    """What a watch tells, and when."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.changes: queue.Queue[tuple[bool, float]] = queue.Queue()
        self.watch = PresenceWatch(runtime, 'ann', lambda alive: self.changes.put((alive, time.monotonic())))

    def next(self, alive: bool) -> float:
        told, when = self.changes.get(timeout=DEADLINE)
        assert told is alive is self.watch.alive
        return when

    def wait_tokens(self, count: int) -> None:
        """Until so many tokens are connected."""
        end = time.monotonic() + DEADLINE
        subscription = self.watch._subscription
        while self.runtime.call(subscription.get_publisher_count) < count:
            assert time.monotonic() < end, f'{count} tokens'


@pytest.fixture
def watcher(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watcher]:
    monkeypatch.setattr(presence, 'LEASE_SECONDS', LEASE)
    monkeypatch.setattr(presence, 'WORD_SECONDS', LEASE / 5.0)
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        watcher = Watcher(runtime)
        assert watcher.watch.alive is None
        yield watcher


def test_one_of_two_tokens_is_enough_and_the_end_of_the_last_is_noticed_at_once(watcher: Watcher) -> None:
    with NodeRuntime.open('first', namespace='/robot1') as first:
        PresenceToken(first, 'ann')
        watcher.next(True)
        with NodeRuntime.open('second', namespace='/robot1') as second:
            PresenceToken(second, 'ann')
            watcher.wait_tokens(2)
            first.close()
            with pytest.raises(queue.Empty):
                watcher.changes.get(timeout=2.0 * LEASE)
            closing = time.monotonic()
        assert watcher.next(False) - closing < LEASE


def test_a_silence_is_noticed_after_the_lease_and_the_next_word_ends_it(watcher: Watcher) -> None:
    with NodeRuntime.open('hanging', namespace='/robot1') as runtime:
        publisher = runtime.call(lambda: runtime.node.create_publisher(Empty, alive_topic('ann'), 1))
        seen = watcher.next(True)
        assert EARLIEST < watcher.next(False) - seen < LATEST
        for _ in range(2):
            publisher.publish(Empty())
            spoken = watcher.next(True)
            assert EARLIEST < watcher.next(False) - spoken < LATEST
        watcher.watch.close()
        watcher.runtime.call(lambda: None)
        publisher.publish(Empty())
        with pytest.raises(queue.Empty):
            watcher.changes.get(timeout=0.3)
