# SPDX-License-Identifier: BSD-3-Clause
"""An operator stops and pauses a robot that drives: it stands still, whatever hangs, and goes on where it was."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator

import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, LivelinessWatch
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.system.hold_up import THREADS
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import uncontended_time

GOAL = (3.8, 1.2)
HOME = (0.8, 4.45)
"""Where the robot is when the simulation begins."""
REST_SECONDS = 1.0
"""From a stop, or the hang of what drives the robot, to rest."""
HANG_SECONDS = PEER_TIMEOUT + 1.0
"""Longer than others wait for a process that hangs."""


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Probe]]:
    with Stack(tmp_path_factory.mktemp('system'), can_be_held_up=True) as stack, NodeRuntime.open('probe') as runtime:
        stack.start_all({'speed_factor': '3.0'})
        yield stack, Probe(runtime)


@pytest.fixture
def stack(system: tuple[Stack, Probe]) -> Stack:
    return system[0]


@pytest.fixture
def probe(system: tuple[Stack, Probe]) -> Iterator[Probe]:
    """Have the robot drive."""
    probe = system[1]
    probe.wait_ready()
    probe.reset()
    probe.drive_to(*GOAL, driven=0.1)
    yield probe
    if probe.status.state != ExecutiveStatus.IDLE:
        probe.stop()
        probe.wait_state(ExecutiveStatus.IDLE)


def rest_after(probe: Probe, moment: float) -> float:
    """Seconds of uncontended time from a moment to the robot's last movement."""
    probe.wait_at_rest()
    return probe.moved_at - moment


def wait_near(probe: Probe, place: tuple[float, float]) -> None:
    """Wait until the robot is seen at a place: the end of its goal may be heard sooner."""

    def is_near() -> bool:
        assert probe.pose is not None
        position = probe.pose.pose.position
        return math.dist((position.x, position.y), place) < 0.3

    probe.wait(is_near, f'the robot at {place}')


def test_a_stop_while_the_bt_server_hangs(stack: Stack, probe: Probe) -> None:
    """For longer than others wait for it, and shorter than the lease of its participant."""
    stack.send_signal('bt_server', signal.SIGSTOP)
    try:
        stopped = probe.stop()
        probe.wait(lambda: 'goal of bt_executor not confirmed canceled' in probe.status.message, 'what has not stopped')
        assert rest_after(probe, stopped) < REST_SECONDS
        probe.wait(lambda: probe.peer_alive('bt_server') is False, 'bt_server shown as gone')
        assert probe.status.state == ExecutiveStatus.STOPPING
    finally:
        where = probe.moved_stamp
        stack.send_signal('bt_server', signal.SIGCONT)
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    probe.wait_at_rest()
    assert probe.moved_stamp == where, 'what was stopped moves again'
    probe.wait_ready()


@pytest.mark.parametrize(
    ('process', 'thread'),
    [
        ('bt_server', 'executor'),
        pytest.param('onboard_executive', 'executor', marks=pytest.mark.one_process),
        pytest.param('onboard_executive', 'run', marks=pytest.mark.one_process),
    ],
)
def test_a_stop_while_one_thread_hangs(stack: Stack, probe: Probe, process: str, thread: str) -> None:
    """For longer than others wait for its process: when it goes on, nothing of what was stopped does."""
    watch = LivelinessWatch(probe.console, process)
    held_up = stack.hold_up(process, THREADS[process][thread], HANG_SECONDS)
    probe.wait(lambda: watch.late, f'{process} late')
    probe.stop()
    assert rest_after(probe, held_up) < REST_SECONDS
    where = probe.moved_stamp
    probe.wait(lambda: watch.ready, f'{process} as before')
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    probe.wait_at_rest()
    assert probe.moved_stamp == where, 'what was stopped moves again'
    watch.close()


@pytest.mark.one_process
@pytest.mark.parametrize(
    ('process', 'thread'),
    [
        (process, thread)
        for process, threads in THREADS.items()
        for thread in threads
        # With the world the robot and its time stand still; the benchmark of faults has the clocks.
        if thread not in ('world', 'clock')
    ],
)
def test_the_robot_stands_still_while_one_thread_hangs_and_drives_on(
    stack: Stack, probe: Probe, process: str, thread: str
) -> None:
    held_up = stack.hold_up(process, THREADS[process][thread], 3.0)
    assert rest_after(probe, held_up) < REST_SECONDS
    there = probe.moved_stamp
    probe.wait(lambda: probe.moved_stamp > there, 'the robot drives on')
    assert probe.status.state == ExecutiveStatus.RUNNING


