# SPDX-License-Identifier: BSD-3-Clause
"""Arguments that several commands have."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence

from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.values.text import one_line
from flexbt_server.node_types import node_registry
from flexbt_tools.files import read_skill_files
from flexbt_tools.trees.files import read_models, roots
from flexbt_tools.trees.outline import PORTS, find_tree, is_main
from flexbt_tools.trees.stand_ins import OpenRegistry


def positive(text: str) -> float:
    """Return the ``type`` of an argument that is a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number above 0')
    return value


def add_files(parser: argparse.ArgumentParser) -> None:
    """One or several tree files: ``options.files``."""
    parser.add_argument('files', metavar='FILE', nargs='+', help='XML file of trees; - for standard input')


def add_file(parser: argparse.ArgumentParser) -> None:
    """One tree file: ``options.file``."""
    parser.add_argument('file', metavar='FILE', help='XML file of trees; - for standard input')


def add_node_types(parser: argparse.ArgumentParser, *, allow_unknown: bool = True) -> None:
    """Add the options of known node types: ``options.models``, ``options.nav2_branch``, ``options.allow_unknown``."""
    parser.add_argument(
        '--models',
        metavar='FILE',
        action='append',
        default=[],
        help='XML file whose <TreeNodesModel> describes node types that are not installed here; repeatable',
    )
    parser.add_argument(
        '--nav2-branch',
        choices=NAV2_BRANCHES,
        default=NAV2_BRANCHES[0],
        help='branch of Nav2 that files are for, unless they show it (default: %(default)s)',
    )
    if allow_unknown:
        parser.add_argument('--allow-unknown', action='store_true', help='allow unknown node types')


def add_trees(parser: argparse.ArgumentParser) -> None:
    """Add the options that select trees: ``options.tree``, ``options.expand``."""
    parser.add_argument('--tree', metavar='ID', help='only this tree')
    parser.add_argument('--expand', action='store_true', help='show sub-trees in place instead of separately')


def chosen_trees(library: TreeLibrary, options: argparse.Namespace) -> list[TreeKey]:
    """Return the trees that are meant: one; or with --expand those that are not sub-trees; or all, the main ones
    first."""
    if options.tree is not None:
        return [find_tree(library, options.tree)]
    if options.expand:
        return roots(library)
    return sorted(library.tree_keys(), key=lambda key: not is_main(library, key))


def add_ports(parser: argparse.ArgumentParser, default: str) -> None:
    """``options.ports``."""
    parser.add_argument(
        '--ports',
        choices=PORTS,
        default=default,
        help='ports to show: those in the file, all, or none (default: %(default)s)',
    )


def add_json(parser: argparse._ActionsContainer) -> None:
    """``options.json``."""
    parser.add_argument('--json', action='store_true', help='print JSON for programs')


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Return the keys that others write: ``options.input``."""
    parser.add_argument(
        '--input',
        metavar='KEY',
        action='append',
        default=[],
        help='blackboard key that is written from outside; repeatable',
    )


def add_skills(parser: argparse.ArgumentParser) -> None:
    """Files of manifests: ``options.skills``."""
    parser.add_argument(
        '--skills',
        metavar='FILE',
        action='append',
        default=[],
        help='YAML file of skills, in addition to those that classes declare; repeatable',
    )


def skill_library(files: Sequence[str], known: NodeRegistry) -> SkillLibrary:
    """Return the skills of the node types, and what the files add. Raises RefusedError.

    Report classes whose skills do not fit together.
    """
    return read_skill_files(files, node_skills(known, lambda text: print(one_line(f'note: {text}'), file=sys.stderr)))


def registry(options: argparse.Namespace, *, allow_unknown: bool) -> NodeRegistry:
    """Return the node types of installed packages, and of the models that are given. Raises RefusedError.

    Report packages of whose nodes at least one cannot be used.
    """
    known = node_registry(
        lambda nodes, error: print(one_line(f'note: without {nodes}: {error}'), file=sys.stderr),
        options.nav2_branch,
    )
    read_models(options.models, known)
    return OpenRegistry(known) if allow_unknown else known
