# SPDX-License-Identifier: BSD-3-Clause
"""What the pages of the studio are told about the debugger of a robot."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    ActiveState,
    BreakpointKind,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    TreeBreakpoint,
    TreeHold,
)
from flexbt_console.mirror.view import View
from flexbt_studio.server.live import live_event

HOSTILE = '\u202e\x1b[2J</script>'
SNAPSHOT = ExecutiveSnapshot(
    'e1',
    1,
    active_states=(ActiveState('/Run', tree_run_id='r1'), ActiveState('/Rest')),
    decisions=(Decision('d1', DecisionKind.TRANSITION, '/Rest', 'done'),),
    breakpoints=('/Rest',),
    tree_holds=(TreeHold('r1', 'Main', f'Add{HOSTILE}', f'ann{HOSTILE}', 90.0, 'breakpoint', (HOSTILE,)),),
    tree_breakpoints=(
        TreeBreakpoint(BreakpointKind.BREAK, 'Main', 'Add', 'x > 1', operator='ann', stamp=80.0, hits=2),
        TreeBreakpoint(BreakpointKind.DUMMY, 'Main', 'Rest', status=200, problem=HOSTILE),
        TreeBreakpoint(BreakpointKind.UNKNOWN, 'Main', 'Rest'),
    ),
    stamp=100.0,
)


def event(snapshot: ExecutiveSnapshot | None) -> dict[str, Any]:
    made = live_event('/', View(LinkState.LIVE, 0.0, snapshot=snapshot))
    read: dict[str, Any] = json.loads(json.dumps(made, allow_nan=False))
    return read


def test_a_held_tree_is_told_once_and_not_with_each_heartbeat() -> None:
    assert event(SNAPSHOT) == event(replace(SNAPSHOT, sequence=2, stamp=107.5))
    later = replace(SNAPSHOT.tree_holds[0], since=90.25)  # held again there, within a second
    assert event(SNAPSHOT) != event(replace(SNAPSHOT, tree_holds=(later,)))


def test_what_is_set_and_held_is_told_by_tree_path_and_run() -> None:
    told = event(SNAPSHOT)
    [hold] = told['holds']
    assert (hold['run'], hold['tree'], hold['path'], hold['since']) == ('r1', 'Main', f'Add{HOSTILE}', 90.0)
    assert 'HELD before Add' in hold['text'] and 'ann' in hold['text']
    assert not {'\u202e', '\x1b'} & {*hold['text']}
    marks = [(one['path'], one['mark'], one['condition']) for one in told['points']]
    assert marks == [('Add', 'breakpoint', 'x > 1'), ('Rest', 'dummy ?', ''), ('Rest', 'unknown ?', '')]
    assert (told['breakpoints'], told['waiting'], told['runners']) == (['/Rest'], ['/Rest'], {'r1': '/Run'})


def test_of_a_robot_that_was_never_heard_nothing_is_told_about_the_debugger() -> None:
    assert not {'holds', 'points', 'breakpoints'} & event(None).keys()
