# SPDX-License-Identifier: BSD-3-Clause
"""The operator link and the node: heartbeat, rate, late joiners, peers, parameters, time, and the process itself."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.files import USER_DIRECTORY
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.lifecycle.managed_node import NodeScope
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.runtime import clock_watch
from flexbt_common.runtime.clock_watch import GOES_ON
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Progress
from flexbt_msgs.msg import (
    BehaviorList,
    BehaviorStructure,
    ExecutiveCommand,
    ExecutiveEvent,
    ExecutiveEvents,
    ExecutiveLog,
    ExecutiveStatus,
    PlaceList,
    QueueOptions,
    TreeBreakpoint,
    TreeDebugging,
    TreeHold,
)
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.status_publisher import BURST, MAXIMUM_RATE, StatusPublisher
from flexbt_onboard.node.executive_parameters import ExecutiveParameters, declare_parameters
from flexbt_onboard.node.executive_status import StatusPicture, StatusSources
from flexbt_onboard.runs import behavior_run
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until


class Hold(EventState):
    """Stays until it is forced."""

    def __init__(self) -> None:
        super().__init__(outcomes=['on'], desired_rate=None)


def circle() -> OperatableStateMachine:
    """Two states that lead to each other."""
    machine = OperatableStateMachine(outcomes=['never'])
    with machine:
        OperatableStateMachine.add('A', Hold(), {'on': 'B'})
        OperatableStateMachine.add('B', Hold(), {'on': 'A'})
    return machine


@pytest.fixture
def make_bench() -> Iterator[Callable[..., ExecutiveBench]]:
    """Make benches, and closes them."""
    benches: list[ExecutiveBench] = []

    def make(**options: Any) -> ExecutiveBench:
        benches.append(ExecutiveBench(behavior_of(circle), **options))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


Make = Callable[..., ExecutiveBench]


def test_a_status_that_cannot_be_made_is_followed_by_the_next(
    make_bench: Callable[..., ExecutiveBench], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench()
    picture, failures = StatusSources.picture, ['broken']

    def fail_once(self: StatusSources) -> StatusPicture:
        if failures:
            raise RuntimeError(failures.pop())
        return picture(self)

    monkeypatch.setattr(StatusSources, 'picture', fail_once)
    wait_until(lambda: not failures, 'the fault')
    bench.applied(ExecutiveCommand.AUTONOMY, autonomy=1)
    bench.wait_for(lambda status: status.autonomy == 1, 'what came after the fault')


class Sloppy(EventState):
    """Tells the operator values that are of no type of a message."""

    def __init__(self) -> None:
        super().__init__(outcomes=['on'], desired_rate=None)

    def on_enter(self, userdata: Any) -> None:
        told: Any = 5
        self.log_info(told)
        self.ask(told)

    def progress(self) -> Progress:
        figure: Any = numpy.float32(2.5)
        return Progress(distance=figure, poses=10**9, goal='there')


def sloppy() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Sloppy', Sloppy(), {'on': 'done'})
    return machine


def test_whatever_a_state_tells_the_status_is_sent() -> None:
    with contextlib.closing(ExecutiveBench(behavior_of(sloppy))) as bench:
        bench.start()
        (decision,) = bench.wait_for(lambda status: status.decisions, 'the question')
        assert decision.prompt == '5'
        (progress,) = bench.status.active_states[0].progress
        assert (progress.distance_remaining, progress.goal.header.frame_id) == (2.5, '')
        assert bench.logged('5').path == '/Sloppy'


def test_the_heartbeat_comes_within_the_period_that_it_promises(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=(), heartbeat_period=0.2))
    bench.wait_for_next_status()
    before, began = len(bench.statuses), uncontended_time()
    wait_until(lambda: len(bench.statuses) >= before + 5, 'five heartbeats')
    assert uncontended_time() - began < 5 * 0.4
    assert bench.status.heartbeat_period == pytest.approx(0.2)
    stamps = [status.stamp.sec + 1e-9 * status.stamp.nanosec for status in bench.statuses[before : before + 5]]
    assert min(later - earlier for earlier, later in pairwise(stamps)) > 0.15


def test_before_the_first_clock_message_everything_works_in_wall_time(make_bench: Make) -> None:
    bench = make_bench(
        ros_parameters={'use_sim_time': True}, parameters=ExecutiveParameters(peers=(), heartbeat_period=0.1)
    )
    before = bench.status.sequence
    bench.wait_for(lambda status: status.sequence > before + 2, 'heartbeats')
    assert bench.status.stamp.sec == 0
    bench.start()
    bench.wait_active('/A')
    bench.applied(ExecutiveCommand.STOP)
    assert bench.wait_idle() == 'preempted'


def clock_publisher(runtime: NodeRuntime) -> Any:
    return runtime.call(lambda: runtime.node.create_publisher(Clock, names.CLOCK, 10))


def tell_time(runtime: NodeRuntime) -> None:
    """Publish on /clock until the runtime ends."""
    publisher = clock_publisher(runtime)

    def publish() -> None:
        publisher.publish(Clock(clock=Time(sec=5)))
        runtime.steady.call_at(runtime.steady.now() + 0.05, publish)

    publish()


THIRTY_YEARS = 30 * 365 * 86_400
BAD_TIMES: dict[str, Callable[[int], list[Time]]] = {
    'negative': lambda number: [Time(sec=-3 - number)],
    'nanoseconds of more than a second': lambda number: [Time(sec=5, nanosec=4_000_000_000)],
    'thirty years to and fro': lambda number: [Time(sec=5 + number % 2 * THIRTY_YEARS, nanosec=number * 1000)],
    'two publishers': lambda number: [Time(sec=5, nanosec=number * 1000), Time(sec=9000, nanosec=number * 1000)],
    'back and on': lambda number: [Time(sec=1000 - number % 500)],
    'a flood': lambda number: [Time(sec=number, nanosec=part) for part in range(100)],
}


@pytest.mark.parametrize('kind', BAD_TIMES)
def test_bad_times_on_clock_keep_no_operator_from_stopping(make_bench: Make, kind: str) -> None:
    bench = make_bench(
        ros_parameters={'use_sim_time': True}, parameters=ExecutiveParameters(peers=(), heartbeat_period=0.1)
    )
    with contextlib.ExitStack() as stack:
        runtimes = [stack.enter_context(NodeRuntime.open(name)) for name in ('simulator', 'other')]
        publishers = [clock_publisher(runtime) for runtime in runtimes]
        wait_until(lambda: all(one.get_subscription_count() == 1 for one in publishers), 'the executive on /clock')
        publishers[0].publish(Clock(clock=Time(sec=4)))
        bench.start()
        bench.wait_active('/A')
        stopped = threading.Event()

        def publish() -> None:
            for number in itertools.count():
                for time_message, publisher in zip(BAD_TIMES[kind](number), itertools.cycle(publishers), strict=False):
                    publisher.publish(Clock(clock=time_message))
                if stopped.wait(0.001):
                    return

        thread = threading.Thread(target=publish)
        stack.callback(thread.join)
        stack.callback(stopped.set)
        thread.start()
        for number in range(15):
            bench.applied(ExecutiveCommand.NOTE, text=f'note {number}')  # log, events and status ask for the time
        sequence = bench.status.sequence
        bench.wait_for(lambda status: status.sequence > sequence, 'a heartbeat')
        bench.applied(ExecutiveCommand.STOP)
        assert bench.wait_idle() == 'preempted'
    faults = [line.text for line in bench.logs if line.severity >= ExecutiveLog.WARN and names.CLOCK not in line.text]
    assert len(faults) <= 1, faults


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_second_publisher_of_the_simulated_time_is_told(make_bench: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock_watch, 'LISTEN_SECONDS', 0.3)
    monkeypatch.setattr(clock_watch, 'PAUSE_SECONDS', 0.1)
    bench = make_bench(
        ros_parameters={'use_sim_time': True}, parameters=ExecutiveParameters(peers=(), heartbeat_period=0.1)
    )
    with contextlib.ExitStack() as stack:
        for name in ('simulator', 'bag', 'simulator'):
            tell_time(stack.enter_context(NodeRuntime.open(name)))
        bench.wait_for(lambda status: '3 publishers of /clock (/bag, 2 x /simulator)' in status.message, 'who they are')
    bench.wait_for(lambda status: 'publishers' not in status.message, 'the end of it')
    assert bench.logged('ROS_DOMAIN_ID').severity == ExecutiveLog.WARN


def test_simulated_time_that_nobody_publishes_is_in_status_log_and_diagnostics(make_bench: Make) -> None:
    bench = make_bench(ros_parameters={'use_sim_time': True}, parameters=ExecutiveParameters(peers=()))
    told: list[DiagnosticStatus] = []
    bench.console.call(
        lambda: bench.console.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda array: told.extend(array.status), 10
        )
    )
    bench.start()
    bench.wait_active('/A')
    bench.wait_for(lambda status: 'nobody publishes /clock' in status.message, 'what is wrong')
    assert bench.logged('nobody publishes /clock').severity == ExecutiveLog.WARN
    wait_until(
        lambda: [one for one in told if 'simulated time' in one.name and 'nobody publishes' in one.message],
        lambda: f'diagnostics; {told}',
    )
    publisher = clock_publisher(bench.console)

    def publish() -> bool:
        publisher.publish(Clock(clock=bench.console.clock.stamp()))
        return not bench.status.message

    wait_until(publish, 'nothing is wrong any more')
    assert bench.logged(GOES_ON).severity == ExecutiveLog.INFO


def test_a_late_console_has_the_whole_picture(make_bench: Make, tmp_path: Path) -> None:
    file = tmp_path / 'places.yaml'
    file.write_text('kitchen: {x: 1, y: 2.5, yaw: 1.5707963}\ndock: {x: 0, y: 0, frame: odom}\n')
    with NodeRuntime.open('executive', parameters={'places': str(file)}) as runtime:
        places = runtime.call(lambda: declare_parameters(runtime.node)).places
    bench = make_bench(parameters=ExecutiveParameters(peers=(), places=places))
    run_id = bench.start()
    bench.wait_active('/A')
    late = NodeRuntime('late_console', args=())
    seen: dict[str, Any] = {}
    try:

        def subscribe() -> None:
            for type, topic in (
                (ExecutiveStatus, names.EXECUTIVE_STATUS),
                (BehaviorStructure, names.EXECUTIVE_STRUCTURE),
                (BehaviorList, names.EXECUTIVE_BEHAVIORS),
                (ExecutiveLog, names.EXECUTIVE_LOG),
                (PlaceList, names.PLACES),
            ):
                late.node.create_subscription(
                    type,
                    topic,
                    lambda message, topic=topic: seen.setdefault(topic, message),
                    names.transient_local_qos(50),
                )

        late.call(subscribe)
        wait_until(lambda: len(seen) == 5, lambda: f'five latched messages, have {list(seen)}')
        assert seen[names.EXECUTIVE_STATUS].run_id == run_id
        assert seen[names.EXECUTIVE_STRUCTURE].run_id == run_id
        assert [manifest.name for manifest in seen[names.EXECUTIVE_BEHAVIORS].behaviors] == ['Test']
        dock, kitchen = seen[names.PLACES].places
        assert (dock.name, dock.pose.header.frame_id) == ('dock', 'odom')
        assert (kitchen.name, kitchen.pose.pose.position.y) == ('kitchen', 2.5)
        assert kitchen.pose.pose.orientation.z == pytest.approx(0.5**0.5)
    finally:
        late.close()


def test_a_late_console_gets_the_latest_transitions_and_the_commands_of_all_operators(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=()))
    bench.start()
    bench.wait_active('/A')
    for path in ('/A', '/B', '/A'):
        bench.applied(ExecutiveCommand.FORCE, path=path, outcome='on', operator_id='ann')
    bench.applied(ExecutiveCommand.NOTE, text='all is well', operator_id='ann', decision_id='input-7')
    bench.refused(ExecutiveCommand.FORCE, path='/A', outcome='off', operator_id='ann')
    with NodeRuntime.open('late_console') as late:
        batches: list[ExecutiveEvents] = []

        def numbered() -> dict[int, ExecutiveEvent]:
            return {batch.first + place: event for batch in batches for place, event in enumerate(batch.events)}

        late.call(
            lambda: late.node.create_subscription(
                ExecutiveEvents, names.EXECUTIVE_EVENTS, batches.append, names.transient_local_qos(names.EVENTS_DEPTH)
            )
        )
        # START, three times a FORCE with its transition, NOTE, and the FORCE that is refused
        wait_until(lambda: sorted(numbered()) == list(range(1, 10)), numbered)
        told = [(event.kind, event.path, event.outcome, event.target) for event in numbered().values()]
        assert told.count((ExecutiveEvent.TRANSITION, '/A', 'on', '/B')) == 2
        commands = [event for event in numbered().values() if event.kind == ExecutiveEvent.COMMAND]
        assert [(event.operator_id, event.command, event.applied) for event in commands][-2:] == [
            ('ann', 'NOTE', True),
            ('ann', 'FORCE', False),
        ]
        assert [event.target for event in commands] == ['Test', '', '', '', 'Test', '']  # where no path tells it
        assert (commands[-2].text, commands[-2].decision_id) == ('all is well', 'input-7')
        assert 'not active' in commands[-1].reason


def test_peers_are_shown_and_their_changes_are_told(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('bt_server', '/other/navigation')))
    assert [(peer.name, peer.alive) for peer in bench.status.peers] == [
        ('/bt_server', False),
        ('/other/navigation', False),
    ]
    server = NodeRuntime('bt_server', args=())
    try:
        LivelinessToken(server)
        bench.wait_for(lambda status: status.peers[0].alive, 'alive')
        bench.logged('/bt_server is alive')
    finally:
        server.close()
    begin = uncontended_time()
    bench.wait_for(lambda status: not status.peers[0].alive, 'gone')
    assert uncontended_time() - begin < 3.0
    assert bench.logged('/bt_server is not alive any more').severity == ExecutiveLog.ERROR
    assert 'restart it' in bench.status.peers[0].problem
    assert not bench.status.peers[1].alive


def test_a_peer_that_hangs_is_gone_after_the_time_that_was_set(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('bt_server',), peer_timeout=1.0))
    go_on = threading.Event()
    with NodeRuntime.open('bt_server') as server:
        LivelinessToken(server)
        bench.wait_for(lambda status: status.peers[0].alive, 'alive')
        server.post(lambda: go_on.wait(DEADLINE))
        bench.wait_for(lambda status: not status.peers[0].alive, 'gone')
        go_on.set()
        bench.wait_for(lambda status: status.peers[0].alive, 'alive again')
    # By default it would have been told as late before: that is told sooner than it would have been gone.
    bench.logged('/bt_server is not alive any more')
    assert not [line for line in bench.logs if 'is late' in line.text]


def test_the_level_that_a_console_starts_with_is_a_parameter(make_bench: Make) -> None:
    assert make_bench(parameters=ExecutiveParameters(peers=(), autonomy=3)).status.autonomy == 3


def asking() -> OperatableStateMachine:
    """Its state wants to be left at once, and the operator is asked."""

    class Done(Hold):
        def execute(self, userdata: Any) -> str:
            return 'on'

    machine = OperatableStateMachine(outcomes=['on'])
    with machine:
        OperatableStateMachine.add('A', Done(), {'on': 'on'}, autonomy={'on': Autonomy.Full})
    return machine


def test_a_decision_names_the_server_that_has_died_and_what_to_do() -> None:
    bench = ExecutiveBench(behavior_of(asking), parameters=ExecutiveParameters(peers=('bt_server', 'never_there')))
    try:
        with NodeRuntime.open('bt_server') as server:
            LivelinessToken(server).set_ready(True)
            bench.wait_for(lambda status: status.peers[0].ready, 'ready')
            bench.start()
            bench.wait_for(lambda status: status.decisions, 'the decision')
            assert bench.status.decisions[0].prompt == ''
        bench.wait_for(lambda status: status.decisions[0].prompt, 'what has died')
        assert bench.status.decisions[0].prompt == '/bt_server is gone: restart it, or force an outcome'
        with NodeRuntime.open('bt_server') as server:
            LivelinessToken(server).set_ready(True)
            bench.wait_for(lambda status: not status.decisions[0].prompt, 'it is back')
    finally:
        bench.close()


def test_a_node_of_the_default_is_expected_once_it_was_seen(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters())
    assert [(peer.alive, peer.expected) for peer in bench.status.peers] == [(False, False)] * len(bench.status.peers)
    with NodeRuntime.open('simulator') as runtime:
        LivelinessToken(runtime)
        bench.wait_for(lambda status: any(peer.expected for peer in status.peers), 'seen')
    bench.wait_for(lambda status: any(peer.expected and not peer.alive for peer in status.peers), 'missed')
    assert [peer.name for peer in bench.status.peers if peer.expected] == ['/simulator']


def test_a_node_that_was_named_is_expected_at_once(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('never_there',)))
    assert [(peer.alive, peer.expected) for peer in bench.status.peers] == [(False, True)]


def test_why_the_pose_is_not_known_is_told(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('localization',), pose_topic='robot/pose'))
    assert bench.status.pose_problem == 'nobody publishes /robot/pose'
    with NodeRuntime.open('localization') as runtime:
        token = LivelinessToken(runtime)
        publisher = runtime.call(lambda: runtime.node.create_publisher(PoseStamped, 'robot/pose', 1))
        bench.wait_for(lambda status: status.pose_problem == 'nothing came on /robot/pose yet', 'a publisher')
        wait_until(publisher.get_subscription_count, 'subscribed')
        publisher.publish(PoseStamped())
        bench.wait_for(lambda status: status.pose_problem == '', 'known')
        token.remove_name('/localization')  # it was killed, and the middleware has not missed its publisher yet
        bench.wait_for(lambda status: status.pose_problem == 'nobody publishes /robot/pose any more', 'gone')
        token.add_name('/localization')
        bench.wait_for(lambda status: status.pose_problem == '', 'known again')
    bench.wait_for(lambda status: status.pose_problem == 'nobody publishes /robot/pose any more', 'old')


def test_every_field_of_the_status_is_told() -> None:
    def nested() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['on'])
        with machine:
            OperatableStateMachine.add('Inner', asking(), {'on': 'on'})
        return machine

    parameters = ExecutiveParameters(peers=('never_there',), pose_topic='robot/pose')
    with contextlib.closing(ExecutiveBench(behavior_of(nested), parameters=parameters)) as bench:
        assert bench.status.robot_pose.header.frame_id == ''
        publisher = bench.console.call(lambda: bench.console.node.create_publisher(PoseStamped, 'robot/pose', 1))
        wait_until(publisher.get_subscription_count, 'subscribed')
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x = 'map', 1.5
        publisher.publish(pose)
        bench.wait_for(lambda status: status.robot_pose == pose, 'pose')
        bench.start(autonomy=2)
        bench.wait_for(lambda status: status.decisions, 'the decision')
        bench.applied(ExecutiveCommand.STEP_INTO, decision_id=bench.status.decisions[0].id)
        bench.wait_for(lambda status: status.step, 'the step')
        once = [QueueOptions(on_failure=QueueOptions.HOLD)]
        bench.applied(ExecutiveCommand.QUEUE_ADD, behavior=bench.status.behavior, run_id='', queue_options=once)
        bench.applied(ExecutiveCommand.LOCK, path='/Inner/A')
        bench.applied(ExecutiveCommand.BREAKPOINT, path='/Inner/A')
        bench.applied(ExecutiveCommand.AUTONOMY, path='/Inner', autonomy=1)
        debugging = TreeDebugging(breakpoints=[TreeBreakpoint(path='a')], holds=[TreeHold(path='a')])
        qos = names.transient_local_qos()
        debugger = bench.console.call(
            lambda: bench.console.node.create_publisher(TreeDebugging, names.TREE_DEBUGGING, qos)
        )
        debugger.publish(debugging)
        bench.wait_for(lambda status: status.tree_breakpoints and status.tree_holds, 'what was set at trees')
        for operator in ('ann', 'bob'):
            bench.applied(ExecutiveCommand.CLAIM_AUTHORITY, operator_id=operator)
        bench.wait_for(lambda status: status.authority_requests, 'the request')
        bench.applied(ExecutiveCommand.STOP, operator_id='ann')
        bench.wait_idle()
        bench.wait_for(lambda status: status.queue_held, 'the queue held')
        bench.applied(ExecutiveCommand.QUEUE_RELEASE, run_id='', queue_number=1, operator_id='ann')
        bench.wait_for(lambda status: status.queue_entry, 'the entry that runs')
        told, nothing = list(bench.statuses), ExecutiveStatus()
        for field in ExecutiveStatus.get_fields_and_field_types():
            assert any(getattr(status, field) != getattr(nothing, field) for status in told), field


@pytest.fixture
def server() -> Iterator[LivelinessToken]:
    """Yield a node that is alive, and not ready."""
    with NodeRuntime.open('bt_server') as runtime:
        yield LivelinessToken(runtime)


def test_a_start_waits_for_a_node_that_is_alive_and_not_ready(make_bench: Make, server: LivelinessToken) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('bt_server', 'never_there')))
    bench.wait_for(lambda status: status.peers[0].alive, 'alive')
    assert not bench.status.peers[0].ready
    bench.start()  # is answered at once
    bench.logged('waits until /bt_server is ready')
    assert (bench.status.state, bench.status.active_states) == (ExecutiveStatus.STARTING, [])
    server.set_ready(True)
    bench.wait_active('/A')
    assert bench.status.state == ExecutiveStatus.RUNNING
    assert bench.status.peers[0].ready
    server.set_ready(False)
    bench.wait_for(lambda status: not status.peers[0].ready, 'not ready')
    assert bench.status.peers[0].alive
    assert bench.logged('/bt_server is alive, but not ready any more').severity == ExecutiveLog.WARN


def test_a_start_that_waits_can_be_stopped(make_bench: Make, server: LivelinessToken) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=('bt_server',)))
    bench.wait_for(lambda status: status.peers[0].alive, 'alive')
    bench.start()
    bench.logged('waits until /bt_server is ready')
    assert 'waits until /bt_server is ready' in bench.refused(ExecutiveCommand.AUTONOMY, autonomy=1)
    assert 'is starting' in bench.refused(ExecutiveCommand.PAUSE)
    bench.applied(ExecutiveCommand.STOP)
    assert bench.wait_idle() == 'preempted'


def test_a_start_does_not_wait_without_end(
    make_bench: Make, server: LivelinessToken, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(behavior_run, 'READY_SECONDS', 0.2)
    bench = make_bench(parameters=ExecutiveParameters(peers=('bt_server',)))
    bench.wait_for(lambda status: status.peers[0].alive, 'alive')
    bench.start()
    assert bench.logged('begins all the same: /bt_server not ready').severity == ExecutiveLog.WARN


def test_a_command_has_its_effect_within_milliseconds(make_bench: Make) -> None:
    bench = make_bench(parameters=ExecutiveParameters(peers=(), heartbeat_period=0.2))
    bench.start()
    bench.wait_active('/A')
    latencies = []
    for number in range(10):
        path, other = ('/A', '/B') if number % 2 == 0 else ('/B', '/A')
        count = len(bench.statuses)
        begin = uncontended_time()
        id = bench.send(ExecutiveCommand.FORCE, path=path, outcome='on')

        def arrived(count: int = count, id: str = id, other: str = other) -> bool:
            return any(
                [state.path for state in status.active_states] == [other]
                and id in [result.command_id for result in status.results]
                for status in bench.statuses[count:]
            )

        wait_until(arrived, f'effect of {id}')
        latencies.append(uncontended_time() - begin)
        # Quiet for a moment, as operators are: the rate of messages is limited.
        bench.wait_for_next_status()
    assert median(latencies) < 0.05, latencies


def test_changes_that_come_fast_are_put_together() -> None:
    sent: list[float] = []

    class Publisher(StatusPublisher):
        def send(self) -> None:
            sent.append(time.monotonic())

    with NodeRuntime.open('publisher') as runtime:
        publisher = runtime.call(lambda: Publisher(runtime, 10.0))
        begin, uncontended = time.monotonic(), uncontended_time()
        publisher.changed()
        wait_until(lambda: sent, 'the first at once')
        assert uncontended_time() - uncontended < 1 / MAXIMUM_RATE
        while len(sent) < BURST + 5:
            assert time.monotonic() - begin < DEADLINE
            publisher.changed()
            time.sleep(0.001)
        last = time.monotonic()
        publisher.changed()
        wait_until(lambda: sent[-1] >= last, 'the last change is sent as well')
        assert len(sent) <= BURST + 2 + MAXIMUM_RATE * (sent[-1] - begin)


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'heartbeat_period': 0.0}, 'heartbeat_period'),
        ({'heartbeat_period': 'often'}, 'heartbeat_period'),
        ({'autonomy': 4}, 'autonomy'),
        ({'pose_topic': 'two words'}, "parameter 'pose_topic': 'two words' is not a name in ROS 2; write letters"),
        ({'peers': ['bt server']}, "parameter 'peers': 'bt server' is not a name in ROS 2; write letters"),
        ({'places': '/nowhere/places.yaml'}, 'parameter places: places file /nowhere/places.yaml'),
    ],
)
def test_wrong_parameters_are_refused_by_name(parameters: dict[str, Any], words: str) -> None:
    with (
        NodeRuntime.open('executive', parameters=parameters) as runtime,
        pytest.raises(FlexbtError, match=words),
    ):
        runtime.call(lambda: declare_parameters(runtime.node))


def test_parameters_are_described_and_have_their_defaults() -> None:
    given = {'peers': ['a', ''], 'peer_timeout': 7.0, 'autonomy': 3}
    with NodeRuntime.open('executive', parameters=given) as runtime:
        values = runtime.call(lambda: declare_parameters(runtime.node))
        own = f'{USER_DIRECTORY}/domain_{runtime.node.context.get_domain_id()}'  # two executives never share a file
        assert values == ExecutiveParameters(
            peers=('a',), peer_timeout=7.0, autonomy=3, event_log_directory=own, machine_directory=f'{own}/machines'
        )
        for name in ('peers', 'pose_topic', 'heartbeat_period', 'autonomy'):
            descriptor = runtime.node.describe_parameter(name)
            assert descriptor.description
            assert descriptor.read_only


BEHAVIORS = """
import pathlib
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine

