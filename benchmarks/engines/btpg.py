# SPDX-License-Identifier: BSD-3-Clause
"""Planning all goals of BTPG's scenes (Cai et al., IJCAI 2025): each within a limit, and at what cost.

Beside the planner, in the same run: BT Expansion and OBTEA, as they are published, on the same bit sets; and what BTPG
recorded of its own programs with a limit of 1 s (on another machine). A run that ended in time with a tree that misses
the goal is *wrong* in the recorded ones; here each plan is carried out on the model, and its cost compared with the
optimum where that is known.

Usage: python3 benchmarks btpg [--data DIRECTORY] [--limit SECONDS] [--every N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import gzip
import heapq
import json
import os
import random
import statistics
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

from _figures import write_figures

from flexbt_formal.planning.problem import Domain, read_scene
from flexbt_formal.planning.relaxation import Reachability
from flexbt_formal.planning.search import SearchOutcome, search

DATA: Final = Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).resolve().parents[3] / 'shared/data')) / 'btpg'
LITERALS, CONJUNCTIONS = 5, 30
SCENES: Final = ('RW', 'VH', 'OG', 'RH')
RECORDED: Final = {'bfs': 'BT Expansion', 'obtea': 'OBTEA', 'uhbtp': 'HBTP', 'opt_h0': 'HBTP oracle'}


class Run(NamedTuple):
    """Planning one goal: whether it ended in time, whether its plan is wrong, conditions, seconds, cost."""

    in_time: bool
    wrong: bool
    expanded: int
    seconds: float
    cost: float | None


def planned(reachability: Reachability, goal: int, limit: float) -> Run:
    """FlexBT's planner."""
    found = search(reachability, goal, time_limit=limit, clock=time.process_time)
    domain, state = reachability.domain, reachability.initial
    wrong = False
    for action in found.plan():
        wrong |= bool(domain.needs[action] & ~state)
        state = domain.result(state, action)
    in_time = found.outcome is not SearchOutcome.TIME_LIMIT
    return Run(
        in_time, wrong or (found.cost is not None and bool(goal & ~state)), found.expanded, found.seconds, found.cost
    )


def expanded_by(reachability: Reachability, goal: int, limit: float, *, by_cost: bool) -> Run:
    """BT Expansion (conditions first come first served), or OBTEA (the cheapest condition first)."""
    domain, initial = reachability.domain, reachability.initial
    began = time.process_time()
    costs = {goal: 0.0}
    heap: list[tuple[float, int]] = [(0.0, goal)]
    fifo = deque([goal])
    done: list[int] = []
    while heap if by_cost else fifo:
        if time.process_time() - began > limit:
            return Run(False, False, len(done), limit, None)
        cost, condition = heapq.heappop(heap) if by_cost else (costs[fifo[0]], fifo.popleft())
        if cost > costs[condition] or any(not one & ~condition for one in done):
            continue
        if not condition & ~initial:
            return Run(True, False, len(done), time.process_time() - began, cost)
        done.append(condition)
        for action, adds in enumerate(domain.adds):
            if not adds & condition or domain.deletes[action] & condition:
                continue
            before = domain.needs[action] | condition & ~adds
            dearer = cost + domain.costs[action]
            if reachability.exclusions.excluded(before) or dearer >= costs.get(before, float('inf')):
                continue
            if not by_cost and before in costs:
                continue
            costs[before] = dearer
            heapq.heappush(heap, (dearer, before))
            fifo.append(before)
    return Run(False, True, len(done), time.process_time() - began, None)


BASELINES: Final[dict[str, Callable[[Reachability, int, float], Run]]] = {
    'BT Expansion, own': lambda reachability, goal, limit: expanded_by(reachability, goal, limit, by_cost=False),
    'OBTEA, own': lambda reachability, goal, limit: expanded_by(reachability, goal, limit, by_cost=True),
}


def recorded(goal: dict[str, Any], name: str) -> Run | None:
    """Return what BTPG recorded; None where it did not run."""
    run = goal.get('published', {}).get(name)
    if run is None:
        return None
    in_time = not run['timeout']
    return Run(in_time, in_time and run['error'], int(run['expanded']), run['time_s'], run['cost'])


