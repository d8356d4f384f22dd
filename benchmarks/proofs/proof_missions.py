# SPDX-License-Identifier: BSD-3-Clause
"""How long the proofs of real missions take, and how many situations they have.

The behaviors of the demonstrations with their trees; and each stock tree of Nav2, where these are at hand, run by a
machine that tries it twice, recovers by a tree, asks the operator, and can be canceled at any time.

Usage: python3 benchmarks proof_missions [--seconds S] [--only NAME] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from _figures import write_figures

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_retry
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.machine_system import MachineBounds
from flexbt_formal.exploration.model import Report
from flexbt_formal.proofs.behavior_proof import prove_behavior
from flexbt_server.node_types import node_registry
from flexbt_states import BtExecuteGoalState, BtExecuteState, BtLoaderState, OperatorDecisionState
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES
from flexbt_tools.behaviors.built_behavior import build, installed, used_trees
from flexbt_tools.trees.stand_ins import OpenRegistry

TARGET: Final = 60.0
"""CPU seconds for each."""

BEHAVIORS: Final = ('Navigate', 'Navigate Split', 'Inspection', 'Night Watch')
ENDLESS: Final = 'follow_point.xml'
"""It follows until it fails, so that its mission never finishes; the proof has to say so."""
RECOVERY: Final = 'flexbt_demo_behaviors/navigate/recovery.xml'


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=600.0, help='limit of each, wall time (default: %(default)g)')
    parser.add_argument('--only', default='', help='only missions with this in their name')
    parser.add_argument('--output', type=Path, default=Path('out/proof_missions.json'))
    options = parser.parse_args()
    registry = OpenRegistry(node_registry(lambda source, error: None))
    is_good = True
    rows = []
    print(f'{"mission":64} {"situations":>10} {"steps":>7} {"CPU s":>6}  verdict')
    for name, machine in missions():
        if options.only not in name:
            continue
        begin = time.process_time()
        used = used_trees(machine, (), registry)
        proof = prove_behavior(name, machine, used, MachineBounds(), ExplorationLimits(options.seconds, 1_000_000))
        seconds = time.process_time() - begin
        situations = sum(one.configurations for one in proof.reports)
        steps = sum(one.steps for one in proof.reports)
        verdict = _verdict(proof.reports)
        print(f'{name[-64:]:64} {situations:10} {steps:7} {seconds:6.1f}  {verdict}', flush=True)
        rows.append({'mission': name, 'situations': situations, 'steps': steps, 'CPU, s': seconds, 'verdict': verdict})
        is_good = is_good and (verdict == 'holds') is (name != ENDLESS) and seconds <= TARGET
    write_figures(options.output, {'rows': rows, 'target, s': TARGET})
    return 0 if is_good else 1


def missions() -> Iterator[tuple[str, MachineDefinition]]:
    """Yield all of them, by their names."""
    for entry in installed(BEHAVIORS):
        machine = build(entry, []).machine
        assert machine is not None
        yield entry.name, machine
    for tree in STOCK_TREES:
        yield tree.name, define(under_a_machine(str(tree)))


def under_a_machine(tree: str) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    machine.userdata.goal = None
    add = OperatableStateMachine.add
    with machine:
        add('Load', BtLoaderState(filepaths=[tree, RECOVERY]), {'done': 'Drive', 'failed': 'failed'})
        drive = with_retry(BtExecuteGoalState(bt_file=tree), 2)
        add('Drive', drive, {'done': 'finished', 'canceled': 'Ask', 'failed': 'Recover'}, {'failed': Autonomy.Low})
        add('Recover', BtExecuteState(bt_file=RECOVERY), {'done': 'Drive', 'canceled': 'Ask', 'failed': 'Ask'})
        ask = OperatorDecisionState(['again', 'enough'], 'Try again?')
        add('Ask', ask, {'again': 'Drive', 'enough': 'failed'})
    return machine


def _verdict(reports: list[Report]) -> str:
    wrong = [found.violation.text for report in reports for found in report.counterexamples]
    if wrong:
        return f'{len(wrong)} wrong: {wrong[0]:.80}'
    return 'holds' if all(report.is_complete for report in reports) else 'holds as far as it was followed'


if __name__ == '__main__':
    sys.exit(main())
