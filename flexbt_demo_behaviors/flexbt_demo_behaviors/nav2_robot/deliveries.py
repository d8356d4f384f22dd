# SPDX-License-Identifier: BSD-3-Clause
"""A program that fetches something from the shelf, brings it to the packing room, and asks a person in between.

It is a typical Nav2 program. If another node stops its robot, it learns so from the results of its tasks, as always
with Nav2.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any, Final

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient

from flexbt_common import names
from flexbt_common.files import resolve_file
from flexbt_core import Place, load_places
from flexbt_msgs.action import ExecuteBehavior
from flexbt_msgs.msg import BehaviorArgument

try:
    from nav2_simple_commander.robot_navigator import BasicNavigator, TaskResult
except ImportError:
    from .navigator import Navigator as BasicNavigator
    from .navigator import TaskResult

HIGH: Final = 2
"""Autonomy level of the question to the operator."""

SERVER_S: Final = 30.0


class Deliveries:
    """The program: it sends tasks to the navigator and questions to the operator."""

    def __init__(self, navigator: Any, places: Mapping[str, Place]) -> None:
        self._navigator = navigator
        self._places = places
        self._operator = ActionClient(navigator, ExecuteBehavior, names.EXECUTE_BEHAVIOR)

    def run(self) -> bool:
        """Fetch, bring and go home. Return whether the robot is home."""
        navigator = self._navigator
        navigator.setInitialPose(self._pose('dock'))
        navigator.waitUntilNav2Active()
        self._drive('to the shelf', navigator.goToPose(self._pose('shelf')))
        if self._ask('Is the robot loaded?'):
            through = navigator.goThroughPoses([self._pose('aisle'), self._pose('packing')])
            self._drive('to the packing room', through)
            if self._ask('Is the robot unloaded?'):
                stops = [self._pose('aisle'), self._pose('shelf')]
                if self._drive('another round', navigator.followWaypoints(stops)) is not TaskResult.SUCCEEDED:
                    self._ask('The round was broken off. What now?')
        return self._drive('home', navigator.goToPose(self._pose('dock'))) is TaskResult.SUCCEEDED

    def _pose(self, name: str) -> PoseStamped:
        place, message = self._places[name], PoseStamped()
        message.header.frame_id = 'map'
        message.pose.position.x, message.pose.position.y = place.x, place.y
        message.pose.orientation.z, message.pose.orientation.w = math.sin(place.yaw / 2.0), math.cos(place.yaw / 2.0)
        return message

    def _drive(self, task: str, is_accepted: bool) -> TaskResult:
        """Wait for the end of a task and print its result."""
        navigator = self._navigator
        while is_accepted and rclpy.ok() and not navigator.isTaskComplete():
            pass  # your own program would read navigator.getFeedback() here
        result: TaskResult = navigator.getResult() if is_accepted else TaskResult.FAILED
        print(f'{task}: {result.name}', flush=True)
        return result

    def _ask(self, question: str) -> bool:
        """Ask the operator. Return whether to continue."""
        if not self._operator.wait_for_server(timeout_sec=SERVER_S):
            raise RuntimeError(f'no executive takes the question {question!r} within {SERVER_S:g} s')
        goal = ExecuteBehavior.Goal(behavior='Ask Operator', autonomy=HIGH)
        goal.arguments = [BehaviorArgument(name='question', value=question)]
        sent = self._operator.send_goal_async(goal)
        rclpy.spin_until_future_complete(self._navigator, sent)
        if not sent.result().accepted:
            raise RuntimeError(f'the executive does not take the question {question!r}')
        answered = sent.result().get_result_async()
        rclpy.spin_until_future_complete(self._navigator, answered)
        result = answered.result().result
        print(f'{question} {result.outcome or result.message}', flush=True)
        return bool(result.outcome == 'go_on')


def main() -> int:
    """Run the program. Return 0 if the robot is home at the end."""
    rclpy.init()
    places = load_places(resolve_file('flexbt_demo_behaviors/nav2_robot/places.yaml'))
    navigator = BasicNavigator()
    try:
        return 0 if Deliveries(navigator, places).run() else 1
    except KeyboardInterrupt:
        return 130
    except Exception:
        if rclpy.ok():
            raise
        return 143  # SIGTERM has shut the context down, and rclpy raised any exception where the program waited
    finally:
        navigator.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
