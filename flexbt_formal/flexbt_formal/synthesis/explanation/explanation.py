# SPDX-License-Identifier: BSD-3-Clause
"""Why there is no machine, in the words of who asked for one.

The questions are asked in this order, and the first answer counts: can it begin at all; could it succeed if the world
helped; is there always something left to do; and only then: what does the world do to prevent the goal for ever.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final

from flexbt_formal.synthesis.games import Game, Join, Not, Section, Specification, Watch, names_in
from flexbt_formal.synthesis.inputs import OBJECTIVE, ONE_ACTIVE, Problem

from .conflict import smallest_conflict
from .counter_play import CounterPlay
from .play_text import Step, played

SEARCH_TIME: Final = 10.0
"""How long a smallest conflict is looked for, once a minimal one is known, s."""


class Kind(Enum):
    """What kind of failure it is; the values are how it begins to be told."""

    START = 'the initial conditions contradict each other'
    LUCK = 'the goal cannot be reached, even if everything goes well'
    DEAD_END = 'the machine can come to a point where nothing is allowed any more'
    NEVER = 'the world can prevent the goal for ever'


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why there is no machine. ``conflict`` is what was asked for and cannot be had together, in the words of the
    files, with place; ``never`` what of that never becomes possible; ``steps`` one course of events, and ``stuck`` why
    it ends; ``remedies`` what may help."""

    kind: Kind
    conflict: tuple[str, ...]
    is_smallest: bool
    never: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    stuck: tuple[str, ...] = ()
    remedies: tuple[str, ...] = ()
    play: CounterPlay | None = None

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
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


def explained(problem: Problem, watch: Watch | None = None) -> Explanation:
    """Why no strategy solves a problem, given that none does."""
    return _Question(problem, watch or (lambda _: None)).answer()


class _Question:
    def __init__(self, problem: Problem, watch: Watch) -> None:
        self._problem = problem
        self._specification = problem.specification
        self._watch = watch
        self._game = Game(problem.specification, watch=watch)
        self._encoding = self._game.encoding

    def answer(self) -> Explanation:
        kind = next(kind for kind in Kind if self._fails(kind, self._specification))
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
            case Kind.START:
                return told
            case Kind.LUCK if self._exclude_each_other(conflict):
                alone = 'it contradicts itself, the values that there are, or what can be active at once'
                them = alone if len(conflict) == 1 else 'they contradict each other'
                return replace(told, remedies=(f'change what is asked for: {them}, whatever the capabilities do',))
            case Kind.LUCK:
                return replace(told, never=tuple(self._never(conflict)))
        solution = self._posed(kind, self._specification).solved(explained=True)
        steps, stuck = played(CounterPlay(solution, lenient=True), self._problem)
        return replace(told, steps=steps, stuck=stuck, play=CounterPlay(solution))

    def _posed(self, kind: Kind, specification: Specification) -> Game:
        """A game with fewer demands; when giving up is too early, all of them decide."""
        restraint = None if kind is Kind.LUCK else self._game.restraint
        return Game(self._asked(kind, specification), self._encoding, self._watch, restraint)

    def _asked(self, kind: Kind, specification: Specification) -> Specification:
        """What a question is about: dead ends have nothing to do with liveness, nor with when to give up."""
        if kind is Kind.LUCK:
            return specification
        if kind is Kind.NEVER:
            return replace(specification, last_resort=None, hopes=())
        safety = tuple(line for line in specification.lines if not line.section.value.endswith('LIVENESS'))
        return replace(specification, lines=safety, last_resort=None, live=())

    def _fails(self, kind: Kind, specification: Specification) -> bool:
        game = self._posed(kind, specification)
        match kind:
            case Kind.START:
                return not game.can_begin_in(self._encoding.true)
            case Kind.LUCK:
                return not game.can_begin_in(game.hopeful)
            case Kind.DEAD_END | Kind.NEVER:
                return not game.can_begin_in(game.solved().winning)

    def _exclude_each_other(self, demands: Sequence[str]) -> bool:
        """Whether demands could not be had together either if everything changed as it pleases."""
        lines = self._specification.lines
        asked = [line for line in lines if line.origin in demands]
        begun = [line for line in lines if line.origin is None and line.section.value.endswith('INIT')]
        meant = [line for line in lines if line.origin is None and line.rule in (OBJECTIVE, ONE_ACTIVE)]
        return self._fails(Kind.LUCK, replace(self._specification, lines=(*asked, *begun, *meant)))

    def _never(self, conflict: Sequence[str]) -> list[str]:
        """What of a conflict never becomes possible from the start, whatever the world does, and which preconditions
        never hold."""
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

    def _remedies(self, kind: Kind) -> list[str]:
        options = self._problem.options
        match kind:
            case Kind.START:
                return ['change one of the conditions above']
            case Kind.LUCK:
                return ['give a capability the postcondition that is missing, or drop one of the demands above']
            case Kind.DEAD_END:
                return [
                    'allow something after the outcome at which it ends: a capability, or an outcome of the machine',
                    "add 'failed' to the outcomes of the machine",
                ]
            case Kind.NEVER:
                found = []
                if options.liveness.value != 'fair' and options.retries is None:
                    found.append('assume that what is tried again and again completes at some time: --liveness fair')
                if options.retries is None:
                    found.append('let the machine give up: --retries N, which adds the outcome failed')
                return [*found, 'drop one of the demands above']


def _is_of_world(section: Section) -> bool:
    return section.value.startswith('ENV')
