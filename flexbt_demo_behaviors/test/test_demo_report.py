# SPDX-License-Identifier: BSD-3-Clause
"""Timeline and report of a demonstration: nothing passes by default."""

import io
import math
from pathlib import Path

import pytest

from flexbt_console.errors import RefusedError
from flexbt_demo_behaviors.demonstration.report import (
    POINT_DISTANCE,
    DemoReport,
    GoalResult,
    RobotTrack,
    Timeline,
    pose_text,
)
from flexbt_sim.world import Pose, World


def report() -> DemoReport:
    return DemoReport('A demonstration', ('arrive', 'leave'))


def result() -> GoalResult:
    return GoalResult('kitchen', Pose(1.0, 2.0, 0.0), 'arrived', 0.1, True, 12.0, 3.0)


def test_a_report_passes_only_with_every_branch_a_goal_and_no_problem() -> None:
    tried = report()
    verdicts = [tried.passed]
    tried.take('arrive')
    tried.goals.append(result())
    verdicts.append(tried.passed)
    tried.take('leave')
    verdicts.append(tried.passed)
    tried.problem = 'the robot is lost'
    verdicts.append(tried.passed)
    assert verdicts == [False, False, True, False]
    assert 'the robot is lost' in tried.text()


def test_a_command_that_the_console_refuses_to_make_is_a_problem_of_the_report() -> None:
    tried = report()

    def script() -> None:
        raise RefusedError('nothing is pending')

    tried.play(script)
    assert not tried.passed and 'problem nothing is pending' in tried.text()


def test_the_summary_is_told_also_where_no_picture_can_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / 'picture.png'
    picture.mkdir()
    with pytest.raises(IsADirectoryError):
        report().conclude(World(None), {}, picture)
    assert 'A demonstration: FAILED' in capsys.readouterr().out


def test_a_branch_that_was_not_taken_is_named() -> None:
    assert 'leave' in [line for line in report().text().splitlines() if 'NOT TAKEN' in line][1]
    table = DemoReport('A demonstration', ('arrive', 'leave' * 20)).text().splitlines()[1:]
    assert len({line.index('NOT TAKEN') for line in table}) == 1


def test_a_branch_that_nobody_promised_is_a_mistake_of_the_script() -> None:
    with pytest.raises(KeyError, match='fly'):
        report().take('fly')


def test_the_timeline_indents_further_lines() -> None:
    stream = io.StringIO()
    Timeline(stream, clock=iter([0.0, 2.5]).__next__).tell('log', 'one\ntwo\x1b[2J')
    first, second = stream.getvalue().splitlines()
    assert first.startswith('   2.5 s  log')
    assert second.strip() == 'two\\e[2J'
    assert second.index('two') == first.index('one')


def test_the_track_keeps_what_was_driven_and_the_first_plan_to_each_place() -> None:
    changes = []
    track = RobotTrack(lambda: changes.append(1))
    assert not track.ready
    for step in range(101):
        track.add_pose(Pose(step * 0.01, 0.0, 0.0), time=step * 0.1)
    assert track.length == pytest.approx(1.0, abs=POINT_DISTANCE)
    assert 30 <= len(track.way) <= 51  # not all of the 101
    assert track.time == pytest.approx(10.0)
    track.add_plan([(0.0, 0.0), (5.0, 5.0)])
    track.add_plan([(2.0, 2.0), (5.0, 5.0)])  # the same place, from further on
    track.add_plan([])
    track.add_plan([(2.0, 2.0), (0.0, 5.0)])
    assert track.plans == [[(0.0, 0.0), (5.0, 5.0)], [(2.0, 2.0), (0.0, 5.0)]]
    track.restart()
    assert track.plans == []
    assert [pose for _, pose in track.way] == [Pose(1.0, 0.0, 0.0)]
    assert len(changes) > 100


def test_the_track_knows_rest() -> None:
    track = RobotTrack()
    rests = []
    for time, x, yaw in ((5.0, 0.0, 0.0), (5.1, 0.02, 0.0), (5.2, 0.02, -0.03), (5.3, 0.02, math.tau - 0.03)):
        track.add_pose(Pose(x, 0.0, yaw), time)
        rests.append(track.at_rest)
    assert rests == [True, False, False, True]


def test_a_pose_is_shown_with_its_heading_in_degrees() -> None:
    assert pose_text(Pose(3.0, -4.0, math.pi / 2.0)) == '(3.00, -4.00, 90°)'
