# SPDX-License-Identifier: BSD-3-Clause
"""Whose messages are the executive's: of the first that was heard, unless it is gone or silent."""

from __future__ import annotations

import pytest

from flexbt_common.middleware.received_messages import UNKNOWN_WRITER
from flexbt_console.link import executive_sender
from flexbt_console.link.executive_sender import RETURN_SECONDS, ExecutiveSender, Succession

FIRST, OTHER, THIRD = (bytes([number]) * 12 for number in (1, 2, 3))
SAME, NEXT, INSTEAD = Succession
REFUSED = None


class Domain:
    """Participants, and a console that hears them."""

    def __init__(self) -> None:
        self.now = 100.0
        self.there = {FIRST, OTHER, THIRD}
        self.is_silent = False
        self.sender = ExecutiveSender(lambda one: one in self.there, lambda: self.is_silent, lambda: self.now)

    def status(self, participant: bytes) -> Succession | None:
        """Return what becomes of a status that a participant sends."""
        if not self.sender.has_sent(participant):
            return REFUSED
        self.is_silent = False
        return self.sender.follow(participant)

    def late(self, participant: bytes) -> Succession | None:
        """Return the same, when the executive has not been heard for too long."""
        self.is_silent = True
        return self.status(participant)


@pytest.fixture
def domain() -> Domain:
    made = Domain()
    assert made.status(FIRST) is SAME
    return made


def test_another_one_is_refused_while_the_executive_is_there_and_heard(domain: Domain) -> None:
    assert [domain.status(one) for one in (OTHER, FIRST, OTHER)] == [REFUSED, SAME, REFUSED]


def test_one_that_is_gone_is_replaced(domain: Domain) -> None:
    domain.there.remove(FIRST)
    domain.now += 1.0
    assert [domain.status(one) for one in (OTHER, OTHER, THIRD)] == [NEXT, SAME, REFUSED]


def test_one_that_was_late_is_the_executive_again(domain: Domain) -> None:
    assert domain.late(OTHER) is NEXT
    assert domain.sender.has_sent(FIRST)  # what comes before its status, such as a structure
    assert [domain.status(one) for one in (FIRST, OTHER)] == [INSTEAD, REFUSED]


def test_those_that_came_after_it_were_all_in_its_place(domain: Domain) -> None:
    assert [domain.late(one) for one in (OTHER, THIRD)] == [NEXT] * 2
    assert [domain.status(one) for one in (FIRST, OTHER, THIRD)] == [INSTEAD, REFUSED, REFUSED]


@pytest.mark.parametrize('wait', [RETURN_SECONDS, 10.0 * RETURN_SECONDS])
def test_one_that_does_not_come_back_in_time_has_lost_its_place(domain: Domain, wait: float) -> None:
    assert domain.late(OTHER) is NEXT
    domain.now += wait
    assert [domain.status(one) for one in (FIRST, OTHER)] == [REFUSED, SAME]


def test_what_is_no_status_replaces_nobody(domain: Domain) -> None:
    domain.is_silent = True
    assert domain.sender.has_sent(OTHER)  # and could not be unpacked
    assert domain.status(FIRST) is SAME


def test_where_writers_are_not_told_every_status_counts() -> None:
    domain = Domain()
    assert {domain.status(UNKNOWN_WRITER) for _ in range(3)} == {SAME}


def test_only_so_many_are_remembered(domain: Domain, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executive_sender, '_MOST_REPLACED', 2)
    assert {domain.late(number.to_bytes(12)) for number in range(10)} == {NEXT}
    assert domain.status(FIRST) is INSTEAD


def test_one_that_answers_in_the_place_of_another_is_the_executive(domain: Domain) -> None:
    assert domain.status(OTHER) is REFUSED
    assert domain.sender.follow(OTHER, answers=True) is INSTEAD
    assert [domain.status(one) for one in (FIRST, OTHER)] == [REFUSED, SAME]


@pytest.mark.parametrize(('early', 'succession'), [([FIRST], SAME), ([FIRST, OTHER], INSTEAD), ([OTHER], INSTEAD)])
def test_what_came_before_the_executive_was_known_may_be_of_others(early: list[bytes], succession: Succession) -> None:
    domain = Domain()
    assert all(domain.sender.has_sent(one) for one in early)
    assert [domain.status(FIRST), domain.status(FIRST)] == [succession, SAME]
