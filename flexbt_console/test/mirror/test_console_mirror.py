# SPDX-License-Identifier: BSD-3-Clause
"""The mirror, whatever happens to the messages on their way."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.freshness import LOST_PERIODS, LinkState
from flexbt_console.mirror.mirror import LISTEN_SECONDS, Change, Mirror, Transit
from flexbt_console.mirror.records import (
    ActiveState,
    Behavior,
    BehaviorList,
    CommandKind,
    ExecutiveSnapshot,
    LogLine,
    OperatorCommand,
    Structure,
)
from flexbt_core.clock.clock import ManualClock


def snapshot(executive: str, sequence: int, period: float = 1.0) -> ExecutiveSnapshot:
    return ExecutiveSnapshot(executive, sequence, heartbeat_period=period, run_id=f'{executive}-{sequence}')


@given(
    lengths=st.lists(st.integers(1, 12), min_size=1, max_size=4),
    seed=st.integers(0, 2**32),
    loss=st.sampled_from([0.0, 0.3, 0.8]),
    skew=st.floats(-1e5, 1e5),
)
def test_the_mirror_equals_the_newest_message_that_came(
    lengths: list[int], seed: int, loss: float, skew: float
) -> None:
    """Executives that follow each other; their messages are lost, doubled and shuffled by up to a second."""
    rng = random.Random(seed)
    deliveries: list[tuple[float, float, ExecutiveSnapshot]] = []
    sent = 0.0
    for number, length in enumerate(lengths):
        for sequence in range(1, length + 1):
            sent += 0.1
            for _ in range(rng.choice([1, 1, 2])):
                if rng.random() >= loss:
                    deliveries.append((sent + rng.random(), sent, snapshot(f'e{number}', sequence)))
    deliveries.sort(key=lambda delivery: delivery[0])
    clock = ManualClock()
    mirror = Mirror(clock)
    newest = (-1.0, snapshot('nobody', 0))
    heard = 0.0
    for arrival, sent, message in deliveries:
        clock.set(arrival)
        newest = max(newest, (sent, message), key=lambda entry: entry[0])
        was_silent = mirror.view().snapshot is not None and arrival - heard > 1.5
        taken = mirror.receive_snapshot(message, Transit(sent + skew, arrival))
        heard = arrival if taken else heard
        if was_silent:
            return  # from here on, a straggler of an executive that has ended may have been taken
        assert mirror.view().snapshot == newest[1]


@given(st.permutations(range(1, 9)))
def test_without_times_of_sending_the_sequence_decides(order: list[int]) -> None:
    mirror = Mirror(ManualClock())
    seen = 0
    for sequence in order:
        taken = mirror.receive_snapshot(snapshot('e', sequence))
        assert taken == (sequence > seen)
        seen = max(seen, sequence)
        view = mirror.view()
        assert view.snapshot is not None and view.snapshot.sequence == seen


def test_repeated_messages_do_not_keep_a_picture_alive() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    for _ in range(20):
        clock.advance(0.5)
        mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    assert mirror.view().link is LinkState.LOST
    assert mirror.view().age == 10.0


def test_the_age_is_told_and_nothing_old_is_called_live() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    assert (mirror.view().link, mirror.view().age) == (LinkState.LOST, None)
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.01))
    assert mirror.view().link is LinkState.LIVE
    for advance, state in (
        (1.4, LinkState.LIVE),
        (0.2, LinkState.STALE),
        (3.3, LinkState.STALE),
        (0.2, LinkState.LOST),
    ):
        clock.advance(advance)
        assert mirror.view().link is state
    mirror.receive_snapshot(snapshot('e', 2), Transit(5.1, 5.11))
    assert mirror.view().link is LinkState.LIVE


@pytest.mark.parametrize(('lost_after', 'lost_age'), [(20.0, 20.0), (0.1, LOST_PERIODS)])
def test_a_link_is_lost_at_the_age_that_was_set_and_after_some_periods_at_the_soonest(
    lost_after: float, lost_age: float
) -> None:
    clock = ManualClock()
    mirror = Mirror(clock, lost_after=lost_after)
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    for age, state in ((lost_age - 0.1, LinkState.STALE), (lost_age + 0.1, LinkState.LOST)):
        clock.set(age)
        assert mirror.view().link is state


@given(
    period=st.one_of(st.floats(), st.sampled_from([0.0, -1.0, float('nan'), float('inf')])),
    transit=st.one_of(st.none(), st.floats(-1e9, 1e9)),
    wait=st.floats(0.0, 100.0),
)
def test_no_heartbeat_period_keeps_a_picture_live_for_long(period: float, transit: float | None, wait: float) -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    sent = None if transit is None else Transit(0.0, transit)
    mirror.receive_snapshot(snapshot('e', 1, period), sent)
    mirror.receive_snapshot(snapshot('e', 2, period), sent)
    clock.advance(wait)
    view = mirror.view()
    assert view.age is not None and view.age >= wait
    assert view.live == (mirror.view().link is LinkState.LIVE)
    if wait > 15.0:
        assert not view.live
    if wait > 25.0:
        assert view.link is LinkState.LOST


@pytest.mark.parametrize('gap', [0.0, 5.0])
@pytest.mark.parametrize(('age', 'link'), [(0.9, LinkState.LIVE), (600.0, LinkState.LOST)])
def test_a_kept_message_of_a_silent_executive_is_as_old_as_it_is(age: float, link: LinkState, gap: float) -> None:
    """A late subscriber gets the last message, however old. The next one is not, and shows that somebody is there."""
    clock = ManualClock()
    mirror = Mirror(clock)
    mirror.receive_snapshot(snapshot('e', 7), Transit(sent=0.0, received=age))
    view = mirror.view()
    assert view.link is link and view.age == age
    clock.advance(gap)
    mirror.receive_snapshot(snapshot('e', 8), Transit(sent=age + gap, received=age + gap + 0.01))
    assert mirror.view().link is LinkState.LIVE


def test_clocks_that_differ_delay_the_live_picture_by_one_echo_only() -> None:
    for skew in (-3600.0, 3600.0):
        clock = ManualClock()
        mirror = Mirror(clock)
        mirror.receive_snapshot(snapshot('e', 1), Transit(sent=0.0, received=skew))
        assert not mirror.view().live and mirror.wants_ping()
        clock.advance(0.01)
        mirror.receive_pong(-skew + 0.005)
        assert mirror.view().live and not mirror.wants_ping()
        clock.advance(1.0)
        mirror.receive_snapshot(snapshot('e', 2), Transit(sent=1.0, received=skew + 1.0))
        assert mirror.view().live


@given(
    skew=st.floats(-1e4, 1e4),
    ways=st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.booleans()), min_size=1, max_size=40),
)
def test_nothing_is_live_that_was_on_its_way_for_long_however_the_clocks_differ(
    skew: float, ways: list[tuple[float, float, bool]]
) -> None:
    """Ways there and back of any length, such as in a queue; ``skew`` is what the sender's clock is ahead."""
    clock = ManualClock(100.0)
    mirror = Mirror(clock)
    echoed = False
    for sequence, (there, back, is_echoed) in enumerate(ways, 1):
        clock.advance(6.0)  # no message passes another one
        mirror.receive_snapshot(snapshot('e', sequence), Transit(clock.now() - back + skew, clock.now()))
        if is_echoed:
            mirror.receive_pong(there + skew)
            echoed = True
        young = -0.05 <= back - skew <= 1.0  # may be taken for what it looks like, while there was no echo
        if young and not echoed:
            return
        assert not mirror.view().live or (echoed and back <= 2.5 + 1e-6)
        assert not is_echoed or there + back > 1.5 or mirror.view().live


