# SPDX-License-Identifier: BSD-3-Clause
"""Trees and map in line mode: what a script and a person get of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from flexbt_console.commands.command_line import check, parse
from flexbt_console.commands.spec import Ask, Inquiry, Reading
from flexbt_console.errors import ConsoleError, NoAnswerError, RefusedError, UsageError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    ActiveState,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    GridMap,
    Surroundings,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, StatusChange, TreeNodes, TreeReport, Trees
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import width
from flexbt_console.present.maps import draw_map, map_image
from flexbt_console.present.style import ASCII, UNICODE, Glyphs, glyphs

RUNNING, FAILURE, IDLE = MirroredStatus.RUNNING, MirroredStatus.FAILURE, MirroredStatus.IDLE
NODES = [
    MirroredNode(1, 0, 'Main', 'Fallback'),
    MirroredNode(2, 1, 'Drive', 'Sequence'),
    MirroredNode(3, 2, 'Plan\x1b[2J', 'ComputePathToPose'),
    MirroredNode(4, 2, 'Follow', 'FollowPath'),
    MirroredNode(5, 1, 'Wait', 'Wait'),
]


class SeenRobot(RobotLink):
    """A robot of which this is known."""

    def __init__(self, view: View) -> None:
        self.view = view

    def surroundings(self, has_arrived: Callable[[View], bool], timeout: float, scan_period: float = 0.0) -> View:
        return self.view


def robot(run_id: str = 't', **around: Any) -> SeenRobot:
    """Return a robot whose tree has recovered from a plan that failed, in a room of 4 x 2 m with a wall along its
    middle."""
    trees = Trees()
    trees.receive_structure(TreeNodes('t', 'Errand', NODES, 1.0))
    changes = [StatusChange(2.0, uid, FAILURE) for uid in (3, 2)] + [StatusChange(3.0, uid, IDLE) for uid in (2, 3)]
    report = TreeReport('t', 1, [RUNNING, IDLE, IDLE, IDLE, RUNNING], changes, 7.0, finished=False, paused=False)
    trees.receive_status(report)
    cells = bytes(100 if column == 20 else 0 for row in range(20) for column in range(40))
    known = {'map': GridMap(40, 20, 0.1, 0.0, 0.0, cells), 'plan': ((0.5, 1.0), (3.5, 1.0)), **around}
    snapshot = ExecutiveSnapshot(
        'e', 1, state=ExecutiveState.RUNNING, active_states=(ActiveState('/Go', tree_run_id=run_id),),
        robot_pose=FramedPose(0.5, 1.0), stamp=7.0,
    )  # fmt: skip
    places = {'kitchen': FramedPose(3.0, 1.5)}
    return SeenRobot(View(LinkState.LIVE, 0.1, '', snapshot, None, places=places, has_places=True,
                          trees=trees.runs(), surroundings=Surroundings(**known)))  # fmt: skip


def shown(seen: SeenRobot, *words: str) -> Reading:
    """Return the answer of a command."""
    line = parse(words)
    check(line)
    assert isinstance(line.spec.action, Ask)
    return line.spec.action.ask(line, Inquiry(seen, 5.0, print, None, lambda state, things: []))


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({}, UNICODE),  # as of a container, whose terminal is UTF-8
        ({'LANG': 'de_DE.UTF-8'}, UNICODE),
        ({'LANG': 'C'}, ASCII),
        ({'LANG': 'C', 'LC_CTYPE': 'C.UTF-8'}, ASCII),  # as Python has changed it
        ({'LANG': 'C', 'LC_CTYPE': 'de_DE.UTF-8'}, UNICODE),
        ({'LANG': 'C', 'LC_ALL': 'C.UTF-8'}, UNICODE),
        ({'LANG': 'de_DE.UTF-8', 'LC_ALL': 'POSIX'}, ASCII),
        ({'LANG': 'de_DE.UTF-8', 'TERM': 'vt100'}, ASCII),
        ({'FLEXBT_ASCII': '1'}, ASCII),
    ],
)
def test_what_the_terminal_has_no_signs_for_is_drawn_in_ascii(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], expected: Glyphs
) -> None:
    for name in ('LANG', 'LC_ALL', 'LC_CTYPE', 'FLEXBT_ASCII'):
        monkeypatch.delenv(name, raising=False)
    for name, value in {'TERM': 'xterm', **given}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr('locale.getpreferredencoding', lambda do_setlocale: 'UTF-8')
    assert glyphs() is expected


def test_a_tree_is_shown_with_the_reasons_of_what_has_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('FLEXBT_ASCII', '1')
    answer = shown(robot(), 'tree')
    assert answer.text == [
        'tree Errand  running',
        '> Main (Fallback)  6 s',
        '  x Drive (Sequence)  FAILURE',
        '    x Plan\\e[2J (ComputePathToPose)  FAILURE',
        '    . Follow (FollowPath)',
        '  > Wait  6 s',
        'failed: Plan\\e[2J, and so Drive',
    ]
    (tree,) = answer.value
    assert tree['acting'] == (5,) and tree['failures'] == [[3, 2]] and tree['nodes'][2]['last'] is FAILURE


def test_no_tree_and_a_tree_that_is_not_heard_are_two_things() -> None:
    with pytest.raises(NoAnswerError, match='BT server'):
        shown(robot(run_id='another'), 'tree')
    nodes_only = Trees()
    nodes_only.receive_structure(TreeNodes('t', 'Errand', NODES, 1.0))
    with pytest.raises(NoAnswerError, match='BT server'):  # what its nodes do has not arrived
        shown(SeenRobot(dataclasses.replace(robot().view, trees=nodes_only.runs())), 'tree')
    nothing = robot(run_id='')
    with pytest.raises(RefusedError, match='no tree has run'):
        shown(SeenRobot(dataclasses.replace(nothing.view, trees=())), 'tree')


def test_a_map_is_lines_json_or_an_image(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv('FLEXBT_ASCII', '1')
    answer = shown(robot(), 'map', '--size', '40x12')
    text = '\n'.join(answer.text)
    assert text.isascii() and len(answer.text) == 12 and '@kitchen' in text and 'plan 3.0 m' in text
    assert sum('#' in line for line in answer.text) == 9 and any(line.startswith('     >...') for line in answer.text)
    assert answer.value['goal'] == (3.5, 1.0) and answer.value['map']['width'] == 40
    file = tmp_path / 'map'
    assert shown(robot(scan=((1.0, 0.3),)), 'map', '--png', str(file), '--scan').value['file'] == str(file)
    with Image.open(file) as image:
        assert image.format == 'PNG' and abs(image.width - 2 * image.height) <= 4
        pixels = [
            image.getpixel((image.width * x // 40, image.height * y // 20)) for x, y in ((20, 2), (30, 2), (20, 10))
        ]
        assert pixels[0] == (40, 40, 40) and pixels[1] == (255, 255, 255)  # the wall, and beside it
        assert pixels[2] == (0, 0x72, 0xB2)  # the plan leads through it
        assert image.getpixel((image.width * 10 // 40, image.height * 17 // 20)) == (0xD5, 0x5E, 0)


@pytest.mark.parametrize(('columns', 'resolution'), [(3600, 0.05), (90, 1e-6)])
def test_of_several_cells_in_a_pixel_the_darkest_counts(columns: int, resolution: float) -> None:
    """Also of a map whose cells are so small that all of it is a pixel."""
    row = bytearray(columns)
    row[columns // 2] = 100
    image = map_image(robot(map=GridMap(columns, 300, resolution, 0.0, 0.0, bytes(row) * 300), plan=()).view)
    dark = [place for place in range(image.width) if image.getpixel((place, image.height // 2)) == (40, 40, 40)]
    assert len(dark) == 1


@pytest.mark.parametrize('size', ['80', '80x', 'x24', '7x24', '80x3', '1001x24', '8ex24', '²0x24', '9' * 10**6])
def test_a_size_that_is_none_is_refused(size: str) -> None:
    with pytest.raises(UsageError) as refused:
        shown(robot(), 'map', f'--size={size}')
    assert len(str(refused.value)) < 200


def test_a_file_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    for file in (tmp_path, tmp_path / 'no' / 'map.png', Path('x' * 5000)):
        with pytest.raises(ConsoleError, match='cannot be written'):
            shown(robot(), 'map', '--png', str(file))


def seen(grid: GridMap, pose: FramedPose | None, places: dict[str, FramedPose]) -> View:
    """Return the picture of a robot on a map."""
    snapshot = ExecutiveSnapshot('e', 1, robot_pose=pose)
    return View(LinkState.LIVE, 0.1, snapshot=snapshot, places=places, surroundings=Surroundings(map=grid))


def test_names_of_places_cover_neither_each_other_nor_their_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('FLEXBT_ASCII', '1')
    names = {'alpha_dock': 1.0, 'archive_door': 1.9, 'beta_dock': 2.6, 'lobby': 3.4}
    places = {name: FramedPose(x, 1.0) for name, x in names.items()}
    grid = GridMap(80, 40, 0.05, 0.0, 0.0, bytes(3200))
    for columns in (24, 32, 60):
        _, cells = draw_map(seen(grid, None, places), None, columns, 12, ASCII)
        drawn = [''.join(sign for sign, _ in row) for row in cells]
        assert sum(line.count('@') for line in drawn) == 4
        words = [word for line in drawn for word in line.replace('@', ' ').split()]
        assert all(any(name.startswith(word.rstrip('~')) for name in names) for word in words), drawn
        assert columns < 60 or sorted(words) == sorted(names)


def test_a_wide_name_takes_its_cells_and_what_is_drawn_over_half_of_a_character_takes_all_of_it() -> None:
    grid = GridMap(80, 40, 0.05, 0.0, 0.0, bytes(3200))
    for robot_x, expected in ((None, '◦厨房 '), (2.15, '◦→ 房'), (2.25, '◦ →房')):
        pose = FramedPose(robot_x, 1.0) if robot_x is not None else None
        places = {'厨房': FramedPose(2.0, 1.0)}
        _, cells = draw_map(seen(grid, pose, places), None, 40, 10, UNICODE)
        drawn = [''.join(sign for sign, _ in row) for row in cells]
        assert all(width(line) == 40 for line in drawn), drawn
        assert any(expected in line for line in drawn), drawn