def row(name: str, runs: Iterable[Run], others: dict[str, Any]) -> dict[str, Any]:
    """Return a row of the table."""
    all_runs = list(runs)
    figures = {
        'goals': len(all_runs),
        'timed out %': 100 * statistics.fmean(not run.in_time for run in all_runs),
        'wrong %': 100 * statistics.fmean(run.wrong for run in all_runs),
        'expanded': statistics.fmean(run.expanded for run in all_runs),
        'mean s': statistics.fmean(run.seconds for run in all_runs),
        'max s': max(run.seconds for run in all_runs),
    }
    print(
        f'  {name:23}{figures["goals"]:6}{figures["timed out %"]:11.1f}{figures["wrong %"]:9.1f}'
        f'{figures["expanded"]:10.1f}{figures["mean s"]:9.4f}{figures["max s"]:9.4f}',
        flush=True,
    )
    return {'planner': name, **others, **figures}


def measure(data: Path, scene: str, limit: float, every: int) -> tuple[list[dict[str, Any]], int]:
    """Return the rows of a scene, and the number of goals that were not planned as they have to be."""
    began = time.process_time()
    with gzip.open(data / f'scenes/{scene}.actions.jsonl.gz', 'rt') as lines:
        actions, initial = read_scene((data / f'scenes/{scene}.json').read_text(), lines, scene)
    domain = Domain(actions, initial)
    reachability = Reachability(domain, domain.state(initial))
    print(
        f'{scene}: {len(actions)} actions, {len(domain.literals)} literals, read in {time.process_time() - began:.2f} s'
    )
    goals = [json.loads(line) for line in (data / f'goals/{scene}.jsonl').read_text().splitlines()]
    rows, missed = [], 0
    for kind in ('single', 'multi', 'mix'):
        chosen = [goal for goal in goals if goal['set'] == kind]
        if not chosen:
            continue
        others = {'scene': scene, 'set': kind}
        print(f' {kind:24}{"goals":>6}{"timed out %":>11}{"wrong %":>9}{"expanded":>10}{"mean s":>9}{"max s":>9}')
        runs = [planned(reachability, domain.mask(goal['goal']), limit) for goal in chosen]
        for goal, run in zip(chosen, runs, strict=True):
            best = goal['optimal_cost'] if goal['optimal_cost'] is not None else goal['reference_cost']
            if not run.in_time or run.wrong or run.cost is None or run.cost > best:
                missed += 1
                print(f'  {goal["id"]}: {run}, least cost {best}')
            elif goal['optimal_cost'] is not None and run.cost < best:
                missed += 1
                print(f'  {goal["id"]}: cost {run.cost} below the optimum {best}')
        rows.append(row('FlexBT', runs, others))
        for name, baseline in BASELINES.items():
            some = [baseline(reachability, domain.mask(goal['goal']), limit) for goal in chosen[::every]]
            rows.append(row(name, some, others))
        for name, shown in RECORDED.items():
            told = [one for goal in chosen if (one := recorded(goal, name)) is not None]
            if told:
                rows.append(row(f'{shown}, recorded', told, others))
    larger = [planned(reachability, goal, limit) for goal in conjunctions(reachability, goals)]
    print(f' random, {LITERALS} literals')
    rows.append(row('FlexBT', larger, {'scene': scene, 'set': f'random, {LITERALS} literals'}))
    return rows, missed


def conjunctions(reachability: Reachability, goals: list[dict[str, Any]]) -> list[int]:
    """Larger goals than BTPG has: literals of its goals that do not exclude each other, drawn at random; always the
    same. Some cannot be reached, which has to be found out, too."""
    known = sorted({literal for goal in goals for literal in goal['goal']})
    draw = random.Random(0)
    found: list[int] = []
    while len(found) < CONJUNCTIONS:
        goal = reachability.domain.mask(draw.sample(known, LITERALS))
        if not reachability.exclusions.excluded(goal):
            found.append(goal)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--data', type=Path, default=DATA, help='where scenes/ and goals/ are (default: %(default)s)')
    parser.add_argument('--limit', type=float, default=1.0, help='seconds of processor time a goal (default: 1)')
    parser.add_argument('--every', type=int, default=5, help='the own baselines plan one goal of so many (default: 5)')
    parser.add_argument('--output', type=Path, default=Path('out/btpg.json'))
    options = parser.parse_args()
    if not options.data.is_dir():
        print(f'{options.data}: the data of BTPG is not here; nothing is measured')
        write_figures(options.output, [])
        return 0
    rows, missed = [], 0
    for scene in SCENES:
        of_scene, of_missed = measure(options.data, scene, options.limit, options.every)
        rows += of_scene
        missed += of_missed
    slowest = max(
        figures['max s']
        for figures in rows
        if figures['planner'] == 'FlexBT' and figures['set'] in ('single', 'multi', 'mix')
    )
    print(
        f'target: each goal within {options.limit:g} s, at the least cost; missed by {missed}, slowest {slowest:.3f} s'
    )
    write_figures(options.output, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