def test_a_link_that_is_fast_again_is_measured_again() -> None:
    """All echoes came late: the bound that they give would make each picture old before the next one arrives."""
    clock = ManualClock()
    mirror = Mirror(clock)
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    mirror.receive_pong(1.6)
    assert mirror.wants_ping()
    mirror.receive_pong(0.001)
    assert not mirror.wants_ping()
    clock.advance(1.4)
    assert mirror.view().live


def test_an_executive_on_another_computer_is_measured_anew() -> None:
    mirror = Mirror(ManualClock())
    for sequence in (1, 2):
        mirror.receive_snapshot(snapshot('e', sequence), Transit(float(sequence), float(sequence)))
    for sequence in (1, 2):
        mirror.receive_snapshot(snapshot('f', sequence), Transit(10.0 + sequence, 110.0 + sequence))
    assert not mirror.view().live
    mirror.receive_pong(-99.99)
    assert mirror.view().live


def test_what_a_message_was_late_counts_as_age() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    for sequence, delay in ((1, 0.01), (2, 0.01), (3, 1.01)):
        clock.set(sequence + delay)
        mirror.receive_snapshot(snapshot('e', sequence), Transit(sent=float(sequence), received=clock.now()))
    age = mirror.view().age
    assert age is not None and abs(age - 1.0) < 1e-6


@pytest.mark.parametrize('is_echoed', [False, True])
@pytest.mark.parametrize('step', [-500.0, 500.0])
def test_a_clock_that_is_set_does_not_make_the_picture_old(step: float, is_echoed: bool) -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    for sequence in range(1, 40):
        clock.advance(1.0)
        ahead = step if sequence > 10 else 0.0
        mirror.receive_snapshot(snapshot('e', sequence), Transit(clock.now() + ahead, clock.now()))
        if is_echoed and sequence < 10:
            mirror.receive_pong(0.0)
        assert mirror.view().live, sequence


