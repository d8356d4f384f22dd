# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``bt_tool``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Final, Protocol

from flexbt_common.cli import abandon_stdout, make_streams_safe
from flexbt_core.values import lines
from flexbt_tools.errors import DeskError, ExitCode
from flexbt_tools.mock_runs import run
from flexbt_tools.tree_checks import check
from flexbt_tools.trees import draw, log, model, show

EXIT_CODES: Final = (
    ('0', 'nothing is wrong; the tree succeeded'),
    ('1', 'check: something is wrong; run: the tree did not succeed'),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('4', 'run: a node raised an exception, or broke the rules'),
    ('5', 'run: the tree was not done in time'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ('check', check, 'find what is wrong, and what is suspicious, in tree files'),
    ('show', show, 'show the trees of a file as text'),
    ('draw', draw, 'draw the trees of a file'),
    ('model', model, 'describe the node types that are known here, for editors'),
    ('run', run, 'run a tree with mocks, and print what happens'),
    ('log', log, 'print a log file (.btlog) of a run'),
)


class Command(Protocol):
    """A module with one command of an executable."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declares what it takes."""

    def run(self, options: argparse.Namespace) -> ExitCode:
        """Carries it out. Raises DeskError."""


def main(words: Sequence[str] | None = None) -> int:
    """Runs ``bt_tool`` and gives its exit code, see :class:`flexbt_tools.errors.ExitCode`."""
    return run_command('bt_tool', 'Behavior-tree files at the desk: without ROS running.', COMMANDS, EXIT_CODES, words)


def run_command(
    program: str,
    description: str,
    commands: Sequence[tuple[str, Command, str]],
    exit_codes: Sequence[tuple[str, str]],
    words: Sequence[str] | None,
) -> int:
    """Runs one of the commands (name, module, summary) of an executable and gives its exit code."""
    make_streams_safe()
    options = _parser(program, description, commands, exit_codes).parse_args(words)
    try:
        code: ExitCode = options.run(options)
        sys.stdout.flush()
    except DeskError as error:
        for line in lines(str(error), limit=1000):
            print(line, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        abandon_stdout()
        return ExitCode.OK
    return code


def _parser(
    program: str, description: str, commands: Sequence[tuple[str, Command, str]], exit_codes: Sequence[tuple[str, str]]
) -> argparse.ArgumentParser:
    codes = '\n'.join(f'  {code:4} {meaning}' for code, meaning in exit_codes)
    parser = argparse.ArgumentParser(
        prog=program,
        description=description,
        epilog=f'exit codes:\n{codes}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True)
    for name, module, summary in commands:
        command = subparsers.add_parser(name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.')
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


if __name__ == '__main__':
    sys.exit(main())
