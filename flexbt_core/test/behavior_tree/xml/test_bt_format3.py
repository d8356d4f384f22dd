# SPDX-License-Identifier: BSD-3-Clause
"""Files of format 3: each construct means what its counterpart of format 4 means."""

from __future__ import annotations

import pytest

from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import Source, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.format3 import is_format_3, make_format_4
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_core.behavior_tree.xml.reader import load_xml


def root(body: str, version: str = ' BTCPP_format="3"') -> Element:
    return parse(Source('old.xml', f'<root{version}><BehaviorTree ID="Main">{body}</BehaviorTree></root>'))


def text_of(element: Element) -> str:
    """Return the element as XML, with attributes in the order of their names."""
    attributes = ''.join(f' {name}="{value}"' for name, value in sorted(element.attributes.items()))
    return f'<{element.tag}{attributes}>{"".join(map(text_of, element.children))}</{element.tag}>'


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('<SequenceStar name="s"><A/></SequenceStar>', '<SequenceWithMemory name="s"><A/></SequenceWithMemory>'),
        ('<Control ID="SequenceStar"><A/></Control>', '<Control ID="SequenceWithMemory"><A/></Control>'),
        (
            '<RetryUntilSuccesful num_attempts="2"><A/></RetryUntilSuccesful>',
            '<RetryUntilSuccessful num_attempts="2"><A/></RetryUntilSuccessful>',
        ),
        (
            '<Parallel success_threshold="2" failure_threshold="{n}"><A/></Parallel>',
            '<Parallel success_count="2" failure_count="{n}"><A/></Parallel>',
        ),
        (
            '<Control ID="Parallel" threshold="{n}"><A/></Control>',
            '<Control ID="Parallel" success_count="{n}" failure_count="-1"><A/></Control>',
        ),
        ('<SubTree ID="T" a="x" b="{y}"/>', '<SubTree ID="T" a="{x}" b="{y}"/>'),
        ('<SubTree ID="T" name="n" __shared_blackboard="true"/>', '<SubTree ID="T" name="n" _autoremap="true"/>'),
        ('<SubTree ID="T"><remap internal="a" external="x"/></SubTree>', '<SubTree ID="T" a="{x}"/>'),
        ('<SubTreePlus ID="T" a="x" b="{y}" __autoremap="1"/>', '<SubTree ID="T" a="x" b="{y}" _autoremap="1"/>'),
        (
            '<BlackboardCheckInt value_A="{a}" value_B="42" return_on_mismatch="SUCCESS"><A/></BlackboardCheckInt>',
            '<Precondition if="a == 42" else="SUCCESS"><A/></Precondition>',
        ),
        (
            '<BlackboardCheckDouble value_A="{a}" value_B="+0.5"><A/></BlackboardCheckDouble>',
            '<Precondition else="FAILURE" if="a == 0.5"><A/></Precondition>',
        ),
        (
            '<Decorator ID="BlackboardCheckString" value_A="{a}" value_B="42"><A/></Decorator>',
            """<Decorator ID="Precondition" if="a == '42'" else="FAILURE"><A/></Decorator>""",
        ),
    ],
)
def test_what_each_construct_becomes(old: str, new: str) -> None:
    converted, expected = root(old), root(new)
    make_format_4(converted)
    assert text_of(converted) == text_of(expected)


def test_which_files_are_of_format_3() -> None:
    assert is_format_3(root('<A/>'))
    assert not is_format_3(root('<SequenceStar/>', ' BTCPP_format="4"'))
    assert not is_format_3(root('<A/>', ''))
    for sign in (
        '<SequenceStar/>',
        '<Action ID="SequenceStar"/>',
        '<SubTree ID="T" __shared_blackboard="true"/>',
        '<Parallel success_threshold="1"/>',
    ):
        assert is_format_3(root(sign, ''))


def test_a_file_runs() -> None:
    text = """<root main_tree_to_execute="Main">
      <BehaviorTree ID="Main">
        <SequenceStar>
          <SubTree ID="Write" target="result"/>
          <Parallel success_threshold="1"><AlwaysSuccess/><AlwaysFailure/></Parallel>
        </SequenceStar>
      </BehaviorTree>
      <BehaviorTree ID="Write"><SetBlackboard output_key="target" value="done"/></BehaviorTree>
    </root>"""
    board = Blackboard()
    tree = Tree(TreeLibrary([load_xml(text, 'old.xml', builtin_registry())]), 'Main', blackboard=board)
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert board.get('result') == 'done'


def test_a_check_of_an_entry_that_no_script_can_read_is_an_error() -> None:
    check = '<BlackboardCheckInt value_A="{goal-x}" value_B="0"><AlwaysSuccess/></BlackboardCheckInt>'
    text = f'<root BTCPP_format="3"><BehaviorTree ID="Main">{check}</BehaviorTree></root>'
    with pytest.raises(TreeLoadError, match=r'script of \[if\]'):
        load_xml(text, 'old.xml', builtin_registry())


def test_errors_have_the_places_of_the_file() -> None:
    body = '<Parallel\n success_threshold="many"><AlwaysSuccess/></Parallel>'
    text = f'<root BTCPP_format="3"><BehaviorTree ID="Main">\n{body}</BehaviorTree></root>'
    with pytest.raises(TreeLoadError) as raised:
        load_xml(text, 'old.xml', builtin_registry())
    (error,) = raised.value.errors
    assert (error.line, error.column) == (3, 2)
    assert 'success_count' in str(error)
