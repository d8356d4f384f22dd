# SPDX-License-Identifier: BSD-3-Clause
"""The reference tables of the README: what they say is what the code declares, no more and no less."""

import inspect
import re
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

import flexbt_console.recording.recorder
import flexbt_onboard.executive_parameters
import flexbt_server.parameters
import flexbt_sim.navigation_parameters
import flexbt_sim.simulator_parameters
import flexbt_states
from flexbt_common.node_runtime import NodeRuntime
from flexbt_console.command_table import COMMANDS, EXIT_CODES
from flexbt_server.behavior_tree import PortDirection
from flexbt_server.node_types import node_registry

README = (Path(__file__).parents[2] / 'README.md').read_text(encoding='utf-8')

PORTS_OF_CLIENTS = {'server_name', 'service_name', 'server_timeout', '→error_msg'}
"""Ports that are told once, above the table."""

LONG_LIST = 4
"""Of a default with more entries than this the README gives the number."""


def table(heading: str) -> list[list[str]]:
    """The cells of the first table after a text, without the head."""
    lines = iter(README[README.index(heading) :].splitlines())
    rows: list[str] = []
    for line in lines:
        if line.startswith('|'):
            rows.append(line)
        elif rows:
            break
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', row)[1:-1]] for row in rows[2:]]


def codes(cell: str) -> list[str]:
    return re.findall(r'`([^`]+)`', cell)


def test_executables() -> None:
    section = README[README.index('### Executables') : README.index('### Actions')]
    installed = {
        point.name
        for distribution in metadata.distributions()
        if distribution.name.startswith('flexbt')
        for point in distribution.entry_points.select(group='console_scripts')
    }
    assert set(re.findall(r'\*\*`(\w+)`\*\*', section)) == installed


@pytest.mark.parametrize(
    ('executable', 'declare'),
    [
        ('bt_server', flexbt_server.parameters.declare_parameters),
        ('onboard_executive', flexbt_onboard.executive_parameters.declare_parameters),
        ('simulator', flexbt_sim.simulator_parameters.declare_parameters),
        ('navigation', flexbt_sim.navigation_parameters.declare_parameters),
        ('recorder', flexbt_console.recording.recorder.declare_parameters),
    ],
)
def test_parameters(executable: str, declare: Callable[[Node], object]) -> None:
    with NodeRuntime.open('readme') as runtime:
        node = runtime.node

        def declared() -> dict[str, tuple[str, str]]:
            before = node.get_parameters_by_prefix('').keys()
            declare(node)
            return {
                name: (shown(parameter), node.describe_parameter(name).description)
                for name, parameter in node.get_parameters_by_prefix('').items()
                if name not in before
            }

        parameters = runtime.call(declared)
    assert {codes(row[0])[0]: (row[1], row[2]) for row in table(f'**`{executable}`**')} == parameters


def shown(parameter: Parameter) -> str:
    """A default as the README writes it."""
    value: Any = parameter.value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int | float):
        return f'`{value}`' if value != '' else '–'
    values = [str(entry) for entry in value if entry != '']
    if len(values) > LONG_LIST:
        return f'{len(values)} keys'
    return f'`[{", ".join(values)}]`' if values else '–'


def test_states() -> None:
    rows = {name: row for row in table('### States') for name in codes(row[0])}
    assert rows.keys() == set(flexbt_states.__all__)
    parameters: list[str] = []
    for name, row in rows.items():
        state = getattr(flexbt_states, name)
        above, parameters = parameters, codes(row[1])
        if row[1].startswith('as above'):
            parameters = above + parameters
        documented: dict[str, list[str]] = {'--': [], '>#': [], '#>': [], '<=': []}
        for mark, key in re.findall(r'^\s*(--|>#|#>|<=) (\S+)', inspect.getdoc(state) or '', re.MULTILINE):
            documented[mark].append(key)
        assert list(documented.values()) == [
            list(inspect.signature(state).parameters),
            *(re.findall(r'\w+', cell) for cell in row[2:]),
        ], name
        assert set(parameters) == set(documented['--']), name


def test_nodes() -> None:
    rows = {name: codes(row[2].replace('→`', '`→')) for row in table('### BT nodes') for name in codes(row[0])}
    ports = {
        manifest.id: {
            ('→' if port.direction is PortDirection.OUTPUT else '') + name for name, port in manifest.ports.items()
        }
        - PORTS_OF_CLIENTS
        for manifest in node_registry(lambda _point, _error: None)
    }
    numbered = re.compile(r'_\d$')  # of which the README shows the first two
    assert {name: {port for port in named if not numbered.search(port)} for name, named in rows.items()} == {
        name: {port for port in declared if not numbered.search(port)} for name, declared in ports.items()
    }


def test_commands_and_exit_codes_of_the_console() -> None:
    assert [codes(row[0])[0].split()[0] for row in table('### Console')] == [command.name for command in COMMANDS]
    assert [tuple(row) for row in table('Every command has')] == list(EXIT_CODES)
