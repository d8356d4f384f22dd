# SPDX-License-Identifier: BSD-3-Clause
"""The map on the screen, and the cursor on it by which a pose is answered."""

from __future__ import annotations

import math
from typing import Final

from rich.text import Text

from flexbt_console.errors import RefusedError
from flexbt_console.mirror import Decision, View
from flexbt_console.pictures import Frame, Glyphs, MapCanvas, cut, where_text
from flexbt_console.ui.interaction import has_map

from .pane import drawn

CURSOR_STEPS: Final = {'left': (-1, 0), 'right': (1, 0), 'up': (0, -1), 'down': (0, 1)}
CURSOR_TURNS: Final = {'less_than_sign': math.tau / 16.0, 'greater_than_sign': -math.tau / 16.0}


LEAST_COLUMNS: Final = 8
LEAST_ROWS: Final = 3


class MapPane:
    """Draws the map. The cursor belongs to one decision, and is gone with it."""

    def __init__(self, signs: Glyphs) -> None:
        self._canvas = MapCanvas(signs)
        self._frame: Frame | None = None
        self._cursor: tuple[float, float] | None = None
        self._yaw = 0.0
        self._is_aimed = False
        self._decision = ''
        self._drawn: tuple[object, Text] | None = None

    @property
    def is_pointing(self) -> bool:
        """Whether there is a cursor."""
        return self._cursor is not None

    @property
    def is_aimed(self) -> bool:
        """Return whether there is a cursor that was moved or turned."""
        return self._cursor is not None and self._is_aimed

    def point(self, view: View) -> bool:
        """Put the cursor where the robot is; False while there is no map, or nothing is asked."""
        robot = view.snapshot.robot_pose if view.snapshot else None
        if view.decision is None or not has_map(view):
            return False
        if self._frame is None:  # it is hidden, and is drawn now
            self.draw(view, 2 * LEAST_COLUMNS, 2 * LEAST_ROWS)
        assert self._frame is not None
        middle = self._frame.centre(self._frame.columns // 2, self._frame.rows // 2)
        self._cursor = (robot.x, robot.y) if robot is not None else middle
        self._yaw = robot.yaw if robot is not None else 0.0
        self._is_aimed = False
        self._decision = view.decision.id
        return True

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
        """Take the cursor away."""
        self._cursor = None

    def lose(self, view: View) -> bool:
        """Take the cursor away when what it answers is not what waits first any more; whether that was so."""
        if self._cursor is None or (view.decision is not None and view.decision.id == self._decision):
            return False
        self._cursor = None
        return True

    def answer(self, view: View) -> tuple[str, Decision | None]:
        """Take the cursor away; return what it says, and the decision that it answers, None when that is gone.

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
        """The map in so many rows of so many cells; the last row tells where the robot, or the cursor, is."""
        robot = view.snapshot.robot_pose if view.snapshot else None
        room = rows - 1
        if columns < LEAST_COLUMNS or room < LEAST_ROWS:
            return Text('')
        shown = view.drawn, robot, view.places, self._cursor, columns, room
        if self._drawn is None or self._drawn[0] != shown:
            self._frame, cells = self._canvas.draw(*shown)
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
