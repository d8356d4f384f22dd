# SPDX-License-Identifier: BSD-3-Clause
"""An executable with commands: its arguments, its errors, its exit code.

Packages with further dependencies add commands through entry points of the group :data:`ENTRY_POINTS`. The name is
``<executable>.<command>``, the value a module with the functions ``add_arguments`` and ``run``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from flexbt_common.command_line import SuggestingArgumentParser, run_program
from flexbt_core.values.text import escape_lines
from flexbt_tools.errors import ExitCode, ToolError, missing_package
from flexbt_tools.tree_checks.diagnostics import error_records

ENTRY_POINTS: Final = 'flexbt.commands'


@dataclass(frozen=True)
class ToolCommand:
    """A command of an executable: name, summary, a function that adds its arguments, and one that runs it.

    The latter may raise ToolError. A command without functions is provided by flexbt_formal.
    """

    name: str
    summary: str
    add_arguments: Callable[[argparse.ArgumentParser], None] | None = None
    run: Callable[[argparse.Namespace], ExitCode] | None = None


def run_command(
    program: str,
    description: str,
    commands: Sequence[ToolCommand],
    exit_codes: Sequence[tuple[str, str]],
    words: Sequence[str] | None,
) -> int:
    """Run one of the commands of an executable and return its exit code.

    Reject a command of flexbt_formal if that package is not installed.
    """
    words = sys.argv[1:] if words is None else list(words)

    def run() -> ExitCode:
        added = {point.name: point for point in entry_points(group=ENTRY_POINTS)}
        available: list[ToolCommand] = []
        missing: list[str] = []
        for command in commands:
            if command.run is not None:
                available.append(command)
            elif point := added.get(f'{program}.{command.name}'):
                available.append(_loaded(command, point) if words[:1] == [command.name] else command)
            else:
                missing.append(command.name)
        try:
            if words and words[0] in missing:
                raise missing_package(f'{program} {words[0]}')
            options = _parser(program, description, available, exit_codes).parse_args(words)
            code: ExitCode = options.run(options)
            return code
        except ToolError as error:
            if '--json' in words:
                findings = error_records(error)
                print(json.dumps({'findings': findings}), flush=True)
            for line in escape_lines(str(error), limit=1000):
                print(line, file=sys.stderr)
            return error.exit_code

    return run_program(program, run)


def _loaded(command: ToolCommand, point: EntryPoint) -> ToolCommand:
    module = point.load()
    return replace(command, add_arguments=module.add_arguments, run=module.run)


def _parser(
    program: str, description: str, commands: Sequence[ToolCommand], exit_codes: Sequence[tuple[str, str]]
) -> argparse.ArgumentParser:
    codes = '\n'.join(f'  {code:4} {meaning}' for code, meaning in exit_codes)
    parser = SuggestingArgumentParser(
        prog=program,
        description=description,
        epilog=f'exit codes:\n{codes}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    subparsers = parser.add_subparsers(metavar='COMMAND', required=True)
    for command in commands:
        summary = command.summary
        added = subparsers.add_parser(command.name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.')
        if command.add_arguments is not None:  # or it is of another package, and not the one that is run
            command.add_arguments(added)
        added.set_defaults(run=command.run)
    return parser
