# SPDX-License-Identifier: BSD-3-Clause
"""Actions below which trees are made while they run: their nodes are nodes of the running tree."""

from __future__ import annotations

from typing import ClassVar

import pytest

from flexbt_core.behavior_tree.engine.leaf import ExpandingAction, StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.observers import LogReader, StatusLog
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.monitors.properties import Violation
from flexbt_core.monitors.requirements import Never
from flexbt_core.monitors.tree_monitor import TreeMonitor

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus


class Grow(ExpandingAction):
    """Does the trees of the entry ``trees``, one after the other."""

    ports = {'trees': input_port(STRING)}

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.left: list[str] = []

    def on_start(self) -> NodeStatus:
        self.left = str(self.get_input('trees')).split(';')
        return self._next()

    def _next(self) -> NodeStatus:
        board = Blackboard(self.blackboard)
        board.enable_autoremap()
        return self.expand(self.services, self.left.pop(0), board)

    def on_running(self) -> NodeStatus:
        try:
            status = self.tick_tree()
        except TreeLoadError as error:
            return self.fail(str(error))
        return self._next() if status is SUCCESS and self.left else status

    def on_halted(self) -> None:
        self.left = []


class Work(StatefulAction):
    """RUNNING until the entry ``done`` is true."""

    told: ClassVar[list[str]] = []

    def on_start(self) -> NodeStatus:
        self.told.append('start')
        return RUNNING

    def on_running(self) -> NodeStatus:
        return SUCCESS if self.blackboard.get_or('done', False) else RUNNING

    def on_halted(self) -> None:
        self.told.append('halt')

    def on_pause(self) -> str:
        self.told.append('pause')
        return ''

    def on_resume(self) -> None:
        self.told.append('resume')


class Break(StatefulAction):
    def on_start(self) -> NodeStatus:
        raise OSError('no arm')

    def on_running(self) -> NodeStatus:
        return SUCCESS

    def on_halted(self) -> None: ...


XML = """<root BTCPP_format="4">
  <BehaviorTree ID="Long"><Sequence>
    <Delay delay_msec="1000"><AlwaysSuccess/></Delay><Work name="work"/>
  </Sequence></BehaviorTree>
  <BehaviorTree ID="Short"><Inverter><AlwaysFailure/></Inverter></BehaviorTree>
  <BehaviorTree ID="Nested"><Sequence>
    <Grow name="inner" trees="Short;Short"/><Work name="last"/>
  </Sequence></BehaviorTree>
  <BehaviorTree ID="Broken"><Sequence><Break name="broken"/></Sequence></BehaviorTree>
  <BehaviorTree ID="Misfit"><Sleep msec="{text}"/></BehaviorTree>
  <BehaviorTree ID="Uncounted"><Repeat num_cycles="{count}"><AlwaysSuccess/></Repeat></BehaviorTree>
  <BehaviorTree ID="Main"><Sequence>
    <Grow name="grow" trees="{trees}"/><Script code="ended := true"/>
  </Sequence></BehaviorTree>
</root>"""


@pytest.fixture
def library() -> TreeLibrary:
    registry: NodeRegistry = builtin_registry()
    for node_class in (Grow, Work, Break):
        registry.register(node_class.__name__, node_class)
    Work.told = []
    return TreeLibrary([load_xml(XML, 'trees.xml', registry)])


class Watched:
    """A tree, and what its log says of it: read whenever the nodes become others."""

    def __init__(self, library: TreeLibrary, trees: str) -> None:
        self.board = Blackboard()
        self.board.set('trees', trees)
        self.clock = ManualClock()
        self.log: list[int] = []
        self.changes: list[tuple[str, NodeStatus]] = []
        self.expansions = 0
        self.tree = Tree(library, 'Main', blackboard=self.board, clock=self.clock, services=library)
        self.tree.observe(StatusLog(self.log), on_expanded=self._expanded)
        self._read_by()

    def _read_by(self) -> None:
        paths = {node.uid: node.path for node in self.tree.nodes}
        self.reader = LogReader(self.tree.nodes, lambda uid, before, after: (paths[uid], NodeStatus(after)))

    def _expanded(self) -> None:
        self.read()
        self.expansions += 1
        self._read_by()

    def read(self) -> None:
        self.changes += self.reader.read(self.log)
        self.log.clear()

    def check(self) -> None:
        """Check that the log says of each node what it is."""
        self.read()
        assert list(self.reader.statuses[1:]) == [node.status for node in self.tree.nodes]
        assert [node.uid for node in self.tree.nodes] == list(range(1, len(self.tree.nodes) + 1))


def test_its_nodes_are_nodes_of_the_running_tree(library: TreeLibrary) -> None:
    watched = Watched(library, 'Short;Long')
    tree = watched.tree
    trunk = tree.nodes
    assert tree.tick_once() is RUNNING
    watched.check()
    assert watched.expansions == 2  # the second took the place of the first
    assert tree.nodes[: len(trunk)] == trunk and len(tree.definitions) == len(tree.nodes)
    assert [node.path for node in tree.nodes[len(trunk) :]][-1] == 'grow/work'
    assert [(subtree.path, subtree.tree_id) for subtree in tree.subtrees] == [('', 'Main'), ('grow', 'Long')]
    assert tree.next_wake == watched.clock.now() + 1.0
    watched.clock.advance(1.0)
    assert tree.tick_once() is RUNNING
    assert tree.active_nodes(leaves_only=True) == ['grow/work']
    watched.check()
    assert ('grow/work', RUNNING) in watched.changes
    watched.board.set('done', True)
    assert tree.tick_once() is SUCCESS
    assert watched.board.get('ended') == 1
    watched.check()
    assert tree.nodes[len(trunk)].status is IDLE  # the root of the tree can be ticked again


