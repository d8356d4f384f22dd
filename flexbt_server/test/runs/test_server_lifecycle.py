# SPDX-License-Identifier: BSD-3-Clause
"""The BT server as a managed node: what it does in which state, and what becomes of running trees."""

from __future__ import annotations

import contextlib
import gc
import random
import socket
import threading
import weakref
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.lifecycle.managed_node import ManagedNode, NodeScope
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_core.clock.work_thread import LateWork
from flexbt_msgs.action import BtExecute, BtGetData, BtLoad, BtSetData
from flexbt_msgs.srv import ControlTree
from flexbt_server.bt_server import BtServer, tree_reader
from flexbt_server.parameters import declare_parameters
from flexbt_testing.nodes.clients import LifecycleClient, SentGoal
from flexbt_testing.nodes.server_world import Client, Navigation, document
from flexbt_testing.pytest_plugin import entities_of
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result
ACTIONS = {names.BT_LOADER, names.BT_EXECUTOR, names.BT_GET_DATA, names.BT_SET_DATA}
WAITING = '<Wait wait_duration="1000"/>'


class Managed:
    """A managed BT server, navigation, and a client that is its lifecycle manager as well."""

    def __init__(self, server: NodeRuntime, navigation: NodeRuntime, client: NodeRuntime) -> None:
        assert isinstance(server.node, ManagedNode)
        self.runtime = server
        self.node = server.node
        self.navigation = Navigation(navigation)
        self.navigation.hold.add(names.WAIT)
        self.wait = self.navigation.actions[names.WAIT]
        self.node.manage(server, BtServer, parameters=declare_parameters)
        self.client = Client(client)
        self.manager = LifecycleClient(client, names.BT_SERVER)

    def change(self, *labels: str) -> None:
        """Make transitions that have to succeed."""
        for label in labels:
            assert self.manager.change(label), label

    def entities(self) -> Counter[type]:
        """Return what there is on the node, by kind."""

        return self.runtime.call(lambda: entities_of(self.node))

    def actions(self) -> set[str]:
        """Actions in the graph, as the client knows it."""
        node = self.client.runtime.node
        return {name for name in ACTIONS if node.count_services(f'{name}/_action/send_goal')}


@contextlib.contextmanager
def managed(**parameters: Any) -> Iterator[Managed]:
    chosen = {'server_timeout': 10.0, 'autostart': False} | parameters
    with (
        NodeRuntime.open('navigation') as navigation,
        NodeRuntime.open(names.BT_SERVER, parameters=chosen, node_class=ManagedNode) as server,
        NodeRuntime.open('client') as client,
    ):
        yield Managed(server, navigation, client)


def wait_for_leaf(world: Managed) -> None:
    wait_until(lambda: world.wait.goals, 'goal of the leaf')


def test_goals_are_rejected_until_the_server_is_active_and_the_log_says_why(capfd: pytest.CaptureFixture[str]) -> None:
    with managed() as world:
        wait_until(lambda: world.actions() == set())
        world.change('configure')
        client = world.client
        goals = [
            SentGoal(client.loader, BtLoad.Goal(xml=document(WAITING))),
            client.execute(),
            SentGoal(client.getter, BtGetData.Goal(keys=['key'])),
            SentGoal(client.setter, BtSetData.Goal(entries=[to_entry('key', 1)])),
        ]
        assert [goal.wait().status for goal in goals] == [GoalStatus.REJECTED] * 4
        told = capfd.readouterr().err
        assert 'the BT server is inactive; activate it (ros2 lifecycle set /bt_server activate)' in told
        world.change('activate')
        client.load_tree('<SetBlackboard value="5" output_key="key"/>')
        assert client.execute().result.code == Result.SUCCESS
        assert client.get('key').code == BtGetData.Result.SUCCESS


def test_running_trees_are_at_rest_when_the_server_is_inactive() -> None:
    with managed() as world:
        world.change('configure', 'activate')
        world.wait.delay_cancel = 0.3  # it takes a moment until the robot stands
        world.client.load_tree(WAITING)
        runs = [world.client.execute(blackboard=name) for name in ('', 'a', 'b')]
        wait_until(lambda: len(world.wait.goals) == 3, 'goals of the leaves')
        controlled = threading.Event()
        control = world.client.runtime.node.create_client(ControlTree, names.CONTROL_TREE)
        wait_until(control.service_is_ready)
        world.change('deactivate')
        # All that is so when the manager has its answer.
        assert set(world.wait.statuses.values()) == {'canceled'} and len(world.wait.statuses) == 3
        for run in runs:
            assert run.result.code == Result.CANCELED
            assert run.result.message.startswith('the BT server was deactivated')
        world.client.runtime.call(
            lambda: control.call_async(ControlTree.Request()).add_done_callback(lambda _: controlled.set())
        )
        assert controlled.wait(60.0)
        world.change('activate')
        again = world.client.execute()  # its trees are still loaded
        wait_until(lambda: len(world.wait.goals) == 4)
        world.wait.end(3)
        assert again.result.code == Result.SUCCESS


