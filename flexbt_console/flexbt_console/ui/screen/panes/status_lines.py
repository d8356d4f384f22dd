# SPDX-License-Identifier: BSD-3-Clause
"""The lines around the panes: link and run at the top, what is wrong below them, and the keys."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from flexbt_console.mirror import RobotOverview, View
from flexbt_console.pictures import cut, cut_middle, fold, width
from flexbt_console.present import (
    Line,
    Tone,
    age_text,
    alarm_line,
    authority_asked_line,
    authority_text,
    autonomy_text,
    peer_line,
    tone_of,
    what_runs,
)
from flexbt_console.ui.interaction import KEYS
from flexbt_core.values import one_line

from .pane import styled

ALARM_ROWS = 3


def status_text(view: View, columns: int, robot: str, others: str, operator: str | None, page: str = '') -> Text:
    """The first line; ``robot`` names it where there are several, ``others`` says what those need. ``page`` is the
    address of the page in a browser, which is at its end where there is room.

    Who asks ``operator`` for the authority is in :func:`alarm_text`.
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
    """Where both are too long, the first has a third of the columns."""
    return cut(cut(text, max(columns // 3, columns - width(end))) + end, columns)


def others_text(robots: Sequence[RobotOverview], own: str) -> str:
    """What the other robots need, in short, and how many of them are not heard; '' while there is neither."""
    others = [one for one in robots if one.name != own]
    needing, unreachable = sum(one.needs_operator for one in others), sum(one.is_unreachable for one in others)
    told = [f'{needing} other{" needs" if needing == 1 else "s need"} you'] if needing else []
    told += [f'{unreachable} unreachable'] if unreachable else []
    return f'{", ".join(told)}: o' if told else ''


def alarm_text(view: View, columns: int, operator: str | None, *, is_recorded: bool = False) -> Text:
    """What is wrong, the gravest first, in at most :data:`ALARM_ROWS` rows; and who asks this operator for the
    authority. What is too long takes more of them, where they are not needed for others.
    """
    snapshot = view.snapshot
    shown: list[str] = [alarm] if (alarm := alarm_line(view)) else []
    if view.problem:
        shown.append(Line(one_line(view.problem), Tone.ERROR))
    if snapshot is not None and not view.live:
        sent = '' if is_recorded else '; only STOP is sent'
        shown.append(Line(f'BLIND: this is how it was then{sent}', Tone.ERROR))
    if snapshot is not None:
        shown += [peer_line(peer) for peer in snapshot.missed_peers]
        shown += [Line(one_line(snapshot.message), Tone.WARNING)] if snapshot.message else []
    asks = authority_asked_line(snapshot, operator) if snapshot is not None else ''
    asked = [Line(cut_middle(asks, columns - 1), tone_of(asks))] if asks else []
    shown = [*shown[: ALARM_ROWS - len(asked)], *asked]
    rows = ALARM_ROWS // max(1, len(shown))
    return styled([Line(row, tone_of(line)) for line in shown for row in fold(f' {line}', columns, rows, '   ')])


def keys_text(view: View, columns: int, operator: str | None, focused: str = '', *, has_answer: bool = True) -> Text:
    """The keys, as many as there is room for; those that this operator cannot use now are dim. Before them the pane
    that has the focus, and the keys that are for it. ``has_answer``: Enter has something to send or to begin."""
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
