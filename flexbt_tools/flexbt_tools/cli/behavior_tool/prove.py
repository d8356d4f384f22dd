# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool prove``: follows all that can happen to a behavior, and tells what is wrong with the shortest way to
it."""

from __future__ import annotations

import argparse

from flexbt_core.exploration import Bounds, Operator, RestoreError
from flexbt_core.state_machine import AUTONOMY_NAMES, Autonomy
from flexbt_tools.behavior_proofs import prove_behavior
from flexbt_tools.behaviors import used_trees
from flexbt_tools.cli import arguments, proof_arguments
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.proofs import ProgressLine, behavior_test

from .behavior_arguments import add_parameters, add_tree_files, built, parameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('name', metavar='NAME', help='installed behavior, or file (.yaml) of a machine')
    add_parameters(parser)
    add_tree_files(parser)
    arguments.add_node_types(parser, allow_unknown=False)
    parser.add_argument(
        '--operator',
        choices=[one.value for one in Operator],
        default=Operator.ANSWERS.value,
        help='what the operator does: nothing, answers what is asked, or also pauses and forces (default: %(default)s)',
    )
    parser.add_argument(
        '--forces', metavar='N', type=int, choices=range(4), default=0, help='outcomes that are forced, 0 to 3'
    )
    parser.add_argument(
        '--autonomy',
        choices=list(AUTONOMY_NAMES.values()),
        default=AUTONOMY_NAMES[Autonomy.Low],
        help='level of autonomy (default: %(default)s)',
    )
    proof_arguments.add_faults(parser, 'cancels that are ignored, and servers that are gone for good')
    proof_arguments.add_requirements(parser, 'machine of the behavior')
    proof_arguments.add_limits(parser)


def run(options: argparse.Namespace) -> ExitCode:
    behavior = built(options)
    assert behavior.machine is not None
    used = used_trees(behavior.machine, options.trees, arguments.registry(options, allow_unknown=True))
    operator = Operator.ALL if options.forces else Operator(options.operator)
    bounds = Bounds(
        operator,
        options.forces,
        options.faults,
        next(level for level, name in AUTONOMY_NAMES.items() if name == options.autonomy),
    )
    own, by_name = proof_arguments.requirements(options)
    required = [*own, *by_name.get(behavior.name, ())]
    trees = [use.key.id for use in used.uses if use.key is not None]
    proof_arguments.tell_unused(options, by_name, {behavior.name, *trees})
    progress = ProgressLine(not options.quiet)
    try:
        proof = prove_behavior(
            behavior.name,
            behavior.machine,
            used,
            bounds,
            seconds=options.seconds,
            configurations=options.situations,
            required=required,
            required_of_trees=by_name,
            on_progress=progress.tell,
            kept=proof_arguments.kept(options),
        )
    except RestoreError as error:
        raise UsageError(f'{behavior.name}: {error}') from error
    finally:
        progress.end()
    code = proof_arguments.tell(options, proof.reports)
    if options.save_test is not None and not proof.machine.holds:
        text = behavior_test(behavior.name, parameters(options), bounds, proof.machine.counterexamples, required)
        proof_arguments.save_test(options, text)
    return code
