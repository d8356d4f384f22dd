# SPDX-License-Identifier: BSD-3-Clause
"""Arguments that commands about behaviors have."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from flexbt_onboard.behaviors import machine_entry
from flexbt_tools.behaviors import BuiltBehavior, build, installed
from flexbt_tools.errors import UsageError
from flexbt_tools.text_files import read_text

_MAX_BYTES: Final = 4_000_000


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


def machine_file(options: argparse.Namespace) -> Path | None:
    """The file of a machine that is meant instead of an installed behavior."""
    file = Path(options.name)
    return file if file.suffix in ('.yaml', '.yml') else None


def built(options: argparse.Namespace) -> BuiltBehavior:
    """The behavior that is meant. Raises UsageError when it cannot be built."""
    file = machine_file(options)
    if file is None:
        (entry,) = installed([options.name])
    else:
        entry = machine_entry(file.stem, read_text(str(file), _MAX_BYTES))
    behavior = build(entry, parameters(options))
    if behavior.machine is None:
        raise UsageError('\n'.join(f'{behavior.name}: {problem}' for problem in behavior.problems))
    return behavior
