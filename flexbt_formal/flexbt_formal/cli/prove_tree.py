# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool prove``: explore everything that can happen to a tree, and report violations with the shortest ways.

The main file of a model in the format of AS2FM is recognized by its first element: see ``prove_model``.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.proofs.proof_report import Compared, ProgressLine
from flexbt_formal.proofs.saved_test import File, Replay, requirement_texts
from flexbt_formal.proofs.tree_proof import compare_trees, prove_tree, replay_tree
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.trees.files import read_library, roots
from flexbt_tools.trees.outline import find_tree

from . import proof_arguments, prove_model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_files(parser)
    parser.add_argument('--tree', metavar='ID', help='only this tree (default: all trees that are not sub-trees)')
    arguments.add_list(parser, '--given', 'KEY', 'key that is set on the blackboard from outside')
    arguments.add_node_types(parser, allow_unknown=False)
    proof_arguments.add_count(parser, '--faults', 1, 'servers that are gone for good')
    proof_arguments.add_requirements(parser, 'tree')
    old = 'file of the previous version, or - for standard input: report how the trees differ from it'
    arguments.add_list(parser, '--against', 'OLD', old)
    proof_arguments.add_limits(parser)
    prove_model.add_arguments(parser)


def run(options: argparse.Namespace) -> ExitCode:
    if prove_model.is_asked(options.files):
        return prove_model.run(options)
    if options.property:
        raise UsageError(f'--property is for models, and {options.files[0]} is a file of trees: use --require')
    library = read_library(options.files, arguments.registry(options, allow_unknown=True))
    keys: list[TreeKey] = [find_tree(library, options.tree)] if options.tree is not None else roots(library)
    before = read_library(options.against, arguments.registry(options, allow_unknown=True)) if options.against else None
    own, by_name = proof_arguments.requirements(options)
    proof_arguments.warn_unused(options, by_name, [key.id for key in keys])
    required = {key: [*own, *by_name.get(key.id, ())] for key in keys}
    with proof_arguments.proving(options) as progress:
        reports = {
            key: prove_tree(
                library,
                key,
                given=options.given,
                limits=ExplorationLimits(options.seconds / len(keys), options.situations, options.seconds),
                faults=options.faults,
                required=required[key],
                cache=proof_arguments.proof_cache(options),
                on_progress=partial(progress.show, f'tree {key.id}'),
            )
            for key in keys
        }
        compared = _compared(options, before, library, keys, progress)
    settings = {'files': [File(file) for file in options.files], **proof_arguments.node_settings(options)}
    replays = [
        Replay(
            f'the tree {key.id!r}',
            replay_tree,
            settings | {'tree': key.id, 'require': requirement_texts(required[key])},
            report.counterexamples,
        )
        for key, report in reports.items()
    ]
    return proof_arguments.tell(options, library, replays, list(reports.items()), compared)


def _compared(
    options: argparse.Namespace,
    old: TreeLibrary | None,
    library: TreeLibrary,
    keys: Sequence[TreeKey],
    progress: ProgressLine,
) -> list[Compared]:
    """Compare the trees with those of the previous version, which may have other trees."""
    if old is None:
        return []
    others = roots(old) if options.tree is None else []
    names = dict.fromkeys(key.id for key in (*keys, *others))
    limits = ExplorationLimits(options.seconds / len(names), options.situations, options.seconds)
    found = []
    for name in names:
        before, now = old.find(name), library.find(name)
        if before is None or now is None:
            found.append(Compared(f'tree {name}', only='now' if before is None else 'before'))
            continue
        on_progress = partial(progress.show, f'tree {name}, against before')
        versions = ((old, before), (library, now))
        found.append(compare_trees(*versions, given=options.given, limits=limits, on_progress=on_progress))
    return found
