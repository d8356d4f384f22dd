# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees in the mirror: their nodes may become others while they run."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest

from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import ActiveState, ExecutiveSnapshot, Peer
from flexbt_console.mirror.trees import (
    GONE_SECONDS,
    MirroredNode,
    MirroredNodeKind,
    MirroredStatus,
    MirroredTree,
    StatusChange,
    TreeNodes,
    TreeReport,
    Trees,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.style import ASCII, Tone, tone_of
from flexbt_console.present.tree_lines import acting_lines, tree_lines

RUNNING, SUCCESS = MirroredStatus.RUNNING, MirroredStatus.SUCCESS
TRUNK = [MirroredNode(1, 0, 'Main', 'Sequence'), MirroredNode(2, 1, 'reach', 'ReachGoal', kind=MirroredNodeKind.ACTION)]
FIRST = [*TRUNK, MirroredNode(3, 2, 'look', 'IsAt')]
SECOND = [*TRUNK, MirroredNode(3, 2, 'go', 'GoTo')]


def structure(trees: Trees, number: int, nodes: Sequence[MirroredNode]) -> None:
    trees.receive_structure(TreeNodes('run', 'Main', nodes, 0.0, number))


def status(trees: Trees, sequence: int, number: int, statuses: Sequence[MirroredStatus], *changed: int) -> bool:
    changes = [StatusChange(float(sequence), uid, statuses[uid - 1]) for uid in changed]
    stamp = float(sequence)
    return trees.receive_status(
        TreeReport('run', sequence, statuses, changes, stamp, finished=False, paused=False, structure=number)
    )


def test_a_run_with_other_nodes_keeps_what_is_known_of_those_that_it_has_still() -> None:
    trees = Trees()
    structure(trees, 1, FIRST)
    assert status(trees, 1, 1, [RUNNING, RUNNING, SUCCESS], 1, 2, 3)
    structure(trees, 2, SECOND)
    (run,) = trees.runs()
    assert run.running_leaves == (2,)  # it searches
    assert (run.nodes, run.statuses) == (tuple(SECOND), (RUNNING, RUNNING, MirroredStatus.IDLE))
    assert run.since[:2] == (1.0, 1.0) and run.last_end(3) is MirroredStatus.IDLE
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
        snapshot = ExecutiveSnapshot('e', 1, stamp=9.0, active_states=named)
        (run,) = View(LinkState.LIVE, 0.0, snapshot=snapshot, trees=trees.runs()).running_trees
        assert run.seconds(2) == 9.0 - trees.runs()[0].since[1]


def test_statuses_of_nodes_that_are_not_known_yet_are_shown_on_no_others() -> None:
    trees = Trees()
    structure(trees, 1, FIRST)
    assert status(trees, 1, 2, [RUNNING, RUNNING, RUNNING, SUCCESS])
    assert trees.runs() == ()
    structure(trees, 2, [*SECOND, MirroredNode(4, 2, 'put', 'PutDown')])
    (run,) = trees.runs()
    assert run.statuses == (RUNNING, RUNNING, RUNNING, SUCCESS)


def names(run: MirroredTree, rows: int) -> list[str]:
    """Return the nodes on the screen: their names, in their order."""
    return [re.sub(r' +[A-Z]+$|  \d+ s$', '', line.lstrip(' >?*x+-.')) for line in tree_lines(run, 80, rows, ASCII)[1:]]


def test_a_planner_that_is_ticked_at_a_rate_moves_no_other_line() -> None:
    trees, idle = Trees(), MirroredStatus.IDLE
    control, decorator = MirroredNodeKind.CONTROL, MirroredNodeKind.DECORATOR
    nodes = [
        MirroredNode(1, 0, 'NavigateRecovery', 'RecoveryNode', kind=control),
        MirroredNode(2, 1, 'PipelineSequence', 'PipelineSequence', kind=control),
        MirroredNode(3, 2, 'RateController', 'RateController', kind=decorator),
        MirroredNode(4, 3, 'ComputePath', 'RecoveryNode', kind=control),
        MirroredNode(5, 4, 'ComputePathToPose', 'ComputePathToPose', kind=MirroredNodeKind.ACTION),
        MirroredNode(6, 4, 'ClearGlobal', 'ClearEntireCostmap', kind=MirroredNodeKind.ACTION),
        MirroredNode(7, 2, 'FollowPath', 'FollowPath', kind=MirroredNodeKind.ACTION),
        *(MirroredNode(uid, 1, f'Spin{uid}', 'Spin', kind=MirroredNodeKind.ACTION) for uid in range(8, 14)),
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
        MirroredNode(
            uid,
            uid - 1,
            f'at cost {uid}' if uid == 8 else 'ReactiveSequence',
            'ReactiveSequence',
            '',
            MirroredNodeKind.CONTROL,
        )
        for uid in range(2, 12)
    ]
    nodes = [
        MirroredNode(1, 0, 'BringCup', 'ReachGoal'),
        *deep,
        MirroredNode(12, 11, 'PickUp', 'PickUp', kind=MirroredNodeKind.ACTION),
    ]
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
            MirroredNode(first, 1, f'at cost {first}', 'ReactiveSequence', '', MirroredNodeKind.CONTROL),
            MirroredNode(first + 1, first, f'Holds{first}', 'Holds', kind=MirroredNodeKind.CONDITION),
            MirroredNode(first + 2, first, f'Work{first}', 'Work', kind=MirroredNodeKind.ACTION),
        )
    ]
    structure(trees, 1, [MirroredNode(1, 0, 'Plan', 'ReactiveFallback', '', MirroredNodeKind.CONTROL), *ways])
    idle, failed = MirroredStatus.IDLE, MirroredStatus.FAILURE
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


