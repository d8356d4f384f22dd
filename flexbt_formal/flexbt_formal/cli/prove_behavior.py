# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool prove``: explore everything that can happen to a behavior, and report violations with the shortest
way to each."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence

from flexbt_core.monitors.requirement_text import StatedRequirement
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Autonomy
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.machine_system import MachineBounds, Operator
from flexbt_formal.proofs.behavior_proof import (
    BehaviorProof,
    Version,
    compare_behaviors,
    prove_behavior,
    replay_behavior,
)
from flexbt_formal.proofs.proof_report import Compared, ProgressLine
from flexbt_formal.proofs.saved_test import File, Replay, requirement_texts
from flexbt_tools.behaviors.built_behavior import BuiltBehavior, UsedTrees, machine_file, used_trees
from flexbt_tools.cli import arguments
from flexbt_tools.cli.behavior_tool import add_behavior, add_tree_files, built, parameters
from flexbt_tools.errors import ExitCode, UnfitError

from . import proof_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_behavior(parser)
    add_tree_files(parser)
    arguments.add_list(parser, '--given', 'KEY', 'key that is set on the blackboards from outside')
    arguments.add_node_types(parser, allow_unknown=False)
    activity = 'operator: does nothing, answers decisions, or also pauses and forces'
    arguments.add_choice(parser, '--operator', Operator, Operator.ANSWERS.value, activity)
    proof_arguments.add_count(parser, '--forces', 0, 'number of forced outcomes')
    levels = list(AUTONOMY_NAMES.values())
    arguments.add_choice(parser, '--autonomy', levels, AUTONOMY_NAMES[Autonomy.Low], 'level of autonomy')
    proof_arguments.add_count(parser, '--faults', 1, 'cancels that are ignored, and servers that are gone for good')
    proof_arguments.add_requirements(parser, 'machine of the behavior')
    parser.add_argument(
        '--against',
        metavar='OLD',
        help='previous version, an installed behavior or a file (.yaml, .py): report how the behavior differs from it',
    )
    of_old = '--trees of the previous version (default: those of --trees)'
    arguments.add_list(parser, '--against-trees', 'FILE', of_old)
    proof_arguments.add_limits(parser)


def run(options: argparse.Namespace) -> ExitCode:
    behavior = built(options, options.name)
    assert behavior.machine is not None
    used = _used(options, behavior, options.trees)
    operator = Operator.ALL if options.forces else Operator(options.operator)
    bounds = MachineBounds(
        operator,
        options.forces,
        options.faults,
        next(level for level, name in AUTONOMY_NAMES.items() if name == options.autonomy),
    )
    own, by_name = proof_arguments.requirements(options)
    required = [*own, *by_name.get(behavior.name, ())]
    trees = [use.key.id for use in used.uses if use.key is not None]
    proof_arguments.warn_unused(options, by_name, {behavior.name, *trees})
    with proof_arguments.proving(options) as progress:
        proof = prove_behavior(
            behavior.name,
            behavior.machine,
            used,
            bounds,
            ExplorationLimits(options.seconds, options.situations),
            required=required,
            required_of_trees=by_name,
            given=options.given,
            on_progress=progress.show,
            cache=proof_arguments.proof_cache(options),
        )
        compared = _compared(options, behavior.machine, used, bounds, progress)
    replays = list(_replays(options, proof, bounds, required, by_name))
    proofs = [*proof.trees.items(), (None, proof.machine)]
    return proof_arguments.tell(options, used.library, replays, proofs, compared)


def _used(options: argparse.Namespace, behavior: BuiltBehavior, files: Sequence[str]) -> UsedTrees:
    assert behavior.machine is not None
    used = used_trees(behavior.machine, files, arguments.registry(options, allow_unknown=True))
    if used.findings:  # an unknown tree cannot be proved
        raise UnfitError('\n'.join(finding.text(behavior.name) for finding in used.findings))
    return used


def _compared(
    options: argparse.Namespace,
    machine: MachineDefinition,
    used: UsedTrees,
    bounds: MachineBounds,
    progress: ProgressLine,
) -> list[Compared]:
    """Compare the behavior with its previous version."""
    if options.against is None:
        return []
    old = built(options, options.against)
    assert old.machine is not None
    before = Version(old.machine, _used(options, old, options.against_trees or options.trees))
    return compare_behaviors(
        machine.label or options.name,
        before,
        Version(machine, used),
        bounds,
        ExplorationLimits(options.seconds, options.situations),
        given=options.given,
        on_progress=lambda name, *counts: progress.show(f'{name}, against before', *counts),
    )


def _replays(
    options: argparse.Namespace,
    proof: BehaviorProof,
    bounds: MachineBounds,
    required: Sequence[StatedRequirement],
    by_name: Mapping[str, Sequence[StatedRequirement]],
) -> Iterator[Replay]:
    """Yield the counterexamples of the trees and of the machine, with the calls that replay them."""
    common = {
        'name': options.name if machine_file(options.name) is None else File(options.name),
        'parameters': parameters(options),
        'trees': [File(file) for file in options.trees],
        **proof_arguments.node_settings(options),
    }
    for key, report in proof.trees.items():
        settings = common | {'tree': key.id, 'require': requirement_texts(by_name.get(key.id, ()))}
        yield Replay(f'the tree {key.id!r}', replay_behavior, settings, report.counterexamples)
    settings = common | {
        'operator': bounds.operator.value,
        'forces': bounds.forces,
        'faults': bounds.faults,
        'autonomy': bounds.autonomy,
        'configurations': options.situations,
        'require': requirement_texts(required),
    }
    yield Replay(f'the machine of {proof.name!r}', replay_behavior, settings, proof.machine.counterexamples)
