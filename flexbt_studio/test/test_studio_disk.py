# SPDX-License-Identifier: BSD-3-Clause
"""Files that other programs write while they are open: pages are told, and one of them takes the text."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest
from test_studio_server import TREE, Page, Refused, with_pages

from flexbt_studio.documents.project import Project
from flexbt_studio.errors import StudioError

FAR = '<root BTCPP_format="4"><BehaviorTree ID="Far"><AlwaysSuccess/></BehaviorTree></root>\n'
USER = '<root BTCPP_format="4"><BehaviorTree ID="Main"><SubTree ID="Far"/></BehaviorTree></root>\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / 'main.xml').write_text(TREE)
    return tmp_path / 'main.xml'


def test_pages_are_told_and_one_takes_the_text_of_the_other_program(file: Path) -> None:
    async def story(one: Page, other: Page) -> None:
        for page in (one, other):
            await page.ask('open', file='main.xml')
        file.write_text(TREE.replace('"1"', '"22"'))
        for page in (one, other):
            await page.event('disk', file='main.xml')
        assert await one.ask('take_disk', file='main.xml') == TREE.replace('"1"', '"22"')
        assert await other.ask('take_disk', file='main.xml') is None
        assert (await other.event('files_changed', what='take_disk'))['saved'] == TREE.replace('"1"', '"22"')
        place = TREE.index('"1"') + 1
        await one.ask('edit', file='main.xml', version=1, edits=[[place, place + 1, '22']])
        assert await one.ask('difference', file='main.xml') == []
        file.unlink()
        assert not (await one.ask('save', file='main.xml', version=2))['changed'] and file.exists()
        file.write_bytes(b'\xff\xfe')  # no text: nothing to take
        with pytest.raises(Refused, match='changed on disk'):
            await one.ask('save', file='main.xml', version=2)
        file.write_text(TREE)
        assert await one.event('disk', file='main.xml')

    with_pages(file.parent, story, 2)


def test_pages_are_told_when_files_appear_and_vanish(file: Path) -> None:
    async def story(page: Page) -> None:
        assert [one['file'] for one in (await page.ask('hello'))['files']] == ['main.xml']
        (file.parent / 'added.xml').write_text(TREE)
        await page.event('files_changed', what='disk')
        assert [one['file'] for one in await page.ask('files')] == ['added.xml', 'main.xml']
        file.unlink()
        await page.event('files_changed', what='disk')
        assert [one['file'] for one in await page.ask('files')] == ['added.xml']

    with_pages(file.parent, story)


def test_pages_are_told_of_files_that_are_not_open_and_what_uses_their_trees_is_checked_again(file: Path) -> None:
    far = file.with_name('far.xml')
    far.write_text(FAR)
    file.write_text(USER)

    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        assert (await page.event('findings', file='main.xml'))['findings'] == []
        far.write_text(FAR + '\n')
        await page.event('disk', file='far.xml')
        await page.event('files_changed', what='disk')  # it may have other trees
        assert (await page.event('findings', file='main.xml'))['findings'] == []
        await page.ask('trees', file='main.xml')
        far.unlink()
        await page.ask('files')  # whoever looks first
        await page.event('disk', file='far.xml')
        (found,) = (await page.event('findings', file='main.xml'))['findings']
        assert 'there is no tree [Far]' in found['message']

    with_pages(file.parent, story)


def test_what_no_page_has_open_is_as_on_disk_unless_it_is_edited(file: Path) -> None:
    far, edited = file.with_name('far.xml'), file.with_name('edited.xml')
    for one in (far, edited):
        one.write_text(FAR)

    async def story(page: Page, other: Page) -> None:
        async def opened() -> list[str]:
            return [one['file'] for one in await page.ask('files') if one['open']]

        await page.ask('run_nodes', file='far.xml', tree='Far')  # this opens nothing
        assert await opened() == []
        for one in (page, other):
            await one.ask('open', file='far.xml')
        await page.ask('open', file='edited.xml')
        await page.ask('edit', file='edited.xml', version=1, edits=[[0, 0, ' ']])
        for name in ('far.xml', 'edited.xml'):
            await page.ask('leave', file=name)
        file.write_text(TREE.replace('Spin', 'Wait'))
        await page.event('disk', file='main.xml')  # since then it was looked
        assert await opened() == ['edited.xml', 'far.xml']
        await other.socket.close()
        while await opened() != ['edited.xml']:
            await asyncio.sleep(0.1)
        far.write_text(FAR.replace('Far', 'Near'))
        await page.event('disk', file='far.xml')
        assert (await page.ask('trees', file='main.xml')).keys() >= {'Near'}

    with_pages(file.parent, story, 2)


def test_a_page_that_opens_a_file_is_told_what_was_told_before(file: Path) -> None:
    async def story(one: Page, other: Page) -> None:
        await one.ask('open', file='main.xml')
        await one.ask('edit', file='main.xml', version=1, edits=[[0, 0, ' ']])
        file.write_text(TREE + '\n')
        await one.event('disk', file='main.xml')
        await other.event('disk', file='main.xml')
        await other.ask('open', file='main.xml')
        await other.event('disk', file='main.xml')
        with pytest.raises(Refused, match='changed on disk'):
            await one.ask('save', file='main.xml', version=2)

    with_pages(file.parent, story, 2)


def test_a_mark_that_another_program_writes_stays_and_what_is_no_text_is_not_replaced(file: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        file.write_bytes(b'\xef\xbb\xbf' + TREE.encode())
        with pytest.raises(Refused, match='changed on disk'):
            await page.ask('save', file='main.xml', version=1)
        assert await page.ask('take_disk', file='main.xml') == TREE
        await page.ask('edit', file='main.xml', version=1, edits=[[0, 0, ' ']])
        await page.ask('save', file='main.xml', version=2)
        assert file.read_bytes() == b'\xef\xbb\xbf ' + TREE.encode()
        await page.ask('create', file='new.xml', text=TREE)
        (file.parent / 'new.xml').write_bytes(b'\xff\xfe')
        with pytest.raises(Refused, match='changed on disk'):
            await page.ask('save', file='new.xml', version=1)

    with_pages(file.parent, story)


def test_a_file_is_read_anew_after_one_of_the_same_time_and_size_takes_its_place(file: Path) -> None:
    project = Project(file.parent)
    assert project.document('main.xml').text == TREE
    project.open('main.xml')
    assert project.disk_changes() == []
    project.close('main.xml')
    changed = TREE.replace('Spin', 'Wait')
    fresh = file.with_name('fresh')
    fresh.write_text(changed)
    os.utime(fresh, ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns))  # as rsync, tar and cp -p do
    fresh.replace(file)
    assert project.document('main.xml').text == changed


def test_a_name_that_the_disk_refuses_is_told_at_the_save(tmp_path: Path) -> None:
    project, name = Project(tmp_path), f'{"x" * 300}.xml'
    version = project.create(name, TREE).version
    with pytest.raises(StudioError, match='could not be written: File name too long'):
        project.save(name, version)
    assert project.text(name) == TREE
