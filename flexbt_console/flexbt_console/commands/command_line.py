# SPDX-License-Identifier: BSD-3-Clause
"""Command lines: words to a parsed command, and the help, both from the table of commands."""

from __future__ import annotations

import difflib
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from flexbt_console.errors import UsageError
from flexbt_console.mirror.records import AutonomyLevel

from . import command_table
from .command_table import COMMANDS, COMMON_OPTIONS, EXIT_CODES, CommandSpec, Option

WIDTH: Final = 79
"""Columns of a help text."""

_NUMBER = re.compile(r'-(\d|\.\d|inf|nan)', re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class CommandLine:
    """A command with its words. ``ros_arguments`` are those for ROS, ``--ros-args`` included."""

    spec: CommandSpec | None
    words: tuple[str, ...] = ()
    options: dict[str, list[str]] = field(default_factory=dict)
    ros_arguments: tuple[str, ...] = ()

    def has(self, name: str) -> bool:
        """Whether the option was given."""
        return name in self.options

    def value(self, name: str) -> str | None:
        """The value of an option, the last one when it was given again; None when it was not given."""
        values = self.options.get(name)
        return values[-1] if values else None

    def values(self, name: str) -> list[str]:
        """All values of a repeated option."""
        return self.options.get(name, [])

    def seconds(self, name: str) -> float | None:
        """The value of an option in seconds.

        Raises:
            UsageError: it is not a number above 0.
        """
        text = self.value(name)
        if text is None:
            return None
        try:
            seconds = float(text)
        except ValueError:
            seconds = math.nan
        if not 0.0 < seconds < math.inf:
            raise UsageError(f'{name} {text}: expected a number of seconds above 0')
        return seconds


def parse(words: Sequence[str]) -> CommandLine:
    """Read a command line; the command is the first word that is no option.

    Raises:
        UsageError: unknown command or option, a missing value, too few or too many words.
    """
    own, ros_arguments = _split_ros_arguments(words)
    spec: CommandSpec | None = None
    positional: list[str] = []
    options: dict[str, list[str]] = {}
    rest = list(own)
    while rest:
        word = rest.pop(0)
        if word == '--':
            positional += rest
            break
        if word == '-h':
            word = '--help'
        if word.startswith('-') and len(word) > 1 and not _NUMBER.match(word):
            _take_option(word, rest, spec, options)
        elif spec is None:
            spec = _find(word)
        else:
            positional.append(word)
    line = CommandLine(spec, tuple(positional), options, ros_arguments)
    _check(line)
    return line


def overview() -> str:
    """The help of the whole console."""
    lines = [
        'usage: console [COMMAND] [ARGUMENT ...] [OPTION ...] [--ros-args ...]',
        '',
        "The operator's console of a FlexBT executive.",
        'Without a command, in a terminal: the interactive prompt.',
        '',
        'commands:',
    ]
    lines += _table([(spec.name, spec.summary) for spec in COMMANDS])
    lines += ['', 'options of every command:']
    lines += _table([(option.usage, option.help) for option in COMMON_OPTIONS])
    lines += ['', 'exit codes:']
    lines += _table(list(EXIT_CODES))
    lines += ['', 'console COMMAND --help tells more of a command.']
    return '\n'.join(lines)


def command_help(spec: CommandSpec) -> str:
    """The help of one command."""
    lines = textwrap.wrap(f'usage: console {spec.usage}', WIDTH, subsequent_indent=' ' * 8)
    lines += ['', *textwrap.wrap(spec.summary, WIDTH)]
    for paragraph in spec.details:
        lines += ['', *textwrap.wrap(paragraph, WIDTH)]
    if spec.options:
        lines += ['', 'options:', *_table([(option.usage, option.help) for option in spec.options])]
    lines += ['', 'options of every command:']
    lines += _table([(option.usage, option.help) for option in COMMON_OPTIONS])
    return '\n'.join(lines)


def autonomy_level(text: str) -> AutonomyLevel:
    """Read a level of autonomy: its name or its number.

    Raises:
        UsageError: it is neither.
    """
    names = {level.name.lower(): level for level in AutonomyLevel}
    numbers = {str(level.value): level for level in AutonomyLevel}
    level = names.get(text.lower(), numbers.get(text))
    if level is None:
        raise UsageError(f'{text!r} is no level of autonomy; expected off, low, high, full or 0 to 3')
    return level


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
    spec = command_table.find(name)
    if spec is None:
        near = difflib.get_close_matches(name, [spec.name for spec in COMMANDS], n=1)
        hint = f'did you mean {near[0]!r}?' if near else 'see console --help'
        raise UsageError(f'there is no command {name!r}; {hint}')
    return spec


def _take_option(word: str, rest: list[str], spec: CommandSpec | None, options: dict[str, list[str]]) -> None:
    name, equals, value = word.partition('=')
    known: tuple[Option, ...] = COMMON_OPTIONS + (spec.options if spec else ())
    option = next((option for option in known if option.name == name), None)
    if option is None:
        where = f'"{spec.name}" has' if spec else 'there is'
        near = difflib.get_close_matches(name, [option.name for option in known], n=1)
        hint = f'; did you mean {near[0]}?' if near else ''
        raise UsageError(f'{where} no option {name} here{hint}')
    if name in options and not option.repeated:
        raise UsageError(f'{name} is given twice')
    if option.value is None:
        if equals:
            raise UsageError(f'{name} takes no value')
        options[name] = []
        return
    if not equals:
        if not rest:
            raise UsageError(f'{name} needs a value: {option.usage}')
        value = rest.pop(0)
    options.setdefault(name, []).append(value)


def _check(line: CommandLine) -> None:
    spec = line.spec
    if spec is None or line.has('--help'):
        return
    least = sum(argument.required for argument in spec.arguments)
    most = math.inf if any(a.repeated for a in spec.arguments) else len(spec.arguments)
    if not least <= len(line.words) <= most:
        raise UsageError(f'usage: {spec.usage}')


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
