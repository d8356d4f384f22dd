# SPDX-License-Identifier: BSD-3-Clause
"""The time line of a recording on the screen: lanes, and keys that go to failures, decisions and changes."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.pilot import Pilot

from flexbt_common import names
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import RefusedError
from flexbt_console.mirror.lanes import Lane, LaneEntry
from flexbt_console.present.cells import width
from flexbt_console.present.lane_lines import HEAD, lane_lines
from flexbt_console.present.style import ASCII, UNICODE
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.run_file import write_recording
from flexbt_console.ui.screen.app import OperatorScreen
from flexbt_console.ui.screen.pane import Pane
from flexbt_console.ui.screen.replay_bar import NOTHING_SENT, NoLink, ReplayBar
from flexbt_console.ui.station import Attention, Station
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.msg import (
    ActiveState,
    ExecutiveLog,
    ExecutiveStatus,
    PendingDecision,
    TreeNode,
    TreeStatus,
    TreeStructure,
)
from flexbt_msgs.msg import TreeStatusChange as Change


def recording(file: Path) -> Path:
    """Return a run of twenty seconds: Plan, then Drive, which is asked about at 4 s; errors at 6 and 9 s; a node that
    fails at 12 s."""
    said: list[tuple[float, str, Any]] = []
    for second in range(21):
        status = ExecutiveStatus(executive_id='e', sequence=second + 1, state=ExecutiveStatus.RUNNING, run_id='r')
        status.behavior, status.heartbeat_period, status.stamp.sec = 'Patrol', 1.0, 100 + second
        status.active_states = [ActiveState(path='/Plan' if second < 3 else '/Drive')]
        if 4 <= second < 6:
            status.decisions = [PendingDecision(id='d', kind=PendingDecision.TRANSITION, path='/Drive', outcome='done')]
        said.append((second, names.EXECUTIVE_STATUS, status))
    for number, second in enumerate((6, 9)):
        line = ExecutiveLog(executive_id='e', sequence=number + 1, severity=ExecutiveLog.ERROR, text=f'lost {second}')
        line.stamp.sec = 100 + second
        said.append((second, names.EXECUTIVE_LOG, line))
    nodes = [TreeNode(uid=1, name='Main', path='/Main'), TreeNode(uid=2, parent=1, name='Follow', path='/Main/Follow')]
    said.append((3.0, names.TREE_STRUCTURE, TreeStructure(run_id='t', behavior_tree='Drive', nodes=nodes, number=1)))
    for number, (second, statuses) in enumerate(((4, [1, 1]), (12, [1, 3]), (14, [1, 2]))):
        tree = TreeStatus(run_id='t', sequence=number + 1, structure=1, statuses=statuses)
        tree.stamp.sec = 100 + second
        tree.changes = [Change(uid=uid + 1, status=status, stamp=tree.stamp) for uid, status in enumerate(statuses)]
        said.append((second, names.TREE_STATUS, tree))
    ordered = sorted(said, key=lambda one: one[0])
    write_recording(file, [(round((1_000 + when) * 1e9), topic, message) for when, topic, message in ordered])
    return file


def test_the_screen_goes_from_failure_to_failure_and_to_decisions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('flexbt_console.ui.screen.replay_bar.PATIENCE', math.inf)  # however slow the machine is
    monkeypatch.setenv('FLEXBT_ASCII', '1')
    clock = ManualClock()
    bar = ReplayBar(RunPlayer(recording(tmp_path / 'run.mcap')), clock)

    async def shows(pilot: Pilot[None], key: str, time: float, *words: str) -> None:
        app = pilot.app
        assert isinstance(app, OperatorScreen)
        await pilot.press(key)
        app.draw()
        await pilot.pause()
        assert bar.player.time == pytest.approx(time), key
        text = '\n'.join(str(pane._text) for pane in app.query(Pane))
        for word in words:
            assert word in text, (word, text)

    async def run() -> None:
        make = CommandBuilder(None, NOTHING_SENT)
        station = Station(bar.player.mirror, NoLink(), make, 1.0, Attention(clock), 'it was a recording')
        app = OperatorScreen(station, clock, replay=bar)
        async with app.run_test(size=(80, 24)) as pilot:
            await shows(pilot, 'right_square_bracket', 6.0, 'lost 6', '[>Drive', '?Drive', 'xlost 9 error')
            await shows(pilot, 'right_square_bracket', 9.0, 'lost 9', 'xFollow failure')
            await shows(pilot, 'right_square_bracket', 12.0)
            await shows(pilot, 'right_square_bracket', 12.0, 'no later failure')
            await shows(pilot, 'left_curly_bracket', 4.0, '/Drive wants done')
            await shows(pilot, 'left_curly_bracket', 4.0, 'no earlier decision')
            await shows(pilot, 'left', 3.0)
            await shows(pilot, 'right', 4.0)
            await shows(pilot, 'right_parenthesis', 4.0)
            for pane in app.query(Pane):
                assert pane.region.bottom <= 24 and pane.region.right <= 80
            lanes = app.query_one('#lanes', Pane)
            assert [str(row)[:HEAD].strip() for row in str(lanes._text).split('\n')] == [
                'States',
                'Nodes',
                'Decisions',
                'Faults',
            ]
            await shows(pilot, 'z', 4.0)
            assert not lanes.display  # another pane has the room

    asyncio.run(run())


def test_what_was_not_read_yet_is_not_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bar = ReplayBar(RunPlayer(recording(tmp_path / 'run.mcap')), ManualClock())
    monkeypatch.setattr('flexbt_console.ui.screen.replay_bar.PATIENCE', -1.0)
    for move in ('next failure', 'previous decision'):
        with pytest.raises(RefusedError, match='still being read'):
            bar.move(move)
    monkeypatch.setattr('flexbt_console.ui.screen.replay_bar.PATIENCE', math.inf)
    bar.move('next failure')
    assert bar.player.time == pytest.approx(6.0)


def test_of_a_recording_that_is_cut_the_lanes_go_as_far_as_it_does(tmp_path: Path) -> None:
    file = recording(tmp_path / 'run.mcap')
    whole = {(one.lane, one.key, one.begin) for one in RunPlayer(file).lanes().since()}
    data = file.read_bytes()
    counts = []
    for share in (0.5, 0.7, 0.9):
        cut = tmp_path / f'cut{share}.mcap'
        cut.write_bytes(data[: int(share * len(data))])
        known = {(one.lane, one.key, one.begin) for one in RunPlayer(cut).lanes().since()}
        assert known <= whole
        counts.append(len(known))
    assert counts == sorted(counts) and counts[0] > 0
    assert {lane for lane, _, _ in whole} == {Lane.STATES, Lane.NODES, Lane.DECISIONS, Lane.FAULTS}


@pytest.mark.parametrize('columns', [12, 20, 80, 300])
def test_each_row_has_as_many_cells_as_there_are(tmp_path: Path, columns: int) -> None:
    player = RunPlayer(recording(tmp_path / 'run.mcap'))
    for begin in (-5.0, 0.0, 7.3, 30.0):
        lines = lane_lines(player.lanes().since(), begin, begin + 9.0, begin + 2.0, columns, ASCII)
        assert len(lines) == 4 and all(len(line) <= columns and '|' in line for line in lines)


@given(
    entries=st.lists(
        st.builds(
            lambda lane, label, begin, seconds: LaneEntry(0, lane, label, label, begin, begin + seconds, '完了'),
            st.sampled_from(Lane),
            st.sampled_from(['充電', 'Drive', '荷物を置く']),
            st.floats(0.0, 60.0),
            st.floats(0.0, 20.0),
        ),
        max_size=12,
    ),
    at=st.floats(0.0, 60.0),
)
def test_wide_characters_move_neither_the_cursor_nor_what_is_behind_them(entries: list[LaneEntry], at: float) -> None:
    lines = lane_lines(entries, 0.0, 60.0, at, 80, UNICODE)
    assert {width(line) for line in lines} <= {79}
    assert len({width(line[: line.index('|')]) for line in lines}) <= 1


def test_what_was_over_at_the_beginning_of_a_recording_is_over() -> None:
    short = [LaneEntry(1, Lane.FAULTS, '', 'lost', 0.0, 0.0, 'error'), LaneEntry(2, Lane.STATES, '/A', 'A', 0.0, 0.0)]
    states, faults = lane_lines(short, 0.0, 60.0, 50.0, 80, ASCII)
    assert '-' not in states + faults
