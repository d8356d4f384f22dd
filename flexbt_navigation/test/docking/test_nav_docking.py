# SPDX-License-Identifier: BSD-3-Clause
"""dock_robot and undock_robot at the charging stations of a world file: the battery says that the robot is charged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from nav2_msgs.action import DockRobot, UndockRobot
from nav2_msgs.msg import SpeedLimit
from nav2_msgs.srv import ReloadDockDatabase
from sensor_msgs.msg import BatteryState

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_msgs.srv import SetFault
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import RobotProbe, aborted, open_sim_world, pose
from flexbt_testing.waiting import wait_until

Result, Feedback = DockRobot.Result, DockRobot.Feedback

HOME = (11.2, 4.45, 0.0)
"""At the east end of the corridor."""
BEFORE = (9.5, 4.45, 0.0)

WORLD = """\
map: {map}
robots:
  turtle: {{model: waffle, pose: [9.5, 4.45, 0.0]}}
stations:
  home: {{pose: [11.2, 4.45, 0.0]}}
"""


@pytest.fixture(scope='module')
def world_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp('worlds') / 'corridor.yaml'
    file.write_text(WORLD.format(map=built_in_map()))
    return file


@pytest.fixture(scope='module')
def world(world_file: Path) -> Iterator[RobotProbe]:
    simulator = {
        'world': str(world_file),
        'robot_namespaces': False,
        'initialpose_moves_robot': True,
        'speed_factor': 0.0,
    }
    with open_sim_world(simulator, {'dock_database': str(world_file), 'max_retries': 1}) as probe:
        yield probe


@pytest.fixture(scope='module')
def battery(world: RobotProbe) -> list[bool]:
    """Return whether the battery is charged, as it is told."""
    told: list[bool] = []

    def on_battery(message: BatteryState) -> None:
        told.append(message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING)

    node = world.runtime.node
    world.runtime.call(lambda: node.create_subscription(BatteryState, names.BATTERY_STATE, on_battery, 1))
    return told


def dock(world: RobotProbe, **fields: Any) -> SentGoal:
    return world.send(names.DOCK_ROBOT, **({'use_dock_id': True, 'dock_id': 'home'} | fields))


def undock(world: RobotProbe, **fields: Any) -> SentGoal:
    return world.send(names.UNDOCK_ROBOT, **fields)


def test_a_robot_drives_to_the_station_is_charged_and_leaves_it(world: RobotProbe, battery: list[bool]) -> None:
    world.place(BEFORE)
    goal = dock(world)
    assert goal.wait().status is GoalStatus.SUCCEEDED, goal.result
    assert (goal.result.success, goal.result.error_code, goal.result.num_retries) == (True, Result.NONE, 0)
    states = [message.state for message in goal.feedback]
    assert states == sorted(states)
    assert {Feedback.NAV_TO_STAGING_POSE, Feedback.CONTROLLING} <= set(states)
    rest = world.wait_at_rest()
    assert rest.distance(HOME) < 0.1
    assert battery[-1]
    again = dock(world)
    assert again.wait().status is GoalStatus.SUCCEEDED
    assert world.wait_at_rest().distance(rest[1:]) < 0.01
    left = undock(world, max_undocking_time=30.0)
    assert left.wait().status is GoalStatus.SUCCEEDED
    assert (left.result.success, left.result.error_code) == (True, UndockRobot.Result.NONE)
    assert world.wait_at_rest().distance(HOME) == pytest.approx(0.7, abs=0.12)
    assert not battery[-1]


def test_a_robot_that_is_on_no_dock_has_nothing_to_leave(world: RobotProbe, battery: list[bool]) -> None:
    there = world.place(BEFORE)
    world.wait(lambda: battery[-1:] == [False], 'no charge')
    result = aborted(undock(world), UndockRobot.Result.NONE)  # as opennav_docking
    assert not result.success and 'on no dock' in result.error_msg
    assert world.later(0.3)[1:] == there[1:]


NOWHERE = {'use_dock_id': False, 'dock_pose': pose((math.nan, 1.0))}
REFUSED = {
    'id': ({'dock_id': 'moon'}, Result.DOCK_NOT_IN_DB, "'moon'; known: home"),
    'type': ({'use_dock_id': False, 'dock_pose': pose(HOME), 'dock_type': 'x'}, Result.DOCK_NOT_VALID, "'x'"),
    'pose': (NOWHERE, Result.DOCK_NOT_VALID, 'nan'),
    'frame': ({'use_dock_id': False, 'dock_pose': pose(HOME, 'moon')}, Result.UNKNOWN, "'moon'"),
    'wall': ({'use_dock_id': False, 'dock_pose': pose((1.6, 1.25))}, Result.FAILED_TO_STAGE, ''),
    'time': ({'max_staging_time': 0.5}, Result.FAILED_TO_STAGE, '0.5 s'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_cannot_be_docked_at_is_refused_with_nav2s_code(world: RobotProbe, case: str) -> None:
    fields, code, said = REFUSED[case]
    world.place(BEFORE)
    result = aborted(dock(world, **fields), code)
    assert said in result.error_msg
    assert not result.success
    world.wait_at_rest()


def test_where_nothing_charges_docking_is_tried_again_and_fails(world: RobotProbe, battery: list[bool]) -> None:
    world.place((8.3, 4.45, 0.0))
    elsewhere = {'use_dock_id': False, 'dock_pose': pose((9.0, 4.45, 0.0)), 'navigate_to_staging_pose': False}
    goal = dock(world, **elsewhere)
    assert aborted(goal, Result.FAILED_TO_CHARGE).num_retries == 1
    assert Feedback.RETRY in {message.state for message in goal.feedback}
    plain = dock(world, **elsewhere, dock_type='simple_non_charging_dock')
    assert plain.wait().status is GoalStatus.SUCCEEDED
    left = undock(world, max_undocking_time=30.0)
    assert left.wait().status is GoalStatus.SUCCEEDED
    assert world.wait_at_rest().distance((9.0, 4.45)) == pytest.approx(0.7, abs=0.12)
    aborted(undock(world, dock_type='x'), UndockRobot.Result.DOCK_NOT_VALID)


def test_what_the_battery_has_reported_does_not_count_after_the_robot_has_moved(
    world: RobotProbe, battery: list[bool]
) -> None:
    def silence(*, clear: bool) -> None:
        fault = SetFault.Request(fault='sensor_silent', parameters='{sensor: battery}', clear=clear)
        assert world.ask(SetFault, 'simulator/set_fault', fault).success

    world.place(BEFORE)
    assert dock(world).wait().status is GoalStatus.SUCCEEDED
    silence(clear=False)
    try:
        assert dock(world).wait().status is GoalStatus.SUCCEEDED
        world.place(BEFORE)
        aborted(dock(world), Result.FAILED_TO_CHARGE)
        assert world.wait_at_rest().distance(HOME) < 0.1
    finally:
        world.place(BEFORE)
        battery.clear()
        silence(clear=True)
        world.wait(lambda: battery[-1:] == [False], 'no charge')


def test_a_limit_of_the_speed_holds_on_the_way_to_the_staging_pose(world: RobotProbe) -> None:
    world.place((2.0, 4.45, 0.0))
    node = world.runtime.node
    limits = world.runtime.call(lambda: node.create_publisher(SpeedLimit, names.SPEED_LIMIT, 1))
    wait_until(limits.get_subscription_count)

    def drives_at(speed: float) -> bool:
        return bool(world.commands[-1][0] == pytest.approx(speed))

    goal = dock(world)
    world.wait_driving(0.25)
    limits.publish(SpeedLimit(speed_limit=0.15))
    wait_until(partial(drives_at, 0.15))
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    world.wait_at_rest()
    before = len(world.commands)
    goal = dock(world)
    world.wait_driving(0.14)
    assert max(linear for linear, _ in world.commands[before:]) == pytest.approx(0.15)
    limits.publish(SpeedLimit())
    wait_until(partial(drives_at, 0.26))
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    world.runtime.call(lambda: node.destroy_publisher(limits))


def test_docking_is_canceled_and_taken_over_at_any_time(world: RobotProbe) -> None:
    world.place((2.0, 4.45, 0.0))
    for begun in (False, True):
        goal = dock(world)
        if begun:
            world.wait_driving(0.1)
        goal.cancel()
        assert goal.wait().status is GoalStatus.CANCELED
        world.wait_at_rest()
    older = dock(world)
    world.wait(lambda: older.feedback, 'the robot on its way')
    newer = dock(world)
    aborted(older, Result.NONE)
    world.wait(lambda: newer.feedback, 'the robot on its way again')
    turn = world.send(names.SPIN, target_yaw=0.5)
    aborted(newer, Result.NONE)
    assert turn.wait().status is GoalStatus.SUCCEEDED


def test_a_refused_goal_stops_the_robot_on_the_one_that_it_was_to_replace(
    world: RobotProbe, battery: list[bool]
) -> None:
    """As in Nav2, and as a refused path does."""
    world.place(BEFORE)
    goal = dock(world)
    world.wait_driving(0.1)
    aborted(undock(world, dock_type='x'), UndockRobot.Result.DOCK_NOT_VALID)
    assert not goal.ended
    aborted(dock(world, dock_id='moon'), Result.DOCK_NOT_IN_DB)
    assert 'was to replace it' in aborted(goal, Result.NONE).error_msg
    world.wait_at_rest()
    left = undock(world, dock_type='simple_non_charging_dock', max_undocking_time=30.0)
    world.wait_driving(0.05)
    aborted(undock(world, dock_type='x'), UndockRobot.Result.DOCK_NOT_VALID)
    assert 'was to replace it' in aborted(left, UndockRobot.Result.NONE).error_msg
    world.wait_at_rest()


def test_another_database_replaces_the_docks_and_a_broken_one_does_not(
    world: RobotProbe, world_file: Path, tmp_path: Path
) -> None:
    def reload(file: Path) -> bool:
        request = ReloadDockDatabase.Request(filepath=str(file))
        return bool(world.ask(ReloadDockDatabase, names.RELOAD_DOCKS, request).success)

    docks = 'docks: {shelf: {type: shelf, pose: [1, 2, 0]}}'
    outside = tmp_path / 'docks.yaml'  # not where the file is that a parameter names
    outside.write_text(docks)
    assert not reload(outside)
    file = world_file.parent / 'docks.yaml'
    file.write_text(docks)
    assert reload(file)
    aborted(dock(world), Result.DOCK_NOT_IN_DB)
    aborted(dock(world, dock_id='shelf'), Result.DOCK_NOT_VALID)
    file.write_text('docks: 3')
    assert not reload(file)
    aborted(dock(world, dock_id='shelf'), Result.DOCK_NOT_VALID)
    assert reload(world_file)
