# SPDX-License-Identifier: BSD-3-Clause
"""The nemesis: its plans, a few seeds, and mutations that it finds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from flexbt_testing.one_process.mutations import MUTATIONS
from flexbt_testing.one_process.nemesis import Job, Plan, Step, provocation, run_all, run_one, shrink


def test_plans_are_drawn_by_the_seed_and_survive_a_file() -> None:
    for seed in range(200):
        plan = Plan.draw(seed)
        assert plan == Plan.draw(seed) == Plan.read(plan.text())
    assert len({Plan.draw(seed).steps for seed in range(200)}) > 150


def test_seeds_break_no_invariant_and_give_the_same_run_again() -> None:
    plans = [Plan.draw(seed, seconds=6.0) for seed in (1, 2)]
    outcomes = {job.plan.seed: outcome for job, outcome in run_all(map(Job, plans), at_once=2)}
    assert {seed: outcome.violations for seed, outcome in outcomes.items()} == {1: [], 2: []}
    assert run_one(Job(plans[0])).hash == outcomes[1].hash


def test_a_crash_of_the_executive_loses_nothing_that_was_shown() -> None:
    assert run_one(Job(provocation('kill_executive'))).violations == []


@pytest.mark.parametrize(
    ('name', 'plan', 'number'),
    [
        ('the journal does not write', 'kill_executive', 8),
        ('states are not left at a stop', 'stop', 5),
    ],
)
def test_a_mutation_is_found_by_its_invariant(name: str, plan: str, number: int) -> None:
    mutation = next(one for one in MUTATIONS if one.name == name)
    assert number in run_one(Job(provocation(plan), mutation)).broken


def test_a_plan_is_shrunk_to_what_breaks_the_invariant(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs are replaced by a rule: it breaks whenever navigation is killed. What is tested is the search."""
    from flexbt_testing.one_process import nemesis
    from flexbt_testing.one_process.invariants import Violation

    def judged(job: Job) -> nemesis.Outcome:
        breaks = any(step.act == 'kill' and step.target == 'navigation' for step in job.plan.steps)
        return nemesis.Outcome([Violation(3, 1.0, '')] if breaks else [])

    monkeypatch.setattr(nemesis, 'run_one', judged)
    steps = (*Plan.draw(3).steps, *Plan.draw(4).steps, Step(5.0, 'kill', 'navigation', 4.0), *Plan.draw(5).steps)
    small = shrink(replace(Plan.draw(3), steps=steps), {3}, lambda _text: None, most=100)
    assert [(step.act, step.target) for step in small.steps] == [('kill', 'navigation')]
    assert small.preemption == 0.0
    assert small.steps[0].amount < 4.0
