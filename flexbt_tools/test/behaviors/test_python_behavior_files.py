# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in Python files that are not installed: their modules, versions, interfaces, and faults."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

CALL = 'import sys; from flexbt_tools.executables import behavior_tool; sys.exit(behavior_tool())'

BEHAVIOR = """\
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import WaitState

from {helper} import SECONDS


class {name}(Behavior):
    manifest = BehaviorManifest('{name}', 'waits')

    def create(self) -> OperatableStateMachine:
        print('made')
        machine = OperatableStateMachine(['finished', 'failed'])
        with machine:
            machine.add('Wait', WaitState(SECONDS), transitions={{'done': '{target}'}})
        return machine
"""


def tool(*words: object) -> subprocess.CompletedProcess[str]:
    """Run ``behavior_tool`` in a process, which then has imported what it was told to."""
    command = [sys.executable, '-P', '-B', '-c', CALL, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def report(*words: object) -> Any:
    """Return what ``behavior_tool`` prints with ``--json``."""
    done = tool(*words, '--json')
    try:
        return json.loads(done.stdout)
    except ValueError:
        raise AssertionError(f'{done.stdout}\n{done.stderr}') from None


def rules(*words: object) -> list[str]:
    """Return the rules of the findings."""
    return [one['rule'] for one in report(*words)['findings']]


def write(folder: Path, helper: str, *, target: str = 'finished', seconds: str = '1.0', name: str = 'Waits') -> Path:
    """Write a behavior and the module from which it gets its time, and return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / 'json.py').write_text(f'SECONDS = {seconds}\n')
    file = folder / 'waits.py'
    file.write_text(BEHAVIOR.format(helper=helper, name=name, target=target))
    return file


def test_a_file_of_a_package_is_imported_with_what_is_beside_it_and_not_with_what_is_installed(tmp_path: Path) -> None:
    below = tmp_path / 'flexbt_demo_behaviors' / 'below'  # a package of this name is installed, and loaded before
    file = write(below, '.json')
    for folder in (below, below.parent):
        (folder / '__init__.py').touch()
    assert rules('check', file) == ['dead-outcome']
    (below / 'json.py').write_text("SECONDS = 'soon'\n")
    (finding,) = report('check', file)['findings']
    assert (finding['file'], finding['line']) == (str(file), 15) and 'soon' in finding['message']


@pytest.mark.parametrize('is_package', [False, True])
def test_two_versions_of_a_file_are_compared_each_with_its_own_modules(tmp_path: Path, is_package: bool) -> None:
    helper = '.helper' if is_package else 'helper'
    now, before = write(tmp_path / 'now', helper), write(tmp_path / 'before', helper, target='failed')
    for file in (now, before):
        check = f'assert __file__.startswith({str(file.parent)!r})\nSECONDS = 1.0\n'
        (file.parent / 'helper.py').write_text(check)
        if is_package:
            (file.parent / '__init__.py').touch()
    (compared,) = report('prove', now, '--against', before)['comparisons']
    assert compared['differences']
    (compared,) = report('prove', now, '--against', now)['comparisons']
    assert not compared['differences']


@pytest.mark.parametrize(('name', 'is_package'), [('round-2.py', True), ('a round\n.old.py', False)])
def test_a_file_may_have_a_name_that_no_import_could_have(tmp_path: Path, name: str, is_package: bool) -> None:
    file = write(tmp_path / 'now', '.json' if is_package else 'helper', target='lost').rename(tmp_path / 'now' / name)
    (file.parent / 'helper.py').write_text('SECONDS = 1.0\n')
    if is_package:
        (file.parent / '__init__.py').touch()
    (finding,) = report('check', file)['findings']
    assert "leads to 'lost'" in finding['message']


def test_several_behaviors_in_one_file_are_checked_and_named(tmp_path: Path) -> None:
    file = write(tmp_path, 'helper')
    (tmp_path / 'helper.py').write_text('SECONDS = 1.0\n')
    file.write_text(file.read_text() + BEHAVIOR.format(helper='helper', name='Others', target='finished'))
    assert report('check', file)['summary']['behaviors'] == 2
    refused = tool('show', file)
    assert refused.returncode == 2 and 'Waits, Others' in refused.stderr and 'waits.py:CLASS' in refused.stderr
    assert tool('show', f'{file}:Others').returncode == 0
    assert 'has no class Other that' in tool('show', f'{file}:Other').stderr


@pytest.mark.parametrize(
    ('text', 'line', 'message'),
    [
        ('\nimport nothing_such\n', 2, 'No module named'),
        ('\n\nraise SystemExit(0)\n', 3, 'SystemExit'),
        ('x = 1\n', 0, 'no class'),
        ('def f(:\n', 1, 'SyntaxError'),
        ('from flexbt_core.state_machine.model.definition import Child\n\nChild()\n', 3, 'TypeError'),
    ],
)
def test_a_file_that_cannot_be_imported_is_refused_with_the_place_in_it(
    tmp_path: Path, text: str, line: int, message: str
) -> None:
    file = tmp_path / 'broken.py'
    file.write_text(text)
    (finding,) = report('check', file)['findings']
    assert message in finding['message'] and finding['line'] == line
    assert finding['file'] == (str(file) if line else '')


def test_a_behavior_that_ends_the_process_while_it_is_built_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, 'helper')
    (tmp_path / 'helper.py').write_text('SECONDS = 1.0\n')
    file.write_text(file.read_text().replace("print('made')", 'raise SystemExit(0)'))
    (finding,) = report('check', file)['findings']
    assert finding['rule'] == 'refused' and 'create() raised SystemExit' in finding['message']
    assert tool('show', file).returncode == 2


FLEXBE = """\
from flexbe_core import Autonomy, Behavior, OperatableStateMachine
from flexbe_states.wait_state import WaitState


class WaitsSM(Behavior):
    def __init__(self, node):
        super().__init__()
        self.name = 'Waits'
        self.add_parameter('seconds', 1.0)
        OperatableStateMachine.initialize_ros(node)
        WaitState.initialize_ros(node)

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add(
                'Wait', WaitState(self.seconds), transitions={'done': 'nowhere'}, autonomy={'done': Autonomy.Off}
            )
        return machine
"""


def test_a_behavior_of_flexbe_is_checked_without_its_manifest(tmp_path: Path) -> None:
    pytest.importorskip('flexbt_flexbe')
    file = tmp_path / 'waits_sm.py'
    file.write_text(FLEXBE)
    (finding,) = report('check', file)['findings']
    assert 'nowhere' in finding['message'] and finding['path'] == '/Wait'
    file.write_text(FLEXBE.replace('nowhere', 'finished'))
    assert rules('check', file, '--param', 'seconds=2.0') == ['dead-outcome']
    assert [one['never'] for one in report('prove', file)['proofs']] == [['/ > failed']]
