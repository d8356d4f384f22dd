# SPDX-License-Identifier: BSD-3-Clause
"""Explanations why no machine exists: the smallest conflict, in the words of the request.

The first of these checks that fails gives the explanation: Is an initial state possible? Could the goal be reached if
the world helped? Has the system an answer in every state? If all pass, the world can prevent the goal forever, and a
play shows how.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import reduce
from itertools import combinations, islice
from operator import or_
from typing import Any, Final, NamedTuple

from .encoding import Diagram
from .formulas import Join, Not, VariableName, names_in, valuation
from .solver import Game, Removal, Solution, Watch
from .specification import Section, Specification
from .translation import OBJECTIVE, ONE_ACTIVE, SynthesisProblem

# Plays in which the world prevents a goal, and their text in the words of the capabilities.
#
# Outside of the winning states the world has a move after which the system is still outside, with every answer. A play
# continues forever without meeting the starved guarantee, or ends where the system has no answer.

MAX_ANSWERS: Final = 30
"""Maximum number of answers on offer."""

Values = dict[str, int]


class CounterPlay:
    """A play step by step: :attr:`inputs` is the move of the world, :attr:`answers` are the possible answers.

    ``solution`` is the solution of a lost game, solved with ``explained``. A ``lenient`` world first lets capabilities
    succeed wherever it does not lose by that, so that the play soon comes to where the world prevents the goal.
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
        here = valuation(self.state or {})
        removal = self._removal()
        key = tuple((self.state or {}).values())
        self._visits[key] = self._visits.get(key, 0) + 1
        moves = of.given(here, self._world_moves(removal, here) & game.world)
        if self._lenient and self._visits[key] == 1:
            winning = game.answered(of.primed(self._solution.winning))
            harmless = of.given(here, reduce(or_, game.live, of.false) & ~winning)
            moves = harmless if harmless != of.false else moves
        inputs = next(of.members(game.inputs_next, moves))
        self._offer(inputs, of.given({**here, **inputs}, game.system), game.outputs_next)

    def _world_moves(self, removal: Removal, here: dict[VariableName, int]) -> Diagram:
        """Return the moves with which the world keeps winning; at every second visit, those with an outcome that has to
        follow at some time, each in its turn."""
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
        turn, is_odd = divmod(self._visits[tuple((self.state or {}).values())], 2)
        lively = [of.given(here, one & ~game.answered(closer)) for one in game.live]
        lively = [one for one in lively if one != of.false]
        return moves if is_odd or not lively else lively[turn % len(lively)]

    def _removal(self) -> Removal:
        here = valuation(self.state or {})
        of = self._of
        return next(one for one in self._solution.removals if of.has(here, one.kept) and not of.has(here, one.reached))

    def _count_assumption(self, before: Values, after: Values) -> None:
        step = {**valuation(before), **valuation(after, primed=True)}
        if self._of.has(step, self._game.assumptions[self._assumption]):
            self._assumption = (self._assumption + 1) % len(self._game.assumptions)

    def _offer(self, inputs: dict[VariableName, int], answers: Diagram, names: list[VariableName]) -> None:
        self.inputs = {name.name: value for name, value in inputs.items()}
        found = islice(self._of.members(names, answers), MAX_ANSWERS)
        self.answers = [{name.name: value for name, value in one.items()} for one in found]

    @property
    def is_hopeless(self) -> bool:
        """True if the goal is out of reach from here, even if the world helps from now on."""
        return self.state is not None and not self._of.has(valuation(self.state), self._game.hopeful)

    def nearest_answer(self) -> int:
        """Return the number of the answer from which least luck is needed."""
        game, of = self._game, self._of
        if self._near is None:
            self._near = [of.false]
            meets = game.guarantees[0] & of.primed(game.hopeful)
            while (wider := game.with_luck(meets | of.primed(self._near[-1]))) != self._near[-1]:
                self._near.append(wider)
        states = [valuation({**self.inputs, **answer}) for answer in self.answers]
        far = len(self._near)
        distances = [next((n for n, near in enumerate(self._near) if of.has(one, near)), far) for one in states]
        return distances.index(min(distances))

    def why_none(self) -> list[str]:
        """Return a minimal set of formulas that exclude all answers; for a position without an answer."""
        game, of = self._game, self._of
        section = Section.SYS_INIT if self.state is None else Section.SYS_TRANS
        known = valuation(self.inputs, primed=self.state is not None)
        known |= valuation(self.state or {})
        lines = [line for line in game.specification.lines if line.section is section]
        lines.sort(key=lambda line: line.origin is not None)  # what the user wrote is left out last
        needed = list(lines)
        for line in lines:
            without = [one for one in needed if one is not line]
            if of.given(known, of.all_of(one.formula for one in without) & of.in_range(game.outputs_next)) == of.false:
                needed = without
        return list(dict.fromkeys(line.meaning for line in needed))


