# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/console.md, the reference of the console, from its registry of commands.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from target import target

from flexbt_console.commands.command_line import COMMON_OPTIONS, EXIT_CODES
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.commands.spec import CommandSpec, LinkNeed, Mode, Send
from flexbt_console.ui.keys import HOW_KEYS_SEND, KEYS

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'console.md'
HEAD: Final = """\
# Console

All commands of the operator's console, on the command line, at the interactive prompt and on the screen. The text
comes from the registry of commands (`docs/tools/make_console.py` writes this page). `console COMMAND --help` prints the
same.

## Overview

| Command | Effect |
|---|---|"""
OPTIONS: Final = """\

## Common options

| Option | Meaning |
|---|---|"""
CODES: Final = """\

## Exit codes

If a command waits longer than a second, it prints the reason to standard error. Scripts can use the exit code:

| Exit code | Meaning |
|---|---|"""


def page() -> str:
    """Return the whole page."""
    lines = [HEAD]
    lines += [f'| {_code(spec.usage)} | {_cell(spec.summary)} |' for spec in COMMANDS]
    lines += [OPTIONS, *(f'| {_code(option.usage)} | {_cell(option.help)} |' for option in COMMON_OPTIONS)]
    lines += [CODES, *(f'| {code.value} | {_cell(meaning)} |' for code, meaning in EXIT_CODES.items()), '']
    for spec in COMMANDS:
        lines += section(spec)
    return '\n'.join(lines).rstrip('\n') + '\n'


def section(spec: CommandSpec) -> Iterator[str]:
    """Return the section of one command."""
    yield f'## {spec.name}'
    yield ''
    yield _code(spec.usage)
    yield ''
    yield f'{spec.summary[0].upper()}{spec.summary[1:]}.'
    for paragraph in spec.details:
        yield ''
        yield paragraph
    if spec.action is Mode.SCREEN:
        yield from ('', '| Key | | Effect |', '|---|---|---|')
        yield from (f'| `{key.shown}` | {_cell(key.label)} | {_cell(key.help)} |' for key in KEYS)
        yield from ('', HOW_KEYS_SEND)
    if spec.options:
        yield ''
        yield '| Option | Meaning |'
        yield '|---|---|'
        yield from (f'| {_code(option.usage)} | {_cell(option.help)} |' for option in spec.options)
    yield ''
    yield ' '.join(_needs(spec))
    yield ''


def _needs(spec: CommandSpec) -> Iterator[str]:
    if isinstance(spec.action, Send):
        kinds = ' or '.join(f'`{kind.name}`' for kind in spec.action.kinds)
        yield f'Sends {kinds} of `flexbt_msgs/msg/ExecutiveCommand`.'
        if spec.action.answers is not None:
            decisions = ' or '.join(sorted(kind.name for kind in spec.action.answers.kinds))
            yield f'Answers a pending decision ({decisions}).'
        if spec.link is LinkNeed.HEARD:
            yield 'The prompt sends it even without a live link.'
    yield 'On the command line and at the prompt.' if spec.in_prompt else 'On the command line only.'


def _code(text: str) -> str:
    return f'`{_cell(text)}`'


def _cell(text: str) -> str:
    return text.replace('|', r'\|')


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
