# SPDX-License-Identifier: BSD-3-Clause
"""The costmaps of navigation on the page: on real topics, over the real WebSocket, and only while they are shown."""

from __future__ import annotations

import asyncio
import json
import math
import struct
from types import SimpleNamespace
from typing import Any

import numpy
import pytest
from aiohttp import ClientSession, WSCloseCode, WSMsgType, web
from aiohttp.test_utils import TestClient, TestServer
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid
from tf2_msgs.msg import TFMessage
from web_support import WebRobot, WebRobots, served

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.link.costmap_link import MOST_SHOWN, UNKNOWN, CostmapLinks, combined
from flexbt_console.ui.web.costmaps import show_costmaps
from flexbt_console.ui.web.requests import BURST
from flexbt_testing.waiting import DEADLINE, wait_until


@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 4), st.randoms(use_true_random=False))
def test_of_cells_that_become_one_the_highest_cost_counts(height: int, width: int, factor: int, chance: Any) -> None:
    cells = numpy.array([[chance.choice((0, 1, 50, 99, 100, UNKNOWN)) for _ in range(width)] for _ in range(height)])
    made = combined(cells.astype(numpy.uint8), factor)
    assert made.shape == (-(-height // factor), -(-width // factor))
    for row, column in numpy.ndindex(made.shape):
        block = cells[row * factor : (row + 1) * factor, column * factor : (column + 1) * factor]
        known = [cost for cost in block.flatten() if cost != UNKNOWN]
        assert made[row, column] == max(known, default=UNKNOWN)


class Navigation:
    """A robot that publishes costmaps; ``odom`` is at (5, 0) of the map and turned to the left."""

    def __init__(self, runtime: NodeRuntime) -> None:
        node = runtime.node
        self.runtime = runtime
        topics = [f'/robot/{names.costmap_topics(name)[0]}' for name in names.COSTMAPS]
        self.publishers = [node.create_publisher(OccupancyGrid, one, names.transient_local_qos()) for one in topics]
        placed = TransformStamped(child_frame_id='odom')
        placed.header.frame_id, placed.transform.translation.x = 'map', 5.0
        placed.transform.rotation.z = placed.transform.rotation.w = math.sqrt(0.5)
        self.frames = node.create_publisher(TFMessage, '/robot/tf_static', names.transient_local_qos())
        self.frames.publish(TFMessage(transforms=[placed]))

    def tell(self, which: int, frame: str, width: int, height: int, cells: list[int]) -> None:
        grid = OccupancyGrid(data=cells)
        grid.header.frame_id = frame
        grid.info.width, grid.info.height, grid.info.resolution = width, height, 0.5
        grid.info.origin.position.x, grid.info.origin.orientation.w = 2.0, 1.0
        self.runtime.call(lambda: self.publishers[which].publish(grid))

    def is_heard(self) -> bool:
        return any(one.get_subscription_count() for one in self.publishers)


def test_costmaps_are_sent_while_a_page_shows_them() -> None:
    async def run(port: int, navigation: Navigation) -> None:
        async with (
            asyncio.timeout(DEADLINE),
            ClientSession() as session,
            session.ws_connect(f'http://127.0.0.1:{port}/costmaps?robot=robot', max_msg_size=0) as socket,
        ):
            await socket.send_json({'hello': None})
            await socket.send_json({'show': [*names.COSTMAPS, 'other', 3]})

            async def until(name: str, width: int) -> tuple[dict[str, Any], bytes]:
                while True:
                    data = (await socket.receive()).data
                    (length,) = struct.unpack('>I', data[:4])
                    head = json.loads(data[4 : 4 + length])
                    if (head['costmap'], head['width']) == (name, width):
                        return head, data[4 + length :]

            tell = navigation.tell
            await asyncio.to_thread(tell, 0, 'map', 3, 2, [0, 50, 99, 100, -1, 0])
            head, cells = await until('global_costmap', 3)
            assert (head['x'], head['y'], head['yaw'], head['resolution']) == (2.0, 0.0, 0.0, 0.5)
            assert [*cells] == [0, 50, 99, 100, UNKNOWN, 0]
            # What is wrong is left out, and what is large has fewer cells.
            await asyncio.to_thread(tell, 0, 'map', 4, 4, [0])
            await asyncio.to_thread(tell, 0, 'map', 1000, 700, [0] * 700_000)
            head, cells = await until('global_costmap', 500)
            assert len(cells) == head['width'] * head['height'] <= MOST_SHOWN and head['resolution'] == 1.0
            # One in another frame has its place by the transforms; it comes again and again, as from Nav2.
            local = asyncio.create_task(until('local_costmap', 2))
            while not local.done():
                await asyncio.to_thread(tell, 1, 'odom', 2, 2, [1, 2, 3, 4])
                await asyncio.wait([local], timeout=0.1)
            head, _ = await local
            assert [round(head[key], 6) for key in ('x', 'y', 'yaw')] == [5.0, 2.0, round(math.pi / 2.0, 6)]
            await socket.send_str('{"show": 3}')
            while (last := await socket.receive()).type is not WSMsgType.CLOSE:
                pass
            assert last.data == WSCloseCode.UNSUPPORTED_DATA
        await asyncio.to_thread(wait_until, lambda: not navigation.is_heard(), 'the end of the subscriptions')

    with NodeRuntime.open('navigation') as far, NodeRuntime.open('console') as near:
        navigation = far.call(lambda: Navigation(far))
        robots = WebRobots({'/robot': WebRobot().station()})
        robots.costmaps = CostmapLinks(near)
        with served(robots) as port:
            assert not navigation.is_heard()
            asyncio.run(run(port, navigation))


def test_a_flood_of_requests_ends_the_connection() -> None:
    link: Any = SimpleNamespace(newest={})

    async def answer(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        await show_costmaps(socket, link, lambda: True)
        return socket

    async def flood() -> int | None:
        application = web.Application()
        application.router.add_get('/', answer)
        async with TestClient(TestServer(application)) as client, client.ws_connect('/') as socket:
            for _ in range(BURST + 50):
                await socket.send_str('{"show": []}')
            await socket.receive()
            return socket.close_code

    assert asyncio.run(asyncio.wait_for(flood(), DEADLINE)) == WSCloseCode.POLICY_VIOLATION


@pytest.mark.parametrize('robot', ['nobody', ''])
def test_a_page_of_no_robot_and_one_without_the_token_get_nothing(robot: str) -> None:
    async def run(port: int) -> None:
        async with (
            asyncio.timeout(DEADLINE),
            ClientSession() as session,
            session.ws_connect(f'http://127.0.0.1:{port}/costmaps?robot={robot}') as socket,
        ):
            await socket.send_json({'hello': None} if robot else {'hullo': None})
            end = await socket.receive()
            assert end.data == (WSCloseCode.TRY_AGAIN_LATER if robot else WSCloseCode.POLICY_VIOLATION)

    with served({'/robot': WebRobot().station()}) as port:
        asyncio.run(run(port))
