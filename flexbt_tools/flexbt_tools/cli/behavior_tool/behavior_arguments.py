# SPDX-License-Identifier: BSD-3-Clause
"""Arguments that commands about behaviors have."""

from __future__ import annotations

import argparse

from flexbt_tools.behaviors import BuiltBehavior, behavior_entry, build
from flexbt_tools.errors import UsageError


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Values of parameters: ``options.parameters``."""
    parser.add_argument(
        '--param',
        metavar='NAME=VALUE',
        dest='parameters',
        action='append',
        default=[],
        help='value of a parameter of the behavior; repeatable (the defaults hold for the rest)',
    )


def parameters(options: argparse.Namespace) -> list[tuple[str, str]]:
    """Pairs of name and text. Raises UsageError."""
    pairs = []
    for text in options.parameters:
        name, equals, value = text.partition('=')
        if not equals:
            raise UsageError(f'--param {text}: write NAME=VALUE')
        pairs.append((name, value))
    return pairs


def add_tree_files(parser: argparse.ArgumentParser) -> None:
    """Files that the behavior does not load itself: ``options.trees``."""
    parser.add_argument(
        '--trees',
        metavar='FILE',
        action='append',
        default=[],
        help='tree file that the BT server has loaded already; repeatable',
    )


def built(options: argparse.Namespace, name: str) -> BuiltBehavior:
    """The behavior of this name, or file. Raises UsageError when it cannot be built."""
    behavior = build(behavior_entry(name), parameters(options))
    if behavior.machine is None:
        raise UsageError('\n'.join(f'{behavior.name}: {problem}' for problem in behavior.problems))
    return behavior
