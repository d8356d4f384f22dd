# SPDX-License-Identifier: BSD-3-Clause
"""The studio in a real browser: what a mission engineer does with keys, and that nothing is lost."""

from __future__ import annotations

import asyncio
import difflib
import threading
from pathlib import Path
from typing import Any

import pytest
from studio_page import TOKEN, StudioPage, held, served

from flexbt_studio.server import session
from flexbt_studio.server.session import Page, Sessions
from flexbt_studio.server.web_server import editor_folder
from flexbt_testing.browser import NEEDS_BROWSER
from flexbt_testing.waiting import DEADLINE

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = NEEDS_BROWSER

TREE = """\
<root BTCPP_format="4" main_tree_to_execute="Main">
  <!-- Drive, or wait: 🙂 -->
  <BehaviorTree ID="Main">
    <Fallback name="Drive">
      <Sequence>
        <ComputePathToPose goal="{goal}" path="{path}"/>
        <FollowPath path="{path}"/>
      </Sequence>
      <Wait wait_duration="1.0"/>   <!-- a while -->
      <SubTree ID="Recover" path="{path}"/>
    </Fallback>
  </BehaviorTree>
</root>
"""
RECOVER = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Recover">
    <Sequence _collapsed="true">
      <BackUp backup_dist="0.3"/>
      <FollowPath path="{path}"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
