# SPDX-License-Identifier: BSD-3-Clause
"""The bar of the pending decision: question, reason, target of each answer; and the answer that the operator picked."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import RefusedError
from flexbt_console.mirror.records import Decision, DecisionKind, StateStructure
from flexbt_console.mirror.view import View
from flexbt_console.present.cells import cut, cut_middle, fold, width
from flexbt_console.present.rendering import age_text, asked_text, reason_lines, subject_lines
from flexbt_console.present.style import Glyphs, Line, Tone, toned
from flexbt_console.present.tree_lines import acting_lines
from flexbt_console.ui.answers import Meaning, ShownDecision, choose
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import one_line

from .robot_panes import leads_text

ROWS: Final = 4
"""Rows of the bar: it stays at its place, also while nothing waits."""

CHOICE_ROWS: Final = 2
"""Rows of the decision bar for the possible answers."""

LEAST_CELLS: Final = 7
"""Cells of a choice of one letter, with the gap behind it."""

BURST_SECONDS: Final = 0.7
"""Keys that follow each other sooner belong to the decision of the first of them. A keyboard repeats a key that is held
down sooner than that (X11: after 0.66 s)."""

BURST_SIGNS: Final = 20
"""Maximum number of signs of a burst that are kept: a key that is held down repeats without end."""

_ENTER: Final = '\u23ce'
"""Sign for an Enter in what was typed."""

_ALONE: Final = re.compile(f'(.*{_ENTER})?[0-9]|')
"""Pattern of the input that may precede an Enter that answers: nothing, or a number that picks, also after a list."""

NARROWEST: Final = 16
"""Minimum cells of a choice if there is no room for all of its text."""


class Burst:
    """The keys typed in one burst, wherever they went: letters, digits, and the Enters of lines and lists.

    Arrows, Tab and Escape begin another burst.

    Two letters are a word. It may be meant as an answer, so no letter of it is a key that sends something, and an Enter
    behind it answers nothing. Neither does the second Enter of two: the first was meant for what it has closed.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._text = ''
        self._typed_at = -math.inf

    def typed(self, key: str, sign: str | None, *, is_elsewhere: bool) -> None:
        """Note a pressed key; ``sign`` is what it types. ``is_elsewhere``: an open line or list gets it."""
        now = self._clock.now()
        if now - self._typed_at >= BURST_SECONDS or not (sign or key in ('enter', 'backspace')):
            self._text = ''
        self._typed_at = now
        if key == 'enter' and is_elsewhere:
            sign = _ENTER
        if sign is not None and (sign.isalnum() or sign == _ENTER):
            self._text = (self._text + sign)[-BURST_SIGNS:]

    def check_key(self, key: str) -> None:
        """Raise RefusedError for a key that is a letter of a word."""
        word = self._text.rpartition(_ENTER)[2]
        if len(word) > 1:
            raise RefusedError(f'{word!r} is a word, so "{key}" in it did nothing; press : to type a line')

    def check_enter(self) -> None:
        """Raise RefusedError for an Enter that was typed in one go with more than the number of a choice."""
        if not _ALONE.fullmatch(self._text):
            raise RefusedError(
                f'nothing was sent: Enter came just behind {self._text!r}. Look at the decision, and press Enter '
                'again; 0 lists its answers, ":" types a line'
            )
        self._text = _ENTER


