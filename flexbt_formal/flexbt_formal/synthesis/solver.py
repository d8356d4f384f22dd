# SPDX-License-Identifier: BSD-3-Clause
"""Solver of games: the states from which a specification can be fulfilled, and how far each is from the next guarantee.

Three fixpoints in each other (Bloem et al. 2012), over transitions, so that assumptions and guarantees may speak of the
next step. With outcomes that have to follow at some time (``Specification.live``) the set of states that come closer is
widened by those from which each transition with such an outcome does, while all others stay winning (after Banerjee,
Majumdar, Mallik, Schmuck, Soudjani: Fast symbolic algorithms for omega-regular games under strong transition fairness,
2022; here the world chooses among the transitions of an outcome).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from .encoding import Diagram, Encoding
from .specification import Section, Specification

FAIR: Final = -1
"""The kind of a layer that is left by an outcome which follows at some time."""

Watch = Callable[[str], None]
"""Called between the steps of a computation with what it does; may raise, to end it."""


@dataclass(frozen=True, slots=True)
class RankLayer:
    """States that come closer to a guarantee, at the earliest in this layer. ``kind`` is the number of the assumption
    that has to hold at some time, or FAIR."""

    kind: int
    states: Diagram


@dataclass(slots=True)
class Removal:
    """States from which guarantee ``goal`` cannot be met forever, and how the world prevents it.

    ``kept`` are the states that were winning before; ``reached`` those from which the guarantee can be met again.
    ``waits[i]`` are the shrinking sets in which assumption ``i`` has not been met yet.
    """

    goal: int
    kept: Diagram
    reached: Diagram
    waits: list[list[Diagram]] = field(default_factory=list)


class Game:
    """The game of a specification: its moves as diagrams.

    ``hopeful`` are the states from which all guarantees can be met again and again if the world helps. ``restraint``
    are the moves that do not give up too early; where it is given, it is not found out.
    """

    def __init__(
        self,
        specification: Specification,
        encoding: Encoding | None = None,
        watch: Watch | None = None,
        restraint: Diagram | None = None,
    ) -> None:
        self.specification = specification
        self.encoding = encoding or Encoding(specification)
        self.watch = watch or (lambda _: None)
        of = self.encoding
        names = specification.names
        self.inputs, self.outputs = names(inputs=True), names(inputs=False)
        self.inputs_next, self.outputs_next = names(inputs=True, primed=True), names(inputs=False, primed=True)
        state = of.in_range([*self.inputs, *self.outputs])
        self.start_world = self._all(Section.ENV_INIT) & of.in_range(self.inputs)
        self.start_system = self._all(Section.SYS_INIT) & of.in_range(self.outputs)
        self.world = self._all(Section.ENV_TRANS) & of.in_range(self.inputs_next) & state
        self.system = self._all(Section.SYS_TRANS) & of.in_range(self.outputs_next)
        self.assumptions = [of.set_of(one) for one in specification.of(Section.ENV_LIVENESS)] or [of.true]
        self.guarantees = [of.set_of(one) for one in specification.of(Section.SYS_LIVENESS)] or [of.true]
        self.live = [self.world & of.set_of(active) & of.set_of(outcome) for active, outcome in specification.live]
        self.hopeful, self.restraint = self._hopeful()
        self.system = self.system & (self.restraint if restraint is None else restraint)

    def _hopeful(self) -> tuple[Diagram, Diagram]:
        """Return the states from which all can still be met, and the moves that are left when giving up is the last
        resort."""
        of, specification = self.encoding, self.specification
        if specification.last_resort is None:
            return self.hoped_for(self.guarantees, of.true), of.true
        goes_on = ~of.set_of(specification.last_resort)
        hopeful = self.hoped_for([of.set_of(one) for one in specification.hopes], goes_on)
        way_out = of.some(self.outputs_next, self.system & goes_on & of.primed(hopeful))
        return hopeful, goes_on | ~way_out

    def _all(self, section: Section) -> Diagram:
        found = self.encoding.true
        for formula in self.specification.of(section):
            self.watch('reading the formulas')
            found = found & self.encoding.set_of(formula)
        return found

    def can_begin_in(self, states: Diagram) -> bool:
        """Return whether for all inputs at the start there are outputs with which the state is one of these."""
        of = self.encoding
        answered = of.some(self.outputs, self.start_system & states)
        return of.all(self.inputs, ~self.start_world | answered) == of.true

    # -- steps -------------------------------------------------------------------------------------------------------

    def answered(self, targets: Diagram) -> Diagram:
        """Return the moves of the world (states with next inputs) that the system can answer by one of ``targets``."""
        return self.encoding.some(self.outputs_next, self.system & targets)

    def forced(self, targets: Diagram) -> Diagram:
        """Return the states from which each move of the world can be answered by one of ``targets``."""
        return self.encoding.all(self.inputs_next, ~self.world | self.answered(targets))

    def with_luck(self, targets: Diagram) -> Diagram:
        """Return the states from which one of ``targets`` is possible, if the world helps."""
        return self.encoding.some(self.inputs_next, self.world & self.answered(targets))

    def fairly(self, targets: Diagram, safe: Diagram) -> Diagram:
        """Return the states from which the world takes one of ``targets`` at some time, all others being ``safe``: an
        outcome has to follow that leads to ``targets`` whatever comes with it."""
        of = self.encoding
        if not self.live:
            return of.false
        answered, helped = self.answered(targets), of.false
        for moves in self.live:
            helped |= of.some(self.inputs_next, moves) & of.all(self.inputs_next, ~moves | answered)
        return helped & self.forced(safe | targets)

    # -- fixpoints ---------------------------------------------------------------------------------------------------

    def hoped_for(self, guarantees: list[Diagram], moves: Diagram) -> Diagram:
        """Return the states from which guarantees can be met again and again by these moves, if the world helps."""
        of = self.encoding
        kept = of.true
        while True:
            before = kept
            for guarantee in guarantees:
                meets = guarantee & of.primed(kept)
                near = of.false
                while True:
                    self.watch('looking for what can be reached with luck')
                    wider = near | self.with_luck(moves & (meets | of.primed(near)))
                    if wider == near:
                        break
                    near = wider
                kept = kept & near
            if kept == before:
                return kept

    def solved(self, *, explained: bool = False) -> Solution:
        """Return the winning states, with their layers; ``explained`` keeps what the world does about the others."""
        of = self.encoding
        kept, removals = of.true, list[Removal]()
        rounds = 0
        while True:
            rounds += 1
            before = kept
            layers: list[list[RankLayer]] = []
            for number, guarantee in enumerate(self.guarantees):
                near, of_goal, removal = self._approach(number, guarantee, kept)
                layers.append(of_goal)
                if explained and near & kept != kept:
                    removals.append(removal)
                kept = kept & near
            if kept == before:
                return Solution(self, kept, layers, removals, rounds)

    def _approach(self, number: int, guarantee: Diagram, kept: Diagram) -> tuple[Diagram, list[RankLayer], Removal]:
        """From where a guarantee can be met without leaving ``kept``."""
        of = self.encoding
        stays = of.primed(kept)
        meets = guarantee & stays
        near, layers = of.false, list[RankLayer]()
        while True:
            self.watch(f'guarantee {number + 1} of {len(self.guarantees)}: {len(layers)} layers')
            closer = meets | of.primed(near)
            removal = Removal(number, kept, near)
            found = near
            for kind, assumption in enumerate(self.assumptions):
                states, shrinking = of.true, [of.true]
                while True:
                    self.watch(f'guarantee {number + 1} of {len(self.guarantees)}: {len(layers)} layers')
                    fewer = self.forced(closer | (~assumption & of.primed(states)))
                    if fewer == states:
                        break
                    states = fewer
                    shrinking.append(states)
                removal.waits.append(shrinking)
                if states & ~found != of.false:
                    layers.append(RankLayer(kind, states))
                    found = found | states
            fair = self.fairly(closer, stays)
            if fair & ~found != of.false:
                layers.append(RankLayer(FAIR, fair))
                found = found | fair
            if found == near:
                return near, layers, removal
            near = found


@dataclass(frozen=True, slots=True)
class Solution:
    """The winning states of a game. ``layers[j]`` lead to guarantee ``j``, the nearest first."""

    game: Game
    winning: Diagram
    layers: list[list[RankLayer]]
    removals: list[Removal]
    rounds: int

    def is_realizable(self) -> bool:
        """Return whether for all inputs at the start there are outputs that win."""
        return self.game.can_begin_in(self.winning)
