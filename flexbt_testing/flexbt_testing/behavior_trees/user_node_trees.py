# SPDX-License-Identifier: BSD-3-Clause
"""User-defined nodes, well-behaved and not, and random trees of them and the engine's nodes."""

from __future__ import annotations

import random
from collections.abc import Iterable
from typing import Any

from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Control, ControlNode, Decorator
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock

RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus.RUNNING, NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.SKIPPED


class Flip(Condition):
    """A condition that holds every other time. It raises if its name says so."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.calls = 0

    def tick(self) -> NodeStatus:
        self.calls += 1
        if 'raise' in self.name and self.calls % 3 == 0:
            raise RuntimeError('as its name says')
        return SUCCESS if self.calls % 2 else FAILURE


class Busy(StatefulAction):
    """A leaf that is RUNNING twice, then SUCCESS."""

    def on_start(self) -> NodeStatus:
        self.left = 2
        return RUNNING

    def on_running(self) -> NodeStatus:
        self.left -= 1
        return RUNNING if self.left else SUCCESS

    def on_halted(self) -> None:
        if 'raise' in self.name:
            raise RuntimeError('in on_halted')


class Moody(SyncAction):
    """A node that stores statuses itself."""

    def tick(self) -> NodeStatus:
        self.status = RUNNING
        return SUCCESS


class Careless(Control):
    """A node that ticks its children in a different order each time, ignores their errors, and halts one at random."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.random = random.Random(self.uid)

    def tick(self) -> NodeStatus:
        order = list(range(len(self.children)))
        self.random.shuffle(order)
        self.status = RUNNING
        results = []
        for index in order:
            try:
                results.append(self.tick_child(index))
            except NodeExecutionError:
                self.halt_child(index)
            if self.random.random() < 0.2:
                self.halt_children_except(index)
        if self.random.random() < 0.5 or RUNNING in results:
            return RUNNING
        self.reset_children()
        return self.random.choice((SUCCESS, FAILURE, SKIPPED))

    def on_halt(self) -> None:
        self.halt_child(self.random.randrange(len(self.children)))
        if self.random.random() < 0.2:
            self.tick_child(0)
        if self.random.random() < 0.2:
            raise RuntimeError('in on_halt')


class Twice(Decorator):
    """A node that ticks its child twice, and returns any status."""

    def tick(self) -> NodeStatus:
        first = self.tick_child()
        if first is RUNNING and self.active:
            self.halt_child()
        return self.tick_child() if first is not SUCCESS else RUNNING


class Fickle(ControlNode):
    """A node that does not derive from Control, so that its behavior is unknown."""

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        self.status = self._ticks[-1]()
        if self.status is not RUNNING:
            self.reset_children()
        return self.status


def make(body: str, more: Iterable[type[TreeNode]] = (), **options: Any) -> Tree:
    """Return a tree of these nodes and ``more``."""
    registry = builtin_registry()
    register_nav2(registry)
    registry.register_classes((Flip, Busy, Moody, Careless, Twice, Fickle, *more))
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return Tree(TreeLibrary([load_xml(text, 'test.xml', registry)]), 'Main', clock=ManualClock(), **options)


LEAVES = (
    *('<Flip/>', '<Busy/>') * 4,
    '<Flip name="raise"/>',
    '<Busy name="raise"/>',
    '<Moody/>',
    '<AlwaysSuccess/>',
    '<AlwaysFailure/>',
    '<Sleep msec="20"/>',
    '<Script code="n := n + 1"/>',
    '<SetBlackboard value="2" output_key="n"/>',
    '<Flip _skipIf="n == 1"/>',
    '<Busy _while="n != 3"/>',
    '<Busy _onHalted="n := missing"/>',
)
DECORATORS = (
    'Inverter',
    'ForceSuccess',
    'Repeat num_cycles="{n}"',
    'RetryUntilSuccessful num_attempts="2"',
    'Timeout msec="20"',
    'Delay delay_msec="10"',
    'RateController hz="50"',
    'SkipUnlessUpdated entry="{n}"',
    'Precondition if="n != 2" else="SKIPPED"',
    'LoopInt queue="1;2" value="{n}"',
    'Inverter _failureIf="n == 3"',
    'GoalUpdatedController',
    *('Twice',) * 3,
    *('KeepRunningUntilFailure', 'SingleTrigger', 'RunOnce'),
)
CONTROLS = (
    *('Careless',) * 3,
    'Fickle',
    *('Sequence', 'Fallback', 'ReactiveSequence', 'ReactiveFallback') * 2,
    *('AsyncSequence', 'SequenceWithMemory', 'PipelineSequence', 'RoundRobin', 'NonblockingSequence'),
    'Parallel failure_count="2"',
    'ParallelAll',
    'TryCatch catch_on_halt="true"',
    'Sequence _onSuccess="n := n + 1"',
)


def random_body(seed: int) -> str:
    """Return the XML of a random tree. The entry ``n`` holds a number."""
    source = random.Random(seed)

    def node(depth: int) -> str:
        chance = source.random()
        if depth > 4 or (depth > 0 and chance < 0.3):
            return source.choice(LEAVES)
        if chance < 0.55:
            tag = source.choice(DECORATORS)
            return f'<{tag}>{node(depth + 1)}</{tag.partition(" ")[0]}>'
        tag = source.choice(CONTROLS)
        children = ''.join(node(depth + 1) for _ in range(source.randint(2, 4)))
        return f'<{tag}>{children}</{tag.partition(" ")[0]}>'

    return node(0)


def run_some(tree: Tree, seed: int) -> None:
    """Do one random operation on a tree."""
    source = random.Random(seed)
    clock = tree.context.clock
    assert isinstance(clock, ManualClock)
    try:
        match source.randrange(8):
            case 0:
                tree.halt()
            case 1:
                tree.tick_exactly_once()
            case 2:
                tree.blackboard.set('n', source.randrange(5))
            case 3:
                clock.advance(source.choice((0.001, 0.01, 0.05)))
            case _:
                tree.tick_once()
    except NodeExecutionError:
        pass
