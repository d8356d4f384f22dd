# SPDX-License-Identifier: BSD-3-Clause
"""The tutorial of the first mission, step by step in a real browser. With FLEXBT_PICTURES its pictures are written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from studio_page import StudioPage, served

from flexbt_studio.server.web_server import editor_folder
from flexbt_testing.browser import NEEDS_BROWSER

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = NEEDS_BROWSER

LOOK = """\
<root BTCPP_format="4" main_tree_to_execute="Look">
  <BehaviorTree ID="Look">
    <Sequence>
      <Spin/>
      <Inverter>
        <IsBatteryLow min_battery="0.2"/>
      </Inverter>
    </Sequence>
  </BehaviorTree>
</root>
"""


def picture(page: StudioPage, name: str) -> None:
    """Write a picture of the page into the folder that FLEXBT_PICTURES names, if it does."""
    folder = os.environ.get('FLEXBT_PICTURES')
    if folder:
        page.driver.save_screenshot(str(Path(folder, name)))


def chosen(page: StudioPage, *texts: str) -> None:
    """Answer the questions that the page asks."""
    for text in texts:
        page.until(lambda: page.focused == 'choice-field')
        page.chord(Keys.CONTROL, 'a')
        page.press(text, Keys.ENTER)


def test_the_first_mission(page: StudioPage, tmp_path: Path) -> None:
    folder = tmp_path / 'patrol'
    folder.mkdir()
    with served(folder, editor_folder()) as port:
        page.driver.get(f'http://127.0.0.1:{port}/#token=a-token')
        page.until(lambda: 'CONNECTED' in page.text('link'))
        page.chord(Keys.CONTROL, 'k')
        chosen(page, 'new file', 'Tree', 'look.xml')
        page.until_selected('Look')
        page.press(Keys.ARROW_DOWN, 'A')
        chosen(page, 'Spin')
        page.until_selected('Look/0/1')
        page.press('a')
        chosen(page, 'IsBatteryLow')
        page.until_selected('Look/0/2')
        page.press('w')
        chosen(page, 'Inverter')
        page.until_told('wrapped in Inverter')
        page.press(Keys.HOME, Keys.DELETE)
        page.until_told('removed')
        page.until_selected('Look/0/0')
        page.until(lambda: page.invalid == ['Look/0/1/0'])
        page.press(Keys.F8)
        page.until_selected('Look/0/1/0')
        picture(page, 'studio_problem.png')
        page.press(Keys.ENTER)
        page.until(lambda: page.run('return document.getElementById("field-min_battery") !== null'))
        page.tab_to('field-min_battery')
        page.press('0.2', Keys.ENTER, Keys.ESCAPE)
        page.until(lambda: page.invalid == [])
        page.chord(Keys.CONTROL, 's')
        page.until_told('look.xml saved')
        page.press(Keys.F9)
        page.until(lambda: page.text('proof').startswith(('proved', 'not proven')))
        assert (folder / 'look.xml').read_text() == LOOK
        assert page.text('proof') == 'proved: nothing wrong (4 of 4 reached)'
        page.run('document.getElementById("requirements").focus()')
        page.press('never =FAILURE', Keys.TAB, Keys.F9)
        page.until(lambda: page.text('proof') == 'not proven: 1 wrong')
        page.run('document.querySelector("#proof-list button").click()')
        page.until(lambda: page.focused == 'player-line')
        page.press(Keys.END)
        page.until(lambda: '=FAILURE happens' in page.text('player-told'))
        picture(page, 'studio.png')
        page.press(Keys.ESCAPE, Keys.F10)
        page.until(lambda: 'reached' in page.text('run-told'))
        page.press(Keys.END)
        page.until(lambda: 'child 2 of 2 failed' in page.text('run-lines'))
        page.press(Keys.ESCAPE)
        page.chord(Keys.CONTROL, 'k')
        chosen(page, 'new file', 'State machine', 'patrol.yaml')
        page.until_selected('/')
        page.press(Keys.ARROW_DOWN, 'a')
        chosen(page, 'BtExecuteState', 'Look')
        page.until(lambda: 'BtExecuteState' in page.shown_text)
        picture(page, 'studio_machine.png')
