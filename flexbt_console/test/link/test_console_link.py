# SPDX-License-Identifier: BSD-3-Clause
"""The operator link on real topics: late join, loss, restart, and what is said when there is nobody."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.action import ActionServer, CancelResponse
from rclpy.serialization import serialize_message
from simulation_interfaces.msg import Result as SimulationResult
from simulation_interfaces.srv import DeleteEntity, SpawnEntity

from flexbt_common import names
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received, reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import NoAnswerError, NoLinkError, RefusedError
from flexbt_console.link import executive_sender, fleet_link, simulator_link, surroundings_link
from flexbt_console.link.executive_sender import interface_problem
from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.link.queries import SynthesisQuery
from flexbt_console.link.simulator_link import SimulatorLink
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    AutonomyLevel,
    CommandKind,
    ExecutiveSnapshot,
    OperatorCommand,
    SynthesisRequest,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.style import ASCII
from flexbt_console.present.tree_lines import tree_lines
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_msgs.msg import (
    BehaviorList,
    BehaviorStructure,
    ExecutiveCommand,
    ExecutiveEvents,
    ExecutiveLog,
    ExecutiveStatus,
    Place,
    PlaceList,
    TreeNode,
    TreeStatus,
    TreeStructure,
)
from flexbt_testing.lock_order import unwatched_locks
from flexbt_testing.nodes.oversized import oversized
from flexbt_testing.nodes.scripted_executive import Faults, ScriptedExecutive
from flexbt_testing.waiting import DEADLINE, held, uncontended_time, wait_until


def test_a_process_with_many_names_keeps_no_other_robot_out_and_is_forgotten(
    executives: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_link, 'MOST_ROBOTS', 6)
    with NodeRuntime.open('console') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')

        def known() -> set[str]:
            return {*robots.fleet.names}

        with NodeRuntime.open('forger') as forger:
            node, kind = forger.node, ExecutiveStatus
            for number in range(20):
                topic = f'/forged{number}/{names.EXECUTIVE_STATUS}'
                status = kind(executive_id=str(number), sequence=1, heartbeat_period=1.0)
                forger.call(partial(node.create_publisher, kind, topic, names.transient_local_qos())).publish(status)
            wait_until(lambda: len(known()) == 6 and robots.fleet.left_out == 14, 'as many as there may be')
            robot = executives('robot')
            wait_until(lambda: '/robot' in known(), 'the robot')
            assert len(known()) == 6
            assert robots.robot('/robot')[1].live_view(DEADLINE)
            chosen = next(iter(known() - {'/robot'}))
            robots.select(chosen)
        monkeypatch.setattr(fleet_link, 'FORGET_SECONDS', 0.0)
        wait_until(lambda: known() == {'/robot', chosen}, 'only who is there, and who was chosen')

        def heard() -> set[str]:
            joined = runtime.node.get_subscriber_names_and_types_by_node('console', '/')
            return {topic.split('/')[1] for topic, _ in joined if topic.startswith('/forged')}

        wait_until(lambda: heard() == {chosen.strip('/')}, 'nothing is left of those that are forgotten')
        assert not robot.received


def test_a_namespace_with_no_room_for_the_topics_of_a_robot_keeps_no_other_one_out(executives: Any) -> None:
    with NodeRuntime.open('console') as runtime, NodeRuntime.open('forger') as forger:
        length = 247 - len(f'//{names.EXECUTIVE_STATUS}')  # which is what ROS allows
        topic = f'/{"x" * length}/{names.EXECUTIVE_STATUS}'
        node, qos = forger.node, names.transient_local_qos()
        forger.call(lambda: node.create_publisher(ExecutiveStatus, topic, qos))
        wait_until(lambda: runtime.node.count_publishers(topic) > 0, 'the status under a long name')
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')
        executives('robot')
        wait_until(lambda: '/robot' in robots.fleet.names, 'the robot')


def test_one_fault_of_a_look_for_robots_does_not_end_the_looks(
    executives: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with NodeRuntime.open('console') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')
        join, failed = robots._join, threading.Event()

        def join_later(name: str) -> ExecutiveLink:
            if not failed.is_set():
                failed.set()
                raise RuntimeError('no endpoint is left')
            return join(name)

        monkeypatch.setattr(robots, '_join', join_later)
        executives('robot')
        wait_until(lambda: '/robot' in robots.fleet.names, 'the robot')
        assert failed.is_set()


def test_of_a_robot_that_nobody_has_opened_only_the_status_is_heard(executives: Any) -> None:
    executives('robot').do(lambda: None)
    with NodeRuntime.open('console') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')
        wait_until(lambda: '/robot' in robots.fleet.names, 'the robot')
        mirror, link = robots.robot('/robot')
        assert link.live_view(DEADLINE).behaviors is None
        assert not runtime.node.get_subscriptions_info_by_topic('/robot/executive/behaviors')
        robots.open('/robot')
        wait_until(lambda: mirror.view().behaviors is not None, 'the behaviors')


def test_of_a_tree_that_is_too_large_the_first_nodes_are_kept_and_how_many_are_left_out() -> None:
    mirror, more = Mirror(ManualClock()), 7
    size = surroundings_link.MOST_TREE_NODES + more
    nodes = [TreeNode(uid=uid, parent=uid // 2, name='n', registration='Sequence') for uid in range(1, size + 1)]
    receivers = surroundings_link.SurroundingsFeed(mirror).receivers
    receivers[names.TREE_STRUCTURE](TreeStructure(run_id='t', number=1, behavior_tree='Large', nodes=nodes))
    status = TreeStatus(run_id='t', sequence=1, structure=1, statuses=[TreeStatus.RUNNING] * size)
    receivers[names.TREE_STATUS](status)
    (run,) = mirror.view().trees
    assert (len(run.nodes), len(run.statuses), run.left_out) == (size - more, size - more, more)
    assert f'{more} more nodes left out' in tree_lines(run, 80, 10, ASCII)[0]


def test_who_tells_of_trees_is_known_by_its_name_and_missed_when_it_leaves_as_another_comes() -> None:
    with station('wood') as operator, NodeRuntime.open('other', namespace='wood') as other, ExitStack() as busy:
        operator.link.open_surroundings()
        node = operator.runtime.node
        with NodeRuntime.open('my_server', namespace='wood') as server:
            status = TreeStatus(run_id='t', structure=1, statuses=[TreeStatus.RUNNING])

            def begin() -> Any:
                nodes = [TreeNode(uid=1, name='n', registration='Sequence')]
                structure = TreeStructure(run_id='t', number=1, behavior_tree='Main', nodes=nodes)
                publisher = server.node.create_publisher(
                    TreeStructure, names.TREE_STRUCTURE, names.transient_local_qos()
                )
                publisher.publish(structure)
                return server.node.create_publisher(TreeStatus, names.TREE_STATUS, names.transient_local_qos())

            statuses = server.call(begin)

            def is_known() -> bool:
                status.sequence += 1
                statuses.publish(status)
                return [run.server for run in operator.mirror.view().running_trees] == ['/wood/my_server']

            wait_until(is_known, 'the run and the node that has it')
            busy.enter_context(held(operator.runtime))  # so that it hears of both at once
        other.call(lambda: other.node.create_publisher(TreeStatus, names.TREE_STATUS, names.transient_local_qos()))
        found = partial(node.get_publishers_info_by_topic, f'/wood/{names.TREE_STATUS}')
        wait_until(lambda: [names.node_of(one) for one in found()] == ['/wood/other'], found)
        busy.close()
        operator.wait(lambda view: not view.running_trees and [run.server_gone for run in view.drawn_trees] == [True])


def test_a_stop_is_sent_while_the_executor_is_busy_with_what_others_send(executives: Any) -> None:
    robot, free = executives('robot'), threading.Event()
    with NodeRuntime.open('console', namespace='/robot') as runtime:
        link = ExecutiveLink(runtime, Mirror(runtime.steady), 'ann')
        view = link.live_view(DEADLINE)
        node = runtime.node
        wait_until(lambda: node.count_subscribers('/robot/executive/command') > 0, 'the executive listens')
        runtime.post(lambda: free.wait(DEADLINE))
        link.mirror.add_listener(lambda change: wait_until(lambda: robot.received, 'the STOP'))  # nor for those
        try:
            link.send(CommandBuilder('ann').command(view, CommandKind.STOP), DEADLINE)
            wait_until(lambda: robot.received, 'the STOP')
        finally:
            free.set()


def test_who_waits_for_a_robot_does_not_keep_the_process_from_its_end(executives: Any) -> None:
    executives('waited')
    with NodeRuntime.open('console', namespace='/waited') as runtime:
        link, begun = ExecutiveLink(runtime, Mirror(runtime.steady), 'ann'), threading.Event()
        link.live_view(DEADLINE)
        waiting = threading.Thread(target=link.wait_for, args=(lambda view: begun.set(), None), daemon=True)
        waiting.start()
        assert begun.wait(DEADLINE)
    waiting.join(DEADLINE)
    assert not waiting.is_alive()


def test_one_node_joins_every_robot_and_commands_the_one_that_is_meant(executives: Any) -> None:
    fleet = {name: executives(name) for name in ('first', 'second')}
    with NodeRuntime.open('console', namespace='/first') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')
        wait_until(lambda: {'/first', '/second'} <= set(robots.fleet.names), 'both robots')
        _, link = robots.select('/second')
        view = link.live_view(DEADLINE)
        command = CommandBuilder('ann').start(view, 'Drive')
        link.send(command, DEADLINE)
        tracked = link.settled(command.id, DEADLINE)
        assert tracked is not None and tracked.state is CommandState.APPLIED
        assert (len(fleet['first'].received), len(fleet['second'].received)) == (0, 1)
        assert robots.robot('/first')[1].live_view(DEADLINE).running is False
        robots.select('/first')
        wait_until(
            lambda: not runtime.node.get_subscriptions_info_by_topic('/second/tree_status'),
            'nobody listens to the one that was left',
        )
        robots.robot('/first')[0].receive_plan(((0.0, 0.0), (1.0, 0.0)))
        robots.open('/first')
        robots.close('/first')  # one that has it open is left
        runtime.call(lambda: None)
        assert robots.robot('/first')[0].view().surroundings.plan
        robots.select('/second')
        runtime.call(lambda: None)
        assert not robots.robot('/first')[0].view().surroundings.plan  # it may have become another one
    with NodeRuntime.open('console') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann', only=['/second', '/nobody'])
        assert (robots.own, robots.fleet.names) == ('/second', ('/nobody', '/second'))
    with NodeRuntime.open('console') as runtime:
        robots = FleetLink(runtime, Fleet(), lambda: Mirror(runtime.steady), 'ann')
        wait_until(lambda: {'/first', '/second'} <= set(robots.fleet.names), 'both robots')
        assert '/' not in robots.fleet.names  # nobody is there, and nobody has asked for it
        assert robots.select('/')[0].view().snapshot is None  # what the screen begins with


def test_who_asks_for_the_surroundings_holds_nothing_up_and_listens_no_longer_than_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with NodeRuntime.open('console', namespace='/alone') as runtime:
        mirror = Mirror(runtime.steady)
        link, call, asked = ExecutiveLink(runtime, mirror, 'ann', '/alone'), runtime.call, threading.Event()

        def noted_call(fn: Any, timeout: float = 2.0) -> Any:
            asked.set()
            return call(fn, timeout)

        def busy() -> None:
            asked.wait(DEADLINE)
            mirror.receive_plan(((0.0, 0.0), (1.0, 0.0)))

        monkeypatch.setattr(runtime, 'call', noted_call)
        runtime.post(busy)
        assert link.surroundings(lambda view: bool(view.surroundings.plan), DEADLINE).surroundings.plan
        # The graph knows of it some time after the subscription has ended.
        wait_until(lambda: not runtime.node.get_subscriptions_info_by_topic('/alone/tree_status'), 'no listener')
        runtime.post(lambda: wait_until(lambda: not asked.is_set(), 'the end of the question'))
        monkeypatch.setattr(runtime, 'call', lambda fn: call(fn, 0.01))
        with pytest.raises(NoAnswerError, match='too busy'):
            link.surroundings(lambda view: True, DEADLINE)
        asked.clear()
        monkeypatch.undo()
        link.open_surroundings()
        monkeypatch.setattr(runtime, 'call', lambda fn: call(fn, 0.01))
        with held(runtime):
            link.close_surroundings()
        wait_until(lambda: not runtime.node.get_subscriptions_info_by_topic('/alone/tree_status'), 'no listener')


def test_who_has_something_made_for_the_first_time_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    with NodeRuntime.open('console', namespace='/alone') as runtime:
        mirror = Mirror(runtime.steady)
        link = ExecutiveLink(runtime, mirror, 'ann', '/alone')

        class Query(SynthesisQuery):
            def __init__(self, *args: Any) -> None:
                runtime.call(lambda: mirror.receive_plan(()), DEADLINE / 6.0)  # the executor tells of a change
                super().__init__(*args)

            def cancel(self, timeout: float) -> int:
                return 7

        monkeypatch.setattr('flexbt_console.link.queries.SynthesisQuery', Query)
        assert link.cancel_synthesis(DEADLINE) == 7


def test_what_an_executive_sends_has_a_bound_for_each_field(capfd: pytest.CaptureFixture[str]) -> None:
    with NodeRuntime.open('console', namespace='/alone') as runtime:
        link = ExecutiveLink(runtime, Mirror(runtime.steady), None, '/alone')
        for kind in (BehaviorList, BehaviorStructure, ExecutiveEvents, ExecutiveLog, ExecutiveStatus, PlaceList):
            path, message = next(oversized(kind, 2_000_000))
            for sent, is_taken in ((kind(), True), (message, False)):
                data = serialize_message(sent)
                received = Received(data, len(data), UNKNOWN_WRITER, 0.0)
                taken = link._unpacked(received, kind, kind.__name__)
                assert (taken is not None) is is_taken, f'{kind.__name__}.{path}'
    assert 'BehaviorList: ignored: executive_id has 2000000 characters' in capfd.readouterr().err


@pytest.mark.filterwarnings('ignore:failed to send response')  # to the console, which has ended
def test_a_synthesis_ends_with_who_asked_for_it_and_with_the_console() -> None:
    begun: list[Any] = []
    canceled: list[Any] = []

    def cancel(goal: Any) -> CancelResponse:
        canceled.append(goal)
        return CancelResponse.ACCEPT

    def serve(runtime: NodeRuntime) -> None:
        options = {'handle_accepted_callback': begun.append, 'cancel_callback': cancel}
        ActionServer(runtime.node, SynthesizeBehavior, names.SYNTHESIZE_BEHAVIOR, lambda goal: None, **options)

    request = SynthesisRequest('X', goals=('g',), time_limit=3600.0)
    with ThreadPoolExecutor() as threads, NodeRuntime.open('robot') as robot, NodeRuntime.open('console') as console:
        robot.call(lambda: serve(robot))
        link, left = ExecutiveLink(console, Mirror(console.steady), 'ann'), Future[None]()
        gone, other = (threads.submit(link.synthesis, request, DEADLINE, print, one) for one in (left, None))
        wait_until(lambda: len(begun) == 2, 'both searches')
        left.set_result(None)
        with pytest.raises(NoAnswerError, match='was closed'):
            gone.result(DEADLINE)
        assert not other.done()
        wait_until(lambda: len(canceled) == 1, 'its cancel')
        console.close()
        with pytest.raises(NoAnswerError, match='the console ends'):
            other.result(DEADLINE)
        wait_until(lambda: len({bytes(goal.goal_id.uuid) for goal in canceled}) == 2, 'the other cancel')


def test_an_obstacle_whose_removal_nobody_has_answered_can_be_removed_once_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(simulator_link, '_LOOK_SECONDS', 0.0)
    codes = SimulationResult
    answers = [codes.RESULT_OK, codes.RESULT_OPERATION_FAILED, codes.RESULT_NOT_FOUND]
    release = threading.Event()

    def spawn(request: Any, response: Any) -> Any:
        response.result.result, response.entity_name = codes.RESULT_OK, request.name
        return response

    def delete(_request: Any, response: Any) -> Any:
        release.wait(DEADLINE)
        response.result.result = answers.pop(0)
        return response

    with NodeRuntime.open('console') as console, NodeRuntime.open('simulator') as runtime:
        for kind, name, answer in ((SpawnEntity, 'spawn_entity', spawn), (DeleteEntity, 'delete_entity', delete)):
            runtime.call(partial(runtime.node.create_service, kind, f'/simulator/{name}', answer))
        simulator = SimulatorLink(console)
        wait_until(simulator.is_possible, 'the simulator')
        name = simulator.drop(1.0, 2.0, DEADLINE)
        with pytest.raises(NoAnswerError):
            simulator.remove(name, 0.3)
        release.set()
        with pytest.raises(RefusedError):
            simulator.remove(name, DEADLINE)
        assert [*simulator.dropped] == [(name, 1.0, 2.0, 0.2)]
        simulator.remove(name, DEADLINE)  # it was gone already
        assert not simulator.dropped
        simulator.drop(1.0, 2.0, DEADLINE)
        assert len(simulator.dropped) == 1
        runtime.close()
        wait_until(lambda: not simulator.is_possible() and not simulator.dropped, 'nothing where no simulator is')


class Station:
    """A console without a user interface."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.mirror = Mirror(runtime.steady)
        self.link = ExecutiveLink(runtime, self.mirror)
        self.requests = CommandBuilder('ann')

    def state_of(self, command: OperatorCommand) -> CommandState:
        """Send a command, and wait for what becomes of it."""
        self.link.send(command, DEADLINE)
        tracked = self.link.settled(command.id, DEADLINE)
        assert tracked is not None
        return tracked.state

    def wait(self, condition: Any) -> None:
        """Wait until a condition on the view holds."""
        assert self.link.wait_for(lambda view: condition(view) or None, DEADLINE), self.mirror.view()


