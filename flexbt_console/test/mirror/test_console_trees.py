# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees in the mirror: their nodes may become others while they run."""

from __future__ import annotations

from collections.abc import Sequence

from flexbt_console.mirror import (
    ActiveState,
    LinkState,
    NodeKind,
    NodeStatus,
    Snapshot,
    StatusChange,
    TreeNode,
    Trees,
    View,
)

RUNNING, SUCCESS = NodeStatus.RUNNING, NodeStatus.SUCCESS
TRUNK = [TreeNode(1, 0, 'Main', 'Sequence'), TreeNode(2, 1, 'reach', 'ReachGoal', kind=NodeKind.ACTION)]
FIRST = [*TRUNK, TreeNode(3, 2, 'look', 'IsAt')]
SECOND = [*TRUNK, TreeNode(3, 2, 'go', 'GoTo')]


def structure(trees: Trees, number: int, nodes: Sequence[TreeNode]) -> None:
    trees.receive_structure('run', 'Main', nodes, 0.0, number)


def status(trees: Trees, sequence: int, number: int, statuses: Sequence[NodeStatus], *changed: int) -> bool:
    changes = [StatusChange(float(sequence), uid, statuses[uid - 1]) for uid in changed]
    stamp = float(sequence)
    return trees.receive_status(
        'run', sequence, statuses, changes, stamp, finished=False, paused=False, structure=number
    )


def test_a_run_with_other_nodes_keeps_what_is_known_of_those_that_it_has_still() -> None:
    trees = Trees()
    structure(trees, 1, FIRST)
    assert status(trees, 1, 1, [RUNNING, RUNNING, SUCCESS], 1, 2, 3)
    structure(trees, 2, SECOND)
    (run,) = trees.runs()
    assert run.running_leaves == (2,)  # it searches
    assert (run.nodes, run.statuses) == (tuple(SECOND), (RUNNING, RUNNING, NodeStatus.IDLE))
    assert run.since[:2] == (1.0, 1.0) and run.last_end(3) is NodeStatus.IDLE
    assert not status(trees, 2, 1, [RUNNING, RUNNING, SUCCESS])  # of the nodes before
    assert status(trees, 3, 2, [RUNNING, RUNNING, RUNNING], 3)
    (run,) = trees.runs()
    assert run.running_leaves == (3,) and run.seconds(2) == 2.0
    structure(trees, 1, FIRST)  # late
    assert trees.runs()[0].nodes == tuple(SECOND)


def test_the_time_of_a_leaf_goes_on_while_nothing_changes_in_its_tree() -> None:
    trees = Trees()
    structure(trees, 1, FIRST)
    status(trees, 1, 1, [RUNNING, RUNNING, SUCCESS], 1, 2)
    state = ActiveState('/S', 0.0, tree_run_id=trees.runs()[0].run_id)
    for named in ((state,), ()):
        snapshot = Snapshot('e', 1, stamp=9.0, active_states=named)
        (run,) = View(LinkState.LIVE, 0.0, snapshot=snapshot, trees=trees.runs()).running_trees
        assert run.seconds(2) == 9.0 - trees.runs()[0].since[1]


def test_statuses_of_nodes_that_are_not_known_yet_are_shown_on_no_others() -> None:
    trees = Trees()
    structure(trees, 1, FIRST)
    assert status(trees, 1, 2, [RUNNING, RUNNING, RUNNING, SUCCESS])
    assert trees.runs() == ()
    structure(trees, 2, [*SECOND, TreeNode(4, 2, 'put', 'PutDown')])
    (run,) = trees.runs()
    assert run.statuses == (RUNNING, RUNNING, RUNNING, SUCCESS)
