# SPDX-License-Identifier: BSD-3-Clause
"""The state machine of the run as lines: every active path, time in each state, and what each outcome leads to."""

from __future__ import annotations

from flexbt_console.mirror import ActiveState, AutonomyLevel, Snapshot, StateKind, StateStructure, View
from flexbt_console.pictures import Glyphs, cut, window
from flexbt_console.present import Line, Tone, autonomy_text, not_paused_lines, progress_text, tone_of
from flexbt_core.values import one_line


def machine_lines(view: View, columns: int, rows: int, signs: Glyphs) -> list[str]:
    """The machine in at most so many rows of so many cells, the first active state always among them."""
    snapshot = view.snapshot
    if snapshot is None:
        return []
    states = {state.path: state for state in snapshot.active_states}
    levels = set(view.active_levels)
    if view.structure is None:
        lines = [line for path in view.active_levels for line in _active(path, states.get(path), view, signs)]
    else:
        lines = []
        for state in view.structure.states:
            parent = state.path.rpartition('/')[0] or '/'
            if state.path == '/' or parent in levels:  # what is in a container that is not active is not of now
                lines += _state(state, states, view, signs)
    marked = next((place for place, line in enumerate(lines) if tone_of(line) is Tone.DECISION), 0)
    return [Line(cut(line, columns), tone_of(line)) for line in window(lines, marked, rows)]


def _state(state: StateStructure, states: dict[str, ActiveState], view: View, signs: Glyphs) -> list[str]:
    assert view.snapshot is not None
    if state.path in view.active_levels:
        lines = _active(state.path, states.get(state.path), view, signs)
        if state.kind is StateKind.STATE:
            indent = '  ' * _depth(state.path)
            lines += [f'{indent}  {text}' for text in outcome_texts(state, signs)]
        return lines
    label = one_line(state.path.rpartition('/')[2]) or '/'
    return [Line(f'{"  " * _depth(state.path)}  {label}{_marks(state.path, view.snapshot, signs)}', Tone.DIM)]


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


def _active(path: str, state: ActiveState | None, view: View, signs: Glyphs) -> list[str]:
    snapshot = view.snapshot
    assert snapshot is not None
    indent = '  ' * _depth(path)
    label = one_line(path.rpartition('/')[2]) or one_line(snapshot.behavior) or '/'
    waits = any(decision.path == path for decision in snapshot.decisions)
    sign = signs.waits if waits else signs.active
    marks = _marks(path, snapshot, signs)
    if state is None:
        return [Line(f'{indent}{sign} {label}{marks}', Tone.PLAIN)]
    seconds = max(0.0, snapshot.stamp - state.entered)
    paused = '  PAUSED' if state.paused else ''
    lines: list[str] = [Line(f'{indent}{sign} {label}{marks}  {seconds:.0f} s{paused}', Tone.DECISION)]
    if state.progress is not None and (text := progress_text(state.progress, view.places)):
        lines.append(f'{indent}  {text}')
    lines += [Line(f'{indent}    {line}', tone_of(line)) for line in not_paused_lines(state)]
    return lines


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
