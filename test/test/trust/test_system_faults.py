# SPDX-License-Identifier: BSD-3-Clause
"""Stop, and death of each process while the robot drives: at rest in time, seen in time, and used again afterwards.

One process of each kind of fault is a real one. Others run in one process: what differs is who hears of it.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock

from flexbt_common.names import CLOCK
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

ROBOT = frozenset({'simulator', 'navigation', 'bt_server', 'stop_guard', 'onboard_executive'})
KITCHEN = (10.0, 2.3)

BRAKING_SECONDS = 0.26 / 2.5
REST_AFTER_STOP = 0.5 + BRAKING_SECONDS
REST_AFTER_DEATH = 1.0
SEEN_AFTER_DEATH = 3.0
RECOVERY_SECONDS = {'bt_server': 0.0, 'navigation': 6 * 1.0}
"""Of the tree that drives, before it fails: it asks up to six servers of navigation for a recovery, and waits for each
to appear for the BT server's `server_timeout`."""

SPEED = {'speed_factor': '3.0'}
"""Of the world: limits are in real time, ways and rest in that of the robot."""

SLOW_NODES = """
import time

def register(registry):
    time.sleep(5.0)
"""


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Probe]]:
    with Stack(tmp_path_factory.mktemp('system')) as stack, NodeRuntime.open('probe') as runtime:
        yield stack, Probe(runtime)


@pytest.fixture
def stack(system: tuple[Stack, Probe]) -> Stack:
    """Everything runs: what a test has ended is started again."""
    stack, probe = system
    ended, executive = ROBOT - stack.running(), probe.status.executive_id
    for name in ended:
        stack.start(name, SPEED if name == 'simulator' else None)
    if 'onboard_executive' in ended:
        probe.wait(lambda: probe.status.executive_id != executive, 'another executive')
    return stack


@pytest.fixture
def console() -> Iterator[Mirror]:
    """Yield what an operator sees."""
    with NodeRuntime.open('console') as runtime:
        mirror = Mirror(runtime.steady)
        ExecutiveLink(runtime, mirror, operator=None).open_surroundings()
        yield mirror


@pytest.fixture
def probe(system: tuple[Stack, Probe], stack: Stack) -> Iterator[Probe]:
    """Put the robot in the dock, with the executive idle."""
    probe = system[1]
    probe.wait_ready()
    probe.reset()
    yield probe
    if 'onboard_executive' in stack.running() and probe.status.state != ExecutiveStatus.IDLE:
        probe.stop()
        probe.wait_state(ExecutiveStatus.IDLE)


def in_one_process(victim: str) -> Any:
    """Return a parameter for a process whose fault differs from another one's only in what follows from it."""
    return pytest.param(victim, marks=pytest.mark.one_process)


def drive_again(probe: Probe) -> None:
    """Everything works as before."""
    probe.drive_to(*KITCHEN, driven=0.1)


def rest_after(probe: Probe, moment: float) -> float:
    """Seconds of uncontended time from a moment to the robot's last movement."""
    probe.wait_at_rest()
    return probe.moved_at - moment


def test_stop_while_driving_brings_the_robot_to_rest_and_leaves_no_goal(stack: Stack, probe: Probe) -> None:
    probe.drive_to(*KITCHEN)
    stopped = probe.stop()
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    assert rest_after(probe, stopped) < REST_AFTER_STOP
    for action in ('bt_executor', 'follow_path', 'compute_path_to_pose', 'operator_input'):
        assert probe.active_goals(action) == 0, action


@pytest.mark.parametrize(
    'bad',
    [Time(sec=-3), Time(sec=30 * 365 * 86_400), Time(sec=5, nanosec=4_000_000_000)],
    ids=['negative', 'late', 'none'],
)
def test_bad_times_on_clock_keep_no_stop_from_the_robot(bad: Time, stack: Stack, probe: Probe) -> None:
    """Four hundred of the first one froze the executive for good."""
    with NodeRuntime.open('forger') as forger:
        publisher = forger.call(lambda: forger.node.create_publisher(Clock, CLOCK, 10))
        wait_until(lambda: publisher.get_subscription_count() >= len(ROBOT) - 1, 'those who hear the time')
        probe.drive_to(*KITCHEN)
        sent = [0]

        def send() -> None:
            publisher.publish(Clock(clock=bad))
            sent[0] += 1
            forger.steady.call_at(forger.steady.now() + 0.005, send)

        send()
        wait_until(lambda: sent[0] >= 400, 'the bad times')
        stopped = probe.stop()
        probe.wait_state(ExecutiveStatus.IDLE)
        assert rest_after(probe, stopped) < REST_AFTER_STOP
    drive_again(probe)


