# SPDX-License-Identifier: BSD-3-Clause
"""The debugger of the page in a real browser, with a real executive and BT server in processes of their own."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from studio_page import StudioPage

from flexbt_testing.browser import NEEDS_BROWSER
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import run_console, start_console

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = NEEDS_BROWSER

TREE = """\
<root BTCPP_format="4" main_tree_to_execute="Count">
  <BehaviorTree ID="Count">
    <Sequence>
      <Script code="attempt := 0"/>
      <KeepRunningUntilFailure name="Again">
        <Sequence>
          <Script name="Add" code="attempt := attempt + 1"/>
          <Sleep name="Rest" msec="100"/>
        </Sequence>
      </KeepRunningUntilFailure>
    </Sequence>
  </BehaviorTree>
</root>
"""
MACHINE = """\
behavior: {name: Counting}
machine:
  outcomes: [finished, failed]
  states:
    Load:
      state: BtLoaderState
      parameters: {filepaths: [FOLDER/count.xml]}
      transitions: {done: Run, failed: failed}
    Run:
      state: BtExecuteState
      parameters: {bt_file: FOLDER/count.xml}
      transitions: {done: Rest, canceled: finished, failed: failed}
    Rest:
      state: WaitState
      parameters: {wait_time: 0.1}
      transitions: {done: Run}
