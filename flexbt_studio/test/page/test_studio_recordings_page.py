# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in the studio's page: the graphs, the map and the log at a moment, and what was never reached."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from studio_page import StudioPage, held, served

from flexbt_testing.browser import NEEDS_BROWSER

sys.path.insert(0, str(Path(__file__).parents[1]))

from recorded import MACHINE, TREE, installed_project, log, record

pytestmark = NEEDS_BROWSER
ENTER, ESCAPE, LEFT, END = '\ue007', '\ue00c', '\ue012', '\ue010'
_SHOWN = (
    'return Object.fromEntries([...document.querySelectorAll("#picture [data-path]")].flatMap((one) => '
    '[...one.classList].filter((name) => name.startsWith("st-")).map((name) => [one.dataset.path, name.slice(3)])))'
)


def shown(page: StudioPage) -> dict[str, str]:
    """Return the statuses on the graph by path."""
    found: dict[str, str] = page.run(_SHOWN)
    return found


def open_recording(page: StudioPage, name: str) -> None:
    page.run('document.getElementById("recordings-open").click()')
    page.until(lambda: page.focused == 'choice-field')
    page.press(name, ENTER)


def test_a_recording_and_a_log_are_shown_on_the_graphs(page: StudioPage, tmp_path: Path) -> None:
    record(tmp_path / 'recordings' / 'run.mcap')
    (tmp_path / 'drive.xml').write_text(TREE)
    (tmp_path / 'tour.yaml').write_text(MACHINE)
    log(tmp_path, tmp_path / 'recordings' / 'dry.btlog', 'Look=FAILURE', '*=SUCCESS')

    def visible(id: str) -> Any:
        return page.run('return document.getElementById(arguments[0]).checkVisibility()', id)

    with served(tmp_path, None) as port:
        page.open(port, 'drive.xml')
        page.run('document.querySelector("#recordings > summary").click()')
        open_recording(page, 'run.mcap')
        page.until_text('player-title', 'Recording run.mcap')
        page.until_text('player-count', 'of 5.0 s')
        # To the failure: the node, the log and the machine are those of then.
        page.run('document.getElementById("recordings-failure").click()')
        page.until(lambda: shown(page) == {'Drive/0': 'running', 'Drive/0/0': 'failure', 'Drive/0/1': 'running'})
        page.until_text('recordings-log', 'lost the path')
        page.until(lambda: visible('recorded-map'))
        page.run('document.querySelector("#player-lanes .timeline-body").focus()')
        page.press(LEFT)
        page.until(lambda: shown(page) == {'Drive/0': 'running', 'Drive/0/0': 'running'})
        page.until(lambda: 'lost' not in page.text('recordings-log'))
        page.go('tour.yaml')
        page.until(lambda: shown(page) == {'/': 'running', '/Run': 'running'})
        page.run('document.querySelector("#player-lanes .timeline-body").focus()')
        page.press(END)
        page.until(lambda: shown(page) == {'/': 'running', '/Rest': 'running'})
        # What no run has reached is tinted, and nothing can be sent.
        page.run('document.getElementById("tint-dry").click()')
        page.go('drive.xml')
        page.until(lambda: shown(page).get('Drive/0/2') == 'never')
        assert '1 run reached 3 of 4 nodes' in page.text('run-told') or not visible('run-told')
        assert not visible('debug') and not visible('stop')
        page.press(ESCAPE, ESCAPE)
        page.until(lambda: not visible('player'))
        assert not visible('recorded-map')
        # A log plays on the graph of its tree; if the project has another version, on that of the log.
        open_recording(page, 'dry.btlog')
        page.until_text('player-title', 'Log of Drive')
        page.run('document.getElementById("recordings-failure").click()')
        page.until(lambda: shown(page).get('Drive/0/0') == 'failure')
        page.press(ESCAPE)
        page.until(lambda: not visible('player'))
        changed = TREE.replace(
            '<Wait name="Never" wait_duration="1"/>', '<Spin/><Wait name="Never" wait_duration="1"/>'
        )
        page.run(
            'const field = document.querySelector("#text textarea"); field.value = arguments[0];'
            'field.dispatchEvent(new Event("input", {bubbles: true}))',
            changed,
        )
        page.until(lambda: page.run('return document.querySelectorAll("#picture .node").length') == 6)
        open_recording(page, 'dry.btlog')
        page.until_text('tabs', 'recording dry.btlog.xml')
        page.until(lambda: visible('player'))
        page.run('document.getElementById("recordings-failure").click()')
        page.until(lambda: shown(page).get('Drive/0/0') == 'failure')
        page.run('document.getElementById("recordings-open").click()')
        page.until(lambda: page.focused == 'choice-field')
        page.press(ESCAPE)


def test_of_a_log_and_a_recording_the_one_that_was_opened_last_is_shown(
    page: StudioPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record(tmp_path / 'recordings' / 'run.mcap')
    (tmp_path / 'drive.xml').write_text(TREE)
    (tmp_path / 'tour.yaml').write_text(MACHINE)
    log(tmp_path, tmp_path / 'recordings' / 'dry.btlog', '*=SUCCESS')
    with served(tmp_path, None) as port:
        page.open(port, 'tour.yaml')
        page.run('document.querySelector("#recordings > summary").click()')
        with held(monkeypatch, 'tree_log') as asked:
            open_recording(page, 'dry.btlog')
            assert asked.wait(60.0)
            open_recording(page, 'run.mcap')
            page.until_text('player-title', 'Recording run.mcap')
        page.go('drive.xml')  # what is asked for later is answered later
        page.until_selected('Drive')
        page.go('tour.yaml')
        page.until_selected('/')
        assert page.text('player-title') == 'Recording run.mcap'
        with page.emulated(390, 844, mobile=True):
            title = page.driver.find_element('id', 'player-title')
            assert page.run('return arguments[0].scrollWidth <= arguments[0].clientWidth', title)


def test_a_recording_is_decided_again_by_the_open_file(page: StudioPage, tmp_path: Path) -> None:
    name = installed_project(tmp_path)
    with served(tmp_path, None) as port:
        page.open(port, name)
        page.run('document.querySelector("#recordings > summary").click()')
        page.run('document.getElementById("recordings-decide").click()')
        page.until_text('told', 'Open a recording of a robot')
        open_recording(page, 'run.mcap')
        page.until_text('player-title', 'Recording run.mcap')
        page.go(name)
        page.run('document.getElementById("recordings-decide").click()')
        page.until_text('recordings-decided', 'no difference in')
