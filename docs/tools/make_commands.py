# SPDX-License-Identifier: BSD-3-Clause
"""Write the list of commands in docs/explanation/operator_link.md, from the registries of executive and console.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from target import target

from flexbt_console.commands.registry import COMMANDS as CONSOLE_COMMANDS
from flexbt_console.commands.spec import CommandSpec, Send
from flexbt_onboard.commands.command_registry import CommandRegistry

PAGE: Final = Path(__file__).parents[1] / 'explanation' / 'operator_link.md'
BEGIN: Final = '<!-- written by docs/tools/make_commands.py -->\n'
END: Final = '<!-- end of what is written -->\n'


def items() -> Iterator[str]:
    """Return an item for each kind of run and of authority, with the commands that need it."""
    specs: dict[str, CommandSpec] = {}
    for spec in CONSOLE_COMMANDS:
        if isinstance(spec.action, Send):
            for kind in spec.action.kinds:
                specs[kind.name] = spec  # the last one: a command of its own after one that knows several
    needs: dict[str, list[str]] = {}
    for command in CommandRegistry.COMMANDS:
        need = f'{command.run.value}, {"with authority" if command.needs_authority else "**without authority**"}'
        needs.setdefault(need, []).append(f'`{command.name}` (`{specs[command.name].name}`)')
    yield from (f'- {need}: {", ".join(commands)}\n' for need, commands in needs.items())


def page() -> str:
    """Return the whole page with the current list."""
    before, _, rest = PAGE.read_text(encoding='utf-8').partition(BEGIN)
    after = rest.partition(END)[2]
    return ''.join([before, BEGIN, '\n', *items(), '\n', END, after])


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