class Robot:
    """A tree that runs, and what the executive says of its server; a second passes with each message."""

    def __init__(self, server: str = '/bt_server') -> None:
        self.trees = Trees()
        self.now = 0.0
        self._server = server
        self._sequence = 0
        structure(self.trees, 1, FIRST)

    def tell(self, *, finished: bool = False, sent: float | None = None) -> None:
        """Send a status, at once or at a time before."""
        self.now += 1.0
        self._sequence += 1
        stamp = self.now if sent is None else sent
        self.trees.receive_status(
            TreeReport(
                'run',
                self._sequence,
                [RUNNING, RUNNING, SUCCESS],
                [],
                stamp,
                finished=finished,
                paused=False,
                server=self._server,
            ),
            self.now,
        )

    def says(self, *, alive: bool, since: float, executive: str = 'e', expected: bool = True) -> None:
        """Send a snapshot."""
        self.now += 1.0
        peers = [Peer('/nav', True), Peer('/bt_server', alive, since, expected=expected)]
        self.trees.receive_peers(executive, peers, self.now)

    @property
    def run(self) -> MirroredTree:
        (run,) = self.trees.runs(self.now)
        return run

    def runs(self) -> bool:
        return self.run.is_running

    def has_lost(self) -> bool:
        """Return whether the server of the run is gone."""
        return self.run.server_gone

    @property
    def view(self) -> View:
        return View(LinkState.LIVE, 0.0, trees=self.trees.runs(self.now))


@pytest.mark.parametrize('server', ['/bt_server', ''])  # a recording does not tell who has sent it
def test_a_tree_whose_server_is_gone_is_shown_as_it_was_and_does_not_run(server: str) -> None:
    robot = Robot(server)
    robot.tell()
    robot.says(alive=True, since=0.0)
    assert robot.runs() and robot.view.drawn_trees == robot.view.running_trees == [robot.run]
    robot.says(alive=False, since=2.5)
    assert not robot.runs() and not robot.view.running_trees and not acting_lines(robot.run)
    (drawn,) = robot.view.drawn_trees
    assert drawn.status(2) is RUNNING  # the last that was heard
    title, *nodes = tree_lines(drawn, 80, 10, ASCII)
    assert 'SERVER GONE' in title and 'running' not in title and {tone_of(line) for line in nodes} == {Tone.DIM}
    robot.tell(sent=2.0)  # it was on its way when the server went
    robot.says(alive=True, since=5.5)  # another process has its place, which does not know of it
    assert not robot.runs() and robot.view.drawn_trees
    robot.now += GONE_SECONDS
    assert not robot.trees.runs(robot.now)


def test_a_server_that_is_replaced_between_two_snapshots_has_lost_its_trees() -> None:
    robot = Robot()
    robot.tell()
    robot.says(alive=True, since=0.0)
    robot.tell()
    robot.says(alive=True, since=0.0)
    robot.says(alive=True, since=4.5)
    assert robot.has_lost()
    robot.trees.receive_structure(TreeNodes('next', 'Main', FIRST, 6.0))
    running = [RUNNING, RUNNING, SUCCESS]
    report = TreeReport('next', 1, running, [], 6.0, finished=False, paused=False, server='/bt_server')
    robot.trees.receive_status(report, 6.0)
    robot.says(alive=True, since=4.5)
    assert [run.run_id for run in robot.view.drawn_trees] == ['next']  # and nothing of the one before


def test_a_status_just_before_the_server_is_replaced_is_none_of_the_other_process() -> None:
    robot = Robot()
    robot.says(alive=True, since=0.0)
    robot.tell()
    robot.says(alive=True, since=2.5)
    assert robot.has_lost()


def test_a_server_with_another_clock_than_the_executive_is_there() -> None:
    robot = Robot()
    for _ in range(2):
        robot.says(alive=True, since=1.7e9)
        robot.tell()
        assert robot.runs()
    robot.says(alive=False, since=1.7e9 + 5.0)
    assert robot.has_lost()


def test_a_server_that_is_heard_again_runs_its_trees() -> None:
    robot = Robot()
    robot.tell()
    robot.says(alive=True, since=0.0)
    robot.says(alive=False, since=2.5)  # it hung for too long
    robot.tell()
    assert robot.has_lost()  # until the executive hears it, too
    robot.says(alive=True, since=4.5)
    assert robot.runs()
    robot.trees.servers_left({'/bt_server'}, robot.now)
    assert robot.runs()
    robot.trees.servers_left({'/other'}, robot.now)  # the link was down for longer than the middleware waits
    assert robot.has_lost()
    robot.says(alive=True, since=4.5)
    assert robot.has_lost()
    robot.tell()
    robot.says(alive=False, since=8.5)
    robot.tell(finished=True)
    assert robot.run.finished and not robot.has_lost()


def test_an_executive_that_is_restarted_ends_no_tree_and_one_that_does_not_watch_the_server_neither() -> None:
    robot = Robot()
    robot.tell()
    robot.says(alive=True, since=0.0)
    robot.says(alive=False, since=2.0, executive='f', expected=False)  # it has not seen it yet
    assert robot.runs()
    robot.says(alive=False, since=2.0, executive='f')  # nor has one whose peers somebody has named
    robot.says(alive=True, since=4.0, executive='f')
    assert robot.runs()
    robot.says(alive=False, since=5.0, executive='f')
    assert robot.has_lost()
    other = Robot('/trees')
    other.tell()
    other.says(alive=False, since=1.5)
    assert other.runs()
