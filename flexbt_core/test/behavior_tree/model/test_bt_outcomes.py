# SPDX-License-Identifier: BSD-3-Clause
"""What each rule says of a node: its possible results, which children are ticked, and when all this is at the earliest.

That no run contradicts the rules is a test of ``bt_tool check``; here is how much they say.
"""

from __future__ import annotations

import pytest

from flexbt_core.behavior_tree.model.outcomes import (
    Choice,
    Exchanged,
    InOrder,
    Lasting,
    OneOf,
    Outcomes,
    Recovered,
    Repeated,
    Results,
    TimeLimit,
    Times,
    WithDefault,
)
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, PortValue
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS
from flexbt_testing.behavior_trees.steps import LETTERS, NAMES

SEQUENCE, FALLBACK = InOrder(SUCCESS), InOrder(FAILURE)
MEMORY = InOrder(SUCCESS, yields=True, remembers=True)
REPEAT, RETRY, RECOVERY = Repeated('n', SUCCESS), Repeated('n', FAILURE), Recovered('n')
LIMIT, DELAY = TimeLimit('n'), Exchanged(waits=True, delay='n')

# Rule; its port: a number, a pointer, or not given; the children, with letters and earliest times of their results.
# Then the possible results, and x for each child that may be ticked; the earliest times of results and of starts.
ROWS: list[tuple[Outcomes, int | str | None, str, str, str]] = [
    (SEQUENCE, None, 'S1 F2 R, S3 F4 R, S5 R', 'SFR xxx', 'F2 S9 | 0 1 4'),
    (SEQUENCE, None, 'S1 K2, S3 K1', 'SK xx', 'K2 S2 | 0 1'),
    (SEQUENCE, None, 'F1, S2', 'F x.', 'F1 | 0 inf'),
    (SEQUENCE, None, 'S1, F2', 'F xx', 'F3 | 0 1'),
    (FALLBACK, None, 'S1 F2 R, S3 F4 R, S5 R', 'SR xxx', 'S1 | 0 2 6'),
    (FALLBACK, None, 'S1 K2, S3 K1', 'SK xx', 'K3 S1 | 0 2'),
    (FALLBACK, None, 'F1, S2', 'S xx', 'S3 | 0 1'),
    (FALLBACK, None, 'S1, F2', 'S x.', 'S1 | 0 inf'),
    (MEMORY, None, 'S1 F2 R, S3 F4 R, S5 R', 'SFR xxx', 'F2 S5 | 0 0 0'),
    (MEMORY, None, 'S1 K2, S3 K1', 'SRK xx', 'K1 S1 | 0 0'),
    (MEMORY, None, 'F1, S2', 'FR x.', 'F1 S2 | 0 0'),
    (MEMORY, None, 'S1, F2', 'FR xx', 'F2 | 0 0'),
    (InOrder(FAILURE, yields=True), None, 'F1, F2', 'FR xx', 'F3 | 0 1'),
    (Choice(), None, 'S1 F2 R, S3 F4 R', 'SFR xx', 'F0 S4 | 0 1'),
    (Choice(), None, 'S1 F2 R, S3 F4 R, S5 R', 'SFR xxx', 'F5 S4 | 0 1 2'),
    (Choice(), None, 'S1, S3 F4 R, S5 R', 'SFR xx.', 'F5 S4 | 0 1 inf'),
    (Choice(), None, 'F2 R, S3 F4 R', 'FR x.', 'F0 | 0 inf'),
    (DELAY, None, 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (DELAY, None, 'S1 K2', 'SRK x', 'K2 S1 | 0'),
    (DELAY, 500, 'S1 F2 R', 'SFR x', 'F2.5 S1.5 | 0.5'),
    (DELAY, 500, 'S1 K2', 'SRK x', 'K2 S1 | 0'),
    (DELAY, '{n}', 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (DELAY, '{n}', 'S1 K2', 'SRK x', 'K2 S1 | 0'),
    (Exchanged(success=FAILURE, failure=SUCCESS), None, 'S1 F2 R', 'SFR x', 'F1 S2 | 0'),
    (Exchanged(success=RUNNING, skipped=RUNNING), None, 'S1 F2 K3', 'FR x', 'F2 | 0'),
    (Exchanged(failure=SUCCESS), None, 'S1 F2 R', 'SR x', 'S1 | 0'),
    (REPEAT, 3, 'S1 F2 R', 'SFR x', 'F2 S3 | 0'),
    (REPEAT, 1, 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (REPEAT, 0, 'S1 F2 R', 'S .', 'F2 S0 | 0'),
    (REPEAT, -1, 'S1 F2 R', 'FR x', 'F2 | 0'),
    (REPEAT, -2, 'S1 F2 R', 'S .', 'F2 S0 | 0'),
    (REPEAT, '{n}', 'S1 F2 R', 'SFR x', 'F2 S0 | 0'),
    (REPEAT, 3, 'S1 F2 K3', 'SFRK x', 'F2 K3 S1 | 0'),
    (REPEAT, 3, 'K3', 'K x', 'K3 | 0'),
    (RETRY, 3, 'S1 F2 R', 'SFR x', 'F6 S1 | 0'),
    (RETRY, 1, 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (RETRY, 0, 'S1 F2 R', 'F .', 'F0 S1 | 0'),
    (RETRY, -1, 'S1 F2 R', 'SR x', 'S1 | 0'),
    (RETRY, -2, 'S1 F2 R', 'F .', 'F0 S1 | 0'),
    (RETRY, '{n}', 'S1 F2 R', 'SFR x', 'F0 S1 | 0'),
    (RETRY, 3, 'S1 F2 K3', 'SFRK x', 'F2 K3 S1 | 0'),
    (RETRY, 3, 'K3', 'K x', 'K3 | 0'),
    (RECOVERY, 2, 'S1 F2 R, S3 F4 R', 'SFR xx', 'F2 S1 | 0 2'),
    (RECOVERY, 0, 'S1 F2 R, S3 F4 R', 'SFR x.', 'F2 S1 | 0 2'),
    (RECOVERY, -1, 'S1 F2 R, S3 F4 R', 'F ..', 'F0 | 0 2'),
    (RECOVERY, '{n}', 'S1 F2 R, S3 F4 R', 'SFR xx', 'F0 S1 | 0 2'),
    (RECOVERY, None, 'S1 F2 R, S3 F4 R', 'SFR xx', 'F0 S1 | 0 2'),
    (RECOVERY, 2, 'S1, S1', 'S x.', 'S1 | 0 inf'),
    (RECOVERY, 2, 'F1, S1 F1', 'F xx', 'F1 | 0 1'),
    (LIMIT, 2000, 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (LIMIT, 2000, 'S3', 'S x', 'F2 | 0'),
    (LIMIT, 0, 'S1 F2 R', 'SFR x', 'F2 S1 | 0'),
    (LIMIT, 0, 'S3', 'S x', 'S3 | 0'),
    (LIMIT, 0, 'S3 R', 'SR x', 'S3 | 0'),
    (LIMIT, '{n}', 'S3 R', 'SFR x', 'F0 S3 | 0'),
    (LIMIT, '{n}', 'S1 F2 R', 'SFR x', 'F0 S1 | 0'),
    (LIMIT, '{n}', 'S3', 'S x', 'F0 S3 | 0'),
    (LIMIT, 2000, 'S3 K1 R', 'SFRK x', 'F0 K1 S3 | 0'),
    (LIMIT, 2000, 'S3 K2 R', 'SFRK x', 'F2 | 0'),
    (LIMIT, 2000, 'S2 K3 R', 'SFRK x', 'F2 | 0'),
    (OneOf((SUCCESS, RUNNING)), None, '', 'SR', 'S0 |'),
    (Lasting((RUNNING, SUCCESS), 'n', 0.001), 500, '', 'SR', 'S0.5 |'),
    (Lasting((RUNNING, SUCCESS), 'n'), -2, '', 'SR', 'S2 |'),
    (Lasting((RUNNING, SUCCESS), 'n', 0.001), '{n}', '', 'SR', 'S0 |'),
    (Lasting((RUNNING, SUCCESS), 'n', 0.001), None, '', 'SR', 'S0 |'),
    (WithDefault('n'), 1, '', 'S', 'S0 |'),
    (WithDefault('n'), '{n}', '', 'SF', 'F0 S0 |'),
    (WithDefault('n'), None, '', 'SF', 'F0 S0 |'),
    (OneOf((SUCCESS,)), None, 'S1 F2 R', 'S x', 'S0 | 0'),
]


@pytest.mark.parametrize(('rule', 'port', 'children', 'possible', 'earliest'), ROWS)
def test_what_a_rule_says(rule: Outcomes, port: int | str | None, children: str, possible: str, earliest: str) -> None:
    pairs = [[(LETTERS[word[0]], word[1:]) for word in child.split()] for child in children.split(', ') if child]
    results: list[Results] = [frozenset(result for result, _ in child) for child in pairs]
    times: list[Times] = [{result: float(time) for result, time in child if result is not RUNNING} for child in pairs]
    values = {} if port is None else {'n': PortValue('9', None, port)}
    if isinstance(port, str):
        values = {'n': PortValue(port, 'n', NO_DEFAULT)}
    known = rule.possible(values, results)
    ticked = ''.join('x' if one else '.' for one in known.ticked)
    assert f'{"".join(letter for letter in "SFRK" if LETTERS[letter] in known.results)} {ticked}'.rstrip() == possible
    first = rule.earliest(values, times)
    ends = ' '.join(sorted(f'{NAMES[result]}{time:g}' for result, time in first.results.items()))
    assert f'{ends} | {" ".join(f"{time:g}" for time in first.begins)}'.rstrip() == earliest


def test_what_decides_whether_a_child_is_ticked() -> None:
    assert [SEQUENCE.deciding({}, child) for child in range(3)] == [None, 0, 1]
    assert [Choice().deciding({}, child) for child in range(3)] == [0, 0, 0]
    for count, decides in ((0, None), (2, 0)):
        assert RECOVERY.deciding({'n': PortValue('', None, count)}, 1) == decides
