# SPDX-License-Identifier: BSD-3-Clause
"""Command lines, parsed and checked against the registry, and the help on them."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Final

from flexbt_console.errors import ExitCode, UsageError
from flexbt_console.mirror.freshness import LOST_SECONDS
from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle

from .registry import COMMANDS, find
from .spec import NO_COMMAND, CommandLine, CommandSpec, Option, Read, robot_names, seconds

COMMON_OPTIONS: Final = (
    Option('--json', 'print JSON for programs: one object, or one a line for watch'),
    Option('--timeout', 'how long to wait for the executive and its answer (default 5)', 'SECONDS', read=seconds),
    Option(
        '--operator',
        'who gives the command (default: FLEXBT_OPERATOR, or user@host/terminal; a page asks for a name)',
        'NAME',
    ),
    Option('--observer', 'only watch: send no commands; the executive counts no operator (its own role in a policy)'),
    Option('--namespace', 'namespace of the robot, as --ros-args -r __ns:=NAME', 'NAME', values=robot_names),
    Option(
        '--places',
        'YAML file with places in addition to those of the robot (default: FLEXBT_PLACES, or the parameter "places")',
        'FILE',
    ),
    Option(
        '--lost-after',
        f'age at which a status counts as lost instead of late (default {LOST_SECONDS:g})',
        'SECONDS',
        read=seconds,
    ),
    Option('--help', 'show this help'),
)
"""Options of every command."""

_NUMBER = re.compile(r'-(\d|\.\d|inf|nan)', re.IGNORECASE)


def parse(words: Sequence[str]) -> CommandLine:
    """Read a command line; the command is the first word that is not an option.

    Raises:
        UsageError: unknown command or option, a missing value, too few or too many words.
    """
    own, ros_arguments = _split_ros_arguments(words)
    spec = NO_COMMAND
    positional: list[str] = []
    options: dict[str, list[str]] = {}
    rest = iter(own)
    for word in rest:
        if word == '--':
            positional += rest
            break
        if word == '-h':
            word = '--help'
        if word.startswith('-') and len(word) > 1 and not _NUMBER.match(word):
            _take_option(word, rest, spec, options)
        elif spec is NO_COMMAND:
            spec = _find(word)
        elif not positional and (longer := find(f'{spec.name} {word}')) is not None:
            spec = longer
        else:
            positional.append(word)
    line = CommandLine(spec, spec.joined(positional), options, ros_arguments)
    if spec is not NO_COMMAND and not line.has('--help'):
        least = sum(argument.required for argument in spec.arguments)
        most = math.inf if any(argument.repeated for argument in spec.arguments) else len(spec.arguments)
        if not least <= len(line.words) <= most:
            more = [one.name for one in COMMANDS if one.name.startswith(f'{spec.name} ')]
            others = f'; or one of {", ".join(more)}' if more and line.words else ''
            raise UsageError(f'usage: {spec.usage}{others}')
    return line


def check(line: CommandLine) -> None:
    """Read the words and values of a line of a command, before anything is started for it.

    Raises:
        UsageError: one is not written as it has to be.
    """
    for option in COMMON_OPTIONS + line.spec.options:
        for value in line.values(option.name) if option.read is not None else ():
            _read(option.read, value, f'{option.name} ')
    for index, word in enumerate(line.words):
        argument, *others = line.spec.arguments_at(index)
        if not others:
            _read(argument.read, word)
    if line.spec.check is not None:
        line.spec.check(line)


def _split_ros_arguments(words: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    # As ROS does it: "--ros-args" begins a stretch of ROS arguments which ends at "--" or with the line.
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for word in words:
        if inside and word == '--':
            inside = False
        elif word == '--ros-args':
            inside = True
        else:
            (ros if inside else own).append(word)
    return own, ('--ros-args', *ros) if ros else ()


def _find(name: str) -> CommandSpec:
    spec = find(name)
    if spec is None:
        remedy = did_you_mean(name, [spec.name for spec in COMMANDS], '; see console --help')
        raise UsageError(f'there is no command {short_repr(name)}{remedy}')
    return spec


def _take_option(word: str, rest: Iterator[str], spec: CommandSpec, options: dict[str, list[str]]) -> None:
    name, equals, value = word.partition('=')
    known: tuple[Option, ...] = COMMON_OPTIONS + spec.options
    option = next((option for option in known if option.name == name), None)
    if option is None:
        where = f'"{spec.name}" has' if spec.name else 'there is'
        near = did_you_mean(name, [option.name for option in known], '')
        raise UsageError(f'{where} no option {truncate_middle(name)} here{near}')
    if name in options and not option.repeated:
        raise UsageError(f'{name} is given twice')
    if option.value is None:
        if equals:
            raise UsageError(f'{name} takes no value')
        options[name] = []
        return
    given = value if equals else next(rest, None)
    if given is None:
        raise UsageError(f'{name} needs a value: {option.usage}')
    options.setdefault(name, []).append(given)


def _read(read: Read | None, word: str, what: str = '') -> None:
    try:
        if read is not None:
            read(word)
    except UsageError as error:
        raise UsageError(f'{what}{error}') from None


# The help of the console and of each command, and what the exit codes mean.

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
    """Return the help of the whole console."""
    lines = [
        'usage: console [COMMAND] [ARGUMENT ...] [OPTION ...] [--ros-args ...]',
        '',
        "The operator's console of a FlexBT executive.",
        'Without a command, in a terminal: the screen, or else the prompt.',
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
    """Return the help of one command."""
    lines = _help_of(spec, f'console {spec.usage}', spec.options)
    lines += ['', 'options of every command:']
    lines += _table([(option.usage, option.help) for option in COMMON_OPTIONS])
    return '\n'.join(lines)


def prompt_help(leaving: str) -> list[str]:
    """Return the help of the interactive prompt; ``leaving`` is what happens when the operator leaves it."""
    rows = [(' '.join([spec.name, *(argument.usage for argument in spec.arguments)]), spec) for spec in COMMANDS]
    return [
        'Short answers while a decision is shown: a number or name chooses an outcome;',
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
    """Return the help of one command at the interactive prompt."""
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
