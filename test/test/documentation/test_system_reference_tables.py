# SPDX-License-Identifier: BSD-3-Clause
"""The tables of the reference: what they say is what the code declares, no more and no less."""

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

import flexbt_console.recording.recorder
import flexbt_onboard.node.executive_parameters
import flexbt_server.parameters
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_navigation.lifecycle_manager import declare_manager_parameters
from flexbt_navigation.parameters import declare_navigation_parameters
from flexbt_onboard.node.executive_parameters import declare_motion
from flexbt_sim.simulator.parameters import declare_simulator_parameters

ROOT = Path(__file__).parents[3]
REFERENCE = ROOT / 'docs' / 'reference'
EXECUTABLES = (REFERENCE / 'executables.md').read_text(encoding='utf-8')

LONG_LIST = 4
"""Of a default with more entries than this the page gives the number."""


def table(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the first table after a text of a page, without the head."""
    lines = iter(page[page.index(heading) :].splitlines())
    rows: list[str] = []
    for line in lines:
        if line.startswith('|'):
            rows.append(line)
        elif rows:
            break
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', row)[1:-1]] for row in rows[2:]]


def codes(cell: str) -> list[str]:
    return re.findall(r'`([^`]+)`', cell)


def executables() -> Iterator[metadata.EntryPoint]:
    for distribution in metadata.distributions():
        if distribution.name.startswith('flexbt'):
            yield from distribution.entry_points.select(group='console_scripts')


def test_executables_begin_with_what_handles_signals_and_load_the_rest_then() -> None:
    modules = {point.module for point in executables()}
    assert {module.partition('.')[2] for module in modules} == {'executables'}
    script = f'import sys, {", ".join(modules)}; print(*(name for name in sys.modules if name.startswith("flexbt")))'
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True, check=True)
    packages = {module.partition('.')[0] for module in modules} | {'flexbt_common'}
    assert set(done.stdout.split()) == modules | packages | {'flexbt_common.executables'}


def test_executables() -> None:
    installed = {point.name for point in executables()}
    assert set(re.findall(r'\*\*`(\w+)`\*\*', EXECUTABLES)) == installed
    if (ROOT / 'install' / 'flexbt_underlay.sh').exists():  # otherwise built by colcon alone
        found = subprocess.run(
            [
                'bash',
                '-c',
                f'. {ROOT}/tools/env.sh; for name; do command -v "$name" || echo "$name"; done',
                '',
                *installed,
            ],
            capture_output=True,
            text=True,
            check=True,
        )
        assert [line for line in found.stdout.splitlines() if '/' not in line] == []


@pytest.mark.parametrize(
    ('executable', 'declare'),
    [
        ('bt_server', flexbt_server.parameters.declare_parameters),
        ('onboard_executive', flexbt_onboard.node.executive_parameters.declare_parameters),
        ('stop_guard', lambda node: declare_motion(ParameterDeclarer(node))),
        ('simulator', declare_simulator_parameters),
        ('navigation', declare_navigation_parameters),
        ('lifecycle_manager', declare_manager_parameters),
        ('recorder', flexbt_console.recording.recorder.declare_parameters),
    ],
)
def test_parameters(executable: str, declare: Callable[[Node], object]) -> None:
    with NodeRuntime.open('reference') as runtime:
        node = runtime.node
        domain = f'domain_{node.context.get_domain_id()}'

        def declared() -> dict[str, tuple[str, str]]:
            before = node.get_parameters_by_prefix('').keys()
            declare(node)
            return {
                name: (shown(parameter).replace(domain, 'domain_N'), node.describe_parameter(name).description)
                for name, parameter in node.get_parameters_by_prefix('').items()
                if name not in before
            }

        parameters = runtime.call(declared)
    assert {codes(row[0])[0]: (row[1], row[2]) for row in table(EXECUTABLES, f'**`{executable}`**')} == parameters


def shown(parameter: Parameter) -> str:
    """Return a default as the page writes it."""
    value: Any = parameter.value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int | float):
        return f'`{value}`' if value != '' else '–'
    values = [str(entry) for entry in value if entry != '']
    if len(values) > LONG_LIST:
        return f'{len(values)} keys'
    return f'`[{", ".join(values)}]`' if values else '–'


def test_every_interface_that_is_no_part_of_another_is_on_its_page() -> None:
    files = [file for kind in ('action', 'msg', 'srv') for file in (ROOT / 'flexbt_msgs' / kind).iterdir()]
    parts = {type for file in files for type in re.findall(r'^\w+', file.read_text(encoding='utf-8'), re.MULTILINE)}
    page = set(re.findall(r'\w+', (REFERENCE / 'interfaces.md').read_text(encoding='utf-8')))
    assert {file.stem for file in files} - parts - page == set()


@pytest.mark.parametrize(
    ('tool', 'page'),
    [
        ('make_bounds.py', 'reference/interfaces.md'),
        ('make_commands.py', 'explanation/operator_link.md'),
        ('make_world_files.py', 'reference/world_files.md'),
    ],
)
def test_tables_that_are_written_from_the_code(tool: str, page: str, tmp_path: Path) -> None:
    file = tmp_path / 'page.md'
    subprocess.run([sys.executable, ROOT / 'docs' / 'tools' / tool, file], check=True)
    written, wanted = (where.read_text(encoding='utf-8') for where in (ROOT / 'docs' / page, file))
    assert written == wanted, f'run docs/tools/{tool}'
