# SPDX-License-Identifier: BSD-3-Clause
"""Write the lists of parameters in docs/reference/executables.md, from the declarations of the nodes.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node
from target import target

import flexbt_console.recording.black_box
import flexbt_console.recording.recorder
import flexbt_onboard.node.executive_parameters
import flexbt_server.parameters
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.lifecycle_manager import declare_manager_parameters
from flexbt_navigation.parameters import declare_navigation_parameters
from flexbt_sim.simulator.parameters import declare_simulator_parameters

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'executables.md'
LIST: Final = re.compile(r'(<!-- written by \S+: (\w+) -->\n).*?(<!-- end of what is written -->\n)', re.DOTALL)
EXECUTABLES: Final[dict[str, Callable[[Node], object]]] = {
    'bt_server': flexbt_server.parameters.declare_parameters,
    'onboard_executive': flexbt_onboard.node.executive_parameters.declare_parameters,
    'stop_guard': flexbt_onboard.node.executive_parameters.declare_motion,
    'simulator': declare_simulator_parameters,
    'navigation': declare_navigation_parameters,
    'lifecycle_manager': declare_manager_parameters,
    'recorder': flexbt_console.recording.recorder.declare_parameters,
    'black_box': flexbt_console.recording.black_box.declare_parameters,
}
LONG_LIST: Final = 4
"""A default with more entries than this is shown as their number."""


def rows(declare: Callable[[Node], object]) -> dict[str, str]:
    """Return the parameters that ``declare`` declares on a node, each with its item of a list."""
    with NodeRuntime.open('reference') as runtime:
        node = runtime.node
        domain = f'domain_{node.context.get_domain_id()}'

        def declared() -> dict[str, str]:
            before = node.get_parameters_by_prefix('').keys()
            declare(node)
            return {
                name: f'- `{name}`{shown(parameter.value)}: {node.describe_parameter(name).description}\n'
                for name, parameter in node.get_parameters_by_prefix('').items()
                if name not in before
            }

        return {name: row.replace(domain, 'domain_N') for name, row in runtime.call(declared).items()}


def shown(value: Any) -> str:
    """Return a default in parentheses, or nothing if it is empty."""
    if isinstance(value, bool):
        return f' ({str(value).lower()})'
    if isinstance(value, str | int | float):
        return f' (`{value}`)' if value != '' else ''
    values = [str(entry) for entry in value if entry != '']
    if len(values) > LONG_LIST:
        return f' ({len(values)} keys)'
    return f' (`[{", ".join(values)}]`)' if values else ''


def page() -> str:
    """Return the whole page with the current lists. An item of an earlier list is a reference to it."""
    first: dict[str, str] = {}

    def items(found: re.Match[str]) -> str:
        own, above = '', defaultdict[str, list[str]](list)
        for name, row in rows(EXECUTABLES[found[2]]).items():
            if first.setdefault(row, found[2]) == found[2]:
                own += row
            else:
                above[first[row]].append(f'`{name}`')
        lines = [f'As for [{other}](#{other}): {", ".join(names)}.\n\n' for other, names in above.items()]
        lines += [own, '\n'] if own else []
        return ''.join([found[1], '\n', *lines, found[3]])

    return LIST.sub(items, PAGE.read_text(encoding='utf-8'))


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