@contextmanager
def station(namespace: str) -> Iterator[Station]:
    with NodeRuntime.open('console', namespace=namespace) as runtime:
        yield Station(runtime)


def test_a_late_console_sees_everything_and_commands_at_once(executives: Any) -> None:
    executive = executives('late')
    with station('late') as first:
        view = first.link.live_view(DEADLINE)
        assert first.state_of(first.requests.start(view, 'Drive')) is CommandState.APPLIED
    started = uncontended_time()
    with station('late') as second:
        second.link.live_view(DEADLINE)
        second.wait(lambda view: view.structure and view.behaviors and second.mirror.log())
        joined = uncontended_time() - started
        view = second.mirror.view()
        assert view.active_paths == ('/AskGoal',)
        assert view.structure is not None and view.structure.state('/Accept') is not None
        assert second.state_of(second.requests.answer(view, '', '1 2 0')) is CommandState.APPLIED
    assert executive.values[0].pose.position.x == 1.0
    assert joined < 5.0  # typically 0.2 s; the machine may be busy


def test_commands_have_one_effect_each_over_a_lossy_link(executives: Any) -> None:
    faults = Faults(seed=1, lose_commands=0.4, lose_status=0.4, double=0.3)
    executive = executives('lossy', faults=faults, heartbeat=0.1)
    with station('lossy') as operator:
        operator.link.wait_for(lambda view: view.snapshot, DEADLINE)
        for level in list(AutonomyLevel) * 3:
            command = operator.requests.autonomy(operator.mirror.view(), level)
            assert operator.state_of(command) is CommandState.APPLIED
    assert [command.autonomy for command in executive.applied] == [0, 1, 2, 3] * 3
    assert len(executive.received) > len(executive.applied)