def test_the_server_is_alive_in_every_state() -> None:
    with managed() as world:
        changes: list[bool] = []
        watch = LivelinessWatch(world.client.runtime, names.BT_SERVER, changes.append)
        for label in ('configure', 'activate', 'deactivate', 'cleanup', 'configure', 'shutdown'):
            wait_until(lambda: watch.alive)
            world.change(label)
        world.runtime.close()
        wait_until(lambda: changes == [True, False], 'the end')


def test_only_the_server_that_waits_for_a_read_that_hangs_is_not_ready() -> None:
    disks = [threading.Event() for _ in range(2)]
    threads: list[threading.Thread] = []
    with NodeRuntime.open('reading') as runtime:
        unready = LivelinessToken(runtime)._held._unready

        def configure(disk: threading.Event) -> NodeScope:
            """Return what is configured has begun to read, and is late."""

            def read() -> None:
                threads.append(threading.current_thread())
                assert disk.wait(DEADLINE)

            scope = NodeScope(runtime)
            reader = tree_reader(scope)
            reader._seconds = 0.01
            reader.submit(read, 'a file was not read')
            wait_until(lambda: threads and 'files' in unready, 'why it is not ready')
            return scope

        configure(disks[0]).close()
        assert 'files' not in unready
        again = configure(disks[1])
        disks[0].set()
        threads[0].join(DEADLINE)
        assert 'files' in unready, 'the other disk has not answered'
        again.close()
        assert 'files' not in unready
        disks[1].set()
        reader = tree_reader(NodeScope(runtime))
        for seconds, uses_processor, why in (
            (5.0, True, ''),
            (10.0, False, 'the disk'),
            (15.0, True, ''),
            (60.0, True, 'may never end'),
            (65.0, True, 'within 60 s'),  # each reason is told once
        ):
            reader._on_late(LateWork('a file was not read', seconds, uses_processor))
            told = unready.get('files', '')
            assert why in told and bool(why) is bool(told), (seconds, told)
        reader._on_late(None)
        assert 'files' not in unready
        reader.close()


@pytest.mark.dds('Groot2 talks by sockets of ZeroMQ')
def test_cleanup_forgets_everything_and_frees_it() -> None:
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with managed(groot2_port=port) as world:
        before = world.entities()
        for _ in range(2):  # the port can be taken again
            world.change('configure', 'activate')
            wait_until(lambda: world.actions() == ACTIONS)
            assert world.client.execute().result.code == Result.ERROR  # no such tree, any more
            world.client.load_tree('<SetBlackboard value="5" output_key="key"/>')
            assert world.client.get('key').code == BtGetData.Result.FAILURE
            assert world.client.execute().result.code == Result.SUCCESS
            world.change('deactivate', 'cleanup')
            assert world.entities() == before
            wait_until(lambda: world.actions() == set())


def test_each_configuration_has_publishers_of_its_own_and_is_freed() -> None:
    with managed() as world:
        for _ in range(2):
            world.change('configure', 'activate')
            world.client.load_tree('<Publish type="std_msgs/msg/String" topic_name="said" subscriber_timeout="0"/>')
            assert world.client.execute().result.code == Result.SUCCESS
            goals = weakref.ref(world.node._managed.goals)
            world.change('deactivate', 'cleanup')
            wait_until(lambda: gc.collect() >= 0 and goals() is None, 'it is freed', every=0.25)  # noqa: B023


def test_what_is_broken_when_it_is_configured_can_be_mended(tmp_path: Path) -> None:
    file = tmp_path / 'tree.xml'
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Main"><NoSuchNode/></BehaviorTree></root>')
    with managed(allowed_directories=[str(tmp_path)], preload=[str(file)]) as world:
        before = world.entities()
        for _ in range(2):
            assert not world.manager.change('configure')
            assert world.manager.state() == 'unconfigured'
            assert world.entities() == before
        heard: list[DiagnosticStatus] = []
        runtime = world.client.runtime
        runtime.call(
            lambda: runtime.node.create_subscription(
                DiagnosticArray, '/diagnostics', lambda array: heard.extend(array.status), 10
            )
        )
        wait_until(lambda: heard, 'diagnostics')
        assert heard[-1].name == '/bt_server: lifecycle'
        assert heard[-1].level == DiagnosticStatus.ERROR
        assert heard[-1].message.startswith('unconfigured: ') and 'NoSuchNode' in heard[-1].message
        file.write_text(document(WAITING))
        tick_rate = [Parameter('tick_rate', value=20.0)]
        assert world.runtime.call(lambda: world.node.set_parameters(tick_rate))[0].successful
        world.change('configure', 'activate')
        wait_until(lambda: heard[-1].message == 'active')
        assert heard[-1].level == DiagnosticStatus.OK
        world.client.execute()
        wait_for_leaf(world)
        assert not world.runtime.call(lambda: world.node.set_parameters(tick_rate))[0].successful


