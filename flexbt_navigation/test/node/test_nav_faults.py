# SPDX-License-Identifier: BSD-3-Clause
"""A simulator that comes late, dies and comes back; navigation servers that end while the robot drives."""

from __future__ import annotations

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from nav2_msgs.action import ComputePathToPose, FollowPath, Spin
from nav2_msgs.srv import GetCost
from sensor_msgs.msg import LaserScan
from simulation_interfaces.srv import ResetSimulation
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.calls.goal_server import goal_servers
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message, time_message
from flexbt_navigation import node, robot_interface
from flexbt_navigation.node import Navigation
from flexbt_navigation.robot_interface import PoseWatch
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import DriveModel
from flexbt_testing.nodes.sim_world import (
    DOCK,
    FAST,
    OFFICE,
    aborted,
    line,
    open_navigation,
    open_probe,
    open_sim_world,
    open_simulator,
    without_faults,
)
from flexbt_testing.waiting import DEADLINE, contended_time, uncontended_time, wait_until

EAST = (11.2, 4.45)
CRATE = f"""
map: {built_in_map()}
robots: {{turtle: {{pose: [3.0, 3.95, 0]}}}}
obstacles: {{crate: {{pose: [8.0, 3.95, 0], shape: [0.4, 0.4]}}}}
faults: [{{entity: turtle, fault: messages_late, parameters: {{topic: pose, delay: 0.5}}}}]
"""

BRAKING = DriveModel().linear_speed / DriveModel().linear_acceleration


def test_requests_made_before_there_is_a_robot_are_served_when_it_comes() -> None:
    with open_probe() as probe, open_navigation(pose_timeout=60.0):
        goals = [probe.plan(OFFICE), probe.follow(line(DOCK, (1.5, 4.45)))]
        assert all(goal.accepted.wait(DEADLINE) for goal in goals)
        with without_faults(names.SIMULATOR, parameters=FAST) as simulator:
            Simulator(simulator)
            assert [goal.wait().status for goal in goals] == [GoalStatus.SUCCEEDED] * 2


def test_without_a_robot_requests_fail_in_time() -> None:
    with open_probe() as probe, open_navigation(pose_timeout=0.2):
        assert names.POSE in aborted(probe.plan(OFFICE), ComputePathToPose.Result.TF_ERROR).error_msg
        assert 'pose' in aborted(probe.send(names.SPIN, target_yaw=1.0), Spin.Result.TF_ERROR).error_msg


def test_requests_that_are_canceled_while_they_wait_for_the_robot_end_canceled() -> None:
    with open_probe() as probe, open_navigation(pose_timeout=60.0):
        goals = [probe.plan(OFFICE), probe.follow(line(DOCK, EAST)), probe.send(names.SPIN, target_yaw=1.0)]
        for goal in goals:
            assert goal.accepted.wait(60.0)
            goal.cancel()
        assert [goal.wait().status for goal in goals] == [GoalStatus.CANCELED] * 3


