# SPDX-License-Identifier: BSD-3-Clause
"""A plan is proposed and accepted in hunks, and a file is compared with an earlier version, in a real browser."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from studio_page import TOKEN, StudioPage, held, served

from flexbt_studio.server.web_server import editor_folder
from flexbt_testing.browser import NEEDS_BROWSER

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = NEEDS_BROWSER

SKILLS = """\
objects: {hall: place, office: place}
predicates:
  at: {parameters: {where: place}, exclusive: where}
  joined: {parameters: {from: place, to: place}}
skills:
  GoTo:
    parameters: {from: place, to: place}
    preconditions: ['joined(from, to)', at(from)]
    outcomes: {SUCCESS: [at(to)]}
    arguments: {to: $to}
"""
MISSION = 'skills: [skills.yaml]\nstart: [at(hall), "joined(hall, office)"]\ngoal: at(office)\n'
TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <Spin/>
      <Wait wait_duration="1.0"/>
      <BackUp/>
      <AlwaysSuccess/>
    </Sequence>
  </BehaviorTree>
</root>
"""
CHECKED = 'return [...document.querySelectorAll(".hunks input")].map((one) => one.checked)'
CHANGES = 'return [...document.querySelectorAll(".versions .list button")].map((one) => one.innerText)'
MARKS = """
const marked = [...document.querySelectorAll('.versions .change')];
return marked.map((one) => [one.dataset.path, one.getAttribute('aria-description'), getComputedStyle(one.querySelector('.box')).strokeDasharray !== 'none']);
"""  # noqa: E501


def command(page: StudioPage, words: str) -> None:
    """Choose a command of the list."""
    page.chord(Keys.CONTROL, 'k')
    page.until(lambda: page.focused == 'choice-field')
    page.press(words, Keys.ENTER)


async def text_elsewhere(port: int, file: str, before: str = '', after: str = '') -> str:
    """Return the text of a file as another page has it, and let that replace a part. The editor shows some lines."""
    async with aiohttp.ClientSession() as session, session.ws_connect(f'http://127.0.0.1:{port}/session') as socket:
        await socket.send_json({'hello': TOKEN})

        async def ask(number: int, method: str, **arguments: Any) -> Any:
            await socket.send_json({'id': number, 'method': method, 'arguments': arguments})
            while (answer := await socket.receive_json()).get('id') != number:
                pass
            return answer['result']

        opened = await ask(1, 'open', file=file)
        text: str = opened['text']
        if before:
            at = text.index(before)
            await ask(2, 'edit', file=file, version=opened['version'], edits=[[at, at + len(before), after]])
        return text


def test_a_plan_is_accepted_in_hunks_as_one_edit(page: StudioPage, tmp_path: Path) -> None:
    (tmp_path / 'skills.yaml').write_text(SKILLS)
    (tmp_path / 'mission.yaml').write_text(MISSION)
    tool = 'import sys; from flexbt_tools.executables import bt_tool; sys.exit(bt_tool())'
    words = [sys.executable, '-c', tool, 'plan', '--json', 'mission.yaml']
    planned = subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True)
    tree: str = json.loads(planned.stdout)['tree']
    first, last = '<!-- by hand, first -->', '<!-- by hand, last -->'
    lines = tree.splitlines()
    lines.insert(3, first)
    lines.insert(lines.index('  </BehaviorTree>') - 1, last)
    (tmp_path / 'main.xml').write_text('\n'.join(lines) + '\n')
    with served(tmp_path, editor_folder()) as port:
        page.open(port, 'main.xml')
        command(page, 'tree or machine for a goal')
        page.until(lambda: page.focused == 'goal-source')
        assert page.run('return document.getElementById("goal-text").value') == 'at(office)'
        # What cannot be reached has a reason, and changes nothing.
        page.tab_to('goal-text')
        page.press('x', Keys.ENTER)
        page.until(lambda: "there is no predicate 'x'" in page.text('goal-told'))
        # What can be is proposed: both comments would go. The first stays, and what another page has edited meanwhile.
        page.press(Keys.BACKSPACE, 'at(office)', Keys.ENTER)
        page.until_sheet('A tree for the goal')
        page.until(lambda: page.run(CHECKED) == [True, True])
        asyncio.run(text_elsewhere(port, 'main.xml', first, f'{first}<!-- and another -->'))
        page.until(lambda: 'edited in another page' in page.told)
        page.run('document.querySelector(".hunks input").focus()')
        page.press(Keys.ARROW_DOWN, Keys.ARROW_UP, ' ', Keys.ARROW_DOWN)
        assert page.run(CHECKED) == [False, True]
        page.run('document.querySelector("#sheet-buttons .primary").focus()')
        page.press(Keys.ENTER)
        page.until_told('1 of 1 hunks accepted')
        assert page.focused == page.selected

        def now() -> str:
            return asyncio.run(text_elsewhere(port, 'main.xml'))

        text = now()
        assert first in text and 'another' in text and last not in text
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: last in now())
        assert 'another' in now()
        # Once more: the lines of the first hunk are others in the meantime, so it is refused.
        page.run('document.getElementById("goal-show").click()')
        page.until_sheet('A tree for the goal')
        page.until(lambda: page.run(CHECKED) == [True, True])
        asyncio.run(text_elsewhere(port, 'main.xml', first, '<!-- better -->'))
        page.until(lambda: 'edited in another page' in page.told)
        page.run('document.querySelector("#sheet-buttons .primary").click()')
        page.until_told('1 refused: their lines have changed since')
        text = now()
        assert 'better' in text and last not in text