@given(step=st.floats(2.0, 5000.0), delay=st.floats(3.0, 50.0))
def test_a_clock_that_was_set_forward_hides_no_delay_that_comes_later(step: float, delay: float) -> None:
    clock = ManualClock()
    mirror = Mirror(clock)

    def receive(sequence: int, sent: float, ahead: float, by: float) -> None:
        clock.set(sent + by)
        mirror.receive_snapshot(snapshot('e', sequence), Transit(sent + ahead, clock.now()))
        if mirror.wants_ping():
            mirror.receive_pong(ahead + by)

    for sequence in range(1, 60):
        by = min(delay, max(0.0, 0.5 * (sequence - 20)))  # the link gets slower and slower
        receive(sequence, float(sequence), step * (sequence > 10), by)
        assert mirror.view().live or by >= 1.0, sequence
        assert not mirror.view().live or by <= 2.5, sequence


@pytest.mark.parametrize('is_echoed', [False, True])
@given(step=st.floats(-500.0, -16.0) | st.floats(0.0, 500.0), gap=st.integers(2, 15), waited=st.booleans())
def test_what_has_waited_while_a_clock_was_set_is_not_live(
    is_echoed: bool, step: float, gap: int, waited: bool
) -> None:
    """The link was cut, and its messages come then; or there were none, and an echo shows that the next one is new."""
    clock, sequences = ManualClock(), itertools.count(1)
    mirror = Mirror(clock)

    def receive(sent: float) -> None:
        mirror.receive_snapshot(snapshot('e', next(sequences)), Transit(sent, clock.now() + step * (sent > 5.0)))

    for _ in range(5):
        clock.advance(1.0)
        receive(clock.now())
        if is_echoed:
            mirror.receive_pong(0.0)
    clock.advance(gap)
    for late in range(gap - 1, 2, -1) if waited else ():
        receive(clock.now() - late)
        assert not mirror.view().live
    receive(clock.now())
    mirror.receive_pong(-step)
    assert mirror.view().live


@given(back=st.floats(16.0, 500.0), gap=st.integers(4, 15), since=st.integers(0, 15), overtaken=st.integers(0, 15))
def test_an_echo_from_after_a_clock_was_set_back_makes_nothing_live_that_was_sent_before(
    back: float, gap: int, since: int, overtaken: int
) -> None:
    """The echo overtakes messages that were held by the link, the last ones of them from after the clock was set."""
    clock = ManualClock()
    mirror = Mirror(clock)
    for sequence in range(1, 6 + gap):
        if sequence < 6:
            clock.advance(1.0)
        elif sequence == 6:
            clock.advance(gap)
        if sequence == 6 + overtaken % gap:
            mirror.receive_pong(-back)
        sent = float(sequence) - back * (sequence > 5 + gap - since % gap)
        mirror.receive_snapshot(snapshot('e', sequence), Transit(sent, clock.now()))
        if sequence < 6:
            mirror.receive_pong(0.0)
        assert mirror.view().live is (sequence < 6) or sequence > 2 + gap
    mirror.receive_pong(-back)
    assert mirror.view().live


@pytest.mark.parametrize('is_echoed', [False, True])
def test_a_computer_that_has_slept_takes_nothing_from_before_for_new(is_echoed: bool) -> None:
    """Its steady clock has stood still: neither a step of the wall clock, nor a command to be sent once more."""
    clock, asleep = ManualClock(), 0.0
    mirror = Mirror(clock, seconds_asleep=lambda: asleep)
    for sequence in range(1, 5):
        clock.advance(1.0)
        mirror.receive_snapshot(snapshot('e', sequence), Transit(clock.now(), clock.now() + 0.01))
    if is_echoed:
        mirror.receive_pong(0.0)
    mirror.give(OperatorCommand('1', CommandKind.STOP, 'ann'), timeout=5.0)
    assert mirror.view().live and len(mirror.due_commands(reachable=True)) == 1
    sent, asleep = clock.now() + 0.1, 3600.0
    view = mirror.view()
    assert view.link is LinkState.LOST and view.age is not None and view.age >= asleep
    assert mirror.due_commands(reachable=True) == [] and mirror.next_command_time(reachable=True) is None
    tracked = mirror.command('1')
    assert tracked is not None and tracked.state is CommandState.TIMEOUT
    clock.advance(0.2)
    mirror.receive_snapshot(snapshot('e', 5), Transit(sent, clock.now() + asleep))
    age = mirror.view().age
    assert not mirror.view().live and age is not None and age > asleep - 1.0
    mirror.receive_snapshot(snapshot('e', 6), Transit(clock.now() + asleep, clock.now() + asleep + 0.01))
    assert mirror.view().live
    change = mirror.next_link_change()
    assert change is not None
    clock.set(change)
    assert mirror.view().link is LinkState.STALE


