# SPDX-License-Identifier: BSD-3-Clause
"""A recording on the screen: what is seen at each of its times, and that nothing is commanded."""

from __future__ import annotations

import asyncio
from pathlib import Path

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from textual.pilot import Pilot

from flexbt_common import names
from flexbt_console.commands import CommandBuilder
from flexbt_console.recording.definitions import full_definition
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.run_file import RunWriter
from flexbt_console.ui.screen import NoLink, OperatorScreen, ReplayBar
from flexbt_core.clock import ManualClock
from flexbt_msgs.msg import ActiveState, ExecutiveStatus

STATUS = 'flexbt_msgs/msg/ExecutiveStatus'


def recording(file: Path) -> Path:
    """A run of ten states, each for a second."""
    writer = RunWriter(file)
    writer.add_topic(names.EXECUTIVE_STATUS, '/executive/status', STATUS, full_definition(STATUS))
    for second in range(11):
        status = ExecutiveStatus(
            executive_id='e', sequence=second + 1, state=ExecutiveStatus.RUNNING, run_id='r', behavior='Patrol'
        )
        status.heartbeat_period = 1.0
        status.stamp = Time(sec=100 + second)
        status.active_states = [ActiveState(path=f'/State{second}', entered=status.stamp)]
        when = (1_000 + second) * 10**9
        writer.add(names.EXECUTIVE_STATUS, serialize_message(status), when, when)
    writer.close()
    return file


def text_of(app: OperatorScreen) -> str:
    return '\n'.join(''.join(segment.text for segment in line) for line in app.screen._compositor.render_strips())


def test_a_recording_is_played_stepped_searched_and_takes_no_command(tmp_path: Path) -> None:
    clock = ManualClock()
    bar = ReplayBar(RunPlayer(recording(tmp_path / 'run.mcap')), clock)

    async def shows(pilot: Pilot[None], *words: str) -> None:
        app = pilot.app
        assert isinstance(app, OperatorScreen)
        await pilot.pause()
        app.draw()
        await pilot.pause()
        for word in words:
            assert word in text_of(app), word

    async def run() -> None:
        make = CommandBuilder(None)
        app = OperatorScreen(bar.player.mirror, NoLink(), make, 1.0, clock, 'it was a recording', replay=bar)
        async with app.run_test(size=(100, 30)) as pilot:
            await shows(pilot, 'State0', 'stands x1  0.0 / 10.0 s')
            await pilot.press('space', 'right_square_bracket')
            clock.advance(2.0)
            app._play_on()
            await shows(pilot, 'State4', 'plays x2  4.0 / 10.0 s')
            await pilot.press('comma')
            await shows(pilot, 'State3', 'stands', 'LIVE')
            await pilot.press('full_stop', 'full_stop')
            await shows(pilot, 'State5')
            await pilot.press('colon', *'/State8', 'enter')
            await shows(pilot, 'State8', ' 8.0 / 10.0 s')
            await pilot.press('colon', *'/State2', 'enter')
            await shows(pilot, "nothing has 'State2' in it after 8.0 s")
            await pilot.press('home', 'exclamation_mark')
            await shows(pilot, 'State0', 'observer')

    asyncio.run(run())
