# SPDX-License-Identifier: BSD-3-Clause
"""Faults of navigation servers on command, on one launched world."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from typing import Any

import pytest
from nav2_msgs.action import BackUp, FollowPath
from simulation_interfaces.msg import Result, SimulationState
from simulation_interfaces.srv import SetSimulationState, StepSimulation
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.calls.goal_server import goal_servers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message
from flexbt_msgs.srv import SetFault
from flexbt_sim.messages import check_fault
from flexbt_sim.world.faults import NAVIGATION_SERVERS, fault_parameters
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, aborted, line, open_navigation, open_simulator
from flexbt_testing.waiting import wait_until

EAST = (11.2, 4.45)


class World:
    """Simulator, navigation, and somebody who brings faults about."""

    def __init__(self, probe: RobotProbe, navigation: NodeRuntime) -> None:
        self.probe = probe
        self.navigation = navigation
        self.told: list[String] = []
        runtime = probe.runtime
        runtime.call(
            lambda: runtime.node.create_subscription(
                String, names.SERVER_FAULTS, self.told.append, names.transient_local_qos(10)
            )
        )
        wait_until(lambda: self.told, 'the first word of faults')

    def fault(self, fault: str, *, after: float = 0.0, duration: float = 0.0, **parameters: Any) -> Any:
        return self.probe.ask(
            SetFault, 'simulator/set_fault',
            SetFault.Request(fault=fault, parameters=json.dumps(parameters), after=after, duration=duration),
        )  # fmt: skip

    def clear(self) -> None:
        assert self.probe.ask(SetFault, 'simulator/set_fault', SetFault.Request(clear=True)).success
        self.wait_for_faults(0)

    def wait_for_faults(self, count: int) -> None:
        """Until so many servers have one."""
        wait_until(lambda: self.navigation.call(self._count) == count, f'{count} servers with a fault')

    def _count(self) -> int:
        return sum(one.fault != type(one.fault)() for one in goal_servers(self.navigation).values())

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Time stands still."""
        self._set_state(SimulationState.STATE_PAUSED)
        yield
        self._set_state(SimulationState.STATE_PLAYING)

    def _set_state(self, state: int) -> None:
        request = SetSimulationState.Request(state=SimulationState(state=state))
        response = self.probe.ask(SetSimulationState, 'simulator/set_simulation_state', request)
        assert response.result.result == Result.RESULT_OK

    def wait_action(self, seconds: float) -> Any:
        return self.probe.send(names.WAIT, time=duration_message(seconds))


@pytest.fixture(scope='module')
def world() -> Iterator[World]:
    with open_simulator(speed_factor=5.0) as probe, open_navigation() as navigation:
        made = World(probe, navigation)
        wait_until(lambda: made.fault('server_refuses').success, 'the navigation is known')
        made.clear()
        yield made


