# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``.test`` files: what they say is read, what they test is run, and what is wrong is found."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from flexbe_packages import write_package
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Path as RosPath

from flexbt_flexbe import shim
from flexbt_testing.flexbe import StateTestError, read_state_test, run_state_test
from flexbt_testing.nodes.state_bench import StateBench

PACKAGE = 'tested_flexbe_states'
SUBJECTS = """
from flexbe_core import Autonomy, Behavior, EventState, OperatableStateMachine


class ApplyState(EventState):
    def __init__(self, function, label='', outcomes=('done', 'failed')):
        super().__init__(outcomes=list(outcomes), input_keys=['value'], output_keys=['result', 'label'])
        self._function, self._label = function, label

    def execute(self, userdata):
        if self._function is None:
            return 'failed'
        outcome, userdata.result = self._function(userdata.value)
        if self._label:
            userdata.label = self._label
        return outcome


class BrokenState(EventState):
    def __init__(self):
        super().__init__(outcomes=['done'])
        raise ArithmeticError('cannot be made')


class Neither:
    pass


class TestedMissionSM(Behavior):
    def __init__(self, node):
        super().__init__()
        self.name = 'Tested Mission'
        self.add_parameter('factor', 1)

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished', 'failed'], input_keys=['value'])
        machine.userdata.value = 0
        with machine:
            OperatableStateMachine.add('Apply', ApplyState(lambda value: ('done', value * self.factor)),
                                       transitions={'done': 'finished', 'failed': 'failed'},
                                       autonomy={'done': Autonomy.Full, 'failed': Autonomy.Full})
        return machine
"""
POSE = PoseStamped(pose=Pose(position=Point(x=1.0), orientation=Quaternion(w=1.0)))
STATE = f'path: {PACKAGE}.tested_mission_sm\nclass: ApplyState\n'
BEHAVIOR = f'path: {PACKAGE}\nname: Tested Mission\n'


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the package under test: its share."""
    python = write_package(tmp_path, PACKAGE, manifests={}, sources={'tested_mission_sm.py': SUBJECTS})
    monkeypatch.syspath_prepend(python)
    monkeypatch.setenv('PYTHONPATH', f'{python}{os.pathsep}{shim.DIRECTORY}', prepend=os.pathsep)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=os.pathsep)
    for module in [name for name in sys.modules if name.partition('.')[0] == PACKAGE]:
        monkeypatch.delitem(sys.modules, module)
    return tmp_path / 'share' / PACKAGE


def written(directory: Path, text: str) -> Path:
    file = directory / 'one.test'
    file.write_text(text, encoding='utf-8')
    return file


@pytest.mark.parametrize(
    ('text', 'problems'),
    [
        (STATE + 'params: {function: "lambda x: (\'done\', x + 1)"}\ninput: {value: 2}\noutput: {result: 3}\n'
         'outcome: done', []),
        (STATE + 'params: {function: None}\ninput: {value: 2}\noutcome: failed', []),
        (STATE + 'params: {function: "lambda x: (\'done\', x)", label: //topic}\ninput: {value: None}\n'
         'output: {label: //topic, result: None}\noutcome: done', []),
        (f'{STATE}import_only: true\nparams: {{nothing: 1}}', []),
        (STATE.replace('Apply', 'Broken') + 'import_only: true', []),
        (BEHAVIOR + 'params: {factor: 3}\ninput: {value: 2}\noutput: {result: 6}\noutcome: finished', []),
        (STATE + yaml.dump({'params': {'function': "lambda x: ('done', x)"}, 'input': {'value': POSE},
                            'output': {'result': POSE}, 'outcome': 'done'}), []),
        # What is wrong
        (STATE + 'params: {function: None}\ninput: {value: 2}\noutcome: done', ["outcome is 'failed', not 'done'"]),
        (STATE + 'params: {function: "lambda x: (\'done\', x)"}\ninput: {value: 2}\n'
         'output: {result: 3, label: a}\noutcome: failed',
         ["outcome is 'done', not 'failed'", "'result' is 2, not 3", "has not written 'label'"]),
        (STATE + 'params: {function: "lambda x: (\'done\', 99 * x + \'c\')"}\ninput: {value: a}\n'
         f'output: {{result: {99 * "a"}b}}\noutcome: done', [f"'result' is '{99 * 'a'}c', not '{99 * 'a'}b'"]),
        (STATE + 'params: {function: "lambda x: (None, x)"}\ninput: {value: 2}\noutcome: done', ['gave no outcome']),
        (STATE + 'params: {function: "lambda x: 1 / 0"}\ninput: {value: 2}\noutcome: done',
         ["outcome is 'failed', not 'done'.*ZeroDivisionError"]),
        (f'{STATE}params: {{function: None}}\noutcome: done', ['value']),
        (f'{STATE}params: {{functions: None}}\noutcome: done', ["unexpected keyword argument 'functions'"]),
        (STATE + 'params: {function: None}\ninput: {value: 2}\noutput: {other: 1}\noutcome: failed', ['other']),
        (f'{STATE.replace("Apply", "Broken")}outcome: done', ['ArithmeticError: cannot be made']),
        (f'{STATE.replace("Apply", "No")}outcome: done', ['neither an EventState nor a Behavior, but None']),
        (f'{STATE.replace("ApplyState", "Neither")}outcome: done', ['neither an EventState nor a Behavior']),
        (f'{STATE.replace("tested_m", "m")}outcome: done', ['cannot be imported: ModuleNotFoundError']),
        (f'{BEHAVIOR}params: {{speed: 3}}\noutcome: finished', ["has no parameter 'speed'"]),
        (f'{BEHAVIOR}params: {{factor: much}}\noutcome: finished', ["'much' is not a value of type int"]),
    ],
)  # fmt: skip
def test_a_test_passes_or_says_all_that_is_wrong(
    installed: Path, tmp_path: Path, bench: StateBench, text: str, problems: list[str]
) -> None:
    found = run_state_test(
        read_state_test(written(tmp_path, text)), bench, 0.5 if 'no outcome' in str(problems) else 10
    )
    if not problems:
        assert found == []
    for problem in problems:
        assert any(re.search(problem, one, re.DOTALL) for one in found), (problem, found)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('- 1', 'a test is a mapping of class, import_only,'),
        ('', 'path is missing'),
        ('path: a.b', 'class is missing; give it, or the name of a behavior'),
        (STATE, 'outcome is missing'),
        (f'{STATE}outcome: done\noutput_: 1', 'unknown keys output_; known are class,'),
        (f'{STATE}outcome: done\nlaunch: x\ndata: y', 'data, launch: nodes and data that a test needs are not'),
        (f'{STATE}outcome: done\nparams: [1]', r'params has to be a mapping of names to values, not \[1\]'),
        (f'{STATE}outcome: done\nparams: {{f: "lambda x:"}}', "'lambda x:' is not a function: "),
        (f'{STATE}outcome: done\nparams: {{f: "lambda x: x, print(1)"}}', 'is not a function'),
        (f'{STATE}outcome: done\ninput: !!python/object/apply:os.mkdir [executed]', 'line 4: '),
        ('? [a]\n: 1', 'line 1: a key has to be a name'),
        (f'{STATE}class: x', "line 3: 'class' is there twice"),
        (f'{STATE}outcome: done\ninput: {{a: !!python/object/new:os.stat_result []}}', 'line 4: '),
        (
            f'{STATE}outcome: done\ninput: {{a: !!python/object/new:os.system {{state: 1}}}}',
            'os.system is not a ROS mess',
        ),
        (f'{STATE}outcome: done\ninput: {{a: !!python/object/new:std_msgs.msg._x.Bool {{}}}}', 'a message has a state'),
    ],
)
def test_what_is_no_test_is_refused_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    file = written(tmp_path, text)
    with pytest.raises(StateTestError, match=reason) as caught:
        read_state_test(file)
    assert str(file) in str(caught.value)
    assert not (tmp_path / 'executed').exists()


@given(st.text(alphabet='{}[]:,-?&*!<|> \n\'"#%@apt\x00é') | st.builds(lambda a, b: f'{a}{STATE}{b}', *[st.text()] * 2))
def test_any_text_is_a_test_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = tmp_path_factory.getbasetemp() / 'any.test'
    file.write_text(text, encoding='utf-8', errors='replace')
    try:
        read_state_test(file)
    except StateTestError as error:
        assert str(file) in str(error)


numbers = st.floats(allow_nan=False)
poses = st.builds(
    PoseStamped,
    pose=st.builds(Pose, position=st.builds(Point, x=numbers, y=numbers, z=numbers)),
)
messages = poses | st.builds(RosPath, poses=st.lists(poses, max_size=3))


@given(messages)
def test_messages_are_read_as_pyyaml_writes_them(tmp_path_factory: pytest.TempPathFactory, message: Any) -> None:
    text = f'{STATE}outcome: done\n{yaml.dump({"input": {"value": message}})}'
    assert read_state_test(written(tmp_path_factory.getbasetemp(), text)).inputs['value'] == message


USE = """
from flexbe_testing.py_tester import PyTester


