# SPDX-License-Identifier: BSD-3-Clause
"""The studio's page: code of behaviors that runs after a word, the form of a behavior, and files that others write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from studio_page import StudioPage, served

from flexbt_testing.browser import NEEDS_BROWSER

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = NEEDS_BROWSER

BEHAVIOR = """\
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import WaitState


class Waits(Behavior):
    manifest = BehaviorManifest('Waits', 'waits')

    def create(self) -> OperatableStateMachine:
        machine = OperatableStateMachine(['finished'])
        with machine:
            machine.add('First', WaitState(1.0), transitions={'done': 'Second'})
            machine.add('Second', WaitState('soon'), transitions={'done': 'finished'})
        return machine
"""
MACHINE = """\
behavior:
  name: Rounds
  parameters:
    limit: {default: 20, description: how many}
machine:
  outcomes: [finished, failed]
  states:
    Tell:
      state: LogState
      parameters:
        text: |
          one
          two
      transitions: {done: Wait}
    Wait:
      state: WaitState   # a while
      parameters: {wait_time: 2.0}
      transitions: {done: Tell}
"""
PRESS = """
const wanted = [...document.querySelectorAll(arguments[0])].find((one) => one.textContent.includes(arguments[1]));
wanted?.click();
return Boolean(wanted);
"""
FILL = """
const field = document.querySelector(`[data-field="${CSS.escape(arguments[0])}"]`);
if (!field || field.readOnly) return false;
field.value = arguments[1];
field.dispatchEvent(new Event('change', {bubbles: true}));
return true;
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / 'waits.py').write_text(BEHAVIOR)
    (tmp_path / 'rounds.yaml').write_text(MACHINE)
    return tmp_path


def test_code_runs_after_the_word_and_a_counterexample_is_played(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'waits.py')
        page.until_text('problems', 'it is only read')
        page.press(Keys.F9)
        page.until_sheet('Run the code of behaviors?')
        assert page.run('return document.activeElement.textContent') == 'Only Read'
        page.press(Keys.ENTER)
        page.until(lambda: not page.run('return document.getElementById("sheet").open'))
        assert page.text('proof') == 'Prove' and page.text('problems').count('only read') == 1
        assert page.run(PRESS, '#allow-code', 'Run')
        page.until_sheet('Run the code of behaviors?')
        assert page.run(PRESS, '#sheet button', 'Run Code')
        page.until(lambda: page.invalid == ['/Second'])
        assert 'soon' in page.text('problems')
        page.click('/Second')
        page.until(lambda: page.run(FILL, '0', '1.0'))
        page.until_text('problems', 'No problems found')
        page.run('document.getElementById("requirements").value = "never =finished"')
        page.press(Keys.F9)
        page.until_text('proof', 'not proven')
        assert page.run(PRESS, '#proof-list button', 'play')
        assert page.run(PRESS, '#player button', '›')
        page.until(lambda: page.run('return document.querySelectorAll("#picture .st-running").length'))
        # The same tab is not asked again, also after a reload.
        page.driver.refresh()
        page.until_text('problems', 'No problems found')


def test_the_head_of_a_behavior_its_outcomes_and_the_clipboard(page: StudioPage, folder: Path) -> None:
    from selenium.common.exceptions import StaleElementReferenceException
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    def element(selector: str) -> Any:
        return page.driver.find_element(By.CSS_SELECTOR, selector)

    def until_line(text: str) -> None:
        page.until(lambda: text in page.shown_text)

    with served(folder, None) as port:
        page.open(port, 'rounds.yaml')
        assert page.run(FILL, 'parameter:limit:default', '30')
        until_line('limit: {default: 30, description: how many}')
        page.until(lambda: page.run(FILL, 'parameter:limit:name', 'most'))
        until_line('most: {default: 30, description: how many}')
        assert page.run(PRESS, '#add-parameter', 'Add')
        page.press('place', Keys.ENTER)
        page.until(lambda: 'Default of place' in page.text('choice'))
        page.press('home', Keys.ENTER)
        until_line('place: {default: home}')
        # A text of several lines keeps its block.
        page.click('/Tell')
        page.until(lambda: page.run(FILL, 'text', 'one\ntwo\nthree\n'))
        until_line('        text: |\n          one\n          two\n          three\n')

        # A transition is drawn to an outcome of the container.
        def drawn() -> bool:
            try:
                mark, end = (
                    element('#picture [data-path="/Wait#done"] .box'),
                    element('#picture [data-end=failed] rect'),
                )
                ActionChains(page.driver).click_and_hold(mark).move_to_element(end).perform()
            except StaleElementReferenceException:  # the graph was drawn again meanwhile
                return False
            finally:
                ActionChains(page.driver).release().perform()
            return True

        page.until(drawn)
        page.until_told('done leads to failed')
        until_line('transitions: {done: failed}')
        # A copy beside it, and one from another file.
        page.click('/Wait')
        page.press('c')
        page.until_told('copied as text')
        page.press('v')
        page.until_selected('/Wait2')
        before, copy = page.shown_text.split('    Wait2:\n')
        assert before.endswith(copy) and 'state: WaitState   # a while\n' in copy and '{done: failed}' in copy


def test_a_file_that_another_program_writes(page: StudioPage, folder: Path, editor: Path | None) -> None:
    file = folder / 'rounds.yaml'
    with served(folder, editor) as port:
        page.open(port, 'rounds.yaml')
        file.write_text(MACHINE.replace('wait_time: 2.0', 'wait_time: 3.0'))
        page.until_told('was changed on disk')
        assert 'wait_time: 3.0' in page.shown_text and not page.has_changes()
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: 'wait_time: 2.0' in page.shown_text and page.has_changes())
        file.write_text(MACHINE.replace('wait_time: 2.0', 'wait_time: 4.0'))
        page.until(lambda: page.run('return !document.getElementById("on-disk").hidden'))
        assert 'wait_time: 2.0' in page.shown_text
        assert page.run(PRESS, '#merge', 'Merge')
        page.until_sheet('changed on disk')
        assert page.run(PRESS, '#sheet button', 'Take the Version on Disk')
        page.until(lambda: 'wait_time: 4.0' in page.shown_text and not page.has_changes())
        assert page.run('return document.getElementById("on-disk").hidden')
        assert 'wait_time: 4.0' in file.read_text()
        (folder / 'added.yaml').write_text(MACHINE)
        page.until_text('files', 'added.yaml')
