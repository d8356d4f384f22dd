# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/console.md, the reference of the console, from its registry of commands.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from target import target

from flexbt_console.commands.command_line import COMMON_OPTIONS, EXIT_CODES
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.commands.spec import CommandSpec, LinkNeed, Mode, Option, Send
from flexbt_console.ui.keys import HOW_KEYS_SEND, KEYS

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'console.md'
HEAD: Final = """\
# Console

All commands of the operator's console. `docs/tools/make_console.py` writes this page from the registry of commands;
`console COMMAND --help` prints the same. [The operator link](../explanation/operator_link.md#list-of-commands) lists
the commands that are sent to the executive. A command works on the command line and at the prompt.
"""
NOT_IN_PROMPT: Final = ', '.join(f'`{spec.name}`' for spec in COMMANDS if not spec.in_prompt)
OPTIONS: Final = """\

## Common options

All commands have these:
"""
SENT: Final = """\

Commands that are sent to the executive, except {}, also have this option, which their usages leave out:
"""
SHARED: Final = """\

The following, where a usage names them, mean the same for all commands unless the section says otherwise:
"""
CODES: Final = """\

## Exit codes

If a command waits longer than a second, it prints the reason to standard error. Scripts can use the exit code:

| Exit code | Meaning |
|---|---|"""
USES: Final = Counter(option for spec in COMMANDS for option in spec.options)
USUAL: Final = {option.usage: option for option, _ in reversed(USES.most_common())}
"""The most common option of each usage."""
SHARED_OPTIONS: Final = [option for option, uses in USES.items() if uses > 1 and USUAL[option.usage] == option]
REASON: Final = USES.most_common(1)[0][0]
"""The option of commands that are sent."""
WITHOUT_REASON: Final = ', '.join(
    f'`{spec.name}`' for spec in COMMANDS if isinstance(spec.action, Send) and REASON not in spec.options
)
DETAILS: Final = Counter(paragraph for spec in COMMANDS for paragraph in spec.details)
SHARED_DETAILS: Final = [paragraph for paragraph, uses in DETAILS.items() if uses > 1]


def page() -> str:
    """Return the whole page."""
    lines = [f'{HEAD}On the command line only: {NOT_IN_PROMPT}.', OPTIONS, *map(_item, COMMON_OPTIONS)]
    lines += [SENT.format(WITHOUT_REASON), _item(REASON)]
    lines += [
        SHARED,
        *(_item(option) for option in SHARED_OPTIONS if option != REASON),
        *(f'- {paragraph}' for paragraph in SHARED_DETAILS),
    ]
    lines += [CODES, *(f'| {code.value} | {_cell(meaning)} |' for code, meaning in EXIT_CODES.items()), '']
    for spec in COMMANDS:
        lines += section(spec)
    return '\n'.join(lines).rstrip('\n') + '\n'


def section(spec: CommandSpec) -> Iterator[str]:
    """Return the section of one command."""
    yield f'## {spec.name}'
    yield ''
    usage = spec.usage.replace(f' [{REASON.usage}]', '')
    if usage != spec.name:
        yield f'`{usage}`'
        yield ''
    yield f'{spec.summary[0].upper()}{spec.summary[1:]}.'
    for paragraph in spec.details:
        if paragraph not in SHARED_DETAILS:
            yield ''
            yield paragraph
    if spec.action is Mode.SCREEN:
        yield from ('', *(f'- `{key.shown}` ({key.label}): {key.help}' for key in KEYS), '', HOW_KEYS_SEND)
    own = [option for option in spec.options if option not in SHARED_OPTIONS]
    if own:
        yield from ('', *map(_item, own))
    if isinstance(spec.action, Send) and spec.action.answers is not None:
        decisions = ' or '.join(sorted(kind.name for kind in spec.action.answers.kinds))
        yield from ('', f'Answers a pending decision ({decisions}).')
    if isinstance(spec.action, Send) and spec.link is LinkNeed.HEARD:
        yield from ('', 'The prompt sends it even without a live link.')
    yield ''


def _item(option: Option) -> str:
    return f'- `{option.usage}`: {option.help}'


def _cell(text: str) -> str:
    return text.replace('|', r'\|')


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
