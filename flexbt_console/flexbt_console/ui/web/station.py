# SPDX-License-Identifier: BSD-3-Clause
"""What the page needs of a robot: its mirror, the way of commands to it, and the simulator where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flexbt_console.commands import CommandedRobot
from flexbt_console.mirror import Fleet, Mirror
from flexbt_console.ui.interaction import Station


class Obstacles(Protocol):
    """Obstacles that an operator drops into a simulated world. Each method raises ConsoleError."""

    @property
    def dropped(self) -> tuple[tuple[str, float, float, float], ...]:
        """Those that were dropped here: name, centre (m) and radius (m) of each."""

    def is_possible(self) -> bool:
        """Whether there is a simulator."""

    def drop(self, x: float, y: float, timeout: float) -> str:
        """Put one there; gives its name. Not on the executor thread."""

    def remove(self, name: str, timeout: float) -> None:
        """Take it away again."""


@dataclass(frozen=True)
class PageStation(Station):
    """A robot as the operator of a page has it."""

    leaving: str = 'close the page: the robot goes on'
    obstacles: Obstacles | None = None


class Robots(Protocol):
    """The robots by their namespaces; see :class:`flexbt_console.link.FleetLink`."""

    fleet: Fleet
    own: str
    """The one that is shown where none is named, if it is there."""

    def robot(self, name: str) -> tuple[Mirror, CommandedRobot]:
        """The mirror and the link of a robot. Raises KeyError when it is not known."""

    def open(self, name: str) -> None:
        """Have map, trees and scan of a robot come until :meth:`close` was called as often. Both may take a moment."""

    def close(self, name: str) -> None:
        """See :meth:`open`."""
