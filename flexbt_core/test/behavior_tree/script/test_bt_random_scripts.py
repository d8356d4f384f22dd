# SPDX-License-Identifier: BSD-3-Clause
"""Scripts, pre- and post-conditions against BehaviorTree.CPP: random trees."""

from __future__ import annotations

import pytest

from flexbt_testing.behavior_trees import conformance as bt_conformance
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees import wheel as bt_wheel
from flexbt_testing.behavior_trees.random_trees import script_case


@pytest.mark.skipif(not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4')
@pytest.mark.parametrize('block', bt_conformance.BLOCKS)
def test_random_trees_give_the_trace_of_btcpp(block: int) -> None:
    cases = [script_case(seed) for seed in range(block * 400, (block + 1) * 400)]
    failing = 0
    for case, expected, found in bt_conformance.compare(cases):
        assert not found, f'{found}\n{case}'
        assert 'crash' not in expected
        failing += any(step['error'] for step in expected['steps'])
    assert 20 < failing < 160, 'some scripts have to fail, and most must not'


def test_a_tree_does_the_same_when_nobody_looks() -> None:
    for seed in range(250):
        case = script_case(seed)
        case['ops'] *= 2  # more of it by the code that is made of the scripts
        seen, unseen = (bt_scripted.Run(case, observed=observed).trace() for observed in (True, False))
        for step in [*seen['steps'], seen['final']]:
            step['events'] = [event for event in step['events'] if event[0] != 'st']
        assert unseen == seen, case