def test_halt_pause_and_resume_reach_its_leaves(library: TreeLibrary) -> None:
    watched = Watched(library, 'Nested')
    assert watched.tree.tick_once() is RUNNING
    assert watched.tree.pause() == ()
    watched.tree.resume()
    watched.tree.halt()
    assert Work.told == ['start', 'pause', 'resume', 'halt']
    watched.check()
    assert {node.status for node in watched.tree.nodes} == {IDLE}
    nodes = len(watched.tree.nodes)
    for _ in range(3):  # what was there before is there no more
        assert watched.tree.tick_once() is RUNNING
        watched.check()
        assert len(watched.tree.nodes) == nodes
        watched.tree.halt()
    # Halted before the tree is there, it is not made.
    watched.tree.tick_exactly_once()
    made = watched.expansions
    watched.tree.halt()
    watched.tree.tick_exactly_once()
    assert watched.expansions == made


def test_an_error_in_it_is_told_with_the_way_up(library: TreeLibrary) -> None:
    watched = Watched(library, 'Broken')
    with pytest.raises(NodeExecutionError, match='no arm') as raised:
        watched.tree.tick_once()
    assert raised.value.node_path == 'grow/broken'
    assert raised.value.trace.path == 'grow/broken' and 'grow' in raised.value.trace.chain
    watched.tree.halt()
    watched.check()


def test_one_that_cannot_be_made_is_a_failure_for_its_reason(library: TreeLibrary) -> None:
    watched = Watched(library, 'Misfit')
    watched.board.set('text', 1.5)
    assert watched.tree.tick_once() is FAILURE
    assert watched.tree.failure is not None and 'the type' in watched.tree.failure.reason
    watched.check()


def test_the_error_of_a_tree_is_not_that_of_the_next(library: TreeLibrary, monkeypatch: pytest.MonkeyPatch) -> None:
    start = Grow.on_start
    monkeypatch.setattr(Grow, 'on_start', lambda node: start(node) and node.tick_tree())
    watched = Watched(library, 'Misfit')
    watched.board.set('text', 1.5)
    assert watched.tree.tick_once() is FAILURE
    watched.board.set('trees', 'Short')
    assert watched.tree.tick_once() is SUCCESS


def test_callbacks_reach_its_nodes_while_it_runs(library: TreeLibrary) -> None:
    watched = Watched(library, 'Nested')
    assert watched.tree.tick_once() is RUNNING
    (work,) = (node for node in watched.tree.nodes if node.name == 'last')
    watched.tree.callbacks.set_pre_tick(work, lambda node: SUCCESS)
    watched.tree.wake()
    assert watched.tree.tick_once() is SUCCESS
    assert watched.board.get('ended') == 1


def test_requirements_know_its_leaves_by_their_names_and_types(library: TreeLibrary) -> None:
    found: list[Violation] = []
    monitor = TreeMonitor(found.append, [Never('grow/AlwaysFailure'), Never('grow/work')])
    board, clock = Blackboard(), ManualClock()
    board.set('trees', 'Short;Long')
    tree = Tree(library, 'Main', blackboard=board, clock=clock, services=library, substitute=monitor.watched)
    monitor.begins(tree)
    for _ in range(2):
        monitor.ticked(tree.tick_once())
        clock.advance(1.0)
    assert [one.where for one in found] == ['grow/AlwaysFailure', 'grow/work']


def test_nodes_are_substituted_by_the_paths_that_they_get(library: TreeLibrary) -> None:
    paths: list[str] = []

    def substitute(definition: NodeDefinition, path: str) -> NodeDefinition:
        paths.append(path)
        return definition

    board = Blackboard()
    board.set('trees', 'Short;Short;Long')
    tree = Tree(library, 'Main', blackboard=board, clock=ManualClock(), services=library, substitute=substitute)
    trunk = len(tree.nodes)
    assert paths == [node.path for node in tree.nodes]
    assert tree.tick_once() is RUNNING
    made = [node.path for node in tree.nodes[trunk:]]
    assert made[0] == f'grow/Sequence::{trunk + 1}' and paths[-len(made) :] == made


def test_an_unknown_tree_and_an_entry_that_is_missing_in_it_are_errors_of_its_nodes(library: TreeLibrary) -> None:
    with pytest.raises(NodeExecutionError) as raised:
        Watched(library, 'Nope').tree.tick_once()
    reason = 'LookupError: there is no tree [Nope] to be made below [grow]'
    assert str(raised.value) == f'exception in node [grow] (Grow): {reason}'
    with pytest.raises(NodeExecutionError, match=r'exception in node \[grow/Sleep::4\] \(Sleep\): PortError: port'):
        Watched(library, 'Misfit').tree.tick_once()
    reason = r'exception in node \[grow/Repeat::4\] \(Repeat\): PortError: port \[num_cycles\]'
    with pytest.raises(NodeExecutionError, match=reason) as raised:
        Watched(library, 'Uncounted').tree.tick_once()
    assert (raised.value.node_path, raised.value.uid) == ('grow/Repeat::4', 4)
