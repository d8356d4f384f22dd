# SPDX-License-Identifier: BSD-3-Clause
"""The studio's server over its real HTTP and WebSocket: pages, edits, conflicts, jobs, and what it refuses."""

from __future__ import annotations

import asyncio
import json
import os
import pwd
import shutil
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, NoReturn

import aiohttp
import pytest

from flexbt_console.commands.spec import Role
from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.greetings import GREETING_OF_SOURCE
from flexbt_console.ui.web.server import serving
from flexbt_console.ui.web.users import User, Users, token_hash, write_users
from flexbt_studio.server.main import main as studio
from flexbt_studio.server.web_server import StudioServer, editor_folder
from flexbt_studio.server.workbench import Workbench
from flexbt_testing.waiting import DEADLINE

TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <Fallback>
        <Wait wait_duration="1"/>
        <Spin/>
      </Fallback>
      <Inverter>
        <AlwaysSuccess/>
      </Inverter>
      <SubTree ID="Other"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
OTHER = '<root BTCPP_format="4"><BehaviorTree ID="Other"><AlwaysSuccess name="ä"/></BehaviorTree></root>'
TOKEN = 'a-token'  # noqa: S105


class Refused(Exception):
    """What the server answered instead of a result."""


class Page:
    """An open page."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.events: list[dict[str, Any]] = []
        self._asked = 0

    async def ask(self, method: str, **arguments: Any) -> Any:
        """Return the result of a request. Keep the events that arrive before it."""
        self._asked += 1
        await self.socket.send_json({'id': self._asked, 'method': method, 'arguments': arguments})
        while True:
            message = await self.socket.receive_json()
            if message.get('id') != self._asked:
                self.events.append(message)
            elif 'error' in message:
                raise Refused(message['error']['kind'], message['error']['message'])
            else:
                return message['result']

    async def event(self, name: str, **fields: Any) -> dict[str, Any]:
        """Return the next event of this name with these fields, also one that has arrived before."""
        while True:
            for one in self.events:
                if one.get('event') == name and all(one.get(key) == value for key, value in fields.items()):
                    self.events.remove(one)
                    return one
            self.events.append(await self.socket.receive_json())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / 'main.xml').write_text(TREE)
    (tmp_path / 'more').mkdir()
    (tmp_path / 'more' / 'other.xml').write_text(OTHER)
    return tmp_path


def with_pages(
    folder: Path, story: Callable[..., Awaitable[None]], count: int = 1, access: Access | None = None
) -> None:
    """Run a story with pages of a server for the folder."""
    access = access or Access('127.0.0.1', TOKEN)

    async def run() -> None:
        server = StudioServer(Workbench(folder), access, editor_folder())
        async with (
            asyncio.timeout(DEADLINE),
            serving(server.application(), '127.0.0.1', 0) as port,
            aiohttp.ClientSession(f'http://127.0.0.1:{port}') as session,
        ):
            pages = [Page(await session.ws_connect('/session', max_msg_size=0)) for _ in range(count)]
            for page in pages:
                await page.socket.send_json({'hello': TOKEN})
            await story(*pages, session) if 'session' in story.__annotations__ else await story(*pages)

    asyncio.run(run())


def test_an_edit_reaches_the_other_page_and_the_disk_only_by_a_save(folder: Path) -> None:
    async def story(one: Page, other: Page) -> None:
        opened = await one.ask('open', file='main.xml')
        assert opened['text'] == TREE and opened['version'] == 1
        await other.ask('open', file='main.xml')
        place = TREE.index('"1"') + 1
        assert await one.ask('edit', file='main.xml', version=1, edits=[[place, place + 1, '25']]) == 2
        told = await other.event('edited', file='main.xml')
        assert told['version'] == 2 and told['edits'] == [[place, place + 1, '25']]
        with pytest.raises(Refused, match='version 2 is current') as refused:
            await other.ask('edit', file='main.xml', version=1, edits=[[0, 0, 'x']])
        assert refused.value.args[0] == 'conflict'
        model = await other.event('model', version=2)
        assert model['view']['nodes'][2]['attributes'][0]['value'] == '25'
        assert (folder / 'main.xml').read_text() == TREE
        difference = await one.ask('difference', file='main.xml')
        assert [line for line in difference if line[0] in '+-'][2:] == [
            '-        <Wait wait_duration="1"/>',
            '+        <Wait wait_duration="25"/>',
        ]
        await other.ask('save', file='main.xml', version=2)
        assert (folder / 'main.xml').read_text() == TREE.replace('"1"', '"25"')

    with_pages(folder, story, 2)


def test_what_a_page_has_sent_is_done_and_told_though_it_ends_at_once(folder: Path) -> None:
    async def story(one: Page, other: Page) -> None:
        for page in (one, other):
            await page.ask('open', file='main.xml')
        change = {'file': 'main.xml', 'version': 1, 'edits': [[0, 0, ' ']]}
        await one.socket.send_json({'id': 98, 'method': 'edit', 'arguments': change})
        await one.socket.send_json({'id': 99, 'method': 'save', 'arguments': {'file': 'main.xml', 'version': 2}})
        await one.socket.close()
        assert (await other.event('edited', file='main.xml'))['version'] == 2
        await other.event('files_changed', file='main.xml', what='save')
        assert (folder / 'main.xml').read_text() == f' {TREE}'

    with_pages(folder, story, 2)


def test_a_page_that_was_not_connected_gets_the_edits_since(folder: Path) -> None:
    async def story(one: Page, other: Page) -> None:
        for page in (one, other):
            assert (await page.ask('open', file='main.xml'))['since'] is None
        made = []
        for version, key in ((1, 'a'), (2, 'b')):
            edits = [[0, 0, key]]
            await one.ask('edit', file='main.xml', version=version, edits=edits, key=key)
            assert (await other.event('edited', version=version + 1))['key'] == key
            made.append([version + 1, edits, key])
        for version, since in ((1, made), (2, made[1:]), (3, []), (0, None), (4, None)):
            assert (await other.ask('open', file='main.xml', version=version))['since'] == since
        await one.ask('edit', file='main.xml', version=3, edits=[[0, 0, ' ' * 100_000]], key='c')  # too much to be kept
        for version, since in ((4, []), (3, None), (1, None)):
            assert (await other.ask('open', file='main.xml', version=version))['since'] == since
        await one.ask('close', file='main.xml')
        assert (await other.ask('open', file='main.xml', version=2))['since'] is None

    with_pages(folder, story, 2)


def test_a_file_that_is_closed_before_its_check_stays_closed(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        await page.ask('create', file='new.xml', text=TREE)
        for file in ('main.xml', 'new.xml'):
            await page.ask('close', file=file)
        await page.ask('open', file='more/other.xml')
        await page.event('findings', file='more/other.xml')  # after the checks of the others would have been
        assert [one['file'] for one in await page.ask('files') if one['open']] == ['more/other.xml']
        assert not [one for one in page.events if one['event'] == 'note']

    with_pages(folder, story)


def test_what_somebody_else_wrote_is_not_overwritten(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        await page.ask('edit', file='main.xml', version=1, edits=[[0, 0, '<!-- mine -->']])
        theirs = TREE.replace('Spin', 'BackUp')
        (folder / 'main.xml').write_text(theirs)
        with pytest.raises(Refused, match='changed on disk'):
            await page.ask('save', file='main.xml', version=2)
        seen = await page.ask('on_disk', file='main.xml')
        assert seen['text'] == theirs
        (folder / 'main.xml').write_text(theirs + '\n')  # and again
        with pytest.raises(Refused, match='changed on disk'):
            await page.ask('save', file='main.xml', version=2, over=seen['disk'])
        seen = await page.ask('on_disk', file='main.xml')
        await page.ask('save', file='main.xml', version=2, over=seen['disk'])
        assert (folder / 'main.xml').read_text() == '<!-- mine -->' + TREE

    with_pages(folder, story)


def test_line_breaks_and_a_byte_order_mark_stay(folder: Path) -> None:
    written = ('\ufeff' + TREE.replace('\n', '\r\n')).encode()
    (folder / 'main.xml').write_bytes(written)

    async def story(page: Page) -> None:
        opened = await page.ask('open', file='main.xml')
        assert opened['text'] == TREE
        node = next(one for one in opened['view']['nodes'] if one['type'] == 'Spin')
        start, end = node['span']
        assert TREE[start:end] == '<Spin/>'
        edits = await page.ask(
            'gesture',
            file='main.xml',
            version=1,
            name='add_node',
            arguments={'parent': node['parent'], 'index': 0, 'xml': '<AlwaysFailure/>'},
        )
        await page.ask('edit', file='main.xml', version=1, edits=edits)
        await page.ask('save', file='main.xml', version=2)
        expected = written.replace(b'        <Wait', b'        <AlwaysFailure/>\r\n        <Wait')
        assert (folder / 'main.xml').read_bytes() == expected

    with_pages(folder, story)


def test_findings_come_after_an_edit_with_a_fix_and_look_into_other_files(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        found = await page.event('findings', version=1)
        assert [one for one in found['findings'] if one['severity'] == 'error'] == []
        place = TREE.index('wait_duration') + len('wait_duration')
        await page.ask('edit', file='main.xml', version=1, edits=[[place, place, 's']])
        found = await page.event('findings', version=2)
        (error,) = [one for one in found['findings'] if one['severity'] == 'error']
        assert error['path'] == 'Main/0/0/0' and error['file'] == 'main.xml'
        (fix,) = error['fixes']
        await page.ask('edit', file='main.xml', version=2, edits=fix['edits'])
        assert (await page.ask('model', file='main.xml'))['text'] == TREE
        await page.ask('edit', file='main.xml', version=3, edits=[[TREE.index('Other'), TREE.index('Other') + 1, 'Z']])
        found = await page.event('findings', version=4)
        assert any('Zther' in one['message'] for one in found['findings'])
        await page.ask('open', file='more/other.xml')
        await page.event('findings', file='more/other.xml')
        page.events.clear()
        await page.ask(
            'edit', file='more/other.xml', version=1, edits=[[OTHER.index('Other'), OTHER.index('Other') + 1, 'Z']]
        )
        found = await page.event('findings', file='main.xml')  # of a file that was not edited
        assert not any('Zther' in one['message'] for one in found['findings'])

    with_pages(folder, story)


def test_a_proof_has_steps_at_nodes_and_a_cancelled_one_leaves_no_process(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        asked = {'file': 'main.xml', 'version': 1, 'require': ['never =FAILURE']}
        number = (await page.ask('start_job', job='prove', **asked))['number']
        done = await page.event('job', number=number)
        assert done['state'] == 'done', done
        (found,) = [one for one in done['result'][0]['proofs'][0]['wrong'] if one['property'] == 'REQUIREMENT']
        last = found['steps'][-1]['statuses']
        assert {tuple(done['nodes'][path]): status for path, status in last.items()}[
            ('main.xml', 'Main/0')
        ] == 'FAILURE'
        assert ['more/other.xml', 'Other/0'] in done['nodes'].values()
        await page.ask('create', file='-new.xml', text=OTHER)
        number = (await page.ask('start_job', job='run', file='-new.xml', version=1))['number']
        assert (await page.event('job', number=number))['state'] == 'done'  # its name is no option
        number = (await page.ask('start_job', job='run', file='main.xml', version=1, mock=['*=FAILURE']))['number']
        ran = await page.event('job', number=number)
        assert ran['result'][-1]['result'] == 'FAILURE' and ran['result'][0]['path'] in ran['nodes']
        number = (await page.ask('start_job', job='prove', **asked))['number']
        await page.ask('cancel_job', number=number)
        assert (await page.event('job', number=number))['state'] == 'canceled'
        assert children('flexbt_tools') == []
        # Also while its process is being started, and at the end of the page that has started it.
        numbers = [(await page.ask('start_job', job='prove', **asked))['number'] for _ in range(3)]
        await page.ask('cancel_job', number=numbers[0])
        while not children('flexbt_tools'):
            await asyncio.sleep(0)
        await page.ask('cancel_job', number=numbers[1])
        await page.socket.close()
        while children('flexbt_tools'):
            await asyncio.sleep(0)

    with_pages(folder, story)


def children(word: str = 'flexbt_') -> list[str]:
    """Return the command lines with a word of the processes that this one has started and that are still there.

    The fork server is one of the tests, for all of them.
    """
    found = []
    for entry in Path('/proc').iterdir():
        if entry.name.isdigit():
            try:
                parent = entry.joinpath('stat').read_text().rpartition(')')[2].split()[1]
                line = entry.joinpath('cmdline').read_bytes().replace(b'\0', b' ').decode()
            except OSError:
                continue
            if int(parent) == os.getpid() and word in line and 'fork_server' not in line:
                found.append(line)
    return found


def test_a_comparison_tells_whether_an_edit_changes_what_the_tree_does(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('open', file='main.xml')
        spin = TREE.index('        <Spin/>\n')
        await page.ask('edit', file='main.xml', version=1, edits=[[spin, spin, '        <!-- turn -->\n']])
        number = (await page.ask('start_job', job='compare', file='main.xml', version=2))['number']
        same = await page.event('job', number=number)
        assert not any(one['differences'] for one in same['result'][0]['comparisons']), same
        await page.ask('gesture', file='main.xml', version=2, name='remove', arguments={'node': 'Main/0/0/1'})
        edits = await page.ask('gesture', file='main.xml', version=2, name='remove', arguments={'node': 'Main/0/0/1'})
        await page.ask('edit', file='main.xml', version=2, edits=edits)
        number = (await page.ask('start_job', job='compare', file='main.xml', version=3))['number']
        other = await page.event('job', number=number)
        assert any(one['differences'] for one in other['result'][0]['comparisons']), other
        # It uses another file no longer, which is compared, too.
        length = len((await page.ask('model', file='main.xml'))['text'])
        text = TREE.replace('<SubTree ID="Other"/>', '<AlwaysSuccess/>')
        await page.ask('edit', file='main.xml', version=3, edits=[[0, length, text]])
        started = await page.ask('start_job', job='compare', file='main.xml', version=4)
        assert started['files'] == ['main.xml', 'more/other.xml']
        same = await page.event('job', number=started['number'])
        told = [(one['name'], one['only'], one['differences']) for one in same['result'][0]['comparisons']]
        assert told == [('tree Main', '', []), ('tree Other', '', [])]

    (folder / 'latin.xml').write_bytes(b'<BehaviorTree ID="\xe9"/>')  # cannot be read, and has nothing to do with it
    with_pages(folder, story)


NONSENSE: list[tuple[str, dict[str, Any], str]] = [
    ('opne', {}, "did you mean 'open'"),
    ('_view', {}, 'no request'),
    ('end', {}, 'no request'),
    ('open', {}, 'missing'),
    ('open', {'file': '../secret.xml'}, 'not in the project'),
    ('open', {'file': '/etc/passwd'}, 'not in the project'),
    ('open', {'file': 'link.xml'}, 'not in the project'),
    ('open', {'file': 'a\0b'}, 'not in the project'),
    ('open', {'file': './main.xml'}, "has the name 'main.xml'"),  # under two names it would be two documents
    ('open', {'file': 'pipe.xml'}, 'pipe'),
    ('start_job', {'job': 'prove', 'file': 'sub/../main.xml', 'version': 1}, "has the name 'main.xml'"),
    ('open', {'file': 'missing.xml'}, 'cannot be read'),
    ('open', {'file': 'more'}, 'more'),
    ('open', {'file': 'latin.xml'}, 'not UTF-8'),
    ('open', {'file': 3}, 'wrong arguments'),
    ('create', {'file': 'main.xml', 'text': ''}, 'exists already'),
    ('create', {'file': '../new.xml', 'text': ''}, 'not in the project'),
    ('create', {'file': 'new.txt', 'text': ''}, 'not edited here'),
    ('edit', {'file': 'main.xml', 'version': 1, 'edits': [[5, 2, 'x']]}, 'an edit is'),
    ('edit', {'file': 'main.xml', 'version': 1, 'edits': [[0, 9, ''], [3, 4, '']]}, 'overlaps'),
    ('edit', {'file': 'main.xml', 'version': 1, 'edits': 'x'}, 'an edit is'),
    ('gesture', {'file': 'main.xml', 'version': 1, 'name': 'mvoe', 'arguments': {}}, "did you mean 'move'"),
    ('gesture', {'file': 'main.xml', 'version': 1, 'name': 'move', 'arguments': {'node': 1}}, 'move'),
    ('gesture', {'file': 'main.xml', 'version': 1, 'name': 'remove', 'arguments': {'node': 'Main/9'}}, 'Main/9'),
    ('clip', {'file': 'main.xml', 'part': 'Main/9'}, 'Main/9'),
    ('start_job', {'job': 'dance', 'file': 'main.xml', 'version': 1}, 'dance'),
    ('start_job', {}, 'wrong arguments'),
]


def test_nonsense_is_refused_with_what_is_wrong_and_the_page_goes_on(folder: Path) -> None:
    (folder / 'link.xml').symlink_to('/etc/hostname')
    (folder / 'latin.xml').write_bytes(b'<root>\xe9</root>')
    os.mkfifo(folder / 'pipe.xml')  # who opens it waits for its other end

    async def story(page: Page) -> None:
        for method, arguments, message in NONSENSE:
            with pytest.raises(Refused) as refused:
                await page.ask(method, **arguments)
            assert message in refused.value.args[1], (method, refused.value)
            assert refused.value.args[0] != 'fault', (method, refused.value)
        for text in ('', '[', '[]', '{"id": 1}', '{"id": 1, "method": 5}', '[' * 100_000, 'null'):
            await page.socket.send_str(text)
        assert (await page.ask('open', file='main.xml'))['text'] == TREE
        assert (folder / 'main.xml').read_text() == TREE

    with_pages(folder, story)


def test_a_page_ends_with_its_user_also_if_it_asks_for_nothing(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp('users') / 'users.yaml'
    ann, ben = (User(name, Role.MAINTAINER, token_hash(token)) for name, token in (('ann', TOKEN), ('ben', 'another')))
    write_users(file, [ann, ben])

    async def story(page: Page) -> None:
        await page.ask('hello')
        write_users(file, [ben])
        while (message := await page.socket.receive()).type is aiohttp.WSMsgType.TEXT:
            pass
        assert (message.data, message.extra) == (aiohttp.WSCloseCode.POLICY_VIOLATION, 'the user was removed')

    with_pages(folder, story, access=Access('127.0.0.1', users=Users(file)))


def test_who_says_nothing_keeps_nobody_out(folder: Path) -> None:
    async def story(page: Page, session: aiohttp.ClientSession) -> None:
        silent = [await session.ws_connect('/session') for _ in range(GREETING_OF_SOURCE + 1)]
        assert (await silent[0].receive()).type in (aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.CLOSE)
        await page.ask('hello')

    with_pages(folder, story)


def test_only_the_page_with_the_token_is_answered_and_nothing_else_is_served(folder: Path) -> None:
    async def story(page: Page, session: aiohttp.ClientSession) -> None:
        stranger = await session.ws_connect('/session')
        await stranger.send_json({'hello': 'wrong'})
        assert (await stranger.receive()).type is aiohttp.WSMsgType.CLOSE
        for headers, status in (({'Origin': 'http://elsewhere.example'}, 403), ({'Host': 'elsewhere.example'}, 421)):
            async with session.get('/', headers=headers) as answer:
                assert answer.status == status
        for path in ('/main.xml', '/../setup.py', '/modules/../package.json', '/modules/@codemirror', '/studio.py'):
            async with session.get(path) as answer:
                assert answer.status == 404, path
        async with session.get('/') as answer:
            policy = answer.headers['Content-Security-Policy']
            assert answer.status == 200 and 'unsafe' not in policy and "default-src 'none'" in policy
            page_text = await answer.text()
        if editor_folder() is not None:
            found = json.loads(page_text.partition('<script type="importmap">')[2].partition('</script>')[0])
            for name, address in found['imports'].items():
                async with session.get(address) as answer:
                    assert answer.status == 200 and 'export' in await answer.text(), name
        await page.ask('hello')

    with_pages(folder, story)


MACHINE = """\
machine:
  outcomes: [finished]
  states:
    Wait:
      state: WaitState
      parameters: {wait_time: 1.0}
      transitions: {done: finishd}
