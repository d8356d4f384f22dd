# SPDX-License-Identifier: BSD-3-Clause
"""How the world prevents it: a play against a strategy that nothing beats.

Outside of the winning states the world has a move after which the system is still outside, whatever it answers. A play
goes on for ever without the guarantee that starves, or ends where the system has no answer.
"""

from __future__ import annotations

from itertools import islice
from typing import Final

from flexbt_formal.synthesis.games import Diagram, Name, Removal, Section, Solution

MAX_ANSWERS: Final = 30
"""Answers that are offered at most."""

Values = dict[str, int]


class CounterPlay:
    """A play step by step: :attr:`inputs` is what the world does, :attr:`answers` what the system may answer.

    ``solution`` is that of a game that is lost, solved with ``explained``. A ``lenient`` world lets things succeed at
    first wherever it can afford that, so that the point is reached sooner at which it prevents the goal.
    """

    def __init__(self, solution: Solution, *, lenient: bool = False) -> None:
        self._solution = solution
        self._lenient = lenient
        self._near: list[Diagram] | None = None
        self._game = solution.game
        self._of = solution.game.encoding
        self._visits: dict[tuple[int, ...], int] = {}
        self._assumption = 0
        self.state: Values | None = None
        self.inputs: Values = {}
        self.answers: list[Values] = []
        self._begin()

    def answer(self, number: int) -> None:
        """The system answers by one of ``answers``, and the world makes its next move. Raises IndexError."""
        chosen = self.answers[number]
        before = self.state
        self.state = {**self.inputs, **chosen}
        if before is not None:
            self._count_assumption(before, self.state)
        self._move()

    def _begin(self) -> None:
        game, of = self._game, self._of
        losing = game.start_world & ~of.some(game.outputs, game.start_system & self._solution.winning)
        inputs = next(of.members(game.inputs, losing))
        self._offer(inputs, of.given(inputs, game.start_system), game.outputs)

    def _move(self) -> None:
        game, of = self._game, self._of
        here = self._named(self.state or {})
        removal = self._removal()
        key = tuple((self.state or {}).values())
        self._visits[key] = self._visits.get(key, 0) + 1
        moves = of.given(here, self._world_moves(removal, here) & game.world)
        if self._lenient and self._visits[key] == 1:
            winning = game.answered(of.primed(self._solution.winning))
            harmless = of.given(here, game.world & game.live & ~winning)
            moves = harmless if harmless != of.false else moves
        inputs = next(of.members(game.inputs_next, moves))
        self._offer(inputs, of.given({**here, **inputs}, game.system), game.outputs_next)

    def _world_moves(self, removal: Removal, here: dict[Name, int]) -> Diagram:
        """The moves by which the world stays ahead; among them from time to time those that it has to take."""
        game, of = self._game, self._of
        stays = of.primed(removal.kept)
        closer = (game.guarantees[removal.goal] & stays) | of.primed(removal.reached)
        away = of.given(here, game.world & ~game.answered(closer | stays))
        if away != of.false:
            return away
        shrinking = removal.waits[self._assumption]
        last = next(index for index, states in enumerate(shrinking) if not of.has(here, states))
        waiting = ~game.assumptions[self._assumption] & of.primed(shrinking[last - 1])
        moves = of.given(here, game.world & ~game.answered(closer | waiting))
        lively = of.given(here, game.world & game.live)
        if lively != of.false and self._visits.get(tuple((self.state or {}).values()), 0) % 2 == 0:
            return lively
        return moves

    def _removal(self) -> Removal:
        here = self._named(self.state or {})
        of = self._of
        return next(one for one in self._solution.removals if of.has(here, one.kept) and not of.has(here, one.reached))

    def _count_assumption(self, before: Values, after: Values) -> None:
        step = {**self._named(before), **{Name(name, True): value for name, value in after.items()}}
        if self._of.has(step, self._game.assumptions[self._assumption]):
            self._assumption = (self._assumption + 1) % len(self._game.assumptions)

    def _offer(self, inputs: dict[Name, int], answers: Diagram, names: list[Name]) -> None:
        self.inputs = {name.name: value for name, value in inputs.items()}
        found = islice(self._of.members(names, answers), MAX_ANSWERS)
        self.answers = [{name.name: value for name, value in one.items()} for one in found]

    @property
    def is_hopeless(self) -> bool:
        """Whether the goal is out of reach from here, even if the world helps from now on."""
        return self.state is not None and not self._of.has(self._named(self.state), self._game.hopeful)

    def nearest_answer(self) -> int:
        """The number of the answer from which least luck is needed."""
        game, of = self._game, self._of
        if self._near is None:
            self._near = [of.false]
            meets = game.guarantees[0] & of.primed(game.hopeful)
            while (wider := game.with_luck(meets | of.primed(self._near[-1]))) != self._near[-1]:
                self._near.append(wider)
        states = [self._named({**self.inputs, **answer}) for answer in self.answers]
        far = len(self._near)
        distances = [next((n for n, near in enumerate(self._near) if of.has(one, near)), far) for one in states]
        return distances.index(min(distances))

    def why_none(self) -> list[str]:
        """Where there is no answer: the formulas that exclude all of them, none of which could be left out."""
        game, of = self._game, self._of
        section = Section.SYS_INIT if self.state is None else Section.SYS_TRANS
        known = {Name(name, self.state is not None): value for name, value in self.inputs.items()}
        known |= self._named(self.state or {})
        lines = [line for line in game.specification.lines if line.section is section]
        lines.sort(key=lambda line: line.origin is not None)  # what the user wrote is left out last
        needed = list(lines)
        for line in lines:
            without = [one for one in needed if one is not line]
            if of.given(known, of.all_of(one.formula for one in without) & of.in_range(game.outputs_next)) == of.false:
                needed = without
        return list(dict.fromkeys(line.meaning for line in needed))

    def _named(self, values: Values) -> dict[Name, int]:
        return {Name(name): value for name, value in values.items()}