class Picking:
    """The answer that Enter sends. A key belongs to the decision that was drawn when it was pressed."""

    def __init__(self, clock: Clock) -> None:
        self._shown = ShownDecision(clock)
        self._pick = '', ''
        """The decision that an answer was picked for, and the answer: it is gone with the decision."""
        self._clock = clock
        self._pressed_at = -math.inf

    def drawn(self, view: View) -> None:
        """Note that the screen shows this decision now."""
        shown = view.decision.id if view.decision else None
        self._shown.drawn(shown)
        if self._pick[0] != shown:
            self._pick = '', ''

    def pressed(self) -> None:
        """Note that a key was pressed that answers. With others that came quickly before it, it is for one decision."""
        now = self._clock.now()
        if now - self._pressed_at >= BURST_SECONDS:
            self._shown.typed('')
        self._pressed_at = now
        self._shown.typed('key')

    def turned_to(self, decision_id: str) -> None:
        """Note that the operator has chosen this decision from the list, and so has seen it."""
        self._pick = '', ''
        self._pressed_at = -math.inf
        self._shown.known(decision_id)

    def moved(self) -> None:
        """Forget the choice: the operator went to another robot, whose decisions are new to the operator."""
        self._pick = '', ''
        self._shown.drawn('')

    def picked(self, decision: Decision | None) -> str:
        """Return the answer that Enter sends: the picked one, or else the outcome that the state wants; '' for none."""
        if decision is None:
            return ''
        if self._pick[0] == decision.id:
            return self._pick[1]
        return decision.outcome if decision.kind is DecisionKind.TRANSITION else ''

    def pick(self, number: int, view: View) -> None:
        """Pick a choice of the decision on the screen, from 1 on.

        Raises:
            RefusedError: nothing waits, the choice does not exist, or the decision has only just appeared.
        """
        decision = self._decision(view)
        if not 1 <= number <= len(decision.choices):
            self._pick = decision.id, ''  # so that Enter does not send another one than was meant
            raise RefusedError(f'there is no choice {number}; there are {len(decision.choices)}')
        self._pick = decision.id, decision.choices[number - 1]

    def confirm(self, view: View, builder: CommandBuilder) -> Meaning:
        """Return the command for the picked answer.

        Raises:
            NotShownError: what the decision is about was not received.
            RefusedError: nothing is picked, or the decision is another one than that on the screen.
        """
        decision = self._decision(view)
        answer = self.picked(decision)
        if not answer:
            what = 'pick a choice by its number' if decision.choices else 'type the value, or point at it on the map'
            raise RefusedError(f'nothing is picked yet: {what}')
        meaning = choose(answer, view, builder, decision)
        self._pick = '', ''
        return meaning

    def _decision(self, view: View) -> Decision:
        return self._shown.bound.decision(view)