def test_what_is_written_until_a_proposal_comes_stays(
    page: StudioPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'main.xml').write_text(TREE)
    with served(tmp_path, None) as port:
        page.open(port, 'main.xml')
        with held(monkeypatch, 'models', is_done=True) as asked:
            command(page, 'export models of node types')
            page.until_text('choice-title', 'Export')
            page.press(Keys.ENTER)
            assert asked.wait(60.0)
            page.write()
            page.run('document.activeElement.setSelectionRange(0, 0)')
            page.press('<!-- late -->')
            page.until(lambda: asyncio.run(text_elsewhere(port, 'main.xml')).startswith('<!-- late -->'))
        page.until_sheet('Models of its node types')
        assert 'late' not in page.text('sheet')
        page.run('document.querySelector("#sheet-buttons .primary").click()')
        page.until_told('1 of 1 hunks accepted')
        text = asyncio.run(text_elsewhere(port, 'main.xml'))
        assert text.startswith('<!-- late --><root') and 'TreeNodesModel' in text


def test_a_file_is_compared_with_a_version_of_git(page: StudioPage, tmp_path: Path) -> None:
    (tmp_path / 'main.xml').write_text(TREE)
    with served(tmp_path, editor_folder()) as port:
        page.open(port, 'main.xml')
        page.press(Keys.ARROW_DOWN, Keys.ARROW_DOWN)
        page.chord(Keys.ALT, Keys.F9)
        page.until(lambda: 'no git repository' in page.text('choice-note'))
        page.press(Keys.ENTER)
        page.until_sheet('Both texts are the same')
        page.press(Keys.ESCAPE)
        author = ['-c', 'user.name=A', '-c', 'user.email=a@example.org', '-c', 'commit.gpgSign=false']
        for words in (['init', '-q'], ['add', '.'], [*author, 'commit', '-q', '-m', 'The first']):
            subprocess.run(['git', *words], cwd=tmp_path, check=True)
        # Move Spin to the end, rename it, and remove Wait.
        page.until_selected('Main/0/0')
        for place in ('Main/0/1', 'Main/0/2', 'Main/0/3'):
            page.chord(Keys.ALT, Keys.ARROW_DOWN)
            page.until_selected(place)
        page.press(Keys.F2)
        page.until(lambda: page.focused == 'choice-field')
        page.press('Turn', Keys.ENTER)
        page.until_told('renamed to Turn')
        page.press(Keys.HOME, Keys.DELETE)
        page.until_told('Wait removed')
        page.chord(Keys.ALT, Keys.F9)
        page.until(lambda: page.focused == 'choice-field')
        page.press('The first', Keys.ENTER)
        page.until_sheet('1 removed, 1 changed, 1 moved')
        assert [one.splitlines() for one in page.run(CHANGES)] == [
            ['− removed: Wait'],
            ['↷ moved, ≠ changed: Turn', 'within Sequence', 'name: none → Turn'],
        ]
        assert page.run(MARKS) == [['-Main/0/1', '− removed', True], ['Main/0/2', '↷ moved, ≠ changed', True]]
        page.press(Keys.F8, Keys.F8)
        page.until(lambda: '2 of 2' in page.text('sheet'))
        selected = 'return document.querySelector(".versions [aria-selected=true]").dataset.path'
        assert page.run(selected) == 'Main/0/2'
        page.chord(Keys.SHIFT, Keys.F8)
        page.until(lambda: page.run(selected) == '-Main/0/1')
        page.press(Keys.ESCAPE)
        page.until(lambda: not page.run('return document.getElementById("sheet").open'))
        assert page.has_changes()
