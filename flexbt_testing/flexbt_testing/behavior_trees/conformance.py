# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of the engine with BehaviorTree.CPP, event by event.

To run it from a shell: ``python3 -m flexbt_testing.behavior_trees.conformance --count 20000 --seed 0``.

A profile selects the contents of the random trees: ``wheel`` is a corpus of all nodes; ``scripts`` has more scripts,
pre- and post-conditions, and missing entries. A seed always gives the same tree.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final

from .random_trees import script_case, wheel_case
from .scripted_nodes import Run
from .wheel import traces

PROFILES: Final[dict[str, Callable[[int], dict[str, Any]]]] = {'wheel': wheel_case, 'scripts': script_case}

BLOCKS: Final = range(1 if os.environ.get('FLEXBT_ACCELERATION') == '0' else 4)
"""Blocks of random trees in the tests; only one without acceleration, whose cases also run with it."""


def difference(expected: dict[str, Any], actual: dict[str, Any]) -> str:
    """Return the first difference between a trace of BehaviorTree.CPP and one of the engine; '' if none.

    Errors are compared by place, not by text. Blackboards are compared only where the library shows them.
    """
    if 'crash' in expected:
        return ''
    if bool(expected['load_error']) != bool(actual['load_error']):
        return f'load error: {expected["load_error"]!r} != {actual["load_error"]!r}'
    if expected['load_error']:
        return ''
    steps = zip([*expected['steps'], expected['final']], [*actual['steps'], actual['final']], strict=False)
    for number, (theirs, ours) in enumerate(steps):
        if 'would make a text of' in (ours['error'] or ''):
            return ''  # longer than the engine allows
        where = f'step {number} {theirs["op"]}'
        for index, (event, mine) in enumerate(zip(theirs['events'], ours['events'], strict=False)):
            if event != mine:
                return f'{where}, event {index}: {event} != {mine}'
        if theirs['error'] and ours['error'] and theirs['op'] == ['halt']:
            # A script of _onHalted failed. There the remaining nodes keep running; here all are halted, on purpose.
            return ''
        if len(theirs['events']) != len(ours['events']):
            return (
                f'{where}: {len(theirs["events"])} != {len(ours["events"])} events: {theirs["events"]} {ours["events"]}'
            )
        if bool(theirs['error']) != bool(ours['error']):
            return f'{where}: error {theirs["error"]!r} != {ours["error"]!r}'
        if theirs['status'] != ours['status']:
            return f'{where}: status {theirs["status"]} != {ours["status"]}'
        for path, board in theirs['bb'].items():
            if board != ours['bb'].get(path):
                return f'{where}: blackboard [{path}] {board} != {ours["bb"].get(path)}'
    if len(expected['steps']) != len(actual['steps']):
        return f'{len(expected["steps"])} != {len(actual["steps"])} steps'
    return ''


def compare(cases: Iterable[dict[str, Any]]) -> Iterator[tuple[dict[str, Any], dict[str, Any], str]]:
    """Yield for each case: the case, the trace of BehaviorTree.CPP, and our difference from it."""
    cases = list(cases)
    for case, expected in zip(cases, traces(cases), strict=True):
        yield case, expected, difference(expected, Run(case).trace())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=1000, help='trees of each profile')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--profiles', default=','.join(PROFILES), help=f'of {", ".join(PROFILES)}')
    parser.add_argument('--show', type=int, default=5, help='how many differences to print in full')
    options = parser.parse_args()
    profiles = options.profiles.split(',')
    unknown = set(profiles) - set(PROFILES)
    if unknown:
        parser.error(f'there is no profile {", ".join(sorted(unknown))}; profiles: {", ".join(PROFILES)}')
    differing = [judge(profile, options.seed, options.count, options.show) for profile in profiles]
    raise SystemExit(1 if any(differing) else 0)


def judge(profile: str, first: int, count: int, show: int) -> int:
    """Compare the trees of these seeds, print the differences, and return the number of differing trees."""
    events = differing = crashed = errors = 0
    for start in range(first, first + count, 1000):
        seeds = range(start, min(start + 1000, first + count))
        results = compare(map(PROFILES[profile], seeds))
        for seed, (case, expected, found) in zip(seeds, results, strict=True):
            crashed += 'crash' in expected
            steps = [*expected.get('steps', []), expected.get('final', {})]
            events += sum(len(step.get('events', ())) for step in steps)
            errors += bool(expected.get('load_error')) or any(step.get('error') for step in steps)
            if found:
                differing += 1
                if differing <= show:
                    print(f'{profile}, seed {seed}: {found}\n  {json.dumps(case)}')
    print(
        f'{profile}: {count} trees compared, {events} events, {errors} cases with an error in both; '
        f'{differing} differ, {crashed} crashed the library',
        flush=True,
    )
    return differing


if __name__ == '__main__':
    main()
