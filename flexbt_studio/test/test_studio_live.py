# SPDX-License-Identifier: BSD-3-Clause
"""What the pages of the studio are told about the debugger of a robot."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from typing import Any, cast

import pytest

from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror
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
from flexbt_core.clock.clock import ManualClock
from flexbt_studio.errors import StudioError
from flexbt_studio.server.live import LiveRobots, live_event
from flexbt_testing.waiting import DEADLINE

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


class Robots:
    """What LiveRobots uses of FleetLink. To open /b raises ``error``."""

    def __init__(self) -> None:
        self.mirrors = {name: Mirror(ManualClock()) for name in ('/a', '/b')}
        self.own, self.fleet = '/a', Fleet()
        for name, mirror in self.mirrors.items():
            self.fleet.add(name, mirror)
        self.opened: list[str] = []
        self.error: Exception | None = None

    def robot(self, name: str) -> list[Mirror]:
        """Return its mirror."""
        return [self.mirrors[name]]

    def open(self, name: str, operator: str) -> None:
        """Watch the robot."""
        if name == '/b' and self.error is not None:
            if isinstance(self.error, KeyError):
                del self.mirrors[name]
            raise self.error
        self.opened.append(name)

    def close(self, name: str) -> None:
        """Watch it no longer."""
        self.opened.remove(name)


@pytest.mark.parametrize('error', [KeyError('/b'), TimeoutError('busy'), RuntimeError("can't start new thread")])
def test_a_robot_that_cannot_be_opened_is_refused_and_others_stay_live(error: Exception) -> None:
    robots, told = Robots(), asyncio.Queue[dict[str, Any]]()

    async def run() -> None:
        live = LiveRobots(cast('FleetLink', robots), told.put_nowait)
        await live.watch('/a')
        robots.error = error
        with pytest.raises(StudioError, match='cannot be watched now'):
            await live.watch('/b')
        robots.mirrors['/a'].receive_snapshot(replace(SNAPSHOT, behavior='goes on'))
        while (event := await asyncio.wait_for(told.get(), DEADLINE))['behavior'] != 'goes on':
            assert event['robot'] == '/a'
        robots.error = None
        robots.mirrors.setdefault('/b', Mirror(ManualClock()))  # it is found again
        await live.watch('/b')
        assert robots.opened == ['/a', '/b']
        await live.close()
        assert robots.opened == []

    asyncio.run(run())
