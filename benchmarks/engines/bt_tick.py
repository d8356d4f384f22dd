# SPDX-License-Identifier: BSD-3-Clause
"""What a tick of a behavior tree costs: this engine, BehaviorTree.CPP (through the wheel behaviortreepy) and py_trees.

Shapes: (a) a sequence of leaves, (b) a reactive fallback over conditions, (c) a chain of decorators, (d) sub-trees with
remapped ports that are written and read, (e) scripts and pre-conditions, and (f) a sequence of leaves written in Python
for this engine and for the wheel. The engines take turns within each round, so that the noise of the machine meets
them alike; what counts is the median of the ratios of the rounds.

A second table has other nodes, each of them many times below one ParallelAll, which ticks them all.

A third table has the loading of a file through the store of the BT server, for the first time and again, and the memory
of a node.

Usage: python3 benchmarks bt_tick [--rounds N] [--sizes 100,1000] [--shapes a,b,...] [--others loop,switch,...]
                                  [--output FILE.json]
"""

from __future__ import annotations

import argparse
import gc
import importlib
import statistics
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from _figures import write_figures

from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeDocument, TreeLibrary
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.trees.tree_store import TreeStore

TARGET_NATIVE: Final = 0.7
TARGET_PYTHON: Final = 0.5
TARGET_PY_TREES: Final = 30.0
OTHER_NODES: Final = 1000
"""Nodes of a tree of the second table."""
NODES_PER_SAMPLE: Final = 60_000
"""Nodes ticked for one sample of an engine."""

CHAIN_DEPTH: Final = 200
"""Nodes of a chain in one tree: XML may nest 256 deep, so long chains go through sub-trees."""

Tick = Callable[[], object]


def document(*trees: str) -> str:
    """Return an XML file of trees; the first is the main one."""
    bodies = ''.join(f'<BehaviorTree ID="T{number}">{body}</BehaviorTree>' for number, body in enumerate(trees))
    return f'<root BTCPP_format="4" main_tree_to_execute="T0">{bodies}</root>'


def leaves(count: int) -> str:
    return document(f'<Sequence>{"<AlwaysSuccess/>" * (count - 1)}</Sequence>')


def conditions(count: int) -> str:
    return document(f'<ReactiveFallback>{"<AlwaysFailure/>" * (count - 1)}</ReactiveFallback>')


def decorators(count: int) -> str:
    trees: list[str] = []
    left = count
    while left > 0:
        depth = min(CHAIN_DEPTH, left) - 1
        left -= depth + 1
        inner = f'<SubTree ID="T{len(trees) + 1}"/>' if left > 0 else '<AlwaysSuccess/>'
        trees.append('<Inverter>' * depth + inner + '</Inverter>' * depth)
    return document(*trees)


