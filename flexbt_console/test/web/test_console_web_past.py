# SPDX-License-Identifier: BSD-3-Clause
"""The past of a robot on its page: everything shows the moment, decisions and commands are those of now."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession
from web_support import PLAN, WebRobot, served

from flexbt_common import names
from flexbt_console.errors import UsageError
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import ActiveState, CommandKind, FramedPose, GridMap, LogLine, LogSeverity
from flexbt_console.recording.run_file import write_recording
from flexbt_console.ui.web.past import RecordedPast, Recordings
from flexbt_console.ui.web.requests import RATE, is_harmless
from flexbt_core.values.text import short_repr
from flexbt_msgs.msg import ActiveState as ActiveStateMessage
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.browser import NEEDS_BROWSER, Browser
from flexbt_testing.waiting import DEADLINE


@contextlib.asynccontextmanager
async def page(port: int) -> AsyncIterator[Any]:
    """Provide what asks the server as a page: ``ask('past', moment=3.0)`` gives the next answer of that kind."""
    async with (
        ClientSession() as session,
        session.ws_connect(f'http://127.0.0.1:{port}/link', max_msg_size=0) as socket,
    ):
        await socket.send_json({'hello': None, 'operator': None})

        async def ask(kind: str, **message: Any) -> Any:
            if message:
                await socket.send_json(message)
            async with asyncio.timeout(DEADLINE):
                while True:
                    answer = await socket.receive()
                    content = answer.json() if isinstance(answer.data, str) else {}
                    if kind in content:
                        return content[kind]

        await ask('hello')
        yield ask


def drive(robot: WebRobot) -> None:
    """Let a robot drive for ten seconds; it loses its path at 5 s."""
    for second in range(1, 11):
        robot.clock.set(float(second))
        if second == 5:
            robot.mirror.receive_log(LogLine('e', 50, LogSeverity.ERROR, 'lost the path', '/Drive', 'r1', 5.0))
        state = ActiveState('/Drive' if second < 8 else '/Ask', float(second < 8))
        pose = FramedPose(1.0 + second / 10, 2.0)
        robot.show(heartbeat_period=10.0, active_states=(state,), robot_pose=pose, stamp=float(second))


def test_two_pages_show_different_moments_and_neither_answers_from_the_past() -> None:
    robot = WebRobot(is_drawn=True)

    async def run(port: int) -> None:
        async with page(port) as one, page(port) as other:
            await asyncio.to_thread(drive, robot)
            robot.show(PLAN)
            lanes = await one('lanes', lanes=0)
            assert lanes['live'] and {entry['lane'] for entry in lanes['entries']} >= {'states', 'decisions', 'faults'}
            (fault,) = [entry for entry in lanes['entries'] if entry['lane'] == 'faults' and entry['begin'] == 5.0]
            assert fault['tone'] == 'error' and 'lost the path' in fault['text']
            assert (await one('lanes', lanes=lanes['revision']))['entries'] == []
            early, late = await one('past', moment=4.5), await other('past', moment=9.0)
            assert (early['pose']['x'], late['pose']['x']) == (1.4, 1.9)
            assert early['active']['paths'][-1] == '/Drive' and late['active']['paths'][-1] == '/Ask'
            assert not any('lost' in line['text'] for line in early['log'])
            assert any('lost' in line['text'] for line in late['log'])
            assert early['decisions'] == [] and early['machine'] and early['trees']
            for line in ({'answer': 'done'}, {'do': 'confirm'}, {'do': 'pause'}, {'do': 'stopp'}, {'obstacle': [1, 1]}):
                told = await one('told', **line, decision='d1')
                assert 'shows the past; nothing was sent' in told['text']
            assert robot.sent == []
            await one('parts', do='stop', decision=None)
            assert [sent.kind for sent in await asyncio.to_thread(robot.wait_sent, 1)] == [CommandKind.STOP]
            robot.show(PLAN)
            assert 'driven' in await one('parts', moment=None)
            assert 'applied' in (await one('told', answer='done', decision='d1'))['text']
            for wrong in (
                {'moment': 'x'},
                {'moment': True},
                {'lanes': '1'},
                {'moment': 1.0, 'of': 3},
                {'moment': 1e300},
            ):
                assert (await other('lanes' if 'lanes' in wrong else 'past', **wrong))['problem']
            assert (await other('past', moment=-1e9))['time'] == -1e9  # the earliest that is known

    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))


@pytest.mark.parametrize('run_id', ['r1', ''])
def test_back_from_the_past_the_driven_path_is_that_of_now_also_before_the_first_run(run_id: str) -> None:
    robot = WebRobot()
    robot.show(run_id=run_id)

    async def run(port: int) -> None:
        async with page(port) as ask:
            async with asyncio.timeout(DEADLINE):
                while 'driven' not in await ask('parts'):
                    pass
                await ask('past', moment=0.0)
                while 'driven' not in await ask('parts', moment=None):
                    pass

    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))


@pytest.mark.parametrize('line', ['stop', 'STOP', ' Stop --wait'])
def test_a_stop_is_sent_from_the_past_however_it_is_written(line: str) -> None:
    assert is_harmless({'do': line, 'decision': None})


def test_a_map_that_has_changed_is_that_of_the_moment() -> None:
    robot = WebRobot()
    maps: list[bytes] = []

    async def run(port: int) -> None:
        async with ClientSession() as session, session.ws_connect(f'http://127.0.0.1:{port}/link') as socket:
            await socket.send_json({'hello': None})

            async def until(kind: str, count: int) -> None:
                async with asyncio.timeout(DEADLINE):
                    while len(maps) < count or kind:
                        answer = await socket.receive()
                        if isinstance(answer.data, bytes):
                            maps.append(answer.data)
                        elif kind in answer.json():
                            kind = ''

            await until('parts', 1)
            robot.clock.set(5.0)
            robot.mirror.receive_map(GridMap(2, 1, 0.05, 0.0, 0.0, b'\0\x64'))
            await until('', 2)
            await socket.send_json({'moment': 2.0})
            await until('past', 3)
            await socket.send_json({'moment': 6.0})
            await until('past', 4)
            await socket.send_json({'moment': None})
            await until('parts', 5)
        assert maps[2] == maps[0] and maps[1] == maps[3] == maps[4]

    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))


def recording(file: Path) -> Path:
    """Write a run of five seconds in /Plan."""
    said = []
    for second in range(6):
        status = ExecutiveStatus(executive_id='e', state=ExecutiveStatus.RUNNING, run_id='r', behavior='Recorded')
        status.active_states, status.sequence = [ActiveStateMessage(path='/Plan')], second + 1
        said.append((second * 10**9, names.EXECUTIVE_STATUS, status))
    write_recording(file, said)
    return file


def test_recordings_are_those_of_the_folder_and_a_name_leads_nowhere_else(tmp_path: Path) -> None:
    folder, outside = tmp_path / 'flexbt', tmp_path / 'secret.mcap'
    folder.mkdir()
    recording(outside)
    recording(folder / 'run.mcap')
    (folder / 'link.mcap').symlink_to(outside)
    (folder / 'broken.mcap').write_bytes(b'no recording')
    (folder / 'sub.mcap').mkdir()
    os.mkfifo(folder / 'pipe.mcap')
    known = Recordings(folder)
    assert sorted(one['name'] for one in known.names()) == ['broken.mcap', 'run.mcap']
    for name in (
        '../secret.mcap',
        str(outside),
        'link.mcap',
        'sub.mcap',
        'pipe.mcap',
        '',
        '.',
        'run.mcap\0',
        'RUN.mcap',
    ):
        with pytest.raises(UsageError, match='has no recording') as refused:
            known.past(name)
        assert 'secret' not in str(refused.value).replace(short_repr(name), '')
    with pytest.raises(UsageError, match='is not an MCAP file'):
        known.past('broken.mcap')
    past = known.past('run.mcap')
    assert known.past('run.mcap') is past
    snapshot = past.moment(3.0).view().snapshot
    assert snapshot is not None and (snapshot.behavior, snapshot.sequence) == ('Recorded', 4)
    lanes = past.lanes(0)
    assert (lanes['begin'], lanes['end'], lanes['live']) == (0.0, 5.0, False)
    assert [entry['label'] for entry in lanes['entries']] == ['Plan']


@NEEDS_BROWSER
def test_the_page_goes_to_a_failure_and_back_and_confirms_nothing_there(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / '.ros' / 'flexbt').mkdir(parents=True)
    recording(tmp_path / '.ros' / 'flexbt' / 'patrol.mcap')
    robot = WebRobot(is_drawn=True)
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        drive(robot)
        robot.show(PLAN)
        browser.until(lambda: browser.run('return document.querySelectorAll(".lanes .faults.error").length') == 1)
        browser.press('j')
        browser.press('[')
        browser.until_text('past', 'PAST')
        browser.until_text('past-log', 'lost the path')
        browser.until_text('pose', 'x 1.50')
        assert not browser.driver.find_element('id', 'log').is_displayed()
        # The decision is that of now, and is shut.
        assert 'Drive' in browser.text('decision-line')
        assert browser.run('return [...document.querySelectorAll("[data-choice]")].every((one) => one.disabled)')
        browser.run('document.activeElement.blur()')
        browser.press('\ue014')  # an arrow: what is typed now does not go with the keys before
        browser.press('1')
        browser.press('\ue007')  # Enter
        browser.until_text('told', 'shows the past')
        # While the robot goes on, the moment stays.
        robot.show(PLAN, robot_pose=FramedPose(3.0, 2.0))
        robot.mirror.receive_log(LogLine('e', 51, LogSeverity.INFO, 'goes on', '/Drive', 'r1', 11.0))
        browser.until(lambda: 'goes on' in (browser.run('return document.getElementById("log").textContent')))
        assert 'x 1.50' in browser.text('pose') and 'goes on' not in browser.text('past-log')
        assert robot.sent == []
        browser.press('!')
        assert [one.kind for one in robot.wait_sent(1)] == [CommandKind.STOP]
        robot.show(PLAN, robot_pose=FramedPose(3.0, 2.0))
        # Back: an answer is picked anew, and not sooner than somebody can have read it.
        browser.press('\ue00c')
        browser.until(lambda: not browser.driver.find_element('id', 'past').is_displayed())
        browser.until_text('pose', 'x 3.00')
        assert browser.driver.find_element('id', 'log').is_displayed()
        browser.run('document.activeElement.blur()')

        def has_to_pick() -> bool:  # once the decision has been there long enough to be read
            browser.press('\ue007')
            return 'pick an answer' in browser.text('told')

        browser.until(has_to_pick)
        assert len(robot.sent) == 1
        # A recording, and back.
        browser.driver.find_element('id', 'recordings').click()
        browser.until_text('dialog-body', 'patrol.mcap')
        browser.driver.find_element('css selector', '#dialog-body li button').click()
        browser.until_text('past', 'RECORDING')
        browser.until_text('timeline-title', 'patrol.mcap')
        browser.until(lambda: browser.run('return document.querySelectorAll(".lanes .states").length') == 1)
        # It is short, and has the whole width all the same.
        browser.until(lambda: browser.run('return document.querySelector(".lanes .before")?.getBBox().width ?? 0') < 40)
        browser.driver.find_element('id', 'past').click()
        browser.until_text('pose', 'x 3.00')


@NEEDS_BROWSER
def test_of_two_recordings_the_one_that_was_opened_last_is_shown(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    folder, goes_on = tmp_path / '.ros' / 'flexbt', threading.Event()
    folder.mkdir(parents=True)
    for name in ('first', 'last'):
        recording(folder / f'{name}.mcap')
    moment = RecordedPast.moment

    def slow(self: RecordedPast, time: float) -> Mirror:
        assert 'last' in str(self._file) or goes_on.wait(DEADLINE)
        return moment(self, time)

    monkeypatch.setattr(RecordedPast, 'moment', slow)
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        for name in ('first', 'last'):
            browser.driver.find_element('id', 'recordings').click()
            browser.until(lambda: browser.driver.find_element('id', 'dialog').is_displayed())  # it keeps its old text
            browser.press(f'{name}.mcap', '\ue007')
            browser.until_text('timeline-title', f'{name}.mcap')
        goes_on.set()
        browser.until(lambda: browser.driver.find_element('id', 'past-log').is_displayed())


@NEEDS_BROWSER
def test_a_time_line_of_decades_has_few_ticks(browser: Browser) -> None:
    """The clock of a robot was set while it was recorded."""
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        count = browser.run(
            'const {Timeline} = await import("./timeline.js"), place = document.getElementById("timeline");'
            'const line = new Timeline(place.appendChild(document.createElement("div")), {moment() {}});'
            'line.take({entries: [], revision: 1, begin: 0, end: 1.7e9, wall: 0, live: false});'
            'line.body.style.height = "100px";'
            'line.all();'
            'line.draw();'
            'return line.svg.querySelectorAll(".tick").length'
        )
        assert 1 <= count <= 30


@NEEDS_BROWSER
def test_a_great_time_line_keeps_the_page_from_nothing(browser: Browser) -> None:
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        drawn, later = browser.run("""
            const {Timeline} = await import('./timeline.js'), place = document.getElementById('timeline');
            const line = new Timeline(place.appendChild(document.createElement('div')), {moment() {}}), drawn = [];
            const frame = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
            const lanes = {revision: 1, begin: 0, wall: 0, live: true}, at = {begin: 0, end: 1, count: 1};
            const one = {...at, lane: 'states', key: '/A', label: '', word: '', tone: '', text: ''};
            line.body.style.height = '100px';
            const take = (number) => line.take({...lanes, entries: [{...one, number}], end: number});
            line.draw = () => {  // of very many entries
              drawn.push(performance.now());
              while (performance.now() - drawn.at(-1) < 200);
              Timeline.prototype.draw.call(line);
            };
            const begin = performance.now();
            for (let number = 1; performance.now() - begin < 2000; number += 1) { take(number); await frame(); }
            const count = drawn.length;
            while (line.isOld) await frame();  // in the end all of it is seen
            line.zoom(2);  // what somebody does is seen at once
            await frame();
            return [count, drawn.length - count];
        """)
        assert 1 <= drawn <= 4 and later >= 1


@NEEDS_BROWSER
def test_who_moves_along_the_time_line_asks_for_no_more_moments_than_the_server_takes(browser: Browser) -> None:
    robot = WebRobot()
    script = (
        'const {send} = WebSocket.prototype, times = [], line = document.querySelector("#timeline input");'
        'WebSocket.prototype.send = function (text) {'
        ' if (text.startsWith(\'{"moment"\')) times.push(performance.now()); send.call(this, text); };'
        'let count = 0;'
        'return new Promise((done) => { const move = () => {'
        ' count += 1;'
        ' line.value = Number(line.min) + (count % 50) / 50 * (line.max - line.min);'
        ' line.dispatchEvent(new Event("input"));'
        ' if (times.length < 12) requestAnimationFrame(move); else done(times); }; move(); })'
    )
    with served({'robot': robot.station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        robot.clock.advance(20.0)
        robot.show()
        browser.until(lambda: float(browser.run('return document.querySelector("#timeline input").max')) > 10.0)
        times = browser.run(script)
        assert all(later - earlier > 1000.0 / RATE for earlier, later in itertools.pairwise(times))


@NEEDS_BROWSER
def test_what_the_time_line_tells_covers_no_row(browser: Browser) -> None:
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        browser.run('document.querySelector("#timeline .timeline-body").focus()')
        browser.press('[')
        browser.until_text('timeline', 'no earlier failure')
        edges = (
            'const of = (name) => document.querySelector(`#timeline .timeline-${name}`).getBoundingClientRect();'
            'return [of("body").bottom, of("told").top, of("told").bottom, of("bar").top]'
        )
        body, top, bottom, bar = browser.run(edges)
        assert bar < body <= top + 0.5 < bottom


@NEEDS_BROWSER
def test_some_of_a_recording_stays_on_its_time_line_however_far_it_is_moved(browser: Browser) -> None:
    with served({'robot': WebRobot().station()}) as port:
        browser.driver.get(f'http://127.0.0.1:{port}/')
        browser.until_live()
        for pixels in (1000, -1000):
            start, end = browser.run(
                'const {Timeline} = await import("./timeline.js"), place = document.getElementById("timeline");'
                'const line = new Timeline(place.appendChild(document.createElement("div")), {moment() {}});'
                'line.take({entries: [], revision: 1, begin: 0, end: 10, wall: 0, live: false});'
                'line.body.style.height = "100px";'
                'line.draw();'
                'for (let n = 0; n < 50; n++) line.pan(arguments[0]);'
                'return [line.from, line.to]',
                pixels,
            )
            assert start < 10 and end > 0


@NEEDS_BROWSER
def test_the_time_line_has_the_clock_of_the_log_wherever_the_browser_is(browser: Browser, tmp_path: Path) -> None:
    wall = Recordings(recording(tmp_path / 'run.mcap').parent).past('run.mcap').lanes(0)['wall']
    zones = ('Asia/Tokyo', 'America/New_York')
    shown = []
    with served({'robot': WebRobot().station()}) as port:
        for zone in zones:
            browser.driver.get(f'http://127.0.0.1:{port}/')
            browser.driver.execute_cdp_cmd('Emulation.setTimezoneOverride', {'timezoneId': zone})
            try:
                script = 'const {Timeline} = await import("./timeline.js");'
                script += 'return Timeline.prototype.clock.call({wall: arguments[0]}, 60)'
                shown.append(browser.run(script, wall))
            finally:
                browser.driver.execute_cdp_cmd('Emulation.setTimezoneOverride', {'timezoneId': ''})
    assert shown == 2 * [time.strftime('%H:%M:%S', time.localtime(60))]