"""


def test_without_a_home_the_editor_is_only_looked_for_where_python_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_account(number: int) -> NoReturn:
        raise KeyError(number)  # as for the number of a user that /etc/passwd does not have

    monkeypatch.delenv('HOME')
    monkeypatch.setattr(pwd, 'getpwuid', no_account)
    found = editor_folder()
    assert found is None or found.is_relative_to(sys.prefix)


def test_an_option_of_the_studio_that_is_misspelled_is_suggested(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, 'argv', ['studio', '--opearte'])
    with pytest.raises(SystemExit):
        studio()
    assert "did you mean '--operate'?" in capsys.readouterr().err


def test_an_editor_that_cannot_be_installed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'share').touch()
    monkeypatch.setattr(shutil, 'which', lambda _name: 'npm')
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    monkeypatch.setattr(sys, 'argv', ['studio', '--get-editor'])
    assert studio() == 2
    assert capsys.readouterr().err == f'studio: {tmp_path}/share/flexbt_studio: cannot be written: Not a directory\n'


def test_a_machine_is_checked_and_laid_out_in_processes_that_are_gone_at_the_end(folder: Path) -> None:
    (folder / 'ä round.yaml').write_text('# 😀\r\n' + MACHINE.replace('\n', '\r\n'), encoding='utf-8', newline='')

    async def story(page: Page) -> None:
        opened = await page.ask('open', file='ä round.yaml')
        found = await page.event('findings', version=1)
        (error,) = found['findings']
        assert error['path'] == '/Wait'
        start, end = error['span']
        assert opened['text'].encode('utf-16-le')[2 * start : 2 * end].decode('utf-16-le') == 'finishd'
        await page.ask('edit', file='ä round.yaml', version=1, edits=error['fixes'][0]['edits'])
        assert (await page.event('findings', version=2))['findings'] == []
        layout = await page.ask('layout', file='ä round.yaml', folded=[])
        left, top, width, height = layout['states']['/']
        inner = layout['states']['/Wait']
        assert left <= inner[0] and inner[0] + inner[2] <= left + width and inner[1] + inner[3] <= top + height
        assert {edge['outcome'] for edge in layout['edges']} == {'', 'done'}
        for arguments in ({}, {'file': 'ä round.yaml'}, {'file': 'missing.yaml', 'folded': []}):
            with pytest.raises(Refused):
                await page.ask('layout', **arguments)

    with_pages(folder, story)
    assert children() == []


TELL = """\
machine:
  outcomes: [done]
  input_keys: [at]
  states:
    Tell:
      state: LogKeyState
      transitions: {done: done}
      remapping: {data: at}
