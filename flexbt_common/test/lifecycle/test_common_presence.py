# SPDX-License-Identifier: BSD-3-Clause
"""Presence: lost words are no harm, a silence of a lease is, and an orderly end is noticed at once."""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Iterator

import pytest

from flexbt_common import names
from flexbt_common.lifecycle import presence
from flexbt_common.lifecycle.presence import PresenceToken, PresenceWatch
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import PeerStatus
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

LEASE = 1.0
AT_ONCE = 0.4


class Watcher:
    """Who is there, and since when that is known: the time, and the uncontended time."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.changes: queue.Queue[tuple[set[str], float, float]] = queue.Queue()
        self._runtime = runtime
        self._watch = runtime.call(lambda: PresenceWatch(runtime))
        self._watch.add_listener(
            lambda: self.changes.put((set(self._watch.present), time.monotonic(), uncontended_time()))
        )

    def next(self, *present: str) -> tuple[float, float]:
        """Time, and uncontended time, of the next change, which makes these present."""
        told, *when = self.changes.get(timeout=DEADLINE)
        assert told == set(present)
        return when[0], when[1]

    def participants(self) -> set[bytes]:
        """Return those whose tokens are heard."""
        return self._runtime.call(lambda: {token.participant for token in self._watch._heard})

    def has_gone(self, participant: bytes) -> bool:
        return self._runtime.call(lambda: self._watch.has_gone(participant))

    def nothing_for(self, seconds: float) -> None:
        with pytest.raises(queue.Empty):
            self.changes.get(timeout=seconds)


@pytest.fixture
def watcher(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watcher]:
    monkeypatch.setattr(presence, 'PRESENCE_LEASE_SECONDS', LEASE)
    monkeypatch.setattr(presence, 'WORD_SECONDS', LEASE / 5.0)
    with NodeRuntime.open('watcher', namespace='/robot1') as runtime:
        yield Watcher(runtime)


def test_each_name_is_there_until_its_last_token_ends(watcher: Watcher) -> None:
    with NodeRuntime.open('a', namespace='/robot1') as a, NodeRuntime.open('b', namespace='/robot1') as b:
        PresenceToken(a, 'ann')
        watcher.next('ann')
        PresenceToken(b, 'bob\0')  # whatever an operator is called
        watcher.next('ann', 'bob\ufffd')
        with NodeRuntime.open('c', namespace='/robot1') as c:
            PresenceToken(c, 'ann')
            watcher.nothing_for(2.0 * LEASE)
        watcher.nothing_for(2.0 * LEASE)
        a.close()
        closed = uncontended_time()
        assert watcher.next('bob\ufffd')[1] - closed < AT_ONCE
        b.close()
        closed = uncontended_time()
        assert watcher.next()[1] - closed < AT_ONCE


def test_of_two_tokens_of_one_process_whose_time_stands_still_one_stays(watcher: Watcher) -> None:
    with NodeRuntime.open('a', namespace='/robot1', parameters={'use_sim_time': True}) as runtime:
        token = PresenceToken(runtime, 'ann')
        watcher.next('ann')
        PresenceToken(runtime, 'ann')
        runtime.call(token.close)
        watcher.nothing_for(2.0 * LEASE)


def test_a_silence_is_noticed_after_the_lease_and_the_next_word_ends_it(watcher: Watcher) -> None:
    with NodeRuntime.open('hanging', namespace='/robot1') as runtime:
        publisher = runtime.call(lambda: runtime.node.create_publisher(PeerStatus, names.EXECUTIVE_PRESENCE, 1))
        end = time.monotonic() + DEADLINE
        while not publisher.get_subscription_count():
            assert time.monotonic() < end

        def say() -> tuple[float, float]:
            """Return when it was heard; a word may get lost."""
            while watcher.changes.empty():
                publisher.publish(PeerStatus(name='ann', alive=True))
                with contextlib.suppress(AssertionError):
                    wait_until(lambda: not watcher.changes.empty(), 'a word', LEASE)
                assert time.monotonic() < end
            return watcher.next('ann')

        for _ in range(2):
            spoken = say()
            (participant,) = watcher.participants()
            assert not watcher.has_gone(participant)
            silent = watcher.next()
            assert silent[0] - spoken[0] > LEASE - 0.1
            assert silent[1] - spoken[1] < LEASE + 0.5
            assert watcher.has_gone(participant), 'its names are free for others'
        say()
    ended = uncontended_time()  # without a word
    assert watcher.next()[1] - ended < AT_ONCE