def decision_lines(view: View, picked: str, columns: int, signs: Glyphs, *, is_pointing: bool = False) -> list[str]:
    """Return the bar in at most :data:`ROWS` rows of this many cells. Without a decision it shows active states."""
    decision, snapshot = view.decision, view.snapshot
    if decision is None or snapshot is None:
        acting = [f'  {signs.active} {line}' for run in view.running_trees for line in acting_lines(run)]
        room = ROWS - 1
        if len(acting) > room:
            acting = [*acting[: room - 1], f'  +{len(acting) - room + 1} more']
        folded = [row for line in acting for row in fold(line, columns, room // len(acting))]
        return [Line('no pending decision', Tone.DIM), *folded]
    age = f'  {age_text(max(0.0, snapshot.stamp - decision.since))}' if decision.since else ''
    others = len(view.decisions) - 1
    tails = [f'{age}  (+{others} more{listed})' for listed in (': "a" lists them', ': a', '')] if others else [age]
    where = one_line(decision.path)
    head = f'{signs.waits} {asked_text(decision, snapshot).replace(where, cut_middle(where, columns // 2), 1)}'
    told_of = (*subject_lines(decision, view)[:1], *reason_lines(decision, view)[:1])
    reasons = [toned(f'  {line}', line) for line in told_of]
    texts = choice_texts(decision, view.state(decision.path), signs)
    choices = _choice_rows(decision, texts, picked, columns)
    answers = choices or [cut(_how_to_answer(decision, is_pointing=is_pointing), columns)]
    room = ROWS - len(answers)
    heads = fold(head, columns, most := max(1, min(2, room - len(reasons))))
    if width(heads[-1]) + width(tails[-1]) > columns and len(heads) < most:
        heads.append(' ')
    tail = next((one for one in tails if width(heads[-1]) + width(one) <= columns), tails[-1])
    heads[-1] = cut(heads[-1], columns - width(tail)) + tail  # also of a head that is cut
    lines: list[str] = [Line(text, Tone.DECISION) for text in heads]
    for reason in reasons:
        if len(lines) < room:
            lines += fold(reason, columns, room - len(lines))
    lines += answers
    if choices and len(lines) < ROWS:
        lines.append(Line(cut(_how_to_pick(decision, picked), columns), Tone.DIM))
    return lines[:ROWS]


def choice_texts(decision: Decision, state: StateStructure | None, signs: Glyphs) -> list[str]:
    """Return each choice with its number and its target; a star marks the outcome that the state wants."""
    ways = {one.outcome: one for one in state.transitions} if state else {}
    return [
        f'{number} {one_line(choice)}{"*" * (choice == decision.outcome)}{leads_text(ways.get(choice), signs)}'
        for number, choice in enumerate(decision.choices, 1)
    ]


def waiting_texts(view: View) -> list[str]:
    """Return each pending decision with its waiting time and its question."""
    snapshot = view.snapshot
    if snapshot is None:
        return []
    ages = [age_text(max(0.0, snapshot.stamp - one.since)) if one.since else '' for one in snapshot.decisions]
    return [f'{age:>7}  {asked_text(one, snapshot)}' for age, one in zip(ages, snapshot.decisions, strict=True)]


def _choice_rows(decision: Decision, texts: Sequence[str], picked: str, columns: int) -> list[str]:
    """Return the choices side by side; the picked one in brackets.

    If there is no room for all, each is cut; what is still left out, the picked one never, is counted.
    """
    kept = decision.choices.index(picked) if picked in decision.choices else 0
    indices = [*range(min(len(texts), CHOICE_ROWS * columns // LEAST_CELLS))]
    if texts and kept not in indices:
        indices.append(kept)

    def rows_of(longest: int) -> list[str]:
        cells = [_cell(texts[one], longest, is_picked=decision.choices[one] == picked) for one in indices]
        if len(indices) < len(texts):
            cells.append(f' +{len(texts) - len(indices)} more: 0 ')
        return _side_by_side(cells, columns)

    rows = rows_of(columns)
    if len(rows) > CHOICE_ROWS:
        narrow = min(columns, max(NARROWEST, columns // -(-len(texts) // CHOICE_ROWS) - 2))
        while len(rows := rows_of(narrow)) > CHOICE_ROWS and len(indices) > 1:
            del indices[-2 if indices[-1] == kept else -1]
    return [Line(row, Tone.DECISION) for row in rows[:CHOICE_ROWS]]


def _cell(text: str, columns: int, *, is_picked: bool) -> str:
    return f'[{cut(text, columns - 2)}]' if is_picked else f' {cut(text, columns - 2)} '


def _side_by_side(cells: Sequence[str], columns: int) -> list[str]:
    rows: list[str] = []
    for cell in cells:
        if rows and width(rows[-1]) + width(cell) + 2 <= columns:
            rows[-1] += f'  {cell}'
        else:
            rows.append(cut(cell, columns))
    return rows


def _how_to_pick(decision: Decision, picked: str) -> str:
    star = '; * is what the state wants' if decision.outcome in decision.choices else ''
    if not picked:
        return f'  a number picks an answer, and then Enter sends it{star}'
    return f'  Enter sends what is in brackets; a number picks another answer{star}'


def _how_to_answer(decision: Decision, *, is_pointing: bool) -> str:
    if is_pointing:
        return '  on the map: arrows move, < > turn; Enter answers, Esc leaves'
    if decision.wants_pose:
        return '  "g" points at it on the map; ":" types a place, or x y yaw; "d" declines'
    return '  ":" types the value: input VALUE; "d" declines'
