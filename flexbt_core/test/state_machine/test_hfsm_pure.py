# SPDX-License-Identifier: BSD-3-Clause
"""The core is pure Python: a fresh interpreter that has no ROS, only PyYAML, imports all of it, and runs a machine."""

from __future__ import annotations

import subprocess
import sys

from flexbt_testing.state_machines.bench import Bench, Scripted, nested

MOST_INLINE = 29
"""Attributes that CPython keeps in the object itself; with more it has a dictionary, and each of them takes longer."""

PROGRAM = """
import sys, threading

class Guard:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if top not in (*sys.stdlib_module_names, 'flexbt_core', 'yaml', '_yaml'):
            raise ImportError(f'{name} must not be imported by the state machine')

sys.meta_path.insert(0, Guard())
import importlib, pkgutil
import flexbt_core as engine, flexbt_core.state_machine as package
for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
    importlib.import_module(module.name)
imported = {name for name in sys.modules if name.startswith('flexbt_')}
others = {name for name in imported if not name.startswith('flexbt_core.state_machine')}
others -= {'flexbt_core'}
below = ('flexbt_core.clock', 'flexbt_core.values', 'flexbt_core.skills', 'flexbt_core.errors')
assert all(name.startswith(below) for name in others), others

from flexbt_core.clock.clock import ManualClock

class Pass(engine.EventState):
    def execute(self, userdata):
        return 'done'

machine = engine.OperatableStateMachine(outcomes=['ended'])
with machine:
    engine.OperatableStateMachine.add('Pass', Pass(outcomes=['done']), {'done': 'ended'})
run = engine.MachineRun(engine.define(machine), ManualClock(), [])
run.start()
assert not run.step()
assert threading.active_count() == 1
print(run.outcome)
"""


def test_the_core_imports_no_ros_and_starts_no_thread() -> None:
    result = subprocess.run([sys.executable, '-c', PROGRAM], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == 'ended'


def test_what_each_step_asks_has_its_attributes_inline() -> None:
    run = Bench(nested(Scripted(), 'Outer/Inner')).run
    (leaf,) = run.active_states()
    asked = [run, run.root, run.controls, leaf, leaf.clock, *run.regions()]
    assert {type(one).__name__: len(vars(one)) for one in asked if len(vars(one)) > MOST_INLINE} == {}
