# SPDX-License-Identifier: BSD-3-Clause
"""What an operator is asked to judge: latched for consoles that come late, within bounds, again after a crash; and the
plan that the robot follows."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path as FilePath
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.decision_subject import subject_message
from flexbt_common.values.entries import from_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import (
    BlackboardEntry,
    DecisionSubject,
    DecisionSubjects,
    ExecutiveCommand,
    PendingDecision,
    RobotPlan,
)
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until


def path_of(count: int, frame: str = 'map') -> Path:
    """Return a straight path of so many poses, 5 cm from one to the next."""
    path = Path()
    path.header.frame_id = frame
    for number in range(count):
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x = frame, 0.05 * number
        path.poses.append(pose)
    return path


class Plan(EventState):
    """Makes a path of so many poses, of one more the next time, and a number that is about something else."""

    def __init__(self, count: int) -> None:
        super().__init__(outcomes=['done'], output_keys=['path', 'charge'], desired_rate=None)
        self._count = count

    def execute(self, userdata: UserData) -> str:
        userdata.path, userdata.charge = path_of(self._count), 0.5
        self._count += 1
        return 'done'


class Judge(EventState):
    """Lets the operator choose, on what it reads, if it reads anything."""

    def __init__(self, *keys: str) -> None:
        super().__init__(outcomes=['good', 'bad'], input_keys=keys, desired_rate=None)

    def on_enter(self, userdata: UserData) -> None:
        self.ask('Is it good?', 'good')


def judging(*keys: str, count: int = 200) -> Callable[[], OperatableStateMachine]:
    """Plan, and judge what is named."""

    def create() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['end'])
        with machine:
            OperatableStateMachine.add('Plan', Plan(count), {'done': 'Judge'})
            OperatableStateMachine.add(
                'Judge', Judge(*keys), {'good': 'end', 'bad': 'Plan'}, autonomy={'good': Autonomy.Full}
            )
        return machine

    return create


Opened = Callable[..., ExecutiveBench]


@pytest.fixture
def open_bench() -> Iterator[Opened]:
    """Open executives for behaviors, and close them in the end."""
    with contextlib.ExitStack() as stack:

        def open(make: Callable[[], OperatableStateMachine], **options: Any) -> ExecutiveBench:
            return stack.enter_context(contextlib.closing(ExecutiveBench(behavior_of(make), **options)))

        yield open


def asked(bench: ExecutiveBench) -> PendingDecision:
    """Return the decision that waits, with what it is about."""
    bench.wait_for(lambda status: status.decisions and status.decisions[0].subject_number, 'asked')
    return bench.status.decisions[0]


@contextlib.contextmanager
def late_reader(type: type[Any], topic: str) -> Iterator[list[Any]]:
    """Provide what somebody gets who subscribes now."""
    heard: list[Any] = []
    with NodeRuntime.open('late_console') as late:
        late.call(lambda: late.node.create_subscription(type, topic, heard.append, names.transient_local_qos()))
        yield heard


def late_subject(decision: PendingDecision) -> DecisionSubject:
    """Return what a console gets of a decision that comes while it waits."""
    with late_reader(DecisionSubjects, names.EXECUTIVE_SUBJECTS) as heard:

        def found() -> list[DecisionSubject]:
            return [one for message in heard for one in message.subjects if one.id == decision.id]

        wait_until(lambda: any(one.number == decision.subject_number for one in found()), lambda: f'have {heard}')
        return next(one for one in found() if one.number == decision.subject_number)


def test_a_console_that_comes_late_gets_what_is_to_be_judged(open_bench: Opened) -> None:
    bench = open_bench(judging('path'))
    bench.start(autonomy=1)
    decision = asked(bench)
    assert list(decision.subject) == ['path']
    subject = late_subject(decision)
    (entry,) = subject.entries
    assert (entry.key, entry.type) == ('path', 'nav_msgs/msg/Path')
    assert from_entry(entry) == path_of(200)
    bench.applied(ExecutiveCommand.CONFIRM, decision_id=decision.id)
    bench.wait_idle()
    with late_reader(DecisionSubjects, names.EXECUTIVE_SUBJECTS) as heard:
        wait_until(lambda: heard and not heard[-1].subjects, lambda: f'nothing is asked any more; have {heard}')


def test_a_state_that_reads_nothing_is_asked_about_all_that_its_machine_knows(open_bench: Opened) -> None:
    bench = open_bench(judging())
    bench.start(autonomy=1)
    decision = asked(bench)
    assert list(decision.subject) == ['path', 'charge']  # what can be drawn comes first
    assert [entry.text for entry in late_subject(decision).entries] == ['', '0.5']


def test_a_path_of_10_megabytes_is_shown_by_fewer_poses_and_that_is_told(open_bench: Opened) -> None:
    bench = open_bench(judging('path', count=130_000))
    bench.start(autonomy=1)
    subject = late_subject(asked(bench))
    shown = from_entry(subject.entries[0])
    assert len(shown.poses) <= 500
    assert shown.poses[-1].pose.position.x == pytest.approx(0.05 * 129_999)
    assert list(subject.notes) == ['path: 500 of 130000 poses'.replace('500', str(len(shown.poses)))]


def test_what_is_asked_anew_after_a_crash_is_shown_anew(open_bench: Opened, tmp_path: FilePath) -> None:
    parameters = ExecutiveParameters(peers=(), journal_directory=str(tmp_path))
    with contextlib.closing(ExecutiveBench(behavior_of(judging('path')), parameters=parameters)) as before:
        before.start(autonomy=1)
        asked(before)
        saved = {file: file.read_bytes() for file in tmp_path.iterdir()}
    for file, content in saved.items():  # as a crash leaves it
        file.write_bytes(content)
    bench = open_bench(judging('path'), parameters=parameters)
    bench.applied(ExecutiveCommand.RESUME_RUN)
    assert from_entry(late_subject(asked(bench)).entries[0]) == path_of(200)


def test_an_input_request_is_shown_with_what_it_is_about(open_bench: Opened) -> None:
    bench = open_bench(judging('path'))
    action = bench.console.node
    from rclpy.action import ActionClient

    client = bench.console.call(lambda: ActionClient(action, OperatorInput, names.OPERATOR_INPUT))
    wait_until(client.server_is_ready, 'the server')
    subject = subject_message('', 0, {'path': path_of(3)}, ['charge'])
    bench.console.call(lambda: client.send_goal_async(OperatorInput.Goal(prompt='?', type='bool', subject=subject)))
    told = late_subject(asked(bench))
    assert (from_entry(told.entries[0]), list(told.notes)) == (path_of(3), ['charge has no value'])
    large = DecisionSubject(entries=[BlackboardEntry(key='x', type='string', text='x' * 200_000)])
    sent = bench.console.call(
        lambda: client.send_goal_async(OperatorInput.Goal(prompt='?', type='bool', subject=large))
    )
    wait_until(sent.done, 'answered')
    result = bench.console.call(lambda: sent.result().get_result_async())
    wait_until(result.done, 'ended')
    assert 'at most 128000 are shown' in result.result().result.message


def test_values_without_bound_and_without_type_are_shown_in_short() -> None:
    class Driver:
        def __repr__(self) -> str:
            raise RuntimeError

        @property
        def poses(self) -> list[float]:
            raise RuntimeError

    values = {
        'driver': Driver(),
        'list': [[0] * 1000] * 1000,
        'text': 'x' * 10_000_000,
        'nested': {'a': [1, 2]},
        'number': 3,
    }
    subject = subject_message('d', 1, values)
    assert sum(len(entry.text) + len(entry.data) for entry in subject.entries) < 1000
    assert {note.partition(' ')[0] for note in subject.notes} == {'list', 'text'}
    (note,) = subject_message('d', 1, {'path': path_of(700)}).notes
    assert note == 'path: 351 of 700 poses'
    many = subject_message('d', 1, {f'k{number}': number for number in range(30)})
    assert (len(many.entries), len(many.notes)) == (20, 1)
    assert many.notes[0].startswith('10 values not shown: ')


def test_a_plan_is_kept_for_consoles_that_come_late_and_forgotten_with_the_next_run(open_bench: Opened) -> None:
    bench = open_bench(judging('path'))
    publisher = bench.console.call(lambda: bench.console.node.create_publisher(Path, names.PLAN, 1))
    wait_until(publisher.get_subscription_count, 'the executive hears it')
    publisher.publish(path_of(20_000))
    with late_reader(RobotPlan, names.EXECUTIVE_PLAN) as heard:
        wait_until(lambda: heard and len(heard[-1].x), 'the plan')
        plan = heard[-1]
        assert (plan.frame_id, len(plan.x) <= 500, len(plan.x) == len(plan.y)) == ('map', True, True)
        assert (plan.x[0], plan.x[-1]) == (0.0, pytest.approx(0.05 * 19_999))
        publisher.publish(path_of(60_000))  # more than there is time for
        wait_until(lambda: not heard[-1].x, 'no plan, and not the one before')

        def is_shown(y: float) -> bool:
            path, before = path_of(3), len(heard)
            path.poses[1].pose.position.y = y
            publisher.publish(path)
            wait_until(lambda: len(heard) > before, 'what the plan is now')
            return bool(heard[-1].x)

        assert not is_shown(math.nan)
        assert not is_shown(1e300)  # infinite in the message to the consoles
        publisher.publish(path_of(3))
        wait_until(lambda: len(heard[-1].x) == 3, 'the next plan')
        before = len(heard)
        bench.start(autonomy=1)
        # What is judged: no planner has published it. That there is no plan before may be replaced on its way.
        wait_until(lambda: len(heard[-1].x) == 200, lambda: f'have {[len(plan.x) for plan in heard]}')
        assert not any(plan.x for plan in heard[before:-1])
        decision = bench.wait_for(lambda status: status.decisions, 'decision')[0]
        bench.applied(ExecutiveCommand.FORCE, path=decision.path, decision_id=decision.id, outcome='bad')
        wait_until(lambda: len(heard[-1].x) == 201, 'the next that is judged, and not the one that was refused')