class Hold(EventState):
    def __init__(self):
        super().__init__(outcomes=['on'], desired_rate=None)
    def on_exit(self, userdata):
        pathlib.Path(__file__).with_name('left').write_text(str(self.exit_reason))

class Held(Behavior):
    manifest = BehaviorManifest('Held')
    def create(self):
        machine = OperatableStateMachine(outcomes=['on'])
        with machine:
            OperatableStateMachine.add('Hold', Hold(), {'on': 'on'})
        return machine
"""


@pytest.mark.dds('the executive is a process, which a signal ends')
@pytest.mark.parametrize('signal_number', [signal.SIGINT, signal.SIGTERM])
def test_the_process_lists_a_broken_behavior_runs_another_and_ends_in_order(tmp_path: Path, signal_number: int) -> None:
    info = tmp_path / 'held-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: held\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text('[flexbt.behaviors]\nheld = held:Held\nbroken = missing_module:Broken\n')
    (tmp_path / 'held.py').write_text(BEHAVIORS)
    environment = {**os.environ, 'PYTHONPATH': f'{tmp_path}:{os.environ.get("PYTHONPATH", "")}'}
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexbt_onboard.node.onboard_executive', '--ros-args', '-r', '__ns:=/robot'],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    console = NodeRuntime('console', args=(), namespace='/robot')
    try:
        statuses: list[ExecutiveStatus] = []
        lists: list[BehaviorList] = []

        def link() -> Any:
            node = console.node
            node.create_subscription(
                ExecutiveStatus, names.EXECUTIVE_STATUS, statuses.append, names.transient_local_qos()
            )
            node.create_subscription(BehaviorList, names.EXECUTIVE_BEHAVIORS, lists.append, names.transient_local_qos())
            return node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos())

        commands = console.call(link)
        wait_until(lambda: statuses and lists and commands.get_subscription_count(), 'link up')
        errors = {manifest.name: manifest.error for manifest in lists[-1].behaviors}
        assert errors['Held'] == ''
        assert 'missing_module' in errors['broken']
        commands.publish(ExecutiveCommand(id='1', kind=ExecutiveCommand.START, behavior='Held', autonomy=3))
        wait_until(lambda: statuses[-1].active_states, lambda: f'running; {statuses[-1]}')
        assert not (tmp_path / 'left').exists()
        begin = uncontended_time()
        process.send_signal(signal_number)
        _, stderr = process.communicate(timeout=DEADLINE)
        assert uncontended_time() - begin < 2.0
        assert process.returncode == 0
        assert 'Traceback' not in stderr
        assert 'PREEMPTED' in (tmp_path / 'left').read_text()
        wait_until(lambda: statuses[-1].state == ExecutiveStatus.IDLE, 'last status')
    finally:
        process.kill()
        process.wait()
        console.close()


@pytest.mark.dds('a thread never waits, and is interrupted by the interpreter')
def test_who_logs_while_the_executive_ends_is_not_disturbed() -> None:
    """A run may be left behind, which knows nothing of the end."""
    faults: list[BaseException] = []
    is_over = threading.Event()
    with NodeRuntime.open('node') as runtime:
        for _ in range(5):
            scope = NodeScope(runtime)
            link = runtime.call(partial(ConsoleLink, scope, 'id', 1.0))

            def log(link: ConsoleLink = link) -> None:
                try:
                    while not is_over.is_set():
                        link.log(ExecutiveLog.DEBUG, 'still here')
                except BaseException as error:
                    faults.append(error)

            threads = [threading.Thread(target=log) for _ in range(3)]
            is_over.clear()
            for thread in threads:
                thread.start()
            scope.close()
            is_over.set()
            for thread in threads:
                thread.join()
    assert not faults


def test_a_topic_whose_ends_do_not_fit_is_told_to_the_operator(make_bench: Make) -> None:
    bench = make_bench()
    node = bench.runtime.node
    with NodeRuntime.open('camera') as camera:
        camera.call(lambda: camera.node.create_publisher(Empty, 'seen', qos_profile_sensor_data))
        bench.runtime.call(lambda: node.create_subscription(Empty, 'seen', lambda _: None, 1))
        line = bench.logged("No messages on '/seen'")
    assert line.severity == ExecutiveLog.WARN
