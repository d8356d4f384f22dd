# SPDX-License-Identifier: BSD-3-Clause
"""The past of a robot: each moment is shown as it was then, and whatever happens, it takes a bounded memory."""

from __future__ import annotations

import pickle
import random
import threading
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import itemgetter
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_console.mirror import fleet as fleet_module
from flexbt_console.mirror import history as history_module
from flexbt_console.mirror import lanes as lanes_module
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.history import History
from flexbt_console.mirror.lanes import MOST_ENTRIES, Lane, LaneEntry, Lanes
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    ActiveState,
    BehaviorList,
    CommandKind,
    Decision,
    DecisionKind,
    DriveProgress,
    EventKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    GridMap,
    LogLine,
    LogSeverity,
    OperatorCommand,
    Peer,
    StopGuard,
    Structure,
    Subject,
    Subjects,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, StatusChange, TreeNodes, TreeReport
from flexbt_core.clock.clock import ManualClock

NODES = [MirroredNode(1, 0, 'Main', 'Sequence', '/Main'), MirroredNode(2, 1, 'Go', 'FollowPath', '/Main/Go')]


class Robot:
    """A robot whose messages are random."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.clock = ManualClock()
        self.mirror = Mirror(self.clock)
        self.number = 0
        self.jump = 0.0

    def snapshot(self, **parts: Any) -> None:
        self.number += 1
        now = self.clock.now() + self.jump
        self.mirror.receive_snapshot(
            ExecutiveSnapshot('e', self.number, stamp=now, **parts), Transit(now, now + 0.1 * self.random.random())
        )

    def step(self) -> None:
        pick, mirror, now = self.random.choice, self.mirror, self.clock.now() + self.jump
        self.number += 1
        match self.random.randrange(17):
            case 0 | 1 | 2:
                state = pick(['/A', '/B', '/C/D'])
                waits = (Decision(f'd{self.number}', DecisionKind.TRANSITION, state, 'done'),)
                goal = DriveProgress(goal=FramedPose(pick([1.0, 2.0]), 0.0))
                self.snapshot(
                    state=ExecutiveState.RUNNING,
                    run_id=pick(['r1', 'r2']),
                    active_states=(ActiveState(state, now, progress=goal),),
                    decisions=pick([(), waits]),
                    peers=(Peer('/bt_server', pick([True, False]), now),),
                    robot_pose=FramedPose(self.random.random(), self.random.random()),
                )
            case 3:
                mirror.receive_structure(Structure(pick(['r1', 'r2'])))
            case 4:
                mirror.receive_behaviors(BehaviorList('e'))
            case 5:
                mirror.receive_places({pick('ab'): FramedPose(0.0, 0.0)})
            case 6:
                mirror.receive_subjects(Subjects('e', (Subject('d1', 1),)))
            case 7:
                mirror.receive_log(LogLine('e', self.number, pick([*LogSeverity]), 'text', '/A', 'r1', now))
            case 8:
                left = ExecutiveEvent(
                    'e', self.number, EventKind.TRANSITION, '/A', 'done', '/B', run_id='r1', stamp=now
                )
                mirror.receive_events([left])
            case 9:
                mirror.receive_tree_structure(TreeNodes(pick('xy'), 'Main', NODES, now, pick([1, 2])))
            case 10 | 11:
                statuses = [pick([*MirroredStatus]) for _ in NODES]
                changes = [StatusChange(now, 2, pick([*MirroredStatus]))]
                report = TreeReport(pick('xy'), self.number, statuses, changes, now, False, False, pick([1, 2]))
                mirror.receive_tree_status(replace(report, finished=pick([True, False, False])))
            case 12:
                mirror.receive_map(GridMap(2, 2, 0.05, 0.0, 0.0, self.random.randbytes(4)))
            case 13:
                mirror.receive_plan(((0.0, now),))
            case 14:
                mirror.receive_scan(((now, 0.0),), 1.0)
            case 15:
                pick([mirror.forget_surroundings, mirror.sender_gone, mirror.tree_servers_left])()
            case 16:
                others: list[Callable[[], object]] = [
                    lambda: mirror.sender_replaced(pick([True, False])),
                    lambda: mirror.set_problem(pick(['', 'no'])),
                    lambda: mirror.receive_guard(StopGuard(holding=pick([True, False]))),
                    lambda: mirror.receive_pong(0.1),
                ]
                pick(others)()


def shown(mirror: Mirror) -> Any:
    return mirror.view(), mirror.log(), mirror.events()


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32), calls=st.sampled_from([1, 7, 1000]))
def test_each_moment_is_shown_as_it_was_then(seed: int, calls: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(history_module, 'CHUNK_CALLS', calls)
        robot = Robot(seed)
        for _ in range(robot.random.randrange(20)):
            robot.step()
        past = History(robot.mirror)
        was = []
        for _ in range(50):
            robot.clock.advance(robot.random.choice([0.01, 0.3, 0.3, 0.3, 8.0]))
            for _ in range(robot.random.randrange(1, 4)):
                robot.step()
            robot.clock.advance(robot.random.choice([0.001, 0.1, 2.0]))
            was.append((robot.clock.now(), shown(robot.mirror)))
        robot.random.shuffle(was)
        for time, then in was[:25]:
            assert shown(past.moment(time)) == then
        assert shown(past.moment(-1.0)) == shown(past.moment(past.begin))


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32), jumps=st.booleans())
def test_lanes_that_are_read_piece_by_piece_are_those_that_are_read_at_once(seed: int, jumps: bool) -> None:
    robot = Robot(seed)
    lanes = Lanes(robot.mirror)
    known: dict[int, LaneEntry] = {}
    revision = 0
    for _ in range(150):
        robot.clock.advance(robot.random.choice([0.0, 0.3, 5.0, 100.0]))
        robot.jump = robot.random.choice([0.0, -1e6, 1e6]) if jumps else 0.0  # of the executive's clock
        robot.step()
        for entry in lanes.since(revision, robot.random.choice([1, 3, 100])):
            assert entry.revision > revision
            known[entry.number], revision = entry, entry.revision
    known |= {entry.number: entry for entry in lanes.since(revision)}
    assert sorted(known.values(), key=lambda one: one.number) == sorted(lanes.since(), key=lambda one: one.number)
    snapshot = robot.mirror.view().snapshot
    active = {state.path for state in snapshot.active_states} if snapshot is not None else set()
    for entry in known.values():
        assert entry.end is None or entry.begin <= entry.end <= robot.clock.now()
        if entry.lane is Lane.STATES and entry.end is None:
            assert any(path == entry.key or path.startswith(f'{entry.key}/') for path in active)


def test_eight_hours_and_a_flood_take_a_bounded_memory_and_the_lanes_keep_what_is_rare() -> None:
    robot = Robot(1)
    past, lanes = History(robot.mirror, 200_000), Lanes(robot.mirror)
    robot.snapshot(active_states=(ActiveState('/A', 0.0),))
    robot.mirror.receive_log(LogLine('e', 1, LogSeverity.ERROR, 'lost', '/A'))
    failed = [StatusChange(0.0, 2, MirroredStatus.FAILURE)]
    running = [MirroredStatus.RUNNING, MirroredStatus.IDLE]
    robot.mirror.receive_tree_structure(TreeNodes('x', 'Main', NODES, 0.0))
    robot.mirror.receive_tree_status(TreeReport('x', 1, running, failed, 0.0, finished=False, paused=False))
    for number in range(20_000):
        robot.clock.advance(8 * 3600 / 20_000)
        noise = str(robot.random.random()) * 5
        robot.mirror.receive_log(LogLine('e', 2 + number, LogSeverity.INFO, noise))
        robot.snapshot(active_states=(ActiveState('/A', 0.0, (noise,)),))
        changes = [StatusChange(number, 2, status) for status in (MirroredStatus.RUNNING, MirroredStatus.SUCCESS)]
        robot.mirror.receive_tree_status(
            TreeReport('x', number + 2, running, changes * 20, number, finished=False, paused=False)
        )
    robot.mirror.receive_log(LogLine('e', 30_000, LogSeverity.ERROR, 'x' * 10_000_000))
    robot.clock.advance(1.0)
    assert past.moment(robot.clock.now()).log()[-1].text == 'x' * 10_000_000
    assert past.bytes < 200_000 + 3 * history_module.CHUNK_BYTES + 10_100_000
    for number in range(100):
        robot.mirror.receive_log(LogLine('e', 30_001 + number, LogSeverity.INFO, str(robot.random.random()) * 20_000))
    assert past.bytes < 200_000 + 50_000_000  # as much as the mirror has in its log, once more
    assert past.begin > 0.0
    entries = lanes.since()
    assert next(one.text for one in entries if one.lane is Lane.FAULTS) == 'lost  /A'
    assert len([one for one in entries if one.lane is Lane.NODES]) <= MOST_ENTRIES
    assert all(len(one.text) < 400 and len(one.label) < 400 for one in entries)
    (state,) = [one for one in entries if one.lane is Lane.STATES]
    assert (state.key, state.end) == ('/A', None)
    assert not lanes.since(lanes.revision)


def test_a_stop_waits_for_nothing_large_that_is_written_or_compressed(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, stopped = Robot(1), list[bool]()
    stop = OperatorCommand('1', CommandKind.STOP, 'ann')

    def meanwhile(work: Callable[..., bytes]) -> Callable[..., bytes]:
        def worked(*arguments: Any) -> bytes:
            giving = threading.Thread(target=robot.mirror.give, args=(stop, 5.0), daemon=True)
            giving.start()
            giving.join(5.0)
            stopped.append(not giving.is_alive())
            return work(*arguments)

        return worked

    dumps = pickle.dumps
    written = meanwhile(dumps)  # of all that the mirror has
    monkeypatch.setattr(pickle, 'dumps', lambda one: (written if isinstance(one, dict) else dumps)(one))
    monkeypatch.setattr(zlib, 'compress', meanwhile(zlib.compress))
    monkeypatch.setattr(zlib, 'decompress', meanwhile(zlib.decompress))
    past = History(robot.mirror)
    robot.mirror.receive_map(GridMap(1000, 2000, 0.05, 0.0, 0.0, bytes(2_000_000)))
    robot.mirror.receive_log(LogLine('e', 1, LogSeverity.INFO, 'x' * 2_000_000))
    robot.clock.advance(1.0)
    robot.mirror.receive_plan(())
    robot.clock.advance(1.0)
    past.moment(0.5)
    assert all(stopped) and len(stopped) >= 4


def test_of_a_map_that_changes_the_past_keeps_what_is_compressed_of_it() -> None:
    robot = Robot(1)
    past = History(robot.mirror, 1_000_000)
    for number in range(100):
        robot.mirror.receive_map(GridMap(1000, 1000, 0.05, 0.0, 0.0, bytes([number]) * 1_000_000))
        robot.clock.advance(1.0)
    assert past.begin == 0.0 and past.bytes < 1_000_000
    shown = past.moment(42.5).view().surroundings.map
    assert shown is not None and shown.cells == bytes([42]) * 1_000_000


def test_the_pasts_of_many_robots_share_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_module, 'PAST_BYTES', 4_000_000)
    monkeypatch.setattr(history_module, 'CHUNK_BYTES', 50_000)
    fleet, robots = Fleet(), [Robot(seed) for seed in range(8)]
    pasts = []
    for number, robot in enumerate(robots):
        pasts.append(fleet.past(str(number), robot.mirror)[0])
        for one in robots:
            for _ in range(30):
                one.clock.advance(1.0)
                one.snapshot(message=one.random.randbytes(10_000).hex())
                one.mirror.receive_scan(tuple((one.random.random(), 0.0) for _ in range(300)), 1.0)
    bounds = 1.25 * 4_000_000 + len(pasts) * 2 * 50_000
    assert sum(past.bytes for past in pasts) < bounds
    assert all(past.bytes > bounds / len(pasts) / 2 for past in pasts)


@pytest.mark.parametrize('status_first', [False, True])
@pytest.mark.parametrize(('kind', 'said'), [(DecisionKind.CHOICE, 'answer'), (DecisionKind.TRANSITION, 'force')])
def test_an_outcome_that_a_state_asked_for_is_an_answer(kind: DecisionKind, said: str, status_first: bool) -> None:
    robot = Robot(0)
    lanes = Lanes(robot.mirror)
    active = {'state': ExecutiveState.RUNNING, 'run_id': 'r1', 'active_states': (ActiveState('/Ask'),)}
    robot.snapshot(**active, decisions=(Decision('d1', kind, '/Ask', 'again'),))
    skip = ExecutiveEvent(
        'e', 1, EventKind.COMMAND, '/Ask', 'skip', operator='ann', command='FORCE', decision_id='d1', run_id='r1'
    )
    for step in (robot.snapshot, lambda: robot.mirror.receive_events([skip]))[:: 1 if status_first else -1]:
        robot.clock.advance(0.2)
        step()
    words = {one.lane: (one.label, one.word) for one in lanes.since()}
    assert words[Lane.COMMANDS] == (f'{said} skip', 'applied')
    assert words[Lane.DECISIONS][1] == 'skip by ann'


@settings(deadline=None, max_examples=50)
@given(
    visits=st.lists(st.tuples(st.sampled_from(['/A', '/B']), st.sampled_from([0.001, 0.3, 1.5])), min_size=1),
    chance=st.randoms(use_true_random=False),
)
def test_each_visit_of_a_state_has_its_own_outcome(visits: list[tuple[str, float]], chance: random.Random) -> None:
    """Statuses and events come by different topics: either may be the first to tell, of several visits too."""
    clock, stamp, told = ManualClock(), 100.0, list[tuple[float, Callable[[], object]]]()
    mirror = Mirror(clock)
    lanes, arrives = Lanes(mirror), {'status': 0.0, 'event': 0.0}

    def tell(kind: str, send: Callable[[], object]) -> None:
        arrives[kind] = max(arrives[kind] + 1e-9, stamp + chance.uniform(0.0, 0.4))  # each topic keeps its order
        told.append((arrives[kind], send))

    def status(number: int, *active: ActiveState) -> Callable[[], object]:
        one = ExecutiveSnapshot('e', number, state=ExecutiveState.RUNNING, run_id='r1', active_states=active)
        return partial(mirror.receive_snapshot, replace(one, stamp=stamp))

    for number, (path, seconds) in enumerate(visits):
        tell('status', status(number, ActiveState(path, stamp)))
        stamp += seconds
        left = ExecutiveEvent('e', number, EventKind.TRANSITION, path, str(number), stamp=stamp, run_id='r1')
        tell('event', partial(mirror.receive_events, [left]))
        stamp += 1e-5
    tell('status', status(len(visits)))
    for at, send in sorted(told, key=itemgetter(0)):
        clock.set(at)
        send()
    shown = [one for one in lanes.since() if one.lane is Lane.STATES]
    assert sorted(int(one.word) for one in shown if one.word) == [*range(len(visits))]
    for number, (path, seconds) in enumerate(visits):
        (entry,) = (one for one in shown if one.word == str(number))
        assert entry.key == path and entry.end is not None
        assert seconds < 1.0 or entry.end - entry.begin > 1.0


@pytest.mark.parametrize('status_first', [False, True])
def test_each_decision_has_its_own_answer(status_first: bool) -> None:
    robot = Robot(0)
    lanes = Lanes(robot.mirror)
    active = {'state': ExecutiveState.RUNNING, 'run_id': 'r1', 'active_states': (ActiveState('/A'), ActiveState('/B'))}
    decisions = tuple(Decision(f'd{path}', DecisionKind.TRANSITION, path, 'done') for path in ('/A', '/B', '/C'))
    robot.snapshot(**active, decisions=decisions)
    answers = [
        ExecutiveEvent('e', 1, EventKind.COMMAND, operator='bob', command='CONFIRM', decision_id='d/B', run_id='r1'),
        ExecutiveEvent('e', 2, EventKind.COMMAND, operator='ann', command='CONFIRM', decision_id='d/A', run_id='r1'),
        ExecutiveEvent(
            'e', 3, EventKind.COMMAND, operator='eve', command='CONFIRM', decision_id='of before', run_id='r1'
        ),
    ]
    for step in (robot.snapshot, lambda: robot.mirror.receive_events(answers))[:: 1 if status_first else -1]:
        robot.clock.advance(0.2)
        step()
    words = {one.key: one.word for one in lanes.since() if one.lane is Lane.DECISIONS}
    assert words == {'/A': 'confirmed by ann', '/B': 'confirmed by bob', '/C': ''}


def test_a_node_that_has_gone_on_for_long_may_end_otherwise_than_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes_module, 'MOST_ENTRIES', 2)
    robot = Robot(1)
    lanes = Lanes(robot.mirror)
    robot.snapshot()
    robot.mirror.receive_tree_structure(TreeNodes('x', 'Main', NODES, 0.0))

    def tell(sequence: int, status: MirroredStatus) -> None:
        robot.mirror.receive_tree_status(
            TreeReport('x', sequence, [MirroredStatus.RUNNING, status], [], 0.0, False, False)
        )

    for sequence, status in enumerate((MirroredStatus.RUNNING, MirroredStatus.SUCCESS, MirroredStatus.RUNNING), 1):
        tell(sequence, status)
    for number in range(9):  # more than are remembered
        robot.mirror.receive_log(LogLine('e', number, LogSeverity.WARN, 'text', f'/{number}'))
    tell(4, MirroredStatus.FAILURE)
    assert [one.word for one in lanes.since() if one.label == 'Go'] == ['success', 'failure']


def test_a_goal_has_the_name_of_a_place_of_its_own_frame() -> None:
    robot = Robot(0)
    lanes = Lanes(robot.mirror)
    robot.mirror.receive_places({'dock': FramedPose(1.0, 0.0), 'start': FramedPose(1.0, 0.1, frame='odom')})
    for frame in ('map', 'odom', 'utm'):
        goal = DriveProgress(goal=FramedPose(1.0, 0.05, frame=frame))
        robot.snapshot(
            state=ExecutiveState.RUNNING, run_id='r1', active_states=(ActiveState(f'/{frame}', progress=goal),)
        )
        robot.clock.advance(0.2)
    found = {one.key.split()[0]: one.label for one in lanes.since() if one.lane is Lane.GOALS}
    assert found == {'/map': 'dock', '/odom': 'start', '/utm': '1.0, 0.1'}, found


def test_lanes_know_what_was_sent_once_before_they_began() -> None:
    """A page may be opened long after its server has heard of the places, or while a program follows a tree."""
    robot = Robot(0)
    goal = FramedPose(1.0, 2.0)
    robot.mirror.receive_places({'dock': goal})
    robot.mirror.receive_tree_structure(TreeNodes('x', 'Main', NODES, 0.0))
    running, failure = MirroredStatus.RUNNING, MirroredStatus.FAILURE
    robot.mirror.receive_tree_status(TreeReport('x', 1, (running, running), (), 0.0, finished=False, paused=False))
    robot.clock.advance(10.0)
    lanes = Lanes(robot.mirror)
    robot.clock.advance(10.0)
    robot.mirror.receive_tree_status(TreeReport('x', 2, (running, failure), (), 20.0, finished=False, paused=False))
    robot.snapshot(active_states=(ActiveState('/Go', 20.0, progress=DriveProgress(goal=goal)),))
    shown = [(one.label, one.begin, one.end, one.word) for one in lanes.since() if one.lane is not Lane.STATES]
    assert shown == [('Main', 10.0, None, ''), ('Go', 10.0, 20.0, 'failure'), ('dock', 20.0, None, '')]
