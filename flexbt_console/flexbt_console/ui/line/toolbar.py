# SPDX-License-Identifier: BSD-3-Clause
"""The lines below the prompt: the current state, as styled text for a terminal of any size."""

from __future__ import annotations

from typing import Final

from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.records import ActiveState, DecisionKind
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, cut_middle, fold
from flexbt_console.present.debugging import breakpoint_summary, held_lines
from flexbt_console.present.rendering import (
    alarm_line,
    authority_text,
    autonomy_text,
    choice_line,
    command_result_lines,
    decision_line,
    link_word,
    not_paused_lines,
    peer_line,
    reason_lines,
    subject_lines,
    what_runs,
    where_lines,
)
from flexbt_console.present.style import Line, Tone, tone_of, toned
from flexbt_core.values.text import one_line

MOST_STATES: Final = 3
MOST_ACTIVITIES: Final = 3

MOST_ROWS: Final = 2
"""Maximum rows of a text from the robot."""

REASON_ROWS: Final = 3
"""Maximum rows of the reason for the outcome that a state wants."""


def toolbar(view: View, width: int, height: int) -> list[tuple[str, str]]:
    """Return the style class and the text of each line: at most ``height`` lines of at most ``width`` cells.

    When there is not enough room, the parts are kept in this order: link and behavior, the decision, problems, the
    rest.
    """
    first, *head = _head(view, width)
    decision = _decision(view, width)[: max(0, height - 1)]
    head = head[: max(0, height - 1 - len(decision))]
    rest = _rest(view, width, height - 1 - len(head) - len(decision))
    return [(f'class:{tone_of(line).name.lower()}', cut(line, width)) for line in (first, *head, *rest, *decision)]


def _head(view: View, width: int) -> list[str]:
    word, snapshot = link_word(view), view.snapshot
    if snapshot is None:
        head: list[str] = [word]
    else:
        text = ' | '.join([word, what_runs(view), f'autonomy {autonomy_text(snapshot.autonomy)}'])
        head = [toned(text, word)]
    head += [alarm] if (alarm := alarm_line(view)) else []
    if view.problem:
        head += fold(Line(one_line(view.problem), Tone.ERROR), width, MOST_ROWS)
    elif not view.live and snapshot is not None:
        head.append(toned('NOT LIVE: this is how it was then', word))
    if snapshot is not None:
        head += [line for peer in snapshot.missed_peers for line in fold(peer_line(peer), width, MOST_ROWS)]
        head += fold(Line(one_line(snapshot.message), Tone.WARNING), width, MOST_ROWS) if snapshot.message else []
        for line in (*held_lines(snapshot), *breakpoint_summary(snapshot)):
            head += fold(line, width, MOST_ROWS)
    return head


def _decision(view: View, width: int) -> list[str]:
    decision, snapshot = view.decision, view.snapshot
    if decision is None or snapshot is None:
        return []
    others = len(view.decisions) - 1
    more = f'  (+{others} more: status)' if others else ''
    lines = fold(Line(f'? {decision_line(decision, snapshot)}{more}', Tone.DECISION), width, MOST_ROWS)
    reason = [*subject_lines(decision, view), *reason_lines(decision, view)[:1]]
    lines += [part for line in reason for part in fold(toned(f'  {line}', line), width, REASON_ROWS)]
    if decision.choices:
        lines += fold(Line(f'  {choice_line(decision)}', Tone.DECISION), width, MOST_ROWS)
    if decision.kind is DecisionKind.TRANSITION:
        lines.append('  number or name chooses; "confirm" takes the one marked *')
    return lines


def _rest(view: View, width: int, room: int) -> list[str]:
    snapshot = view.snapshot
    if snapshot is None or room <= 0:
        return []
    above: list[str] = []
    command = view.last_command
    if command is not None and command.state is CommandState.PENDING:
        above += command_result_lines(command)[:1]
    if snapshot.authority:
        above.append(f'authority  {authority_text(snapshot)}')
    states = snapshot.active_states[:MOST_STATES]
    more = len(snapshot.active_states) - len(states)
    below = [f'  … {more} more active states'] if more else []
    below += [toned(f'robot  {line}', line) for line in where_lines(snapshot)]
    left = room - len(above) - len(below)
    shown = [line for state in states for line in _state(state, width, max(1, left // len(states)))]
    tone = Tone.PLAIN if view.live else Tone.DIM
    lines = [*above, *shown[: max(0, left)], *below][:room]
    return [line if tone_of(line) is not Tone.PLAIN else Line(line, tone) for line in lines]


def _state(state: ActiveState, width: int, rows: int) -> list[str]:
    """Return the lines of a state and its activity. The nodes of its tree begin with the root; if there are too many,
    keep the last ones, because the leaves matter most."""
    path = cut_middle(f'> {one_line(state.path)}{" (paused)" if state.paused else ""}', width)
    notes = not_paused_lines(state)[: max(0, rows - 1)]
    room = min(MOST_ACTIVITIES + 1, rows - 1 - len(notes))
    activity = [cut_middle(f'    {one_line(text)}', width) for text in state.activity]
    if len(activity) > room:
        kept = activity[-(room - 1) :] if room > 1 else activity[-1:]
        above = [f'    … {len(activity) - len(kept)} above'] if room > 1 else []
        activity = [*above, *kept][: max(0, room)]
    return [path, *[toned(f'    {note}', note) for note in notes], *activity]
