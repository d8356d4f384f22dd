# SPDX-License-Identifier: BSD-3-Clause
"""A recording on the screen: the lanes of its time line, and the keys that move on it. Nothing can be commanded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

from rich.text import Text

from flexbt_console.errors import RefusedError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.lanes import LaneEntry
from flexbt_console.present.cells import cut
from flexbt_console.present.lane_lines import Kind, lane_lines, stops
from flexbt_console.present.style import Line, Tone, glyphs
from flexbt_core.clock.clock import Clock

from .pane import styled

if TYPE_CHECKING:
    from flexbt_console.recording.player import RunPlayer

SPEEDS: Final = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0)
JUMP_SECONDS: Final = 10.0
PATIENCE: Final = 0.2
"""Seconds for which is read at once: of a long recording the way to a time is seen, and keys are heard."""

MOVES: Final = {
    'space': 'play',
    'full_stop': 'forward',
    'comma': 'back',
    'right_square_bracket': 'next failure',
    'left_square_bracket': 'previous failure',
    'right_curly_bracket': 'next decision',
    'left_curly_bracket': 'previous decision',
    'right_parenthesis': 'nearer',
    'left_parenthesis': 'farther',
    'end': 'jump_forward',
    'home': 'jump_back',
}
"""Effect of each key on the time line."""

CURSOR_MOVES: Final = {
    'left': 'previous change',
    'right': 'next change',
    'less_than_sign': 'slower',
    'greater_than_sign': 'faster',
}
"""Effects of keys that otherwise move the cursor on the map."""

USUAL_SPAN: Final = 60.0
LEAST_SPAN: Final = 1.0
ZOOM: Final = 2.0
"""Seconds that the lanes show at first and at least, and the factor by which a key changes them."""

KEYS: Final = (
    ('Space', 'Play or pause; at the end, play from the beginning'),
    (', .', 'Previous or next event'),
    ('Home End', f'Jump {JUMP_SECONDS:g} s back or forward'),
    ('[ ]', 'Previous or next failure'),
    ('{ }', 'Previous or next decision'),
    ('← →', 'Previous or next change of states, decisions, commands, goals or faults'),
    ('( )', 'Show more, or less, time in the lanes'),
    ('< >', f'Slower or faster, {SPEEDS[0]:g} to {SPEEDS[-1]:g} times'),
    ('/', 'Type a text; Enter goes to its next occurrence'),
    ('Tab', 'Focus the next pane: PgUp, PgDn scroll it (Esc: the end), z enlarges it, h hides it'),
    (':', 'Type a command that shows something, such as status, tree, events; Esc cancels'),
    ('q', 'Quit'),
)

HELP: Final = ('q quits', 'space plays', '? keys', ', . step', '[ ] failure', '{ } decision', '/ finds', '< > speed')
"""Hints, of which as many are shown as fit next to a line of LEAST cells."""

LEAST: Final = 10
NEAR: Final = 1e-6

NOTHING_SENT: Final = 'this is a recording; nothing was sent'


class NoLink(RobotLink):
    """A recording takes no commands."""

    why = 'this is a recording: there is no robot to ask'


class ReplayBar:
    """A bar that plays a recording in the time of ``clock``."""

    def __init__(self, player: RunPlayer, clock: Clock) -> None:
        self.player = player
        self._clock = clock
        self._speed = SPEEDS.index(1.0)
        self._played_from: float | None = None
        self._wanted: float | None = None
        self._span = min(USUAL_SPAN, player.duration)
        self._entries: tuple[int, list[LaneEntry]] = -1, []

    @property
    def entries(self) -> list[LaneEntry]:
        """The entries of the lanes, as far as they were read."""
        lanes = self.player.lanes(PATIENCE)
        if lanes.revision != self._entries[0]:
            self._entries = lanes.revision, lanes.since()
        return self._entries[1]

    @property
    def is_playing(self) -> bool:
        """True while it plays."""
        return self._played_from is not None

    def play_on(self) -> bool:
        """Update the recording to the present time, or towards the requested one; return whether it has moved."""
        if self._wanted is not None:
            self._go_to(self._wanted)
            return True
        if self._played_from is None:
            return not self.player.has_lanes
        now = self._clock.now()
        passed, self._played_from = now - self._played_from, now
        self.player.go_to(self.player.time + passed * SPEEDS[self._speed], PATIENCE)
        if self.player.time >= self.player.duration:
            self._played_from = None
        return True

    def move(self, what: str) -> None:
        """Execute a key of :data:`MOVES`."""
        if what == 'play':
            if not self.is_playing and self.player.time >= self.player.duration:
                self._go_to(0.0)
            self._played_from = None if self.is_playing else self._clock.now()
        elif what in ('forward', 'back'):
            self._played_from = None
            self._go_to(self.player.next_said(1 if what == 'forward' else -1))
        elif what in ('nearer', 'farther'):
            self._span = min(
                max(LEAST_SPAN, self._span * (ZOOM if what == 'farther' else 1.0 / ZOOM)), self.player.duration
            )
        elif what.startswith(('next ', 'previous ')):
            self._jump(what.startswith('next '), cast('Kind', what.partition(' ')[2]))
        elif what in ('faster', 'slower'):
            self._speed = min(max(0, self._speed + (1 if what == 'faster' else -1)), len(SPEEDS) - 1)
        else:
            by = JUMP_SECONDS if what == 'jump_forward' else -JUMP_SECONDS
            self._go_to((self.player.time if self._wanted is None else self._wanted) + by)

    def _jump(self, is_forward: bool, kind: Kind) -> None:
        """Go to the next or previous time of a kind, and pause there.

        Raises RefusedError when there is none, or the lanes are not read so far.
        """
        at, times = self.player.time if self._wanted is None else self._wanted, stops(self.entries, kind)
        if is_forward:
            found = next((one for one in times if one > at + NEAR), None)
        else:
            found = next((one for one in reversed(times) if one < at - NEAR), None)
        if not self.player.has_lanes and not (is_forward and found is not None):
            raise RefusedError('the recording is still being read; press it again in a moment')
        if found is None:
            raise RefusedError(f'no {"later" if is_forward else "earlier"} {kind}')
        self._played_from = None
        self._go_to(found)

    def find(self, text: str) -> None:
        """Go to the next message that contains this text, and pause there. Raises RefusedError when none follows."""
        self._go_to(self.player.find(text))
        self._played_from = None

    def _go_to(self, time: float) -> None:
        self._wanted = None if self.player.go_to(time, PATIENCE) else time
        if self._played_from is not None:  # the way there does not count
            self._played_from = self._clock.now()

    def lanes_text(self, columns: int) -> Text:
        """Return the lanes around the moment that is shown."""
        player = self.player
        begin = min(max(0.0, player.time - self._span / 2.0), player.duration - self._span)
        return styled(lane_lines(self.entries, begin, begin + self._span, player.time, columns, glyphs()))

    def text(self, columns: int) -> Text:
        """Return the time line in one row."""
        player = self.player
        state = 'goes' if self._wanted is not None else 'plays' if self.is_playing else 'stands'
        head = f' {state} x{SPEEDS[self._speed]:g}  {player.time:.1f} / {player.duration:.1f} s '
        room = columns - len(head) - 3
        keys = ''
        for one in HELP:
            if len(one) + 2 <= room - LEAST:
                keys, room = f'{keys}  {one}', room - len(one) - 2
        room = max(4, room)
        place = round(player.time / player.duration * (room - 1)) if player.duration else 0
        line = '-' * place + '|' + '-' * (room - 1 - place)
        return styled([Line(cut(f'{head}[{line}]{keys}', columns), Tone.PLAIN)])


def replay_help_lines() -> list[str]:
    """Return the keys of a recording, for people."""
    return [f'{key:>8}  {help}' for key, help in KEYS]