def test_nothing_that_was_due_with_others_is_sent_after_a_stop_that_comes_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent: list[str] = []
    with NodeRuntime.open('console') as runtime, ThreadPoolExecutor() as operator:
        link = ExecutiveLink(runtime, Mirror(runtime.steady), 'ann')

        def publish(message: ExecutiveCommand) -> None:
            sent.append(message.id)
            if message.id == 'first':
                operator.submit(link.send, OperatorCommand('stop', CommandKind.STOP, 'ann'), DEADLINE).result(DEADLINE)

        def send_both() -> None:
            link._reachable = True
            for name, kind in (('first', CommandKind.AUTONOMY), ('second', CommandKind.START)):
                link.mirror.give(OperatorCommand(name, kind, 'ann'), DEADLINE)
            link._send_due()

        monkeypatch.setattr(link, '_commands', SimpleNamespace(publish=publish))
        runtime.call(send_both)
        assert 'stop' in sent and 'second' not in sent


def test_a_command_that_cannot_be_sent_keeps_no_other_one_back(executives: Any) -> None:
    executives('unsent')
    with NodeRuntime.open('console', namespace='/unsent') as runtime:
        link = ExecutiveLink(runtime, Mirror(runtime.steady), 'ann')
        make, view = CommandBuilder('ann'), link.live_view(DEADLINE)
        bad = replace(make.autonomy(view, AutonomyLevel.HIGH), autonomy=1000)  # a byte in the message
        good = make.start(view, 'Drive')
        free = threading.Event()
        runtime.post(lambda: free.wait(DEADLINE))  # both are due at the same time
        link.send(bad, 1.0)
        link.send(good, DEADLINE)
        free.set()
        for command, state in ((good, CommandState.APPLIED), (bad, CommandState.TIMEOUT)):
            tracked = link.settled(command.id, DEADLINE)
            assert tracked is not None and tracked.state is state