"""
ADD, REST = 'Count/0/1/0/0', 'Count/0/1/0/1'


class Mission(NamedTuple):
    """The folder of a mission that an executive runs, and the address of its studio."""

    folder: Path
    studio: str
    stack: Stack


@pytest.fixture
def mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Mission]:
    monkeypatch.setenv('FLEXBT_STUDIO_EDITOR', '/nowhere')  # a plain text field; always the same for the fork servers
    folder, about = tmp_path / 'site' / 'counting', tmp_path / 'site' / 'counting-1.0.dist-info'
    for one in (folder, about):
        one.mkdir(parents=True)
    (folder / '__init__.py').touch()
    (folder / 'count.xml').write_text(TREE)
    (folder / 'counting.yaml').write_text(MACHINE.replace('FOLDER', str(folder)))
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: counting\nVersion: 1.0\n')
    (about / 'entry_points.txt').write_text('[flexbt.behaviors]\ncounting = counting:counting.yaml\n')
    environment = {'PYTHONPATH': os.pathsep.join([str(tmp_path / 'site'), os.environ.get('PYTHONPATH', '')])}
    with Stack(tmp_path) as stack:
        wall_time = {'use_sim_time': 'false'}
        stack.start('bt_server', {**wall_time, 'allowed_directories': f"['{folder}']"})
        stack.start(
            'onboard_executive', {**wall_time, 'authority_timeout': '600.0', 'heartbeat_period': '10.0'}, environment
        )
        done = run_console('--timeout', '60', 'start', 'Counting')
        assert done.returncode == 0, done.stderr
        with start_console('web', '--port', '0', '--timeout', '60', '--studio', str(folder)) as web:
            try:
                assert web.stdout is not None
                found = re.search(r'(http://127\.0\.0\.1:\d+/)#(token=\S+)', web.stdout.readline())
                assert found is not None
                yield Mission(folder, f'{found[1]}studio/#{found[2]}', stack)
            finally:
                web.kill()


@pytest.fixture
def robot(page: StudioPage, mission: Mission) -> Iterator[StudioPage]:
    """Provide a page with Live on, at the tree that runs."""
    open_page(page, mission, 'count.xml')
    yield page
    page.driver.get('about:blank')  # while its servers are there


def open_page(page: StudioPage, mission: Mission, file: str) -> None:
    # While a tree is held, the page asks who leaves it. The driver answers, and may then lose the next address.
    page.run('BeforeUnloadEvent.prototype.preventDefault = () => {}')
    page.driver.get('about:blank')
    page.driver.get(f'{mission.studio}&file={file}')
    page.until(lambda: page.selected)
    page.run('document.getElementById("live").click()')
    page.until(lambda: page.run('return document.getElementById("live").className') == 'good')
    page.until_text('debug-who', 'you: guest-')
    page.until(lambda: page.run('return document.querySelector("#picture .st-running")'))  # what runs has been received


def marks(page: StudioPage) -> dict[str, str]:
    """Return what the debugger shows on the graph, by the paths of the items."""
    script = (
        'return Object.fromEntries([...document.querySelectorAll("#picture .debug-mark text")]'
        '.map((one) => [one.closest("[data-path]").dataset.path, one.textContent]))'
    )
    found: dict[str, str] = page.run(script)
    return found


def answer(page: StudioPage, text: str) -> None:
    page.until(lambda: page.focused == 'choice-field')
    page.chord(Keys.CONTROL, 'a')
    page.press(text, Keys.ENTER)


def until_mark(page: StudioPage, path: str, *words: str) -> None:
    page.until(lambda: all(word in marks(page).get(path, '') for word in words))


def attempts(page: StudioPage) -> int:
    """Return the entry of the blackboard, from the table; -1 if it is not shown."""
    found = re.search(r'attempt\s+(\d+)\s', page.text('debug-data'))
    return int(found[1]) if found else -1


def rewrite(page: StudioPage, change: Callable[[str], str]) -> None:
    """Put another text into the text pane."""
    page.run(
        'const field = document.querySelector("#text textarea"); field.value = arguments[0];'
        'field.dispatchEvent(new Event("input", {bubbles: true}))',
        change(page.shown_text),
    )


def press_button(page: StudioPage, place: str, text: str) -> None:
    script = (
        '[...document.getElementById(arguments[0]).querySelectorAll("button")]'
        '.find((one) => one.textContent === arguments[1]).click()'
    )
    page.run(script, place, text)


def step(page: StudioPage) -> None:
    """Answer the held transition; it must have been shown for a moment."""
    applied = told(page, 'step into')
    while told(page, 'step into') == applied:
        press_until_told(page, Keys.F11, 'step into', 'has just come')


def press_until_told(page: StudioPage, key: str, *texts: str) -> None:
    """Press a key, and wait until one of the texts is told once more."""
    count = sum(told(page, text) for text in texts)
    page.press(key)
    page.until(lambda: sum(told(page, text) for text in texts) > count)


def lines(page: StudioPage) -> list[str]:
    """Return what the robot has told, the newest first."""
    return page.text('debug-log').splitlines()


def let_go(page: StudioPage) -> None:
    """Let the held tree go on until it is held again."""
    holds = told(page, 'HELD:')
    page.press(Keys.F5)
    page.until(lambda: told(page, 'HELD:') > holds)


def told(page: StudioPage, text: str) -> int:
    """Return how many of the lines that the robot has told contain a text."""
    return sum(text in line for line in lines(page))


def test_a_tree_is_held_stepped_and_stopped(robot: StudioPage, mission: Mission) -> None:
    page = robot
    page.click(REST)
    # What is no condition is refused with the reason, and nothing is set.
    for condition, reason in (('attempt = 5', 'it would change'), ('attempt >', 'a value is missing')):
        page.press('B')
        answer(page, condition)
        page.until_text('debug-log', reason)
    page.press('B')
    page.until(lambda: page.focused == 'choice-field')
    page.run('document.getElementById("choice-field").value = "1 == ".repeat(2000000)')
    page.run('document.getElementById("choice-field").oninput()')
    page.press(Keys.ENTER)
    page.until_told('nothing was sent')
    assert (marks(page), page.text('held')) == ({}, '')
    page.press('B')
    answer(page, 'attempt > 10')
    until_mark(page, REST, 'HELD', 'breakpoint if')
    page.until_text('held', 'HELD before Rest')
    page.until(lambda: attempts(page) > 10)
    # Whoever closes the page is asked, since the tree stays held.
    assert not page.run('return dispatchEvent(new Event("beforeunload", {cancelable: true}))')
    assert 'stays so when this page is closed' in page.text('held')
    label = page.run('return document.querySelector(`[data-path="${arguments[0]}"]`).getAttribute("aria-label")', REST)
    assert 'HELD, breakpoint if' in label
    # To the end of the tick, to the next hold, and to another node: each press once.
    page.run('document.querySelector("#held button").focus()')
    page.press(Keys.ENTER)
    page.until_text('held', 'PAUSED')
    assert page.focused == 'held'
    page.press(Keys.F11)
    page.until_text('held', 'HELD before Rest')
    # Pressed three times at once: it is let go once for each time that it is held, and each press is answered.
    holds = told(page, 'HELD:')
    page.press(Keys.F5, Keys.F5, Keys.F5)
    page.until(lambda: told(page, 'continue: applied') + told(page, 'on its way') == 3)
    page.until(lambda: told(page, 'HELD:') == holds + told(page, 'continue: applied'))
    page.until(lambda: re.search(r'attempt\s+\d+\s+Add\s', page.text('debug-data')))  # who has written it
    # The blackboard of the held tree is changed; the tree goes on with it.
    press_button(page, 'debug-data', 'Change…')
    answer(page, "attempt := 'many'")
    page.until_text('debug-log', 'cannot be run')
    press_button(page, 'debug-data', 'Change…')
    answer(page, 'attempt := 4000')
    page.until(lambda: attempts(page) == 4000)
    while attempts(page) <= 4000:  # Rest may be held at several of its ticks
        let_go(page)
    page.run('document.querySelector("#debug-set .quiet").focus()')
    page.press(Keys.ENTER)
    page.until(lambda: marks(page) == {REST: '‖ HELD'})  # clearing does not let it go
    assert page.focused == REST
    page.click(ADD)
    page.chord(Keys.CONTROL, Keys.F10)
    page.until_text('debug-log', 'tree run-to Add: applied')
    page.until(lambda: marks(page) == {ADD: '‖ HELD'})
    page.press('q')
    page.until_sheet('Add is ')
    page.press(Keys.ESCAPE)
    # An answer that comes late takes the place of nothing that is read by then.
    late = (
        'const {send} = WebSocket.prototype;'
        'WebSocket.prototype.send = function (data) {'
        ' if (data.includes("tree why")) window.late = () => send.call(this, data); else send.call(this, data); }'
    )
    page.run(late)
    page.press('q', '?')
    page.until_sheet('In the Graph')
    page.until(lambda: page.run('return Boolean(window.late)'))
    page.run('window.late()')
    page.until_text('debug-log', 'tree why: Add is ')
    assert 'In the Graph' in page.text('sheet')
    page.press(Keys.ESCAPE)
    # Another page of the same robot shows the same, and takes away what this one has set.
    first = page.driver.current_window_handle
    page.driver.switch_to.new_window('tab')
    try:
        open_page(page, mission, 'count.xml')
        page.until_text('held', 'HELD before Add')
        page.click(REST)
        page.press('d')
        answer(page, 'SUCCESS')
        until_mark(page, REST, 'dummy SUCCESS')
        page.press('d')
        page.until(lambda: marks(page) == {ADD: '‖ HELD'})
    finally:
        page.driver.close()  # the robot stays held
        page.driver.switch_to.window(first)
    page.until(lambda: marks(page) == {ADD: '‖ HELD'})
    # Without the authority nothing is touched, but STOP works.
    assert run_console('--timeout', '60', '--operator', 'bob', 'claim').returncode == 0
    page.until_text('debug-who', 'authority bob')
    page.press(Keys.F5)
    page.until_text('debug-log', "'bob' has the authority")
    page.until_text('held', 'HELD before Add')
    page.chord(Keys.CONTROL, 'k')
    page.until(lambda: page.focused == 'choice-field')  # no Enter is for the STOP of the dialog
    page.driver.find_element('css selector', '#choice .stop').click()
    page.until(lambda: page.text('held') == '')
    page.chord(Keys.SHIFT, Keys.F5)
    page.until(lambda: page.text('debug-log').count('stop: applied') == 2)
    page.driver.find_element('css selector', '#choice form button').click()
    page.until_text('player-told', 'idle')
    assert marks(page) == {}


def test_a_machine_is_held_and_switched_to_what_is_written(robot: StudioPage, mission: Mission) -> None:
    page, file = robot, mission.folder / 'counting.yaml'
    page.click('Count/0/1')
    page.press('p')
    page.until_text('held', 'PAUSED')
    page.press('f')
    answer(page, 'SUCCESS')
    until_mark(page, 'Count/0/1', 'force SUCCESS')
    open_page(page, mission, 'counting.yaml')
    page.until_text('held', 'PAUSED')
    page.click('/Run')
    page.press('b')
    until_mark(page, '/Run', 'breakpoint')
    press_button(page, 'held', 'Continue')
    until_mark(page, '/Run', 'WAITS')
    page.until_text('held', '/Run wants done (breakpoint)')
    step(page)
    page.until_text('held', '/Rest wants done')
    # A version without the active state is refused with the reason, one that has more states is taken over.
    rewrite(page, lambda text: text.replace('Rest', 'Sit'))
    page.run('document.getElementById("debug-switch").click()')
    page.until_sheet('/Rest is active, and is not in this version')
    assert 'Save and Switch' not in page.text('sheet')
    page.press(Keys.ESCAPE)
    more = '    More: {state: WaitState, parameters: {wait_time: 0.1}, transitions: {done: Run}}\n'
    led = '0.1}\n      transitions: {done: '
    rewrite(page, lambda text: text.replace('Sit', 'Rest').replace(f'{led}Run', f'{led}More') + more)
    page.run('document.getElementById("debug-switch").click()')
    page.until_sheet('adds /More')
    assert '/Rest: done leads to More, not to Run' in page.text('sheet')
    page.press(Keys.ENTER)
    page.until_text('debug-log', 'switch Counting: applied')
    assert 'More:' in file.read_text()
    page.run('document.getElementById("debug-switch").click()')
    page.until_sheet('States and transitions are as on the robot')
    page.press(Keys.ESCAPE)
    # What the step held waits for its answer also after the switch.
    page.until_text('held', '/Rest wants done')
    answered = told(page, 'confirm')
    while told(page, 'confirm') == answered:
        press_until_told(page, Keys.F5, 'confirm', 'has just come', 'the decision changed')
    # The process of the trees dies while one is held.
    page.until(lambda: '/Rest' not in page.text('held'))
    open_page(page, mission, 'count.xml')
    page.click(REST)
    page.press('p')
    page.until_text('held', 'PAUSED')
    mission.stack.kill('bt_server')
    page.until(lambda: 'PAUSED' not in page.text('held'))
