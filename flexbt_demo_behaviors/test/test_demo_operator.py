# SPDX-License-Identifier: BSD-3-Clause
"""The scripted operator, at a mirror that is fed by hand: it notices whatever goes wrong, and says what."""

import io
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.mirror.command_tracker import TrackedCommand
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    AutonomyLevel,
    CommandKind,
    CommandResult,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    LogLine,
    OperatorCommand,
    Peer,
    ResultCode,
)
from flexbt_console.mirror.records import FramedPose as Place
from flexbt_console.mirror.view import View
from flexbt_core import ManualClock
from flexbt_demo_behaviors.demonstration.report import DemoError, RobotTrack, Timeline
from flexbt_demo_behaviors.demonstration.running import Narrator
from flexbt_demo_behaviors.demonstration.scripted_operator import ScriptedOperator
from flexbt_sim.world import Pose

DEADLINE = 60.0
"""Seconds of wall time, on a busy machine too."""

QUESTION = Decision('q1', DecisionKind.INPUT, path='/AskGoal', input_type='geometry_msgs/msg/PoseStamped')
PLAN = Decision('q2', DecisionKind.CHOICE, path='/JudgePath', outcome='done', outcomes=('done', 'failed'))
RUNNING = ExecutiveSnapshot('executive', 1, state=ExecutiveState.RUNNING, run_id='run', behavior='Navigate')


@dataclass
class Link:
    """Takes commands in place of an executive, and answers each as `answer` says."""

    mirror: Mirror
    answer: Callable[[OperatorCommand], ExecutiveSnapshot] = lambda _command: RUNNING
    code: ResultCode = ResultCode.APPLIED
    given: list[OperatorCommand] = field(default_factory=list)
    sequence: int = 0

    def show(self, snapshot: ExecutiveSnapshot) -> None:
        self.sequence += 1
        self.mirror.receive_snapshot(replace(snapshot, sequence=self.sequence))

    def send(self, command: OperatorCommand, timeout: float) -> TrackedCommand:
        self.given.append(command)
        tracked = self.mirror.give(command, timeout)
        result = CommandResult(command.id, self.code, 'not now')
        self.show(replace(self.answer(command), results=(result,)))
        return tracked


@pytest.fixture
def link() -> Link:
    return Link(Mirror(ManualClock()))


@pytest.fixture
def track() -> RobotTrack:
    track = RobotTrack()
    track.add_pose(Pose(0.0, 0.0, 0.0), 0.0)
    return track


@pytest.fixture
def operator(link: Link, track: RobotTrack) -> ScriptedOperator:
    link.mirror.receive_places({'kitchen': Place(3.0, 4.0), 'office': Place(1.0, 0.0)})
    operator = ScriptedOperator(link.mirror, track, link.send, CommandBuilder('script'), Timeline(io.StringIO()))
    track.on_change = operator.notify
    return operator


def test_a_goal_is_answered_with_its_place_and_judged_by_where_the_robot_is(
    operator: ScriptedOperator, link: Link, track: RobotTrack
) -> None:
    link.show(replace(RUNNING, decisions=(QUESTION,)))
    operator.give_goal('kitchen')
    command = link.given[0]
    assert (command.kind, command.decision_id, command.run_id) == (CommandKind.ANSWER, 'q1', 'run')
    assert '"x": 3.0' in command.inputs[0].text
    track.add_pose(Pose(3.0, 3.9, 0.0), 9.0)
    result = operator.close_goal('arrived', must_reach=True)
    assert result.reached
    assert [result.error, result.seconds] == pytest.approx([0.1, 9.0])


def test_a_goal_is_judged_by_where_the_robot_is_when_it_has_arrived(
    operator: ScriptedOperator, link: Link, track: RobotTrack
) -> None:
    """On a busy computer, a pose may come later than the word of the arrival."""
    link.show(replace(RUNNING, decisions=(QUESTION,)))
    operator.give_goal('kitchen')
    track.add_pose(Pose(2.0, 2.0, 0.0), 8.0)
    link.show(replace(RUNNING, active_states=(ActiveState('/AskGoal', entered=9.0),)))
    late = threading.Timer(0.05, track.add_pose, (Pose(3.0, 4.0, 0.0), 9.0))
    late.start()
    assert operator.close_goal('arrived', must_reach=True).reached
    late.join()


