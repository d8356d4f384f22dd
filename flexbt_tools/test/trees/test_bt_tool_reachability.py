# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` says of children that are never ticked, or never done in time, against what the engine does."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.outcomes import Exchanged
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.skills.library import SkillLibrary
from flexbt_testing.behavior_trees.steps import LETTERS
from flexbt_tools.tree_checks.reachability import never_ticked, short_limits

TICKS = 8


class Free(StatefulAction):
    """Gives what ``services`` says, call by call, and after that succeeds; a leaf of which nothing is known."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.script: Iterator[str] = iter(self.services.get(config.name, ''))

    def on_start(self) -> NodeStatus:
        return LETTERS[next(self.script, 'S')]

    on_running = on_start

    def on_halted(self) -> None:
        pass


class Succeed(Decorator):
    """A decorator of one's own, which declares its rule."""

    outcomes = Exchanged(failure=NodeStatus.SUCCESS)

    def tick(self) -> NodeStatus:
        status = self.tick_child()
        return NodeStatus.SUCCESS if status is NodeStatus.FAILURE else status


class Fail(Succeed):
    """Derived, and does something else."""

    def tick(self) -> NodeStatus:
        self.tick_child()
        return NodeStatus.FAILURE


REGISTRY = builtin_registry()
register_nav2(REGISTRY)
REGISTRY.register_classes((Free, Succeed, Fail))


def library_of(body: str) -> TreeLibrary:
    text = f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    return TreeLibrary([load_xml(text, 'file', REGISTRY)])


def said(library: TreeLibrary) -> set[int]:
    """Columns of the children that are said never to be ticked."""
    return {child.offset for row in never_ticked(library) for child in row.parent.children[row.first : row.end]}


def ticked(library: TreeLibrary, scripts: dict[str, str]) -> set[int]:
    """Columns of the nodes that change their status in a run."""
    return run(library, scripts)[0]