def test_a_stale_answer_is_refused_by_the_executive(executives: Any) -> None:
    executives('stale')
    with station('stale') as operator:
        view = operator.link.live_view(DEADLINE)
        assert operator.state_of(operator.requests.start(view, 'Drive')) is CommandState.APPLIED
        operator.wait(lambda view: view.decision)
        view = operator.mirror.view()
        assert operator.state_of(operator.requests.answer(view, '', '1 2')) is CommandState.APPLIED
        assert operator.state_of(operator.requests.answer(view, '', '3 4')) is CommandState.REFUSED


def test_the_end_and_the_return_of_the_executive_are_seen() -> None:
    with station('restart') as operator:
        with NodeRuntime.open('onboard_executive', namespace='restart') as runtime:
            executive = ScriptedExecutive(runtime, faults=Faults(swallow_commands=True))
            first = operator.link.live_view(DEADLINE)
            command = operator.requests.autonomy(first, AutonomyLevel.FULL)
            operator.link.send(command, DEADLINE)
            wait_until(lambda: executive.received, 'the command')
        operator.wait(lambda view: view.link is LinkState.LOST)
        with NodeRuntime.open('onboard_executive', namespace='restart') as runtime:
            again = ScriptedExecutive(runtime)
            operator.wait(lambda view: view.live and view.snapshot.executive_id == again.status.executive_id)
            tracked = operator.link.settled(command.id, DEADLINE)
            assert tracked is not None and tracked.state is CommandState.TIMEOUT
            level = operator.requests.autonomy(operator.mirror.view(), AutonomyLevel.LOW)
            assert operator.state_of(level) is CommandState.APPLIED
            assert [entry.id for entry in again.applied] == [level.id]
            assert [entry.executive_id for entry in executive.received] == [executive.status.executive_id]
            assert again.applied[0].executive_id == again.status.executive_id


