# SPDX-License-Identifier: BSD-3-Clause
"""The simulated robot of the studio: real processes, that run the open files, and that always end."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from test_studio_server import TOKEN, Page, Refused

from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.server import serving
from flexbt_studio.server.simulator import Simulation
from flexbt_studio.server.web_server import StudioServer
from flexbt_studio.server.workbench import Workbench
from flexbt_testing.waiting import DEADLINE, wait_until

WORLD = """
plan:
  rooms:
    - {from: [0, 0], to: [4, 4]}
    - {from: [4, 0], to: [8, 4]}
  openings:
    - {at: [4, 2], width: 1.2}
robots:
  courier: {model: burger, pose: [1, 2, 0]}
doors:
  gate: {from: [4, 1.4], to: [4, 2.6], automatic: true}
places:
  far: [6.5, 2, 0]
"""
DRIVE = """<root BTCPP_format="4" main_tree_to_execute="Go">
  <BehaviorTree ID="Go"><Sequence><SubTree ID="Drive" goal="{goal}"/></Sequence></BehaviorTree>
</root>"""
PART = """<root BTCPP_format="4">
  <BehaviorTree ID="Drive">
    <Sequence><ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/></Sequence>
  </BehaviorTree>
</root>"""
MACHINE = """machine:
  outcomes: [finished, failed]
  states:
    Say:
      state: LogState
      parameters: {text: saved}
      transitions: {done: finished}
"""
OTHER = """machine:
  outcomes: [finished, failed]
  states:
    Wait:
      state: WaitState
      parameters: {wait_time: 3000}
      transitions: {done: finished}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    files = {'world.yaml': WORLD, 'go.xml': DRIVE, 'parts/drive.xml': PART, 'round.yaml': MACHINE}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_why_the_robot_has_ended_stays_the_last_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[str, str]] = []

    async def run() -> None:
        simulation = Simulation(Access(), lambda event: told.append((event['state'], event['message'])), is_alone=True)
        monkeypatch.setattr(simulation, '_is_ready', lambda: True)  # by a status of before
        simulation._fail('bt_server has ended')
        await simulation._wait()
        simulation._fail('stop_guard has ended, too')
        assert simulation._closing is not None
        await simulation._closing

    asyncio.run(run())
    assert told == [('ended', 'bt_server has ended')]


def processes(of: int) -> dict[int, str]:
    """Return the processes of the simulated robot whose studio is process ``of`` or was it, by their identifiers."""
    found = {}
    for one in Path('/proc').glob('[0-9]*'):
        try:
            words = (one / 'cmdline').read_bytes().split(b'\0')
            environment = (one / 'environ').read_bytes()
            state = (one / 'stat').read_text().rpartition(')')[2].split()[0]
        except OSError:
            continue
        if f'FLEXBT_TEST_STUDIO={of}'.encode() in environment and b'flexbt_simulation_' in environment and state != 'Z':
            found[int(one.name)] = b' '.join(words).decode()
    return found


def with_page(folder: Path, story: Callable[[Page, aiohttp.ClientSession], Awaitable[None]]) -> None:
    """Run a story with a page of a server for the folder. It has the time of many waits."""

    async def run() -> None:
        server = StudioServer(Workbench(folder), Access('127.0.0.1', TOKEN), None)
        async with (
            asyncio.timeout(10.0 * DEADLINE),
            serving(server.application(), '127.0.0.1', 0) as port,
            aiohttp.ClientSession(f'http://127.0.0.1:{port}') as session,
        ):
            page = Page(await session.ws_connect('/session', max_msg_size=0))
            await page.socket.send_json({'hello': TOKEN})
            await story(page, session)

    asyncio.run(run())


async def until(page: Page, state: str) -> dict[str, Any]:
    """Return the event of the simulated robot that it is in this state."""
    while True:
        event = await page.event('simulator')
        assert event['state'] in ('starting', state), event
        if event['state'] == state:
            return event