def run(library: TreeLibrary, scripts: dict[str, str]) -> tuple[set[int], set[int]]:
    """Columns of the nodes that change their status in a run, and of those that succeed."""
    seen: set[int] = set()
    succeeded: set[int] = set()
    tree: Tree

    def note(node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        offset = tree.definitions[tree.nodes.index(node)].offset
        seen.add(offset)
        if after is NodeStatus.SUCCESS:
            succeeded.add(offset)

    clock = ManualClock()
    tree = Tree(library, 'Main', clock=clock, services=scripts, max_rounds=20)
    tree.observe(note)
    try:
        for _ in range(TICKS):
            tree.tick_once()
            clock.advance(1.0)
    except NodeExecutionError:
        pass  # a condition that was skipped, or a wrong number of children
    return seen, succeeded


LEAVES = ['<AlwaysSuccess/>', '<AlwaysFailure/>', '<Sleep msec="1500"/>', '<Free name="a"/>', '<Free name="b"/>']
CONTROLS = [
    *('Sequence', 'ReactiveSequence', 'AsyncSequence', 'SequenceWithMemory'),
    *('Fallback', 'ReactiveFallback', 'AsyncFallback'),
    *('IfThenElse', 'WhileDoElse'),
]
DECORATORS = [
    *('Inverter', 'ForceSuccess', 'ForceFailure', 'KeepRunningUntilFailure', 'RunOnce'),
    *('Repeat num_cycles="-1"', 'Repeat num_cycles="2"'),
    *('RetryUntilSuccessful num_attempts="-1"', 'RetryUntilSuccessful num_attempts="2"'),
    *('Delay delay_msec="1000"', 'Timeout msec="2500"'),
]
CONDITIONS = ['', '', '', ' _skipIf="false"', ' _failureIf="1 == 1"', ' _successIf="true"', ' _while="0"']


def inner(children: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    def control(tag: str, condition: str, bodies: list[str]) -> str:
        return f'<{tag}{condition}>{"".join(bodies)}</{tag}>'

    def decorator(head: str, condition: str, body: str) -> str:
        return f'<{head}{condition}>{body}</{head.split()[0]}>'

    controls = st.sampled_from([*CONTROLS, 'Parallel', 'TryCatch'])
    conditions = st.sampled_from(CONDITIONS)
    rows = st.lists(children, min_size=2, max_size=3)
    return st.builds(control, controls, conditions, rows) | st.builds(
        decorator, st.sampled_from(DECORATORS), conditions, children
    )


TREES = st.recursive(st.sampled_from(LEAVES), inner, max_leaves=12)


@settings(max_examples=300, deadline=None)
@given(TREES, st.dictionaries(st.sampled_from('ab'), st.text('SFRK', max_size=6)))
def test_what_is_said_never_to_be_ticked_or_done_is_not(body: str, scripts: dict[str, str]) -> None:
    try:
        library = library_of(body)
    except TreeLoadError:  # two asynchronous sequences below a reactive one
        reject()
    seen, succeeded = run(library, scripts)
    assert not said(library) & seen
    if 'K' not in ''.join(scripts.values()):  # of a leaf of which nothing is known it is taken that it is not skipped
        for one in short_limits(library, SkillLibrary()):
            never = succeeded if 'never succeed' in one.place.message else seen
            assert one.place.column - 1 not in never, one.place.message


RECOVERIES = [f'RecoveryNode number_of_retries="{count}"' for count in (-1, 0, 1)]


@pytest.mark.parametrize('head', [*CONTROLS, *RECOVERIES])
def test_all_that_is_never_ticked_is_said(head: str) -> None:
    """For all rows of two and three leaves of which nothing, or the result, is known: with all that those may give."""
    leaves = ('<AlwaysSuccess/>', '<AlwaysFailure/>', '<Free name="{}"/>')
    lengths = (2,) if head in RECOVERIES else (2, 3)
    for row in itertools.chain.from_iterable(itertools.product(leaves, repeat=length) for length in lengths):
        library = library_of(f'<{head}>{"".join(row)}</{head.split()[0]}>'.format(*range(3)))
        free = [str(number) for number in range(''.join(row).count('Free'))]
        reached: set[int] = set()
        for letters in itertools.product('SFRK', repeat=len(free)):
            reached |= ticked(library, dict(zip(free, letters, strict=True)))
        [key] = library.tree_keys()
        children = {child.offset for child in library.definition(key).root.children}
        assert children - reached == said(library), row


@pytest.mark.parametrize('decorator', DECORATORS)
def test_what_a_decorator_can_give_decides_what_follows(decorator: str) -> None:
    """In a sequence and in a fallback, around each leaf."""
    tag = decorator.split()[0]
    # Times are not compared with each other.
    leaves = [leaf for leaf in LEAVES[:4] if 'Sleep' not in leaf or tag != 'Timeout']
    for control, leaf in itertools.product(('Sequence', 'Fallback'), leaves):
        library = library_of(f'<{control}><{decorator}>{leaf}</{tag}><AlwaysSuccess/></{control}>')
        reached: set[int] = set()
        for script in ('S', 'F', 'R', 'K', 'RS', 'RF', 'FS', 'FFFFF', 'RRRRRRRRRR'):
            reached |= ticked(library, {'a': script})
        last = library.definition(next(library.tree_keys())).root.children[1].offset
        assert (last in reached) == (last not in said(library)), leaf


@pytest.mark.parametrize('first', LEAVES[:2])
@pytest.mark.parametrize('tag', CONTROLS)
def test_what_runs_between_two_children_may_be_out_of_time(tag: str, first: str) -> None:
    """A control that yields is RUNNING after a child that passes, and so the time can be up at the next tick."""
    inner = f'<{tag}>{first}<AlwaysSuccess/></{tag}>'
    library = library_of(f'<Fallback><Timeout msec="1">{inner}</Timeout><AlwaysFailure/></Fallback>')
    clock = ManualClock()
    tree = Tree(library, 'Main', clock=clock)
    tree.tick_exactly_once()
    clock.advance(1.0)
    failed = tree.tick_exactly_once() is NodeStatus.FAILURE
    assert not failed or tree.definitions[-1].offset not in said(library)


@pytest.mark.parametrize(('tag', 'known'), [('Succeed', True), ('Fail', False)])
def test_the_rule_of_a_class_holds_for_that_class_alone(tag: str, known: bool) -> None:
    library = library_of(f'<Fallback><{tag}><AlwaysFailure/></{tag}><AlwaysSuccess/></Fallback>')
    assert bool(said(library)) is known
