# SPDX-License-Identifier: BSD-3-Clause
"""The table of commands: at most once, answered as often as asked."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from flexbt_msgs.msg import CommandResult
from flexbt_onboard.commands.command_table import REPORT_TIME, CommandTable


def test_a_resend_is_not_admitted_again_and_its_result_is_reported_last() -> None:
    table = CommandTable(reported=2)
    for name in 'abc':
        assert table.admit(name)
        table.settle(name, 'no' if name == 'a' else None)
    assert [result.command_id for result in table.latest()] == ['b', 'c']
    assert not table.admit('a')
    latest = table.latest()
    assert [result.command_id for result in latest] == ['c', 'a']
    assert (latest[1].code, latest[1].reason) == (CommandResult.REFUSED, 'no')


def test_a_command_that_is_not_decided_is_neither_reported_nor_admitted_again() -> None:
    table = CommandTable()
    assert table.admit('start')
    assert not table.admit('start')
    assert table.latest() == []
    table.settle('start')
    assert [result.code for result in table.latest()] == [CommandResult.APPLIED]


@given(st.lists(st.integers(0, 40), max_size=300))
def test_a_command_among_the_last_remembered_ones_is_never_admitted_twice(sends: list[int]) -> None:
    table = CommandTable(remembered=20, reported=5)
    order: list[int] = []  # model: distinct commands in the order of their first arrival
    for number in sends:
        new = number not in order[-20:]
        assert table.admit(str(number)) == new
        if new:
            order = [*(n for n in order if n != number), number]
            table.settle(str(number))
        assert len(table.latest()) <= 5
        assert table.latest()[-1].command_id == str(number)


def test_a_result_is_reported_for_a_time_and_again_when_it_is_asked_for() -> None:
    now = 100.0
    table = CommandTable(now=lambda: now)
    table.admit('a')
    table.settle('a')
    now += REPORT_TIME
    assert [result.command_id for result in table.latest()] == ['a']
    now += 0.1
    assert table.latest() == []
    assert not table.admit('a')
    assert [result.command_id for result in table.latest()] == ['a']


def test_an_undecided_command_is_not_forgotten() -> None:
    table = CommandTable(remembered=3)
    table.admit('start')
    for number in range(10):
        table.admit(str(number))
        table.settle(str(number))
    assert not table.admit('start')
