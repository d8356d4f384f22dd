# SPDX-License-Identifier: BSD-3-Clause
"""A robot, and an operator's computer, that have neither flexbt_formal nor flexbt_studio nor flexbt_testing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.probe import Probe
from flexbt_testing.waiting import DEADLINE

LEFT_OUT = {'flexbt_formal', 'flexbt_studio', 'flexbt_testing', 'flexbt_system_tests'}
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Fetch"><ReachGoal mission="cup.yaml"/></BehaviorTree></root>'
ROBOT = (
    ('simulation', '--ros-args', '-p', 'speed_factor:=5.0'),
    ('bt_server',),
    ('stop_guard',),
    ('onboard_executive',),
)


@pytest.fixture
def environment() -> dict[str, str]:
    """Return the environment of the tests, without those packages."""
    found = dict(os.environ)
    for name in ('PATH', 'PYTHONPATH', 'AMENT_PREFIX_PATH'):
        places = found.get(name, '').split(os.pathsep)
        found[name] = os.pathsep.join(place for place in places if not LEFT_OUT & set(Path(place).parts))
    return found


@pytest.fixture
def robot(environment: dict[str, str], tmp_path: Path) -> Iterator[None]:
    with ExitStack() as ending:
        for words in ROBOT:
            output = ending.enter_context((tmp_path / f'{words[0]}.log').open('wb'))
            process = subprocess.Popen(words, env=environment, cwd=tmp_path, stdout=output, stderr=output)
            ending.callback(process.wait, DEADLINE)
            ending.callback(process.terminate)
        yield


def answer(environment: dict[str, str], *words: str) -> tuple[int, str]:
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=DEADLINE, check=False)
    return done.returncode, done.stdout + done.stderr


def test_they_cannot_be_imported(environment: dict[str, str]) -> None:
    for package in ('flexbt_formal', 'flexbt_studio', 'flexbt_testing'):
        code, told = answer(environment, sys.executable, '-c', f'import {package}')
        assert code == 1 and f"No module named '{package}'" in told


def test_a_robot_drives_and_names_the_package_that_it_lacks(
    robot: None, environment: dict[str, str], tmp_path: Path
) -> None:
    with NodeRuntime.open('probe') as runtime:
        probe = Probe(runtime)
        probe.wait_ready()
        probe.drive_to(10.0, 2.3)
        probe.stop()
    asked = ('console', 'synthesize', 'flexbt_demo_behaviors/navigate/visit.yaml', '--goal', 'look')
    assert 'install the package flexbt_formal' in answer(environment, *asked, '--name', 'Look')[1]
    (tmp_path / 'fetch.xml').write_text(TREE)
    code, told = answer(environment, 'bt_tool', 'check', str(tmp_path / 'fetch.xml'))
    assert code == 1 and 'flexbt_formal, which is not installed' in told, told
    for words in (('bt_tool', 'prove', 'fetch.xml'), ('bt_tool', 'plan'), ('behavior_tool', 'synthesize', '--json')):
        code, told = answer(environment, *words)
        assert code == 2 and 'flexbt_formal' in told and 'Traceback' not in told, told
    assert answer(environment, 'bt_tool', '--help')[0] == 0
