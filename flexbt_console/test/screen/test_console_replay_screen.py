# SPDX-License-Identifier: BSD-3-Clause
"""A recording on the screen: what is seen at each of its times, and that nothing is commanded."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from textual.pilot import Pilot
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import UsageError
from flexbt_console.recording.player import MirrorFeed, RunPlayer
from flexbt_console.recording.run_file import RunWriter
from flexbt_console.recording.topics import TOPICS, full_definition
from flexbt_console.ui.screen.app import OperatorScreen
from flexbt_console.ui.screen.replay_bar import NOTHING_SENT, NoLink, ReplayBar
from flexbt_console.ui.station import Attention, Station
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.msg import ActiveState, ExecutiveLog, ExecutiveStatus, TreeNode, TreeStatus, TreeStructure


def recording(file: Path) -> Path:
    """Return a run of ten states, each for a second, in a room; for six seconds the lidar meets something 1 m ahead."""
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
    nodes = [TreeNode(uid=1, name='Main'), TreeNode(uid=2, parent=1, name='Wait')]
    said.append((0.0, names.TREE_STRUCTURE, TreeStructure(run_id='t', behavior_tree='Drive', nodes=nodes, number=1)))
    for second in range(10):
        tree = TreeStatus(run_id='t', sequence=second + 1, structure=1, statuses=[1, second % 3])
        line = ExecutiveLog(executive_id='e', sequence=second + 1, severity=ExecutiveLog.INFO, text=f'line {second}')
        said += [(second + 0.01, names.TREE_STATUS, tree), (second + 0.01, names.EXECUTIVE_LOG, line)]
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


def test_going_back_shows_what_was_shown_on_the_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, chance = recording(tmp_path / 'run.mcap'), random.Random(5)
    monkeypatch.setattr('flexbt_console.recording.player.KEPT_EACH', 3)
    player = RunPlayer(file)
    for _ in range(40):
        player.go_to(chance.uniform(0.0, 10.0))
        straight = RunPlayer(file)
        straight.go_to(player.time)
        assert player.mirror.view() == straight.mirror.view() and len(player.mirror.view().trees) == 1
        assert player.mirror.log() == straight.mirror.log() != ()


def test_on_its_way_through_a_long_recording_it_shows_how_far_it_has_come(tmp_path: Path) -> None:
    file = recording(tmp_path / 'run.mcap')
    player, straight = RunPlayer(file), RunPlayer(file)
    seen = []
    while not player.go_to(9.0, patience=0.0):
        seen.append(player.time)
        straight.go_to(player.time)
        assert seen == sorted(seen) and player.time < 9.0
    straight.go_to(9.0)
    assert len(seen) > 20 and player.time == 9.0 and player.mirror.view() == straight.mirror.view()


def test_forward_as_back_it_starts_from_the_nearest_picture_that_was_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('flexbt_console.recording.player.KEPT_EACH', 3)
    player, read = RunPlayer(recording(tmp_path / 'run.mcap')), []
    player.go_to(10.0)
    player.go_to(0.5)
    take = MirrorFeed.take

    def counted(feed: MirrorFeed, topic: str, message: Received) -> None:
        read.append(topic)
        take(feed, topic, message)

    monkeypatch.setattr(MirrorFeed, 'take', counted)
    player.go_to(10.0)
    assert len(read) <= 3


def text_of(app: OperatorScreen) -> str:
    return '\n'.join(''.join(segment.text for segment in line) for line in app.screen._compositor.render_strips())


def test_a_recording_is_played_stepped_searched_and_takes_no_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('flexbt_console.ui.screen.replay_bar.PATIENCE', math.inf)  # however slow the machine is
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
        station = Station(bar.player.mirror, NoLink(), make, 1.0, Attention(clock), 'it was a recording')
        app = OperatorScreen(station, clock, replay=bar)
        async with app.run_test(size=(100, 30)) as pilot:
            await shows(pilot, 'RECORDING', 'State0', 'stands x1  0.0 / 10.0 s', '/ finds', 'nothing is sent')
            await pilot.press('question_mark')
            await shows(pilot, 'Home End', 'Slower or faster')
            assert 'STOP' not in text_of(app)
            await pilot.press('escape')
            await pilot.resize_terminal(80, 24)
            await shows(pilot, 'q quits', 'space plays', ', . step')
            await pilot.press('space', 'greater_than_sign')
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


def test_a_recording_that_is_damaged_anywhere_is_shown_as_far_as_it_goes_and_says_so(tmp_path: Path) -> None:
    whole = recording(tmp_path / 'run.mcap').read_bytes()
    assert RunPlayer(tmp_path / 'run.mcap').mirror.view().problem == ''
    chance = random.Random(11)
    shown = 0
    for number in range(60):
        file, place = tmp_path / f'{number}.mcap', chance.randrange(len(whole))
        is_cut = number % 2 == 0
        rest = b'' if is_cut else bytes([whole[place] ^ 1 << number // 2 % 8]) + whole[place + 1 :]
        file.write_bytes(whole[:place] + rest)
        try:
            player = RunPlayer(file)
        except UsageError as error:  # nothing of it is left, or the definition of a message is damaged
            assert str(file) in str(error)
            continue
        shown += 1
        for time in (player.duration, 0.0, player.duration / 2.0):
            player.go_to(time)
            assert 'lacks its end' in player.mirror.view().problem or not is_cut
    assert shown > 20


def test_a_message_that_cannot_be_read_is_left_aside(tmp_path: Path) -> None:
    status = ExecutiveStatus(executive_id='e', sequence=1, state=ExecutiveStatus.RUNNING, run_id='r')
    kind = TOPICS[names.EXECUTIVE_STATUS].type
    with contextlib.closing(RunWriter(tmp_path / 'run.mcap')) as writer:
        writer.add_topic(names.EXECUTIVE_STATUS, '/status', kind, full_definition(kind))
        for second, data in enumerate((serialize_message(status), b'', b'\0\1\0\0' + b'\xff' * 40)):
            writer.add(names.EXECUTIVE_STATUS, data, second * 10**9, second * 10**9)
    player = RunPlayer(tmp_path / 'run.mcap')
    player.go_to(2.0)
    snapshot = player.mirror.view().snapshot
    assert snapshot is not None and snapshot.run_id == 'r'
