# SPDX-License-Identifier: BSD-3-Clause
"""Layouts of machines: what is drawn has its place, and covers nothing else."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbt_studio.documents.project import Project
from flexbt_studio.server.layouts import Layouts

DEMOS = Path(__file__).parents[2] / 'flexbt_demo_behaviors' / 'flexbt_demo_behaviors'
LETTER, BLANK, HEIGHT = 7.2, 8.0, 18.0
"""Width of a letter of an outcome, of what is around it, and height of its label, as the page draws them, pixels."""


@pytest.fixture(scope='module')
def layouts() -> Iterator[Layouts]:
    made = Layouts()
    yield made
    made.close()


def test_ctrl_c_in_the_terminal_is_not_for_the_worker_and_what_is_closed_starts_no_more() -> None:
    program = """
import os, signal
from flexbt_studio.worker import Worker
signal.signal(signal.SIGINT, lambda *_: None)
worker = Worker('flexbt_studio.server.layout_worker')
worker.start()
os.killpg(0, signal.SIGINT)
print(*worker.ask({'dot': 'digraph {}'}, 60.0))
worker.close()
try:
    worker.start()  # as another thread that was about to
except OSError as error:
    print(error)
"""
    command = [sys.executable, '-c', program]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, start_new_session=True)
    assert (ran.stdout, ran.stderr) == ('layout\nthe studio ends\n', '')


@pytest.mark.parametrize(
    'file',
    ['mission_night/check_room.yaml', 'night_watch/behavior.py', 'inspection/behaviors.py', 'navigate/behaviors.py'],
)
def test_labels_are_within_their_container_and_cover_no_state(layouts: Layouts, file: str) -> None:
    states: list[dict[str, Any]] = Project(DEMOS).document(file).view()['states']
    made = layouts.machine(states, [])
    parents = {state['path']: state['parent'] for state in states}
    labels = 0
    for edge in made['edges']:
        if edge['label'] is None:
            continue
        labels += 1
        x, y = edge['label']
        width = LETTER * len(edge['outcome']) + BLANK
        box = [x - width / 2, y - HEIGHT / 2, width, HEIGHT]
        left, top, wide, high = made['states'][edge['in']]
        assert left <= box[0] and box[0] + box[2] <= left + wide and top <= box[1] and box[1] + box[3] <= top + high
        beside = [made['states'][path] for path, parent in parents.items() if parent == edge['in']]
        covered = [one for one in (*beside, *made['ends'][edge['in']].values()) if _overlap(one, box)]
        assert not covered, (edge['from'], edge['outcome'], box, covered)
    assert labels == sum(len(one['transitions']) for one in states if one['path'] in made['states'])


def test_an_outcome_of_any_name_has_its_arrow(layouts: Layouts) -> None:
    outcomes = ['größe→😀', 'a\\', 'say "no"', '\\n', '<b>', 'a/b', '&amp;']
    ways = [{'outcome': outcome, 'target': outcome} for outcome in outcomes]
    root = {'path': '/', 'parent': None, 'kind': 'machine', 'label': '', 'type': '', 'outcomes': outcomes}
    child = {'path': '/A', 'parent': '/', 'kind': 'state', 'label': 'A', 'type': 'S', 'transitions': ways}
    edges = layouts.machine([root, child], [])['edges']
    assert sorted(one['outcome'] for one in edges) == sorted(['', *outcomes])  # '' is the entry


def _overlap(one: list[float], other: list[float]) -> bool:
    return all(one[at] < other[at] + other[at + 2] and other[at] < one[at] + one[at + 2] for at in (0, 1))
