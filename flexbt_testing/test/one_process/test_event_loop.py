# SPDX-License-Identifier: BSD-3-Clause
"""``asyncio`` in a world: simulated time, threads, several loops, and with them the operator's page and screen."""

from __future__ import annotations

import asyncio
import html
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import aiohttp
import pytest
import rclpy
from std_msgs.msg import String

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.ui.console import main as console
from flexbt_console.ui.screen.app import OperatorScreen
from flexbt_console.ui.station import Attention, Station
from flexbt_testing.one_process.boundary import OutsideWorldError
from flexbt_testing.one_process.programs import Program
from flexbt_testing.one_process.world import World


@pytest.fixture
def bare() -> Iterator[World]:
    """Yield a world without a robot."""
    with World(0, [Program('', 'idle', main=lambda: time.sleep(1e6))]) as made:
        yield made


def run(world: World, *programs: Any) -> None:
    """Run programs side by side until all have ended."""
    processes = [world.launch(one) for one in programs]
    end = world.now + 1000.0
    while world.now < end and any(one.exit_code is None for one in processes):
        world.run(1.0)
    assert [one.exit_code for one in processes] == [0] * len(processes)


def test_waits_take_simulated_time_and_loops_run_side_by_side(bare: World) -> None:
    told: list[tuple[str, float]] = []

    async def counts(name: str, period: float) -> None:
        for _ in range(3):
            await asyncio.sleep(period)
            assert asyncio.get_running_loop().time() == time.monotonic()
            told.append((name, round(bare.now - begin, 3)))

    async def two(name: str, period: float) -> None:
        async with asyncio.timeout(500.0), asyncio.TaskGroup() as group:
            group.create_task(counts(f'{name}1', period))
            group.create_task(counts(f'{name}2', 2.0 * period))

    begin = bare.now
    run(bare, lambda: asyncio.run(two('a', 10.0)), lambda: asyncio.run(two('b', 17.0)))
    times = {name: [when for one, when in told if one == name] for name in ('a1', 'a2', 'b1', 'b2')}
    for name, period in (('a1', 10), ('a2', 20), ('b1', 17), ('b2', 34)):
        assert times[name] == pytest.approx([period, 2 * period, 3 * period], abs=0.01)
    assert told == sorted(told, key=lambda one: one[1])


def test_a_loop_has_the_signal_as_long_as_it_wants(bare: World) -> None:
    told: list[Any] = []

    async def listen() -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        loop.add_signal_handler(signal.SIGTERM, ended.set)
        await ended.wait()
        told.extend(loop.remove_signal_handler(signal.SIGTERM) for _ in range(2))
        await asyncio.sleep(100.0)

    def main() -> None:
        asyncio.run(listen())

    process = bare.launch(main)
    for alive in (True, False):
        bare.run(1.0)
        bare.terminate('main')
        bare.run(1.0)
        assert process.is_alive == alive
    assert (told, process.exit_code) == ([True, False], -signal.SIGTERM)


def test_threads_and_nodes_reach_a_loop(bare: World) -> None:
    """A callback of rclpy, in a thread, hands over what it hears; a blocking call goes to a thread."""
    heard: list[str] = []

    def sleep() -> str:
        time.sleep(5.0)
        return 'slept'

    def listen() -> None:
        async def main() -> None:
            queue: asyncio.Queue[str] = asyncio.Queue()
            loop = asyncio.get_running_loop()
            node.create_subscription(
                String, 'said', lambda message: loop.call_soon_threadsafe(queue.put_nowait, message.data), 10
            )
            spinning = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
            spinning.start()
            assert await asyncio.to_thread(sleep) == 'slept'
            heard.extend([await asyncio.wait_for(queue.get(), 60.0) for _ in range(3)])
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(queue.get(), 60.0)
            rclpy.shutdown()

        rclpy.init()
        node = rclpy.create_node('listener')
        asyncio.run(main())

    def say() -> None:
        rclpy.init()
        node = rclpy.create_node('speaker')
        publisher = node.create_publisher(String, 'said', 10)
        while not publisher.get_subscription_count():
            time.sleep(0.1)
        time.sleep(10.0)
        for number in range(3):
            publisher.publish(String(data=str(number)))
            time.sleep(10.0)

    run(bare, listen, say)
    assert heard == ['0', '1', '2']


def test_a_loop_has_no_sockets_of_this_computer_and_no_processes(bare: World) -> None:
    refusals: list[str] = []

    async def main() -> None:
        for attempt in (
            lambda: asyncio.open_unix_connection('/tmp/socket'),  # noqa: S108
            lambda: asyncio.create_subprocess_exec('true'),
            lambda: asyncio.open_connection('localhost', 443, ssl=True),
        ):
            with pytest.raises(OutsideWorldError) as refused:
                await attempt()
            refusals.append(str(refused.value))
        with pytest.raises(ConnectionRefusedError, match='nobody listens at port 80 in this world'):
            await asyncio.open_connection('localhost', 80)

    def listen_and_go_on() -> None:
        asyncio.run(asyncio.start_server(print, 'localhost', 80))  # which ends with its loop
        time.sleep(10.0)

    bare.launch(listen_and_go_on)
    bare.run(1.0)
    run(bare, lambda: asyncio.run(main()))
    assert 'calls asyncio.create_unix_connection: not in a simulated world. Use instead: a topic' in refusals[0]
    assert 'calls asyncio.subprocess_exec: not in a simulated world. Use instead: start it by' in refusals[1]
    assert 'calls asyncio with TLS: not in a simulated world' in refusals[2]


