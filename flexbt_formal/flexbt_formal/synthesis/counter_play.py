# SPDX-License-Identifier: BSD-3-Clause
"""Plays in which the world prevents a goal, and their text in the words of the capabilities.

Outside of the winning states the world has a move after which the system is still outside, with every answer. A play
continues forever without meeting the starved guarantee, or ends where the system has no answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from typing import Final, NamedTuple

from flexbt_formal.synthesis.games.encoding import Diagram
from flexbt_formal.synthesis.games.formula import VariableName
from flexbt_formal.synthesis.games.solver import Removal, Solution
from flexbt_formal.synthesis.games.specification import Section

from .translation import SynthesisProblem

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
        """Answer for the system by one of ``answers``, and make the next move of the world. Raises IndexError."""
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

    def _world_moves(self, removal: Removal, here: dict[VariableName, int]) -> Diagram:
        """Return the moves by which the world stays ahead; among them from time to time those that it has to take."""
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
        step = {**self._named(before), **{VariableName(name, True): value for name, value in after.items()}}
        if self._of.has(step, self._game.assumptions[self._assumption]):
            self._assumption = (self._assumption + 1) % len(self._game.assumptions)

    def _offer(self, inputs: dict[VariableName, int], answers: Diagram, names: list[VariableName]) -> None:
        self.inputs = {name.name: value for name, value in inputs.items()}
        found = islice(self._of.members(names, answers), MAX_ANSWERS)
        self.answers = [{name.name: value for name, value in one.items()} for one in found]

    @property
    def is_hopeless(self) -> bool:
        """True if the goal is out of reach from here, even if the world helps from now on."""
        return self.state is not None and not self._of.has(self._named(self.state), self._game.hopeful)

    def nearest_answer(self) -> int:
        """Return the number of the answer from which least luck is needed."""
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
        """Return where there is no answer: the formulas that exclude all of them, none of which could be left out."""
        game, of = self._game, self._of
        section = Section.SYS_INIT if self.state is None else Section.SYS_TRANS
        known = {VariableName(name, self.state is not None): value for name, value in self.inputs.items()}
        known |= self._named(self.state or {})
        lines = [line for line in game.specification.lines if line.section is section]
        lines.sort(key=lambda line: line.origin is not None)  # what the user wrote is left out last
        needed = list(lines)
        for line in lines:
            without = [one for one in needed if one is not line]
            if of.given(known, of.all_of(one.formula for one in without) & of.in_range(game.outputs_next)) == of.false:
                needed = without
        return list(dict.fromkeys(line.meaning for line in needed))

    def _named(self, values: Values) -> dict[VariableName, int]:
        return {VariableName(name): value for name, value in values.items()}


# Plays in the words of capabilities.

MAX_STEPS: Final = 40
"""Maximum number of steps that are shown."""


class PlayStep(NamedTuple):
    """A position of a play: what is active, what the world answers, and what was chosen of what may follow."""

    doing: str
    world: str
    choices: tuple[str, ...]
    chosen: str


def played(play: CounterPlay, problem: SynthesisProblem) -> tuple[tuple[PlayStep, ...], tuple[str, ...]]:
    """Return a play in which the system does what takes least luck, until it has come round or the goal is out of
    reach; and why it ends: the demands that leave no answer, or that nothing helps any more."""
    steps: list[PlayStep] = []
    seen: dict[tuple[object, ...], int] = {}
    while len(steps) < MAX_STEPS:
        if not play.answers:
            steps.append(PlayStep(state_text(play.state, problem), world_text(play, problem), (), ''))
            return tuple(steps), tuple(play.why_none())
        key = tuple((play.state or {}).values())
        seen[key] = seen.get(key, 0) + 1
        if seen[key] > 2:
            break
        choices = answers_text(play, problem)
        chosen = play.nearest_answer()
        step = PlayStep(state_text(play.state, problem), world_text(play, problem), choices, choices[chosen])
        steps += [step] if len(choices) > 1 or problem.vocabulary.active_in(play.state or {}) else []
        play.answer(chosen)
        if play.is_hopeless:
            return tuple(steps), ('from there the goal is out of reach, even if everything goes well',)
    return tuple(steps), ()


def state_text(state: Mapping[str, int] | None, problem: SynthesisProblem) -> str:
    """Return what is active, and what is known."""
    if state is None:
        return 'the start'
    words = problem.vocabulary
    doing = ' and '.join((*words.active_in(state), *words.ends_in(state))) or 'nothing'
    return f'{doing}{_holding(state, problem)}'


def world_text(play: CounterPlay, problem: SynthesisProblem) -> str:
    """Return what the world does."""
    words = problem.vocabulary
    said = []
    for name in words.active_in(play.state or {}):
        said += [f'{name} ends by {outcome}' for outcome in words.arrived_in(play.inputs, name)]
    own = {name.name for name in problem.specification.names(inputs=True) if words.is_own(name.name)}
    said += [
        name if value == 1 else f'{name}={value}' for name, value in play.inputs.items() if value and name not in own
    ]
    return ', '.join(said) or ('nothing' if play.state is not None else 'all is as it is at the start')


def answers_text(play: CounterPlay, problem: SynthesisProblem) -> tuple[str, ...]:
    """Return what may follow, each by what becomes active and what is known then; where that is the same, it is
    numbered."""
    texts = [state_text({**play.inputs, **one}, problem) for one in play.answers]
    return tuple(
        text if texts.count(text) == 1 else f'{text} ({texts[:index].count(text) + 1})'
        for index, text in enumerate(texts)
    )


def _holding(state: Mapping[str, int], problem: SynthesisProblem) -> str:
    held = problem.holding(state)
    return f' (holds {", ".join(held)})' if held else ''
