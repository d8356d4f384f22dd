# SPDX-License-Identifier: BSD-3-Clause
"""The process that gave the goals is killed: those of an owner end and the robot stops; others go on."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.message_fields import duration_message
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, line, open_sim_world
from flexbt_testing.waiting import DEADLINE, uncontended_time

pytestmark = pytest.mark.dds('processes are killed, stopped and continued')


@pytest.fixture
def world() -> Iterator[RobotProbe]:
    with open_sim_world({'speed_factor': 1.0}) as probe:
        yield probe


@contextlib.contextmanager
def goal_giver(name: str) -> Iterator[subprocess.Popen[str]]:
    """Provide a process whose goal sends the robot along the corridor."""
    script = Path(__file__).with_name('goal_giver.py')
    with subprocess.Popen([sys.executable, str(script), name], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == 'accepted\n'
            yield process
        finally:
            process.kill()


def test_the_robot_of_a_killed_owner_is_at_rest_within_a_second_and_its_successor_drives_it(world: RobotProbe) -> None:
    pause = world.send(names.WAIT, time=duration_message(100.0))
    with goal_giver(names.BT_SERVER) as owner:
        world.wait_driving()
        owner.kill()
        killed = uncontended_time()
        world.wait_at_rest()
        assert uncontended_time() - killed < 1.0 + 0.3  # it has been at rest for 0.3 s
        # One that was killed before it has said which process it is, is late for a while before its goals end.
        assert pause.wait().status is GoalStatus.ABORTED
        assert 'bt_server' in pause.result.error_msg
    with goal_giver(names.BT_SERVER):
        world.wait_driving()


def test_the_robot_is_held_while_the_owner_is_late_and_goes_on_with_the_same_goal(world: RobotProbe) -> None:
    with goal_giver(names.BT_SERVER) as owner:
        world.wait_driving()
        owner.send_signal(signal.SIGSTOP)
        stopped = uncontended_time()
        world.wait_at_rest()
        assert uncontended_time() - stopped < 1.0 + 0.3
        owner.send_signal(signal.SIGCONT)
        world.wait_driving()  # nobody has sent another goal
        owner.kill()
        world.wait_at_rest()


def test_the_goals_of_others_outlive_them(world: RobotProbe) -> None:
    with goal_giver('somebody') as somebody:
        world.wait_driving()
        somebody.kill()
        somebody.wait()
    before = len(world.commands)
    world.later(1.5)
    assert min(linear for linear, _ in world.commands[before:]) > 0.2
    goal = world.follow(line(DOCK, (1.0, 4.45)))  # somebody else can take the robot
    assert goal.accepted.wait(DEADLINE)
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    world.wait_at_rest()