def test_an_executive_is_listened_for_also_on_a_computer_that_has_slept_before() -> None:
    clock = ManualClock()
    mirror = Mirror(clock, seconds_asleep=lambda: 3600.0)
    change = mirror.next_link_change()
    assert mirror.view().listening and change is not None
    clock.set(change)
    assert not mirror.view().listening


def test_the_end_of_the_sender_is_seen_at_once() -> None:
    mirror = Mirror(ManualClock())
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    mirror.sender_gone()
    assert mirror.view().link is LinkState.LOST
    mirror.receive_snapshot(snapshot('f', 1), Transit(1.0, 1.0))
    assert mirror.view().link is LinkState.LIVE


def test_next_link_change_is_when_the_state_changes() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    assert mirror.next_link_change() == LISTEN_SECONDS  # from then on there is none
    mirror.receive_snapshot(snapshot('e', 1), Transit(0.0, 0.0))
    seen = []
    while (change := mirror.next_link_change()) is not None:
        clock.set(change)
        seen.append(mirror.view().link)
    assert seen == [LinkState.STALE, LinkState.LOST]


def test_structure_and_behaviors_belong_to_what_is_shown() -> None:
    mirror = Mirror(ManualClock())
    mirror.receive_structure(Structure('e-1', 'One'))
    mirror.receive_structure(Structure('e-2', 'Two'))
    mirror.receive_behaviors(BehaviorList('e', (Behavior('One'),)))
    mirror.receive_snapshot(snapshot('e', 2))
    view = mirror.view()
    assert view.structure is not None and view.structure.behavior == 'Two'
    assert view.behaviors == (Behavior('One'),)
    mirror.receive_snapshot(snapshot('f', 1))
    assert mirror.view().structure is None
    assert mirror.view().behaviors is None


@given(st.lists(st.integers(1, 30), max_size=60), st.lists(st.integers(1, 30), max_size=10))
def test_the_log_has_each_line_once_and_in_order(first: list[int], second: list[int]) -> None:
    mirror = Mirror(ManualClock())
    for sequence in first:
        mirror.receive_log(LogLine('e', sequence))
    for sequence in second:
        mirror.receive_log(LogLine('f', sequence))
    expected = [('e', n) for n in sorted(set(first))] + [('f', n) for n in sorted(set(second))]
    assert [(line.executive_id, line.sequence) for line in mirror.log()] == expected


def test_the_log_is_bounded() -> None:
    mirror = Mirror(ManualClock())
    for executive in range(10):
        for sequence in range(1, 2000):
            mirror.receive_log(LogLine(f'e{executive}', sequence))
    assert len(mirror.log(10**6)) <= 1500
    assert mirror.log(3)[-1].sequence == 1999
    assert mirror.log(0) == ()


def test_listeners_hear_of_changes_only() -> None:
    mirror = Mirror(ManualClock())
    heard: list[Change] = []
    mirror.add_listener(heard.append)
    mirror.receive_snapshot(snapshot('e', 2))
    mirror.receive_snapshot(snapshot('e', 1))
    mirror.set_problem('x')
    mirror.set_problem('x')
    mirror.receive_log(LogLine('e', 1))
    mirror.receive_log(LogLine('e', 1))
    assert heard == [Change.STATUS, Change.LINK, Change.LOG]


def test_active_levels_from_the_outside_in() -> None:
    mirror = Mirror(ManualClock())
    states = (ActiveState('/A/B/C'), ActiveState('/A/D'))
    mirror.receive_snapshot(ExecutiveSnapshot('e', 1, active_states=states))
    assert mirror.view().active_levels == ('/', '/A', '/A/B', '/A/B/C', '/A/D')
    assert mirror.view().lockable_paths == ('/A/B/C', '/A/B', '/A/D', '/A')
    mirror.receive_snapshot(ExecutiveSnapshot('e', 2, active_states=(ActiveState('/'),)))
    assert mirror.view().lockable_paths == ()


def test_a_number_that_was_never_the_executives_is_in_the_way_only_until_the_picture_is_silent() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    for number in range(1, 100):
        clock.set(number * 0.5)
        transit = Transit(clock.now(), clock.now())
        mirror.receive_snapshot(snapshot('e', number, period=0.5), transit)
        if number == 10:
            mirror.receive_snapshot(snapshot('e', 2**63, period=3600.0), transit)
    view = mirror.view()
    assert view.live and view.snapshot is not None and view.snapshot.sequence == 99
    # One that comes late is still none.
    assert not mirror.receive_snapshot(snapshot('e', 98), Transit(49.0, clock.now()))