def pause(probe: Probe) -> float:
    """Return the uncontended time when the robot is told to stand still."""
    now = uncontended_time()
    probe.applied(ExecutiveCommand.PAUSE)
    return now


@pytest.mark.one_process
def test_a_paused_robot_stands_still_and_goes_on_where_it_was(stack: Stack, probe: Probe) -> None:
    paused = pause(probe)
    probe.wait_state(ExecutiveStatus.PAUSED)
    assert rest_after(probe, paused) < REST_SECONDS
    probe.wait_at_rest()
    assert [list(state.not_paused) for state in probe.status.active_states] == [[]]
    where = probe.moved_stamp
    run_id = probe.run_id
    probe.applied(ExecutiveCommand.RESUME)
    probe.wait(lambda: probe.moved_stamp > where, 'the robot drives on')
    probe.wait(lambda: probe.status.decisions, 'the decision about the next goal')
    wait_near(probe, GOAL)
    assert (probe.run_id, probe.status.state) == (run_id, ExecutiveStatus.RUNNING)


@pytest.mark.one_process
def test_a_goal_of_somebody_else_waits_for_the_end_of_the_pause(stack: Stack, probe: Probe) -> None:
    pause(probe)
    probe.wait_at_rest()
    where = probe.moved_stamp
    elsewhere = PoseStamped(header=Header(frame_id='map'))
    elsewhere.pose.position.x, elsewhere.pose.position.y, elsewhere.pose.orientation.w = *HOME, 1.0
    goal = SentGoal(
        ActionLinks(probe.console).link(BtExecute, names.BT_EXECUTOR),
        BtExecute.Goal(behavior_tree='flexbt_demo_behaviors/navigate/navigate.xml', goals=[elsewhere]),
    )
    probe.wait(lambda: goal.feedback, 'the tree works for the other goal')
    probe.wait_at_rest()
    assert probe.moved_stamp == where and not goal.ended
    probe.applied(ExecutiveCommand.RESUME)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    wait_near(probe, HOME)
    replaced = 'a newer goal for the same tree has taken over'
    probe.wait(lambda: any(replaced in line.text for line in probe.logs), 'why the state has failed')


@pytest.mark.one_process
def test_a_paused_robot_is_stopped(stack: Stack, probe: Probe) -> None:
    pause(probe)
    probe.wait_at_rest()
    probe.stop()
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    where = probe.moved_stamp
    probe.wait_at_rest()
    assert probe.moved_stamp == where, 'nothing continues that was paused'
    for action in ('bt_executor', 'follow_path'):
        assert probe.active_goals(action) == 0, action


@pytest.mark.one_process
def test_the_server_of_a_paused_robot_is_killed(stack: Stack, probe: Probe) -> None:
    pause(probe)
    probe.wait_at_rest()
    where = probe.moved_stamp
    stack.kill('bt_server')
    probe.wait(lambda: probe.peer_alive('bt_server') is False, 'bt_server shown as dead')
    stack.start('bt_server')
    probe.wait_ready()
    probe.applied(ExecutiveCommand.RESUME)
    probe.wait(lambda: probe.status.decisions, 'the decision about the failed tree')
    probe.wait_at_rest()
    assert probe.moved_stamp == where


@pytest.mark.one_process
def test_a_state_that_is_left_while_its_server_hangs(stack: Stack, probe: Probe) -> None:
    """The run goes on after some seconds, and says what it does not know; what was left moves nothing any more."""
    stack.send_signal('bt_server', signal.SIGSTOP)
    try:
        left = uncontended_time()
        probe.send(ExecutiveCommand.FORCE, path='/Drive', outcome='failed')
        assert rest_after(probe, left) < REST_SECONDS
        probe.wait(lambda: not any(state.path == '/Drive' for state in probe.status.active_states), 'the next state')
        told = 'goal of bt_executor not confirmed canceled'
        probe.wait(lambda: any(line.path == '/Drive' and told in line.text for line in probe.logs), 'what is not known')
    finally:
        goes_on = stack.send_signal('bt_server', signal.SIGCONT)
    probe.wait(lambda: probe.active_goals('bt_executor') == 0, 'the end of the tree that was left')
    # Navigation lets the motion go on for the moment in which the tree hears of its cancel: 8 cm within 0.1 s here.
    assert rest_after(probe, goes_on) < REST_SECONDS, 'what was left moves again'
    assert probe.status.state == ExecutiveStatus.RUNNING
