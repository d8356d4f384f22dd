# SPDX-License-Identifier: BSD-3-Clause
"""Names in the page: rename in all files and take it back in one step, list uses, see who writes and reads a key."""

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

MAIN = """\
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <SubTree ID="Count" step="{step}"/>
      <Script code="step := 2; unread := 1"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
COUNT = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Count">
    <Script code="n := step"/>
  </BehaviorTree>
</root>
"""
MISSION = """\
machine:
  outcomes: [done, failed]
  states:
    Count:
      state: BtExecuteState
      parameters: {bt_file: Count}
      transitions: {done: done, canceled: failed, failed: failed}
"""
TEXTS = {'main.xml': MAIN, 'more/count.xml': COUNT, 'mission.yaml': MISSION}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    project = tmp_path / 'mission'
    (project / 'more').mkdir(parents=True)
    for file, text in TEXTS.items():
        (project / file).write_text(text)
    (project / 'test_count.py').write_text("assert run('Count')\n")
    return project


def changed_tabs(page: StudioPage) -> list[str]:
    script = 'return [...document.querySelectorAll(".tab")].map((one) => one.textContent)'
    return [str(one).strip('● ×') for one in page.run(script) if '●' in one]


def sub_trees(page: StudioPage) -> list[str]:
    """Return the trees that the palette offers."""
    group = '#palette [aria-label^="subtree"] [role=option]'
    return sorted(page.run(f'return [...document.querySelectorAll(`{group}`)].map((one) => one.textContent)'))


def test_a_tree_is_renamed_in_all_files_and_taken_back_in_one_step(
    page: StudioPage, folder: Path, editor: Path | None
) -> None:
    with served(folder, editor) as port:
        page.open(port, 'main.xml', '&node=Main/0/0')
        page.until_selected('Main/0/0')
        page.press(Keys.F2)
        page.until(lambda: page.run('return document.getElementById("choice").open'))
        page.press('Total')
        page.press(Keys.ENTER)
        page.until_sheet('3 edits in 3 files')
        sheet = page.text('sheet')
        assert 'test_count.py:1' in sheet and "run('Count')" in sheet
        assert [line for line in sheet.splitlines() if line.startswith('+')] == [
            '+       <SubTree ID="Total" step="{step}"/>',
            '+       parameters: {bt_file: Total}',
            '+   <BehaviorTree ID="Total">',
        ]
        assert changed_tabs(page) == []
        page.press(Keys.ENTER)
        page.until(lambda: changed_tabs(page) == ['main.xml', 'mission.yaml', 'count.xml'])
        page.until_selected('Main/0/0')
        assert 'test_count.py:1' in page.told
        page.until(lambda: sub_trees(page) == ['Main', 'Total'])
        # The keys of the page and of the text editor take it back in all files, and do it again.
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: changed_tabs(page) == [] and page.shown_text.rstrip() == MAIN.rstrip())
        page.until(lambda: sub_trees(page) == ['Count', 'Main'])
        page.write()
        page.chord(Keys.CONTROL, 'y')
        page.until(lambda: changed_tabs(page) == ['main.xml', 'mission.yaml', 'count.xml'])
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: changed_tabs(page) == [])
        # Who writes and who reads, by keys alone.
        page.run('document.getElementById("picture").querySelector("[aria-selected=true]").focus()')
        page.press('k')
        page.until(lambda: page.run('return document.querySelectorAll("#flow [role=option]").length') == 2)
        page.press(Keys.ARROW_DOWN)
        page.until(lambda: page.run('return document.querySelectorAll("#picture .flow-mark").length') == 2)
        marks = page.run(
            'return [...document.querySelectorAll("#picture .flow-mark text")].map((one) => one.textContent)'
        )
        assert marks == ['R', 'W']
        assert 'read before it is written' in page.text('flow')
        told = 'return document.querySelector(`#picture [data-path="Main/0/1"]`).getAttribute("aria-description")'
        assert page.run(told) == 'writes key step'
        page.until(lambda: 'never read' in page.text('flow'))  # the checker's word for the other key
        page.chord(Keys.SHIFT, Keys.F12)
        page.until(lambda: '2 uses of the blackboard key step' in page.text('choice'))
        page.press(Keys.ESCAPE)
        page.until(lambda: page.run('return document.activeElement.getAttribute("role")') == 'listbox')
        # A file that somebody else has changed: nothing is renamed in any.
        (folder / 'more' / 'count.xml').write_text(COUNT.replace('n :=', 'm :='))
        page.click('Main/0/0')
        page.press(Keys.F2)
        page.until(lambda: page.run('return document.getElementById("choice").open'))
        page.press('Other')
        page.press(Keys.ENTER)
        page.until_told('more/count.xml was changed on disk')
        assert changed_tabs(page) == []