def test_open_files_run_in_a_world_of_the_project_and_faults_happen(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('FLEXBT_TEST_STUDIO', str(os.getpid()))

    async def story(page: Page, session: aiohttp.ClientSession) -> None:
        known = await page.ask('simulator_worlds')
        assert 'world.yaml' in known and 'flexbt_demo_behaviors/night_watch/building.yaml' in known
        for wrong, told in (
            ({'world': 'wrld.yaml', 'speed': 1}, "did you mean 'world.yaml'"),
            ({'world': '', 'speed': 0}, 'speed 0'),
        ):
            with pytest.raises(Refused, match=told):
                await page.ask('simulator_start', **wrong)
        with pytest.raises(Refused, match='start it'):
            await page.ask('simulator_run', file='go.xml', tree='Go', goal='')
        await page.ask('simulator_start', world='world.yaml', speed=5)
        with pytest.raises(Refused, match='runs already'):
            await page.ask('simulator_start', world='', speed=1)
        assert (await until(page, 'running'))['doors'] == ['gate']
        assert len(processes(os.getpid())) == 4
        assert await page.ask('watch', robot='simulation') == 'simulation'
        assert 'id="map"' in await (await session.get('/simulator/')).text()

        # Trees as they are in the page: the edit of the sub-tree is not on disk.
        opened = await page.ask('open', file='parts/drive.xml')
        place = PART.index('<FollowPath')
        await page.ask(
            'edit',
            file='parts/drive.xml',
            version=opened['version'],
            edits=[[place, place, '<Sleep name="edited" msec="1"/>']],
        )
        with pytest.raises(Refused, match='nowhere'):
            await page.ask('simulator_run', file='go.xml', tree='Go', goal='nowhere')
        await page.ask(
            'simulator_what_if',
            fault='server_fails',
            entity='courier',
            parameters={'server': 'follow_path', 'error_msg': 'mud'},
            clear=False,
        )
        await page.ask('simulator_run', file='go.xml', tree='Go', goal='far')
        note = await page.event('note')
        assert 'Go has ended: FAILURE' in note['message']
        await page.ask('simulator_what_if', fault='', entity='courier', parameters={}, clear=True)
        await page.ask('simulator_run', file='go.xml', tree='Go', goal='far')
        while True:
            event = await page.event('live', robot='simulation')
            ended = [
                one['statuses'] for one in event['trees'] if one['statuses'].get('Drive::2/FollowPath::6') == 'RUNNING'
            ]
            if ended:
                assert any(path.endswith('/edited') for path in ended[0])
                break
        assert 'Go has ended: SUCCESS' in (await page.event('note'))['message']
        with pytest.raises(Refused, match='the simulator refuses'):
            await page.ask('simulator_what_if', fault='no_such_fault', entity='', parameters={}, clear=False)
        shut = {'where': 'closed'}
        await page.ask('simulator_what_if', fault='door_jammed', entity='gate', parameters=shut, clear=False)
        await page.ask('simulator_run', file='go.xml', tree='Go', goal='1 2 0')
        assert 'FAILURE' in (await page.event('note'))['message'], 'the way back is shut'

        # A machine as it is in the page.
        opened = await page.ask('open', file='round.yaml')
        await page.ask('edit', file='round.yaml', version=opened['version'], edits=[[0, len(MACHINE), OTHER]])
        name = await page.ask('simulator_run', file='round.yaml', tree='', goal='')
        socket = await session.ws_connect('/simulator/link')
        await socket.send_json({'hello': TOKEN})
        await socket.send_json({'do': f'start {name} --autonomy full'})
        event = await page.event('live', robot='simulation', active=['/Wait'])
        assert event['behavior'] == 'round'

        # Its processes are watched, and all of them end.
        executive = next(one for one, line in processes(os.getpid()).items() if 'onboard_executive' in line)
        os.kill(executive, signal.SIGKILL)
        assert 'onboard_executive has ended' in (await until(page, 'ended'))['message']
        await page.ask('simulator_start', world='', speed=1)
        await page.socket.close()
        await asyncio.to_thread(wait_until, lambda: not processes(os.getpid()), 'the end of the processes')

    with_page(folder, story)


@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGTERM])
def test_the_processes_end_with_the_studio_however_that_ends(folder: Path, how: signal.Signals) -> None:
    """Even while one of them is stopped."""
    program = (
        'import os, sys; os.environ["FLEXBT_TEST_STUDIO"] = str(os.getpid())\n'
        'from flexbt_studio.server.main import main; sys.exit(main())'
    )
    words = [sys.executable, '-c', program, str(folder), '--port', '0']
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as studio:
        assert studio.stdout is not None
        address = next(line for line in studio.stdout if 'the studio is at' in line).split()[4]
        base, _, token = address.partition('/#token=')

        async def start() -> None:
            async with aiohttp.ClientSession(base) as session:
                page = Page(await session.ws_connect('/session'))
                await page.socket.send_json({'hello': token})
                await page.ask('simulator_start', world='world.yaml', speed=1)
                found = await asyncio.to_thread(
                    wait_until, lambda: len(processes(studio.pid)) == 4 and processes(studio.pid)
                )
                os.kill(next(iter(found)), signal.SIGSTOP)
                studio.send_signal(how)
                await asyncio.to_thread(wait_until, lambda: not processes(studio.pid), 'the end of the processes')

        try:
            asyncio.run(start())
        finally:
            studio.kill()
