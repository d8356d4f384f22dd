# SPDX-License-Identifier: BSD-3-Clause
"""Several robots: which needs its operator first; a robot that moves though it should stand."""

from __future__ import annotations

import dataclasses
import json
import random

import pytest

from flexbt_console.errors import ExitCode
from flexbt_console.mirror.fleet import Fleet, RobotOverview, Urgency
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    Peer,
)
from flexbt_console.mirror.unexpected_motion import UnexpectedMotionDetector
from flexbt_console.present.rendering import robot_line
from flexbt_console.ui.line import line_mode
from flexbt_console.ui.screen.lines import others_text
from flexbt_core.clock.clock import ManualClock, SteadyClock

ASKED = Decision('d', DecisionKind.TRANSITION, '/Drive', 'done', ('done',), 2, since=100.0)
RUNS = ExecutiveSnapshot('e', 1, state=ExecutiveState.RUNNING, run_id='r', stamp=130.0, robot_pose=FramedPose(0.0, 0.0))


def test_who_has_waited_longest_for_a_decision_comes_first_and_the_idle_last() -> None:
    clock = ManualClock()
    shown = {
        'idle': dataclasses.replace(RUNS, state=ExecutiveState.IDLE, outcome='finished'),
        'runs': RUNS,
        'alone': dataclasses.replace(RUNS, peers=(Peer('/bt_server', alive=False, problem='start it'),)),
        'unready': dataclasses.replace(RUNS, peers=(Peer('/recorder', alive=True, ready=False, problem='disk full'),)),
        'failed': dataclasses.replace(RUNS, state=ExecutiveState.IDLE, outcome='error'),
        'asks': dataclasses.replace(RUNS, decisions=(ASKED,)),
        'asks longer': dataclasses.replace(RUNS, decisions=(dataclasses.replace(ASKED, since=70.0),)),
    }
    names = [*shown, 'gone', 'never heard']
    random.Random(1).shuffle(names)
    fleet = Fleet()
    mirrors = {name: Mirror(clock) for name in names}
    for name, mirror in mirrors.items():
        fleet.add(name, mirror)
    mirrors['gone'].receive_snapshot(dataclasses.replace(RUNS, decisions=(ASKED,)))
    clock.advance(30.0)
    for name, snapshot in shown.items():
        mirrors[name].receive_snapshot(snapshot)
        mirrors[name].receive_snapshot(dataclasses.replace(snapshot, sequence=2))
    expected = ['asks longer', 'asks', 'failed', 'gone', 'never heard', 'alone', 'unready', 'runs', 'idle']
    overview = fleet.overview()
    assert [robot.name for robot in overview] == expected
    assert [robot.seconds for robot in overview] == [60.0, 30.0, 0.0, 30.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert overview[0].urgency is Urgency.DECISION
    (alone,) = (robot_line(robot) for robot in overview if robot.name == 'alone')
    assert 'degraded' in alone and 'late' not in alone and '/bt_server not found: start it' in alone
    lines = [robot_line(robot).removeprefix(robot.name).strip() for robot in overview if robot.is_unreachable]
    assert lines == [
        'unreachable: last heard 30 s ago; then RUNNING  no behavior',
        'unreachable: never heard',
    ]
    assert others_text(overview, 'idle') == '3 others need you, 2 unreachable: o'


def test_a_robot_that_misses_a_heartbeat_needs_nobody_any_more() -> None:
    clock = ManualClock()
    fleet, mirror = Fleet(), Mirror(clock)
    fleet.add('/forged', mirror)
    for sequence in (1, 2):
        mirror.receive_snapshot(dataclasses.replace(RUNS, sequence=sequence, decisions=(ASKED,)))
    (robot,) = fleet.overview()
    assert robot.needs_operator
    for seconds, urgency in ((1.6, Urgency.LATE), (5.1, Urgency.UNREACHABLE)):
        clock.set(seconds)
        (robot,) = fleet.overview()
        assert (robot.urgency, robot.needs_operator) == (urgency, False)
    mirror.receive_snapshot(dataclasses.replace(RUNS, sequence=3, decisions=(ASKED,)))
    assert fleet.overview()[0].needs_operator


def watch(snapshots: list[ExecutiveSnapshot]) -> list[bool]:
    """Return whether there is an alarm after each of them, one second apart."""
    watched, alarms = UnexpectedMotionDetector(), []
    for second, snapshot in enumerate(snapshots):
        watched.receive(dataclasses.replace(snapshot, stamp=100.0 + second))
        alarms.append(watched.motion is not None)
    return alarms


def at(x: float, **parts: object) -> ExecutiveSnapshot:
    return dataclasses.replace(RUNS, robot_pose=FramedPose(x, 0.0), **parts)  # type: ignore[arg-type]


def test_a_robot_that_moves_after_a_stop_is_an_alarm_until_it_stands() -> None:
    driven = [at(0.3 * second) for second in range(5)]
    stopped = {'state': ExecutiveState.IDLE, 'outcome': 'preempted'}
    braking = [at(1.3, state=ExecutiveState.STOPPING), at(1.4, **stopped), at(1.4, **stopped), at(1.4, **stopped)]
    stands = [at(1.4 + 0.004 * (second % 2), **stopped) for second in range(20)]
    assert not any(watch([*driven, *braking, *stands]))
    creeps = [at(1.4 + 0.06 * second, **stopped) for second in range(10)]
    rest = [at(1.94, **stopped)] * 10
    alarms = watch([*driven, *braking, *creeps, *rest])
    assert alarms.index(True) in range(10, 13)  # 0.1 m later
    assert alarms[18] and not alarms[-1]
    assert not any(watch([*driven, *braking, *creeps, at(3.0)])[-1:])  # another run may drive


def test_a_robot_that_creeps_is_an_alarm_however_often_its_pose_is_told() -> None:
    stopped = {'state': ExecutiveState.IDLE, 'outcome': 'preempted'}
    creeps = [at(0.008 * second, **stopped) for second in range(60)]  # less than the noise from one to the next
    alarms = watch([*creeps, *[creeps[-1]] * 10])
    first = alarms.index(True)
    assert first < 30 and all(alarms[first:60]) and not alarms[-1]


def test_a_robot_whose_pose_gets_lost_while_it_moves_stays_an_alarm_until_it_is_seen_to_stand() -> None:
    stopped = {'state': ExecutiveState.IDLE, 'outcome': 'preempted'}
    moves = [at(0.1 * second, **stopped) for second in range(8)]
    lost = [dataclasses.replace(moves[0], robot_pose=None)] * 10
    found = [at(9.0, **stopped)] * 10  # by another localization, for example
    alarms = watch([*moves, *lost, *found])
    assert all(alarms[7:22]) and not alarms[-1]
    assert not any(watch([*moves[:1], *lost, *found]))


def test_a_paused_robot_may_move_only_by_what_says_that_it_goes_on() -> None:
    held = (ActiveState('/Drive', paused=True),)
    goes_on = (ActiveState('/Drive', paused=True, not_paused=('Drive: its action has no pause',)),)
    for active, expected in ((held, True), (goes_on, False)):
        moves = [at(0.2 * second, state=ExecutiveState.PAUSED, active_states=active) for second in range(10)]
        assert watch(moves)[-1] is expected


def test_a_robot_that_was_found_is_listed_when_it_is_heard(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = SteadyClock()
    fleet, early, late = Fleet(), Mirror(clock), Mirror(clock)
    fleet.add('/early', early)
    early.receive_snapshot(RUNS)
    fleet.add('/late', late)
    monkeypatch.setattr(line_mode, 'ROBOTS_QUIET_SECONDS', 0.0)
    monkeypatch.setattr(line_mode, 'HEAR_SECONDS', 60.0)
    look = fleet.overview

    def heard_after_the_look() -> list[RobotOverview]:
        found = look()
        late.receive_snapshot(RUNS)
        return found

    monkeypatch.setattr(fleet, 'overview', heard_after_the_look)
    assert line_mode.list_robots(fleet, clock, 60.0, as_json=False) is ExitCode.OK
    monkeypatch.setattr(fleet, 'overview', look)
    told = capsys.readouterr().out.splitlines()
    assert len(told) == 2 and all('RUNNING' in line for line in told)

    fleet.add('/never', Mirror(clock))
    monkeypatch.setattr(line_mode, 'HEAR_SECONDS', 0.0)
    line_mode.list_robots(fleet, clock, 60.0, as_json=True)
    (never,) = (one for one in json.loads(capsys.readouterr().out) if one['robot'] == '/never')
    assert never['urgency'] == 'unreachable'
    clock.close()


def test_robots_that_are_not_listed_are_counted_and_those_still_to_be_joined_are_waited_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock, fleet = SteadyClock(), Fleet()
    monkeypatch.setattr(line_mode, 'ROBOTS_QUIET_SECONDS', 0.0)

    def join(number: int) -> None:
        mirror = Mirror(clock)
        fleet.add(f'/r{number}', mirror)
        mirror.receive_snapshot(RUNS)

    def go_on() -> None:
        join(1)
        fleet.note_left_out(936)

    join(0)
    fleet.note_left_out(937, is_growing=True)
    clock.call_at(clock.now() + 0.2, go_on)
    assert line_mode.list_robots(fleet, clock, 60.0, as_json=False) is ExitCode.OK
    told = capsys.readouterr()
    assert len(told.out.splitlines()) == 2
    assert told.err == '936 more not listed; name one with --namespace\n'
    clock.close()


def test_names_of_robots_are_complete_when_no_further_one_comes() -> None:
    class Found(Fleet):
        """One robot is found after the other."""

        @property
        def names(self) -> tuple[str, ...]:
            known = super().names
            if len(known) < 3:
                self.add(f'/r{len(known)}', mirror)
            return known

    mirror, fleet = Mirror(ManualClock()), Found()
    assert line_mode.found_robots(fleet, SteadyClock(), 60.0) == ('/r0', '/r1', '/r2')
