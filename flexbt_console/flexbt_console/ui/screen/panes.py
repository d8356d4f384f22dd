# SPDX-License-Identifier: BSD-3-Clause
"""All panes of one robot: which of them are shown, enlarged and focused, and what is in each."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rich.text import Text

from flexbt_console.errors import RefusedError
from flexbt_console.mirror.fleet import RobotOverview
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut
from flexbt_console.present.style import glyphs
from flexbt_console.ui.keys import has_map
from flexbt_console.ui.station import Station
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import one_line
from flexbt_core.values.text_files import TextFileError, read_text, write_text

from .decision_bar import Picking, decision_lines
from .lines import KEYS_OF_LINE, CommandInput, alarm_text, keys_text, others_text, status_text
from .pane import styled
from .replay_bar import ReplayBar
from .robot_panes import LogPane, MachinePane, MapPane


class Panes:
    """The panes as the operator of ``station`` arranged them; ``line`` is typed below them, and ``replay`` replaces the
    keys in a recording."""

    def __init__(
        self, clock: Clock, station: Station, layout: Layout, line: CommandInput, replay: ReplayBar | None
    ) -> None:
        self.signs = glyphs()
        self.layout = layout
        self.picking = Picking(clock)
        self._operator = station.builder.operator
        self.log = LogPane(self._operator)
        self._page = one_line(station.page)
        self.robot = ''
        """The name of the robot on the screen; '' if there is only one."""
        self._line = line
        self._replay = replay
        self.moved()

    def moved(self) -> None:
        """Show another robot from now on."""
        self.machine, self.map = MachinePane(self.signs), MapPane(self.signs)
        self.picking.moved()
        self.log.moved()

    def follow(self) -> None:
        """Scroll all panes back to the present."""
        self.machine.follow()
        self.log.follow()

    def scroll(self, mirror: Mirror, pages: int) -> None:
        """Scroll by this many pages (negative: back) the focused pane, or else the log.

        Raises:
            RefusedError: the pane cannot scroll.
        """
        if self.layout.focused == 'machine':
            self.machine.scroll(pages)
        elif self.layout.focused == 'map':
            raise RefusedError('the map shows all that there is; Tab goes to the log')
        else:
            self.log.scroll(mirror, -pages)

    def visible(self, view: View) -> tuple[str, ...]:
        """Return the panes that have room, by the layout and by what the operator's present task needs."""
        visible = self.layout.visible('' if has_map(view) else 'map')
        if self.map.is_pointing and 'map' not in visible:
            visible = ('map',)
        return (*visible, 'log') if self._line.is_open and 'log' not in visible else visible

    def has_answer(self, view: View) -> bool:
        """Return whether Enter has an answer to send for the decision on the screen, or opens the line for a value."""
        if self.map.is_pointing:
            return self.map.is_aimed
        decision = view.decision
        is_typed = decision is not None and not (decision.choices or decision.wants_pose)
        return is_typed or bool(self.picking.picked(decision))

    def text_of(
        self, pane: str, view: View, mirror: Mirror, robots: Sequence[RobotOverview], columns: int, rows: int
    ) -> Text:
        """Return the contents of a pane of this many rows of this many cells."""
        match pane:
            case 'status':
                others = others_text(robots, self.robot)
                name = 'RECORDING' if self._replay is not None else self.robot if len(robots) > 1 else ''
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
                return line.draw(view, columns, rows) if line.is_open else self.log.draw(mirror, columns, rows)
            case 'lanes':
                assert self._replay is not None, 'only a recording has lanes here'
                return Text() if self.layout.is_enlarged else self._replay.lanes_text(columns)
            case _ if self._line.is_open:
                return styled([cut(KEYS_OF_LINE, columns)])
            case _ if self._replay is not None:
                return self._replay.text(columns)
            case _:
                return keys_text(view, columns, self._operator, self.layout.focused, has_answer=self.has_answer(view))


# The arrangement of the panes (focused, enlarged or hidden), as the operator has last left it.

PANES: Final = ('machine', 'map', 'log')


class Layout:
    """The layout of the panes. Keys scroll, enlarge and hide the focused one. It is kept in ``file``, if not None,
    as words; unknown words, e.g. of another version, are ignored.

    Methods that change it raise RefusedError if it cannot be kept.
    """

    def __init__(self, file: Path | None = None) -> None:
        self._file = file
        words: list[str] = []
        if file is not None:
            with contextlib.suppress(TextFileError):  # it is not there yet
                words = read_text(file).split()
        self.focused = next((pane for pane in PANES if f'focused={pane}' in words), '')
        self.is_enlarged = bool(self.focused) and 'enlarged' in words
        self.hidden = {pane for pane in PANES if f'hidden={pane}' in words}

    def visible(self, empty: str = '') -> tuple[str, ...]:
        """Return the panes that have room. One that is ``empty`` has some only when it is enlarged."""
        if self.is_enlarged:
            return (self.focused,)
        return tuple(pane for pane in PANES if pane not in self.hidden and pane != empty)

    def focus_next(self) -> None:
        """Focus the next pane that has room; after the last, none."""
        self._focus([pane for pane in PANES if pane not in self.hidden], is_enlarged=self.is_enlarged)

    def enlarge(self) -> None:
        """Enlarge the pane with the focus, or the next one; after the last, show all."""
        if self.is_enlarged or not self.focused:
            self._focus(PANES, is_enlarged=True)
        else:
            self._set(self.focused, is_enlarged=True)

    def hide(self) -> None:
        """Hide the pane with the focus; without a focus, show all."""
        self.hidden = self.hidden | {self.focused} if self.focused else set()
        self._set('', is_enlarged=False)

    def _focus(self, panes: Sequence[str], *, is_enlarged: bool) -> None:
        stops = ['', *panes, '']
        place = stops.index(self.focused) if self.focused in stops else 0
        self._set(stops[place + 1], is_enlarged=is_enlarged)

    def _set(self, focused: str, *, is_enlarged: bool) -> None:
        self.focused, self.is_enlarged = focused, is_enlarged and bool(focused)
        if self._file is None:
            return
        words = [f'focused={focused}'] if focused else []
        words += ['enlarged'] if self.is_enlarged else []
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._file, ' '.join([*words, *(f'hidden={pane}' for pane in sorted(self.hidden))]) + '\n')
        except OSError as error:
            raise RefusedError(f'this layout is not there the next time: {error}') from None
