# SPDX-License-Identifier: BSD-3-Clause
"""Acceleration: which methods are compiled anew, what they write, and that the engine does not need any of it."""

from __future__ import annotations

import inspect
import subprocess
import sys
import types

import pytest

from flexbt_core.behavior_tree.engine.observers import StatusLog, log_reader
from flexbt_core.behavior_tree.model.acceleration_seam import Acceleration, acceleration
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes import decorators
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_testing.behavior_trees.user_node_trees import make

inlining = pytest.importorskip('flexbt_core.behavior_tree.acceleration.node_classes')
if type(acceleration()) is Acceleration:
    pytest.skip('FLEXBT_ACCELERATION=0', allow_module_level=True)

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus


def transition(uid: int, before: int, after: int) -> tuple[int, int, int]:
    return uid, before, after


def test_children_that_are_set_to_idle_are_one_entry() -> None:
    log: list[int] = []
    tree = make(f'<Sequence>{"<AlwaysSuccess/>" * 50}</Sequence>', observers=[StatusLog(log)])
    reader = log_reader(tree.nodes, transition)
    assert tree.tick_once() is SUCCESS
    assert len(log) == 50 + 4
    transitions = reader.read(log)
    assert len(transitions) == 2 * 50 + 3
    assert transitions[51:53] == [(2, SUCCESS, IDLE), (3, SUCCESS, IDLE)]


def test_of_the_engine_nothing_is_left_out() -> None:
    """A method that stores a status and cannot be compiled anew works, but takes its time."""
    registry = builtin_registry()
    register_nav2(registry)
    for manifest in registry:
        node_class = manifest.node_class
        methods = inlining.inlined_methods(node_class)
        for name in dir(node_class):
            if name != '__init__' and isinstance(getattr(node_class, name), types.FunctionType):
                method = methods.get(name, getattr(node_class, name))
                assert 'status' not in method.__code__.co_names, f'{node_class.__name__}.{name} uses the property'


def test_a_file_that_was_replaced_meanwhile_is_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    source = inspect.getsource(decorators)
    for text, compiled in (
        (source, True),
        (source.replace('self.status = FAILURE', 'self.status = RUNNING', 1), False),
    ):
        code = compile(text, str(decorators.__file__), 'exec', dont_inherit=True)
        monkeypatch.setattr(decorators.__loader__, 'get_source', lambda module: text)  # noqa: B023
        monkeypatch.setattr(decorators.__loader__, 'get_code', lambda module: code)  # noqa: B023
        inlining._inlined_of_engine.cache_clear()
        inlining._compiled.cache_clear()
        assert ('execute' in inlining.inlined_methods(decorators.Inverter)) is compiled
        assert 'execute' in inlining.inlined_methods(decorators.SubTree)
    inlining._inlined_of_engine.cache_clear()
    inlining._compiled.cache_clear()


def test_the_engine_works_without_it() -> None:
    """As if the folder were not there."""
    program = (
        """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name == 'flexbt_core.behavior_tree.acceleration':
            raise ModuleNotFoundError(name=name)
sys.meta_path.insert(0, Absent())
from flexbt_core.behavior_tree.engine.observers import StatusLog, log_reader
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
text = """
        + repr(BODY)
        + """
tree = Tree(TreeLibrary().stage([load_xml(text, 'f', builtin_registry())]), 'T')
log = []
reader = log_reader(tree.nodes, lambda *change: change)
tree.observe(StatusLog(log))
assert tree.tick_once().name == 'SUCCESS'
assert tree.blackboard.snapshot() == {'n': 3, 'done': 1.0}, tree.blackboard.snapshot()
assert [after for uid, before, after in reader.read(log) if uid == 1] == [1, 2, 0]
assert type(tree.root).__name__ == 'Sequence' and 'plain_class' not in vars(type(tree.root))
assert not any('acceleration.' in name for name in sys.modules)
"""
    )
    assert subprocess.run([sys.executable, '-c', program], capture_output=True, text=True).stderr == ''


BODY = (
    '<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence><Script code="n := 0"/>'
    '<Repeat num_cycles="3"><AlwaysSuccess _post="n += 1"/></Repeat>'
    '<AlwaysFailure _successIf="n == 3" _onSuccess="done := true"/></Sequence></BehaviorTree></root>'
)