def test_a_signal_that_raises_can_come_at_any_point_of_a_wait() -> None:
    """As Ctrl-C in line mode does: nothing but it comes out, and no lock is lost."""

    class Interrupted(KeyboardInterrupt):
        pass

    is_armed, is_over = [False], threading.Event()  # a lock of the test's own could be lost as well

    def interrupt(*_: Any) -> None:
        if is_armed[0]:
            is_armed[0] = False
            raise Interrupted

    main = threading.main_thread().ident
    assert main is not None
    before = signal.signal(signal.SIGUSR2, interrupt)
    with unwatched_locks(), station('interrupted') as operator, ThreadPoolExecutor() as pool:

        def change() -> None:
            while not is_over.is_set():
                operator.mirror.sender_gone()

        def send() -> None:
            while not is_over.wait(0.001):
                signal.pthread_kill(main, signal.SIGUSR2)

        work = [pool.submit(change), pool.submit(send)]
        try:
            for _ in range(500):
                with pytest.raises(Interrupted):
                    is_armed[0] = True
                    operator.link.wait_for(lambda view: None, DEADLINE)
        finally:
            is_armed[0] = False
            is_over.set()
            for one in work:
                one.result(DEADLINE)
            signal.signal(signal.SIGUSR2, before)
        assert operator.link.wait_for(lambda view: view, DEADLINE)


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_what_others_publish_as_the_executive_does_not_touch_the_picture(executives: Any) -> None:
    executive = executives('forged')
    with station('forged') as operator, NodeRuntime.open('forger', namespace='forged') as forger:
        view = operator.link.live_view(DEADLINE)
        assert operator.state_of(operator.requests.start(view, 'Drive')) is CommandState.APPLIED
        status = operator.mirror.view().snapshot
        assert status is not None
        node = forger.node
        statuses = forger.call(
            lambda: node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, names.transient_local_qos())
        )
        lists = forger.call(
            lambda: node.create_publisher(BehaviorList, names.EXECUTIVE_BEHAVIORS, names.transient_local_qos())
        )
        operator.wait(lambda view: '2 executives' in view.problem)
        for executive_id in (status.executive_id, 'another'):
            statuses.publish(
                ExecutiveStatus(executive_id=executive_id, sequence=2**63, heartbeat_period=3600.0, run_id='forged')
            )
            lists.publish(BehaviorList(executive_id=executive_id))
            statuses.publish(b'no status')
        sequence = status.sequence
        operator.wait(lambda view: view.live and view.snapshot.sequence > sequence + 3)
        operator.wait(lambda view: view.snapshot.executive_id == executive.status.executive_id)
        assert operator.mirror.view().behaviors
        level = operator.requests.autonomy(operator.mirror.view(), AutonomyLevel.FULL)
        assert operator.state_of(level) is CommandState.APPLIED


