# SPDX-License-Identifier: BSD-3-Clause
"""Missions of a whole robot in one process."""

from __future__ import annotations

from flexbt_testing.one_process.world import World


def test_the_robot_gets_to_the_kitchen(world: World) -> None:
    world.start('Navigate', autonomy='High')
    world.answer('/AskGoal', 'kitchen')
    world.run_until(world.asks('/AskGoal'), within=90)
    assert world.robot.near('kitchen', 0.15)
    assert world.states == ['/AskGoal', '/Drive', '/AskGoal']


def test_a_bt_server_that_dies_stops_the_robot(world: World) -> None:
    world.start('Navigate', autonomy='High')
    world.answer('/AskGoal', 'kitchen')
    world.run(5.0)
    assert world.robot.length > 0.5
    world.kill('bt_server')
    world.run(2.0)
    assert world.robot.at_rest
    world.restart('bt_server')
    world.run(10.0)
    world.stop()
