# SPDX-License-Identifier: BSD-3-Clause
"""The stop guard: when it stops the robot, for how long, and what it leaves to the executive."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from itertools import groupby

import pytest
from geometry_msgs.msg import Twist
from nav2_msgs.action import FollowPath
from rclpy.exceptions import ParameterImmutableException

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus, StopGuardStatus
from flexbt_onboard.node import stop_guard
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.waiting import wait_until


class World:
    """A guard, an operator, a server that drives the robot, and an executive that does what it is told to."""

    guard: stop_guard.StopGuard

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.statuses: list[StopGuardStatus] = []
        self.heard: list[ExecutiveCommand] = []
        self.zeros: list[Twist] = []
        self.driving = ScriptedActionServer(runtime, FollowPath, names.FOLLOW_PATH)
        self.links = ActionLinks(runtime)
        runtime.call(self._open)

    def _open(self) -> None:
        node = self.runtime.node
        node.create_subscription(
            StopGuardStatus, names.STOP_GUARD_STATUS, self.statuses.append, names.transient_local_qos(depth=100)
        )
        node.create_subscription(Twist, names.CMD_VEL, self.zeros.append, 100)
        self.stops = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_STOP, names.stop_qos())
        self._status = node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, names.transient_local_qos())

    def wait_connected(self) -> None:
        wait_until(lambda: self.statuses and self.stops.get_subscription_count(), 'the guard')
        wait_until(lambda: self._status.get_subscription_count(), 'the guard hears the executive')

    def begin_executive(self) -> None:
        """Hear of STOPs: whoever does is an executive for the guard."""
        self.runtime.call(
            lambda: self.runtime.node.create_subscription(
                ExecutiveCommand, names.EXECUTIVE_STOP, self.heard.append, names.stop_qos()
            )
        )

    def stop(self, stop_id: str = '', kind: int = ExecutiveCommand.STOP) -> str:
        stop_id = stop_id or uuid.uuid4().hex
        self.stops.publish(ExecutiveCommand(id=stop_id, kind=kind, operator_id='ann'))
        return stop_id

    def answer(self, stop_id: str, code: int = CommandResult.APPLIED, executive: str = '') -> None:
        result = CommandResult(command_id=stop_id, code=code)
        self._status.publish(ExecutiveStatus(executive_id=executive, results=[result]))

    def show(self, executive: str, run: str = '') -> None:
        """Send a status without results."""
        self._status.publish(ExecutiveStatus(executive_id=executive, run_id=run))

    def drive(self) -> SentGoal:
        began = len(self.driving.running)
        goal = SentGoal(self.links.link(FollowPath, names.FOLLOW_PATH), FollowPath.Goal())
        wait_until(lambda: len(self.driving.running) > began or goal.ended, 'the goal')
        return goal

    @property
    def last(self) -> StopGuardStatus:
        return self.statuses[-1]

    def wait_holding(self, *stops: str) -> None:
        done = set(stops)
        wait_until(
            lambda: self.last.holding and done <= {one.command_id for one in self.last.results},
            lambda: f'the guard holds the robot for {stops}; {self.statuses}',
        )


@pytest.fixture
def world() -> Iterator[World]:
    with NodeRuntime.open('world') as runtime, NodeRuntime.open('stop_guard') as guard:
        world = World(runtime)
        world.guard = stop_guard.open_stop_guard(guard)
        world.wait_connected()
        yield world


def test_what_no_executive_answers_is_stopped_and_held_until_one_does(world: World) -> None:
    goal = world.drive()
    stop_id = world.stop()
    world.wait_holding(stop_id)
    assert world.last.operator_id == 'ann'
    assert goal.wait().status is GoalStatus.CANCELED
    wait_until(lambda: world.zeros, 'zero velocity')
    assert world.drive().wait().status is GoalStatus.CANCELED, 'what comes while the robot is held'
    world.begin_executive()  # it was restarted, and has heard nothing
    wait_until(lambda: stop_id in [one.id for one in world.heard], 'the STOP, from the guard')
    assert world.heard[-1].kind == ExecutiveCommand.STOP and world.heard[-1].operator_id == 'ann'
    world.answer(stop_id)
    wait_until(lambda: not world.last.holding, 'the guard lets the robot go')
    world.stop(stop_id)  # a console that has lost the answer
    world.stop(stop_id)
    goal = world.drive()
    other = world.stop()
    world.wait_holding(other)
    assert goal.wait().status is GoalStatus.CANCELED
    holding = [status.holding for status in world.statuses]
    assert [now for now, _ in groupby(holding)] == [False, True, False, True], 'once for each STOP'
    wait_until(lambda: len(world.statuses) > len(holding) + 1, 'what it says again and again while it holds')


@pytest.mark.parametrize('end', ['it ends', 'another one is there'])
def test_an_executive_that_ends_just_after_its_answer_has_not_stopped_everything(
    world: World, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    monkeypatch.setattr(stop_guard, 'GRACE_SECONDS', 1e6)  # however busy the machine is
    monkeypatch.setattr(stop_guard, 'FOLLOW_SECONDS', 1e6)
    goal = world.drive()
    with NodeRuntime.open(names.ONBOARD_EXECUTIVE) as executive:
        LivelinessToken(executive).set_ready(True)
        follows = LivelinessWatch(world.runtime, names.ONBOARD_EXECUTIVE)
        wait_until(lambda: follows.ready, 'the executive')
        stop_id = world.stop()
        wait_until(lambda: world.guard.is_open, 'the guard has heard the STOP')
        world.answer(stop_id, executive='one')
        wait_until(lambda: not world.guard.is_open, 'the guard has heard the answer')
        if end == 'another one is there':
            world.show('two')
            wait_until(lambda: world.last.holding, 'the guard holds the robot')
    assert goal.wait().status is GoalStatus.CANCELED
    world.wait_holding()
    world.begin_executive()
    wait_until(lambda: world.heard, 'the STOP, from the guard')
    again = world.heard[-1]
    assert (again.operator_id, again.id != stop_id) == ('ann', True), 'executives know the result of the other one'
    world.answer(again.id, executive='three')
    wait_until(lambda: not world.last.holding, 'the guard lets the robot go')


def test_a_stop_that_an_executive_has_not_answered_before_its_end_is_a_new_one_for_the_next(world: World) -> None:
    with NodeRuntime.open(names.ONBOARD_EXECUTIVE) as executive:
        LivelinessToken(executive).set_ready(True)
        follows = LivelinessWatch(world.runtime, names.ONBOARD_EXECUTIVE)
        wait_until(lambda: follows.ready, 'the executive')
        stop_id = world.stop()
        world.wait_holding(stop_id)
    world.begin_executive()
    again = wait_until(lambda: next((one for one in world.heard if one.id != stop_id), None), 'the STOP, as a new one')
    assert again.operator_id == 'ann'
    world.answer(stop_id, executive='two')  # as its journal says; it has stopped nothing
    count = len(world.statuses)
    wait_until(lambda: len(world.statuses) > count + 1, 'the guard goes on holding the robot')
    world.answer(again.id, executive='two')
    wait_until(lambda: not world.last.holding, 'the guard lets the robot go')
    assert [now for now, _ in groupby(status.holding for status in world.statuses)] == [False, True, False]


def test_a_run_that_has_begun_after_a_stop_is_not_stopped_when_its_executive_ends(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_guard, 'GRACE_SECONDS', 1e6)  # however busy the machine is
    monkeypatch.setattr(stop_guard, 'FOLLOW_SECONDS', 1e6)
    stop_id = world.stop()
    wait_until(lambda: world.guard.is_open, 'the guard has heard the STOP')
    world.answer(stop_id, executive='one')
    wait_until(lambda: not world.guard.is_open, 'the guard has heard the answer')
    world.show('one', 'another run')
    goal = world.drive()
    world.show('two')
    stop_id = world.stop()
    wait_until(lambda: world.guard.is_open, 'the guard has heard the next STOP, and so the status before it')
    world.answer(stop_id, executive='two')
    wait_until(lambda: not world.guard.is_open, 'the guard has heard the answer')
    assert not goal.ended and not any(status.holding for status in world.statuses)


def test_what_the_executive_answers_is_left_to_it(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    goal = world.drive()
    with monkeypatch.context() as patched:
        patched.setattr(stop_guard, 'GRACE_SECONDS', 1e6)  # however busy the machine is
        for _ in range(3):
            stop_id = world.stop()
            wait_until(lambda: world.guard.is_open, 'the guard has heard the STOP')
            world.answer(stop_id)
            wait_until(lambda: not world.guard.is_open, 'the guard has heard the answer')
        stop_id = uuid.uuid4().hex
        world.begin_executive()
        world.answer(stop_id)  # which comes before the STOP
        world.stop(stop_id)
        wait_until(lambda: [one.id for one in world.heard].count(stop_id) == 2, 'the STOP, and again from the guard')
        wait_until(lambda: not world.guard.is_open, 'the answer that has come before')
    assert not goal.ended and not any(status.holding for status in world.statuses)
    refused = world.stop()
    world.answer(refused, CommandResult.REFUSED)  # it is not configured: it stops nothing
    world.wait_holding(refused)
    assert goal.wait().status is GoalStatus.CANCELED
    assert [one.command_id for one in world.last.results] == [refused]
    latest = world.stop()
    world.wait_holding(latest)
    world.answer(latest)  # who has applied this one has applied those before it
    wait_until(lambda: not world.last.holding, 'the guard lets the robot go')


def test_stops_that_are_answered_late_again_and_again_are_logged_once(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stop_guard, 'COMPLAINT_SECONDS', 1e6)
    world: World = request.getfixturevalue('world')
    for _ in range(3):
        stop_id = world.stop()
        world.wait_holding(stop_id)
        world.answer(stop_id)
        wait_until(lambda: not world.last.holding, 'the guard lets the robot go')
    logged = capfd.readouterr().err
    assert logged.count('keeps the robot at rest') == logged.count('lets the robot go') == 1, logged


def test_only_stops_stop(world: World) -> None:
    for kind in (ExecutiveCommand.NOTE, ExecutiveCommand.START, 200):
        world.stop(kind=kind)
    stop_id = world.stop()
    world.wait_holding(stop_id)
    carried_out = [[one.command_id for one in status.results] for status in world.statuses]
    assert [now for now, _ in groupby(carried_out)] == [[], [stop_id]]


def test_a_stop_without_a_name_stops_and_many_stops_are_bounded(world: World) -> None:
    goal = world.drive()
    for stop_id in ('', 'x' * 1000):
        world.stops.publish(ExecutiveCommand(id=stop_id, kind=ExecutiveCommand.STOP, operator_id='y' * 5000))
    assert goal.wait().status is GoalStatus.CANCELED
    stops = [world.stop() for _ in range(60)]
    world.wait_holding(stops[-1])
    assert len(world.last.results) <= 32 and len(world.last.operator_id) <= 200
    world.answer(stops[-1])
    wait_until(lambda: not world.last.holding, 'the guard lets the robot go')


def test_a_guard_hears_the_stops_of_its_own_robot_alone() -> None:
    with (
        NodeRuntime.open('world', namespace='/a') as own,
        NodeRuntime.open('world', namespace='/b') as other,
        NodeRuntime.open('stop_guard', namespace='/a') as guard,
        NodeRuntime.open('stop_guard', namespace='/b') as other_guard,
    ):
        worlds = [World(own), World(other)]
        for runtime in (guard, other_guard):
            stop_guard.open_stop_guard(runtime)
        for one in worlds:
            one.wait_connected()
        mine, others = worlds
        other_id, stop_id = others.stop(), mine.stop()
        mine.wait_holding(stop_id)
        others.wait_holding(other_id)
        assert [[one.command_id for one in world.last.results] for world in worlds] == [[stop_id], [other_id]]


def test_the_guard_serves_nothing_that_a_large_request_could_keep_it_with() -> None:
    with NodeRuntime.open(names.STOP_GUARD, node_class=stop_guard.GuardNode) as runtime:
        stop_guard.open_stop_guard(runtime)
        served = {service.srv_type.__name__ for service in runtime.node.services}
        assert served <= {'GetTypeDescription'}
        with pytest.raises(ParameterImmutableException):  # nor can its own code change what it was started with
            runtime.call(lambda: runtime.node.undeclare_parameter('motion_actions'))
