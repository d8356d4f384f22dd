# SPDX-License-Identifier: BSD-3-Clause
"""The page for people who come from FlexBE: its table of differences and the tests are about the same things."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from flexbt_flexbe import shim

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'how_to' / 'coming_from_flexbe.md').read_text(encoding='utf-8')
TESTS = [
    *sorted((ROOT / 'flexbt_flexbe' / 'test').rglob('test_*.py')),
    *sorted((ROOT / 'flexbt_core' / 'test' / 'state_machine').rglob('test_*.py')),
]


def test_each_difference_is_a_row_and_each_row_has_its_test() -> None:
    section = PAGE[PAGE.index('## Intentional differences') : PAGE.index('## What is not supported')]
    rows = [line for line in section.splitlines() if line.startswith('| ') and not line.startswith('| What |')]
    named = {name for row in rows for name in re.findall(r'`(test_\w+)`', row.rpartition(' | ')[2])}
    written = {name for file in TESTS for name in re.findall(r'def (test_\w+)', file.read_text(encoding='utf-8'))}
    assert named - written == set(), 'rows whose test there is not'
    assert {name for name in written if name.startswith('test_differs_')} - named == set(), 'tests without a row'
    assert all('`test_' in row for row in rows if not row.startswith('|---')), 'rows without a test'


def test_the_commands_are_the_consoles() -> None:
    source = (ROOT / 'flexbt_console' / 'flexbt_console' / 'commands' / 'registry.py').read_text(encoding='utf-8')
    known = set(re.findall(r"(?:CommandSpec|_\w+)\(\s*'(\w+)'", source))
    section = PAGE[PAGE.index('### Commands of the operator') : PAGE.index('## What is the same')]
    used = {word for row in section.splitlines() for word in re.findall(r'`(\w+)[^`]*`', row.rpartition(' | ')[2])}
    assert used and used - known == {'console'} & used


def test_what_is_not_here_is_not_and_its_import_names_it() -> None:
    section = PAGE[PAGE.index('## What is not supported') : PAGE.index("## FlexBT's states in FlexBE's engine")]
    offered, mixins, members = (
        re.findall(r'`([^`]+)`', part)
        for part in re.split(
            'The classes that these derive from|Machines have no members', section[section.index('Of `') :]
        )
    )
    members = members[: members.index('get_deep_state') + 1]
    assert 'EventState' in offered and 'RosStateMachine' in mixins and "sm['label']" in members
    shim.install()
    core = importlib.import_module('flexbe_core.core')
    assert offered[0] == 'flexbe_core.core' and [name for name in offered[1:] if not hasattr(core, name)] == []
    for name in set(mixins) - set(offered):
        with pytest.raises(ImportError, match=rf"cannot import name '{name}'"):
            exec(f'from flexbe_core.core import {name}')  # noqa: S102 - as code for FlexBE has it
    with core.OperatableStateMachine(outcomes=['done']) as machine, pytest.raises(TypeError, match='not subscriptable'):
        machine['label']
    assert [name for name in members if hasattr(machine, name)] == []
