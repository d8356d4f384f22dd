# SPDX-License-Identifier: BSD-3-Clause
"""A behavior as FlexBE's editor writes it, in a package of its own: found by flexbt_flexbe, started, supervised."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer, run_console
from flexbt_testing.waiting import wait_until

PACKAGE = 'mission_flexbe_behaviors'

BEHAVIOR = """
from flexbe_core import Autonomy
from flexbe_core import Behavior
from flexbe_core import ConcurrencyContainer
from flexbe_core import Logger
from flexbe_core import OperatableStateMachine
from flexbe_core import PriorityContainer
from flex_bt_flexbe_states.bt_execute_state import BtExecuteState
from flex_bt_flexbe_states.bt_get_data_state import BtGetDataState
from flex_bt_flexbe_states.bt_loader_state import BtLoaderState
from flex_bt_flexbe_states.bt_set_data_state import BtSetDataState
from flexbe_states.input_state import InputState
from flexbe_states.log_key_state import LogKeyState


class MissionSM(Behavior):

    def __init__(self, node):
        super().__init__()
        self.name = 'Mission'
        self.add_parameter('greeting', 'result')
        OperatableStateMachine.initialize_ros(node)
        Logger.initialize(node)
        BtExecuteState.initialize_ros(node)
        InputState.initialize_ros(node)

    def create(self):
        trees = 'mission_flexbe_behaviors/config/adds.xml'
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        off, low = {'done': Autonomy.Off, 'failed': Autonomy.Off}, {'done': Autonomy.Low, 'failed': Autonomy.Off}
        with machine:
            OperatableStateMachine.add('Load', BtLoaderState(bt_topic='bt_loader', filepaths=[trees]),
                                       transitions={'done': 'Ask', 'failed': 'failed'}, autonomy=off)
            OperatableStateMachine.add('Ask', InputState(request=1, message='how much?', timeout=1.0),
                                       transitions={'received': 'Set', 'aborted': 'failed',
                                                    'no_connection': 'failed', 'data_error': 'failed'},
                                       remapping={'data': 'x'})
            OperatableStateMachine.add('Set', BtSetDataState(bt_topic='bt_set_data', goal_id='x',
                                                             goal_msg_type='double'),
                                       transitions={'done': 'Add', 'failed': 'failed'}, autonomy=off,
                                       remapping={'goal': 'x'})
            OperatableStateMachine.add('Add', BtExecuteState(bt_topic='bt_executor', bt_file=trees),
                                       transitions={'done': 'Get', 'canceled': 'failed', 'failed': 'failed'})
            OperatableStateMachine.add('Get', BtGetDataState(bt_topic='bt_get_data', request_id='y',
                                                             request_msg_pkg='', request_msg_type='double'),
                                       transitions={'done': 'Tell', 'failed': 'failed'}, autonomy=low,
                                       remapping={'data': 'y'})
            OperatableStateMachine.add('Tell', LogKeyState(text=self.greeting + ' {}', severity=Logger.REPORT_HINT),
                                       transitions={'done': 'finished'}, remapping={'data': 'y'})
        return machine
"""
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Adds"><Script code="y := x + 1"/></BehaviorTree></root>'
MANIFEST = """<?xml version="1.0"?>
<behavior name="Mission">
    <executable package_path="mission_flexbe_behaviors.mission_sm" class="MissionSM" />
    <tagstring></tagstring><author>Somebody</author><date></date><description>Adds one.</description>
    <params><param type="text" name="greeting" default="result" label="Greeting" hint="" /></params>
</behavior>
"""
PACKAGE_XML = f"""<package format="3"><name>{PACKAGE}</name><version>1.0.0</version>
<export><flexbe_behaviors /><build_type>ament_cmake</build_type></export></package>
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install the package where colcon would."""
    prefix = tmp_path / 'install'
    for name, text in {
        f'share/{PACKAGE}/package.xml': PACKAGE_XML,
        f'share/{PACKAGE}/config/adds.xml': TREE,
        f'share/ament_index/resource_index/packages/{PACKAGE}': '',
        f'lib/{PACKAGE}/manifest/mission.xml': MANIFEST,
        f'python/{PACKAGE}/__init__.py': '',
        f'python/{PACKAGE}/mission_sm.py': BEHAVIOR,
    }.items():
        file = prefix / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix), prepend=os.pathsep)
    monkeypatch.setenv('PYTHONPATH', str(prefix / 'python'), prepend=os.pathsep)


@pytest.fixture
def robot(installed: None, tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path) as stack:
        for name in ('bt_server', 'onboard_executive'):
            stack.start(name, {'use_sim_time': 'false'})
        yield stack


def waiting_for(path: str) -> dict[str, Any]:
    """Return the decision that a state puts to the operator."""

    def asked() -> Any:
        return next((one for one in console_answer('status')['decisions'] if one['path'] == path), None)

    return dict(wait_until(asked, f'what {path} asks'))


def test_a_flexbe_behavior_runs_its_trees_and_is_supervised(robot: Stack) -> None:
    assert 'Mission' in run_console('behaviors').stdout
    started = run_console('start', 'Mission', 'greeting=sum', '--autonomy', 'low')
    assert started.returncode == 0, started.stdout + started.stderr
    assert waiting_for('/Ask')['prompt'] == 'how much?'
    assert run_console('input', '41').returncode == 0
    assert waiting_for('/Get')['outcome'] == 'done', 'it requires more autonomy than there is'
    assert run_console('confirm').returncode == 0
    wait_until(lambda: 'sum 42.0' in run_console('log').stdout, lambda: run_console('log').stdout)
    wait_until(lambda: console_answer('status')['outcome'] == 'finished', lambda: console_answer('status'))
    assert console_answer('status')['behavior'] == 'Mission'
