# SPDX-License-Identifier: BSD-3-Clause
"""An operator's STOP stops the robot, whoever drives it, while the executive hangs or is dead."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable, Iterator
from typing import Any, Final

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import FollowPath, NavigateToPose
from nav_msgs.msg import Path as PathMessage
from std_msgs.msg import Header

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, StopGuardStatus
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import run_console
from flexbt_testing.waiting import uncontended_time, wait_until

FAR: Final = (10.0, 2.3)
TREE: Final = 'flexbt_demo_behaviors/navigate/navigate.xml'
REST_SECONDS: Final = 1.0
REST_METRES: Final = 0.3
"""From a STOP to rest."""

QUIET_SECONDS: Final = 1.0
"""For which a robot that was stopped is seen at rest: nothing tries again later than that."""

DRIVEN: Final = 0.1
"""m, after which a robot drives."""

HELD_METRES: Final = 0.05
"""For which a goal that comes later moves a robot that is held."""


class Guard:
    """What the stop guard says of itself."""

    def __init__(self, probe: Probe) -> None:
        self.statuses: list[StopGuardStatus] = []
        runtime = probe.console
        runtime.call(
            lambda: runtime.node.create_subscription(
                StopGuardStatus, names.STOP_GUARD_STATUS, self.statuses.append, names.transient_local_qos()
            )
        )

    @property
    def holds(self) -> bool:
        return bool(self.statuses) and bool(self.statuses[-1].holding)

    def has_carried_out(self, stop_id: str) -> bool:
        return bool(self.statuses) and stop_id in [one.command_id for one in self.statuses[-1].results]


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Probe, Guard]]:
    with Stack(tmp_path_factory.mktemp('system')) as stack, NodeRuntime.open('probe') as runtime:
        stack.start_all({'speed_factor': '1.0'}, {'navigators': '["navigate_to_pose"]'}, in_one=True)
        probe = Probe(runtime)
        probe.wait_ready()
        yield stack, probe, Guard(probe)


def metres(one: PoseStamped | None, other: PoseStamped | None) -> float:
    assert one is not None and other is not None
    a, b = one.pose.position, other.pose.position
    return math.dist((a.x, a.y), (b.x, b.y))


def somewhere() -> PoseStamped:
    pose = PoseStamped(header=Header(frame_id='map'))
    pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = *FAR, 1.0
    return pose


def by_tree(links: ActionLinks, probe: Probe) -> SentGoal:
    goal = BtExecute.Goal(behavior_tree=TREE, goals=[somewhere()])
    return SentGoal(links.link(BtExecute, names.BT_EXECUTOR), goal)


def by_navigator(links: ActionLinks, probe: Probe) -> SentGoal:
    return SentGoal(links.link(NavigateToPose, names.NAVIGATE_TO_POSE), NavigateToPose.Goal(pose=somewhere()))


def by_controller(links: ActionLinks, probe: Probe) -> SentGoal:
    assert probe.pose is not None
    start = probe.pose
    path = PathMessage(header=Header(frame_id='map'))
    for step in range(40):
        pose = PoseStamped(header=path.header)
        pose.pose.position.x = start.pose.position.x + 0.05 * step
        pose.pose.position.y = start.pose.position.y
        pose.pose.orientation.w = 1.0
        path.poses.append(pose)
    return SentGoal(links.link(FollowPath, names.FOLLOW_PATH), FollowPath.Goal(path=path))


def in_one_process(drive: Callable[[ActionLinks, Probe], SentGoal]) -> Any:
    """Return a parameter for what differs from a tree only in who is asked to drive."""
    return pytest.param(drive, marks=pytest.mark.one_process)


@pytest.mark.parametrize('drive', [by_tree, in_one_process(by_navigator), in_one_process(by_controller)])
@pytest.mark.parametrize('executive', ['alive', 'hung', 'dead'])
def test_a_stop_while_another_program_drives(
    system: tuple[Stack, Probe, Guard], drive: Callable[[ActionLinks, Probe], SentGoal], executive: str
) -> None:
    stack, probe, guard = system
    probe.wait_ready()
    probe.reset()
    began = probe.moved_stamp
    goal = drive(ActionLinks(probe.console), probe)
    probe.wait(lambda: probe.moved_stamp - began > 0.5, 'the robot drives')
    if executive == 'hung':
        stack.send_signal('onboard_executive', signal.SIGSTOP)
    elif executive == 'dead':
        stack.kill('onboard_executive')
    try:
        there, stopped = probe.pose, uncontended_time()
        stop_id = probe.send(ExecutiveCommand.STOP)
        ended = goal.wait()
        probe.wait_at_rest(QUIET_SECONDS)
        assert ended.status is not GoalStatus.SUCCEEDED
        assert probe.moved_at - stopped < REST_SECONDS
        assert metres(there, probe.pose) < REST_METRES
        if executive != 'alive':
            wait_until(lambda: guard.has_carried_out(stop_id), 'the guard says that it has stopped the robot')
            assert guard.holds
            # What comes meanwhile is stopped as well: the robot is held until an executive has heard of the STOP.
            where = probe.pose
            assert drive(ActionLinks(probe.console), probe).wait().status is not GoalStatus.SUCCEEDED
            probe.wait_at_rest(QUIET_SECONDS)
            assert metres(where, probe.pose) < HELD_METRES
    finally:
        if executive == 'hung':
            stack.send_signal('onboard_executive', signal.SIGCONT)
        elif executive == 'dead':
            stack.start('onboard_executive')
    wait_until(lambda: not guard.holds, 'the guard lets the robot go')
    probe.wait_ready()
    probe.drive_to(*FAR, DRIVEN)
    probe.stop()
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    probe.wait_at_rest(QUIET_SECONDS)  # a goal that comes sooner may be stopped with it


def test_a_stop_of_a_run_whose_executive_hangs(system: tuple[Stack, Probe, Guard]) -> None:
    """When it goes on, it has heard of the STOP before anything moves."""
    stack, probe, guard = system
    probe.wait_ready()
    probe.reset()
    probe.drive_to(*FAR, DRIVEN)
    stack.send_signal('onboard_executive', signal.SIGSTOP)
    try:
        stopped = uncontended_time()
        stop_id = probe.send(ExecutiveCommand.STOP)
        wait_until(lambda: guard.has_carried_out(stop_id), 'the guard says that it has stopped the robot')
        probe.wait_at_rest(QUIET_SECONDS)
        assert probe.moved_at - stopped < REST_SECONDS
        where = probe.moved_stamp
    finally:
        stack.send_signal('onboard_executive', signal.SIGCONT)
    probe.wait_state(ExecutiveStatus.IDLE)
    assert probe.status.outcome == 'preempted'
    wait_until(lambda: not guard.holds, 'the guard lets the robot go')
    probe.wait_at_rest(QUIET_SECONDS)
    assert probe.moved_stamp == where, 'what was stopped moves again'


def test_a_console_says_who_has_confirmed_a_stop(system: tuple[Stack, Probe, Guard]) -> None:
    """Also one that begins when the executive hangs, so that it has no picture."""
    stack, probe, guard = system
    probe.wait_ready()
    alive = run_console('stop', '--operator', 'ann')
    assert alive.returncode == 0 and 'confirmed by the executive' in alive.stdout, alive
    stack.send_signal('onboard_executive', signal.SIGSTOP)
    try:
        hung = run_console('stop', '--operator', 'ann')
        assert hung.returncode == 0 and 'confirmed by the stop guard' in hung.stdout, hung
        # A console that waits in vain for an executive prints what it has heard until then.
        # On a busy machine 2 s can be over before it has discovered the guard.
        wait_until(
            lambda: 'HELD BY THE STOP GUARD' in run_console('status', '--operator', 'ann', '--timeout', '2').stderr,
            'a console that prints that the stop guard holds the robot',
        )
        stack.send_signal('stop_guard', signal.SIGSTOP)
        neither = run_console('stop', '--operator', 'ann', '--timeout', '2', '--json')
        told = json.loads(neither.stdout)
        assert neither.returncode != 0 and told['confirmed_by'] == '', neither
        assert 'neither the executive nor the stop guard' in told['reason']
    finally:
        stack.send_signal('onboard_executive', signal.SIGCONT)
        stack.send_signal('stop_guard', signal.SIGCONT)
    wait_until(lambda: not guard.holds, 'the guard lets the robot go')


def test_a_guard_that_is_missing_is_shown(system: tuple[Stack, Probe, Guard]) -> None:
    stack, probe, guard = system
    probe.wait_ready()
    stack.kill('stop_guard')
    probe.wait(lambda: probe.peer_alive('stop_guard') is False, 'the guard shown as gone')
    stack.start('stop_guard')
    probe.wait_ready()
    assert not guard.holds
