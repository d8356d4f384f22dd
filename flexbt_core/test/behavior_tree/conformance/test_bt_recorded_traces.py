# SPDX-License-Identifier: BSD-3-Clause
"""Recorded traces of BehaviorTree.CPP, one for each rule that is easily got wrong: the engine gives the same.

They were recorded with 4.8.2; those for which 4.10, which the engine follows, gives another trace are marked in the
file, and have tests of their own.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from flexbt_testing.behavior_trees import conformance as bt_conformance
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted

VECTORS: list[dict[str, Any]] = [
    json.loads(line) for line in (Path(__file__).parent / 'bt_recorded_traces.jsonl').read_text().splitlines()
]
SAME = [vector for vector in VECTORS if vector['same_in_4.10']]

# Titles, and what the first difference is; docs/reference/bt_differences.md says why.
DIFFERS_ON_PURPOSE = {
    'setbb no output_key': 'port [output_key] of [SetBlackboard] is missing',
    'missing port': 'port [num_cycles] of type int of [Repeat] is missing',
    'NodeStatus port bad': "'success' is not a status",
    'explicit child in ReactiveSequence': 'load error',
    '= port bare': 'load error',
    'root-level Action without ID w/ models': 'load error',
    # The library halts the child when the time is up, the engine at the tick that finds it up.
    'Timeout': "step 1 ['sleep', 120]: 2 != 0 events",
}


@pytest.mark.parametrize('vector', SAME, ids=[vector['title'] for vector in SAME])
def test_a_recorded_trace(vector: dict[str, Any]) -> None:
    found = bt_conformance.difference(vector['trace'], bt_scripted.Run(vector['case']).trace())
    expected = DIFFERS_ON_PURPOSE.get(vector['title'])
    if expected is None:
        assert not found, found
    else:
        assert expected in found


def test_every_difference_is_one_of_a_vector() -> None:
    assert set(DIFFERS_ON_PURPOSE) <= {vector['title'] for vector in SAME}
