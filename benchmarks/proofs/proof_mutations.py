# SPDX-License-Identifier: BSD-3-Clause
"""How many seeded defects a proof finds: random sound missions, and the same with one defect each.

Machines: a transition leads to the wrong target. Trees: a Sequence where a ReactiveSequence was, a control that forgets
to cancel, a delay that nothing wakes, two owners of the base, a key that may not be written, attempts without a limit,
which never end when a server is gone for good. The sound ones must give
no alarm, and each alarm must replay on an engine of its own.

Usage: python3 benchmarks proof_mutations [--number N] [--seed N] [--show] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

from _figures import write_figures

from flexbt_formal.exploration.explorer import ExplorationLimits, explore, replay
from flexbt_formal.exploration.model import Counterexample, Report, System
from flexbt_testing.seeded_missions import DEFECTS, seeded_machine, seeded_tree

TARGET: Final = 0.95
WRONG_TARGET: Final = 'wrong target'
_LIMITS: Final = ExplorationLimits(seconds=60.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--number', type=int, default=200, help='defects in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--show', action='store_true', help='print those that were not found')
    parser.add_argument('--output', type=Path, default=Path('out/proof_mutations.json'))
    options = parser.parse_args()
    kinds = (WRONG_TARGET, *DEFECTS)
    found, tried = Counter[str](), Counter[str]()
    seconds = dict.fromkeys(kinds, 0.0)
    refused = false_alarms = not_replayed = 0
    for number in range(options.number):
        kind, seed = kinds[number % len(kinds)], options.seed + number
        begin = time.process_time()
        is_machine = kind == WRONG_TARGET
        sound = seeded_machine(seed).system if is_machine else seeded_tree(seed).system
        false_alarms += not _report(sound).holds
        tried[kind] += 1
        mutant = seeded_machine(seed, is_defective=True) if is_machine else seeded_tree(seed, kind)
        if is_machine and mutant[0] is None:
            refused += 1
            found[kind] += 1
            continue
        report = _report(mutant.system)
        not_replayed += sum(not _replays(mutant.system, one) for one in _alarms(report))
        if report.counterexamples:
            found[kind] += 1
        elif options.show:
            print(f'not found: seed {seed}, {mutant.defect}')
        seconds[kind] += time.process_time() - begin
    share = found.total() / tried.total()
    print(f'{"defect":20} {"seeded":>7} {"found":>7} {"CPU s":>8}')
    for kind in kinds:
        print(f'{kind:20} {tried[kind]:7} {found[kind]:7} {seconds[kind]:8.2f}')
    total = f'{tried.total():7} {found.total():7} {sum(seconds.values()):8.2f}'
    print(f'{"all":20} {total}  {share:.1%} (target {TARGET:.0%})')
    print(f'{refused} of them are refused by the engine before anything runs')
    print(f'sound missions with an alarm: {false_alarms}; alarms that do not replay: {not_replayed}')
    figures = {'seeded': dict(tried), 'found': dict(found), 'CPU, s': seconds, 'share': share}
    write_figures(options.output, {**figures, 'false alarms': false_alarms, 'not replayed': not_replayed})
    return 0 if share >= TARGET and not false_alarms and not not_replayed else 1


def _report(system: Callable[[], System]) -> Report:
    return explore(system, '', limits=_LIMITS)


def _alarms(report: Report) -> list[Counterexample]:
    """Return each alarm by itself that a way shows; those about what does not follow have none."""
    return [one for one in report.counterexamples if one.violation.property.is_shown_by_a_way]


def _replays(system: Callable[[], System], alarm: Counterexample) -> bool:
    return alarm.violation in replay(system, alarm.moves)


if __name__ == '__main__':
    sys.exit(main())
