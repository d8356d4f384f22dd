# SPDX-License-Identifier: BSD-3-Clause
"""A recording on the screen: what is seen at each of its times, and that nothing is commanded."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from textual.pilot import Pilot
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_console.commands import CommandBuilder
from flexbt_console.recording.definitions import full_definition
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.run_file import RunWriter
from flexbt_console.recording.topics import TOPICS
from flexbt_console.ui.screen import NOTHING_SENT, NoLink, OperatorScreen, ReplayBar
from flexbt_core.clock import ManualClock
from flexbt_msgs.msg import ActiveState, ExecutiveStatus


def recording(file: Path) -> Path:
    """A run of ten states, each for a second, in a room; for six seconds the lidar meets something 1 m ahead."""
    said: list[tuple[float, str, Any]] = []
    for second in range(11):
        status = ExecutiveStatus(
            executive_id='e', sequence=second + 1, state=ExecutiveStatus.RUNNING, run_id='r', behavior='Patrol'
        )
        status.heartbeat_period = 1.0
        status.stamp = Time(sec=100 + second)
        status.active_states = [ActiveState(path=f'/State{second}', entered=status.stamp)]
        said.append((second, names.EXECUTIVE_STATUS, status))
    room = OccupancyGrid(header=_header('map', 0), data=[0] * 4800)
    room.info.width, room.info.height, room.info.resolution = 80, 60, 0.1
    said += [(0.0, names.MAP, room), (0.0, names.TF_STATIC, _transform('base_link', 'lidar', 0.0, 0.0, 0))]
    for second in range(7):
        scan = LaserScan(header=_header('lidar', second), range_max=8.0, ranges=[1.0])
        said.append((second + 0.125, names.SCAN, scan))
        said.append((second + 0.25, names.TF, _transform('map', 'base_link', 1.0 + 0.5 * second, 3.0, second)))
    with contextlib.closing(RunWriter(file)) as writer:
        for topic in {topic for _, topic, _ in said}:
            writer.add_topic(topic, f'/{topic}', TOPICS[topic].type, full_definition(TOPICS[topic].type))
        for when, topic, message in sorted(said, key=lambda one: one[0]):
            nanoseconds = round((1_000 + when) * 1e9)
            writer.add(topic, serialize_message(message), nanoseconds, nanoseconds)
    return file


def _transform(parent: str, frame: str, x: float, y: float, second: int) -> TFMessage:
    one = TransformStamped(header=_header(parent, second), child_frame_id=frame)
    one.transform.translation.x, one.transform.translation.y = x, y
    return TFMessage(transforms=[one])


def _header(frame: str, second: int) -> Header:
    return Header(frame_id=frame, stamp=Time(sec=100 + second))


def test_the_scan_of_each_moment_is_where_it_was_taken(tmp_path: Path) -> None:
    player = RunPlayer(recording(tmp_path / 'run.mcap'))
    for time, points in (
        (0.0, ()),
        (2.2, ((3.0, 3.0),)),
        (6.0, ((4.5, 3.0),)),
        (9.0, ((5.0, 3.0),)),
        (9.5, ()),  # too long ago
        (1.2, ((2.5, 3.0),)),
    ):
        player.go_to(time)
        assert player.mirror.view().surroundings.scan == points


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
        make = CommandBuilder(None, NOTHING_SENT)
        app = OperatorScreen(bar.player.mirror, NoLink(), make, 1.0, clock, 'it was a recording', replay=bar)
        async with app.run_test(size=(100, 30)) as pilot:
            await shows(pilot, 'RECORDING', 'State0', 'stands x1  0.0 / 10.0 s', '/ finds', 'nothing is sent')
            await pilot.press('question_mark')
            await shows(pilot, 'Home End', 'slower and faster')
            assert 'STOP' not in text_of(app)
            await pilot.press('escape')
            await pilot.resize_terminal(80, 24)
            await shows(pilot, 'q quits', 'space plays', ', . step')
            await pilot.press('space', 'right_square_bracket')
            clock.advance(2.0)
            app._play_on()
            await shows(pilot, 'State4', 'plays x2  4.0 / 10.0 s')
            await pilot.press(*'/Nowhere', 'enter')
            clock.advance(0.01)
            app._play_on()
            await shows(pilot, 'State4', 'plays', "nothing has 'Nowhere' in it")
            await pilot.press('comma')
            await shows(pilot, 'State3', 'stands', 'LIVE')
            await pilot.press('full_stop', 'full_stop')
            await shows(pilot, 'State5')
            await pilot.press('space', *'/State8', 'enter')
            await shows(pilot, 'State8', 'stands', ' 8.0 / 10.0 s')
            await pilot.press('colon', *'/State2', 'enter')
            await shows(pilot, "nothing has 'State2' in it after 8.0 s")
            await pilot.press('home', 'exclamation_mark')
            await shows(pilot, 'State0', 'this is a recording; nothing was sent')
            await pilot.press('end', 'space')
            await shows(pilot, 'State0', 'plays x2  0.0 / 10.0 s')
            await pilot.press('q')
            assert app.return_code == 0

    asyncio.run(run())
