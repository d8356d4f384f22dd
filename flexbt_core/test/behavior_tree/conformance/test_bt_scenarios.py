# SPDX-License-Identifier: BSD-3-Clause
"""The scenarios of BehaviorTree.CPP's own tests: the engine gives the trace of the library, event by event, with all
blackboards.

(Those of which the library of the wheel, 4.8.2, has another opinion than 4.10 are in test_bt_names.py, and in the tests
of the nodes.)
"""

from __future__ import annotations

from typing import Any

import pytest
from bt_scenarios import THEMES, Row

from flexbt_testing.behavior_trees import conformance as bt_conformance
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees import wheel as bt_wheel

pytestmark = pytest.mark.skipif(
    not bt_wheel.available(), reason='the judge is not installed: pip install behaviortreepy==0.1.4'
)


def make_case(row: Row) -> dict[str, Any]:
    """Return a row as a case of bt_scripted."""
    _, trees, ops, *boards = row
    main, *others = trees.split('|')
    bodies = {'Main': main} | dict(other.split(':', 1) for other in others)
    texts = ''.join(f'<BehaviorTree ID="{id}">{body}</BehaviorTree>' for id, body in bodies.items())
    return {
        'xml': f'<root BTCPP_format="4" main_tree_to_execute="Main">{texts}</root>',
        'bb': boards[0] if boards else {},
        'ops': [make_op(op) for op in ops],
    }


def make_op(op: str) -> list[Any]:
    """t, o, h: tick exactly once, tick once, halt; ``i key number`` and the like write an entry."""
    match op.split():
        case ['t']:
            return ['tick']
        case ['o']:
            return ['once']
        case ['h']:
            return ['halt']
        case ['unset', key]:
            return ['unset', key]
        case ['s', text]:
            return ['set', 'my_var', 's', text]
        case ['i', key, number]:
            return ['set', key, 'i', int(number)]
        case ['b', key, truth]:
            return ['set', key, 'b', truth == '1']
    raise ValueError(op)


CASES = {f'{theme}: {row[0]}': make_case(row) for theme, rows in THEMES.items() for row in rows}


@pytest.fixture(scope='module')
def traces() -> dict[str, dict[str, Any]]:
    """Return what the library makes of all of them."""
    return dict(zip(CASES, bt_wheel.traces(CASES.values()), strict=True))


@pytest.mark.parametrize('title', CASES)
def test_the_trace_is_that_of_the_library(traces: dict[str, dict[str, Any]], title: str) -> None:
    expected = traces[title]
    assert 'crash' not in expected
    found = bt_conformance.difference(expected, bt_scripted.Run(CASES[title]).trace())
    assert not found, found


def test_titles_are_unique_and_scenarios_do_something(traces: dict[str, dict[str, Any]]) -> None:
    assert len(CASES) == sum(len(rows) for rows in THEMES.values())
    idle = [title for title, trace in traces.items() if not title.startswith('loading') and trace['load_error']]
    assert set(idle) <= {'reactive: two asynchronous children'}, [
        (title, traces[title]['load_error']) for title in idle
    ]