MACHINE = """\
# A machine.
machine:
  outcomes: [finished, failed]
  states:
    Ask:
      state: OperatorInputState
      parameters: {prompt: Where to?, type: geometry_msgs/PoseStamped}
      transitions: {received: Rest, declined: finished, failed: failed}
    Rest:
      state: WaitState   # a while
      parameters: {wait_time: 2.0}
      transitions: {done: Ask}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    project = tmp_path / 'mission'
    (project / 'more').mkdir(parents=True)
    (project / 'main.xml').write_text(TREE)
    (project / 'more' / 'recover.xml').write_text(RECOVER)
    (project / 'machine.yaml').write_text(MACHINE)
    return project


TEXTS = """
const pane = document.getElementById('graph-body').getBoundingClientRect(), wrong = [], shown = [];
for (const one of document.querySelectorAll('#picture .node')) {
  const box = one.querySelector('.box').getBoundingClientRect();
  const text = getComputedStyle(one.querySelector('.type')).display !== 'none';
  const isIn = box.right > pane.left && box.left < pane.right && box.bottom > pane.top && box.top < pane.bottom;
  if (text) shown.push(one.dataset.path); else if (isIn) wrong.push(one.dataset.path);
}
return [wrong, shown];
"""
PANE = 'return document.activeElement.closest(".panel").id'


def changed_lines(before: str, after: str) -> list[str]:
    """Return the lines of a difference."""
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in '+-']


def test_a_tree_is_written_with_keys_alone(page: StudioPage, folder: Path, editor: Path | None) -> None:
    with served(folder, editor) as port:
        page.open(port, 'main.xml')
        assert page.selected == 'Main'
        # Go around: next, previous, parent, child, ends of the siblings, letters.
        page.press(Keys.ARROW_DOWN)
        assert page.focused == 'Main/0'
        page.press(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
        assert page.focused == 'Main/0/0/0'
        page.press(Keys.ARROW_LEFT, Keys.END)
        assert page.focused == 'Main/0/2'
        page.press(Keys.HOME)
        assert page.focused == 'Main/0/0'
        page.press('f')
        assert page.focused == 'Main/0/0/1'
        # Fold and unfold.
        page.press(Keys.ARROW_LEFT, ' ')
        page.until_told('Sequence folded')
        assert page.run('return document.activeElement.getAttribute("aria-expanded")') == 'false'
        page.press(Keys.ARROW_DOWN)
        assert page.focused == 'Main/0/1'
        page.press(Keys.ARROW_UP, Keys.ARROW_RIGHT)
        page.until_told('Sequence unfolded')
        page.press(Keys.ARROW_RIGHT)
        page.until_selected('Main/0/0/0')
        # Add a node, and fill in its form, with a key that is completed.
        page.press(Keys.ARROW_DOWN, 'a')
        page.until(lambda: page.focused == 'choice-field')
        page.press('goalreach', Keys.ENTER)
        page.until_selected('Main/0/0/2')
        page.press(Keys.ENTER)
        page.until(lambda: page.focused.startswith('field-'))
        page.until(lambda: page.run('return document.getElementById("field-goal") !== null'))
        page.tab_to('field-goal')
        page.chord(Keys.CONTROL, ' ')
        page.until(lambda: page.focused == 'choice-field')
        page.press('goal', Keys.ENTER)
        page.until_told('changed')
        page.until(lambda: page.focused == 'field-goal')
        assert page.run('return document.activeElement.value') == '{goal}'
        page.press(Keys.ESCAPE)
        page.until_selected('Main/0/0/2')
        page.press('A')
        page.until(lambda: page.focused == 'choice-field')
        page.press(Keys.ESCAPE)
        page.until_selected('Main/0/0/2')
        # Move it among its siblings, out of its parent, and into the sibling before it.
        page.chord(Keys.ALT, Keys.ARROW_UP)
        page.until_told('2 of 3 in Sequence')
        page.until_selected('Main/0/0/1')
        page.chord(Keys.ALT, Keys.ARROW_DOWN)
        page.until_selected('Main/0/0/2')
        page.chord(Keys.ALT, Keys.ARROW_LEFT)
        page.until_selected('Main/0/1')
        page.chord(Keys.ALT, Keys.ARROW_RIGHT)
        page.until_selected('Main/0/0/2')
        # Wrap, unwrap, copy, paste, cut, remove.
        page.press('w')
        page.until(lambda: page.focused == 'choice-field')
        page.press('Inverter', Keys.ENTER)
        page.until_told('wrapped in Inverter')
        page.until_selected('Main/0/0/2')
        page.press('u')
        page.until_told('its children took its place')
        page.until_selected('Main/0/0/2')
        page.press('c')
        page.until_told('copied')
        page.press('v')
        page.until_selected('Main/0/0/3')
        page.press('x')
        page.until_told('removed')
        page.until_selected('Main/0/0/2')
        page.press(Keys.DELETE)
        page.until_selected('Main/0/0/1')
        # Rename.
        page.press(Keys.F2)
        page.until(lambda: page.focused == 'choice-field')
        page.press('Drive there', Keys.ENTER)
        page.until_told('renamed to Drive there')
        # Go to the definition of a sub-tree, in another file, and back.
        page.press('/')
        page.until(lambda: page.focused == 'choice-field')
        page.press('recover', Keys.ENTER)
        page.until_selected('Main/0/2')
        page.press(Keys.F12)
        page.until_selected('Recover')
        assert 'more%2Frecover.xml' in page.driver.current_url
        page.press(Keys.ARROW_DOWN)
        assert page.run('return document.activeElement.getAttribute("aria-expanded")') == 'false'  # by _collapsed
        page.chord(Keys.ALT, Keys.ARROW_LEFT)
        page.until_selected('Main/0/2')
        # A problem: go to it, and fix it.
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        page.press(*[Keys.ARROW_UP] * 5, Keys.END, *[Keys.ARROW_LEFT] * len('="1.0"/>   <!-- a while -->'), 's')
        page.until(lambda: page.invalid == ['Main/0/1'])
        page.press(Keys.F8)
        page.until_told('Problem 1 of 1')
        page.until_selected('Main/0/1')
        page.chord(Keys.ALT, Keys.ENTER)
        page.until(lambda: page.invalid == [])
        # Take all of it back, and do it again.
        assert page.has_changes()
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: page.invalid == ['Main/0/1'])
        page.chord(Keys.CONTROL, 'y')
        page.until(lambda: page.invalid == [])
        # Panes, commands, keys.
        seen = [page.run(PANE)]
        while len(seen) < 2 or seen[-1] != 'graph-pane':
            assert len(seen) < 20, seen
            page.press(Keys.F6)
            seen.append(page.run(PANE))
        assert {'text-pane', 'form-pane', 'files-pane', 'palette-pane'} <= set(seen)
        page.press('?')
        page.until_sheet('Wrap in a control or decorator')
        page.press(Keys.ESCAPE)
        page.chord(Keys.CONTROL, 'k')
        page.until(lambda: page.focused == 'choice-field')
        page.press('what save', Keys.ENTER)
        page.until_sheet('Drive there')
        page.press(Keys.ESCAPE)
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert changed_lines(TREE, (folder / 'main.xml').read_text()) == [
            '-         <FollowPath path="{path}"/>',
            '+         <FollowPath path="{path}" name="Drive there"/>',
        ]


def test_what_is_taken_back_leaves_every_byte(page: StudioPage, folder: Path, editor: Path | None) -> None:
    text = TREE.replace('  ', '\t').replace('\n', '\r\n')
    (folder / 'main.xml').write_bytes(text.encode())
    with served(folder, editor) as port:
        page.open(port, 'main.xml')
        for path in ('Main/0/0', 'Main/0/1'):
            page.click(path)
        page.chord(Keys.ALT, Keys.ARROW_UP)
        page.until_told('1 of 3 in Drive')
        page.press('w')
        page.until(lambda: page.focused == 'choice-field')
        page.press('Inverter', Keys.ENTER)
        page.until_told('wrapped')
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        page.press('<!-- ü -->')
        page.until(page.has_changes)
        for _ in range(100):
            if not page.has_changes():
                break
            page.chord(Keys.CONTROL, 'z')
        assert not page.has_changes()
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert (folder / 'main.xml').read_bytes() == text.encode()


def test_two_pages_lose_nothing_of_each_other(
    page: StudioPage, other: StudioPage, folder: Path, editor: Path | None
) -> None:
    with served(folder, editor) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        page.until_text('pages', '2 pages open')
        for one, key in ((page, Keys.HOME), (other, Keys.END)):
            one.write()
            one.chord(Keys.CONTROL, key)
        for letter in '<!-- one -->':
            page.press(letter)
            other.press(letter if letter != 'n' else 'w')
        whole = f'<!-- one -->{TREE}<!-- owe -->'
        page.until(lambda: page.shown_text == other.shown_text == whole)
        # Each takes back only its own.
        while other.shown_text != f'<!-- one -->{TREE}':
            other.chord(Keys.CONTROL, 'z')
        page.until(lambda: page.shown_text == f'<!-- one -->{TREE}')
        # A program changes the file: nothing is overwritten until one has seen that.
        (folder / 'main.xml').write_text(TREE.replace('1.0', '7.0'))
        page.chord(Keys.CONTROL, 's')
        page.until_sheet('changed on disk')
        page.press(Keys.ESCAPE)
        page.until(lambda: not page.run('return document.getElementById("sheet").open'))
        assert (folder / 'main.xml').read_text() == TREE.replace('1.0', '7.0')
        page.chord(Keys.CONTROL, 's')
        page.until_sheet('changed on disk')
        other.chord(Keys.CONTROL, Keys.END)
        other.press('<!-- meanwhile -->')
        page.until(lambda: page.shown_text == f'<!-- one -->{TREE}<!-- meanwhile -->')
        page.press(Keys.ENTER)
        page.until_told('main.xml saved')
        assert (folder / 'main.xml').read_text() == f'<!-- one -->{TREE}<!-- meanwhile -->'
        other.until(lambda: not other.has_changes())


def test_a_server_that_is_started_again_gets_back_what_was_not_saved(
    page: StudioPage, other: StudioPage, folder: Path
) -> None:
    with served(folder, None) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        page.press('<!--before-->')
        other.until(lambda: other.shown_text == f'{TREE}<!--before-->')
    page.until_text('link', 'NO SERVER')
    page.press('<!--without-->')
    page.run('document.querySelector("[aria-label=\'Close main.xml\']").click()')  # the studio has not got it
    page.until_told('close it when it is connected again')
    with served(folder, None, port):
        page.until_text('link', 'CONNECTED')
        whole = f'{TREE}<!--before--><!--without-->'
        page.until(lambda: page.shown_text == other.shown_text == whole)
        page.press('!')
        other.until(lambda: other.shown_text == f'{whole}!')
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
    assert (folder / 'main.xml').read_text() == f'{whole}!'


def test_a_value_that_was_refused_is_entered_again(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.click('Main/0/1')
    page.until_text('link', 'NO SERVER')
    page.write()
    page.chord(Keys.CONTROL, Keys.HOME)
    page.press('<!-- before it -->')
    page.run('document.getElementById("field-wait_duration").focus()')
    page.press(Keys.END, '7', Keys.ENTER)
    page.until_told('not connected to the studio')
    with served(folder, None, port):
        page.until_text('link', 'CONNECTED')
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert '1.07' not in page.shown_text
        page.press(Keys.ENTER)
        page.until(lambda: page.shown_text == f'<!-- before it -->{TREE}'.replace('1.0', '1.07'))


def test_what_was_not_saved_outlives_a_new_server_whose_connection_is_lost_at_once(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answered, greeted, typed = Sessions._result, [], threading.Event()

    async def cut(self: Sessions, asking: Page, method: str, arguments: dict[str, Any]) -> Any:
        if method == 'hello':
            greeted.append(asking)
            if len(greeted) == 1:
                await asking.socket.close()
            else:
                await asyncio.to_thread(typed.wait, DEADLINE)
        return await answered(self, asking, method, arguments)

    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.click('Main/0/1')
        page.press(Keys.DELETE)
        page.until_told('Wait removed')
        page.chord(Keys.ALT, 'n')
        for answer in ('Tree', 'made.xml'):
            page.until(lambda: page.focused == 'choice-field')
            page.press(answer, Keys.ENTER)
        page.until(lambda: 'ID="Made"' in page.shown_text)
        made = f'{page.shown_text}<!--without--><!--meanwhile-->'
    page.until_text('link', 'NO SERVER')
    page.write()
    page.chord(Keys.CONTROL, Keys.END)
    page.press('<!--without-->')
    monkeypatch.setattr(Sessions, '_result', cut)
    with served(folder, None, port):
        page.until(lambda: len(greeted) == 2)
        page.press('<!--meanwhile-->')
        typed.set()
        page.chord(Keys.CONTROL, 's')
        page.until_told('made.xml saved')
        page.run('document.querySelector("#tabs [title=\'main.xml\']").click()')
        page.until(lambda: 'ID="Main"' in page.shown_text)
        assert 'Wait' not in page.shown_text
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
    assert (folder / 'made.xml').read_text() == made and 'Wait' not in (folder / 'main.xml').read_text()


@pytest.mark.parametrize('is_before', [True, False])
def test_a_save_and_an_edit_of_another_page_at_the_same_time(
    page: StudioPage, other: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch, is_before: bool
) -> None:
    """The edit comes just before the save is done, or just after, before the other page is told."""
    answered, asked, edited = Sessions._result, threading.Event(), threading.Event()

    async def slow(self: Sessions, asking: Page, method: str, arguments: dict[str, Any]) -> Any:
        if method == 'save' and is_before:
            asked.set()
            await asyncio.to_thread(edited.wait, DEADLINE)
        result = await answered(self, asking, method, arguments)
        if method == 'edit':
            edited.set()
        elif method == 'save':
            asked.set()
            await asyncio.to_thread(edited.wait, DEADLINE)
        return result

    with served(folder, None) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        page.press('a')
        other.until(lambda: other.shown_text == f'{TREE}a')
        monkeypatch.setattr(Sessions, '_result', slow)
        page.chord(Keys.CONTROL, 's')
        assert asked.wait(DEADLINE)
        other.write()
        other.chord(Keys.CONTROL, Keys.END)
        other.press('x')
        page.until(lambda: (folder / 'main.xml').read_text() == f'{TREE}a{"x" * is_before}')
        other.until_told('saved in another page')
        other.chord(Keys.CONTROL, Keys.SHIFT, 'S')
        other.until_sheet('as it is on disk' if is_before else '+ ax')
        assert other.has_changes() is not is_before


def test_what_was_begun_at_a_node_is_for_that_node_wherever_it_is_then(
    page: StudioPage, other: StudioPage, folder: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    field = 'const field = document.getElementById("field-wait_duration");'

    def insert() -> None:
        """Add a node before it, in the other page."""
        count = page.shown_text.count('AlwaysSuccess')
        other.press('<AlwaysSuccess/>')
        page.until(lambda: page.shown_text.count('AlwaysSuccess') == count + 1)
        page.until(lambda: page.selected == f'Main/0/{count + 2}')

    with served(folder, None) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        other.write()
        other.chord(Keys.CONTROL, Keys.HOME)
        other.press(*[Keys.ARROW_DOWN] * 3, Keys.END)
        page.click('Main/0/1')
        page.run(f'{field} field.focus()')
        page.press(Keys.END, '7')
        insert()
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert page.run(f'{field} return [field.value, document.activeElement === field]') == ['1.07', True]
        assert '1.07' not in page.shown_text  # it is not entered yet
        page.press(Keys.ENTER)
        page.until(lambda: '<Wait wait_duration="1.07"/>' in page.shown_text)
        page.click('Main/0/2')
        page.press('w')
        page.until(lambda: page.focused == 'choice-field')
        insert()
        page.press('Inverter', Keys.ENTER)
        page.until_told('Wait wrapped in Inverter')
        assert page.shown_text.split('<Inverter>')[1].lstrip().startswith('<Wait')
        page.until_selected('Main/0/3')
        box = page.driver.find_element('css selector', '#picture [data-path="Main/0/3"] > .box')
        ActionChains(page.driver).click_and_hold(box).move_by_offset(-40, 0).perform()
        assert page.run('return document.querySelectorAll(".dragged").length') == 1
        insert()
        text = page.shown_text
        page.until(lambda: page.run('return document.querySelectorAll(".dragged").length') == 0)
        ActionChains(page.driver).release().perform()
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert page.shown_text == text


@pytest.mark.parametrize('name', ['', 'name="Nap" '])
def test_what_was_typed_for_a_node_that_another_page_removes_is_for_no_other(
    page: StudioPage, other: StudioPage, folder: Path, name: str
) -> None:
    (folder / 'main.xml').write_text(TREE.replace('<Wait ', f'<Wait {name}'))
    with served(folder, None) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        page.click('Main/0/1')
        page.run('document.getElementById("field-name").focus()')
        page.press('Rest')
        other.click('Main/0/1')
        other.press(Keys.DELETE)
        page.until(lambda: '<Wait' not in page.shown_text)
        page.until(lambda: page.run('return document.getElementById("field-wait_duration")') is None)
        page.click('Main/0/1')
        page.chord(Keys.ALT, Keys.ARROW_UP)  # what was begun before is done by then
        page.until_told('Recover: 1 of 2')
        assert 'Rest' not in page.shown_text


def test_a_requirement_that_is_typed_while_another_file_is_shown_is_of_its_own_file(
    page: StudioPage, folder: Path
) -> None:
    requirements = 'return document.getElementById("requirements").value'
    with served(folder, None) as port:
        page.open(port, 'machine.yaml')
        page.go('main.xml')
        page.until_selected('Main')
        page.run('document.getElementById("prove-job").open = true; document.getElementById("requirements").focus()')
        page.press('never A')
        page.tab('machine.yaml')
        page.until_selected('/')
        assert page.run(requirements) == ''
        page.tab('main.xml')
        page.until_selected('Main')
        assert page.run(requirements) == 'never A'


def test_what_save_writes_is_shown_of_the_file_that_it_was_asked_for_and_saved_there(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(folder, None) as port:
        page.open(port, 'more/recover.xml')
        page.go('main.xml')
        page.until_selected('Main')
        for file in ('more/recover.xml', 'main.xml'):
            page.tab(file)
            page.write()
            page.press('<!-- here -->')
            page.until(page.has_changes)
        with held(monkeypatch, 'difference') as asked:
            page.chord(Keys.CONTROL, Keys.SHIFT, 's')
            assert asked.wait(DEADLINE)
            page.tab('more/recover.xml')
        page.until_sheet('main.xml: what Save writes')
        page.press(Keys.ENTER)
        page.until_told('main.xml saved')
    assert '<!-- here -->' in (folder / 'main.xml').read_text()
    assert (folder / 'more' / 'recover.xml').read_text() == RECOVER


@pytest.mark.parametrize(('field', 'text'), [('wait_duration', 'wait_duration="1.07"'), ('name', 'name="Nap7"')])
def test_what_was_typed_while_another_file_is_opened_is_for_its_own_file(
    page: StudioPage, folder: Path, field: str, text: str
) -> None:
    (folder / 'main.xml').write_text(TREE.replace('<Wait ', '<Wait name="Nap" '))
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.click('Main/0/1')
        page.run(f'document.getElementById("field-{field}").focus()')
        page.press(Keys.END, '7')
        page.go('more/recover.xml')
        page.until(lambda: page.focused.startswith('Recover'))
        page.go('main.xml')
        page.until(lambda: text in page.shown_text)


def test_what_is_asked_for_a_node_is_for_it_also_when_it_moves_or_another_one_is_selected_meanwhile(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def places(*words: str) -> list[int]:
        return [page.shown_text.find(word) for word in words]

    with served(folder, None) as port:
        page.open(port, 'main.xml')
        with held(monkeypatch, 'gesture') as asked:
            page.click('Main/0/1')
            page.chord(Keys.ALT, Keys.ARROW_UP)
            assert asked.wait(DEADLINE)
            page.click('Main/0/2')
            page.chord(Keys.ALT, Keys.ARROW_UP)
        page.until_told('Recover: 2 of 3')
        page.until_selected('Main/0/1')
        order = places('<Wait', '<SubTree', '<FollowPath')
        assert -1 not in order and order == sorted(order)
        with held(monkeypatch, 'gesture') as asked:
            page.chord(Keys.ALT, Keys.ARROW_UP)
            assert asked.wait(DEADLINE)
            page.press(Keys.DELETE)
        page.until_told('Recover removed')
        assert '<SubTree' not in page.shown_text and '<Wait' in page.shown_text
        page.click('Main/0/0')
        with held(monkeypatch, 'clip') as asked:
            page.press('x')
            assert asked.wait(DEADLINE)
            page.click('Main/0/1/1')
        page.until_told('Wait removed')
        assert '<Wait' not in page.shown_text and '<FollowPath' in page.shown_text


def test_what_is_pasted_goes_to_its_file_also_when_another_one_is_shown_by_then(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / 'other.xml').write_text(TREE.replace('Drive', 'Other'))
    with served(folder, None) as port:
        page.open(port, 'other.xml', '&node=Main/0/0/0')
        page.until_selected('Main/0/0/0')
        page.go('main.xml')
        page.until(lambda: 'name="Drive"' in page.shown_text)
        page.click('Main/0/1')
        page.press('c')
        page.until_told('Wait copied')
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        with held(monkeypatch, 'edit') as asked:
            page.press('x')
            assert asked.wait(DEADLINE)
            page.run('document.querySelector(`#picture [data-path="Main/0/1"]`).focus()')
            page.press('v')
            page.tab('other.xml')
        page.until_told('clipboard added')
        assert not page.has_changes()
        page.tab('main.xml')
        once = '      <Wait wait_duration="1.0"/>   <!-- a while -->\n'
        page.until(lambda: 2 * once in page.shown_text)


@pytest.mark.parametrize('is_value', [True, False])
def test_what_is_chosen_for_a_node_that_another_page_removes_is_for_no_other(
    page: StudioPage, other: StudioPage, folder: Path, is_value: bool
) -> None:
    with served(folder, None) as port:
        for one in (page, other):
            one.open(port, 'main.xml')
        page.click('Main/0/0/1')
        if is_value:
            page.run('document.getElementById("field-name").focus()')
            page.chord(Keys.CONTROL, ' ')
        else:
            page.press('a')
        page.until(lambda: page.focused == 'choice-field')
        other.click('Main/0/0/1')
        other.press(Keys.DELETE)
        page.until(lambda: '<FollowPath' not in page.shown_text and page.selected != 'Main/0/0/1')
        text = page.shown_text
        page.press('AlwaysSuccess', Keys.ENTER)
        page.until_told('FollowPath has gone since; nothing was changed')
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        assert page.shown_text == text


def test_without_a_file_or_a_machine_nothing_is_written_or_added(page: StudioPage, folder: Path) -> None:
    (folder / 'empty.yaml').write_text('# nothing\n')
    with served(folder, None) as port:
        page.driver.get('about:blank')
        page.driver.get(f'http://127.0.0.1:{port}/#token={TOKEN}')
        page.until_text('link', 'CONNECTED')
        page.write()
        page.press('abc')
        assert page.shown_text == ''
        page.chord(Keys.CONTROL, 'k')
        page.press('All uses', Keys.ENTER)
        page.until_told('Open a file first')
        page.go('main.xml')
        page.until_selected('Main')
        page.run('document.querySelector("#files-filter").focus()')
        (folder / 'machine.yaml').write_text('# nothing\n')
        page.go('machine.yaml')
        page.until(lambda: page.shown_text == '# nothing\n')
        page.chord(Keys.CONTROL, 'k')
        page.press('Add after', Keys.ENTER)
        page.until_told('The file has no tree or machine')
        page.chord(Keys.ALT, Keys.F9)
        page.until(lambda: page.focused == 'choice-field')
        page.press(Keys.ENTER)
        page.until_sheet('No picture: the text is not a mapping')


def test_keys_are_for_the_file_that_is_seen(page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.go('machine.yaml')
        page.until_selected('/')
        page.click('/Rest')
        page.tab('main.xml')
        page.until_selected('Main')
        with held(monkeypatch, 'layout') as asked:
            page.tab('machine.yaml')
            assert asked.wait(DEADLINE)
            page.press(Keys.DELETE)
            assert page.run('return document.querySelectorAll("#picture [data-path], dialog[open]").length') == 0
        page.until_selected('/Rest')
        page.tab('main.xml')
        page.until_selected('Main')
        page.write()
        page.tab('machine.yaml')
        page.until_selected('/Rest')  # it has the focus, wherever that was before


def test_a_file_that_is_asked_for_twice_is_opened_once(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(folder, None) as port:
        page.open(port, 'machine.yaml')
        with held(monkeypatch, 'open', is_done=True, passing=1) as asked:
            page.go('main.xml', times=2)
            assert asked.wait(DEADLINE)
            page.until(lambda: page.shown_text == TREE)
            page.write()
            page.chord(Keys.CONTROL, Keys.END)
            page.press('x')
            page.until(page.has_changes)
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        page.write()
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: page.shown_text == TREE)


def test_a_file_that_comes_late_takes_the_place_of_no_other(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.go('machine.yaml')
        page.until_selected('/')
        with held(monkeypatch, 'open') as asked:
            page.go('more/recover.xml')
            assert asked.wait(DEADLINE)
            page.tab('main.xml')
            page.until_selected('Main')
            page.write()
        page.until_told('more/recover.xml is open now; another file was shown')
        page.press('x')  # in the text, and in no other place
        page.until(page.has_changes)
        assert 'file=main.xml' in page.driver.current_url and len(page.shown_text) == len(TREE) + 1


def test_a_double_click_answers_one_question(page: StudioPage, folder: Path) -> None:
    chains = pytest.importorskip('selenium.webdriver.common.action_chains')
    with served(folder, None) as port:
        page.open(port, 'machine.yaml')
        page.click('/Rest')
        buttons = '[...document.querySelectorAll("#form button")]'
        page.run(f'{buttons}.find((one) => one.textContent === "Add a Transition…").click()')
        page.until(lambda: page.focused == 'choice-field')
        page.press('late')
        row = page.driver.find_element('css selector', '#choice-list li')
        chains.ActionChains(page.driver).double_click(row).perform()
        page.until_told('A double click presses once')
        assert page.text('choice-title') == 'Rest: target of late' and page.focused == 'choice-field'
        held = '{key: "Enter", repeat: true, bubbles: true}'
        page.run(f'document.activeElement.dispatchEvent(new KeyboardEvent("keydown", {held}))')
        assert page.run('return document.getElementById("choice").open')
        page.press('Ask', Keys.ENTER)
        page.until_told('late leads to Ask')


def test_a_button_of_a_list_keeps_the_focus_when_the_list_changes(page: StudioPage, folder: Path) -> None:
    (folder / 'main.xml').write_text(TREE.replace('wait_duration', 'wait_durations'))
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.until_text('problems', 'wait_durations')
        page.click('Main/0/1')
        for selector in ('#files li:last-child button', '#tabs .tab button', '#problems .fix', '#form button'):
            page.run('document.querySelector(arguments[0]).focus(); window.before = document.activeElement', selector)
            seen = page.run('return window.before.textContent')
            if selector.startswith('#files'):
                (folder / 'added.xml').write_text(TREE)
            else:
                page.run(
                    'const field = document.querySelector("#text textarea"), [from, to] = arguments;'
                    'field.value = field.value.replace(from, to); field.dispatchEvent(new Event("input"))',
                    *(('_durations', '_duration') if selector == '#form button' else ('\n</root>', '\n\n</root>')),
                )
            page.until(lambda: not page.run('return window.before.isConnected'))
            text = page.run('return document.activeElement.textContent')
            assert text.removeprefix('● ') == seen.removeprefix('● '), selector


def test_what_is_too_long_for_the_server_is_taken_back_and_told(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        for length, told in ((9_000_000, 'main.xml: the studio takes at most 8 MB'), (5_000_000, 'split it')):
            page.run(
                'const field = document.querySelector("#text textarea"); field.value += "x".repeat(arguments[0]);'
                'field.dispatchEvent(new Event("input"))',
                length,
            )
            page.until_told(told)
            assert page.shown_text == TREE and page.text('link') == 'CONNECTED'


def test_a_server_that_is_silent_is_taken_for_lost(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page hears of its server also when nothing happens."""
    monkeypatch.setattr(session, 'ALIVE_SECONDS', 0.2)
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        states = page.run("""
            const {SessionLink} = await import('./session_link.js'), states = [];
            const state = (isOpen, text) => states.push(text || isOpen);
            const link = new SessionLink({event() {}, state});
            link.silent = 2000;
            const wait = async (done) => { while (!done()) await new Promise((go) => setTimeout(go, 50)); };
            await wait(() => states.length);
            const begun = performance.now();
            await wait(() => performance.now() - begun > 3000);
            states.push('nothing has happened');
            link.socket.onmessage = () => {};
            await wait(() => states.length > 2);
            link.close();
            return states;
        """)
        assert states[:3] == [True, 'nothing has happened', 'the server of this page is silent']