@pytest.fixture(autouse=True)
def without(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if 'world' in request.fixturenames:
        request.getfixturevalue('world').clear()


def test_all_servers_of_the_node_can_have_faults(world: World) -> None:
    assert sorted(world.navigation.call(lambda: list(goal_servers(world.navigation)))) == sorted(NAVIGATION_SERVERS)
    for server in NAVIGATION_SERVERS:
        check_fault(fault_parameters('server_fails', {'server': server}))


def test_a_server_refuses_until_the_fault_ends(world: World) -> None:
    running = world.wait_action(2.0)
    assert running.accepted.wait(60.0)
    assert world.fault('server_refuses', server=names.WAIT).success
    world.wait_for_faults(1)
    assert world.wait_action(0.1).wait().status is GoalStatus.REJECTED
    turning = world.probe.send(names.SPIN, target_yaw=0.1, time_allowance=duration_message(60.0))
    assert turning.wait().status is GoalStatus.SUCCEEDED
    assert running.wait().status is GoalStatus.SUCCEEDED
    world.clear()
    assert world.wait_action(0.1).wait().status is GoalStatus.SUCCEEDED


def test_a_server_fails_with_code_and_message_and_what_it_drives_rests(world: World) -> None:
    world.probe.place(DOCK)
    code = FollowPath.Result.FAILED_TO_MAKE_PROGRESS
    running = world.probe.follow(line(DOCK, EAST))
    world.probe.wait_driving()
    assert world.fault('server_fails', server=names.FOLLOW_PATH, error_code=code, error_msg='mud').success
    assert aborted(running, code).error_msg == 'mud'
    world.probe.wait_at_rest()
    assert aborted(world.probe.follow(line(DOCK, EAST)), code).error_msg == 'mud'
    world.clear()
    assert world.probe.follow(line(DOCK, (1.5, 4.45))).wait().status is GoalStatus.SUCCEEDED


def test_a_server_hangs_and_goes_on_where_it_is_after_the_fault(world: World) -> None:
    world.probe.place(DOCK)
    goal = world.probe.follow(line(DOCK, (4.0, 4.45)))
    world.probe.wait_driving()
    assert world.fault('server_hangs', server=names.FOLLOW_PATH).success
    rest = world.probe.wait_at_rest()
    assert rest.distance((4.0, 4.45)) > 0.3
    assert world.wait_action(1.0).wait().status is GoalStatus.SUCCEEDED  # the others work
    assert not goal.ended and world.probe.now.distance(rest[1:]) < 1e-6
    world.clear()
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert world.probe.wait_at_rest().distance((4.0, 4.45)) < 0.3


def test_a_server_that_hangs_does_not_answer_a_cancel_before_the_end_of_the_fault(world: World) -> None:
    world.probe.place(DOCK)
    before = world.probe.follow(line(DOCK, EAST))
    world.probe.wait_driving()
    assert world.fault('server_hangs', server=names.FOLLOW_PATH).success
    world.wait_for_faults(1)
    after = world.probe.follow(line(DOCK, EAST))
    assert after.accepted.wait(60.0)
    before.cancel()
    after.cancel()
    world.probe.wait_at_rest()
    assert world.wait_action(1.0).wait().status is GoalStatus.SUCCEEDED
    assert not before.ended and not after.ended
    world.clear()
    assert [goal.wait().status for goal in (before, after)] == [GoalStatus.CANCELED] * 2
    assert world.probe.follow(line(DOCK, (1.5, 4.45))).wait().status is GoalStatus.SUCCEEDED


def test_a_fault_comes_and_goes_at_its_times(world: World) -> None:
    def step(steps: int) -> None:
        request = StepSimulation.Request(steps=steps)
        assert world.probe.ask(StepSimulation, 'simulator/step_simulation', request).result.result == Result.RESULT_OK

    with world.paused():
        assert world.fault('server_refuses', server=names.WAIT, after=0.5, duration=1.0).success
        step(20)
        world.wait_for_faults(0)
        step(60)
        world.wait_for_faults(1)
        step(60)
        world.wait_for_faults(0)


def test_a_server_hears_of_a_fault_while_time_stands_still(world: World) -> None:
    with world.paused():
        assert world.fault('server_refuses', server=names.WAIT).success
        world.wait_for_faults(1)
        world.clear()


def test_what_cannot_be_is_refused_with_what_can(world: World) -> None:
    for fault, parameters, says in (
        ('server_refuses', {'server': 'follow_pth'}, 'follow_path'),
        ('server_fails', {'server': 'backup', 'error_code': 101}, str(BackUp.Result.COLLISION_AHEAD)),
        ('server_fails', {'server': 'backup', 'error_code': -1}, '0 to 65535'),
        ('server_fails', {'server': 'wait', 'colour': 1}, 'colour'),
    ):
        answer = world.fault(fault, **parameters)
        assert not answer.success and says in answer.message, answer.message
    assert world.navigation.call(world._count) == 0


def test_damaged_words_of_faults_change_nothing(world: World) -> None:
    runtime = world.probe.runtime
    publisher = runtime.call(
        lambda: runtime.node.create_publisher(String, names.SERVER_FAULTS, names.transient_local_qos(10))
    )
    count = len(world.told)
    wait_until(lambda: publisher.get_subscription_count() >= 2)
    for text in ('', '[', '{a: 1}', '[1]', '[{fault: stuck_wheel, parameters: {}}]', '[{fault: [], parameters: {}}]'):
        publisher.publish(String(data=text))
    wait_until(lambda: len(world.told) == count + 6)
    assert world.wait_action(0.1).wait().status is GoalStatus.SUCCEEDED
    runtime.call(lambda: runtime.node.destroy_publisher(publisher))
