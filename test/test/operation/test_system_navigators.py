# SPDX-License-Identifier: BSD-3-Clause
"""A robot before a client of Nav2: the calls of nav2_simple_commander, made with plain rclpy.

One test has real processes; the others run in one process. The real nav2_simple_commander drives it as well, by its own
example scripts, where it is installed or where FLEXBT_NAV2_SIMPLE_COMMANDER names the directory of its sources (with
`nav2_simple_commander/` and `robot_navigator.py` below it).
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from domain_coordinator import domain_id
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import FollowPath, FollowWaypoints, NavigateThroughPoses, NavigateToPose
from nav2_msgs.srv import ClearEntireCostmap
from PIL import Image
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, TreeStatus
from flexbt_msgs.srv import SetFault
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import DEADLINE, wait_until

NAVIGATORS = {'navigators': '[navigate_to_pose, navigate_through_poses, follow_waypoints]'}
SPEED = {'speed_factor': '5.0'}
DOCK = (0.8, 4.45)
ANSWER_SECONDS = 5.0
CORRIDOR = 4.45
"""The y of the corridor, in which the robot drives from x = 0.8 to 11.2."""


def pose(x: float, y: float = CORRIDOR) -> PoseStamped:
    stamped = PoseStamped()
    stamped.header.frame_id = 'map'
    stamped.pose.position.x, stamped.pose.position.y, stamped.pose.orientation.w = float(x), float(y), 1.0
    return stamped


def distance(here: Any, x: float, y: float) -> float:
    """From a pose to a place, m."""
    return math.hypot(here.position.x - x, here.position.y - y)


class Commander:
    """A program with one thread, which spins its node while it waits, as BasicNavigator does."""

    def __init__(self) -> None:
        self._context = rclpy.Context()
        self._context.init()
        self.node = node = rclpy.create_node('commander', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._clients = {
            action: ActionClient(node, action, name)
            for action, name in {
                NavigateToPose: 'navigate_to_pose',
                NavigateThroughPoses: 'navigate_through_poses',
                FollowWaypoints: 'follow_waypoints',
            }.items()
        }
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.amcl_poses: list[PoseWithCovarianceStamped] = []
        node.create_subscription(PoseWithCovarianceStamped, 'amcl_pose', self.amcl_poses.append, latched)
        self._initial_pose = node.create_publisher(PoseWithCovarianceStamped, 'initialpose', 10)
        self.goal_pose = node.create_publisher(PoseStamped, 'goal_pose', 10)
        self._services: dict[str, Any] = {}
        self.handle: Any = None
        self.result: Any = None
        self.feedback: Any = None

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()

    def spin(self, future: Any) -> Any:
        self._executor.spin_until_future_complete(future, DEADLINE)
        assert future.done(), 'no answer'
        return future.result()

    def ask(self, service_type: Any, name: str, **fields: Any) -> Any:
        client = self._services.get(name) or self.node.create_client(service_type, name)
        self._services[name] = client
        assert client.wait_for_service(DEADLINE), name
        answers: list[Any] = []

        def is_answered() -> bool:
            """Return the answer is lost where the service does not know this client yet: it is asked again."""
            answers.append(client.call_async(service_type.Request(**fields)))
            self._executor.spin_until_future_complete(answers[-1], ANSWER_SECONDS)
            return any(answer.done() for answer in answers)

        wait_until(is_answered, f'an answer of {name}')
        return next(answer for answer in answers if answer.done()).result()

    def until(self, condition: Any, what: str = 'the condition') -> None:
        wait_until(lambda: (self._executor.spin_once(0.05), condition())[1], what)

    def wait_until_active(self, node: str) -> None:
        self.until(lambda: self.ask(GetState, f'{node}/get_state').current_state.label == 'active', node)

    def set_initial_pose(self, x: float, y: float) -> None:
        message = PoseWithCovarianceStamped()
        message.header.frame_id = 'map'
        message.pose.pose = pose(x, y).pose

        def is_there() -> bool:
            self._initial_pose.publish(message)
            return any(distance(seen.pose.pose, x, y) < 0.01 for seen in self.amcl_poses)

        self.until(is_there, 'amcl_pose')

    def go(self, goal: Any) -> None:
        self.feedback = None
        action = next(action for action in self._clients if isinstance(goal, action.Goal))
        client = self._clients[action]
        assert client.wait_for_server(DEADLINE)

        def on_feedback(message: Any) -> None:
            self.feedback = message.feedback

        self.handle = self.spin(client.send_goal_async(goal, on_feedback))
        assert self.handle.accepted
        self.result = self.handle.get_result_async()

    def to(self, *place: float) -> None:
        self.go(NavigateToPose.Goal(pose=pose(*place)))

    def cancel(self) -> None:
        self.spin(self.handle.cancel_goal_async())

    def ended(self, status: int = GoalStatus.STATUS_SUCCEEDED) -> Any:
        response = self.spin(self.result)
        assert response.status == status, response
        return response.result


def away(probe: Probe, x: float, y: float = CORRIDOR) -> float:
    """Return how far the robot is from a place, m."""
    assert probe.pose is not None
    return distance(probe.pose.pose, x, y)


def wait_near(probe: Probe, x: float) -> None:
    """Wait until the robot is seen at a place: the end of its goal may be heard sooner."""
    probe.wait(lambda: away(probe, x) < 0.3, f'the robot at {x}')


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Probe]]:
    with Stack(tmp_path_factory.mktemp('system')) as stack, NodeRuntime.open('probe') as runtime:
        stack.start_all(SPEED, NAVIGATORS, in_one=True)
        probe = Probe(runtime)
        probe.wait_ready()
        yield stack, probe


@pytest.fixture
def probe(system: tuple[Stack, Probe]) -> Probe:
    return system[1]


@pytest.fixture
def commander(probe: Probe) -> Iterator[Commander]:
    commander = Commander()
    try:
        commander.wait_until_active('amcl')
        commander.wait_until_active('bt_navigator')
        commander.set_initial_pose(*DOCK)
        yield commander
    finally:
        commander.close()


def test_to_a_pose_and_on_to_another_without_a_stop(commander: Commander, probe: Probe) -> None:
    commander.ask(ClearEntireCostmap, 'global_costmap/clear_entirely_global_costmap')
    commander.to(11.0)  # far enough for a client that is held up meanwhile
    commander.until(lambda: commander.feedback and 0.0 < commander.feedback.distance_remaining < 9.6, 'part of the way')
    assert commander.feedback.estimated_time_remaining.sec > 0
    assert commander.feedback.navigation_time.sec >= 1
    assert commander.feedback.number_of_recoveries == 0
    first = commander.result
    commander.to(4.0)
    assert commander.spin(first).status == GoalStatus.STATUS_ABORTED
    commander.ended()
    wait_near(probe, 4.0)


@pytest.mark.one_process
def test_through_poses_and_to_a_pose_meanwhile(commander: Commander, probe: Probe) -> None:
    commander.go(NavigateThroughPoses.Goal(poses=[pose(2.0), pose(4.0), pose(7.0)]))
    commander.until(lambda: commander.feedback and commander.feedback.number_of_poses_remaining < 3, 'the first pose')
    through = commander.result
    commander.to(1.0)
    assert 'navigate_through_poses drives' in commander.ended(GoalStatus.STATUS_ABORTED).error_msg
    assert commander.spin(through).status == GoalStatus.STATUS_SUCCEEDED
    wait_near(probe, 7.0)


@pytest.mark.one_process
def test_waypoints_a_cancel_and_the_next_goal_at_once(commander: Commander, probe: Probe) -> None:
    commander.go(FollowWaypoints.Goal(poses=[pose(1.6), pose(2.4), pose(8.0)]))
    commander.until(lambda: commander.feedback and commander.feedback.current_waypoint == 2, 'the last waypoint')
    followed = commander.result
    commander.cancel()
    commander.to(3.0)
    assert commander.spin(followed).status == GoalStatus.STATUS_CANCELED
    commander.ended()
    wait_near(probe, 3.0)


@pytest.mark.one_process
def test_a_pose_outside_of_the_map_is_missed(commander: Commander) -> None:
    commander.go(FollowWaypoints.Goal(poses=[pose(1.4), pose(100.0), pose(2.0)]))
    result = commander.ended(GoalStatus.STATUS_ABORTED)
    assert [(missed.index, missed.error_code) for missed in result.missed_waypoints] == [(1, 204)]


@pytest.mark.one_process
def test_recoveries_that_are_needed_because_the_controller_fails(commander: Commander, probe: Probe) -> None:
    def fault(**fields: Any) -> None:
        response = commander.ask(SetFault, 'simulator/set_fault', fault='server_fails', **fields)
        assert response.success, response.message

    fault(parameters=f'{{server: follow_path, error_code: {FollowPath.Result.FAILED_TO_MAKE_PROGRESS}}}')
    commander.to(3.0)
    commander.until(lambda: commander.feedback and commander.feedback.number_of_recoveries > 0, 'a recovery')
    assert not commander.result.done()
    fault(clear=True)
    commander.ended()
    wait_near(probe, 3.0)


@pytest.mark.one_process
def test_the_goal_tool_and_the_stop_of_an_operator(commander: Commander, probe: Probe) -> None:
    runs: list[TreeStatus] = []
    subscription = probe.console.call(
        lambda: probe.console.node.create_subscription(TreeStatus, 'tree_status', runs.append, 10)
    )
    commander.until(commander.goal_pose.get_subscription_count, 'goal_pose')
    commander.goal_pose.publish(pose(9.0))
    probe.wait(lambda: away(probe, *DOCK) > 0.5, 'the robot on its way')
    assert probe.status.state == ExecutiveStatus.IDLE
    stopped = probe.send(ExecutiveCommand.STOP)
    probe.wait(lambda: any(result.command_id == stopped for result in probe.status.results), 'the answer')
    probe.wait(lambda: runs and runs[-1].finished, 'the end of the tree')
    probe.wait_at_rest()
    assert away(probe, 9.0) > 1.0
    probe.console.call(lambda: probe.console.node.destroy_subscription(subscription))


SOURCES = os.environ.get('FLEXBT_NAV2_SIMPLE_COMMANDER', '')


@pytest.mark.skipif(
    not SOURCES and importlib.util.find_spec('nav2_simple_commander') is None,
    reason='nav2_simple_commander is not installed, and FLEXBT_NAV2_SIMPLE_COMMANDER does not say where it is',
)
def test_the_examples_of_nav2_simple_commander(tmp_path: Path) -> None:
    # An empty hall around the places of the examples.
    Image.new('L', (700, 400), 254).save(tmp_path / 'hall.png')
    (tmp_path / 'hall.yaml').write_text(
        'image: hall.png\nresolution: 0.05\norigin: [-10.0, -10.0, 0.0]\n'
        'negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n'
    )
    path = os.pathsep.join(filter(None, [SOURCES, os.environ.get('PYTHONPATH')]))
    with domain_id() as domain, Stack(tmp_path) as stack:  # the other robot must not hear it
        environment = os.environ | {'PYTHONPATH': path, 'ROS_DOMAIN_ID': str(domain)}
        hall = {'map': str(tmp_path / 'hall.yaml'), 'initial_pose': '[1.0, 1.0, 0.0]', 'speed_factor': '10.0'}
        for name, parameters in (('simulation', hall), ('bt_server', NAVIGATORS)):
            stack.start(name, parameters, environment)
        for script, told in {
            'example_nav_to_pose': 'Goal succeeded!',
            'example_nav_through_poses': 'Goal succeeded!',
            'example_waypoint_follower': 'Goal succeeded!',
            'demo_recoveries': 'Dead end confirmed! Returning to start...',
            'demo_picking': 'Bringing product to shipping destination',
            'demo_inspection': 'Inspection of shelves complete!',
        }.items():
            done = subprocess.run(
                [sys.executable, '-m', f'nav2_simple_commander.{script}'],
                env=environment, capture_output=True, text=True, timeout=3 * DEADLINE, check=False,
            )  # fmt: skip
            assert done.returncode == 0 and told in done.stdout, (script, done.stdout[-2000:], done.stderr[-2000:])