def test_what_was_not_saved_does_not_go_into_another_project(page: StudioPage, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / 'other'
    other.mkdir()
    (other / 'main.xml').write_text(TREE.replace('Drive', 'Other'))
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.write()
        page.chord(Keys.CONTROL, Keys.END)
        page.press('<!-- mine -->')
        page.until(page.has_changes)
    with served(other, None, port):
        page.until_text('alarm', f'Another project, {other}, is at this address now')
        assert page.shown_text == f'{TREE}<!-- mine -->'


def test_trees_that_were_asked_for_as_the_server_ended_are_asked_for_again(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = 'return document.querySelectorAll(`#palette [aria-label^="subtree"] [role=option]`).length'
    with held(monkeypatch, 'trees') as asked, served(folder, None) as port:
        page.open(port, 'main.xml')
        assert asked.wait(DEADLINE)
    page.until_text('link', 'NO SERVER')
    with served(folder, None, port):
        page.until(lambda: page.run(script) == 2)
        (folder / 'more.xml').write_text(RECOVER.replace('"Recover"', '"More"'))  # another program
        page.until(lambda: page.run(script) == 3)
        (folder / 'more' / 'recover.xml').write_text('<root BTCPP_format="4"/>')
        page.until(lambda: page.run(script) == 2)
        many = 12
        with held(monkeypatch, 'trees', passing=many) as too_often:  # once for each look, however many are written
            for number in range(many):
                (folder / f'{number}.xml').write_text('<root BTCPP_format="4"/>')
            page.until(lambda: page.run('return document.querySelectorAll("#files li").length') > many)
            for number in range(many):
                (folder / f'{number}.xml').write_text(RECOVER.replace('"Recover"', f'"More{number}"'))
            page.until(lambda: page.run(script) == 2 + many)
            assert not too_often.is_set()


def test_an_answer_that_comes_late_is_of_its_file_or_robot(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        keys, watched, sheets, job = page.run("""
            const {Flow} = await import('./flow.js'), {Live} = await import('./live.js');
            const {Jobs} = await import('./jobs.js'), {sheet} = await import('./sheets.js');
            const {choose} = await import('./choice.js');
            const made = (kind, parts) => Object.assign(Object.create(kind.prototype), parts), none = () => {};
            const turn = () => new Promise((done) => setTimeout(done));
            // The keys of a file.
            let file = {name: 'first'}, answers = [];
            const request = (_, words) => new Promise((done) => answers.push(() => done(words.file ?? words.robot)));
            const link = {request}, arrive = async (some) => { for (const one of some) { one(); await turn(); } };
            const flow = made(Flow, {on: {file: () => file, link}, pane: {hidden: false}, show: none});
            flow.update();
            file = {name: 'last'};
            flow.update();
            await arrive(answers.splice(0).reverse());
            // What is watched: the last that was asked for, and nothing once it was ended.
            const player = {
              isLive: false,
              end() { this.isLive = false; this.ended(); },
              play(title, _, {ended}) { Object.assign(this, {title, ended, isLive: true}); },
            };
            const studio = {link, told: none, debugger: {connect: none}, recordings: {ended: none}};
            const live = made(Live, {studio, player, isOn: false, robot: null, trees: new Map()}), watched = [];
            live.watch('slow');
            live.watch('quick');
            await arrive(answers.splice(0).reverse());
            watched.push(live.robot, player.title);
            live.watch('other');
            await arrive(answers.splice(0));
            watched.push(live.robot, player.title, live.isOn);
            live.watch();
            player.end();
            await arrive(answers.splice(0));
            watched.push(live.isOn, player.isLive);
            // Dialogs whose place another one takes.
            const sheets = [sheet('a', []), sheet('b', [])];
            document.querySelector('#sheet-buttons button').click();
            sheets.push(choose('a', []), choose('b', [{label: 'c'}]));
            document.querySelector('#choice-list li').click();
            const never = () => new Promise((done) => setTimeout(done, 2000, false));
            const isAnswered = (one) => Promise.race([one.then(() => true), never()]);
            // A job that is cancelled.
            const names = ['waiting', 'proofs', 'changes', 'runs', 'decisions'];
            const maps = Object.fromEntries(names.map((name) => [name, new Map()]));
            const asks = {link: {request: async (method) => (method === 'start_job' ? {number: 1, files: []} : null)}};
            const jobs = made(Jobs, {...maps, goals: {entries: new Map()}, studio: asks, show: none});
            const one = {name: 'a', language: 'xml', version: 1, settled: async () => {}};
            const job = jobs.start(jobs.runs, 'run', one, {});
            while (!jobs.waiting.size) await turn();
            jobs.cancel(jobs.runs.get('a'));
            return [flow.keys, watched, await Promise.all(sheets.map(isAnswered)), await isAnswered(job)];
        """)
        robots = ['quick', 'Robot quick', 'other', 'Robot other', True, False, False]
        assert (keys, watched, sheets, job) == ('last', robots, [True] * 4, True)


def test_the_last_file_is_not_closed_while_a_robot_is_simulated(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a file the page is loaded again, and the robot ends with the page."""
    answered = Sessions._result

    async def simulated(self: Sessions, asking: Page, method: str, arguments: dict[str, Any]) -> Any:
        if method == 'simulator_state':
            return {'state': 'starting', 'message': '', 'doors': [], 'robots': []}
        return await answered(self, asking, method, arguments)

    monkeypatch.setattr(Sessions, '_result', simulated)
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.go('machine.yaml')
        page.until_selected('/')
        for file in ('machine.yaml', 'main.xml'):
            page.run('document.querySelector(`[aria-label="Close ${arguments[0]}"]`).click()', file)
        page.until_told('The simulated robot would end with main.xml')
        assert page.run('return document.querySelectorAll("#tabs .tab").length') == 1


def test_a_dialog_gives_the_focus_back_once(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        places = page.run("""
            const {choose} = await import('./choice.js'), {sheet} = await import('./sheets.js'), places = [];
            for (const [id, dialog] of [['choice', () => choose('a', [])], ['sheet', () => sheet('a', [])]]) {
              document.getElementById('new').focus();
              const left = dialog();
              document.getElementById(id).close();  // as Escape does it: its event comes later
              places.push(document.activeElement.id);
              document.getElementById('files-filter').focus();
              await left;
              places.push(document.activeElement.id);
            }
            return places;
        """)
        assert places == 2 * ['new', 'files-filter']


def test_an_edit_that_a_busy_server_refuses_is_sent_again(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        sent, text = page.run("""
            const {OpenFile} = await import('./open_file.js'), {plainPane} = await import('./plain_text.js');
            const model = {file: 'a', text: 'ab', version: 1, changed: false, view: {}, problems: [], gestures: []};
            const buffer = plainPane(document.createElement('div'), {}).buffer('ab', 'a'), sent = [];
            const on = Object.fromEntries(['changed', 'viewed', 'found', 'told'].map((kind) => [kind, () => {}]));
            const request = async (method, {edits}) => {
              sent.push(JSON.stringify(edits));
              if (sent.length === 1) throw Object.assign(new Error('busy'), {kind: 'busy'});
            };
            const file = new OpenFile({request, isOpen: true}, model, buffer, on);
            file.apply([[2, 2, 'c']], 'typed');
            await file.synced();
            return [sent, file.base];
        """)
        assert (sent, text) == (2 * ['[[2,2,"c"]]'], 'abc')


def test_an_edit_whose_answer_was_lost_is_known_by_its_key(page: StudioPage, folder: Path) -> None:
    """Another page has removed what it had inserted, so that the text does not tell whether it has arrived."""
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        for has_arrived, expected in ((True, ['bxy', 1, 'bxy']), (False, ['bxyaaaa', 2, 'bxy'])):
            assert expected == page.run(
                """
                const [hasArrived] = arguments, {OpenFile} = await import('./open_file.js');
                const {plainPane} = await import('./plain_text.js');
                const buffer = plainPane(document.createElement('div'), {}).buffer('xy', 'a'), sent = [];
                const model = {file: 'a', changed: false, view: {}, problems: [], gestures: []};
                const on = Object.fromEntries(['changed', 'viewed', 'found', 'told'].map((kind) => [kind, () => {}]));
                const request = async (method, words) => {
                  if (method === 'edit') sent.push(words);
                  if (method === 'edit' && sent.length === 1) throw Object.assign(new Error('lost'), {kind: 'lost'});
                  if (method === 'edit') return words.version + 1;
                  const others = [[hasArrived ? 3 : 2, [[0, hasArrived ? 4 : 0, 'b']], 'other']];
                  const own = hasArrived ? [[2, sent[0].edits, sent[0].key]] : [];
                  return {...model, text: 'bxy', version: others[0][0], since: [...own, ...others]};
                };
                const file = new OpenFile({request, isOpen: true}, {...model, text: 'xy', version: 1}, buffer, on);
                file.apply([hasArrived ? [0, 0, 'aaaa'] : [2, 2, 'aaaa']], 'typed');
                await new Promise((done) => setTimeout(done));
                await file.recover();
                await file.synced();
                const {text} = file;
                buffer.undo();
                return [text, sent.length, file.text];
                """,
                has_arrived,
            )


def test_a_fix_is_for_the_text_that_was_checked(
    page: StudioPage, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / 'main.xml').write_text(text := TREE.replace('wait_duration', 'wait_durations'))
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.until(lambda: page.run('return document.querySelector("#problems .fix")'))
        monkeypatch.setattr(session, 'CHECK_SECONDS', 3600.0)
        page.write()
        page.chord(Keys.CONTROL, Keys.HOME)
        page.press('<!-- -->')
        page.chord(Keys.CONTROL, 's')
        page.until_told('main.xml saved')
        page.run('document.querySelector("#problems .fix").click()')
        page.until_told('has changed since')
        assert page.shown_text == f'<!-- -->{text}'


def test_the_way_to_the_graph_keeps_the_token_and_a_composition_chooses_nothing(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        page.run('document.querySelector(".skip").focus()')
        page.press(Keys.ENTER)
        page.until_selected('Main')
        assert page.run('return location.hash').startswith('#token=')
        page.chord(Keys.CONTROL, 'k')
        page.until(lambda: page.focused == 'choice-field')
        enter = 'new KeyboardEvent("keydown", {key: "Enter", isComposing: true, bubbles: true})'
        page.run(f'document.activeElement.dispatchEvent({enter})')
        assert page.run('return document.getElementById("choice").open')


def test_an_unreadable_text_keeps_the_last_graph(page: StudioPage, folder: Path) -> None:
    with served(folder, editor_folder()) as port:
        page.open(port, 'main.xml')
        page.write()
        page.chord(Keys.CONTROL, Keys.HOME)
        page.press(Keys.ARROW_DOWN, Keys.ARROW_DOWN, Keys.END, Keys.BACKSPACE)
        page.until_text('unreadable', 'Text not readable at 4:5')
        assert page.run('return document.querySelectorAll("#picture.stale .node").length') == 7
        page.press('>')
        page.until(lambda: page.run('return document.getElementById("unreadable").hidden'))
        page.until(lambda: not page.has_changes())


def test_a_machine_is_written_with_keys_alone(page: StudioPage, folder: Path) -> None:
    with served(folder, editor_folder()) as port:
        page.open(port, 'machine.yaml')
        page.press(Keys.ARROW_DOWN)
        assert page.focused == '/Ask'
        page.press(Keys.ARROW_RIGHT)
        assert page.focused == '/Ask#received'
        label = page.run('return document.activeElement.getAttribute("aria-label")')
        assert label == 'outcome received to Rest'
        page.press(Keys.ARROW_DOWN, Keys.ENTER)
        page.until(lambda: page.focused == 'choice-field')
        page.press('Rest', Keys.ENTER)
        page.until_told('declined leads to Rest')
        page.press(Keys.ARROW_LEFT, Keys.F2)
        page.until(lambda: page.focused == 'choice-field')
        page.press('Where', Keys.ENTER)
        page.until_selected('/Where')
        page.press('a')
        page.until(lambda: page.focused == 'choice-field')
        page.press('WaitState', Keys.ENTER)
        page.until_text('choice-title', 'Label')
        page.press('Pause', Keys.ENTER)
        page.until_selected('/Pause')
        page.press(Keys.DELETE)
        page.until_told('Pause removed')
        page.chord(Keys.CONTROL, 's')
        page.until_told('machine.yaml saved')
        expected = MACHINE.replace('declined: finished', 'declined: Rest').replace('Ask', 'Where')
        assert (folder / 'machine.yaml').read_text() == expected


def test_a_parameter_may_be_called_as_a_field_of_the_form(page: StudioPage, folder: Path) -> None:
    text = (folder / 'machine.yaml').read_text().replace('wait_time: 2.0', 'label: one, comment: two')
    (folder / 'machine.yaml').write_text(text)
    with served(folder, None) as port:
        page.open(port, 'machine.yaml')
        page.click('/Rest')
        page.run(
            'const field = [...document.querySelectorAll("#form input")].find((one) => one.value === "Rest");'
            'field.value = "Sleep"; field.dispatchEvent(new Event("change", {bubbles: true}))'
        )
        page.until(lambda: page.shown_text == text.replace('Rest', 'Sleep'))
        page.until_selected('/Sleep')
        page.run(
            'const field = document.querySelector("#form textarea");'
            'field.value = "a nap"; field.dispatchEvent(new Event("change", {bubbles: true}))'
        )
        page.until(lambda: '# a nap' in page.shown_text)
        assert 'label: one, comment: two' in page.shown_text


def test_outcomes_userdata_and_includes_are_added_and_removed(page: StudioPage, folder: Path) -> None:
    def choose(*answers: str) -> None:
        for answer in answers:
            page.until(lambda: page.focused == 'choice-field')
            page.press(answer, Keys.ENTER)

    def command(title: str, *answers: str) -> None:
        page.chord(Keys.CONTROL, 'k')
        choose(title, *answers)

    with served(folder, editor_folder()) as port:
        page.open(port, 'machine.yaml')
        page.run('document.querySelector("[data-act=remove_outcome]").click()')
        choose('failed', 'Rest')
        page.until_told('outcome failed removed')
        assert 'failed: Rest}' in page.shown_text and 'outcomes: [finished]' in page.shown_text
        page.run(
            '[...document.querySelectorAll("#form button")].find((one) => one.textContent === "Add a Key…").click()'
        )
        choose('tries', '3')
        page.until(lambda: 'tries: 3' in page.shown_text)
        page.until(lambda: page.run('return document.getElementById("field-userdata:tries")?.value') == '3')
        page.open(port, 'more/recover.xml')
        page.click('Recover')
        command('Include a file', '../main.xml')
        page.until(lambda: '<include path="../main.xml"/>' in page.shown_text)
        command('No longer include', '../main.xml')
        page.until(lambda: 'include' not in page.shown_text)


def test_nodes_are_dragged(page: StudioPage, folder: Path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    with served(folder, editor_folder()) as port:
        page.open(port, 'main.xml')

        def box(path: str) -> Any:
            return page.driver.find_element('css selector', f'#picture [data-path="{path}"] > .box')

        wait, goal = box('Main/0/1'), box('Main/0/0/0')
        half = goal.rect['width'] // 2
        ActionChains(page.driver).click_and_hold(wait).move_to_element_with_offset(goal, -half + 4, 0).perform()
        assert page.run('return document.querySelectorAll("#picture .drop-mark").length') == 1
        ActionChains(page.driver).release().perform()
        page.until_selected('Main/0/0/0')
        page.run('document.getElementById("palette-filter").value = ""')
        entry = page.driver.find_element('css selector', '#palette [role="option"]')
        name = entry.text
        ActionChains(page.driver).click_and_hold(entry).move_to_element(box('Main/0')).release().perform()
        page.until_selected('Main/0/2')
        page.until(lambda: f'<{name}' in page.shown_text)
        # Escape ends a drag, and leaves all as it was.
        before = page.shown_text
        ActionChains(page.driver).click_and_hold(box('Main/0/0/0')).move_to_element(box('Main/0/1')).send_keys(
            Keys.ESCAPE
        ).release().perform()
        assert page.run('return document.querySelectorAll(".dragged, .drop-mark, .drop-into").length') == 0
        assert page.shown_text == before


def test_a_link_opens_the_node_and_an_idle_page_asks_nothing(page: StudioPage, folder: Path) -> None:
    with served(folder, editor_folder()) as port:
        page.open(port, 'main.xml', '&node=Main/0/0/1')
        assert page.focused == 'Main/0/0/1'
        page.until_text('form', 'FollowPath')
        # A page that is not of this computer has no clipboard without HTTPS.
        page.run('Object.defineProperty(navigator, "clipboard", {value: undefined})')
        page.chord(Keys.CONTROL, 'k')
        page.until(lambda: page.run('return document.getElementById("choice").open'))
        page.press('Copy a link', Keys.ENTER)
        page.until_sheet('file=main.xml&node=Main%2F0%2F0%2F1')
        assert 'token' not in page.text('sheet')
        page.open(port, 'main.xml', '&node=Main/7')
        page.until_told('no Main/7 now')
        page.until_text('problems', 'No problems found')
        page.run(
            'window.sent = 0; const send = WebSocket.prototype.send;'
            'WebSocket.prototype.send = function(text) { window.sent += 1; send.call(this, text); }'
        )
        page.press(Keys.ARROW_DOWN, Keys.ARROW_DOWN, ' ', ' ')
        shown = page.run('return performance.now()')
        page.until(lambda: page.run('return performance.now()') > shown + 300.0)
        assert page.run('return window.sent') == 0


def test_all_nodes_in_the_pane_have_their_texts(page: StudioPage, folder: Path) -> None:
    wide = '\n'.join(f'<Wait name="n{number}" wait_duration="{number}.5"/>' for number in range(60))
    wide = wide.replace('"n59"', '"\u202elive"')  # read from the right it is "evil"
    (folder / 'wide.xml').write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="Wide"><Sequence>{wide}</Sequence></BehaviorTree></root>'
    )
    with served(folder, None) as port:
        page.open(port, 'wide.xml')
        shown = set()
        for key in (Keys.ARROW_DOWN, Keys.ARROW_RIGHT, Keys.END, Keys.ARROW_UP, Keys.HOME):
            page.press(key)
            wrong, names = page.run(TEXTS)
            assert wrong == []
            shown |= set(names)
            assert 0 < len(names) < 40
        assert {'Wide/0/0', 'Wide/0/59'} <= shown
        texts = 'document.querySelectorAll(`[data-path="Wide/0/59"] text`)'
        assert page.run(f'return [...{texts}].map((one) => one.textContent)') == [
            '\\u{202e}live',
            ' Wait',
            ' wait_duration=59.5',
        ]
        page.run('document.querySelector(".zoom > button:nth-child(2)").click()')  # all of it
        page.until(lambda: page.run(TEXTS)[0] == [] and len(page.run(TEXTS)[1]) == 62)


@pytest.mark.parametrize('scheme', ['light', 'dark'])
def test_a_narrow_page_cuts_nothing_off(page: StudioPage, folder: Path, scheme: str) -> None:
    phone = {'width': 390, 'height': 844, 'deviceScaleFactor': 1, 'mobile': True}
    media = {'features': [{'name': 'prefers-color-scheme', 'value': scheme}]}
    with served(folder, None) as port:
        page.driver.execute_cdp_cmd('Emulation.setDeviceMetricsOverride', phone)
        page.driver.execute_cdp_cmd('Emulation.setEmulatedMedia', media)
        try:
            page.open(port, 'main.xml')
            page.press(Keys.ARROW_DOWN)
            assert page.run('return document.documentElement.scrollWidth') <= 390
            cut = page.run(
                'return [...document.querySelectorAll("button, input, h2, select")].filter((one) => {'
                'const box = one.getBoundingClientRect();'
                'return box.width && (box.right > 391 || box.left < -1) && !one.closest("#tabs, #crumbs, .list"); })'
                '.map((one) => one.outerHTML)'
            )
            assert cut == []
        finally:
            page.driver.execute_cdp_cmd('Emulation.clearDeviceMetricsOverride', {})
            page.driver.execute_cdp_cmd('Emulation.setEmulatedMedia', {'features': []})


def test_changes_of_texts_converge(page: StudioPage, folder: Path) -> None:
    """The laws that the work of several pages rests on, for random changes."""
    with served(folder, None) as port:
        page.open(port, 'main.xml')
        assert page.run((Path(__file__).parent / 'change_laws.js').read_text()) == ''