def test_what_is_taken_back_after_a_renaming_was_taken_back_is_of_one_file(
    page: StudioPage, folder: Path, editor: Path | None
) -> None:
    with served(folder, editor) as port:
        page.open(port, 'main.xml', '&node=Main/0/0')
        page.until_selected('Main/0/0')
        page.press(Keys.F2)
        page.until(lambda: page.run('return document.getElementById("choice").open'))
        page.press('Total', Keys.ENTER)
        page.until_sheet('3 edits in 3 files')
        page.press(Keys.ENTER)
        page.until(lambda: len(changed_tabs(page)) == 3)
        page.until_selected('Main/0/0')
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: changed_tabs(page) == [])
        files = ('main.xml', 'mission.yaml', 'more/count.xml')
        for file in files:
            page.tab(file)
            page.write()
            page.chord(Keys.CONTROL, Keys.END)
            page.press('#')
            page.until(page.has_changes)
        page.chord(Keys.CONTROL, 'z')
        page.until(lambda: not page.has_changes())
        assert changed_tabs(page) == ['main.xml', 'mission.yaml']


def test_a_name_that_was_refused_is_entered_again_and_one_that_was_left_is_as_before(
    page: StudioPage, folder: Path
) -> None:
    field = 'document.getElementById("field-its:label")'
    (folder / 'mission.yaml').write_text(MISSION.replace('outcomes: [done,', 'outcomes: [done, Taken,'))
    with served(folder, None) as port:
        page.open(port, 'mission.yaml')
        page.click('/Count')
        page.run(f'{field}.focus(); {field}.select()')
        page.press('Taken', Keys.ENTER)
        page.until_told("'Taken' already")
        page.run('document.getElementById("told").textContent = ""')
        page.press(Keys.ENTER)
        page.until_told("'Taken' already")
        # A tree of several files, whose edits are shown before.
        page.go('more/count.xml')
        page.until_selected('Count')
        page.run('document.getElementById("field-ID").focus(); document.getElementById("field-ID").select()')
        page.press('Total', Keys.ENTER)
        page.until_sheet('3 edits in 3 files')
        page.press(Keys.ESCAPE)
        page.until(lambda: page.run('return document.getElementById("field-ID").value') == 'Count')


def test_histories_are_as_long_as_they_are_told_to_be(page: StudioPage, folder: Path, editor: Path | None) -> None:
    """What was renamed in all files is found by its place in the history of each."""
    with served(folder, editor) as port:
        page.open(port, 'main.xml')
        depths = page.run("""
            const isPlain = Boolean(document.querySelector('#text textarea'));
            const {plainPane} = await import('./plain_text.js');
            const made = isPlain ? plainPane : (await import('./code_text.js')).codePane;
            const buffer = made(document.createElement('div'), {}).buffer('', 'a', 'xml'), depths = [];
            buffer.onchange = () => {};
            for (let step = 1; step <= 2000; step += 1) {
              buffer.apply(['x'], {name: 'typed'});
              if (buffer.depth !== step) depths.push(step);
            }
            return depths;
        """)
        assert depths == []


def test_a_definition_that_cannot_be_asked_for_is_told(page: StudioPage, folder: Path) -> None:
    with served(folder, None) as port:
        page.open(port, 'main.xml', '&node=Main/0/0')
        page.until_selected('Main/0/0')
    page.until_text('link', 'NO SERVER')
    page.press(Keys.F12)
    page.until_told('not connected to the studio')
