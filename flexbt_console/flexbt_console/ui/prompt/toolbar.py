# SPDX-License-Identifier: BSD-3-Clause
"""The lines below the prompt: the present state, as styled text for a terminal of any size."""

from __future__ import annotations

import unicodedata
from typing import Final

from flexbt_console.mirror import CommandState, DecisionKind, LinkState, View
from flexbt_console.present import (
    authority_text,
    autonomy_text,
    behavior_line,
    choice_line,
    command_result_lines,
    decision_line,
    link_word,
    peers_text,
    pose_text,
)
from flexbt_core.values import one_line

Line = tuple[str, str]
"""Style class and text of one line."""

MOST_STATES: Final = 3
MOST_ACTIVITIES: Final = 3

LINK_STYLES: Final = {
    LinkState.LIVE: 'class:live',
    LinkState.STALE: 'class:stale',
    LinkState.LOST: 'class:lost',
}


def toolbar(view: View, width: int, height: int) -> list[Line]:
    """The lines, at most ``height`` of at most ``width`` cells. The decision to make is always among them.

    What matters most stays when there is little room: link and behavior, then the decision, then the rest.
    """
    head = _head(view)
    decision = _decision(view)
    rest = _rest(view)
    room = max(0, height - len(head) - len(decision))
    shown = [*head, *rest[:room], *decision]
    return [(style, cut(text, width)) for style, text in shown[: max(1, height)]]


def cut(text: str, cells: int) -> str:
    """``text`` cut to so many cells of a terminal; wide characters take two."""
    used = 0
    for index, character in enumerate(text):
        used += _cells(character)
        if used > cells:
            return _ending(text[:index], cells)
    return text


def _ending(text: str, cells: int) -> str:
    while text and sum(map(_cells, text)) > cells - 1:
        text = text[:-1]
    return text + '…' if cells > 0 else ''


def _cells(character: str) -> int:
    if unicodedata.category(character) in ('Mn', 'Me'):
        return 0
    return 2 if unicodedata.east_asian_width(character) in ('W', 'F') else 1


def _head(view: View) -> list[Line]:
    parts = [link_word(view)]
    if view.snapshot is not None:
        parts += [behavior_line(view), f'autonomy {autonomy_text(view.snapshot.autonomy)}']
    head = [(LINK_STYLES[view.link], ' | '.join(parts))]
    if view.problem:
        head.append(('class:lost', one_line(view.problem)))
    elif not view.live and view.snapshot is not None:
        head.append((LINK_STYLES[view.link], 'NOT LIVE: this is how it was then'))
    return head


def _decision(view: View) -> list[Line]:
    decision, snapshot = view.decision, view.snapshot
    if decision is None or snapshot is None:
        return []
    others = len(view.decisions) - 1
    more = f'  (+{others} more: status)' if others else ''
    lines = [('class:decision', f'? {decision_line(decision, snapshot)}{more}')]
    if decision.choices:
        lines.append(('class:decision', f'  {choice_line(decision)}'))
    if decision.kind is DecisionKind.TRANSITION:
        lines.append(('', '  number or name chooses; "confirm" takes the one marked *'))
    return lines


def _rest(view: View) -> list[Line]:
    snapshot = view.snapshot
    if snapshot is None:
        return []
    style = '' if view.live else 'class:dim'
    lines: list[Line] = []
    for state in snapshot.active_states[:MOST_STATES]:
        lines.append((style, f'> {one_line(state.path)}'))
        lines += [(style, f'    {one_line(text)}') for text in state.activity[:MOST_ACTIVITIES]]
        if len(state.activity) > MOST_ACTIVITIES:
            lines.append((style, f'    … {len(state.activity) - MOST_ACTIVITIES} more'))
    if len(snapshot.active_states) > MOST_STATES:
        lines.append((style, f'  … {len(snapshot.active_states) - MOST_STATES} more active states'))
    lines.append((style, f'robot  {pose_text(snapshot.robot_pose)}'))
    if snapshot.authority:
        lines.insert(0, (style, f'authority  {authority_text(snapshot)}'))
    missed = [peer for peer in snapshot.peers if not (peer.alive and peer.ready)]
    if missed:
        lines.insert(0, ('class:lost', f'nodes  {peers_text(missed)}'))
    command = view.last_command
    if command is not None and command.state is CommandState.PENDING:
        lines.insert(0, ('class:stale', command_result_lines(command)[0]))
    return lines
