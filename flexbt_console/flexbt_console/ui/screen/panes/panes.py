# SPDX-License-Identifier: BSD-3-Clause
"""All panes of one robot: which of them have room, and what is in each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from rich.text import Text

from flexbt_console.errors import RefusedError
from flexbt_console.mirror import Mirror, RobotOverview, View
from flexbt_console.pictures import cut, glyphs
from flexbt_console.ui.interaction import Station, has_map
from flexbt_core.clock import Clock
from flexbt_core.values import one_line

from .decision_bar import Picking, decision_lines
from .layout import Layout
from .log_pane import LogPane
from .machine_pane import MachinePane
from .map_pane import MapPane
from .pane import styled
from .replay_bar import ReplayBar
from .status_lines import alarm_text, keys_text, others_text, status_text
from .typed_line import KEYS_OF_LINE, TypedLine


class Shown(NamedTuple):
    """What is shown: ``robot``, one of ``robots``, as it is in ``view`` of its ``mirror``."""

    view: View
    mirror: Mirror
    robots: Sequence[RobotOverview]
    robot: str


class Panes:
    """The panes as the operator of ``station`` has them; ``line`` is typed below them, and ``replay`` stands for the
    keys in a recording."""

    def __init__(
        self, clock: Clock, station: Station, layout: Layout, line: TypedLine, replay: ReplayBar | None
    ) -> None:
        self.signs = glyphs()
        self.layout = layout
        self.picking = Picking(clock)
        self._operator = station.make.operator
        self.log = LogPane(self._operator)
        self._page = one_line(station.page)
        self._line = line
        self._replay = replay
        self.moved()

    def moved(self) -> None:
        """They show another robot from now on."""
        self.machine, self.map = MachinePane(self.signs), MapPane(self.signs)
        self.picking.moved()
        self.log.moved()

    def follow(self) -> None:
        """Show what is of now, wherever it was scrolled to."""
        self.machine.follow()
        self.log.follow()

    def scroll(self, mirror: Mirror, pages: int) -> None:
        """Go on by so many pages, or back, in the pane that has the focus, or else in the log.

        Raises:
            RefusedError: there is nothing to scroll in it.
        """
        if self.layout.focused == 'machine':
            self.machine.scroll(pages)
        elif self.layout.focused == 'map':
            raise RefusedError('the map shows all that there is; Tab goes to the log')
        else:
            self.log.scroll(mirror, -pages)

    def visible(self, view: View) -> tuple[str, ...]:
        """Those that have room: as they are laid out, and what is needed for what is done now."""
        visible = self.layout.visible('' if has_map(view) else 'map')
        if self.map.is_pointing and 'map' not in visible:
            visible = ('map',)
        return (*visible, 'log') if self._line.is_open and 'log' not in visible else visible

    def has_answer(self, view: View) -> bool:
        """Return whether Enter has something to send for the decision on the screen, or begins the line for a value."""
        if self.map.is_pointing:
            return self.map.is_aimed
        decision = view.decision
        is_typed = decision is not None and not (decision.choices or decision.wants_pose)
        return is_typed or bool(self.picking.picked(decision))

    def text_of(self, pane: str, shown: Shown, columns: int, rows: int) -> Text:
        """What is in a pane of so many rows of so many cells."""
        view, _, robots, robot = shown
        match pane:
            case 'status':
                others = others_text(robots, robot)
                name = 'RECORDING' if self._replay is not None else robot if len(robots) > 1 else ''
                return status_text(view, columns, name, others, self._operator, self._page)
            case 'alarm':
                return alarm_text(view, columns, self._operator, is_recorded=self._replay is not None)
            case 'machine':
                nothing = 'no behavior runs' if self._replay is not None else 'no behavior runs; "s" starts one'
                return self.machine.draw(view, columns, rows, nothing)
            case 'map':
                return self.map.draw(view, columns, rows)
            case 'decision':
                picked, is_pointing = self.picking.picked(view.decision), self.map.is_pointing
                return styled(decision_lines(view, picked, columns, self.signs, is_pointing=is_pointing))
            case 'log':
                line = self._line
                return line.draw(view, columns, rows) if line.is_open else self.log.draw(shown.mirror, columns, rows)
            case _ if self._line.is_open:
                return styled([cut(KEYS_OF_LINE, columns)])
            case _ if self._replay is not None:
                return self._replay.text(columns)
            case _:
                return keys_text(view, columns, self._operator, self.layout.focused, has_answer=self.has_answer(view))
