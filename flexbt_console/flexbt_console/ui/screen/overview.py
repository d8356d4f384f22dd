# SPDX-License-Identifier: BSD-3-Clause
"""Several robots, one line each, the most urgent first; Enter goes to the one under the cursor."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import ClassVar, Final

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from flexbt_console.mirror import RobotOverview
from flexbt_console.pictures import cut, window
from flexbt_console.present import Line, Tone, robot_line, tone_of

from .panes import Pane, styled

KEYS_OF_OVERVIEW: Final = 'Up Down choose  / finds  Enter goes there  o the most urgent  ! F8 STOP  Esc leaves'


PAGE: Final = 10
"""Robots."""


class Overview(ModalScreen[str | None]):
    """The list of robots; gives the name of the one that was chosen, or None.

    The cursor stays at its robot, wherever that is in the list. Its keys have priority: one that is typed quickly
    behind Enter is for the robot that was chosen, and not for the one before.
    """

    CSS = 'Overview { align: left top; } Overview Pane { width: 100%; height: 100%; }'
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape', 'leave', 'leave', priority=True),
        Binding('o', 'most_urgent', 'go to the most urgent', priority=True),
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
        Binding('slash', 'find', 'find', priority=True),
    ]

    def __init__(self, robots: Callable[[], Sequence[RobotOverview]], own: str) -> None:
        super().__init__()
        self._robots = robots
        self.chosen = own
        """The robot under the cursor."""
        self._own = own
        self._sought: str | None = None

    def compose(self) -> ComposeResult:
        """See :class:`textual.screen.Screen`."""
        yield Pane()

    def on_pane_resized(self) -> None:
        """Draw for the size that there is now."""
        self.draw()

    def draw(self) -> None:
        """Draw the robots as they are now."""
        robots, columns, rows = self._robots(), self.size.width, self.size.height
        if robots and all(one.name != self.chosen for one in robots):
            self.chosen = robots[0].name
        needing = sum(one.needs_operator for one in robots)
        sought = f'  find: {self._sought}_' if self._sought is not None else ''
        head: str = Line(cut(f' robots: {len(robots)}  need you: {needing}{sought}', columns), Tone.PLAIN)
        lines: list[str] = []
        place = 0
        for number, robot in enumerate(robots):
            line, is_chosen = robot_line(robot), robot.name == self.chosen
            place = number if is_chosen else place
            lines.append(Line(cut(f'{">" if is_chosen else " "} {line}', columns), tone_of(line)))
        shown = [head, *window(lines, place, rows - 2)]
        shown += [''] * (rows - 1 - len(shown))
        for pane in self.query(Pane):  # not yet, or not any more, when it is drawn while it opens or closes
            pane.show(styled([*shown, Line(cut(KEYS_OF_OVERVIEW, columns), Tone.DIM)]))

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """What is typed to find a robot is no key."""
        if action == 'most_urgent' and self._sought is not None:
            return False
        return super().check_action(action, parameters)

    def action_step(self, by: int) -> None:
        """Move the cursor."""
        names = [one.name for one in self._robots()]
        if names:
            place = names.index(self.chosen) if self.chosen in names else 0
            self.chosen = names[min(max(0, place + by), len(names) - 1)]
            self.draw()

    def action_find(self) -> None:
        """What is typed from now on is a part of the name of the robot that is meant."""
        self._sought = ''
        self.draw()

    def on_key(self, event: events.Key) -> None:
        """Take the next character of the name, or the last one back."""
        if self._sought is None:
            return
        if event.key == 'backspace':
            self._sought = self._sought[:-1]
        elif event.is_printable and event.character is not None:
            self._sought += event.character
        found = (one.name for one in self._robots() if self._sought.lower() in one.name.lower())
        self.chosen = next(found, self.chosen)
        self.draw()

    def action_choose(self) -> None:
        """Go to the robot under the cursor."""
        self.dismiss(self.chosen)

    def action_most_urgent(self) -> None:
        """Go to the most urgent of the others that need their operator; leave when there is none."""
        needing = (one.name for one in self._robots() if one.needs_operator and one.name != self._own)
        self.dismiss(next(needing, None))

    def action_leave(self) -> None:
        """Leave what is sought, or else the list."""
        if self._sought is None:
            self.dismiss(None)
        else:
            self._sought = None
            self.draw()
