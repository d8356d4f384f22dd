# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in Python run only after the user's word, and then in processes that can do no harm."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from lsprotocol import types as lsp
from test_studio_language_server import Editor, with_editor
from test_studio_server import TOKEN, Page, Refused, with_pages

from flexbt_studio.documents.project import Project
from flexbt_studio.tool_process import check_copy, checked
from flexbt_testing.waiting import wait_until

BEHAVIOR = """\
import helper
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import WaitState


class Waits(Behavior):
    manifest = BehaviorManifest('Waits Long', 'waits')

    def create(self) -> OperatableStateMachine:
        machine = OperatableStateMachine(['finished', 'failed'])
        with machine:
            machine.add('First', WaitState(helper.SECONDS), transitions={'done': 'Second'})
            machine.add('Second', WaitState(1.0), transitions={'done': 'finished'})
        return machine
"""


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a busy machine have time for several processes in one story."""
    monkeypatch.setattr('flexbt_studio.tool_process.CHECK_SECONDS', 600.0)
    for module in ('test_studio_server', 'test_studio_language_server'):
        monkeypatch.setattr(f'{module}.DEADLINE', 600.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    package = tmp_path / 'package' / 'inner'
    package.mkdir(parents=True)
    for name in ('package', 'package/inner'):
        (tmp_path / name / '__init__.py').touch()
    (package / 'waits.py').write_text(BEHAVIOR.replace('import helper', 'from package import helper'))
    (package.parent / 'helper.py').write_text('SECONDS = 1.0\n')
    return package


async def found(page: Page, version: int) -> list[dict[str, Any]]:
    findings: list[dict[str, Any]] = (await page.event('findings', file='waits.py', version=version))['findings']
    return findings


async def edited(page: Page, version: int, text: str, new: str) -> list[dict[str, Any]]:
    """Replace a text of the file, and return the findings for the version that this makes."""
    now = (await page.ask('open', file='waits.py'))['text']
    start = now.index(text)
    await page.ask('edit', file='waits.py', version=version, edits=[[start, start + len(text), new]])
    return await found(page, version + 1)


def test_nothing_runs_without_the_word_and_then_there_is_what_machines_get(folder: Path) -> None:
    async def story(page: Page, other: Page) -> None:
        await page.ask('open', file='waits.py')
        (told,) = await found(page, 1)
        assert (told['rule'], told['severity']) == ('not-run', 'info')
        for job in ('prove', 'compare'):
            with pytest.raises(Refused, match='nobody has allowed'):
                await page.ask('start_job', job=job, file='waits.py', version=1)
        await page.ask('allow_code')
        (dead,) = await found(page, 1)
        assert (dead['rule'], dead['path']) == ('dead-outcome', '/')
        with pytest.raises(Refused, match='nobody has allowed'):  # the word of another page is not its own
            await other.ask('start_job', job='prove', file='waits.py', version=1)
        assert [one for one in await edited(page, 1, "'Second'}", "'Secnd'}") if one['severity'] == 'error']
        (raised,) = await edited(page, 2, 'WaitState(helper', 'WaitState(helper, helper')
        text = (await page.ask('open', file='waits.py'))['text']
        assert raised['path'] == '/First' and 'TypeError' in raised['message']
        assert text[slice(*raised['span'])].strip().startswith("machine.add('First'")
        (missing,) = await edited(page, 3, 'from package import helper', 'import no_such_module')
        assert (missing['line'], missing['severity']) == (1, 'error') and 'no_such_module' in missing['message']

    with_pages(folder, story, 2)


def test_a_file_of_any_name_is_checked(tmp_path: Path) -> None:
    name = '-waits 2.py'
    (tmp_path / name).write_text(BEHAVIOR.replace('import helper\n', '').replace('helper.SECONDS', '1.0'))
    known, copy = check_copy(Project(tmp_path), name)
    (dead,) = asyncio.run(checked(copy))
    assert (known, dead['rule']) == (name, 'dead-outcome')


def test_a_proof_and_a_comparison_are_of_the_text_in_the_page(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('allow_code')
        await page.ask('open', file='waits.py')
        await found(page, 1)
        await edited(page, 1, "'finished'}", "'failed'}")
        require = ['never =failed']
        started = await page.ask('start_job', job='prove', file='waits.py', version=2, require=require)
        assert set(started['files']) == {'waits.py', '__init__.py', '../__init__.py', '../helper.py'}
        proved = await page.event('job', job='prove')
        (proof,) = proved['result'][0]['proofs']
        assert any(step['statuses'] for step in proof['wrong'][0]['steps']) and proof['never'] == ['/ > finished']
        await page.ask('start_job', job='compare', file='waits.py', version=2)
        compared = await page.event('job', job='compare')
        assert compared['result'][0]['comparisons'][0]['differences'], compared

    with_pages(folder, story)


HARMFUL = {
    'while True: pass': 'more than 3 s',
    'import time; time.sleep(10 ** 6)': 'more than 3 s',
    'x = bytearray(10 ** 11)': 'MemoryError',
    'import os; os.fork()': 'not allowed',
    'import subprocess; subprocess.run(["touch", "{0}"])': 'not allowed',
    'open("{0}", "w")': 'PermissionError',
    'open("/proc/self/root{0}", "w")': 'PermissionError',
    'import socket; socket.create_connection(("127.0.0.1", 9))': 'not allowed',
    'import os; os._exit(0)': 'ended with code 0',
    'import ctypes; ctypes.string_at(0)': 'ended by signal 11',
    'print("x" * 10_000_000)': 'never ends by its outcome',
    'print(\'{{"findings": []}}\'); import nothing_at_all': 'nothing_at_all',
    'raise KeyboardInterrupt': 'ended with code 130',
}


@pytest.mark.parametrize('code', HARMFUL)
def test_code_that_would_do_harm_is_ended_and_told(
    folder: Path, code: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if 'more than' in HARMFUL[code]:
        monkeypatch.setattr('flexbt_studio.tool_process.CHECK_SECONDS', 3.0)
    evil = tmp_path / 'evil'
    (folder / 'waits.py').write_text(f'{code.format(evil)}\n{(folder / "waits.py").read_text()}')

    async def story(page: Page) -> None:
        await page.ask('allow_code')
        await page.ask('open', file='waits.py')
        (told,) = await found(page, 1)
        assert HARMFUL[code] in told['message'] and told['severity'] in ('error', 'warning')
        assert not evil.exists()

    with_pages(folder, story)


def test_the_language_server_runs_code_after_its_command_or_option(folder: Path) -> None:
    text = (folder / 'waits.py').read_text()

    async def story(editor: Editor) -> None:
        (told,) = await editor.show('waits.py', text)
        assert told.code == 'not-run' and told.severity is lsp.DiagnosticSeverity.Information
        editor.heard.clear()
        await editor.client.workspace_execute_command_async(lsp.ExecuteCommandParams('flexbt.runPython'))
        await editor.heard.wait()
        (dead,) = editor.diagnostics[editor.uri('waits.py')]
        assert dead.code == 'dead-outcome' and dead.range.start.line == text[
            : text.index('OperatableStateMachine([')
        ].count('\n')
        (wrong,) = await editor.show('waits.py', text.replace('import helper', 'import helpers'), 2)
        assert 'helpers' in wrong.message and wrong.severity is lsp.DiagnosticSeverity.Error

    with_editor(folder, story)

    async def told_at_start(editor: Editor) -> None:
        (dead,) = await editor.show('waits.py', text)
        assert dead.code == 'dead-outcome'

    with_editor(folder, told_at_start, {'runPython': True})


def test_what_runs_ends_with_the_studio(folder: Path, tmp_path: Path) -> None:
    (folder / 'waits.py').write_text(f'import time\ntime.sleep(10 ** 6)\n{BEHAVIOR}')
    call = 'import sys; from flexbt_studio.executables import studio; sys.argv[0] = "studio"; sys.exit(studio())'
    environment = {**os.environ, 'TMPDIR': str(tmp_path), 'PYTHONUNBUFFERED': '1'}
    server = subprocess.Popen(
        [sys.executable, '-P', '-c', call, str(folder)], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert server.stdout is not None
    try:
        address = next(line for line in server.stdout if 'http://' in line).split('http://')[1].split()[0]
        host, _, token = address.partition('/#token=')

        async def story() -> None:
            async with aiohttp.ClientSession(f'http://{host}') as session:
                page = Page(await session.ws_connect('/session', max_msg_size=0))
                await page.socket.send_json({'hello': token or TOKEN})
                await page.ask('allow_code')
                await page.ask('open', file='waits.py')
                await asyncio.to_thread(wait_until, lambda: importing(tmp_path), lambda: 'no process imports it')

        asyncio.run(story())
        (process,) = importing(tmp_path)
        server.send_signal(signal.SIGKILL)
        wait_until(lambda: not importing(tmp_path), lambda: f'process {process} goes on')
    finally:
        server.kill()
        server.communicate()


def importing(folder: Path) -> list[int]:
    """Return the processes that work in folders of copies below a folder."""
    found = []
    for one in Path('/proc').glob('[0-9]*'):
        try:
            if (one / 'cwd').readlink().is_relative_to(folder):
                found.append(int(one.name))
        except OSError:
            continue  # it has ended
    return found


FLEXBE = """\
from flexbe_core import Autonomy, Behavior, OperatableStateMachine
from flexbe_states.wait_state import WaitState


class WaitsSM(Behavior):
    def __init__(self, node):
        super().__init__()
        self.name = 'Waits'
        OperatableStateMachine.initialize_ros(node)
        WaitState.initialize_ros(node)

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            # x:30 y:40
            OperatableStateMachine.add('Wait', WaitState(1.0), {'done': 'nowhere'}, {'done': Autonomy.Off})
        return machine
"""


def test_a_behavior_of_flexbe_is_checked_in_the_same_way(folder: Path) -> None:
    pytest.importorskip('flexbt_flexbe')
    (folder / 'waits.py').write_text(FLEXBE)

    async def story(page: Page) -> None:
        await page.ask('allow_code')
        await page.ask('open', file='waits.py')
        (wrong,) = await found(page, 1)
        assert wrong['path'] == '/Wait' and 'nowhere' in wrong['message']

    with_pages(folder, story)