def test_a_goal_that_was_missed_is_an_error(operator: ScriptedOperator, link: Link, track: RobotTrack) -> None:
    link.show(replace(RUNNING, decisions=(QUESTION,)))
    operator.give_goal('kitchen')
    track.add_pose(Pose(3.0, 3.7, 0.0), 9.0)
    with pytest.raises(DemoError, match=r'kitchen.*0\.30 m off'):
        operator.close_goal('arrived', must_reach=True)
    assert not operator.close_goal('replaced', must_reach=False).reached


def test_a_decision_that_was_answered_is_not_taken_for_the_next_one(operator: ScriptedOperator, link: Link) -> None:
    link.answer = lambda _command: replace(RUNNING, decisions=(QUESTION,))  # still shown
    link.show(replace(RUNNING, decisions=(QUESTION,)))
    operator.give_goal('kitchen')
    with pytest.raises(DemoError, match='decision of /AskGoal'):
        operator.wait_decision(DecisionKind.INPUT, '/AskGoal', timeout=0.05)
    link.show(replace(RUNNING, decisions=(replace(QUESTION, id='q9'),)))
    assert operator.wait_decision(DecisionKind.INPUT, '/AskGoal', timeout=DEADLINE).id == 'q9'


def test_who_hears_the_robot_does_not_wait_while_the_operator_looks(operator: ScriptedOperator) -> None:
    looks, has_looked = threading.Event(), threading.Event()

    def look(_view: View) -> bool:
        looks.set()
        return has_looked.wait(2 * DEADLINE)

    looking = threading.Thread(target=operator.wait, args=(look, 'a look', 60.0))
    hearing = threading.Thread(target=operator.notify)
    looking.start()
    try:
        assert looks.wait(DEADLINE)
        hearing.start()
        hearing.join(DEADLINE)
        assert not hearing.is_alive()
    finally:
        has_looked.set()
        looking.join(DEADLINE)


def test_the_wanted_outcome_is_confirmed_and_another_one_forced(operator: ScriptedOperator, link: Link) -> None:
    link.show(replace(RUNNING, decisions=(PLAN,)))
    operator.choose(PLAN, 'done')
    operator.choose(PLAN, 'failed')
    assert [(command.kind, command.decision_id) for command in link.given] == [
        (CommandKind.CONFIRM, 'q2'),
        (CommandKind.FORCE, 'q2'),
    ]


def test_a_refused_command_is_an_error_with_its_reason(operator: ScriptedOperator, link: Link) -> None:
    link.code = ResultCode.REFUSED
    link.show(replace(RUNNING, decisions=(PLAN,)))
    with pytest.raises(DemoError, match='not now'):
        operator.choose(PLAN, 'done')


def test_a_behavior_that_ends_before_its_time_is_an_error_at_once(operator: ScriptedOperator, link: Link) -> None:
    link.show(replace(RUNNING, state=ExecutiveState.IDLE, outcome='error', message='boom'))
    with pytest.raises(DemoError, match=r"'error'.*boom"):
        operator.wait_state('/Drive', timeout=60.0)


def test_a_transition_that_nobody_expects_to_confirm_is_an_error_at_once(
    operator: ScriptedOperator, link: Link
) -> None:
    blocked = Decision('q3', DecisionKind.TRANSITION, path='/Recover', outcome='failed', required_autonomy=2)
    link.show(replace(RUNNING, decisions=(blocked,)))
    with pytest.raises(DemoError, match=r"/Recover waits.*'failed'"):
        operator.wait_decision(DecisionKind.INPUT, '/AskGoal', timeout=60.0)


