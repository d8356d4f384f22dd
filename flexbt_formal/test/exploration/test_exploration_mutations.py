# SPDX-License-Identifier: BSD-3-Clause
"""A sample of the seeded defects of ``benchmarks/proof_mutations.py``: found, and only where there is one."""

from __future__ import annotations

import pytest

from flexbt_formal.exploration.explorer import ExplorationLimits, explore, replay
from flexbt_testing.seeded_missions import DEFECTS, seeded_machine, seeded_tree

LIMITS = ExplorationLimits(seconds=600)


@pytest.mark.parametrize('defect', DEFECTS)
def test_a_defect_of_a_tree_is_found(defect: str) -> None:
    seed = DEFECTS.index(defect) + 7
    assert explore(seeded_tree(seed).system, '', limits=LIMITS).holds
    wrong = seeded_tree(seed, defect)
    report = explore(wrong.system, '', limits=LIMITS)
    assert not report.holds
    found = report.counterexamples[0]
    if found.violation.property.is_shown_by_a_way:  # the others are about what does not follow
        assert found.violation in replay(wrong.system, found.moves)


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_a_wrong_target_is_found(seed: int) -> None:
    assert explore(seeded_machine(seed).system, '', limits=LIMITS).holds
    wrong = seeded_machine(seed, is_defective=True)
    assert wrong.machine is None or not explore(wrong.system, '', limits=LIMITS).holds, wrong.defect
