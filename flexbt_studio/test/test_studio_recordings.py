# SPDX-License-Identifier: BSD-3-Clause
"""Recordings over the studio's WebSocket: what is listed and opened, and that no name leads elsewhere."""

from __future__ import annotations

import base64
import math
from pathlib import Path
from typing import Any

import pytest
from recorded import MACHINE, PATHS, TREE, installed_project, log, record
from test_studio_server import Page, Refused, with_pages

from flexbt_studio.documents.project import Project
from flexbt_studio.errors import StudioError
from flexbt_studio.server.recordings import recordings_of


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    project = tmp_path / 'project'
    record(project / 'recordings' / 'run.mcap')
    record(project / 'recordings' / 'incidents' / '20260101_120000_stop' / 'recording.mcap')
    (project / 'drive.xml').write_text(TREE)
    (project / 'tour.yaml').write_text(MACHINE)
    log(project, project / 'recordings' / 'dry.btlog', 'Look=FAILURE', '*=SUCCESS')
    return project


def test_a_recording_and_a_log_are_opened_at_any_time(folder: Path) -> None:
    async def story(page: Page) -> None:
        found = [one['name'] for one in await page.ask('recordings')]
        assert sorted(found) == ['dry.btlog', 'incidents/20260101_120000_stop', 'run.mcap']
        for name in ('run.mcap', 'incidents/20260101_120000_stop'):
            robot = await page.ask('watch', robot=f'recording {name}')
            lanes = await page.ask('past', robot=robot, revision=0)
            assert (lanes['begin'], lanes['end'], lanes['live']) == (0.0, 5.0, False)
            faults = [one['begin'] for one in lanes['entries'] if one['lane'] == 'faults']
            assert faults == [2.0]
            early, late = [await page.ask('past', robot=robot, time=time, map='') for time in (1.5, 4.5)]
            assert (early['active'], late['active']) == (['/Run'], ['/Rest']) and early['behavior'] == 'Tour'
            assert early['trees'][0]['statuses'] == {PATHS[0]: 'RUNNING', 'Look': 'RUNNING'}
            assert early['seen']['log'] == [] and 'lost the path' in late['seen']['log'][0]['text']
            assert (early['cells']['width'], len(base64.b64decode(early['cells']['cells']))) == (40, 800)
            assert 'cells' not in await page.ask('past', robot=robot, time=3.0, map=early['map'])
            assert await page.ask('reached', name=name) == {'Drive': sorted(PATHS[:3])}
        shown = await page.ask('tree_log', name='dry.btlog')
        assert (shown['tree'], shown['nodes']) == ('Drive', 4)
        assert [(one['path'], one['after']) for one in shown['events'] if one['after'] == 'FAILURE'] == [
            ('Look', 'FAILURE')
        ]
        text = (await page.ask('open', file=shown['file']))['text']
        assert '<Wait name="Look"' in text

    with_pages(folder, story)


def test_no_name_leads_elsewhere_and_what_is_no_recording_is_refused(folder: Path) -> None:
    place = folder / 'recordings'
    record(folder.parent / 'secret.mcap')
    record(folder.parent / 'other' / '20260101_120000_stop' / 'recording.mcap')
    (place / 'link.mcap').symlink_to(folder.parent / 'secret.mcap')
    (place / '2').symlink_to(folder.parent / 'other' / '20260101_120000_stop')
    (place / 'broken.mcap').write_bytes(b'no recording')
    (place / 'broken.btlog').write_bytes(b'no log')
    (place / 'large.btlog').write_bytes(bytes(9_000_000))

    async def story(page: Page) -> None:
        assert not {'link.mcap', '2'} & {one['name'] for one in await page.ask('recordings')}
        elsewhere = ['../../secret.mcap', str(folder.parent / 'secret.mcap'), 'link.mcap', '2', '', '.', 'run.mcap\0']
        for name in elsewhere:
            for method, words in (('watch', {'robot': f'recording {name}'}), ('reached', {'name': name})):
                with pytest.raises(Refused, match='has no recording'):
                    await page.ask(method, **words)
        for name, why in (
            ('broken', 'not a log file'),
            ('large', 'at most 8 MB'),
            ('missing', 'no recording'),
        ):
            with pytest.raises(Refused, match=why):
                await page.ask('tree_log', name=f'{name}.btlog')
        with pytest.raises(Refused, match='not an MCAP file'):
            await page.ask('watch', robot='recording broken.mcap')
        odd_words: list[dict[str, Any]] = [{'time': 'x'}, {'time': None}, {}, {'revision': 'x'}, {'time': {}}]
        for wrong in odd_words:
            with pytest.raises(Refused, match='past: its arguments'):
                await page.ask('past', robot='recording run.mcap', **wrong)
        for odd in (-1e300, 1e300, math.pi):
            assert (await page.ask('past', robot='recording run.mcap', time=odd))['event'] == 'live'

    with_pages(folder, story)