def test_the_end_has_to_be_the_expected_one(operator: ScriptedOperator, link: Link) -> None:
    link.show(replace(RUNNING, state=ExecutiveState.IDLE, outcome='failed'))
    operator.wait_end('failed')
    with pytest.raises(DemoError, match="'failed', not by 'finished'"):
        operator.wait_end('finished')


def test_what_comes_from_another_thread_ends_a_wait(operator: ScriptedOperator, link: Link, track: RobotTrack) -> None:
    link.show(replace(RUNNING, active_states=(ActiveState('/Drive', activity=('Navigate/FollowPath',)),)))
    operator.wait_state('/Drive')
    operator.wait_tree_node('FollowPath')
    for seconds in (1.0, 2.0):
        track.add_pose(Pose(0.2 * seconds, 0.0, 0.0), seconds)
    rest = threading.Timer(0.05, track.add_pose, (Pose(0.4, 0.0, 0.0), 3.0))
    rest.start()
    operator.wait_rest()
    assert track.at_rest
    death = threading.Timer(0.05, operator.abandon, ('process navigation ended',))
    death.start()
    with pytest.raises(DemoError, match='process navigation ended'):
        operator.wait_state('/AskGoal', timeout=60.0)


def test_a_recovery_that_was_not_needed_is_an_error(operator: ScriptedOperator, link: Link, track: RobotTrack) -> None:
    link.show(replace(RUNNING, active_states=(ActiveState('/Drive'),)))
    track.add_begun('run', [3])  # before it is known which one that is
    track.add_tree('run', {2: 'Spin', 3: 'Recover'})
    operator.wait_begun('Recover')
    track.restart()
    link.show(replace(RUNNING, decisions=(QUESTION,)))
    with pytest.raises(DemoError, match="before the tree had begun 'Recover'"):
        operator.wait_begun('Recover')


@pytest.mark.parametrize(
    ('peer', 'told'),
    [(Peer('/navigation', False), 'NOT ALIVE'), (Peer('/navigation', True, ready=False), 'NOT READY')],
)
def test_readiness_needs_every_peer(operator: ScriptedOperator, link: Link, peer: Peer, told: str) -> None:
    link.show(replace(RUNNING, peers=(Peer('/bt_server', True), peer)))
    with pytest.raises(DemoError, match=f'/navigation {told}'):
        operator.wait_ready(peers=2, timeout=0.05)


def test_what_an_executive_has_said_is_told_once_also_after_it_was_started_again() -> None:
    mirror, stream = Mirror(ManualClock()), io.StringIO()
    mirror.add_listener(Narrator(mirror, Timeline(stream)))
    lines = [LogLine(executive, number, text=f'{executive}{number}') for executive in 'ab' for number in (2, 1, 3)]
    for line in lines:
        mirror.receive_log(line)
    assert [told.split()[-1] for told in stream.getvalue().splitlines()] == [line.text for line in lines]


def test_nothing_is_heard(operator: ScriptedOperator) -> None:
    with pytest.raises(DemoError, match='no executive is heard'):
        operator.wait_ready(peers=1, timeout=0.05)


def test_with_other_places_the_script_drives_to_those_away_from_the_robot(
    operator: ScriptedOperator, track: RobotTrack
) -> None:
    assert operator.places(['office', 'kitchen']) == ['office', 'kitchen']
    assert operator.places(['moon']) == ['kitchen']
    with pytest.raises(DemoError, match='2 places'):
        operator.places(['moon', 'sun'])
    track.add_pose(Pose(3.0, 4.0, 0.0), 1.0)
    assert operator.places(['moon']) == ['office']


def test_an_operator_starts_a_behavior_at_a_level(operator: ScriptedOperator, link: Link) -> None:
    link.show(replace(RUNNING, state=ExecutiveState.IDLE, run_id=''))
    operator.start('Navigate', AutonomyLevel.HIGH)
    assert (link.given[0].behavior, link.given[0].autonomy) == ('Navigate', 2)
