# SPDX-License-Identifier: BSD-3-Clause
"""Missions of whole robots under faults that a seed draws: ``make nemesis SEEDS=100``, or ``nemesis --behavior NAME``.

A plan is drawn before the run: what operators do, which processes are killed or stopped, what happens to the link, and
when. Each plan runs in a process of its own, forked from a world that is ready. The invariants of :mod:`.invariants`
are checked meanwhile. A plan that breaks one is shrunk, and kept with all that was recorded.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from .live import TakenOver, take_over, take_over_at  # isort: skip - it prepares this interpreter

from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import one_line

from .mutations import MUTATIONS, Mutation
from .nemesis_run import NEEDED, SECONDS, WORLDS, Job, Plan, Run, Stage, Step, run_all, run_one, warm_up
from .programs import named_programs

_AGAIN: Final = 100
"""Each of this many seeds is run again, in another interpreter."""

_ROUNDS: Final = (4, 4, 8, 16, 32, 64, 128, 244)
"""Numbers of seeds for the mutations that were not found before."""

_UNCHANGED: Final = 50
_RESTART: Final = (Step(4.0, 'kill', 'onboard_executive', 1.0),)
"""Steps with which most of a node is made once more."""
_FULL: Final = 'flexbt_navigation'


def shrink(job: Job, broken: set[int], say: Callable[[str], object], most: int = 60) -> Plan:
    """Return a smaller plan that breaks one of the same invariants: fewer steps, shorter ones, nothing drawn."""
    plan, tried = job.plan, {}  # type: Plan, dict[Plan, bool]

    def still(candidate: Plan) -> bool:
        if candidate not in tried:
            if len(tried) >= most:
                return False
            tried[candidate] = bool(run_one(replace(job, plan=candidate)).broken & broken)
            say(f'  {len(candidate.steps)} steps, {candidate.seconds:g} s: {"still" if tried[candidate] else "not"}')
        return tried[candidate]

    size = len(plan.steps)
    while size:
        begin = 0
        while begin < len(plan.steps):
            fewer = replace(plan, steps=plan.steps[:begin] + plan.steps[begin + size :])
            plan, begin = (fewer, begin) if still(fewer) else (plan, begin + size)
        size //= 2
    of_one = tuple(replace(step, target=step.target.rpartition('/')[2]) for step in plan.steps)
    for simpler in (
        {'preemption': 0.0},
        {'computing': 0.0},
        {'world': 'navigate', 'motion': 'abstract', 'behavior': 'Navigate', 'arguments': (), 'steps': of_one},
        {'autonomy': 'HIGH'},
        {'settle': 1.5},
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


def _again(job: Job, **environment: str) -> str:
    """Return the hash of a run in another interpreter, with another hash of strings."""
    mutation = job.mutation.name if job.mutation else ''
    words = [sys.executable, '-m', __spec__.name, '--plan', '/dev/stdin', '--hash', '--mutation', mutation]
    others = {**os.environ, 'PYTHONHASHSEED': str((job.plan.seed + 1) % 2**32), **environment}
    ended = subprocess.run(words, env=others, input=job.plan.text(), check=False, capture_output=True, text=True)
    return (ended.stdout.split() or [ended.stderr])[-1] if ended.returncode == 0 else ended.stderr


def hunt(jobs: Sequence[Job], at_once: int, out: Path, say: Callable[[str], object], shrinks: bool = True) -> int:
    """Run jobs, shrink and keep those that break an invariant, or a single one; return how many do."""
    bad: list[tuple[Job, set[int]]] = []
    runs, simulated, faults = Counter[str](), Counter[str](), Counter[str]()
    processor, began = 0.0, os.times().elapsed
    told = began
    for job, outcome in run_all(jobs, at_once):
        plan, kind = job.plan, f'{job.plan.world}, {job.plan.motion}'
        runs[kind] += 1
        simulated[kind] += int(outcome.seconds)
        faults.update(step.act for step in plan.steps)
        processor += outcome.processor
        if outcome.violations:
            say('\n    '.join([f'seed {plan.seed} ({kind})', *map(str, outcome.violations)]))
        broken = outcome.broken
        if plan.seed % _AGAIN == 0 and len(jobs) > 1:
            others = _again(job), _again(job, FLEXBT_ONE_PROCESS='threads')
            if {*others} != {outcome.hash}:
                say(f'seed {plan.seed}: 12: the hash is {outcome.hash}, in another process and with threads {others}')
                broken.add(12)
        if broken or len(jobs) == 1:
            bad.append((job, broken))
        if os.times().elapsed - told > 60.0:
            told = os.times().elapsed
            say(f'{runs.total()} missions in {told - began:.0f} s, {len(bad)} with violations')
    for job, broken in bad:
        small = shrink(job, broken, say) if shrinks and broken - {12} else job.plan
        directory = out / str(small.seed)
        run_one(replace(job, plan=small, keep=directory))
        say(f'{directory}: {len(small.steps)} steps\n{small.text()}')
    for kind, number in sorted(runs.items()):
        say(f'{kind:22} {number:6} missions, {simulated[kind]} s simulated')
    say(', '.join(f'{number} {act}' for act, number in faults.most_common()))
    failed = sum(bool(broken) for _, broken in bad)
    seconds = os.times().elapsed - began
    say(f'{len(jobs)} missions, {failed} with violations, {processor:.0f} s of processor, {seconds:.0f} s of real time')
    return failed


def judge(draw: Callable[[int, str], Plan], jobs: int, say: Callable[[str], object], only: str = '') -> int:
    """Run mutations of the product, and print which invariants find them; return how many none finds.

    ``draw`` returns the plan of a seed with a motion; only navigation needs the full robot. The unchanged product runs
    first, and must break no invariant: its violations count as mutations that are not found. What it breaks in the plan
    of a mutation does not count as found.
    """
    faulty = [outcome for _, outcome in run_all((Job(draw(seed, '')) for seed in range(_UNCHANGED)), jobs)]
    faulty = [outcome for outcome in faulty if outcome.violations]
    for outcome in faulty:
        say('\n    '.join(['the unchanged product', *map(str, outcome.violations)]))
    left = [one for one in MUTATIONS if only in one.name]
    number, done, alone = len(left), 0, Counter[int]()
    for size in _ROUNDS:
        seeds = range(done, done + size)
        found: dict[Mutation, list[set[int]]] = {one: [] for one in left}
        wanted = (Job(draw(seed, 'full' if _FULL in one.where else 'abstract'), one) for one in left for seed in seeds)
        broken = [(job, outcome.broken) for job, outcome in run_all(wanted, jobs) if outcome.violations]
        plans = dict.fromkeys(job.plan for job, _ in broken)
        anyway = {job.plan: outcome.broken for job, outcome in run_all(map(Job, plans), jobs)}
        for job, those in broken:
            own = those - anyway[job.plan] - _of_others(job, those)
            if job.mutation is not None and own:
                found[job.mutation].append(own)
        for mutation in left if not done else ():
            found[mutation] += [{12}] if _is_uneven(Job(Plan(0, steps=_RESTART), mutation)) else []
        for mutation in [one for one in left if found[one]]:
            left.remove(mutation)
            by = set().union(*found[mutation])
            alone.update(by if len(by) == 1 else ())
            numbers = ', '.join(map(str, sorted(by)))
            say(f'{mutation.name:56} {numbers:20} {len(found[mutation])} of the seeds {done} to {done + size - 1}')
        done += size
        say(f'{len(left)} of {number} are not found in {done} seeds')
        if not left:
            break
    for mutation in left:
        say(f'{mutation.name:56} not found')
    say(f'found by an invariant alone: {dict(sorted(alone.items()))}')
    return len(left) + len(faulty)


def _of_others(job: Job, broken: set[int]) -> set[int]:
    """Return which invariants do not hold with only the mutations that are made besides that of a job."""
    if job.mutation is None or not job.mutation.besides or not broken:
        return set()
    return run_one(replace(job, mutation=replace(job.mutation, old='', new='pass'))).broken


def _is_uneven(job: Job) -> bool:
    """Return whether two processes run a job differently, with a mutation that is about that."""
    is_about = job.mutation is not None and '12' in job.mutation.name
    return is_about and _again(job) != _again(job, PYTHONHASHSEED='7')


def _parameter(text: str) -> tuple[str, str]:
    name, separator, value = text.partition('=')
    if not name or not separator:
        raise argparse.ArgumentTypeError(f'{text!r}: expected PARAMETER=VALUE')
    return name, value


def _number(text: str, kind: Callable[[str], float] = float, least: float = 0.0) -> Any:
    try:
        if least <= kind(text) < math.inf:
            return kind(text)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f'{text!r} is not a {"whole " * (kind is int)}number from {least:g} on')


def _plan(file: str) -> Plan:
    try:
        return Plan.read(Path(file).read_text())
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(f'{file}: {error}') from error


def _live(text: str) -> str:
    _number((text.split() or [''])[0])
    return text


def play_live(plan: Plan, text: str) -> int:
    """Run a plan until an operator takes over (see :mod:`.live`). Its faults go on, its operators do not."""
    stage = Stage(plan.world, plan.motion)
    _, words = take_over_at(text)
    run = Run(stage, Job(plan))
    try:
        run.play()
    except TakenOver:
        run._mended.append(stage.world.now)  # nobody else commands or answers any more
        take_over(stage.world, words)
    return 0


def _robots(world: str) -> list[str]:
    """Return the namespaces of the robots of a world that is no demonstration.

    Raises:
        LookupError: there is no such world, or a robot lacks a program.
    """
    with tempfile.TemporaryDirectory() as scratch:
        programs = named_programs(world, Path(), Path(scratch), 'abstract')
    robots = [one.namespace for one in programs if one.executable == 'onboard_executive']
    there = {(one.namespace, one.executable) for one in programs}
    for robot, name in itertools.product(robots or [''], NEEDED):
        if (robot, name) not in there:
            raise LookupError(f'the world {world!r} has no {name}{robot and f" in the namespace {robot}"}')
    return robots


def main() -> int:
    """Run what the command line asks for. Return the exit code."""
    parser = argparse.ArgumentParser(prog='nemesis', description=(__doc__ or '').split('\n\n')[0])
    count = partial(_number, kind=int)
    parser.add_argument('--seeds', type=count, default=0, help='number of seeds to run, from --seed on')
    parser.add_argument('--seed', type=count, default=0, help='the first seed, or the only one')
    parser.add_argument(
        '--seconds', type=partial(_number, least=1.0), default=SECONDS, help='simulated time of the faults, s'
    )
    parser.add_argument(
        '--world',
        default='',
        help=f'a demonstration ({", ".join(WORLDS)}), a world file, or module:function, which returns programs; drawn '
        'by the seed if neither this nor a behavior is given',
    )
    parser.add_argument('--behavior', default='', help='a behavior; drawn by the seed if not given')
    parser.add_argument(
        'parameters', nargs='*', type=_parameter, metavar='PARAMETER=VALUE', help='parameters of the behavior'
    )
    parser.add_argument('--motion', default='', choices=('', 'full', 'abstract'), help='the same for the robot')
    parser.add_argument('--jobs', type=partial(_number, kind=int, least=1), default=2, help='runs at once')
    parser.add_argument('--plan', type=_plan, help='run this plan, such as out/nemesis/7/plan.yaml, instead of a seed')
    parser.add_argument('--mutants', nargs='?', const='', help='run mutations of the product, those with this text')
    parser.add_argument('--mutation', default='', help='run the seeds or the plan with this mutation')
    parser.add_argument('--hash', action='store_true', help='print nothing but the hash of the run')
    parser.add_argument('--as-drawn', action='store_true', help='do not shrink the plans that break an invariant')
    parser.add_argument('--out', type=Path, default=Path('out/nemesis'), help='directory of what is kept')
    live = 'run the seed until this time of its world, then in real time, with a console that has these arguments'
    parser.add_argument('--live', type=_live, metavar='"SECONDS ARGUMENTS"', help=live)
    given = parser.parse_args()

    def say(text: str) -> None:
        print(text, flush=True)

    if given.parameters and not given.behavior:
        parser.error(f'{given.parameters[0][0]}: a parameter is of a behavior, which --behavior names')
    mutation = next((one for one in MUTATIONS if one.name == given.mutation), None)
    if given.mutation and mutation is None:
        parser.error(f'--mutation {given.mutation!r}: there are {", ".join(one.name for one in MUTATIONS)}')
    world = given.plan.world if given.plan else given.world or ('navigate' if given.behavior else '')
    try:
        robots = _robots(world) if world not in ('', *WORLDS) else []
    except (LookupError, FlexbtError) as error:
        parser.error(one_line(str(error.args[0])))

    def draw(seed: int, motion: str = '') -> Plan:
        plan = Plan.draw(seed, given.seconds, world, given.motion or motion, given.behavior, robots)
        return replace(plan, arguments=tuple(given.parameters))

    if given.seeds or given.mutants is not None:
        warm_up()
    if given.mutants is not None:
        return min(judge(draw, given.jobs, say, given.mutants), 1)
    seeds = range(given.seed, given.seed + max(1, given.seeds))
    plans = [given.plan] if given.plan else [draw(seed) for seed in seeds]
    if given.behavior and (wrong := run_one(Job(replace(plans[0], steps=(), seconds=1.0))).violations):
        say('\n    '.join(['without any fault:', *map(str, wrong)]))
        return 2
    if given.live:
        return play_live(plans[0], given.live)
    if given.hash:
        say(run_one(Job(plans[0], mutation)).hash)
        return 0
    return min(hunt([Job(plan, mutation) for plan in plans], given.jobs, given.out, say, not given.as_drawn), 1)


if __name__ == '__main__':
    sys.exit(main())