"""


def test_a_group_of_the_page_is_given_the_keys_of_its_states(folder: Path) -> None:
    async def story(page: Page) -> None:
        await page.ask('create', file='m.yaml', text=TELL)
        group: dict[str, Any] = {'file': 'm.yaml', 'version': 1, 'name': 'group'}
        arguments = {'states': ['/Tell'], 'label': 'Group'}
        edits = await page.ask('gesture', **group, arguments=arguments)
        assert any('input_keys: [at]' in new for _, _, new in edits)
        edits = await page.ask('gesture', **group, arguments={**arguments, 'keys': {}})
        assert not any('_keys' in new for _, _, new in edits)
        with pytest.raises(Refused, match='no states'):
            await page.ask('gesture', **group, arguments={'states': [1], 'label': 'Group'})

    with_pages(folder, story)


HANGING = """
import time

from flexbt_core import EventState


class HangingState(EventState):
    def __init__(self):
        super().__init__(outcomes=['done'])
        print('a line that is no answer')
        time.sleep(1000)
"""


def test_a_state_that_hangs_when_it_is_made_is_told_and_the_page_goes_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / 'hanging.py').write_text(HANGING)
    information = folder / 'hanging-1.dist-info'
    information.mkdir()
    (information / 'METADATA').write_text('Metadata-Version: 2.1\nName: hanging\nVersion: 1\n')
    (information / 'entry_points.txt').write_text('[flexbt.states]\nhanging = hanging\n')
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join([str(folder), os.environ['PYTHONPATH']]))
    monkeypatch.setattr('flexbt_studio.machine_checks.MACHINE_SECONDS', 2.0)
    (folder / 'round.yaml').write_text(MACHINE.replace('WaitState', 'HangingState').replace('wait_time: 1.0', ''))

    async def story(page: Page) -> None:
        await page.ask('open', file='round.yaml')
        assert 'hangs' in (await page.event('note', file='round.yaml'))['message']
        await page.ask('open', file='main.xml')
        await page.event('findings', file='main.xml')
        await page.ask('edit', file='round.yaml', version=1, edits=[[0, len(MACHINE) * 2, MACHINE]])
        assert (await page.event('findings', file='round.yaml'))['findings'][0]['path'] == '/Wait'

    with_pages(folder, story)
    assert children() == []


RENAMED = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <SetBlackboard value="1" output_key="speed"/>
      <SubTree ID="Other" rate="{speed}"/>
      <Script code="speed := 'speed'"/>
    </Sequence>
  </BehaviorTree>
</root>
"""


