# SPDX-License-Identifier: BSD-3-Clause
"""Arguments shared by several commands."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path

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
    """Convert the text of an argument to a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number above 0')
    return value


def picture(*suffixes: str) -> Callable[[str], str]:
    """Return a conversion of a file name that refuses other suffixes than these: the suffix decides the language."""

    def named(text: str) -> str:
        if (suffix := Path(text).suffix.lower()) and suffix not in suffixes:
            raise argparse.ArgumentTypeError(f'{text!r} is none of the pictures made here: {", ".join(suffixes)}')
        return text

    return named


def add_list(parser: argparse._ActionsContainer, flag: str, metavar: str, help: str) -> None:
    """Add an option that may be repeated. Its value is a list of texts, empty by default."""
    parser.add_argument(flag, metavar=metavar, action='append', default=[], help=f'{help}; repeatable')


def add_number(
    parser: argparse._ActionsContainer,
    flag: str,
    metavar: str,
    default: float,
    help: str,
    convert: Callable[[str], float] = positive,
) -> None:
    """Add an option whose value is a number."""
    default_text = '%(default)d' if isinstance(default, int) else '%(default)g'
    whole = f'{help} (default: {default_text})'
    parser.add_argument(flag, metavar=metavar, type=convert, default=default, help=whole)


def add_choice(
    parser: argparse._ActionsContainer, flag: str, choices: Sequence[str] | type[Enum], default: str, help: str
) -> None:
    """Add an option that accepts one of several texts, or a value of an enumeration."""
    values = [one if isinstance(one, str) else one.value for one in choices]
    parser.add_argument(flag, choices=values, default=default, help=f'{help} (default: %(default)s)')


def add_files(parser: argparse.ArgumentParser) -> None:
    """Add ``options.files``: one or several tree files."""
    parser.add_argument('files', metavar='FILE', nargs='+', help='XML file of trees; - for standard input')


def add_file(parser: argparse.ArgumentParser) -> None:
    """Add ``options.file``: one tree file."""
    parser.add_argument('file', metavar='FILE', help='XML file of trees; - for standard input')


def add_node_types(parser: argparse.ArgumentParser, *, allow_unknown: bool = True) -> None:
    """Add the options for node types: ``options.models``, ``options.nav2_branch``, ``options.allow_unknown``."""
    add_list(
        parser,
        '--models',
        'FILE',
        'XML file whose <TreeNodesModel> describes node types that are not installed here',
    )
    which = 'branch of Nav2 that files are for, unless they show it'
    add_choice(parser, '--nav2-branch', NAV2_BRANCHES, NAV2_BRANCHES[0], which)
    if allow_unknown:
        parser.add_argument('--allow-unknown', action='store_true', help='allow unknown node types')


def add_trees(parser: argparse.ArgumentParser) -> None:
    """Add the options that select trees: ``options.tree``, ``options.expand``."""
    parser.add_argument('--tree', metavar='ID', help='only this tree')
    parser.add_argument('--expand', action='store_true', help='show sub-trees in place instead of separately')


def chosen_trees(library: TreeLibrary, options: argparse.Namespace) -> list[TreeKey]:
    """Return the selected trees: one; or with --expand the trees that are not sub-trees; or all, main trees first."""
    if options.tree is not None:
        return [find_tree(library, options.tree)]
    if options.expand:
        return roots(library)
    return sorted(library.tree_keys(), key=lambda key: not is_main(library, key))


def add_ports(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``options.ports``."""
    add_choice(parser, '--ports', PORTS, default, 'ports to show: those in the file, all, or none')


def add_json(parser: argparse._ActionsContainer) -> None:
    """Add ``options.json``."""
    parser.add_argument('--json', action='store_true', help='print JSON for programs')


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Add ``options.input``: the keys that something else writes."""
    add_list(parser, '--input', 'KEY', 'blackboard key that is written from outside')


def add_skills(parser: argparse.ArgumentParser) -> None:
    """Add ``options.skills``: files of manifests."""
    add_list(parser, '--skills', 'FILE', 'YAML file of skills, in addition to those that classes declare')


def skill_library(files: Sequence[str], known: NodeRegistry) -> SkillLibrary:
    """Return the skills of the node types, plus those in the files. Raises RefusedError.

    Report classes whose skills are inconsistent.
    """
    return read_skill_files(files, node_skills(known, lambda text: print(one_line(f'note: {text}'), file=sys.stderr)))


def registry(options: argparse.Namespace, *, allow_unknown: bool) -> NodeRegistry:
    """Return the node types of installed packages, and of the given models. Raises RefusedError.

    Report packages with a node that cannot be used.
    """
    known = node_registry(
        lambda nodes, error: print(one_line(f'note: without {nodes}: {error}'), file=sys.stderr),
        options.nav2_branch,
    )
    read_models(options.models, known)
    return OpenRegistry(known) if allow_unknown else known
