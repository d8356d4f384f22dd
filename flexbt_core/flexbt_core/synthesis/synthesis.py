# SPDX-License-Identifier: BSD-3-Clause
"""The way from a problem to a machine: solve, extract, check, minimize."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .errors import SynthesisError
from .games import Game, Strategy, Watch, check_certificate, strategy_of
from .inputs import Problem
from .machines import SynthesizedMachine, machine_of


@dataclass(frozen=True, slots=True)
class Synthesis:
    """The answer to a problem: a machine with its strategy, whose certificate holds; or None for both."""

    problem: Problem
    machine: SynthesizedMachine | None = None
    strategy: Strategy | None = None
    figures: dict[str, Any] | None = None


def synthesize(problem: Problem, watch: Watch | None = None) -> Synthesis:
    """Solves a problem. ``watch`` is called between steps with what is being done, and may raise to end it.

    Raises:
        SynthesisError: there is a strategy, but no machine carries it out; or the check of its certificate fails,
            which is a fault of the solver.
    """
    game = Game(problem.specification, watch=watch)
    solution = game.solved()
    figures = {'rounds': solution.rounds, 'layers': [len(layers) for layers in solution.layers]}
    if not solution.is_realizable():
        return Synthesis(problem, figures=figures)
    strategy = strategy_of(solution)
    wrong = check_certificate(problem.specification, strategy.to_json())
    if wrong:
        raise SynthesisError(['the strategy does not fulfil the specification: a fault of the solver', *wrong[:5]])
    machine = machine_of(problem, strategy)
    return Synthesis(problem, machine, strategy, {**figures, 'nodes': len(strategy.nodes)})