def test_a_recording_is_decided_again_by_a_tree_as_it_is_edited(tmp_path: Path) -> None:
    name = installed_project(tmp_path)
    (tmp_path / 'other.xml').write_text(TREE)

    async def decide(page: Page, version: int, file: str = name, recording: str = 'run.mcap') -> dict[str, Any]:
        number = (await page.ask('start_job', job='decide', file=file, version=version, recording=recording))['number']
        ended: dict[str, Any] = await page.event('job', number=number)
        return ended

    async def story(page: Page) -> None:
        text = (await page.ask('open', file=name))['text']
        await page.ask('open', file='other.xml')
        await page.ask('edit', file='other.xml', version=1, edits=[[0, 0, ' ']])  # which is not installed
        same = await decide(page, 1)
        assert same['state'] == 'done' and same['result'][0]['differs'] is False, same
        begin, end = text.index('<RecoveryNode'), text.index('</BehaviorTree>')
        await page.ask('edit', file=name, version=1, edits=[[begin, end, '<AlwaysFailure/>']])
        [found] = (await decide(page, 2))['result']
        assert found['differs'] and 'tree GlobalPlanner' in found['text'] and 'AlwaysFailure FAILURE' in found['text']
        assert (tmp_path / name).read_text() == text, 'nothing is saved'
        await page.ask('edit', file=name, version=2, edits=[[begin, begin, '<Nonsense/>']])
        broken = await decide(page, 3)
        assert broken['state'] == 'failed' and 'a tree has exactly 1 root node' in broken['message'], broken
        for file, recording, why in (
            (name, 'missing.mcap', 'has no recording'),
            ('other.xml', 'run.mcap', 'flexbt_demo_behaviors is installed without it'),
        ):
            with pytest.raises(Refused, match=why):
                await decide(page, 1, file, recording)
        (tmp_path / 'package.xml').write_text('<package><name>nobody_has_it</name></package>')
        with pytest.raises(Refused, match='its package nobody_has_it is not installed'):
            await decide(page, 3)
        (tmp_path / 'package.xml').unlink()
        with pytest.raises(Refused, match='is in no ROS package'):
            await decide(page, 3)

    with_pages(tmp_path, story)


def test_where_recordings_are(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('HOME', str(folder.parent / 'home'))
    project = Project(folder)
    assert len(recordings_of(project, '').names()) == 3
    assert len(recordings_of(project, str(folder / 'recordings' / 'incidents')).names()) == 1
    with pytest.raises(StudioError, match='is not a folder'):
        recordings_of(project, str(folder / 'nowhere'))
    (folder / 'recordings').rename(folder.parent / 'moved')
    assert recordings_of(project, '').names() == []  # that of the user's home is not there
    (folder / 'recordings').symlink_to(folder.parent / 'moved')
    assert recordings_of(project, '').names() == []


def test_each_request_is_answered_even_the_one_that_is_too_many(folder: Path) -> None:
    async def story(page: Page) -> None:
        for number in range(1000):
            await page.socket.send_json({'id': number, 'method': 'mocks', 'arguments': {'file': 'drive.xml'}})
        for wrong in ('{', '[]', '{"id": "a", "method": 3}', '{"id": "b", "method": "hello", "arguments": 1}'):
            await page.socket.send_str(wrong)
        answers: dict[Any, Any] = {}
        while not {*range(1000), 'a', 'b'} <= answers.keys():
            message = await page.socket.receive_json()
            if 'event' not in message:
                answers[message['id']] = message
        busy = [one for one in answers.values() if 'error' in one and one['error']['kind'] == 'busy']
        assert all('64 requests of this page are waiting' in one['error']['message'] for one in busy)
        assert await page.ask('files')

    with_pages(folder, story)


def test_a_log_is_forgotten_with_the_last_page_that_shows_it(folder: Path) -> None:
    async def story(one: Page, other: Page, last: Page) -> None:
        file = (await one.ask('tree_log', name='dry.btlog'))['file']
        await other.ask('open', file=file)

        async def is_listed() -> bool:
            return file in [each['file'] for each in await last.ask('files')]

        await one.socket.close()
        while (await last.event('pages'))['count'] != 2:
            pass
        assert await is_listed()
        await other.socket.close()
        while (await last.event('pages'))['count'] != 1:
            pass
        assert not await is_listed()

    with_pages(folder, story, 3)
