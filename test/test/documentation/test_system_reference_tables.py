# SPDX-License-Identifier: BSD-3-Clause
"""The tables of the reference: what they say is what the code declares, no more and no less."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
REFERENCE = ROOT / 'docs' / 'reference'
EXECUTABLES = (REFERENCE / 'executables.md').read_text(encoding='utf-8')


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
    assert set(re.findall(r'\*\*`([\w-]+)`\*\*', EXECUTABLES)) == installed
    if 'FLEXBT_ROOT' in os.environ:  # otherwise built by colcon alone
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
        ('make_parameters.py', 'reference/executables.md'),
        ('make_world_files.py', 'reference/world_files.md'),
    ],
)
def test_tables_that_are_written_from_the_code(tool: str, page: str, tmp_path: Path) -> None:
    file = tmp_path / 'page.md'
    subprocess.run([sys.executable, ROOT / 'docs' / 'tools' / tool, file], check=True)
    written, wanted = (where.read_text(encoding='utf-8') for where in (ROOT / 'docs' / page, file))
    assert written == wanted, f'run docs/tools/{tool}'
