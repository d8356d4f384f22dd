# SPDX-License-Identifier: BSD-3-Clause
"""An executable with commands: its arguments, its errors, its exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Protocol

from flexbt_common.cli import HintingArgumentParser, abandon_stdout, make_streams_safe, report_full_output
from flexbt_core.values import lines
from flexbt_tools.errors import ExitCode, ToolError


class Command(Protocol):
    """A module with one command of an executable."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declares what it takes."""

    def run(self, options: argparse.Namespace) -> ExitCode:
        """Carries it out. Raises ToolError."""


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
