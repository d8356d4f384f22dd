# SPDX-License-Identifier: BSD-3-Clause
"""Several robots, one line each, the most urgent first, filtered as one types; Enter goes to the one that is marked."""

from __future__ import annotations

import sys
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from flexbt_console.mirror import Fleet, RobotOverview
from flexbt_console.pictures import cut, window
from flexbt_console.present import Line, Tone, left_out_text, robot_line, tone_of

from .dialogs import FindField
from .panes import Pane, styled

KEYS_OF_OVERVIEW: Final = 'type to find  Up Down mark  Enter goes there  Tab the most urgent  ! F8 STOP  Esc leaves'

PAGE: Final = 10
"""Robots."""


class Overview(ModalScreen[str | None]):
    """The list of robots; returns the name of the one that was chosen, or None.

    The mark stays at its robot, wherever that is in the list; what is typed moves it to the only robot that fits. Its
    keys have priority: one that is typed quickly behind Enter is for the robot that was chosen, and not for the one
    before.
    """

    CSS = 'Overview { align: left top; } Overview Pane { width: 100%; height: 1fr; }'
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'leave', 'leave', priority=True),
        Binding('tab', 'most_urgent', 'go to the most urgent', priority=True),
        Binding('enter', 'choose', 'go there', priority=True),
        *(
            Binding(key, f'step({by})', key, priority=True)
            for key, by in (
                ('down', 1),
                ('up', -1),
                ('pagedown', PAGE),
                ('pageup', -PAGE),
                ('end', sys.maxsize),
                ('home', -sys.maxsize),
            )
        ),
    ]

    def __init__(self, fleet: Fleet, own: str) -> None:
        super().__init__()
        self._fleet = fleet
        self._robots = fleet.overview
        self._own = own
        self._marked = own
        self._filtered_by = ''

    @property
    def chosen(self) -> str:
        """The robot that is marked, or else the one that is on the screen."""
        self._filter()
        return self._marked or self._own

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        yield FindField()
        yield Pane()

    def on_mount(self) -> None:
        """Give what is typed to the list."""
        self.set_focus(self.query_one(FindField))

    def on_pane_resized(self) -> None:
        """Draw for the size that there is now."""
        self.draw()

    def on_input_changed(self) -> None:
        """Show the robots that fit what is typed."""
        self.draw()

    def _filter(self) -> list[RobotOverview]:
        """Return the robots that fit what is typed; where that has changed, the only one is marked, or none is."""
        typed = self.query_one(FindField).value.strip().lstrip('/').casefold()
        robots = [one for one in self._robots() if typed in one.name.casefold()]
        if typed != self._filtered_by:
            self._filtered_by = typed
            named = [one.name for one in robots if typed == one.name.lstrip('/').casefold()]
            fitting = named or [one.name for one in robots]
            self._marked = '' if not typed or len(fitting) > 1 else next(iter(fitting), '')
        if all(one.name != self._marked for one in robots):
            self._marked = ''
        return robots

    def draw(self, told: str = '') -> None:
        """Draw the robots as they are now."""
        for field in self.query(FindField):  # not yet, or not any more, when it is drawn while it opens or closes
            robots, columns, rows = self._filter(), self.size.width, self.size.height
            needing = sum(one.needs_operator for one in self._robots())
            unreachable = sum(one.is_unreachable for one in self._robots())
            beside = [f'unreachable: {unreachable}'] * bool(unreachable) + left_out_text(self._fleet.left_out)
            counts = '  '.join([f'robots: {len(robots)}', f'need you: {needing}', *beside])
            head = f' {counts}  (type to find)'
            field.placeholder = cut(head, columns - 1)
            lines: list[str] = []
            place = 0
            for number, robot in enumerate(robots):
                line, is_marked = robot_line(robot), robot.name == self._marked
                place = number if is_marked else place
                lines.append(Line(cut(f'{">" if is_marked else " "} {line}', columns), tone_of(line)))
            shown = window(lines, place, rows - 2)
            shown += [''] * (rows - 2 - len(shown))
            last = Line(told, Tone.WARNING) if told else Line(KEYS_OF_OVERVIEW, Tone.DIM)
            for pane in self.query(Pane):
                pane.show(styled([*shown, Line(cut(last, columns), tone_of(last))]))

    def action_step(self, by: int) -> None:
        """Move the mark."""
        names = [one.name for one in self._filter()]
        if names:
            place = names.index(self._marked) if self._marked in names else -1 if by > 0 else len(names)
            self._marked = names[min(max(0, place + by), len(names) - 1)]
            self.draw()

    def action_choose(self) -> None:
        """Go to the robot that is marked."""
        fitting = self._filter()
        if self._marked:
            self.dismiss(self._marked)
        elif fitting:
            self.draw('no robot is marked: type more of its name, or mark one with Up and Down')
        else:
            self.draw('no robot has such a name')

    def action_most_urgent(self) -> None:
        """Go to the most urgent of the others that need their operator; leave when there is none."""
        needing = (one.name for one in self._robots() if one.needs_operator and one.name != self._own)
        self.dismiss(next(needing, None))

    def action_leave(self) -> None:
        """Drop what was typed, or else leave the list."""
        field = self.query_one(FindField)
        if field.value:
            field.value = ''
            self.draw()
        else:
            self.dismiss(None)
