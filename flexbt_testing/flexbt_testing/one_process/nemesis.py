# SPDX-License-Identifier: BSD-3-Clause
"""Missions of whole robots under faults that a seed draws: ``make nemesis SEEDS=100``.

A plan is drawn before the run: what operators do, which processes are killed or stopped, what happens to the link, and
when. Each plan runs in a process of its own, forked from a world that is ready. The invariants of :mod:`.invariants`
are checked meanwhile. A plan that breaks one is shrunk, and kept with all that was recorded.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from .mutations import MUTATIONS, Mutation
from .nemesis_run import SECONDS, WORLDS, Job, Outcome, Plan, run_all, run_one, warm_up

_AGAIN: Final = 100
"""Each of this many seeds is run again, in another interpreter."""

_ROUNDS: Final = (25, 75, 400)
"""Numbers of seeds for the mutations that were not found before."""


def shrink(plan: Plan, broken: set[int], say: Callable[[str], object], most: int = 60) -> Plan:
    """Return a smaller plan that breaks one of the same invariants: fewer steps, shorter ones, nothing drawn."""
    tried: dict[Plan, bool] = {}

    def still(candidate: Plan) -> bool:
        if candidate not in tried:
            if len(tried) >= most:
                return False
            tried[candidate] = bool(run_one(Job(candidate)).broken & broken)
            say(f'  {len(candidate.steps)} steps, {candidate.seconds:g} s: {"still" if tried[candidate] else "not"}')
        return tried[candidate]

    size = len(plan.steps)
    while size:
        begin = 0
        while begin < len(plan.steps):
            fewer = replace(plan, steps=plan.steps[:begin] + plan.steps[begin + size :])
            plan, begin = (fewer, begin) if still(fewer) else (plan, begin + size)
        size //= 2
    for simpler in (
        {'preemption': 0.0},
        {'computing': 0.0},
        {'world': 'navigate', 'motion': 'abstract', 'behavior': 'Navigate'},
        {'autonomy': 'HIGH'},
        {'settle': 2.0},
        {'answers': plan.answers[:1]},
    ):
        candidate = replace(plan, **simpler)
        plan = candidate if candidate != plan and still(candidate) else plan
    for index, step in enumerate(plan.steps):
        short = replace(step, amount=round(step.amount / 2.0, 3))
        candidate = replace(plan, steps=(*plan.steps[:index], short, *plan.steps[index + 1 :]))
        plan = candidate if still(candidate) else plan
    last = max((step.time + 3.0 for step in plan.steps), default=3.0)
    candidate = replace(plan, seconds=min(plan.seconds, last))
    return candidate if candidate != plan and still(candidate) else plan


def _again(plan: Plan, mutation: str = '', **environment: str) -> str:
    """Return the hash of the run of a plan in another interpreter, with another hash of strings."""
    words = [sys.executable, '-m', __spec__.name, '--plan', '/dev/stdin', '--hash', '--mutation', mutation]
    others = {**os.environ, 'PYTHONHASHSEED': str(plan.seed + 1), **environment}
    ended = subprocess.run(words, env=others, input=plan.text(), check=False, capture_output=True, text=True)
    return (ended.stdout or ended.stderr).split()[-1]


def hunt(plans: Sequence[Plan], jobs: int, out: Path, say: Callable[[str], object], shrinks: bool = True) -> int:
    """Run plans, shrink and keep those that break an invariant; return how many do."""
    bad, processor, began = [], 0.0, os.times().elapsed
    runs: Counter[tuple[str, str]] = Counter()
    simulated: Counter[tuple[str, str]] = Counter()
    faults: Counter[str] = Counter()
    told = began
    for job, outcome in run_all(map(Job, plans), jobs):
        plan, kind = job.plan, (job.plan.world, job.plan.motion)
        runs[kind] += 1
        simulated[kind] += int(outcome.seconds)
        faults.update(step.act for step in plan.steps)
        processor += outcome.processor
        if outcome.violations:
            say('\n    '.join([f'seed {plan.seed} ({plan.world}, {plan.motion})', *map(str, outcome.violations)]))
            bad.append((plan, outcome.broken))
        if plan.seed % _AGAIN == 0:
            others = _again(plan), _again(plan, FLEXBT_ONE_PROCESS='threads')
            if {*others} != {outcome.hash}:
                say(f'seed {plan.seed}: 12: the hash is {outcome.hash}, in another process and with threads {others}')
                bad.append((plan, set()))
        if os.times().elapsed - told > 60.0:
            told = os.times().elapsed
            say(f'{runs.total()} missions in {told - began:.0f} s, {len(bad)} with violations')
    for plan, broken in bad:
        small = shrink(plan, broken, say) if shrinks and broken else plan
        directory = out / str(plan.seed)
        run_one(Job(small, keep=directory))
        say(f'{plan.seed}: {directory}, {len(small.steps)} steps:\n{small.text()}')
    for kind, number in sorted(runs.items()):
        say(f'{" ".join(kind):22} {number:6} missions, {simulated[kind]} s simulated')
    say(', '.join(f'{number} {act}' for act, number in faults.most_common()))
    say(
        f'{len(plans)} missions, {len(bad)} with violations, {processor:.0f} s of processor, '
        f'{os.times().elapsed - began:.0f} s of real time'
    )
    return len(bad)


def judge(draw: Callable[[int], Plan], jobs: int, say: Callable[[str], object], only: str = '') -> int:
    """Run mutations of the product, and print which invariants find them; return how many none finds.

    ``draw`` returns the plan of a seed. The unchanged product runs first, and must break no invariant: its violations
    count as mutations that are not found.
    """
    first = [draw(seed) for seed in range(_ROUNDS[0])]
    faulty = [outcome for _, outcome in run_all(map(Job, first), jobs) if outcome.violations]
    for outcome in faulty:
        say('\n    '.join(['the unchanged product', *map(str, outcome.violations)]))
    left = [one for one in MUTATIONS if only in one.name]
    number, done, own = len(left), 0, Counter[str]()
    for size in _ROUNDS:
        plans = [draw(seed) for seed in range(done, done + size)]
        done += size
        found: dict[Mutation, list[set[int]]] = {one: [] for one in left}
        for job, outcome in run_all((Job(plan, one) for one in left for plan in plans), jobs):
            assert job.mutation is not None
            if outcome.broken:
                found[job.mutation].append(outcome.broken)
        for mutation in [one for one in left if found[one] or _is_uneven(one, plans[0])]:
            left.remove(mutation)
            by = set().union(*found[mutation]) or {12}
            own.update([str(*by)] if len(by) == 1 else [])
            hits = f'{len(found[mutation]) or 1} of {size if found[mutation] else 1} seeds'
            say(f'{mutation.name:56} {", ".join(map(str, sorted(by))):20} {hits} from {done - size} on')
    for mutation in left:
        say(f'{mutation.name:56} not found in {done} seeds')
    say(f'{number} mutations, {len(left)} not found; found by one invariant alone: {dict(own)}')
    return len(left) + len(faulty)


def _is_uneven(mutation: Mutation, plan: Plan) -> bool:
    """Return whether two processes run a plan differently with a mutation that is about that."""
    if '12' not in mutation.name:
        return False
    return _again(plan, mutation.name) != _again(plan, mutation.name, PYTHONHASHSEED='7')


def main() -> int:
    """Run what the command line asks for. Return the exit code."""
    parser = argparse.ArgumentParser(prog='nemesis', description=(__doc__ or '').split('\n\n')[0])
    parser.add_argument('--seeds', type=int, default=0, help='number of seeds to run, from --seed on')
    parser.add_argument('--seed', type=int, default=0, help='the first seed, or the only one')
    parser.add_argument('--seconds', type=float, default=SECONDS, help='simulated time of the faults, s')
    parser.add_argument(
        '--world', default='', choices=('', *WORLDS), help='a demonstration; drawn by the seed if not given'
    )
    parser.add_argument('--motion', default='', choices=('', 'full', 'abstract'), help='the same for the robot')
    parser.add_argument('--jobs', type=int, default=2, help='runs at once')
    parser.add_argument('--plan', type=Path, help='run this plan, such as out/nemesis/7/plan.yaml, instead of a seed')
    parser.add_argument('--mutants', nargs='?', const='', help='run mutations of the product, those with this text')
    parser.add_argument('--mutation', default='', help='run the plan with this mutation')
    parser.add_argument('--hash', action='store_true', help='print nothing but the hash of the run')
    parser.add_argument('--as-drawn', action='store_true', help='do not shrink the plans that break an invariant')
    parser.add_argument('--out', type=Path, default=Path('out/nemesis'), help='directory of what is kept')
    given = parser.parse_args()

    def say(text: str) -> None:
        print(text, flush=True)

    def draw(seed: int) -> Plan:
        return Plan.draw(seed, given.seconds, given.world, given.motion)

    if given.seeds or given.mutants is not None:
        warm_up()
    if given.mutants is not None:
        return min(judge(draw, given.jobs, say, given.mutants), 1)
    if given.seeds:
        plans = [draw(seed) for seed in range(given.seed, given.seed + given.seeds)]
        return min(hunt(plans, given.jobs, given.out, say, not given.as_drawn), 1)
    plan = Plan.read(given.plan.read_text()) if given.plan else draw(given.seed)
    mutation = next((one for one in MUTATIONS if one.name == given.mutation), None)
    outcome = run_one(Job(plan, mutation, None if given.hash else given.out / str(plan.seed)))
    if not given.hash:
        _tell(plan, outcome, say)
    say(outcome.hash)
    return int(bool(outcome.violations))


def _tell(plan: Plan, outcome: Outcome, say: Callable[[str], object]) -> None:
    say(plan.text())
    for when, text in outcome.story:
        say(f'{when:9.3f} {text}')
    for violation in outcome.violations:
        say(f'VIOLATION {violation}')
    say(f'{outcome.seconds:.1f} s in {outcome.processor:.2f} s of processor')


if __name__ == '__main__':
    sys.exit(main())
