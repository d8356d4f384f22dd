# SPDX-License-Identifier: BSD-3-Clause
"""The lines around the panes: link and run, alarms, keys, and the line that is typed with its completions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from rich.text import Text
from textual.suggester import Suggester

from flexbt_console.commands.completion import offers
from flexbt_console.commands.registry import begun
from flexbt_console.mirror.fleet import RobotOverview
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, cut_middle, fold, width
from flexbt_console.present.debugging import breakpoint_summary, held_lines
from flexbt_console.present.rendering import (
    age_text,
    alarm_line,
    authority_asked_line,
    authority_text,
    autonomy_text,
    peer_line,
    what_runs,
)
from flexbt_console.present.style import Line, Tone, toned
from flexbt_console.present.tree_lines import window
from flexbt_console.ui.answers import Bound
from flexbt_console.ui.keys import KEYS
from flexbt_core.values.text import one_line

from .pane import Field, styled

ALARM_ROWS = 3


def status_text(view: View, columns: int, robot: str, others: str, operator: str | None, page: str = '') -> Text:
    """Return the first line. ``robot`` is the name of the robot if there are several, ``others`` a text about what the
    others need. ``page`` is the address of the page in a browser, shown at the end of the line if it fits.

    The operator who requests the authority is in :func:`alarm_text`.
    """
    snapshot = view.snapshot
    who = f'{one_line(robot)}  ' if robot else ''
    needs = f'  {others}' if others else ''
    if view.listening:
        return styled([Line(cut(f' {who}LISTENING for an executive{needs}', columns), Tone.WARNING)])
    if snapshot is None:
        text = f' {who}NO EXECUTIVE: is it running, in this namespace and domain?{needs}'
        return styled([Line(cut(text, columns), Tone.ERROR)])
    link = 'LIVE' if view.live else f'{view.link.name} {age_text(view.age or 0.0)}'
    holder = snapshot.authority
    authority = f'  authority {one_line(holder) if holder == operator else authority_text(snapshot)}' if holder else ''
    may = f'  autonomy {autonomy_text(snapshot.autonomy)}{authority}'
    text = _with_end(_with_end(f' {who}{link}  {what_runs(view)}', may, columns - width(needs)), needs, columns)
    gap = columns - width(text) - width(page) - 1
    text += ' ' * gap + page if page and gap > 1 else ''
    shown = styled([Line(text.ljust(columns), Tone.PLAIN if view.live else Tone.ERROR)])
    shown.stylize('reverse')
    return shown


def _with_end(text: str, end: str, columns: int) -> str:
    """Share the columns: if both texts are too long, the first gets a third."""
    return cut(cut(text, max(columns // 3, columns - width(end))) + end, columns)


def others_text(robots: Sequence[RobotOverview], own: str) -> str:
    """Return the needs of the other robots, in short, and how many of them are not heard; '' if neither exists."""
    others = [one for one in robots if one.name != own]
    needing, unreachable = sum(one.needs_operator for one in others), sum(one.is_unreachable for one in others)
    told = [f'{needing} other{" needs" if needing == 1 else "s need"} you'] if needing else []
    told += [f'{unreachable} unreachable'] if unreachable else []
    return f'{", ".join(told)}: o' if told else ''


def alarm_text(view: View, columns: int, operator: str | None, *, is_recorded: bool = False) -> Text:
    """Return the problems, the most severe first, and the operator who requests the authority from this one.

    They have at most :data:`ALARM_ROWS` rows. A long text is folded into rows that other texts do not need.
    """
    snapshot = view.snapshot
    shown: list[str] = [alarm] if (alarm := alarm_line(view)) else []
    if view.problem:
        shown.append(Line(one_line(view.problem), Tone.ERROR))
    if snapshot is not None and not view.live:
        sent = '' if is_recorded else '; only STOP can be sent'
        shown.append(Line(f'NO LINK: showing the last known state{sent}', Tone.ERROR))
    if snapshot is not None:
        shown += [peer_line(peer) for peer in snapshot.missed_peers]
        shown += [Line(one_line(snapshot.message), Tone.WARNING)] if snapshot.message else []
        shown += [*held_lines(snapshot), *breakpoint_summary(snapshot)]
    asks = authority_asked_line(snapshot, operator) if snapshot is not None else ''
    request = [cut_middle(asks, columns - 1)] if asks else []
    shown = [*shown[: ALARM_ROWS - len(request)], *request]
    rows = ALARM_ROWS // max(1, len(shown))
    return styled([row for line in shown for row in fold(toned(f' {line}', line), columns, rows, '   ')])


def keys_text(view: View, columns: int, operator: str | None, focused: str = '', *, has_answer: bool = True) -> Text:
    """Return the keys, as many as there is room for; those that this operator cannot use now are dim. Before them the
    pane that has the focus, and the keys that are for it. ``has_answer``: Enter has something to send or to begin."""
    scroll = '' if focused == 'map' else 'PgUp PgDn '
    head = cut(f'{focused}: {scroll}z h  ', columns) if focused else ''
    room = columns - len(head)
    chosen: set[str] = set()
    ranks = {key: 0 if key.needs(view, operator) else key.rank for key in KEYS}
    usable = {key for key in KEYS if key.can_be_used(view, operator, has_answer=has_answer)}
    for key in sorted(KEYS, key=lambda one: (one not in usable, ranks[one])):
        needed = len(key.shown) + len(key.label) + 3
        if ranks[key] < 3 and needed <= room:
            chosen.add(key.action)
            room -= needed
    text = Text(head, no_wrap=True, end='')
    for key in KEYS:
        if key.action in chosen:
            text.append(f'{key.shown} ', 'bold' if key in usable else 'dim')
            text.append(f'{key.label}  ', '' if key in usable else 'dim')
    return text


# The typed line on the screen (a command, or a search in a recording), and its completions.

KEYS_OF_LINE: Final = 'Enter does it  Tab completes  Up Down: another one  Esc leaves  F8 STOP'

NAME_COLUMNS: Final = 24
"""Columns for the text of an offer, before its description."""


class CommandInput(Field):
    """A command input bound to the decision that was on the screen when typing began, which is ``bound``."""

    _marked = 0

    def __init__(self, view: Callable[[], View], tell_fault: Callable[[Exception], None]) -> None:
        super().__init__(
            id='line',
            suggester=_Completing(self._completed),
            placeholder='a command, or a word of what it does; Tab completes, Esc leaves',
            select_on_focus=False,
            disabled=True,
        )
        self._view = view
        self._tell_fault = tell_fault
        self.bound = Bound(None)

    @property
    def is_open(self) -> bool:
        """True while the operator types the line."""
        return self.has_class('typing')

    def open(self, text: str) -> None:
        """Open the line with this text; further keys are added to it."""
        decision = self._view().decision
        self.bound = Bound(decision.id if decision else None)
        self.disabled = False
        self.value = text
        self.cursor_position = len(text)
        self.add_class('typing')
        self.screen.set_focus(self)

    def close(self) -> str:
        """Return the typed text, and close the line."""
        self.remove_class('typing')
        self.disabled = True
        self.screen.set_focus(None)
        return self.value

    def watch_value(self, value: str) -> None:
        """Mark the first completion."""
        self._marked = 0

    def mark(self, by: int) -> None:
        """Mark another completion."""
        self._marked = min(max(0, self._marked + by), max(0, len(offers(self.value, self._view())) - 1))

    def take_marked(self) -> bool:
        """Insert the completion marked with the arrows, so that it is seen before it runs; False if it is typed."""
        is_another = self._marked > 0 and self._completed(self.value) != self.value
        if is_another:
            self.value = self._completed(self.value) or self.value
            self.cursor_position = len(self.value)
        return is_another

    def complete(self) -> None:
        """Insert the marked completion, and move the cursor to the end of the line to show it."""
        if self.cursor_position == len(self.value):
            self.value = self._completed(self.value) or self.value
            self.cursor_position = len(self.value)

    def draw(self, view: View, columns: int, rows: int) -> Text:
        """Return the usage of its command, and the completions, in this many rows of this many cells."""
        words = self.value.split(' ')
        spec = begun(words)[0] if len(words) > 1 else None
        usage = [Line(cut(f'  {spec.prompt_usage}', columns), Tone.DIM)] if spec is not None and spec.in_prompt else []
        found = offers(self.value, view)
        lines, refused = [], set()
        for number, (line, about, refusal) in enumerate(found):
            description = one_line(f'not possible: {refusal}' if refusal else about)
            shown = f'{">" if number == self._marked else " "} {one_line(line):{NAME_COLUMNS}}  {description}'.rstrip()
            lines.append(cut(shown, columns))
            if refusal:
                refused.add(lines[-1])
        offered = window(lines, self._marked, rows - len(usage))
        return styled([*usage, *(Line(line, Tone.DIM if line in refused else Tone.PLAIN) for line in offered)][:rows])

    def _completed(self, value: str) -> str | None:
        try:
            found = offers(value, self._view())
        except Exception as error:  # on a worker of the field, which would end the screen
            self._tell_fault(error)
            return None
        return found[min(self._marked, len(found) - 1)].line if value and found else None


class _Completing(Suggester):
    def __init__(self, complete: Callable[[str], str | None]) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._complete = complete

    async def get_suggestion(self, value: str) -> str | None:
        """See :class:`textual.suggester.Suggester`."""
        completed = self._complete(value)
        return completed if completed is not None and completed.startswith(value) else None
