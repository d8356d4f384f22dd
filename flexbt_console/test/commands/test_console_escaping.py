# SPDX-License-Identifier: BSD-3-Clause
"""Nothing that comes over the network acts on the terminal."""

from __future__ import annotations

import json
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    ActiveState,
    Behavior,
    BehaviorParameter,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    LogLine,
    LogSeverity,
    Peer,
    StateStructure,
    Structure,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, cut_middle, fold
from flexbt_console.present.json_form import encode_json, status_json
from flexbt_console.present.rendering import behaviors_lines, log_lines, status_lines, structure_lines
from flexbt_console.ui.line.toolbar import toolbar
from flexbt_core.values.text import escape_lines, one_line

HOSTILE = st.one_of(
    st.text(max_size=30),
    st.text(st.characters(categories=['Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp', 'Zs', 'Mn']), max_size=10),
    st.binary(max_size=30).map(lambda data: data.decode('latin-1')),
    st.sampled_from(['\x1b]0;pwned\x07', '\x1b[2J', '\x9b31m', 'a\rb', '‮evil', '\x1b[6n', '[bold]x[/]', '<b>x</b>']),
)


def harmless(text: str) -> bool:
    """Return whether a terminal shows exactly these characters."""
    return all(unicodedata.category(character) not in ('Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp') for character in text)


@given(HOSTILE)
def test_one_line_is_harmless_and_keeps_plain_text(text: str) -> None:
    shown = one_line(text)
    assert harmless(shown)
    if text.isascii() and text.isprintable():
        assert shown == text


@given(HOSTILE, st.integers(0, 20))
def test_width_is_kept(text: str, width: int) -> None:
    assert len(one_line(text, width)) <= width


@pytest.mark.parametrize('code', range(256))
def test_every_byte(code: int) -> None:
    assert harmless(one_line(chr(code)))


def test_of_a_huge_text_the_begin_is_shown_and_the_rest_counted() -> None:
    shown = one_line('\x1b' * 10_000_000)
    assert shown.startswith('\\e\\e') and shown.endswith('… (9980000 more characters)') and len(shown) < 50_000
    assert one_line('x' * 20_000) == 'x' * 20_000 and one_line('\n' * 10_000_000, 4) == '\\n\\…'


def test_stacked_marks_are_cut_off() -> None:
    shown = one_line('a' + '̀' * 50)
    assert sum(unicodedata.category(character) == 'Mn' for character in shown) == 3


def test_many_lines_are_cut() -> None:
    assert len(escape_lines('x\n' * 1000)) == 51


def hostile_view(text: str) -> View:
    decisions = (
        Decision(text, DecisionKind.TRANSITION, text, text, (text, 'x'), 2, text),
        Decision(text, DecisionKind.INPUT, text, prompt=text, input_type=text, input_choices=(text,)),
        Decision(text, DecisionKind.CHOICE, text, '', (text,)),
    )
    snapshot = ExecutiveSnapshot(
        text,
        1,
        state=ExecutiveState.RUNNING,
        run_id=text,
        behavior=text,
        outcome=text,
        message=text,
        active_states=(ActiveState(text, 0.0, (text, text), True, (text,)),),
        decisions=decisions,
        peers=(Peer(text, False, problem=text), Peer(text, True, late=True, age=float('nan'), problem=text)),
        robot_pose=FramedPose(float('nan'), float('inf'), 0.0, text),
        authority=text,
    )
    structure = Structure(
        text, text, (StateStructure(text, type=text, outcomes=(text,), targets=(text,), autonomy=(1,)),)
    )
    reasons = {text: LogLine('e', 1, LogSeverity.ERROR, text, text)}
    return View(LinkState.LIVE, 0.1, text, snapshot, structure, reasons=reasons)


@given(HOSTILE)
def test_every_view_is_harmless(text: str) -> None:
    view = hostile_view(text)
    assert view.structure is not None
    shown = status_lines(view)
    shown += structure_lines(view.structure, view)
    shown += behaviors_lines([Behavior(text, text, text, text, (BehaviorParameter(text, text, text),), text)])
    shown += log_lines(LogLine('e', 1, text=text, path=text))
    shown += [line for _, line in toolbar(view, 80, 20)]
    shown.append(encode_json(status_json(view)))
    for line in shown:
        assert harmless(line), line
    json.loads(shown[-1])


@given(HOSTILE, st.integers(1, 60), st.integers(1, 8))
def test_what_is_folded_or_cut_fits_and_keeps_its_ends(text: str, cells: int, rows: int) -> None:
    folded = fold(text, cells, rows)
    assert 1 <= len(folded) <= rows
    for part in (*folded, cut_middle(text, cells)):
        assert cut(part, cells) == part
    assert cut_middle('/Mission/Area 51/Search/Drive', 16) == '/Miss…arch/Drive'
    assert fold('one two three four', 10, 9, ' ') == ['one two', ' three', ' four']
    assert fold('one two three four', 10, 2, ' ') == ['one two', ' three fo…']


def test_a_word_that_is_longer_than_a_row_is_folded_too() -> None:
    indent = ' ' * 11
    assert fold('key        ' + 'X' * 25, 20, 9, indent) == [
        'key        XXXXXXXXX',
        f'{indent}XXXXXXXXX',
        f'{indent}XXXXXXX',
    ]
    assert fold('厨房' * 4, 10, 9, ' ' * 6) == ['厨房厨房厨', '      房厨', '      房']


@given(st.text(), st.integers(1, 200), st.integers(1, 30))
def test_the_toolbar_fits_into_any_terminal(text: str, width: int, height: int) -> None:
    shown = toolbar(hostile_view(text), width, height)
    assert 1 <= len(shown) <= height
    for _, line in shown:
        assert sum(2 if unicodedata.east_asian_width(c) in 'WF' else 1 for c in line if c not in '̀') <= 2 * width
        assert cut(line, width) == line
