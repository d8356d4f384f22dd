# SPDX-License-Identifier: BSD-3-Clause
"""The page about behaviors in YAML: its example is a behavior, and its tables have all keys."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from flexbt_onboard.behaviors.behavior import BehaviorInput, BehaviorParameter
from flexbt_testing.behavior_trees.bt_tool import behavior_tool

PAGE = (Path(__file__).parents[3] / 'docs' / 'reference' / 'yaml_behaviors.md').read_text(encoding='utf-8')
[EXAMPLE] = re.findall(r'^```yaml\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / 'round.yaml'
    file.write_text(EXAMPLE)
    return file


def test_the_example_is_a_behavior_without_problems(file: Path) -> None:
    [command] = re.findall(r'^behavior_tool (check round.yaml .*?) +#', PAGE, re.MULTILINE)
    done = behavior_tool(*command.replace('round.yaml', str(file)).split(), '--strict')
    assert (done.code, done.err) == (0, '1 behavior: no problems found\n'), done
    shown = behavior_tool('show', str(file), '--param', 'limit=30').out
    assert 'at most 30 s' in shown and 'Judge' in shown
    assert behavior_tool('prove', str(file)).code == 0


def test_a_problem_is_told_as_the_page_says(file: Path) -> None:
    [told] = re.findall(r'`round\.yaml:([^`]*)\.\.\.`', PAGE)
    file.write_text(EXAMPLE.replace('bt_file: $tree', 'bt_fil: $tree'))
    assert f'{file}:{told}' in behavior_tool('check', str(file)).out


@pytest.mark.parametrize(('key', 'declared'), [('parameters', BehaviorParameter), ('inputs', BehaviorInput)])
def test_the_list_of_the_head_has_all_keys(key: str, declared: type[BehaviorParameter | BehaviorInput]) -> None:
    [row] = re.findall(rf'^- `{key}`: (.*by (?:name|key): .*)$', PAGE, re.MULTILINE)
    assert set(re.findall('`([a-z]+)`', row)) == {one.name for one in fields(declared)[1:]}