def test_a_name_is_renamed_in_all_files_or_in_none(folder: Path) -> None:
    (folder / 'main.xml').write_text(RENAMED)
    other = OTHER.replace('<AlwaysSuccess name="ä"/>', '<Script code="x := rate"/>')
    (folder / 'more' / 'other.xml').write_text(other)

    async def story(one: Page, two: Page) -> None:
        at = RENAMED.index('rate')
        assert await one.ask('name', file='main.xml', offset=at) == {
            'kind': 'key', 'name': 'rate', 'file': 'more/other.xml', 'owner': 'Other'
        }  # fmt: skip
        plan = await one.ask('rename', file='main.xml', offset=at, new='tempo')
        assert {file['file']: file['version'] for file in plan['files']} == {'main.xml': 1, 'more/other.xml': 1}
        uses = await one.ask('uses', file='main.xml', offset=RENAMED.index('speed'))
        assert [(use['file'], use['line']) for use in uses['uses']] == [('main.xml', line) for line in (4, 5, 6)]
        keys = {one['key']: one for one in await one.ask('flow', file='main.xml')}
        assert [(use['path'], use['role']) for use in keys['speed']['uses']] == [
            ('Main/0/0', 'writes'), ('Main/0/1', 'reads'), ('Main/0/2', 'writes')
        ]  # fmt: skip
        # Another page edits one of the files: the plan is for versions that are gone.
        await two.ask('open', file='more/other.xml')
        await two.ask('edit', file='more/other.xml', version=1, edits=[[0, 0, ' ']])
        for file in plan['files']:
            opened = await one.ask('open', file=file['file'])
            assert (opened['version'] == file['version']) is (file['file'] == 'main.xml')
        plan = await one.ask('rename', file='main.xml', offset=at, new='tempo')
        assert {file['file']: file['version'] for file in plan['files']} == {'main.xml': 1, 'more/other.xml': 2}
        # It is closed without a save, and then written by somebody else, while the user looks at the plan.
        for text in (other, f'\n{other}'):
            await two.ask('close', file='more/other.xml')
            (folder / 'more' / 'other.xml').write_text(text)
            opened = await one.ask('open', file='more/other.xml')
            assert opened['version'] not in [file['version'] for file in plan['files'] if file['file'] != 'main.xml']
            await one.ask('close', file='more/other.xml')
            plan = await one.ask('rename', file='main.xml', offset=at, new='tempo')
        assert {file['file']: file['version'] for file in plan['files']} == {'main.xml': 1, 'more/other.xml': 4}
        assert (await two.ask('open', file='more/other.xml'))['version'] == 4
        # Somebody else writes one of the files: nothing is renamed in any.
        (folder / 'more' / 'other.xml').write_text(other.replace('x :=', 'y :='))
        with pytest.raises(Refused, match=r'more/other\.xml was changed on disk') as refused:
            await one.ask('rename', file='main.xml', offset=at, new='tempo')
        assert refused.value.args[0] == 'conflict'
        assert (await one.ask('open', file='main.xml'))['text'] == RENAMED
        for offset, new in ((0, 'x'), (10**9, 'x'), (-5, 'x'), (at, ''), (at, 'x' * 5_000_000)):
            with pytest.raises(Refused):
                await one.ask('rename', file='main.xml', offset=offset, new=new)
        with pytest.raises(Refused):
            await one.ask('rename', file='../main.xml', offset=0, new='x')

    with_pages(folder, story, 2)