def test_one_check_of_the_pose_at_a_time_however_motions_take_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each takes over when the check for the motion before it is due, and has not been made."""
    checks: list[float] = []
    look = PoseWatch._look

    def count(*arguments: Any) -> None:
        checks.append(time.monotonic())
        look(*arguments)

    monkeypatch.setattr(PoseWatch, '_look', count)
    with open_simulator(speed_factor=1.0) as probe, open_navigation(pose_timeout=0.2) as navigation:
        for _ in range(6):
            with ThreadPoolExecutor() as pool:
                pool.submit(navigation.call, lambda: time.sleep(0.3))
                goal = probe.send(names.SPIN, target_yaw=1000.0, time_allowance=duration_message(1000.0))
            assert goal.accepted.wait(60.0)
        assert not goal.ended
        checks.clear()
        wait_until(lambda: len(checks) >= 5, 'checks')
        assert checks[4] - checks[0] > 3 * 0.2  # of four periods


def test_a_robot_that_is_lost_fails_what_drives_it_and_is_used_again_when_it_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with open_probe() as probe, open_navigation() as navigation:
        with without_faults(names.SIMULATOR, parameters={'speed_factor': 1.0}) as simulator:
            Simulator(simulator)
            goal = probe.follow(line(DOCK, EAST))
            probe.wait_driving()
        lost = uncontended_time()
        assert 'no pose' in aborted(goal, FollowPath.Result.TF_ERROR).error_msg
        assert uncontended_time() - lost < 3.0
        monkeypatch.setattr(robot_interface, 'RETURN_SECONDS', 60.0)
        early = probe.follow(line(DOCK, (1.5, 4.45)))
        assert early.accepted.wait(60.0)
        navigation.call(lambda: None)  # it has begun to wait
        monkeypatch.setattr(robot_interface, 'RETURN_SECONDS', 0.0)
        assert 'not known' in aborted(probe.plan(OFFICE), ComputePathToPose.Result.TF_ERROR).error_msg
        with without_faults(names.SIMULATOR, parameters=FAST) as simulator:
            Simulator(simulator)  # its time starts again at 0
            assert early.wait().status is GoalStatus.SUCCEEDED
            assert probe.send(names.WAIT, time=duration_message(0.5)).wait().status is GoalStatus.SUCCEEDED


def test_a_robot_drives_on_when_simulated_time_begins_again() -> None:
    with open_sim_world() as probe:
        probe.later(100.0)
        goal = probe.follow(line(DOCK, (4.0, 4.45)))
        probe.wait_driving()
        request = ResetSimulation.Request(scope=ResetSimulation.Request.SCOPE_TIME)
        probe.ask(ResetSimulation, 'simulator/reset_simulation', request)
        assert goal.wait().status is GoalStatus.SUCCEEDED
        assert probe.now.time < 50.0


def test_a_robot_whose_poses_are_older_than_its_scans_sees_what_is_in_its_way(tmp_path: Path) -> None:
    file = tmp_path / 'crate.yaml'
    file.write_text(CRATE)
    with open_sim_world(FAST | {'world': str(file), 'robot_namespaces': False}) as probe:
        path = line((3.0, 3.95), (11.2, 3.95))
        aborted(probe.follow(path), FollowPath.Result.PATIENCE_EXCEEDED)
        assert 7.0 < probe.wait_at_rest().x < 7.8 - 0.22


def test_what_a_lidar_sees_that_hangs_upside_down_is_on_its_other_side() -> None:
    with open_sim_world(navigation={'scan_topic': 'hanging_scan'}) as probe:
        here = probe.place((4.0, 4.45, 0.0))

        def cost(x: float, y: float) -> float:
            service = names.costmap_services(names.COSTMAPS[1])[-1]
            return float(probe.ask(GetCost, service, GetCost.Request(x=x, y=y)).cost)

        wait_until(lambda: cost(here.x, here.y) >= 0.0, 'the map at navigation')
        node = probe.runtime.node
        frames, scans = probe.runtime.call(
            lambda: (
                node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos()),
                node.create_publisher(LaserScan, 'hanging_scan', 1),
            )
        )
        hanging = TransformStamped(child_frame_id='hanging')
        hanging.header.frame_id = 'base_link'
        hanging.transform.rotation.x, hanging.transform.rotation.w = 1.0, 0.0  # half a turn about its axis ahead
        frames.publish(TFMessage(transforms=[hanging]))
        scan = LaserScan(angle_min=math.pi / 2.0, angle_increment=0.1, range_max=3.0, ranges=[0.5])
        scan.header.frame_id = 'hanging'

        def is_seen() -> bool:
            scan.header.stamp = time_message(probe.now.time)
            scans.publish(scan)
            return cost(here.x, here.y - 0.5) == 254.0

        wait_until(is_seen)
        assert cost(here.x, here.y + 0.5) < 254.0


def test_a_thread_that_was_held_up_does_not_take_what_it_has_not_read_for_silence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with open_simulator(speed_factor=1.0) as probe, open_navigation(pose_timeout=2.0) as navigation:
        goal = probe.follow(line(DOCK, (2.5, 4.45)))
        probe.wait_driving()
        run_posted = navigation._run_posted
        held = threading.Event()

        def hold_up() -> None:
            if not held.is_set():
                probe.later(3.0)  # meanwhile the check of the pose is due, and poses come
                held.set()
            run_posted()

        monkeypatch.setattr(navigation, '_run_posted', hold_up)
        assert goal.wait().status is GoalStatus.SUCCEEDED
        assert held.is_set()


def test_a_wait_that_is_asked_of_servers_that_have_just_started_takes_its_time() -> None:
    """The simulation has run for a while, and the servers do not know yet how late it is."""
    with open_simulator(**FAST) as probe:
        probe.later(5.0)
        with open_navigation():
            began = probe.now.time
            assert probe.send(names.WAIT, time=duration_message(2.0)).wait().status is GoalStatus.SUCCEEDED
            assert probe.later(0.1).time - began >= 2.0


def test_navigation_that_ends_tells_its_clients_and_stops_the_robot() -> None:
    with open_simulator(speed_factor=1.0) as probe:
        with open_navigation():
            path = probe.follow(line(DOCK, EAST))
            pause = probe.send(names.WAIT, time=duration_message(100.0))
            assert pause.accepted.wait(60.0)
            ended, contended = probe.wait_driving(), contended_time()
        for goal in (path, pause):
            assert goal.wait().status is GoalStatus.ABORTED
            assert 'shutting down' in goal.result.error_msg
        assert probe.wait_at_rest().time - ended.time < 0.5 + BRAKING + contended_time() - contended
        with without_faults(names.NAVIGATION, parameters={'use_sim_time': True}) as again:
            Navigation(again)
            assert probe.plan(OFFICE).wait().status is GoalStatus.SUCCEEDED


def test_a_goal_that_waits_for_the_pose_ends_with_its_owner() -> None:
    with open_probe() as probe, open_navigation(pose_timeout=60.0):
        goal = probe.follow(line(DOCK, EAST))
        assert goal.accepted.wait(DEADLINE)

        def owner_comes_and_ends() -> bool:
            with NodeRuntime.open(names.BT_SERVER) as owner:
                LivelinessToken(owner)
                watch = LivelinessWatch(probe.runtime, names.BT_SERVER)
                wait_until(lambda: watch.alive, 'the owner')
            return goal.ended

        wait_until(owner_comes_and_ends, 'the end of the goal')
        assert names.BT_SERVER in aborted(goal, FollowPath.Result.UNKNOWN).error_msg


def test_owners_may_be_late_before_all_of_them_are_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    class Watch(LivelinessWatch):
        """A watch whose node is late at once."""

        def __init__(self, runtime: NodeRuntime, *given: Any, **named: Any) -> None:
            super().__init__(runtime, *given, **named)
            if 'on_late' in named:
                runtime.call(lambda: named['on_late'](True))

    monkeypatch.setattr(node, 'LivelinessWatch', Watch)
    with open_navigation(owner_nodes=['one', 'other']) as navigation:
        assert not navigation.health.failure


def test_an_owner_that_hangs_is_gone_after_the_time_that_was_set() -> None:
    go_on, busy = threading.Event(), []
    with (
        open_probe() as probe,
        open_navigation(peer_timeout=1.0) as navigation,
        NodeRuntime.open(names.BT_SERVER) as owner,
    ):
        LivelinessToken(owner)

        def tell(alive: bool) -> None:
            """Return whether it came a bit later than the time that was set, and sooner than by default."""
            if not alive:
                busy.append(goal_servers(navigation)[names.WAIT].busy)

        watch = LivelinessWatch(navigation, names.BT_SERVER, tell, timeout=2.0)
        wait_until(lambda: watch.alive, 'the owner')
        goal = probe.send(names.WAIT, time=duration_message(100.0))
        assert goal.accepted.wait(DEADLINE)
        owner.post(lambda: go_on.wait(DEADLINE))
        assert goal.wait().status is GoalStatus.ABORTED and 'late for too long' in goal.result.error_msg
        wait_until(lambda: busy, 'who waits longer')
        go_on.set()
    assert not any(busy)