class TestStates(PyTester):
    @classmethod
    def setUpClass(cls):
        PyTester._package = '{package}'
        PyTester._tests_folder = 'tests'
        super().setUpClass()

    def test_right(self):
        self.run_test('right')

    def test_wrong(self):
        self.run_test('wrong', timeout_sec=5.0, max_cnt=None)

    def test_missing(self):
        self.run_test('missing')
"""


def test_flexbes_test_cases_run_as_they_are_and_so_do_files_on_the_command_line(installed: Path) -> None:
    folder = installed / 'tests'
    folder.mkdir()
    (folder / 'right.test').write_text(BEHAVIOR + 'outcome: finished')
    (folder / 'wrong.test').write_text(BEHAVIOR + 'outcome: failed')
    (folder / 'test_states.py').write_text(USE.format(package=PACKAGE))
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=folder)
    assert '2 failed, 1 passed' in done.stdout, done.stdout
    assert "its outcome is 'finished', not 'failed'" in done.stdout
    assert 'missing.test: No such file' in done.stdout
    command = [sys.executable, '-m', 'flexbt_testing.flexbe', *map(str, sorted(folder.glob('*.test')))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.stdout.splitlines() == [
        f'passed  {folder}/right.test',
        f'FAILED  {folder}/wrong.test',
        "        its outcome is 'finished', not 'failed'",
        '1 of 2 passed',
    ]
    assert done.returncode == 1
