# SPDX-License-Identifier: BSD-3-Clause
"""The panes of one robot: state machine, map and log.

The state machine of the run on the screen: every active path, time in each state, what each outcome leads to; and
the trees that run.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import Final, NamedTuple

from rich.text import Text

from flexbt_console.errors import RefusedError
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    Decision,
    ExecutiveSnapshot,
    StateKind,
    StateStructure,
    Transition,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, cut_middle, fold
from flexbt_console.present.debugging import marks_of_nodes
from flexbt_console.present.maps import Frame, draw_map, where_text
from flexbt_console.present.queue import queue_lines, queue_summary
from flexbt_console.present.rendering import (
    autonomy_needed,
    autonomy_text,
    event_line,
    log_lines,
    not_paused_lines,
    progress_text,
    stamp_text,
)
from flexbt_console.present.style import Glyphs, Line, Tone, toned
from flexbt_console.present.tree_lines import tree_lines, window
from flexbt_core.values.text import one_line

from .pane import drawn, styled


class _Rank(IntEnum):
    """The parts of a line. If space is short, the last ones are omitted first."""

    ACTIVE = 0
    OUTCOME_OF_FIRST = 1
    OUTCOME = 2
    NOT_ACTIVE = 3


class _Ranked(NamedTuple):
    rank: _Rank
    path: str
    line: str


class MachinePane:
    """A pane that draws machine and trees: the current part, as much as fits, or all of it from the scroll position."""

    def __init__(self, signs: Glyphs) -> None:
        self._signs = signs
        self._from: int | None = None
        self._page = 1

    def scroll(self, pages: int) -> None:
        """Show the whole tree, this many pages farther down."""
        self._from = max(0, (self._from or 0) + pages * self._page)

    def follow(self) -> None:
        """Show the current part again."""
        self._from = None

    def draw(self, view: View, columns: int, rows: int, nothing: str) -> Text:
        """Return the pane in this many rows of this many cells; ``nothing`` is shown while no behavior runs."""
        self._page = max(1, rows - 1)
        queue = queue_summary(view)
        room = rows - bool(queue)
        shown = self._all(view, columns, room) if self._from is not None else self._of_now(view, columns, room)
        if view.snapshot is not None and not view.running:
            shown = shown or [Line(nothing, Tone.DIM)]
            if queue and view.queue is not None and len(shown) < room:
                shown += [
                    toned(cut(line, columns), line)
                    for line in queue_lines(view.queue, view.places)[: rows - len(shown)]
                ]
                queue = ''
        if queue:
            shown.append(toned(cut(f'queue: {queue}', columns), queue))
        text = styled(shown)
        if not view.live:
            text.stylize('dim')
        return text

    def _all(self, view: View, columns: int, rows: int) -> list[str]:
        lines = machine_lines(view, columns, sys.maxsize, self._signs) if view.running else []
        for run in view.drawn_trees:
            lines += tree_lines(run, columns, sys.maxsize, self._signs, marks_of_nodes(view.snapshot, run))
        self._from = min(self._from or 0, max(0, len(lines) - self._page))
        left = len(lines) - self._from - self._page
        position = f'  ({self._from} above, {max(0, left)} below; Esc: what is active)'
        return [*lines[self._from :][: self._page], Line(cut(position, columns), Tone.DIM)]

    def _of_now(self, view: View, columns: int, rows: int) -> list[str]:
        trees = view.drawn_trees
        shown = machine_lines(view, columns, rows, self._signs) if view.running else []
        room = max(4, rows // 2, rows - sum(len(run.nodes) + 1 for run in trees))
        if len(shown) > room:
            shown = machine_lines(view, columns, room, self._signs)
        for number, run in enumerate(trees):
            left = rows - len(shown)
            share = left // (len(trees) - number)
            shown += tree_lines(run, columns, share, self._signs, marks_of_nodes(view.snapshot, run))
        return shown


def machine_lines(view: View, columns: int, rows: int, signs: Glyphs) -> list[str]:
    """Return the machine in at most this many rows of this many cells. If it does not fit, show active states, and the
    targets of the waiting state, or else of the first active one, whose line is always included.
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
    # Cut active lines in the middle: their end has the time and remarks.
    shown = [cut_middle(one.line, columns) if one.rank is _Rank.ACTIVE else one.line for one in ranked]
    return [cut(line, columns) for line in window(shown, marked, rows)]


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
    """Return each outcome with its target, and the level of autonomy that it requires."""
    texts = []
    for one in state.transitions:
        needs = f'  ({autonomy_needed(one.autonomy)})' if one.autonomy >= 0 else ''
        texts.append(f'{one_line(one.outcome)}{leads_text(one, signs)}{needs}')
    return texts


