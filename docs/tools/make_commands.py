# SPDX-License-Identifier: BSD-3-Clause
"""Write the table of commands in docs/explanation/operator_link.md, from the registries of executive and console.

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
HEAD: Final = """\
| Command | `run_id` is | Needs authority | Console command | Effect |
|---|---|---|---|---|
"""


def rows() -> Iterator[str]:
    """Return a row for each command of the executive."""
    specs: dict[str, CommandSpec] = {}
    for spec in CONSOLE_COMMANDS:
        if isinstance(spec.action, Send):
            for kind in spec.action.kinds:
                specs[kind.name] = spec  # the last one: a command of its own after one that knows several
    for command in CommandRegistry.COMMANDS:
        spec = specs[command.name]
        authority = 'yes' if command.needs_authority else '**no**'
        yield f'| `{command.name}` | {command.run.value} | {authority} | `{spec.name}` | {spec.summary} |\n'


def page() -> str:
    """Return the whole page with the current table."""
    before, _, rest = PAGE.read_text(encoding='utf-8').partition(BEGIN)
    after = rest.partition(END)[2]
    return ''.join([before, BEGIN, '\n', HEAD, *rows(), '\n', END, after])


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