# Plays in the words of capabilities.

MAX_STEPS: Final = 40
"""Maximum number of displayed steps."""


class PlayStep(NamedTuple):
    """A position of a play: the active capabilities, the move of the world, and the chosen answer."""

    doing: str
    world: str
    choices: tuple[str, ...]
    chosen: str


def played(play: CounterPlay, problem: SynthesisProblem) -> tuple[tuple[PlayStep, ...], tuple[str, ...]]:
    """Return a play in which the system needs least luck, and the reason for its end.

    It ends when a position comes a third time, after MAX_STEPS, when no answer is left (the reason has the demands that
    exclude all of them), or when the goal cannot be reached any more.
    """
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
    """Describe the active capabilities and the known facts."""
    if state is None:
        return 'the start'
    words = problem.vocabulary
    doing = ' and '.join((*words.active_in(state), *words.ends_in(state))) or 'nothing'
    held = problem.holding(state)
    return f'{doing} (holds {", ".join(held)})' if held else doing


def world_text(play: CounterPlay, problem: SynthesisProblem) -> str:
    """Describe the world's move."""
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
    """Return a text for each answer: the active capabilities and known facts after it. Equal texts are numbered."""
    texts = [state_text({**play.inputs, **one}, problem) for one in play.answers]
    return tuple(
        text if texts.count(text) == 1 else f'{text} ({texts[:index].count(text) + 1})'
        for index, text in enumerate(texts)
    )


SEARCH_TIME: Final = 10.0
"""Time limit of the search for a smallest conflict, once a minimal one is known, s."""


class FailureKind(Enum):
    """The kind of a failure; the values begin its message."""

    START = 'the initial conditions contradict each other'
    LUCK = 'the goal cannot be reached, even if everything goes well'
    DEAD_END = 'the machine can come to a point where nothing is allowed any more'
    NEVER = 'the world can prevent the goal forever'