_FORGER = """
import sys, time
from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus

with NodeRuntime.open('forger', namespace='late') as forger:
    node = forger.node
    qos = names.transient_local_qos()
    statuses = forger.call(lambda: node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, qos))
    forged = ExecutiveStatus(executive_id=sys.argv[1], heartbeat_period=10.0, run_id='forged', sequence=2**62)
    while True:
        forged.sequence += 1
        statuses.publish(forged)
        time.sleep(0.0002)
"""


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_an_executive_that_was_late_gets_its_picture_back_from_one_that_floods(executives: Any) -> None:
    executive = executives('late')
    with station('late') as operator:
        view = operator.link.live_view(DEADLINE)
        assert operator.state_of(operator.requests.start(view, 'Drive')) is CommandState.APPLIED
        status = executive.status
        executive.do(lambda: setattr(executive.faults, 'lose_status', 1.0))
        # A process of its own: what a process sends too much of is no longer heard of any of its participants.
        flooding = subprocess.Popen([sys.executable, '-c', _FORGER, status.executive_id])
        try:
            operator.wait(lambda view: view.snapshot.run_id == 'forged')
            executive.do(lambda: setattr(executive.faults, 'lose_status', 0.0))
            operator.wait(lambda view: view.live and view.snapshot.run_id == status.run_id)
            stop = operator.requests.command(operator.mirror.view(), CommandKind.STOP)
            assert operator.state_of(stop) is CommandState.APPLIED
        finally:
            flooding.kill()
            flooding.wait()
        assert executive.received[-1].run_id == status.run_id


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_stop_under_the_picture_of_a_forger_stops_the_robot_and_finds_the_executive(
    executives: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executive_sender, 'RETURN_SECONDS', 0.0)  # the forger stays
    executive = executives('believed')
    with station('believed') as operator, NodeRuntime.open('forger', namespace='believed') as forger:
        view = operator.link.live_view(DEADLINE)
        assert operator.state_of(operator.requests.start(view, 'Drive')) is CommandState.APPLIED
        executive.do(lambda: executive.log('its own'))
        operator.wait(lambda view: view.has_places and operator.mirror.log())
        # Of a second, so that it is not silent whenever the machine is busy.
        forged = ScriptedExecutive(forger, heartbeat=1.0, faults=Faults(swallow_commands=True))
        forged.status.run_id = 'forged'
        kitchen = Place(name='kitchen')
        kitchen.pose.header.frame_id, kitchen.pose.pose.orientation.w = 'map', 1.0
        forged.do(lambda: forged._places.publish(PlaceList(places=[kitchen])))
        forged.do(lambda: forged.log('forged'))
        executive.do(lambda: setattr(executive.faults, 'lose_status', 1.0))
        operator.wait(lambda view: view.snapshot.run_id == 'forged')
        operator.wait(lambda view: 'kitchen' in view.places and view.live)
        executive.do(lambda: setattr(executive.faults, 'lose_status', 0.0))
        stop = operator.requests.command(operator.mirror.view(), CommandKind.STOP)
        assert operator.state_of(stop) is CommandState.APPLIED
        assert executive.status.outcome == 'preempted'
        operator.wait(lambda view: view.live and view.snapshot.executive_id == executive.status.executive_id)
        operator.wait(lambda view: view.has_places and view.behaviors and view.structure and operator.mirror.log())
        assert 'kitchen' not in operator.mirror.view().places
        assert 'forged' not in {line.text for line in operator.mirror.log()}


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_console_that_was_held_up_takes_nobody_for_silent(executives: Any) -> None:
    executive = executives('held')
    with (
        NodeRuntime.open('console', namespace='held') as runtime,
        NodeRuntime.open('forger', namespace='held') as forger,
    ):
        operator, release, shown = Station(runtime), threading.Event(), list[View]()
        operator.link.live_view(DEADLINE)
        forged = ScriptedExecutive(forger, heartbeat=1000.0)
        forged.status.run_id = 'forged'
        operator.wait(lambda view: '2 executives' in view.problem)
        operator.mirror.add_listener(lambda change: shown.append(operator.mirror.view()))
        runtime.post(lambda: release.wait(DEADLINE))
        forged.do(forged.publish)  # the first of those that wait
        sent = executive.status.sequence
        wait_until(lambda: executive.status.sequence > sent + 3, 'silence, for who does not listen')
        sequence = executive.status.sequence
        release.set()
        operator.wait(lambda view: view.snapshot.sequence > sequence)
        assert 'forged' not in {view.snapshot.run_id for view in shown if view.snapshot}


