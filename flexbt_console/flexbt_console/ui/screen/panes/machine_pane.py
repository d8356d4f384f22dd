# SPDX-License-Identifier: BSD-3-Clause
"""The state machine of the run on the screen: every active path, time in each state, what each outcome leads to; and
the trees that run."""

from __future__ import annotations

import sys
from enum import IntEnum
from typing import NamedTuple

from rich.text import Text

from flexbt_console.mirror import ActiveState, AutonomyLevel, Snapshot, StateKind, StateStructure, View
from flexbt_console.pictures import Glyphs, cut, cut_middle, tree_lines, window
from flexbt_console.present import Line, Tone, autonomy_text, not_paused_lines, progress_text, tone_of
from flexbt_core.values import one_line

from .pane import styled


class _Rank(IntEnum):
    """What a line tells: where there is little room, the last ones are left out first."""

    ACTIVE = 0
    OUTCOME_OF_FIRST = 1
    OUTCOME = 2
    NOT_ACTIVE = 3


class _Ranked(NamedTuple):
    rank: _Rank
    path: str
    line: str


class MachinePane:
    """Draws machine and trees: what is of now, as much as there is room for, or all of it from where it was scrolled
    to."""

    def __init__(self, signs: Glyphs) -> None:
        self._signs = signs
        self._from: int | None = None
        self._page = 1

    def scroll(self, pages: int) -> None:
        """Show all of it, so many pages farther down."""
        self._from = max(0, (self._from or 0) + pages * self._page)

    def follow(self) -> None:
        """Show what is of now."""
        self._from = None

    def draw(self, view: View, columns: int, rows: int, nothing: str) -> Text:
        """In so many rows of so many cells; ``nothing`` is what is told while no behavior runs."""
        self._page = max(1, rows - 1)
        shown = self._all(view, columns, rows) if self._from is not None else self._of_now(view, columns, rows)
        if not shown and view.snapshot is not None and not view.running:
            shown = [Line(nothing, Tone.DIM)]
        text = styled(shown)
        if not view.live:
            text.stylize('dim')
        return text

    def _all(self, view: View, columns: int, rows: int) -> list[str]:
        lines = machine_lines(view, columns, sys.maxsize, self._signs) if view.running else []
        for run in view.drawn_trees:
            lines += tree_lines(run, columns, sys.maxsize, self._signs)
        self._from = min(self._from or 0, max(0, len(lines) - self._page))
        left = len(lines) - self._from - self._page
        told = f'  ({self._from} above, {max(0, left)} below; Esc: what is active)'
        return [*lines[self._from :][: self._page], Line(cut(told, columns), Tone.DIM)]

    def _of_now(self, view: View, columns: int, rows: int) -> list[str]:
        trees = view.drawn_trees
        shown = machine_lines(view, columns, rows, self._signs) if view.running else []
        room = max(4, rows // 2, rows - sum(len(run.nodes) + 1 for run in trees))
        if len(shown) > room:
            shown = machine_lines(view, columns, room, self._signs)
        for number, run in enumerate(trees):
            left = rows - len(shown)
            shown += tree_lines(run, columns, left // (len(trees) - number), self._signs)
        return shown


def machine_lines(view: View, columns: int, rows: int, signs: Glyphs) -> list[str]:
    """The machine in at most so many rows of so many cells. Where it does not fit: what is active, and what the state
    that waits, or else the first active one, leads to; that state is always among the lines.
    """
    snapshot = view.snapshot
    if snapshot is None:
        return []
    states = {state.path: state for state in snapshot.active_states}
    first = view.decision.path if view.decision else next(iter(view.active_paths), '')
    levels = set(view.active_levels)
    if view.structure is None:
        ranked = [line for path in view.active_levels for line in _active(path, states.get(path), view, signs)]
    else:
        ranked = []
        for state in view.structure.states:
            parent = state.path.rpartition('/')[0] or '/'
            if state.path == '/' or parent in levels:  # what is in a container that is not active is not of now
                rank = _Rank.OUTCOME_OF_FIRST if state.path == first else _Rank.OUTCOME
                ranked += _state(state, states, view, signs, rank, is_active=state.path in levels)
    for last in (_Rank.NOT_ACTIVE, _Rank.OUTCOME):
        if len(ranked) > rows:
            ranked = [one for one in ranked if one.rank < last]
    marked = next((place for place, one in enumerate(ranked) if one.path == first), 0)
    # Of what is active the end tells for how long, and what is special about it.
    shown = [
        Line(cut_middle(one.line, columns), tone_of(one.line)) if one.rank is _Rank.ACTIVE else one.line
        for one in ranked
    ]
    return [Line(cut(line, columns), tone_of(line)) for line in window(shown, marked, rows)]


def _state(
    state: StateStructure, states: dict[str, ActiveState], view: View, signs: Glyphs, rank: _Rank, *, is_active: bool
) -> list[_Ranked]:
    assert view.snapshot is not None
    path = state.path
    if is_active:
        lines = _active(path, states.get(path), view, signs)
        if state.kind is StateKind.STATE:
            indent = '  ' * _depth(path)
            lines += [_Ranked(rank, path, f'{indent}  {text}') for text in outcome_texts(state, signs)]
        return lines
    label = one_line(path.rpartition('/')[2]) or '/'
    line = Line(f'{"  " * _depth(path)}  {label}{_marks(path, view.snapshot, signs)}', Tone.DIM)
    return [_Ranked(_Rank.NOT_ACTIVE, path, line)]


def outcome_texts(state: StateStructure, signs: Glyphs) -> list[str]:
    """Each outcome with what it leads to, and the level of autonomy that it requires."""
    texts = []
    for number, outcome in enumerate(state.outcomes):
        level = state.autonomy[number] if number < len(state.autonomy) else -1
        above = 'always you' if level >= AutonomyLevel.FULL else f'above {autonomy_text(level)}'
        needs = f'  ({above})' if level >= 0 else ''
        texts.append(f'{one_line(outcome)}{leads_text(state, number, signs)}{needs}')
    return texts


def leads_text(state: StateStructure, number: int, signs: Glyphs) -> str:
    """What an outcome leads to, by its number from 0 on; '' where that is not known."""
    target = state.targets[number] if number < len(state.targets) else ''
    return f' {signs.arrow} {one_line(target.rpartition("/")[2] or target)}' if target else ''


def _active(path: str, state: ActiveState | None, view: View, signs: Glyphs) -> list[_Ranked]:
    snapshot = view.snapshot
    assert snapshot is not None
    indent = '  ' * _depth(path)
    label = one_line(path.rpartition('/')[2]) or one_line(snapshot.behavior) or '/'
    waits = any(decision.path == path for decision in snapshot.decisions)
    sign = signs.waits if waits else signs.active
    marks = _marks(path, snapshot, signs)
    if state is None:
        return [_Ranked(_Rank.ACTIVE, path, Line(f'{indent}{sign} {label}{marks}', Tone.PLAIN))]
    seconds = max(0.0, snapshot.stamp - state.entered)
    paused = '  PAUSED' if state.paused else ''
    lines: list[str] = [Line(f'{indent}{sign} {label}{marks}  {seconds:.0f} s{paused}', Tone.DECISION)]
    if state.progress is not None and (text := progress_text(state.progress, view.places)):
        lines.append(f'{indent}  {text}')
    lines += [f'{indent}    {one_line(text)}' for text in view.own_activity(state)]
    lines += [Line(f'{indent}    {line}', tone_of(line)) for line in not_paused_lines(state)]
    return [_Ranked(_Rank.ACTIVE, path, line) for line in lines]


def _marks(path: str, snapshot: Snapshot, signs: Glyphs) -> str:
    level = next((level for at, level in snapshot.autonomy_levels if at == path), None)
    return ''.join(
        (
            f' {signs.locked} locked' if path in snapshot.locked else '',
            f' {signs.breakpoint} breakpoint' if path in snapshot.breakpoints else '',
            f' autonomy {autonomy_text(level)}' if level is not None else '',
        )
    )


def _depth(path: str) -> int:
    return 0 if path == '/' else path.count('/')
