# SPDX-License-Identifier: BSD-3-Clause
"""The public names of flexbt_core: each exists in the module that the list names, and loads only what it needs."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import flexbt_core

LIST = Path(flexbt_core.__file__).with_suffix('.pyi')
DEFINED = [
    (alias.name, f'flexbt_core.{statement.module}')
    for statement in ast.parse(LIST.read_text(encoding='utf-8')).body
    if isinstance(statement, ast.ImportFrom)
    for alias in statement.names
]


def test_each_name_is_listed_once_and_offered() -> None:
    names = [name for name, _ in DEFINED]
    assert sorted(names) == sorted(set(names)) == dir(flexbt_core)


@pytest.mark.parametrize('module', sorted({module for _, module in DEFINED}))
def test_each_name_is_defined_in_the_module_that_the_list_names(module: str) -> None:
    for name in (name for name, defining in DEFINED if defining == module):
        public = getattr(flexbt_core, name)
        assert public is getattr(import_module(module), name)
        if inspect.isclass(public) or inspect.isfunction(public):
            assert public.__module__ == module, name


def test_a_clock_loads_no_engine() -> None:
    program = 'import sys; from flexbt_core import Clock; print(*sorted(sys.modules))'
    loaded = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=True, timeout=60)
    ours = {name for name in loaded.stdout.split() if name.startswith('flexbt_')}
    assert ours == {'flexbt_core', 'flexbt_core.clock', 'flexbt_core.clock.clock'}
