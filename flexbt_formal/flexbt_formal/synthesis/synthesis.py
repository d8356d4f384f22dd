# SPDX-License-Identifier: BSD-3-Clause
"""Synthesis of a machine from a problem: solve, extract, check, minimize."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from .certificate import check_certificate
from .errors import SynthesisError, SynthesisTimeout
from .explanation import Explanation, explained
from .from_strategy import SynthesizedMachine, machine_of
from .solver import Game, Watch
from .strategy import Strategy, strategy_of
from .translation import SynthesisProblem

_REPORT_SECONDS: Final = 0.5


@dataclass(frozen=True, slots=True)
class Synthesis:
    """The answer to a problem: a machine with its checked strategy, or an explanation why none exists.

    ``figures`` are about the work: rounds of the outer fixpoint, layers by guarantee, nodes of the strategy.
    """

    problem: SynthesisProblem
    machine: SynthesizedMachine | None = None
    strategy: Strategy | None = None
    explanation: Explanation | None = None
    figures: dict[str, Any] = field(default_factory=dict)


def time_limited(limit: float, remedy: str, report: Callable[[str, float], None]) -> Watch:
    """Return a watch that reports the current step and the elapsed seconds, at most twice a second.

    It raises SynthesisTimeout after ``limit`` seconds.
    """
    began = reported = time.monotonic()

    def watch(doing: str) -> None:
        nonlocal reported
        now = time.monotonic()
        if now - began > limit:
            raise SynthesisTimeout(f'no answer within {limit:g} s ({doing}); {remedy}')
        if now - reported > _REPORT_SECONDS:
            reported = now
            report(doing, now - began)

    return watch


def synthesize(problem: SynthesisProblem, watch: Watch | None = None) -> Synthesis:
    """Solve a problem. ``watch`` is called between steps with what is being done, and may raise to end it.

    Raises:
        SynthesisError: nothing is requested, or the world cannot exist; there is a strategy, but no machine
            carries it out; or the check of its certificate fails, which is a fault of the solver.
    """
    specification = problem.specification
    game = Game(specification, watch=watch)
    solution = game.solved() if game.can_begin_in(game.hopeful) else None
    if solution is None or not solution.is_realizable():
        return Synthesis(problem, explanation=explained(problem, watch))
    figures = {'rounds': solution.rounds, 'layers': [len(layers) for layers in solution.layers]}
    strategy = strategy_of(solution)
    if not strategy.start:
        raise SynthesisError(['the world cannot begin in any way: the formulas of ENV_INIT contradict each other'])
    wrong = check_certificate(specification, strategy.to_json())
    if wrong:
        raise SynthesisError(['the strategy does not fulfil the specification: a fault of the solver', *wrong[:5]])
    return Synthesis(
        problem, machine_of(problem, strategy), strategy, figures={**figures, 'nodes': len(strategy.nodes)}
    )
