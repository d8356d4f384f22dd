# SPDX-License-Identifier: BSD-3-Clause
"""The controls that decide: branches, Switch, reactive ones, TryCatch, ParallelAll. Rules of BehaviorTree.CPP 4.10."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.controls import RecoveryNode
from flexbt_core.behavior_tree.script.values import SAME_NUMBER
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.waiting import WakeEvent
from flexbt_testing.behavior_trees.steps import NAMES, check, control, first_failure, make, step

SWITCH = {'variable': '{x}', 'case_1': 'a', 'case_2': '2'}

# Tree, and what happens to it (the notation of flexbt_testing.behavior_trees.steps).
VECTORS: dict[str, list[tuple[str, str]]] = {
    'IfThenElse': [
        (control('IfThenElse', 'S', 'S', 'F'), 'S 0S 1S'),
        (control('IfThenElse', 'F', 'F', 'S'), 'S 0F 2S'),
        (control('IfThenElse', 'S', 'F', 'S'), 'F 0S 1F'),
        (control('IfThenElse', 'F', 'S', 'F'), 'F 0F 2F'),
        # The condition is asked once, and again only in the next run.
        (control('IfThenElse', 'RSF', 'RRS', 'S'), 'R 0R | R 0S 1R | R 1R | S 1S | S 0F 2S'),
        (control('IfThenElse', 'SF', 'RK'), 'R 0S 1R | K 1K 1!'),
        # Halted: in the condition, in a branch.
        (control('IfThenElse', 'R', 'S'), 'R 0R | halt 0! | R 0R'),
        (control('IfThenElse', 'SF', 'R', 'S'), 'R 0S 1R | halt 1! | S 0F 2S'),
        # Two children and a condition that fails: a stateful one keeps its FAILURE until something resets it.
        (control('IfThenElse', 'FS', 'S'), 'F 0F | F | halt | S 0S 1S'),
        (control('IfThenElse', 'K', 'S'), 'error 0K | halt | error 0K'),
        (control('IfThenElse', 'S'), 'error'),
        (control('IfThenElse', 'S', 'S', 'S', 'S'), 'error'),
        # The wrong number of children is no error in a branch that is not reached.
        (f'<Fallback>{step("S")}{control("IfThenElse", "S")}</Fallback>', 'S 0S'),
    ],
    'WhileDoElse': [
        (control('WhileDoElse', 'S', 'S', 'F'), 'S 0S 1S'),
        (control('WhileDoElse', 'F', 'F', 'S'), 'S 0F 2S'),
        (control('WhileDoElse', 'F', 'S'), 'F 0F | F 0F'),
        (control('WhileDoElse', 'S', 'F', 'S'), 'F 0S 1F'),
        (control('WhileDoElse', 'F', 'S', 'F'), 'F 0F 2F'),
        # A stateful condition keeps its result while the branch runs; the decorator around it is asked every time.
        (control('WhileDoElse', 'SF', 'RS'), 'R 0S 1R | S 1S | F 0F'),
        (f'<WhileDoElse><Inverter>{step("FFSF")}</Inverter>{step("R", 1)}{step("RS", 2)}</WhileDoElse>',
         'R 0F 1R | R 0F 1R | R 0S 1! 2R | R 0F 2! 1R | halt 1!'),
        # The condition is RUNNING: the branch is left as it is.
        (f'<WhileDoElse><Inverter>{step("FRF")}</Inverter>{step("RS", 1)}</WhileDoElse>', 'R 0F 1R | R 0R | S 0F 1S'),
        (f'<WhileDoElse><Inverter>{step("FS")}</Inverter>{step("R", 1)}</WhileDoElse>', 'R 0F 1R | F 0S 1!'),
        (f'<WhileDoElse><Inverter>{step("FK")}</Inverter>{step("R", 1)}</WhileDoElse>', 'R 0F 1R | error 0K 1!'),
        (control('WhileDoElse', 'S', 'K'), 'K 0S 1K | K 0S 1K'),
        (control('WhileDoElse', 'S'), 'error'),
        (control('WhileDoElse', 'S', 'S', 'S', 'S'), 'error'),
    ],
    'Switch': [
        (control('Switch2', 'S', 'S', 'S', **SWITCH), "S 2S | x=a S 0S | x='2.0' S 1S | x=c S 2S | -x S 2S"),
        (control('Switch3', 'S', 'F', 'S', 'S', variable='b', case_1='a', case_2='b', case_3='b'), 'F 1F'),
        # The whole text is a number, or it is none.
        (control('Switch2', 'S', 'S', 'S', **SWITCH), "x='2' S 1S | x='2.00' S 1S | x='2x' S 2S | x='02' S 1S"),
        (control('Switch2', 'S', 'S', 'S', **SWITCH), "x='1.9999999' S 1S | x='1.999' S 2S | x='2e0' S 1S"),
        (control('Switch2', 'S', 'S', 'S', **SWITCH), f"x='{2.0 + SAME_NUMBER!r}' S 1S"),
        (control('Switch2', 'S', 'S', 'S', variable='nan', case_1='inf', case_2='nan'), 'S 1S'),
        # It is reactive: another value halts what runs.
        (control('Switch2', 'R', 'RS', 'R', **SWITCH), "x=a R 0R | x='2' R 0! 1R | S 1S | x=z R 2R | halt 2! | R 2R"),
        (control('Switch2', 'RK', 'R', 'S', **SWITCH), "x=a R 0R | K 0K | x='2' R 1R | halt 0! 1!"),
        (control('Switch2', 'S', 'S', 'S', variable='{x}', case_1='{y}', case_2='{z}'),
         'x=a S 2S | y=a S 0S | y=b S 2S | z=a S 1S | x=b S 0S'),
        (control('Switch2', 'S', 'S', 'S', case_1=''), 'S 2S'),
        (control('Switch2', 'S', 'S', 'S', variable='', case_1=''), 'S 0S'),
        (control('Switch2', 'S', 'S', 'S', variable='a', case_2='a'), 'S 1S'),
        (control('Switch2', 'S', 'S', **SWITCH), 'error'),
        (control('Switch6', *'SSSSSSF', variable='f', **{f'case_{n}': c for n, c in enumerate('abcdef', 1)}), 'S 5S'),
    ],
    'Reactive': [
        # A skipped child is halted before the next one is ticked, and a RUNNING one halts all others.
        (control('ReactiveSequence', 'RK', 'S'), 'R 0R | S 0K 0! 1S'),
        (control('ReactiveSequence', 'SRS', 'RR', 'S'), 'R 0S 1R | R 0R 1! | R 0S 1R | halt 1!'),
        (control('ReactiveFallback', 'RK', 'F'), 'R 0R | F 0K 0! 1F'),
        (control('ReactiveFallback', 'K', 'K'), 'K 0K 1K'),
    ],
    'TryCatch': [
        (control('TryCatch', 'S', 'S', 'S'), 'S 0S 1S | S 0S 1S'),
        (control('TryCatch', 'F', 'S', 'S'), 'F 0F 2S | F 0F 2S'),
        (control('TryCatch', 'S', 'F', 'F'), 'F 0S 1F 2F'),
        (control('TryCatch', 'S', 'S', 'F', 'S', 'K'), 'F 0S 1S 2F 4K'),
        (control('TryCatch', 'SF', 'RSF', 'RS'), 'R 0S 1R | S 1S | R 0F 2R | F 2S'),
        (control('TryCatch', 'F', 'RRS'), 'R 0F 1R | R 1R | F 1S'),
        (control('TryCatch', 'K', 'K', 'S'), 'K 0K 1K'),
        # Nobody has reset it.
        (
            f'<IfThenElse><TryCatch>{step("F")}{step("S", 1)}</TryCatch>{step("S", 2)}</IfThenElse>',
            'F 0F 1S | F 0F 1S',
        ),
        (control('TryCatch', 'K', 'S', 'S'), 'S 0K 1S'),
        (f'<Sequence>{control("TryCatch", "F", "RS")}{step("S", 2)}</Sequence>', 'R 0F 1R | F 1S'),
        # A halt ticks the clean-up only when asked to, and not when it is at work already; once, if it would go on.
        (control('TryCatch', 'R', 'S'), 'R 0R | halt 0!'),
        (control('TryCatch', 'R', 'S', catch_on_halt='true'), 'R 0R | halt 0! 1S | R 0R | halt 0! 1S'),
        (control('TryCatch', 'S', 'R', 'R', catch_on_halt='true'), 'R 0S 1R | halt 1! 2R 2! | R 0S 1R'),
        (control('TryCatch', 'F', 'R', catch_on_halt='true'), 'R 0F 1R | halt 1! | R 0F 1R'),
        (control('TryCatch', 'S', 'S', catch_on_halt='true'), 'S 0S | halt'),
        (control('TryCatch', 'R', 'S', catch_on_halt='{x}'), "R 0R | halt 0! | x='true' R 0R | halt 0! 1S"),
        (f'<ReactiveFallback><Inverter>{step("SSFS")}</Inverter>{control("TryCatch", "R", "S").replace("_0", "_1")}'
         '</ReactiveFallback>', 'R 0S 1R | R 0S 1R | S 0F 1!'),
    ],
    'ParallelAll': [
        (control('ParallelAll', 'S', 'S'), 'S 0S 1S'),
        # The first failure decides, but all others complete first.
        (control('ParallelAll', 'F', 'RS', 'S'), 'R 0F 1R 2S | F 1S'),
        (control('ParallelAll', 'F', 'S', 'F', max_failures='3'), 'S 0F 1S 2F'),
        (control('ParallelAll', 'F', 'F', max_failures='-1'), 'F 0F 1F'),
        (control('ParallelAll', 'F', 'S', max_failures='-1'), 'S 0F 1S'),
        (control('ParallelAll', 'S', max_failures='0'), 'F 0S'),
        (control('ParallelAll', 'S', max_failures='2'), 'error'),
        (control('ParallelAll', 'K', 'K'), 'K 0K 1K'),
        # A skipped child is ticked again as long as another runs.
        (control('ParallelAll', 'KS', 'RS'), 'R 0K 1R | S 0S 1S'),
        (control('ParallelAll', 'F', 'K', 'RRS', max_failures='2'), 'R 0F 1K 2R | R 1K 2R | S 1K 2S'),
        (control('ParallelAll', 'FS', 'RRS'), 'R 0F 1R | halt 1! | R 0S 1R'),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ('body', 'expected'),
    [pytest.param(*row, id=f'{tag} {number}') for tag, rows in VECTORS.items() for number, row in enumerate(rows)],
)
def test_tick_by_tick(body: str, expected: str) -> None:
    check(body, expected)


def test_the_name_of_an_enum_constant_is_its_number() -> None:
    switch = control('Switch3', 'S', 'S', 'S', 'S', variable='{x}', case_1='RED', case_2='GREEN', case_3='3')
    tree, calls = make(f'<Sequence><Script code="x := y"/>{switch}</Sequence>', enums={'RED': 1, 'GREEN': 2, 'BLUE': 3})
    for value, chosen in ((2, '1S'), (1.0, '0S'), ('RED', '0S'), ('2', '1S'), ('BLUE', '2S'), ('X', '3S'), (4, '3S')):
        tree.blackboard.unset('x')
        tree.blackboard.unset('y')
        tree.blackboard.set('y', value)
        calls.clear()
        assert tree.tick_once() is NodeStatus.SUCCESS
        assert calls == [chosen], value
    tree, calls = make(f'<Sequence><Script code="x := GREEN"/>{switch}</Sequence>', enums={'RED': 1, 'GREEN': 2})
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert calls == ['1S']


def test_a_case_that_is_no_text_and_a_number_that_no_double_holds_are_passed_over() -> None:
    tree, calls = make(control('Switch2', 'S', 'S', 'S', variable='1e999', case_1='{y}', case_2='2e999'))
    tree.blackboard.unset('y')
    tree.blackboard.set('y', [1])
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert calls == ['2S']


# -- why a node failed -------------------------------------------------------------------------------------------------

CAUSES = [
    (control('IfThenElse', 'F', 'S'), 'F_0'),
    (control('IfThenElse', 'F', 'S', 'RF'), 'RF_2'),
    (control('WhileDoElse', 'F', 'S'), 'F_0'),
    (control('WhileDoElse', 'S', 'F'), 'F_1'),
    (control('Switch2', 'S', 'RF', 'S', variable='2', case_1='a', case_2='2'), 'RF_1'),
    (control('Switch2', 'S', 'S', 'F'), 'F_2'),
    # What was tried is to blame, not the clean-up, whatever that gives.
    (control('TryCatch', 'S', 'F', 'RS'), 'F_1'),
    (control('TryCatch', 'S', 'F', 'RF'), 'F_1'),
    (control('ParallelAll', 'S', 'F', 'S'), 'F_1'),
    (control('Parallel', 'S', 'F', 'S'), 'F_1'),
]


@pytest.mark.parametrize(('body', 'path'), CAUSES)
def test_the_failure_names_the_child_that_decided(body: str, path: str) -> None:
    responsible, reason, chain = first_failure(
        f'<Sequence name="root"><Delay name="d" delay_msec="0">{body}</Delay></Sequence>'
    )
    assert (responsible, reason) == (path, 'Step returned FAILURE')
    assert chain == ['root', 'd', 'top', path]


def test_no_child_is_to_blame_for_a_threshold_that_no_result_could_meet() -> None:
    body = control('ParallelAll', 'FS', 'S', max_failures='{x}')
    tree, _ = make(body)
    tree.blackboard.set('x', 1)
    assert tree.tick_once() is NodeStatus.FAILURE
    tree.blackboard.set('x', 0)
    assert tree.tick_once() is NodeStatus.FAILURE
    assert tree.failure is not None
    assert tree.failure.path == 'top'
    assert 'max_failures="{x}"' in tree.failure.reason


def test_the_message_of_a_wrong_tree_says_which_node_and_what_it_needs() -> None:
    tree, _ = make(control('Switch3', 'S', 'S'))
    with pytest.raises(NodeExecutionError, match=r'\[top\] \(Switch3\): Switch3 has 4 children, not 2'):
        tree.tick_once()
    tree, _ = make(control('IfThenElse', 'S'))
    with pytest.raises(NodeExecutionError, match='IfThenElse has 2 to 3 children, not 1'):
        tree.tick_once()
    tree, _ = make(control('IfThenElse', 'K', 'S'))
    with pytest.raises(NodeExecutionError, match=r'the condition \[K_0\] was skipped'):
        tree.tick_once()
    with pytest.raises(TreeLoadError, match='TryCatch] has 2 children or more, not 1'):
        make(control('TryCatch', 'S'))


# -- errors while halting ----------------------------------------------------------------------------------------------


def running(body: str, registry: NodeRegistry) -> Tree:
    """Return a tree after its first tick, which leaves it running."""
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'Main')
    assert tree.tick_once() is NodeStatus.RUNNING
    return tree


class Broken(SyncAction):
    """Raises."""

    def tick(self) -> NodeStatus:
        raise ValueError('the clean-up is broken')


def test_a_clean_up_that_raises_while_the_tree_is_halted_is_named_and_halts_the_rest_all_the_same() -> None:
    registry = builtin_registry()
    registry.register('Broken', Broken)
    body = (
        '<Parallel><TryCatch catch_on_halt="true"><Sleep msec="1000" name="one"/><Broken name="bad"/></TryCatch>'
        '<Sleep msec="1000" name="two"/></Parallel>'
    )
    tree = running(body, registry)
    with pytest.raises(NodeExecutionError, match='the clean-up is broken') as caught:
        tree.halt()
    assert caught.value.node_path == 'bad'
    assert all(node.status is NodeStatus.IDLE for node in tree.nodes)
    assert tree.next_wake is None


class Asks(SyncAction):
    """Waits within its tick for an answer, which is there."""

    def tick(self) -> NodeStatus:
        answered = WakeEvent()
        answered.set()
        self.wait_in_tick(answered, self.clock, self.clock.now())
        self.blackboard.set('cleaned', True)
        return NodeStatus.SUCCESS


def test_a_clean_up_may_wait_and_recover_also_while_the_host_stops_the_tree() -> None:
    registry = builtin_registry()
    registry.register_classes((Asks, RecoveryNode))
    body = (
        '<TryCatch catch_on_halt="true"><Sleep msec="1000"/>'
        '<RecoveryNode number_of_retries="1"><Asks/><AlwaysSuccess/></RecoveryNode></TryCatch>'
    )
    tree = running(body, registry)
    tree.callbacks.release()
    tree.halt()
    assert tree.blackboard.get('cleaned') is True
    assert not tree.callbacks.released


# -- TryCatch is what it can be composed of ----------------------------------------------------------------------------

scripts = st.text('SFR', min_size=1, max_size=4)


@settings(max_examples=150, deadline=None)
@given(tries=st.lists(scripts, min_size=1, max_size=3), clean_up=scripts, ops=st.text('tttth', max_size=12))
def test_try_catch_is_a_fallback_of_a_sequence_and_a_forced_failure(tries: list[str], clean_up: str, ops: str) -> None:
    last = step(clean_up, len(tries))
    attempts = ''.join(step(script, number) for number, script in enumerate(tries))
    one, calls = make(f'<TryCatch>{attempts}{last}</TryCatch>')
    other, other_calls = make(
        f'<Fallback><Sequence>{attempts}</Sequence><ForceFailure>{last}</ForceFailure></Fallback>'
    )
    for op in ops:
        if op == 'h':
            one.halt()
            other.halt()
        else:
            assert NAMES[one.tick_once()] == NAMES[other.tick_once()]
        assert calls == other_calls


@pytest.mark.parametrize(
    ('tag', 'port', 'never'),
    [
        ('Parallel', 'success_count', 'it can never succeed'),
        ('Parallel', 'failure_count', 'it can never fail'),
        ('ParallelAll', 'max_failures', 'it can never fail'),
    ],
)
def test_a_threshold_above_the_number_of_children_is_an_error(tag: str, port: str, never: str) -> None:
    tree, _ = make(control(tag, 'S', 'S', **{port: '3'}))
    with pytest.raises(NodeExecutionError, match=f'{port} 3 is more than its 2 children: {never}$'):
        tree.tick_once()


class RaisesOnce(SyncAction):
    """A leaf that raises at its first tick, and succeeds from then on."""

    has_raised = False

    def tick(self) -> NodeStatus:
        if not self.has_raised:
            self.has_raised = True
            raise RuntimeError('once')
        return NodeStatus.SUCCESS


@pytest.mark.parametrize('success_count', ['2', '-1'])
def test_successes_before_an_exception_count_afterwards_and_skipped_children_do_not(success_count: str) -> None:
    body = (
        f'<Parallel success_count="{success_count}" failure_count="3">{step("S")}{step("K", 1)}<RaisesOnce/></Parallel>'
    )
    tree, calls = make(body, extra=[RaisesOnce])
    with pytest.raises(NodeExecutionError):
        tree.tick_once()
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert calls.count('0S') == 1
