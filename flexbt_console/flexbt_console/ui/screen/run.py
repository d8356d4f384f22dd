# SPDX-License-Identifier: BSD-3-Clause
"""The screen in this terminal, of robots or of a recording."""

from __future__ import annotations

import asyncio

from flexbt_common.cli import USER_DIRECTORY, home_path
from flexbt_console.commands import CommandBuilder, CommandedRobot
from flexbt_console.mirror import Mirror
from flexbt_console.present import Line, Tone
from flexbt_console.ui.interaction import OnSignal, standard_error_as_lines
from flexbt_core.clock import Clock

from .app import OperatorScreen, Robots
from .panes import NOTHING_SENT, Layout, NoLink, Player, ReplayBar
from .terminal_images import image_widget

LAYOUT_FILE = f'{USER_DIRECTORY}/screen_layout'
"""Where the layout is kept from one time to the next."""


def run_screen(
    mirror: Mirror,
    link: CommandedRobot,
    make: CommandBuilder,
    timeout: float,
    clock: Clock,
    leaving: str,
    on_signal: OnSignal,
    robots: Robots | None = None,
) -> None:
    """Run the screen in this terminal until the operator leaves it, or a signal ends it, of which ``on_signal`` tells
    (see :class:`flexbt_console.ui.terminal_watch.TerminalWatch`)."""
    screen = OperatorScreen(
        mirror, link, make, timeout, clock, leaving, robots, layout=_layout(), image_widget=image_widget()
    )
    _run(screen, on_signal)


def show_recording(player: Player, clock: Clock, on_signal: OnSignal) -> None:
    """Show a recording in this terminal until the operator leaves it, or a signal ends it."""
    bar, make = ReplayBar(player, clock), CommandBuilder(None, NOTHING_SENT)
    leaving = 'it was a recording'
    screen = OperatorScreen(
        player.mirror, NoLink(), make, 1.0, clock, leaving, replay=bar, layout=_layout(), image_widget=image_widget()
    )
    _run(screen, on_signal)


def _layout() -> Layout:
    return Layout(home_path(LAYOUT_FILE))


def _run(screen: OperatorScreen, on_signal: OnSignal) -> None:
    """Nothing else writes to its terminal."""

    async def run() -> None:
        with on_signal(screen.exit):
            await screen.run_async()

    with standard_error_as_lines(lambda text: screen.tell([Line(text, Tone.WARNING)])):
        asyncio.run(run())