@dataclass(frozen=True, slots=True)
class Explanation:
    """An explanation why no machine exists.

    ``conflict`` are the demands that are impossible together, as quoted from the files with their places; ``never`` are
    those of them that can never be met. ``steps`` is an example play, and ``stuck`` the reason for its end.
    ``remedies`` are changes that may help.
    """

    kind: FailureKind
    conflict: tuple[str, ...]
    is_smallest: bool
    never: tuple[str, ...] = ()
    steps: tuple[PlayStep, ...] = ()
    stuck: tuple[str, ...] = ()
    remedies: tuple[str, ...] = ()
    play: CounterPlay | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the explanation as plain data."""
        return {
            'kind': self.kind.name,
            'text': self.kind.value,
            'conflict': list(self.conflict),
            'is_smallest': self.is_smallest,
            'never': list(self.never),
            'steps': [step._asdict() for step in self.steps],
            'stuck': list(self.stuck),
            'remedies': list(self.remedies),
        }


def explained(problem: SynthesisProblem, watch: Watch | None = None) -> Explanation:
    """Explain why no strategy solves a problem. The caller knows that none does."""
    return _Question(problem, watch or (lambda _: None)).answer()


class _Question:
    def __init__(self, problem: SynthesisProblem, watch: Watch) -> None:
        self._problem = problem
        self._specification = problem.specification
        self._watch = watch
        self._game = Game(problem.specification, watch=watch)
        self._encoding = self._game.encoding

    def answer(self) -> Explanation:
        kind = next(kind for kind in FailureKind if self._fails(kind, self._specification))
        demands = list(
            dict.fromkeys(
                line.origin for line in self._specification.lines if line.origin and not _is_of_world(line.section)
            )
        )
        until = time.monotonic() + SEARCH_TIME

        def conflicts(kept: Sequence[str]) -> bool:
            self._watch(f'looking for the smallest conflict among {len(demands)} demands')
            return self._fails(kind, self._specification.without(set(demands) - set(kept)))

        conflict, is_smallest = smallest_conflict(demands, conflicts, lambda: time.monotonic() < until)
        told = Explanation(kind, conflict, is_smallest, remedies=tuple(self._remedies(kind)))
        match kind:
            case FailureKind.START:
                return told
            case FailureKind.LUCK if self._exclude_each_other(conflict):
                alone = 'it contradicts itself, the values that there are, or what can be active at once'
                them = alone if len(conflict) == 1 else 'they contradict each other'
                return replace(told, remedies=(f'change what is asked for: {them}, whatever the capabilities do',))
            case FailureKind.LUCK:
                return replace(told, never=tuple(self._never(conflict)))
        solution = self._posed(kind, self._specification).solved(explained=True)
        steps, stuck = played(CounterPlay(solution, lenient=True), self._problem)
        return replace(told, steps=steps, stuck=stuck, play=CounterPlay(solution))

    def _posed(self, kind: FailureKind, specification: Specification) -> Game:
        """Return a game with fewer demands. All demands decide when giving up is too early."""
        restraint = None if kind is FailureKind.LUCK else self._game.restraint
        return Game(self._asked(kind, specification), self._encoding, self._watch, restraint)

    def _asked(self, kind: FailureKind, specification: Specification) -> Specification:
        """Return what a question is about: luck, the demands that are left; dead ends have nothing to do with liveness,
        nor with when to give up."""
        if kind is FailureKind.LUCK:
            return replace(specification, hopes=tuple(specification.of(Section.SYS_LIVENESS)))
        if kind is FailureKind.NEVER:
            return replace(specification, last_resort=None, hopes=())
        safety = tuple(line for line in specification.lines if not line.section.value.endswith('LIVENESS'))
        return replace(specification, lines=safety, last_resort=None, live=())

    def _fails(self, kind: FailureKind, specification: Specification) -> bool:
        game = self._posed(kind, specification)
        match kind:
            case FailureKind.START:
                return not game.can_begin_in(self._encoding.true)
            case FailureKind.LUCK:
                return not game.can_begin_in(game.hopeful)
            case FailureKind.DEAD_END | FailureKind.NEVER:
                return not game.can_begin_in(game.solved().winning)

    def _exclude_each_other(self, demands: Sequence[str]) -> bool:
        """Return whether demands contradict each other even if all variables may change freely."""
        lines = self._specification.lines
        asked = [line for line in lines if line.origin in demands]
        begun = [line for line in lines if line.origin is None and line.section.value.endswith('INIT')]
        meant = [line for line in lines if line.origin is None and line.rule in (OBJECTIVE, ONE_ACTIVE)]
        return self._fails(FailureKind.LUCK, replace(self._specification, lines=(*asked, *begun, *meant)))

    def _never(self, conflict: Sequence[str]) -> list[str]:
        """Return what of a conflict never becomes possible from the start, whatever the world does, and which
        preconditions never hold."""
        game, of = self._game, self._encoding
        reached = game.start_world & game.start_system
        while True:
            self._watch('looking for what is ever possible')
            wider = reached | of.unprimed(of.some([*game.inputs, *game.outputs], reached & game.world & game.system))
            if wider == reached:
                break
            reached = wider
        found = []
        words = self._problem.vocabulary
        for name in words.outcomes:
            active = of.set_of(self._problem.formula(words.active(name)))
            if reached & active != of.false:
                continue
            lacking = []
            for line in self._specification.lines:
                match line.formula:
                    case Join('->', (Not(condition), Not(then))) if line.origin and of.set_of(then) == of.primed(
                        active
                    ):
                        if of.primed(reached) & of.set_of(condition) == of.false:
                            lacking.append(line.origin)
            activation = set(names_in(self._problem.formula(words.active(name, primed=True))))
            limits: list[str | None] = [*lacking] or [
                line.origin for line in self._specification.lines if not activation.isdisjoint(names_in(line.formula))
            ]
            if conflict and set(conflict).isdisjoint(limits):
                continue  # the goal is not missed for its sake
            found.append(f'{name} never becomes possible' + (f': {"; ".join(lacking)} never holds' if lacking else ''))
        return found

    def _remedies(self, kind: FailureKind) -> list[str]:
        options = self._problem.options
        match kind:
            case FailureKind.START:
                return ['change one of the conditions above']
            case FailureKind.LUCK:
                return ['give a capability the postcondition that is missing, or drop one of the demands above']
            case FailureKind.DEAD_END:
                return [
                    'allow something after the outcome at which it ends: a capability, or an outcome of the machine',
                    "add 'failed' to the outcomes of the machine",
                ]
            case FailureKind.NEVER:
                found = []
                if options.liveness.value != 'fair' and options.retries is None:
                    found.append('assume that what is tried again and again completes at some time: --liveness fair')
                if options.retries is None:
                    found.append('let the machine give up: --retries N, which adds the outcome failed')
                return [*found, 'drop one of the demands above']


def _is_of_world(section: Section) -> bool:
    return section.value.startswith('ENV')


# The smallest set of demands that conflict.
#
# That something conflicts stays so when demands are added. One set that is minimal is found by halving (Junker:
# QuickXplain, 2004); a smallest one by sets of which it has to have a member each, the demands that remain outside of
# what can be fulfilled together (Ignatiev, Previti, Liffiton, Marques-Silva: Smallest MUS extraction, 2015).

Conflicts = Callable[[Sequence[str]], bool]

_MOST_SETS: Final = 20_000


class Conflict(NamedTuple):
    """Demands of which each is needed for the conflict; ``is_smallest`` when no smaller set conflicts."""

    demands: tuple[str, ...]
    is_smallest: bool


def smallest_conflict(demands: Sequence[str], conflicts: Conflicts, may_go_on: Callable[[], bool]) -> Conflict:
    """Return a smallest set of demands that conflict, given that all of them do.

    ``may_go_on`` is called before each further search. If it returns False, the result is a minimal set: each member is
    needed, but a smaller set may exist.
    """
    if conflicts(()):
        return Conflict((), True)
    minimal = _minimal((), tuple(demands), conflicts, is_new=False)
    outside: list[frozenset[str]] = []
    tried = 0
    while may_go_on():
        for size in range(len(minimal)):
            candidate = None
            for one in combinations(sorted(set().union(*outside), key=demands.index), size):
                tried += 1
                if tried > _MOST_SETS:
                    return Conflict(minimal, False)
                if all(hit & set(one) for hit in outside):
                    candidate = one
                    break
            if candidate is not None:
                break
        if candidate is None:
            return Conflict(minimal, True)
        if conflicts(candidate):
            return Conflict(candidate, True)
        rest = tuple(one for one in demands if one not in candidate)
        fulfilled = _extended(candidate, rest, conflicts)
        outside.append(frozenset(demands) - frozenset(fulfilled))
    return Conflict(minimal, False)


def _minimal(
    background: tuple[str, ...], demands: tuple[str, ...], conflicts: Conflicts, *, is_new: bool
) -> tuple[str, ...]:
    """Return the ``demands`` that are needed beside the ``background``; ``is_new``: the background has grown."""
    if is_new and conflicts(background):
        return ()
    if len(demands) == 1:
        return demands
    half = len(demands) // 2
    first, second = demands[:half], demands[half:]
    of_second = _minimal((*background, *first), second, conflicts, is_new=bool(first))
    of_first = _minimal((*background, *of_second), first, conflicts, is_new=bool(of_second))
    return (*of_first, *of_second)


def _extended(chosen: tuple[str, ...], rest: tuple[str, ...], conflicts: Conflicts) -> tuple[str, ...]:
    """As many further demands as can be fulfilled beside those that are chosen."""
    if not rest or not conflicts((*chosen, *rest)):
        return (*chosen, *rest)
    if len(rest) == 1:
        return chosen
    half = len(rest) // 2
    return _extended(_extended(chosen, rest[:half], conflicts), rest[half:], conflicts)
