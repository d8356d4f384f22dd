# SPDX-License-Identifier: BSD-3-Clause
"""The decision that waits: what, why, what each answer leads to; and the answer that the operator has picked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_console.commands import CommandBuilder
from flexbt_console.errors import RefusedError
from flexbt_console.mirror import Decision, DecisionKind, StateStructure, View
from flexbt_console.pictures import Glyphs, acting_lines, cut, fold
from flexbt_console.present import Line, Tone, age_text, decision_line, reason_lines, tone_of
from flexbt_console.ui.interaction import Bound, Meaning, ShownDecision, choose
from flexbt_core.clock import Clock
from flexbt_core.values import one_line

ROWS: Final = 4
"""Rows of the bar: it stays at its place, also while nothing waits."""


@dataclass(frozen=True)
class Pick:
    """An answer that is picked and not sent: it belongs to one decision, and is gone with it."""

    decision_id: str
    answer: str


class Picking:
    """What Enter would send. The decision that a key belongs to is the one that was drawn when it was pressed."""

    def __init__(self, clock: Clock) -> None:
        self._shown = ShownDecision(clock)
        self._pick: Pick | None = None

    def drawn(self, view: View) -> None:
        """The screen shows this now."""
        shown = view.decision.id if view.decision else None
        self._shown.drawn(shown)
        if self._pick is not None and self._pick.decision_id != shown:
            self._pick = None

    def moved(self) -> None:
        """The operator went to another robot: what was picked is gone, and what comes up there is new to the eye."""
        self._pick = None
        self._shown.drawn('')

    def picked(self, decision: Decision | None) -> str:
        """What Enter answers: what was picked, or else the outcome that the state wants; '' is nothing."""
        if decision is None:
            return ''
        if self._pick is not None and self._pick.decision_id == decision.id:
            return self._pick.answer
        return decision.outcome if decision.kind is DecisionKind.TRANSITION else ''

    def pick(self, number: int, view: View) -> None:
        """Pick a choice of the decision on the screen, from 1 on.

        Raises:
            RefusedError: nothing waits, there is no such choice, or the decision has only just come up.
        """
        decision = self._decision(view)
        if not 1 <= number <= len(decision.choices):
            raise RefusedError(f'there is no choice {number}; there are {len(decision.choices)}')
        self._pick = Pick(decision.id, decision.choices[number - 1])

    def confirm(self, view: View, make: CommandBuilder) -> Meaning:
        """The command for what is picked.

        Raises:
            RefusedError: nothing is picked, or the decision is another one than that on the screen.
        """
        decision = self._decision(view)
        answer = self.picked(decision)
        if not answer:
            what = 'pick a choice by its number' if decision.choices else 'type the value, or point at it on the map'
            raise RefusedError(f'nothing is picked yet: {what}')
        self._pick = None
        return choose(answer, view, make, decision)

    def _decision(self, view: View) -> Decision:
        self._shown.typed('key')
        return Bound(*self._shown.take()).decision(view)


def decision_lines(view: View, picked: str, columns: int, signs: Glyphs, *, is_pointing: bool = False) -> list[str]:
    """The bar in at most :data:`ROWS` rows of so many cells. While nothing waits: what acts."""
    decision, snapshot = view.decision, view.snapshot
    if decision is None or snapshot is None:
        acting = [f'  {signs.active} {line}' for run in view.running_trees for line in acting_lines(run)]
        room = ROWS - 1
        if len(acting) > room:
            acting = [*acting[: room - 1], f'  +{len(acting) - room + 1} more']
        folded = [row for line in acting for row in fold(line, columns, room // len(acting))]
        return [Line('nothing waits for you', Tone.DIM), *folded]
    others = f'  (+{len(view.decisions) - 1} more)' if len(view.decisions) > 1 else ''
    waited = age_text(max(0.0, snapshot.stamp - decision.since)) if decision.since else ''
    head = f'{signs.waits} {decision_line(decision, snapshot)}  {waited}{others}'
    reasons = [f'  because {line}' for line in reason_lines(decision, view)[:1]]
    choices = _choice_rows(decision, view.state(decision.path), picked, columns, signs)
    told = choices or [cut(_how_to_answer(decision, is_pointing=is_pointing), columns)]
    room = ROWS - len(told)
    lines: list[str] = [Line(text, Tone.DECISION) for text in fold(head, columns, max(1, min(2, room)))]
    for reason in reasons:
        if len(lines) < room:
            lines += [Line(text, tone_of(reason)) for text in fold(reason, columns, room - len(lines))]
    return [*lines, *told][:ROWS]


def _choice_rows(
    decision: Decision, state: StateStructure | None, picked: str, columns: int, signs: Glyphs
) -> list[str]:
    """The choices with what they lead to, side by side; the picked one in brackets, what is wanted with a star."""
    cells = []
    for number, choice in enumerate(decision.choices, 1):
        target = ''
        if state is not None and choice in state.outcomes:
            place = state.outcomes.index(choice)
            target = state.targets[place] if place < len(state.targets) else ''
        leads = f' {signs.arrow} {one_line(target.rpartition("/")[2] or target)}' if target else ''
        wanted = '*' if choice == decision.outcome else ''
        text = f'{number} {one_line(choice)}{wanted}{leads}'
        cells.append(f'[{text}]' if choice == picked else f' {text} ')
    rows: list[str] = []
    for cell in cells:
        if rows and len(rows[-1]) + len(cell) + 2 <= columns:
            rows[-1] += f'  {cell}'
        else:
            rows.append(cut(cell, columns))
    return [Line(row, Tone.DECISION) for row in rows[:2]]


def _how_to_answer(decision: Decision, *, is_pointing: bool) -> str:
    if is_pointing:
        return '  on the map: arrows move, < > turn; Enter answers, Esc leaves'
    if decision.wants_pose:
        return '  "g" points at it on the map; ":" types a place, or x y yaw'
    return '  ":" types the value: input VALUE'
