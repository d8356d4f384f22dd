# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that decide, loop and watch entries, against BehaviorTree.CPP: random trees."""

from __future__ import annotations

import pytest

from flexbt_testing.behavior_trees import conformance as bt_conformance
from flexbt_testing.behavior_trees import random_trees as bt_random_nodes
from flexbt_testing.behavior_trees import wheel as bt_wheel


@pytest.mark.skipif(not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4')
@pytest.mark.parametrize('block', bt_conformance.BLOCKS)
def test_random_trees_give_the_trace_of_btcpp(block: int) -> None:
    cases = [bt_random_nodes.control_case(seed) for seed in range(block * 200, (block + 1) * 200)]
    for case, expected, found in bt_conformance.compare(cases):
        assert not found, f'{found}\n{case}'
        assert 'crash' not in expected
