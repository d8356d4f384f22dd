# SPDX-License-Identifier: BSD-3-Clause
"""The help of the console and of each command, and what the exit codes mean."""

from __future__ import annotations

import textwrap
from typing import Final

from flexbt_console.errors import ExitCode

from .command_line import COMMON_OPTIONS
from .registry import COMMANDS
from .spec import CommandSpec, Option

WIDTH: Final = 79
"""Columns of a help text."""

EXIT_CODES: Final = {
    ExitCode.OK: 'applied, or shown',
    ExitCode.FAULT: 'a fault of the console itself',
    ExitCode.USAGE: 'wrong usage; nothing was sent',
    ExitCode.REFUSED: 'refused, by the executive or before it was sent; the reason is printed',
    ExitCode.TIMEOUT: 'no answer in time; whether it had an effect is not known',
    ExitCode.NO_LINK: 'no link: no executive is heard',
    ExitCode.INTERRUPTED: 'interrupted while waiting (watch and the prompt end with 0)',
}


def overview() -> str:
    """The help of the whole console."""
    lines = [
        'usage: console [COMMAND] [ARGUMENT ...] [OPTION ...] [--ros-args ...]',
        '',
        "The operator's console of a FlexBT executive.",
        'Without a command, in a terminal: the screen, or the prompt where it cannot be.',
        '',
        'commands:',
    ]
    lines += _table([(spec.name, spec.summary) for spec in COMMANDS])
    lines += ['', 'options of every command:']
    lines += _table([(option.usage, option.help) for option in COMMON_OPTIONS])
    lines += ['', 'exit codes:']
    lines += _table([(str(code.value), meaning) for code, meaning in EXIT_CODES.items()])
    lines += ['', 'console COMMAND --help tells more of a command.']
    return '\n'.join(lines)


def command_help(spec: CommandSpec) -> str:
    """The help of one command."""
    lines = _help_of(spec, f'console {spec.usage}', spec.options)
    lines += ['', 'options of every command:']
    lines += _table([(option.usage, option.help) for option in COMMON_OPTIONS])
    return '\n'.join(lines)


def prompt_help(leaving: str) -> list[str]:
    """The help of the interactive prompt; ``leaving`` is what happens when the operator leaves it."""
    rows = [(' '.join([spec.name, *(argument.usage for argument in spec.arguments)]), spec) for spec in COMMANDS]
    return [
        'While a decision is shown, in short: a number or name chooses an outcome;',
        'a place, "x y yaw" or a value answers an input request.',
        *_table(
            [
                *((usage, spec.summary) for usage, spec in rows if spec.in_prompt),
                ('help [COMMAND]', 'show this, or the options of a command and more about it'),
                ('quit', f'leave the prompt, as Ctrl-D does: {leaving}'),
            ]
        ),
        'Tab completes a word; Ctrl-C clears the line.',
    ]


def prompt_command_help(spec: CommandSpec) -> list[str]:
    """The help of one command at the interactive prompt."""
    return _help_of(spec, spec.prompt_usage, spec.prompt_options)


def _help_of(spec: CommandSpec, usage: str, options: tuple[Option, ...]) -> list[str]:
    lines = textwrap.wrap(f'usage: {usage}', WIDTH, subsequent_indent=' ' * 8)
    lines += ['', *textwrap.wrap(spec.summary, WIDTH)]
    for paragraph in spec.details:
        lines += ['', *textwrap.wrap(paragraph, WIDTH)]
    if options:
        lines += ['', 'options:', *_table([(option.usage, option.help) for option in options])]
    return lines


def _table(rows: list[tuple[str, str]]) -> list[str]:
    width = min(24, max(len(left) for left, _ in rows))
    lines = []
    for left, right in rows:
        first, *more = textwrap.wrap(right, WIDTH - width - 4) or ['']
        if len(left) > width:
            lines.append(f'  {left}')
            lines.append(f'  {"":{width}}  {first}')
        else:
            lines.append(f'  {left:{width}}  {first}')
        lines += [f'  {"":{width}}  {line}' for line in more]
    return lines