@pytest.mark.parametrize('dies', [False, True])
def test_who_writes_to_a_connection_that_has_ended_is_told(bare: World, dies: bool) -> None:
    told: list[str] = []

    async def hang_up(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await asyncio.sleep(100.0 if dies else 0.0)
        writer.close()

    async def main() -> None:
        async with await asyncio.start_server(hang_up, '127.0.0.1', 7000) as server:
            await server.serve_forever()

    def serve() -> None:
        asyncio.run(main())

    async def write() -> None:
        _, writer = await asyncio.open_connection('127.0.0.1', 7000)
        await asyncio.sleep(5.0)
        try:
            while True:
                writer.write(b'x')
                await writer.drain()
                await asyncio.sleep(0.1)
        except ConnectionResetError as error:
            told.append(str(error))

    bare.launch(serve)
    bare.run(1.0)
    if dies:
        bare.at(bare.now + 2.0, lambda: bare.kill('serve'))
    run(bare, lambda: asyncio.run(write()))
    assert len(told) == 1


ORDER = """
import asyncio
from flexbt_testing.one_process.product import install
install()
from flexbt_testing.one_process.world import World
from flexbt_testing.one_process.programs import Program
import time
told = []

async def waits(number):
    try:
        await asyncio.sleep(100.0)
    except asyncio.CancelledError:
        told.append(number)
        raise

async def main():
    tasks = [asyncio.create_task(waits(number)) for number in range(30)]
    junk = [object() for _ in range(len(told) + {junk})]
    await asyncio.sleep(1.0)  # then asyncio.run cancels what is left

for _ in range(3):
    told.clear()
    with World({seed}, [Program('', 'idle', main=lambda: time.sleep(1e6))]) as world:
        world.launch(lambda: asyncio.run(main()))
        world.run(5.0)
    print(told)
"""


def test_what_is_cancelled_together_is_cancelled_in_an_order_that_addresses_and_earlier_worlds_do_not_decide() -> None:
    told = [
        subprocess.run(
            [sys.executable, '-c', ORDER.format(seed=3, junk=junk)],
            capture_output=True,
            text=True,
            check=True,
            env=None,
        ).stdout
        for junk in (0, 1000, 54321)
    ]
    orders = {order for one in told for order in one.splitlines()}
    assert len(orders) == 1, orders
    assert sorted(eval(orders.pop())) == list(range(30))  # noqa: S307


@pytest.mark.world(motion='abstract')
def test_a_program_drives_a_mission_by_the_page_of_a_world(world: World) -> None:
    """The real page, and a real client of HTTP and WebSockets: commands, events, a bad link, and a page that dies."""

    def page() -> int:
        return console(['web', '--port', '8800', '--operator', 'eve'])

    async def drive() -> None:
        await asyncio.sleep(5.0)
        async with aiohttp.ClientSession('http://127.0.0.1:8800', timeout=aiohttp.ClientTimeout(None)) as client:

            async def command(kind: str, **values: Any) -> Any:
                async with client.post(f'/api/robots/_/commands/{kind}', json=values) as answer:
                    assert answer.status == 200, await answer.text()
                    return await answer.json()

            await command('start', name='Navigate')
            while not world.asks('/AskGoal')(world.view):
                await asyncio.sleep(0.5)
            async with client.get('/api/robots/_/events') as events:
                before = world.now
                world.cut('operator', 6.0)
                await asyncio.sleep(0.5)
                await command('input', value='kitchen')
                assert world.now - before > 5.0, 'the bytes of a cut link wait'
                told = ''
                while '/Drive' not in told:
                    told += (await events.content.readline()).decode()
                world.kill('page')
                with pytest.raises(aiohttp.ClientPayloadError):
                    while await events.content.readline():
                        pass
            with pytest.raises(aiohttp.ClientConnectorError, match='nobody listens'):
                await command('stop')

    def operator_program() -> None:
        asyncio.run(drive())

    world.launch(page)
    run(world, operator_program)
    world.run_until(world.asks('/Drive'), within=90)
    assert world.robot.near('kitchen')


@pytest.mark.world(motion='abstract')
def test_an_operator_at_the_screen_drives_a_mission(world: World) -> None:
    """The real screen, whose keys are pressed on the clock of the world."""

    async def press(app: OperatorScreen) -> None:
        async with app.run_test(size=(100, 30)) as pilot:
            await asyncio.sleep(3.0)
            for text in ('start Navigate', 'input kitchen'):
                await pilot.press('colon', *['space' if key == ' ' else key for key in text], 'enter')
                await asyncio.sleep(60.0)
            shown.append(app.export_screenshot())

    def operator_screen() -> None:
        with NodeRuntime.open('screen') as runtime:
            mirror = Mirror(runtime.steady)
            link, builder = ExecutiveLink(runtime, mirror, 'eve'), CommandBuilder('eve')
            station = Station(mirror, link, builder, 5.0, Attention(runtime.steady), 'the robot goes on')
            asyncio.run(press(OperatorScreen(station, runtime.steady)))

    shown: list[str] = []
    run(world, operator_screen)
    assert world.robot.near('kitchen')
    assert 'input kitchen: applied' in html.unescape(re.sub('<[^>]*>', '', shown[0])).replace('\xa0', ' ')
