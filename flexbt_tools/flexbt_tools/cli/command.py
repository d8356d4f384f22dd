# SPDX-License-Identifier: BSD-3-Clause
"""An executable with commands: its arguments, its errors, its exit code.

Packages that need more than this one add commands by entry points of the group :data:`ENTRY_POINTS`: the name is
``<executable>.<command>``, the value the module.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Final, Protocol

from flexbt_common.cli import HintingArgumentParser, abandon_stdout, make_streams_safe, report_full_output
from flexbt_core.values import lines
from flexbt_tools.errors import ExitCode, ToolError, missing_package

ENTRY_POINTS: Final = 'flexbt.commands'


class Command(Protocol):
    """A module with one command of an executable."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declares what it takes."""

    def run(self, options: argparse.Namespace) -> ExitCode:
        """Carries it out. Raises ToolError."""


def run_command(
    program: str,
    description: str,
    commands: Sequence[tuple[str, Command | None, str]],
    exit_codes: Sequence[tuple[str, str]],
    words: Sequence[str] | None,
) -> int:
    """Run one of the commands (name, module, summary) of an executable and return its exit code.

    A command without a module is one that flexbt_formal adds; where it is not installed, it is refused.
    """
    make_streams_safe()
    words = sys.argv[1:] if words is None else words
    added = {point.name: point for point in entry_points(group=ENTRY_POINTS)}
    own: list[tuple[str, Command, str]] = []
    missing: list[str] = []
    for name, module, summary in commands:
        if module is not None:
            own.append((name, module, summary))
        elif point := added.get(f'{program}.{name}'):
            own.append((name, point.load(), summary))
        else:
            missing.append(name)
    try:
        if words and words[0] in missing:
            raise missing_package(f'{program} {words[0]}')
        options = _parser(program, description, own, exit_codes).parse_args(words)
        code: ExitCode = options.run(options)
        sys.stdout.flush()
    except ToolError as error:
        for line in lines(str(error), limit=1000):
            print(line, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        abandon_stdout()
        return ExitCode.OK
    except OSError as error:
        if not report_full_output(program, error):
            raise
        return ExitCode.USAGE
    return code


def _parser(
    program: str, description: str, commands: Sequence[tuple[str, Command, str]], exit_codes: Sequence[tuple[str, str]]
) -> argparse.ArgumentParser:
    codes = '\n'.join(f'  {code:4} {meaning}' for code, meaning in exit_codes)
    parser = HintingArgumentParser(
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
