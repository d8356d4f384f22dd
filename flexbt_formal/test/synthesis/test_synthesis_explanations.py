# SPDX-License-Identifier: BSD-3-Clause
"""Why there is no machine: the smallest conflict, and a play that nobody wins."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthesis_support import coffee
from test_synthesis_games import formulas, specifications

from flexbt_formal.synthesis.explanation import CounterPlay, Explanation, FailureKind, smallest_conflict
from flexbt_formal.synthesis.formulas import TRUE, Formula, VariableName, value_of
from flexbt_formal.synthesis.solver import Game
from flexbt_formal.synthesis.specification import Section, Specification
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import Liveness, SynthesisProblem

ENDS = '    transition_relation: {failure: [finished]}'


def refused(problem: SynthesisProblem) -> Explanation:
    explanation = synthesize(problem).explanation
    assert explanation is not None
    return explanation


@pytest.mark.parametrize(
    ('problem', 'kind', 'conflict'),
    [
        (
            coffee(initial=('press_a', '!press_a')),
            FailureKind.START,
            ["initial condition 'press_a' (request)", "initial condition '!press_a' (request)"],
        ),
        (
            coffee(goals=('brew', '!brew & grind')),
            FailureKind.LUCK,
            ["goal 'brew' (request)", "goal '!brew & grind' (request)"],
        ),
        (
            coffee(
                ('failure: [grind]}', f'failure: [grind]}}\n{ENDS}'),
                initial=('grind_m', 'brew_a'),
            ),
            FailureKind.DEAD_END,
            [
                "initial condition 'brew_a' (request)",
                "transition_relation 'finished' of brew after failure (coffee.yaml:18)",
                "goal 'brew' (request)",
            ],
        ),
        (
            coffee(('failure: [grind]}', "failure: ['!grind']}"), liveness=Liveness.FAIR_OUTCOMES),
            FailureKind.NEVER,
            [
                "precondition 'grind' of brew (coffee.yaml:16)",
                "postcondition '!grind' of brew after failure (coffee.yaml:17)",
                "goal 'brew' (request)",
            ],
        ),
    ],
    ids=['start', 'luck', 'dead end', 'never'],
)
def test_a_request_that_nothing_fulfils_is_answered_by_what_conflicts(
    problem: SynthesisProblem, kind: FailureKind, conflict: list[str]
) -> None:
    explanation = refused(problem)
    assert explanation.kind is kind
    assert explanation.is_smallest
    assert sorted(explanation.conflict) == sorted(conflict)


def test_a_dead_end_is_told_step_by_step_with_what_leaves_nothing() -> None:
    explanation = refused(coffee(('failure: [grind]}', f'failure: [grind]}}\n{ENDS}'), retries=1))
    assert explanation.steps[-1].world == 'brew ends by failure'
    assert explanation.steps[-1].choices == ()
    assert explanation.stuck[-2:] == (
        "transition_relation 'finished' of brew after failure (coffee.yaml:18)",
        "goal 'brew' (request)",
    )


def test_what_never_becomes_possible_is_named_with_what_it_lacks_where_it_is_needed() -> None:
    clean = '  clean:\n    interface: Try\n    preconditions: [clean]\n'
    explanation = refused(coffee(('completed: [press, ', 'completed: ['), ('  brew:\n', f'{clean}  brew:\n')))
    assert explanation.never == (
        "brew never becomes possible: precondition 'grind' of brew (coffee.yaml:19) never holds",
        "grind never becomes possible: precondition 'press' of grind (coffee.yaml:11) never holds",
    )


@pytest.mark.parametrize(
    ('problem', 'remedy'),
    [
        (coffee(goals=('brew & !brew',)), 'it contradicts itself'),
        (coffee(goals=('brew & !brew',), retries=1), 'it contradicts itself'),
        (coffee(goals=('brew & !brew',), outcomes=('failed',)), 'it contradicts itself'),
        (coffee(goals=('grind_a & brew_a',)), 'what can be active at once'),
        (coffee(goals=('grind_a & brew_a',), parsed=True), 'what can be active at once'),
        (coffee(goals=('brew', '!brew & grind')), 'they contradict each other'),
        (coffee(goals=('press', '!press | !grind', 'grind')), 'they contradict each other'),
    ],
    ids=['one', 'with retries', 'without success', 'two active', 'two active, parsed', 'two', 'three'],
)
def test_a_goal_that_contradicts_itself_is_not_blamed_on_capabilities(problem: SynthesisProblem, remedy: str) -> None:
    explanation = refused(problem)
    assert (explanation.kind, explanation.never) == (FailureKind.LUCK, ())
    assert [one for one in explanation.remedies if remedy in one] == list(explanation.remedies)
    assert explanation.conflict
    assert all(demand.startswith('goal ') for demand in explanation.conflict)


@settings(max_examples=60, deadline=None)
@given(
    specification=specifications(2, 2, 2, 2),
    live=st.one_of(st.none(), formulas(('p', 'a'), ('p', 'q'))),
    lenient=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_a_play_against_the_world_is_by_the_rules_and_never_won(
    specification: Specification, live: Formula | None, lenient: bool, seed: int
) -> None:
    """Whatever is answered: the world keeps its rules, and no state is one from which the system wins."""
    specification = replace(specification, live=() if live is None else ((TRUE, live),))
    solution = Game(specification).solved(explained=True)
    if solution.is_realizable():
        return
    play, dice = CounterPlay(solution, lenient=lenient), random.Random(seed)
    of = solution.game.encoding
    for _ in range(20):
        if play.state is not None:
            step = {VariableName(name): value for name, value in play.state.items()}
            assert not of.has(step, solution.winning)
            step |= {VariableName(name, True): value for name, value in play.inputs.items()}
            assert all(value_of(one, step) for one in specification.of(Section.ENV_TRANS))
        if not play.answers:
            break
        play.answer(dice.randrange(len(play.answers)))


@given(
    sets=st.lists(st.sets(st.integers(0, 7), min_size=1), min_size=1, max_size=5),
)
def test_the_smallest_conflict_is_as_small_as_the_smallest_of_all(sets: Sequence[set[int]]) -> None:
    """Against all subsets, with conflicts that are whatever contains one of some sets."""
    demands = [f'd{number}' for number in range(8)]
    cores = [{f'd{number}' for number in one} for one in sets]

    def conflicts(chosen: Sequence[str]) -> bool:
        return any(core <= set(chosen) for core in cores)

    found = smallest_conflict(demands, conflicts, lambda: True)
    smallest = next(size for size in range(9) if any(conflicts(one) for one in combinations(demands, size)))
    assert found.is_smallest
    assert conflicts(found.demands)
    assert len(found.demands) == smallest


def test_in_haste_no_member_of_the_conflict_can_be_left_out() -> None:
    cores = [{'a', 'b', 'c'}, {'d'}]

    def conflicts(chosen: Sequence[str]) -> bool:
        return any(core <= set(chosen) for core in cores)

    found = smallest_conflict('abcd', conflicts, lambda: False)
    assert not found.is_smallest
    assert conflicts(found.demands)
    assert not any(conflicts([one for one in found.demands if one != left]) for left in found.demands)