def leads_text(one: Transition | None, signs: Glyphs) -> str:
    """Return the target of a transition; '' if it is not known."""
    return f' {signs.arrow} {one_line(one.target.rpartition("/")[2] or one.target)}' if one and one.target else ''


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
    lines += [toned(f'{indent}    {line}', line) for line in not_paused_lines(state)]
    return [_Ranked(_Rank.ACTIVE, path, line) for line in lines]


def _marks(path: str, snapshot: ExecutiveSnapshot, signs: Glyphs) -> str:
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


# The map on the screen, and the cursor on it by which a pose is answered.

CURSOR_STEPS: Final = {'left': (-1, 0), 'right': (1, 0), 'up': (0, -1), 'down': (0, 1)}
CURSOR_TURNS: Final = {'less_than_sign': math.tau / 16.0, 'greater_than_sign': -math.tau / 16.0}


LEAST_COLUMNS: Final = 8
LEAST_ROWS: Final = 3


class MapPane:
    """A pane that draws the map. The cursor belongs to one decision, and disappears with it."""

    def __init__(self, signs: Glyphs) -> None:
        self._signs = signs
        self._frame: Frame | None = None
        self._cursor: tuple[float, float] | None = None
        self._yaw = 0.0
        self._is_aimed = False
        self._decision = ''
        self._drawn: tuple[object, Text] | None = None

    @property
    def is_pointing(self) -> bool:
        """True while the cursor is shown."""
        return self._cursor is not None

    @property
    def is_aimed(self) -> bool:
        """Return whether the cursor was moved or turned."""
        return self._cursor is not None and self._is_aimed

    def point(self, view: View) -> None:
        """Put the cursor at the robot, for the pending decision. Requires a map."""
        robot = view.robot_pose
        if self._frame is None:  # it is hidden, and is drawn now
            self.draw(view, 2 * LEAST_COLUMNS, 2 * LEAST_ROWS)
        assert self._frame is not None and view.decision is not None
        middle = self._frame.centre(self._frame.columns // 2, self._frame.rows // 2)
        self._cursor = (robot.x, robot.y) if robot is not None else middle
        self._yaw = robot.yaw if robot is not None else 0.0
        self._is_aimed = False
        self._decision = view.decision.id

    def move(self, key: str) -> bool:
        """Move or turn the cursor by a key of the tables above; False while there is none."""
        if self._cursor is None or self._frame is None:
            return False
        if key in CURSOR_STEPS:
            across, down = CURSOR_STEPS[key]
            x, y = self._cursor
            self._cursor = x + across * 2.0 * self._frame.step, y - down * 4.0 * self._frame.step
        else:
            self._yaw = math.remainder(self._yaw + CURSOR_TURNS[key], math.tau)
        self._is_aimed = True
        return True

    def leave(self) -> None:
        """Remove the cursor."""
        self._cursor = None

    def lose(self, view: View) -> bool:
        """Remove the cursor if its decision is not the first one any more; return whether it was removed."""
        if self._cursor is None or (view.decision is not None and view.decision.id == self._decision):
            return False
        self._cursor = None
        return True

    def answer(self, view: View) -> tuple[str, Decision | None]:
        """Remove the cursor; return its pose, and the decision that it answers, None when that has ended.

        Raises:
            RefusedError: the cursor was neither moved nor turned.
        """
        assert self._cursor is not None
        if not self._is_aimed:
            raise RefusedError('the cursor was not moved yet: arrows move it, < > turn it; nothing was sent')
        text = f'{self._cursor[0]:.3f} {self._cursor[1]:.3f} {self._yaw:.3f}'
        self._cursor = None
        return text, view.pending(self._decision)

    def draw(self, view: View, columns: int, rows: int) -> Text:
        """Return the map in this many rows of this many cells; the last row shows the place of the robot, or of the
        cursor."""
        room = rows - 1
        if columns < LEAST_COLUMNS or room < LEAST_ROWS:
            return Text('')
        shown = view.drawn, view.robot_pose, view.places, self._cursor, columns, room
        if self._drawn is None or self._drawn[0] != shown:
            self._frame, cells = draw_map(view, self._cursor, columns, room, self._signs)
            self._drawn = shown, drawn(cells)
        text = self._drawn[1].copy()
        if self._cursor is not None:
            where = f'cursor x {self._cursor[0]:.2f} y {self._cursor[1]:.2f} yaw {self._yaw:.2f}'
        else:
            where = where_text(view)
        text.append('\n' + cut(where, columns), 'bold' if self._cursor is not None else '')
        if not view.live:
            text.stylize('dim')
        return text


# The log on the screen: lines of states, transitions, commands of all operators, and lines of the console itself.

TOLD_LINES: Final = 200
"""Maximum number of lines of the console itself that are remembered."""

SET_BACK_SECONDS: Final = 10.0
"""Time by which a line is later than the next one, or than now, if the clock was set back in between, s."""

_INDENT: Final = ' ' * 12


class LogPane:
    """A pane with the latest lines of the log, or a fixed part when it is scrolled back. ``operator`` is the user of
    this screen, whose own commands are reported elsewhere."""

    def __init__(self, operator: str | None) -> None:
        self._operator = operator
        self._told: deque[tuple[float, str]] = deque(maxlen=TOLD_LINES)
        self._held: list[str] = []
        self._back = 0
        self._page = 1

    @property
    def told(self) -> list[str]:
        """Lines of the console itself, the latest last."""
        return [line for _, line in self._told]

    def tell(self, stamp: float, text: Iterable[str]) -> None:
        """Add lines of the console itself, reported at this time of the robot's clock, s."""
        self._told.extend((stamp, line) for line in text)

    def scroll(self, mirror: Mirror, pages: int) -> None:
        """Scroll back by this many pages, or forward, to its end at most."""
        held = self._held or self._lines(mirror, sys.maxsize)
        self._back = min(max(0, self._back + pages * self._page), max(0, len(held) - self._page))
        self._held = held if self._back else []

    def moved(self) -> None:
        """Show another robot from now on."""
        self._told.clear()
        self.follow()

    def follow(self) -> None:
        """Show the latest lines again."""
        self._held, self._back = [], 0

    def draw(self, mirror: Mirror, columns: int, rows: int) -> Text:
        """Return the lines by their times in this many rows. One that is too long takes more of them, at most half of
        all."""
        shown, last = self._lines(mirror, rows), list[str]()
        if self._held:
            new = '; there is something new' * (shown[-1:] != self._held[-1:])
            shown = self._held[: -self._back]
            last = [Line(cut(f'  ({self._back} below{new}; Esc: the latest)', columns), Tone.DIM)]
        rows = max(1, rows - len(last))
        self._page = max(1, rows - 1)
        folded = [row for line in shown[-rows:] for row in fold(line, columns, -(-rows // 2), _INDENT)]
        return styled([*folded[-rows:], *last])

    def _lines(self, mirror: Mirror, count: int) -> list[str]:
        """Return the latest lines, up to this many of each kind; results of one's own commands were shown already."""
        events = [one for one in mirror.events(max(1, count)) if one.operator != self._operator and not one.is_in_log]
        snapshot = mirror.view().snapshot
        now = snapshot.stamp if snapshot is not None else math.inf
        merged = [
            *_in_order(((line.stamp, log_lines(line, with_time=True)) for line in mirror.log(max(1, count))), now, 0),
            *_in_order(((event.stamp, [event_line(event, with_time=True)]) for event in events), now, 0),
            *_in_order(((stamp, [_with_time(stamp, line)]) for stamp, line in self._told), now, 1),
        ]
        merged.sort(key=lambda one: one[0])
        return [line for _, text in merged[-max(1, count) :] for line in text]


def _in_order(
    lines: Iterable[tuple[float, Sequence[str]]], now: float, kind: int
) -> list[tuple[tuple[int, float, int], Sequence[str]]]:
    """Return lines, which are in their order, with what they are sorted by: their time, of those before the clock was
    set back (a simulation that began anew) below that of all later ones."""
    found, clock, later = [], 0, now
    for stamp, text in reversed([*lines]):
        clock -= stamp > later + SET_BACK_SECONDS
        later = stamp
        found.append(((clock, stamp, kind), text))
    return found[::-1]


def _with_time(stamp: float, line: str) -> str:
    time = stamp_text(stamp) if stamp and not line.startswith(' ') else ''
    return toned(f'{time:>8}  {line}', line)
