# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that decide, loop and watch entries, against BehaviorTree.CPP: random trees, and recorded traces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bt_conformance
import bt_random_nodes
import bt_scripted
import bt_wheel
import pytest

VECTORS: list[dict[str, Any]] = [
    json.loads(line) for line in (Path(__file__).parent / 'bt_vectors.jsonl').read_text().splitlines()
]


@pytest.mark.skipif(not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4')
@pytest.mark.parametrize('block', range(3))
def test_random_trees_give_the_trace_of_btcpp(block: int) -> None:
    cases = [bt_random_nodes.make_case(seed) for seed in range(block * 200, (block + 1) * 200)]
    for case, expected, found in bt_conformance.compare(cases):
        assert not found, f'{found}\n{case}'
        assert 'crash' not in expected


@pytest.mark.parametrize('vector', VECTORS, ids=[vector['title'] for vector in VECTORS])
def test_a_recorded_trace(vector: dict[str, Any]) -> None:
    found = bt_conformance.difference(vector['trace'], bt_scripted.Run(vector['case']).trace())
    assert not found, found