def subtrees(count: int) -> str:
    """Two nodes of each sub-tree use an entry of the caller: one writes it, the other reads it."""
    call = '<SubTree ID="T1" in="{value}" out="{value}"/>'
    inner = (
        '<Sequence><SetBlackboard value="1" output_key="out"/>'
        '<Repeat num_cycles="{out}"><AlwaysSuccess/></Repeat></Sequence>'
    )
    calls = call * max(1, (count - 2) // 5)
    return document(f'<Sequence><SetBlackboard value="1" output_key="value"/>{calls}</Sequence>', inner)


def scripts(count: int) -> str:
    """Half of the nodes are scripts, the others have a pre-condition."""
    pair = '<Script code="n := n + 1; ok := n &gt; 0"/><AlwaysSuccess _failureIf="n &lt; 0 || !ok"/>'
    return document(f'<Sequence><Script code="n := 0; ok := true"/>{pair * ((count - 2) // 2)}</Sequence>')


def python_leaves(count: int) -> str:
    return document(f'<Sequence>{"<PythonCondition/>" * (count - 1)}</Sequence>')


SHAPES: Final[dict[str, tuple[str, Callable[[int], str]]]] = {
    'a': ('sequence of leaves', leaves),
    'b': ('reactive fallback over conditions', conditions),
    'c': ('chain of decorators', decorators),
    'd': ('sub-trees, remapped ports', subtrees),
    'e': ('scripts and pre-conditions', scripts),
    'f': ('sequence of Python leaves', python_leaves),
}


def many(element: str, nodes: int, first: str = '', *trees: str) -> Callable[[int], str]:
    """As many copies of ``element``, which is so many ``nodes``, as make up a tree; after what is ``first``."""

    def make(count: int) -> str:
        return document(f'<ParallelAll>{first}{element * max(1, (count - 1) // nodes)}</ParallelAll>', *trees)

    return make


def pointers(text: str) -> Callable[[int], str]:
    return many(text, 2, '<Script code="n := 1"/>')


_LONG: Final = ';'.join(['1'] * 500)

OTHERS: Final[dict[str, tuple[str, Callable[[int], str]]]] = {
    'fallback': ('Fallback over failures', many('<Fallback><AlwaysFailure/><AlwaysFailure/></Fallback>', 3)),
    'memory': ('SequenceWithMemory of one', many('<SequenceWithMemory><AlwaysSuccess/></SequenceWithMemory>', 2)),
    'parallel': (
        'Parallel of four',
        many(f'<Parallel>{"<AlwaysSuccess/>" * 4}</Parallel>', 5),
    ),
    'parallelall': ('ParallelAll of four', many(f'<ParallelAll>{"<AlwaysSuccess/>" * 4}</ParallelAll>', 5)),
    'wide': ('Parallel of all', lambda count: document(f'<Parallel>{"<AlwaysSuccess/>" * (count - 1)}</Parallel>')),
    'ifthenelse': (
        'IfThenElse',
        many('<IfThenElse><AlwaysFailure/><AlwaysSuccess/><AlwaysSuccess/></IfThenElse>', 4),
    ),
    'whiledoelse': (
        'WhileDoElse',
        many('<WhileDoElse><AlwaysSuccess/><AlwaysSuccess/><AlwaysSuccess/></WhileDoElse>', 4),
    ),
    'switch': (
        'Switch3 on an entry',
        many(
            '<Switch3 variable="{s}" case_1="a" case_2="b" case_3="c">' + '<AlwaysSuccess/>' * 4 + '</Switch3>',
            5,
            '<SetBlackboard value="b" output_key="s"/>',
        ),
    ),
    'repeat': ('Repeat, one cycle', many('<Repeat num_cycles="1"><AlwaysSuccess/></Repeat>', 2)),
    'retry': (
        'RetryUntilSuccessful',
        many('<RetryUntilSuccessful num_attempts="1"><AlwaysFailure/></RetryUntilSuccessful>', 2),
    ),
    'force': ('ForceFailure', many('<ForceFailure><AlwaysSuccess/></ForceFailure>', 2)),
    'keeprunning': (
        'KeepRunningUntilFailure',
        many('<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>', 2),
    ),
    'runonce': ('RunOnce, done', many('<RunOnce><AlwaysSuccess/></RunOnce>', 2)),
    'timeout': ('Timeout', many('<Timeout msec="100000"><AlwaysSuccess/></Timeout>', 2)),
    'delay': ('Delay, waiting', many('<Delay delay_msec="100000000"><AlwaysSuccess/></Delay>', 2)),
    'precondition': ('Precondition', many('<Precondition if="true"><AlwaysSuccess/></Precondition>', 2)),
    'loop': ('LoopInt with value', many(f'<LoopInt queue="{_LONG}" value="{{n}}"><AlwaysSuccess/></LoopInt>', 2)),
    'loopstring': (
        'LoopString with value',
        many(f'<LoopString queue="{_LONG}" value="{{s}}"><AlwaysSuccess/></LoopString>', 2),
    ),
    'loopbare': ('LoopDouble without value', many(f'<LoopDouble queue="{_LONG}"><AlwaysSuccess/></LoopDouble>', 2)),
    'skipunless': (
        'SkipUnlessUpdated, written',
        pointers('<SkipUnlessUpdated entry="{n}"><AlwaysSuccess/></SkipUnlessUpdated>'),
    ),
    'skipidle': (
        'SkipUnlessUpdated, not written',
        many('<SkipUnlessUpdated entry="{n}"><AlwaysSuccess/></SkipUnlessUpdated>', 2),
    ),
    'waitvalue': (
        'WaitValueUpdate, written',
        pointers('<WaitValueUpdate entry="{n}"><AlwaysSuccess/></WaitValueUpdate>'),
    ),
    'waitidle': (
        'WaitValueUpdate, not written',
        many('<WaitValueUpdate entry="{n}"><AlwaysSuccess/></WaitValueUpdate>', 2),
    ),
    'wasupdated': (
        'WasEntryUpdated, written',
        many('<WasEntryUpdated entry="{n}"/>', 1, '<Script code="n := 1"/>'),
    ),
    'set': ('SetBlackboard of a literal', many('<SetBlackboard value="1" output_key="n"/>', 1)),
    'copy': (
        'SetBlackboard of an entry',
        many('<SetBlackboard value="{n}" output_key="m"/>', 1, '<Script code="n := 1"/>'),
    ),
    'unset': ('UnsetBlackboard', many('<UnsetBlackboard key="n"/>', 1)),
    'post': (
        '_post',
        many('<AlwaysSuccess _post="n := n + 1"/>', 1, '<Script code="n := 0"/>'),
    ),
    'onsuccess': (
        '_onSuccess of a decorator',
        many('<Inverter _onFailure="n := 1"><AlwaysSuccess/></Inverter>', 2, '<Script code="n := 0"/>'),
    ),
    'skipif': ('_skipIf', many('<AlwaysSuccess _skipIf="n &lt; 0"/>', 1, '<Script code="n := 0"/>')),
    'subtree': ('SubTree', many('<SubTree ID="T1"/>', 2, '', '<AlwaysSuccess/>')),
    'autoremap': (
        'SubTree, _autoremap, entry read',
        many(
            '<SubTree ID="T1" _autoremap="true"/>',
            3,
            '<SetBlackboard value="1" output_key="n"/>',
            '<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>',
        ),
    ),
}
"""Nodes that the shapes do not have, and how many of them make up a tree."""


class PythonCondition(Condition):
    """A leaf of a user."""

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


def registry() -> NodeRegistry:
    made = builtin_registry()
    made.register('PythonCondition', PythonCondition)
    return made


def our_tree(xml: str, nodes: NodeRegistry) -> Tree:
    return Tree(TreeLibrary().stage([load_xml(xml, 'bench.xml', nodes)]), 'T0')


class Wheel:
    """BehaviorTree.CPP. The factory lives as long as its trees."""

    def __init__(self) -> None:
        self._library = importlib.import_module('behaviortreepy')

    def tree(self, xml: str) -> tuple[Any, Any]:
        factory = self._library.BehaviorTreeFactory()
        success = self._library.NodeStatus.SUCCESS
        factory.register_simple_condition('PythonCondition', lambda node: success)
        return factory, factory.create_tree_from_text(xml)


def py_trees_tick(shape: str, count: int) -> Tick | None:
    """Return the same shape in py_trees; None where it has no such thing (conditions of a script, remapped ports)."""
    from py_trees import behaviours, composites, decorators, logging

    logging.level = logging.Level.ERROR
    root: Any
    if shape in 'af':
        root = composites.Sequence('root', memory=False)
        root.add_children([behaviours.Success(name='leaf') for _ in range(count - 1)])
    elif shape == 'b':
        root = composites.Selector('root', memory=False)
        root.add_children([behaviours.Failure(name='leaf') for _ in range(count - 1)])
    elif shape == 'c' and count <= 1000:  # its time grows with the square of the depth
        root = behaviours.Success(name='leaf')
        for _ in range(count - 1):
            root = decorators.Inverter(name='inverter', child=root)
    else:
        return None
    tick: Tick = root.tick_once
    return tick


def sample(tick: Tick, nodes: int, repetitions: int) -> float:
    """ns of a tick for each node."""
    began = time.perf_counter_ns()
    for _ in range(repetitions):
        tick()
    return (time.perf_counter_ns() - began) / repetitions / nodes


def compare(shape: str, xml: str, rounds: int, wheel: Wheel) -> dict[str, Any]:
    """Medians (ns for a node and tick) and medians of ratios of one shape."""
    ours = our_tree(xml, registry())
    nodes = len(ours.nodes)
    factory, theirs = wheel.tree(xml)
    engines: dict[str, Tick] = {
        'flexbt': ours.tick_exactly_once,
        'btcpp': theirs.tick_exactly_once,
    }
    slow = py_trees_tick(shape, nodes)
    if slow is not None:
        engines['py_trees'] = slow
    samples: dict[str, list[float]] = {name: [] for name in engines}
    gc.collect()
    for tick in engines.values():
        tick()
    for _ in range(rounds):
        for name, tick in engines.items():
            repetitions = NODES_PER_SAMPLE // nodes
            samples[name].append(sample(tick, nodes, max(1, repetitions if name != 'py_trees' else repetitions // 40)))
    del theirs, factory
    row: dict[str, Any] = {'shape': shape, 'nodes': nodes}
    row |= {name: statistics.median(values) for name, values in samples.items()}
    row['ratio'] = median_ratio(samples['flexbt'], samples['btcpp'])
    if slow is not None:
        row['times faster than py_trees'] = 1 / median_ratio(samples['flexbt'], samples['py_trees'])
    return row


def median_ratio(ours: Sequence[float], theirs: Sequence[float]) -> float:
    return statistics.median(one / other for one, other in zip(ours, theirs, strict=True))


def loading(count: int, rounds: int, wheel: Wheel) -> dict[str, Any]:
    """Seconds to load a file of so many nodes, and bytes of a node of a running tree."""
    pieces = '<Inverter name="n"><Repeat num_cycles="5"><AlwaysFailure/></Repeat></Inverter>' * 3 + '<AlwaysSuccess/>'
    groups = ''.join(f'<Sequence name="group {number}">{pieces}</Sequence>' for number in range(count // 11))
    xml = document(f'<Fallback>{groups}</Fallback>')
    nodes = registry()

    def first() -> TreeDocument:
        return load_xml(xml, 'bench.xml', nodes)

    def btcpp() -> object:
        return wheel.tree(xml)

    loads: dict[str, list[float]] = {'flexbt': [], 'btcpp': [], 'again': []}
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory, 'bench.xml')
        file.write_text(xml)
        # What the BT server asks to load files, with its default limits.
        store = TreeStore(nodes, [Path(directory)], max_file_size=10_000_000, max_depth=256)
        assert store.load([str(file)])[0].code == BtLoadReport.LOADED

        def again() -> object:
            (report,) = store.load([str(file)])
            assert report.code == BtLoadReport.UNCHANGED
            return report

        for _ in range(rounds):
            for name, load in (('flexbt', first), ('btcpp', btcpp), ('again', again)):
                gc.collect()
                began = time.perf_counter()
                kept = load()
                loads[name].append(time.perf_counter() - began)
                del kept
    library = TreeLibrary().stage([first()])
    builds = []
    for _ in range(rounds):
        gc.collect()
        began = time.perf_counter()
        tree = Tree(library, 'T0')
        builds.append(time.perf_counter() - began)
    del tree
    gc.collect()
    tracemalloc.start()
    tree = Tree(library, 'T0')
    of_node = tracemalloc.get_traced_memory()[0] / len(tree.nodes)
    tracemalloc.stop()
    return {
        'nodes': len(tree.nodes),
        'first load, s': statistics.median(loads['flexbt']),
        'again, unchanged, s': statistics.median(loads['again']),
        'to make a tree of it, s': statistics.median(builds),
        'btcpp load and build, s': statistics.median(loads['btcpp']),
        'bytes of a node': of_node,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=15)
    parser.add_argument('--sizes', default='100,1000,10000')
    parser.add_argument('--shapes', default=','.join(SHAPES), help='of the first table')
    parser.add_argument('--others', default=','.join(OTHERS), help='of the second table')
    parser.add_argument('--output', type=Path, default=Path('out/bt_tick.json'))
    arguments = parser.parse_args()
    wheel = Wheel()
    print(f'{"ns for a node and tick":36}{"nodes":>7}{"FlexBT":>9}{"BT.CPP":>9}{"py_trees":>10}{"ratio":>8}{"x":>7}')
    sizes = [int(size) for size in arguments.sizes.split(',')]
    rows = []
    for shape in filter(None, arguments.shapes.split(',')):
        for count in sizes:
            row = compare(shape, SHAPES[shape][1](count), arguments.rounds, wheel)
            rows.append(row)
            slow = f'{row["py_trees"]:10.0f}' if 'py_trees' in row else f'{"":10}'
            times = f'{row["times faster than py_trees"]:7.0f}' if 'py_trees' in row else ''
            print(
                f'({shape}) {SHAPES[shape][0]:32}{row["nodes"]:7}{row["flexbt"]:9.1f}{row["btcpp"]:9.1f}'
                f'{slow}{row["ratio"]:8.2f}{times}',
                flush=True,
            )
    print(
        f'targets: ratio to BT.CPP at most {TARGET_NATIVE} for native leaves, {TARGET_PYTHON} for those in Python (f); '
        f'{TARGET_PY_TREES:.0f} times faster than py_trees'
    )
    others = []
    print(f'{"other nodes, ns for a node and tick":36}{"nodes":>7}{"FlexBT":>9}{"BT.CPP":>9}{"ratio":>18}')
    for name in filter(None, arguments.others.split(',')):
        what, make = OTHERS[name]
        row = compare(name, make(OTHER_NODES), arguments.rounds, wheel)
        others.append(row | {'what': what})
        print(
            f'{what:36}{row["nodes"]:7}{row["flexbt"]:9.1f}{row["btcpp"]:9.1f}{row["ratio"]:18.2f}',
            flush=True,
        )
    loaded = loading(10_000, arguments.rounds, wheel)
    for what, value in loaded.items():
        print(f'{what:36}{value:12.4g}')
    write_figures(arguments.output, {'tick': rows, 'other nodes': others, 'loading': loaded})
    return 0


if __name__ == '__main__':
    sys.exit(main())