def test_two_executives_at_one_link_are_reported(executives: Any) -> None:
    executives('double')
    executives('double')
    with station('double') as operator:
        operator.wait(lambda view: '2 executives' in view.problem)


def test_of_executives_that_have_left_together_nothing_is_reported() -> None:
    with NodeRuntime.open('console') as runtime, NodeRuntime.open('others') as others:
        mirror = Mirror(runtime.steady)
        ExecutiveLink(runtime, mirror, operator=None)
        qos = names.transient_local_qos()
        publishers = [
            others.call(partial(others.node.create_publisher, ExecutiveStatus, names.EXECUTIVE_STATUS, qos))
            for _ in range(2)
        ]
        wait_until(lambda: '2 executives' in mirror.view().problem, 'the problem')

        def leave() -> None:
            for one in publishers:
                others.node.destroy_publisher(one)

        runtime.call(partial(others.call, leave))  # the console hears of both at once
        wait_until(lambda: mirror.view().problem == '', 'no problem')


def test_nobody_there() -> None:
    with station('nobody') as operator, pytest.raises(NoLinkError, match='ROS_DOMAIN_ID'):
        operator.link.live_view(0.2)


def test_who_waited_for_a_live_link_while_the_computer_slept_gets_none() -> None:
    asleep = [0.0]
    with NodeRuntime.open('console') as runtime, ThreadPoolExecutor() as operator:
        mirror = Mirror(runtime.steady, seconds_asleep=lambda: asleep[0])
        link = ExecutiveLink(runtime, mirror, operator=None)
        waiting = operator.submit(link.live_view, DEADLINE)
        wait_until(lambda: link._waiting, 'the wait')
        asleep[0] = 3600.0
        mirror.receive_snapshot(ExecutiveSnapshot('e', 1, heartbeat_period=10.0), Transit(0.0, 0.0))
        with pytest.raises(NoLinkError, match='stood still'):
            waiting.result(DEADLINE)
        assert link.live_view(DEADLINE).live