def test_what_decides_over_files_addresses_and_limits_is_as_the_node_was_started(tmp_path: Path) -> None:
    with managed(allowed_directories=[str(tmp_path)]) as world:
        attempts: list[tuple[str, Any]] = [
            ('allowed_directories', ['/']),
            ('bt_search_directories', ['/']),
            ('default_nav_to_pose_bt_xml', '/etc/hostname'),
            ('btlog_directory', '/etc'),
            ('groot2_address', '*'),
            ('groot2_port', 1667),
            ('max_file_size', 100_000_000),
            ('max_depth', 10_000),
        ]

        def results() -> list[bool]:
            parameters = [Parameter(name, value=value) for name, value in attempts]
            return [one.successful for one in world.runtime.call(lambda: world.node.set_parameters(parameters))]

        assert results() == [False] * len(attempts)
        world.change('configure', 'activate', 'deactivate', 'cleanup')
        assert results() == [False] * len(attempts)


def test_many_rounds_with_running_trees_leave_nothing_behind() -> None:
    chance = random.Random(3)
    navigators = [names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS]
    with managed(navigators=navigators) as world:
        world.change('configure', 'activate', 'deactivate', 'cleanup')  # transforms are heard from now on
        before = world.entities()
        threads: set[int] = set()
        for round in range(8):
            world.change('configure', 'activate')
            world.client.load_tree(f'<Sequence><Delay delay_msec="{chance.randrange(3)}">{WAITING}</Delay></Sequence>')
            assert LifecycleClient(world.client.runtime, names.BT_NAVIGATOR).state() == 'active'
            runs = [world.client.execute(blackboard=str(index)) for index in range(chance.randrange(4))]
            for run in runs:
                assert run.accepted.wait(60.0)
            ways = (['deactivate', 'cleanup'], ['deactivate', 'activate', 'deactivate', 'cleanup'])
            world.change(*chance.choice(ways))
            for run in runs:
                assert run.result.code == Result.CANCELED, run.result
            assert world.wait.running == []
            assert world.entities() == before
            if round > 1:
                threads.add(threading.active_count())
        assert max(threads) - min(threads) <= 1, threads  # a thread may be about to end


GOALS_OF = {
    'unconfigured': {'configure': 'inactive'},
    'inactive': {'activate': 'active', 'cleanup': 'unconfigured'},
    'active': {'deactivate': 'inactive'},
}


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_nothing_runs_and_no_goal_is_forgotten_whatever_transitions_come(seed: int) -> None:
    chance = random.Random(seed)
    with managed() as world:
        before = world.entities()
        state, is_loaded = 'unconfigured', False
        goals: list[SentGoal] = []
        for _ in range(60):
            if state == 'active' and not is_loaded:
                world.client.load_tree(WAITING)
                is_loaded = True
            if state != 'unconfigured' and chance.random() < 0.6:
                goals += [world.client.execute(blackboard=str(chance.randrange(6))) for _ in range(chance.randrange(5))]
            for goal in goals:
                if goal.accepted.is_set() and chance.random() < 0.1:
                    goal.cancel()
            if chance.random() < 0.5:
                for goal in goals:
                    wait_until(lambda goal=goal: goal.accepted.is_set() or goal.ended)  # type: ignore[misc]
            world.wait.delay_cancel = chance.choice([0.0, 0.0, 0.02])
            label = chance.choice(['configure', 'activate', 'deactivate', 'deactivate', 'cleanup'])
            goal_state = GOALS_OF[state].get(label)
            assert world.manager.change(label) == (goal_state is not None)
            state = goal_state or state
            if state == 'active':
                continue
            assert world.wait.running == []
            for goal in goals:
                outcome = goal.wait()
                result = outcome.result
                if outcome.status is GoalStatus.REJECTED:
                    continue  # the server was not active
                # One that was still under way when there was no server any more got no answer.
                assert result is None or result.code in (Result.CANCELED, Result.ERROR), result
                assert result is not None or state == 'unconfigured', goal.outcomes
            goals.clear()
            if state == 'unconfigured':
                is_loaded = False
                assert world.entities() == before


def test_the_end_of_the_process_is_orderly_in_every_state() -> None:
    for labels in ([], ['configure'], ['configure', 'activate'], ['configure', 'activate', 'shutdown']):
        with managed() as world:
            run = None
            if 'activate' in labels:
                world.change('configure', 'activate')
                world.client.load_tree(WAITING)
                run = world.client.execute()
                wait_for_leaf(world)
                world.change(*labels[2:])
            else:
                world.change(*labels)
            world.runtime.close()
            if run is not None:
                assert run.result.code == Result.CANCELED
                assert 'the BT server is shutting down' in run.result.message
                assert set(world.wait.statuses.values()) == {'canceled'}
