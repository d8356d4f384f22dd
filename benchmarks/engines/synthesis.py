# SPDX-License-Identifier: BSD-3-Clause
"""Machines from capabilities: the examples of flexbe_synthesis beside what upstream's own pipeline gives, and chains
of capabilities of which each may undo the one before.

Usage: python3 benchmarks synthesis [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from _figures import write_figures

from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities, read_mappings
from flexbt_formal.synthesis.hand_written import hand_written
from flexbt_formal.synthesis.request_files import MachineRequest, read_specification
from flexbt_formal.synthesis.specification import Section
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import Liveness, Options, SynthesisProblem, translated

DATA: Final = (
    Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).resolve().parents[3] / 'shared/data')) / 'synthesis'
)
TARGET: Final = 1.0
"""CPU seconds for each example."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path('out/synthesis.json'))
    options = parser.parse_args()
    is_good = True
    rows = []
    synthesize(_chain(2))  # imports dd
    print(f'{"problem":44} {"variables":>9} {"formulas":>8} {"nodes":>6} {"states":>6} {"upstream":>8} {"CPU s":>6}')
    for name, problem, upstream in problems():
        begin = time.process_time()
        answer = synthesize(problem)
        seconds = time.process_time() - begin
        assert answer.machine is not None
        states = 1 + len(answer.machine.states) + len(answer.machine.outcomes)
        lines = problem.specification.lines
        formulas = sum(line.section not in (Section.ENV_INIT, Section.SYS_INIT) for line in lines)
        variables, nodes = len(problem.specification.variables), answer.figures['nodes']
        shown = '' if upstream is None else upstream
        print(f'{name:44} {variables:9} {formulas:8} {nodes:6} {states:6} {shown:>8} {seconds:6.2f}', flush=True)
        rows.append({'problem': name, 'variables': variables, 'formulas': formulas, 'nodes': nodes, 'CPU, s': seconds})
        is_good = is_good and (upstream is None or (states <= upstream and seconds <= TARGET))
    write_figures(options.output, {'rows': rows, 'target, s': TARGET})
    return 0 if is_good else 1


def problems() -> Iterator[tuple[str, SynthesisProblem, int | None]]:
    """Name, problem, and upstream's number of states (root and outcomes included)."""
    for path in sorted(DATA.glob('generated/*.structuredslugs')):
        files = json.loads((DATA / 'expected' / f'{path.stem}.json').read_text(encoding='utf-8'))
        for liveness in (Liveness.ADVERSARIAL, Liveness.FAIR):
            count = files['tested_upstream']['state_count']
            yield f'{path.stem}, {liveness.value}', _example(files, path.stem, liveness), count
    whole = DATA / 'extra' / 'wgcf.yaml'
    if whole.is_file():
        given = read_specification(whole.read_text(encoding='utf-8'), whole.name)
        yield 'wolf, goat and corn', hand_written(given, MachineRequest()), None
    for length in (8, 16, 24):
        yield f'chain of {length}', _chain(length), None


def _example(files: Mapping[str, Any], name: str, liveness: Liveness) -> SynthesisProblem:
    def text(kind: str) -> tuple[str, str]:
        return (DATA / files[kind]).read_text(encoding='utf-8'), files[kind]

    asked = files['request']
    return translated(
        read_capabilities(*text('capabilities'), read_mappings(*text('mappings'))),
        lambda name, parameters: StateInterface(('done',) if name == 'LogState' else tuple(parameters['outcomes'])),
        MachineRequest(tuple(asked['initial_conditions']), tuple(asked['goals']), tuple(asked['sm_outcomes'])),
        read_specification(*text('specification')),
        Options(liveness, parsed=name.endswith('_parsed')),
    )


def _chain(length: int) -> SynthesisProblem:
    lines = ['state_outcome_mappings: {done: completed, failed: failure}', 'sm_outcome_mappings: {finished: finished}']
    lines.append('capabilities:')
    for number in range(length):
        before = max(number - 1, 0)
        needed = f'[c{before}]' if number else '[]'
        effects = f'{{completed: [c{number}], failure: ["!c{before}"]}}'
        lines.append(f'  c{number}: {{interface: Try, preconditions: {needed}, postconditions: {effects}}}')
    file = read_capabilities('\n'.join(lines), 'chain')
    return translated(
        file, lambda name, parameters: StateInterface(('done', 'failed')), MachineRequest(goals=(f'c{length - 1}',))
    )


if __name__ == '__main__':
    raise SystemExit(main())
