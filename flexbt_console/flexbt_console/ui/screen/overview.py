# SPDX-License-Identifier: BSD-3-Clause
"""Several robots, one line each, the most urgent first; Enter goes to the one under the cursor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Final

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import ModalScreen

from flexbt_console.mirror import RobotOverview
from flexbt_console.pictures import cut, window
from flexbt_console.present import Line, Tone, robot_line, tone_of

from .panes import Pane, styled

KEYS_OF_OVERVIEW: Final = 'up, down choose  Enter goes there  ! F8 stops this robot  Esc leaves'


def others_text(robots: Sequence[RobotOverview], own: str) -> str:
    """What the other robots need, in short; '' while none needs anything."""
    needs = [one for one in robots if one.name != own and one.needs_operator]
    who = '1 other needs' if len(needs) == 1 else f'{len(needs)} others need'
    return f'{who} you: o' if needs else ''


class Overview(ModalScreen[str | None]):
    """The list of robots; gives the name of the one that was chosen, or None.

    The cursor stays at its robot, wherever that is in the list. Its keys have priority: one that is typed quickly
    behind Enter is for the robot that was chosen, and not for the one before.
    """

    CSS = 'Overview { align: left top; } Overview Pane { width: 100%; height: 100%; }'
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding('escape,o', 'dismiss(None)', 'leave', priority=True),
        Binding('enter', 'choose', 'go there', priority=True),
        Binding('down,j', 'step(1)', 'next', priority=True),
        Binding('up,k', 'step(-1)', 'previous', priority=True),
    ]

    def __init__(self, robots: Callable[[], Sequence[RobotOverview]], own: str) -> None:
        super().__init__()
        self._robots = robots
        self.chosen = own
        """The robot under the cursor."""

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
        head: str = Line(cut(f' robots: {len(robots)}  need you: {needing}', columns), Tone.PLAIN)
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

    def action_step(self, by: int) -> None:
        """Move the cursor."""
        names = [one.name for one in self._robots()]
        if names:
            place = names.index(self.chosen) if self.chosen in names else 0
            self.chosen = names[min(max(0, place + by), len(names) - 1)]
            self.draw()

    def action_choose(self) -> None:
        """Go to the robot under the cursor."""
        self.dismiss(self.chosen)
