# SPDX-License-Identifier: BSD-3-Clause
"""axe-core finds nothing in the studio: with a tree, a machine, and each dialog, in light and in dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from studio_page import StudioPage, served
from test_studio_python_page import BEHAVIOR, MACHINE

from flexbt_studio.server.web_server import editor_folder
from flexbt_testing.browser import NEEDS_AXE, NEEDS_BROWSER

keys_module = pytest.importorskip(
    'selenium.webdriver.common.keys', reason='selenium drives the browser: pip install selenium'
)
Keys: Any = keys_module.Keys

pytestmark = [NEEDS_BROWSER, NEEDS_AXE]

TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Fallback>
      <!-- drive -->
      <FollowPath path="{path}"/>
      <Wait wait_durations="1.0"/>
      <SubTree ID="Nowhere"/>
    </Fallback>
  </BehaviorTree>
</root>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in (('main.xml', TREE), ('rounds.yaml', MACHINE), ('waits.py', BEHAVIOR)):
        (tmp_path / name).write_text(text)
    return tmp_path


def test_axe_finds_nothing_in_the_studio(page: StudioPage, folder: Path) -> None:
    found: list[str] = []

    def look(where: str) -> None:
        found.extend(f'{where}: {one}' for one in page.violations())

    def dialog(keys: tuple[str, ...], id: str) -> None:
        page.chord(*keys)
        page.until(lambda: page.run('return document.getElementById(arguments[0]).open', id))
        look(' '.join(keys).encode('ascii', 'backslashreplace').decode())
        page.press(Keys.ESCAPE)
        page.until(lambda: not page.run('return document.querySelector("dialog[open]")'))

    with served(folder, editor_folder()) as port:
        page.open(port, 'main.xml')
        page.until_text('problems', 'wait_durations')
        page.run('for (const one of document.querySelectorAll("#runs > details")) one.removeAttribute("name")')
        page.run('for (const one of document.querySelectorAll("#runs > details")) one.open = true')
        look('tree')
        page.press(Keys.DOWN)
        page.until_selected('Main/0')
        look('node')
        dialog((Keys.CONTROL, 'k'), 'choice')
        dialog(('?',), 'sheet')
        dialog(('a',), 'choice')
        page.click('Main/0/1')
        dialog((Keys.F2,), 'choice')
        page.press(Keys.DELETE)
        page.until(page.has_changes)
        dialog((Keys.CONTROL, Keys.SHIFT, 'S'), 'sheet')
        (folder / 'main.xml').write_text(TREE.replace('1.0', '2.0'))
        page.until(lambda: page.run('return !document.getElementById("on-disk").hidden'))
        look('changed on disk')
        dialog((Keys.CONTROL, 's'), 'sheet')
        page.open(port, 'rounds.yaml')
        look('machine')
        page.click('/Tell')
        look('state')
        page.open(port, 'waits.py')
        page.until_text('problems', 'only read')
        dialog((Keys.F9,), 'sheet')
    with served(folder, None) as port:  # the page's own text field
        page.open(port, 'main.xml')
        look('text field')
    assert not found, '\n'.join(sorted(set(found)))


def test_the_file_that_is_shown_is_marked_also_in_the_colours_of_the_system(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port, page.emulated(1400, 950, forced_colors='active'):
        page.open(port, 'main.xml')
        rows = '[...document.querySelectorAll("#files li")]'
        marked = page.run(
            f'return {rows}.filter((one) => getComputedStyle(one).outlineStyle !== "none").map((one) => one.innerText)'
        )
        assert len(marked) == 1 and 'main.xml' in marked[0]


def test_on_a_small_screen_of_touch_stop_and_keys_are_seen_and_a_choice_is_left(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port, page.emulated(320, 640, mobile=True):
        page.open(port, 'main.xml')
        page.press('?')
        page.until_sheet('Keys')
        shown = 'return [...document.querySelectorAll("#sheet kbd")].every((one) => one.checkVisibility())'
        assert page.run(shown)
        assert page.run(
            'const {scrollWidth, clientWidth} = document.getElementById("sheet"); return scrollWidth <= clientWidth'
        )
        page.press(Keys.ESCAPE)
        page.until(lambda: not page.run('return document.querySelector("dialog[open]")'))
        at = (
            'document.getElementById("stop").hidden = false; scrollTo(0, 10000);'
            'const {x, y} = document.getElementById("stop").getBoundingClientRect();'
            'return document.elementFromPoint(x + 5, y + 5)?.id ?? ""'
        )
        assert page.run(at) == 'stop'
        page.driver.find_element('id', 'commands').click()
        page.until(lambda: page.focused == 'choice-field')
        page.driver.find_element('css selector', '#choice form button').click()
        page.until(lambda: not page.run('return document.querySelector("dialog[open]")'))
