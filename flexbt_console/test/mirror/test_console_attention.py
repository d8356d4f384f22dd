# SPDX-License-Identifier: BSD-3-Clause
"""Why decisions have waited, by the keys of the operator."""

from __future__ import annotations

from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import CommandKind, Decision, DecisionKind, ExecutiveSnapshot, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.ui.station import Attention
from flexbt_core.clock.clock import ManualClock


def robot(executive: str, *decisions: str) -> View:
    """Return what a robot asks."""
    asked = tuple(Decision(one, DecisionKind.CHOICE, '/S') for one in decisions)
    return View(LinkState.LIVE, 0.0, snapshot=ExecutiveSnapshot(executive, 0, decisions=asked))


def test_a_wait_is_by_others_unnoticed_or_by_its_own_interaction() -> None:
    clock = ManualClock()
    attention = Attention(clock)
    attention.pending([robot('e', 'a')])
    clock.advance(10.0)  # nobody looks
    attention.touched(robot('e', 'a'), 'a')
    clock.advance(1.0)
    attention.pending([robot('e', 'a', 'b')])
    clock.advance(3.0)
    assert attention.answered(('e', 'a')) == (0.0, 4.0)
    attention.pending([robot('e', 'b')])
    clock.advance(5.0)  # nobody looks
    attention.touched(robot('e', 'b'), 'b')
    attention.touched(robot('e', 'b'), 'b')
    clock.advance(2.0)
    assert attention.answered(('e', 'b')) == (3.0, 2.0)  # of the 10 s that it has waited


def test_going_to_another_decision_and_back_counts_for_each() -> None:
    clock = ManualClock()
    attention = Attention(clock)
    attention.pending([robot('e', 'a', 'b')])
    for decision in ('a', 'b', None, 'a'):
        attention.touched(robot('e', 'a', 'b'), decision)
        clock.advance(1.0)
    assert attention.answered(('e', 'a')) == (1.0, 2.0)
    waits = attention.answered(('e', 'unheard of'))
    assert waits == (0.0, 0.0) and all(type(one) is float for one in waits)  # the message takes nothing else


def test_decisions_of_two_robots_that_are_called_the_same_are_two() -> None:
    clock = ManualClock()
    attention, one, other = Attention(clock), robot('e', 'input-1'), robot('f', 'input-1')
    attention.pending([one, other])
    attention.touched(one, 'input-1')
    clock.advance(7.0)
    attention.touched(other, 'input-1')
    clock.advance(2.0)
    sent = attention.measured(OperatorCommand('c', CommandKind.ANSWER, 'ann', 'f', decision_id='input-1'))
    assert (sent.wait_queue, sent.wait_interaction) == (7.0, 2.0)
    stop = OperatorCommand('d', CommandKind.STOP, 'ann', 'f')
    assert attention.measured(stop) is stop