class Endpoint:
    """What the graph says of a publisher or subscription."""

    def __init__(self, name: str, type_hash: str) -> None:
        self.node_name, self.node_namespace, self.topic_type_hash = name, '/', type_hash


class Graph:
    """A node that subscribes to what an executive publishes, or publishes what that subscribes to; others do so too."""

    def __init__(self, own: str, other: str, *, publishes: bool) -> None:
        self._consoles = [Endpoint('console', own), Endpoint('another', 'RIHS01_cc')]
        self._executives = [Endpoint('onboard_executive', other)]
        self._publishes = publishes

    def resolve_topic_name(self, topic: str) -> str:
        return f'/{topic}'

    def get_name(self) -> str:
        return 'console'

    def get_namespace(self) -> str:
        return '/'

    def get_subscriptions_info_by_topic(self, topic: str) -> list[Endpoint]:
        return self._executives if self._publishes else self._consoles

    def get_publishers_info_by_topic(self, topic: str) -> list[Endpoint]:
        return self._consoles if self._publishes else self._executives


@pytest.mark.parametrize(
    ('own', 'other', 'problem'),
    [
        ('RIHS01_aa', 'RIHS01_aa', ''),
        ('RIHS01_aa', 'RIHS01_bb', 'different versions of flexbt_msgs'),
        ('RIHS01_aa', 'INVALID', ''),
        ('INVALID', 'RIHS01_bb', ''),
    ],
)
@pytest.mark.parametrize('publishes', [False, True])
def test_different_interfaces_are_told(own: str, other: str, problem: str, publishes: bool) -> None:
    told = interface_problem(Graph(own, other, publishes=publishes), 'executive/any')
    assert (problem in told) if problem else told == ''


def test_the_graph_tells_the_hash_of_both_sides(executives: Any) -> None:
    """What the check relies on: the middleware carries the hashes."""
    executives('hash')
    with NodeRuntime.open('console', namespace='hash') as runtime:
        operator = Station(runtime)
        operator.link.live_view(DEADLINE)
        node = runtime.node
        topic = '/hash/executive/status'
        hashes = {str(e.topic_type_hash) for e in node.get_publishers_info_by_topic(topic)}
        hashes |= {str(e.topic_type_hash) for e in node.get_subscriptions_info_by_topic(topic)}
        assert len(hashes) == 1 and next(iter(hashes)).startswith('RIHS01_')
        assert operator.mirror.view().problem == ''
