# SPDX-License-Identifier: BSD-3-Clause
"""Why decisions have waited, by the keys of the operator."""

from __future__ import annotations

from flexbt_console.ui.interaction import Attention
from flexbt_core.clock import ManualClock


def test_a_wait_is_by_others_unnoticed_or_by_its_own_interaction() -> None:
    clock = ManualClock()
    attention = Attention(clock)
    attention.pending(['a'])
    clock.advance(10.0)  # nobody looks
    attention.touched('a')
    clock.advance(1.0)
    attention.pending(['a', 'b'])
    clock.advance(3.0)
    assert attention.answered('a') == (0.0, 4.0)
    attention.pending(['b'])
    clock.advance(5.0)  # nobody looks
    attention.touched('b')
    attention.touched('b')
    clock.advance(2.0)
    assert attention.answered('b') == (3.0, 2.0)  # of the 10 s that it has waited


def test_going_to_another_decision_and_back_counts_for_each() -> None:
    clock = ManualClock()
    attention = Attention(clock)
    attention.pending(['a', 'b'])
    for decision in ('a', 'b', '', 'a'):
        attention.touched(decision)
        clock.advance(1.0)
    assert attention.answered('a') == (1.0, 2.0)
    waits = attention.answered('unheard of')
    assert waits == (0.0, 0.0) and all(type(one) is float for one in waits)  # the message takes nothing else
