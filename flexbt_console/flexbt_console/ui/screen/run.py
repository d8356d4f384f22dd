# SPDX-License-Identifier: BSD-3-Clause
"""The screen in this terminal, of robots or of a recording."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.present.style import Line, Tone
from flexbt_console.ui.station import Attention, Station
from flexbt_console.ui.terminal import OnSignal, standard_error_as_lines
from flexbt_core.clock.clock import Clock

from .app import OperatorScreen
from .panes import Layout
from .replay_bar import NOTHING_SENT, NoLink, ReplayBar
from .textual_app import image_widget

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.recording.player import RunPlayer

LAYOUT_FILE = f'{USER_DIRECTORY}/screen_layout'
"""File that keeps the layout from one session to the next."""


def run_screen(station: Station, clock: Clock, on_signal: OnSignal, robots: FleetLink | None = None) -> None:
    """Run the screen in this terminal until the operator leaves it, or a signal ends it, which ``on_signal`` reports
    (see :class:`TerminalWatch`)."""
    _run(OperatorScreen(station, clock, robots, layout=_layout(), image_widget=image_widget()), on_signal)


def show_recording(player: RunPlayer, clock: Clock, on_signal: OnSignal) -> None:
    """Show a recording in this terminal until the operator leaves it, or a signal ends it."""
    builder = CommandBuilder(None, NOTHING_SENT)
    station = Station(player.mirror, NoLink(), builder, 1.0, Attention(clock), 'it was a recording')
    bar = ReplayBar(player, clock)
    _run(OperatorScreen(station, clock, replay=bar, layout=_layout(), image_widget=image_widget()), on_signal)


def _layout() -> Layout:
    return Layout(home_path(LAYOUT_FILE))


def _run(screen: OperatorScreen, on_signal: OnSignal) -> None:
    """Nothing else writes to its terminal."""

    async def run() -> None:
        with on_signal(screen.exit):
            await screen.run_async()

    with standard_error_as_lines(lambda text: screen.tell([Line(text, Tone.WARNING)])):
        asyncio.run(run())
