# SPDX-License-Identifier: BSD-3-Clause
"""Other nodes in the place of some, by their paths."""

from __future__ import annotations

from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeLibrary
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml

XML = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence><SubTree ID="Arm" name="left" to="{a}"/><SubTree ID="Arm" name="right" to="{b}"/></Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Arm"><Sequence name="move"><Script code="to := 1"/><Sleep name="wait" msec="5000"/></Sequence></BehaviorTree>
</root>
"""  # noqa: E501


def test_nodes_are_exchanged_by_their_paths() -> None:
    registry = builtin_registry()
    library = TreeLibrary([load_xml(XML, 'file', registry)])
    success = registry.get('AlwaysSuccess')
    assert success is not None
    seen = []

    def substitute(definition: NodeDefinition, path: str) -> NodeDefinition:
        seen.append(path)
        leaf = definition._replace(manifest=success, tree_id=None, children=(), values={})
        return leaf if path in ('left/wait', 'right') else definition

    tree = Tree(library, 'Main', substitute=substitute)
    # What is below a node that was exchanged is not made; all others have the path that was asked for.
    assert seen == ['Sequence::1', 'left', 'left/move', 'left/Script::4', 'left/wait', 'right']
    assert [node.path for node in tree.nodes] == seen
    assert [sub_tree.path for sub_tree in tree.subtrees] == ['', 'left']
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert (tree.blackboard.get('a'), tree.blackboard.get_or('b', None)) == (1, None)
    assert Tree(library, 'Main').tick_once() is NodeStatus.RUNNING