@pytest.mark.parametrize('victim', ['bt_server', in_one_process('navigation')])
def test_a_server_that_is_killed_while_driving(victim: str, stack: Stack, probe: Probe, console: Mirror) -> None:
    before = {run.run_id for run in console.view().trees}  # that of a server killed just before may be drawn, too
    probe.drive_to(*KITCHEN)
    runs = probe.wait(lambda: {run.run_id for run in console.view().running_trees} - before, 'the tree on a console')
    killed = stack.kill(victim)
    probe.wait(lambda: probe.peer_alive(victim) is False, f'{victim} shown as dead')
    assert uncontended_time() - killed < SEEN_AFTER_DEATH
    probe.wait(lambda: probe.status.decisions, 'the state that drives has failed: the operator decides')
    assert uncontended_time() - killed < SEEN_AFTER_DEATH + RECOVERY_SECONDS[victim]
    assert rest_after(probe, killed) < REST_AFTER_DEATH
    probe.wait(lambda: not console.view().running_trees, 'no tree runs any more for a console')
    assert uncontended_time() - killed < SEEN_AFTER_DEATH + RECOVERY_SECONDS[victim]
    drawn = [run.server_gone for run in console.view().drawn_trees if run.run_id in runs]
    assert drawn == [True] * (victim == 'bt_server')
    assert stack.running() == ROBOT - {victim}
    assert probe.status.state == ExecutiveStatus.RUNNING, 'the behavior continues: what to do now is for the operator'
    stack.start(victim)
    probe.wait(lambda: probe.peer_alive(victim), f'{victim} alive again')
    probe.stop()
    probe.wait_state(ExecutiveStatus.IDLE)
    drive_again(probe)


@pytest.mark.parametrize('victim', [in_one_process('bt_server'), 'onboard_executive'])
def test_the_robot_is_held_while_a_process_hangs_and_goes_on(victim: str, stack: Stack, probe: Probe) -> None:
    probe.drive_to(*KITCHEN)
    suspended = stack.send_signal(victim, signal.SIGSTOP)
    assert rest_after(probe, suspended) < REST_AFTER_DEATH
    there = probe.moved_stamp
    stack.send_signal(victim, signal.SIGCONT)
    probe.wait(lambda: probe.moved_stamp > there, 'robot driving on')
    assert probe.status.state == ExecutiveStatus.RUNNING


def test_a_run_that_starts_while_a_server_begins_waits_for_it(stack: Stack, probe: Probe, tmp_path: Path) -> None:
    """Whatever makes the server slow; here it is a package of nodes whose import takes several seconds."""
    (tmp_path / 'slow_nodes.py').write_text(SLOW_NODES)
    about = tmp_path / 'slow_nodes-1.0.dist-info'
    about.mkdir()
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: slow_nodes\nVersion: 1.0\n')
    (about / 'entry_points.txt').write_text('[flexbt.bt_nodes]\nslow_nodes = slow_nodes:register\n')
    stack.kill('bt_server')
    probe.wait(lambda: probe.peer_alive('bt_server') is False, 'bt_server shown as dead')
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])
    stack.start('bt_server', environment={'PYTHONPATH': path})
    probe.wait(lambda: probe.peer_alive('bt_server'), 'bt_server alive again')
    drive_again(probe)


@pytest.mark.one_process
def test_an_executive_that_is_killed_while_driving(stack: Stack, probe: Probe) -> None:
    probe.drive_to(*KITCHEN)
    killed = stack.kill('onboard_executive')
    assert rest_after(probe, killed) < REST_AFTER_DEATH
    # The operator sees it by the heartbeat that does not come.
    assert 2.5 * probe.status.heartbeat_period < SEEN_AFTER_DEATH
    assert stack.running() == ROBOT - {'onboard_executive'}
    probe.wait(lambda: probe.active_goals('bt_executor') == 0, 'the tree of the dead executive ended')
    dead = probe.status.executive_id
    stack.start('onboard_executive')
    probe.wait(lambda: probe.status.executive_id != dead, 'another executive')
    probe.wait_ready()
    drive_again(probe)


@pytest.mark.one_process
def test_a_simulator_that_is_killed_while_driving(stack: Stack, probe: Probe) -> None:
    probe.drive_to(*KITCHEN)
    killed = stack.kill('simulator')
    probe.wait(lambda: probe.peer_alive('simulator') is False, 'simulator shown as dead')
    probe.wait(lambda: 'any more' in probe.status.pose_problem, 'the pose shown as old')
    assert uncontended_time() - killed < SEEN_AFTER_DEATH
    # Simulated time stands still now, and yet no goal hangs and the operator's stop works.
    probe.wait(lambda: probe.active_goals('follow_path') == 0, 'the goal of the motion ended')
    probe.stop()
    probe.wait_state(ExecutiveStatus.IDLE)
    stack.start('simulator', SPEED)
    probe.wait_ready()
    drive_again(probe)


@pytest.mark.one_process
def test_a_result_says_why_when_navigation_is_not_there(stack: Stack, probe: Probe) -> None:
    assert stack.end('navigation', signal.SIGINT, DEADLINE).exit_code == 0
    probe.wait_at_rest()  # a goal that comes sooner may be stopped with the run before
    goal = BtExecute.Goal(behavior_tree='flexbt_demo_behaviors/navigate/recovery.xml')
    outcome = probe.call(BtExecute, 'bt_executor', goal)
    assert outcome.result is not None
    assert outcome.result.code == BtExecute.Result.FAILURE
    assert 'clear_entirely' in outcome.result.message or 'no ' in outcome.result.message
    assert outcome.result.failed_node


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_every_process_ends_in_time_and_in_order_while_the_robot_drives(
    number: signal.Signals, stack: Stack, probe: Probe
) -> None:
    probe.drive_to(*KITCHEN)
    for name in ('onboard_executive', 'bt_server', 'navigation', 'simulator'):
        ending = stack.end(name, number, DEADLINE)
        # What runs may take 1.2 s of wall time to halt: on a busy machine that is not always enough.
        assert ending.exit_code == 0 or ending.held_up > 0.5, ending
        assert ending.seconds < 2.0, ending
        assert 'Traceback' not in ending.output, ending
