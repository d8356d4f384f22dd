# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees in the mirror: their nodes may become others while they run."""

from __future__ import annotations

import re
from collections.abc import Sequence

from flexbt_console.mirror import (
    ActiveState,
    LinkState,
    NodeKind,
    NodeStatus,
    Snapshot,
    StatusChange,
    TreeNode,
    TreeRun,
    Trees,
    View,
)
from flexbt_console.pictures import ASCII, acting_lines, tree_lines

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


def names(run: TreeRun, rows: int) -> list[str]:
    """The nodes on the screen: their names, in their order."""
    return [re.sub(r' +[A-Z]+$|  \d+ s$', '', line.lstrip(' >?*x+-.')) for line in tree_lines(run, 80, rows, ASCII)[1:]]


def test_a_planner_that_is_ticked_at_a_rate_moves_no_other_line() -> None:
    trees, idle = Trees(), NodeStatus.IDLE
    control, decorator = NodeKind.CONTROL, NodeKind.DECORATOR
    nodes = [
        TreeNode(1, 0, 'NavigateRecovery', 'RecoveryNode', kind=control),
        TreeNode(2, 1, 'PipelineSequence', 'PipelineSequence', kind=control),
        TreeNode(3, 2, 'RateController', 'RateController', kind=decorator),
        TreeNode(4, 3, 'ComputePath', 'RecoveryNode', kind=control),
        TreeNode(5, 4, 'ComputePathToPose', 'ComputePathToPose', kind=NodeKind.ACTION),
        TreeNode(6, 4, 'ClearGlobal', 'ClearEntireCostmap', kind=NodeKind.ACTION),
        TreeNode(7, 2, 'FollowPath', 'FollowPath', kind=NodeKind.ACTION),
        *(TreeNode(uid, 1, f'Spin{uid}', 'Spin', kind=NodeKind.ACTION) for uid in range(8, 14)),
    ]
    structure(trees, 1, nodes)
    plans = [RUNNING, RUNNING, RUNNING, RUNNING, RUNNING, idle, RUNNING, *(idle,) * 6]
    drives = [RUNNING, RUNNING, SUCCESS, SUCCESS, SUCCESS, idle, RUNNING, *(idle,) * 6]
    rests = [RUNNING, RUNNING, RUNNING, idle, idle, idle, RUNNING, *(idle,) * 6]
    status(trees, 1, 1, plans, 1, 2, 3, 4, 5, 7)
    shown = set()
    for sequence in range(2, 12):  # a second each
        now = (drives, rests, plans)[sequence % 3]
        status(trees, sequence, 1, now, 3, 4, 5)
        shown.add(tuple(names(trees.runs()[0], 6)))
        assert acting_lines(trees.runs()[0])[0].startswith('FollowPath')
    assert len(shown) == 1 and 'FollowPath' in next(iter(shown)), shown


def test_what_only_structures_a_tree_takes_no_room_where_there_is_little() -> None:
    trees = Trees()
    deep = [
        TreeNode(
            uid, uid - 1, f'at cost {uid}' if uid == 8 else 'ReactiveSequence', 'ReactiveSequence', '', NodeKind.CONTROL
        )
        for uid in range(2, 12)
    ]
    nodes = [TreeNode(1, 0, 'BringCup', 'ReachGoal'), *deep, TreeNode(12, 11, 'PickUp', 'PickUp', kind=NodeKind.ACTION)]
    structure(trees, 1, nodes)
    status(trees, 1, 1, [RUNNING] * 12, *range(1, 13))
    (run,) = trees.runs()
    assert names(run, 4) == ['BringCup (ReachGoal)', 'at cost 8 (ReactiveSequence)', 'PickUp']
    assert acting_lines(run) == ['PickUp  0 s  in at cost 8, BringCup']
    assert len(names(run, 20)) == 12  # where there is room, all of it


def test_ways_that_a_condition_keeps_closed_take_no_room_where_there_is_little() -> None:
    trees = Trees()
    ways = [
        node
        for first in (2, 5, 8)
        for node in (
            TreeNode(first, 1, f'at cost {first}', 'ReactiveSequence', '', NodeKind.CONTROL),
            TreeNode(first + 1, first, f'Holds{first}', 'Holds', kind=NodeKind.CONDITION),
            TreeNode(first + 2, first, f'Work{first}', 'Work', kind=NodeKind.ACTION),
        )
    ]
    structure(trees, 1, [TreeNode(1, 0, 'Plan', 'ReactiveFallback', '', NodeKind.CONTROL), *ways])
    idle, failed = NodeStatus.IDLE, NodeStatus.FAILURE
    statuses = [RUNNING, failed, failed, idle, failed, failed, idle, RUNNING, SUCCESS, RUNNING]
    status(trees, 1, 1, statuses, *range(1, 11))
    (run,) = trees.runs()
    assert names(run, 6) == [
        'Plan (ReactiveFallback)',
        'at cost 8 (ReactiveSequence)',
        'Holds8? (Holds)',
        'Work8 (Work)',
    ]
    assert len(names(run, 20)) == 10  # where there is room, all of it
