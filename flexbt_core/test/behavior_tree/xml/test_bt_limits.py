# SPDX-License-Identifier: BSD-3-Clause
"""What a tree can take of memory and time: texts, scripts and rounds are bounded, and a stop is heard within a tick."""

from __future__ import annotations

import pytest

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, ScriptError, TickAbandoned, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.behavior_tree.script.parser import MAX_TOKENS
from flexbt_core.behavior_tree.script.values import MAX_TEXT, MAX_TEXTS
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_testing.behavior_trees.steps import make


class Stop(SyncAction):
    """The host wants to stop the tree while this is ticked for the fifth time."""

    ports = {}

    def tick(self) -> NodeStatus:
        count = self.blackboard.get_or('count', 0) + 1
        self.blackboard.set('count', count)
        if count == 5:
            self.context.stopping = True
        return NodeStatus.SUCCESS


@pytest.mark.parametrize('joining', ['s := s .. s', 's = s + s', 's += s', "t := 1 .. s .. 'x' .. s; s = t"])
def test_a_text_that_is_doubled_again_and_again_is_refused(joining: str) -> None:
    tree = make(f'<Repeat num_cycles="-1"><Script name="double" code="{joining}"/></Repeat>')[0]
    tree.blackboard.set('s', 'x')
    with pytest.raises(NodeExecutionError, match=f'would make a text of .* at most {MAX_TEXT} are made'):
        tree.tick_once()
    assert MAX_TEXT // 4 < len(tree.blackboard.get('s')) <= MAX_TEXT


def test_many_large_texts_are_refused() -> None:
    board = Blackboard()
    board.set('s', 'x' * (MAX_TEXT - 10))
    library = ScriptLibrary()
    same = library.script('; '.join(f'same{number} := s' for number in range(1000)))
    same.evaluate(same.scope(board))  # one text, however many have it
    count = MAX_TEXTS // MAX_TEXT + 2
    others = library.script('; '.join(f"k{number} := s .. '{number}'" for number in range(count)))
    with pytest.raises(ScriptError, match=f'no more than {MAX_TEXTS}'):
        others.evaluate(others.scope(board))
    board.unset('k0')
    board.unset('k1')
    again = library.script("k0 := s .. '0'")
    again.evaluate(again.scope(board))


def test_a_script_is_bounded() -> None:
    library = ScriptLibrary()
    library.script(';'.join(['a:=1'] * (MAX_TOKENS // 4 - 1)))
    with pytest.raises(ScriptError, match=f'after {MAX_TOKENS} tokens'):
        library.script(';'.join(['a:=1'] * MAX_TOKENS))


@pytest.mark.parametrize(
    'xml',
    [
        '<Repeat num_cycles="-1"><Stop/></Repeat>',
        '<RetryUntilSuccessful num_attempts="-1"><Inverter><Stop/></Inverter></RetryUntilSuccessful>',
        '<KeepRunningUntilFailure><Repeat num_cycles="9"><Stop/></Repeat></KeepRunningUntilFailure>',
    ],
)
def test_a_stop_is_heard_between_two_rounds_of_a_tick(xml: str) -> None:
    tree = make(xml, extra=[Stop])[0]
    assert tree.tick_once() is NodeStatus.RUNNING
    assert tree.blackboard.get('count') == 5
    tree.halt()
    assert not tree.callbacks.released
    assert tree.tick_exactly_once() is NodeStatus.RUNNING


def test_a_stop_is_heard_between_two_recoveries() -> None:
    recovery = '<RecoveryNode number_of_retries="1000000000"><AlwaysFailure/><Stop/></RecoveryNode>'
    tree = make(recovery, extra=[Stop])[0]
    with pytest.raises(TickAbandoned, match=r'RecoveryNode\): the tree is being stopped$') as caught:
        tree.tick_once()
    assert (caught.value.node_path, caught.value.uid) == (tree.root.path, tree.root.uid)
    assert tree.blackboard.get('count') == 5


def test_a_tree_may_have_as_many_nodes_as_the_limit_and_no_more() -> None:
    body = '<Sequence><AlwaysSuccess/><AlwaysSuccess/></Sequence>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    document = load_xml(text, 'f', builtin_registry())
    TreeLibrary([document], max_nodes=3)
    with pytest.raises(TreeLoadError) as caught:
        TreeLibrary([document], max_nodes=2)
    place = f'f:1:{text.index("<Sequence>") + 1}'
    assert str(caught.value) == f'{place}: <Sequence>: tree [Main] has 3 nodes with its sub-trees; the limit is 2'


@pytest.mark.parametrize('port', ['<input_port name="p{}"/>', '<input_port name="p{}" default="1"/>', ''])
def test_ports_of_sub_trees_are_bounded_too(port: str) -> None:
    """Few elements with many ports each, or many with few declared ones, are made for every instance."""
    ports = ''.join(port.format(number) for number in range(400))
    given = '' if port else ' '.join(f'p{number}=""' for number in range(400))
    many = '<Sequence>' + '<SubTree ID="Inner"/>' * 400 + '</Sequence>'
    text = (
        f'<root BTCPP_format="4"><TreeNodesModel><SubTree ID="Leaf">{ports}</SubTree></TreeNodesModel>'
        f'<BehaviorTree ID="Main">{many if given else many.replace("Inner", "Leaf")}</BehaviorTree>'
        f'<BehaviorTree ID="Inner"><SubTree ID="Leaf" {given}/></BehaviorTree>'
        '<BehaviorTree ID="Leaf"><AlwaysSuccess/></BehaviorTree></root>'
    )
    with pytest.raises(TreeLoadError) as caught:
        TreeLibrary([load_xml(text, 'f', builtin_registry())])
    errors = [error.message for error in caught.value.errors]
    assert errors[-1] == 'tree [Main] has 160000 ports of its sub-trees; the limit is 65535'
    assert len(errors) < 70_000
