# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation``: navigation servers with the interfaces of Nav2, for the simulated robot.

Actions compute_path_to_pose, compute_path_through_poses, smooth_path, follow_path, spin, backup, drive_on_heading,
assisted_teleop, wait, compute_route, compute_and_track_route, dock_robot and undock_robot; services of the costmaps, of
the route server and of the docking server, and is_path_valid. The simulator can have each server refuse goals, fail,
hang, or die. While a node of the parameter ``owner_nodes`` is late the robot is held; when it is gone every goal is
ended: nobody is left to stop it.
"""

from __future__ import annotations

import sys
from functools import partial

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, goal_servers
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.lifecycle.managed_node import SHUTTING_DOWN
from flexbt_common.runtime.health import Hang
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_navigation.behaviors.server import BehaviorServer, TeleopServer, WaitServer
from flexbt_navigation.common.goals import GoalEnd, finish
from flexbt_navigation.controller.server import ControllerServer, MotionArbiter
from flexbt_navigation.docking.server import DockingServer
from flexbt_navigation.planner.server import PlannerServer, SmootherServer
from flexbt_navigation.routes.server import RouteServer
from flexbt_sim.intra_process import IntraProcessTopics

from .collision_monitor import CollisionMonitor
from .managed_servers import ServerFaults, manage_servers
from .parameters import declare_navigation_parameters
from .preparation import prepare_navigation
from .robot_interface import RobotInterface


class Navigation:
    """The servers on a running node."""

    def __init__(self, runtime: NodeRuntime, in_process: IntraProcessTopics | None = None) -> None:
        """Must be called off the executor thread. ``in_process``: the topics of a robot that is simulated in this
        process.

        Raises:
            FlexbtError: a parameter cannot work.
        """
        self._runtime = runtime
        self._parameters = runtime.call(lambda: declare_navigation_parameters(runtime.node))
        prepare_navigation(self._parameters.controller.follower.steering, self._parameters.costmaps.inflation)
        runtime.call(lambda: self._serve(in_process))
        timeout = self._parameters.peer_timeout
        self._owners = [
            LivelinessWatch(runtime, owner, partial(self._on_owner, owner), on_late=self._on_late, timeout=timeout)
            for owner in self._parameters.owner_nodes
        ]
        for robot in self._parameters.robot_nodes:
            LivelinessWatch(runtime, robot, partial(self._on_robot, robot), timeout=timeout)
        runtime.on_close(self._close)
        runtime.health.on_hang(self._after_hang)
        LivelinessToken(runtime).set_ready(True)
        runtime.node.get_logger().info('ready')

    def _serve(self, in_process: IntraProcessTopics | None) -> None:
        runtime = self._runtime
        parameters = self._parameters
        self._robot = robot = RobotInterface(runtime, parameters.robot, parameters.costmaps, in_process)
        self._arbiter = arbiter = MotionArbiter(runtime, robot)
        PlannerServer(runtime, parameters.planner, parameters.controller, robot)
        ControllerServer(runtime, parameters.controller, arbiter)
        BehaviorServer(runtime, parameters.controller, arbiter)
        SmootherServer(runtime, robot)
        TeleopServer(runtime, arbiter)
        self._routes = RouteServer(runtime, parameters.routes, robot)
        CollisionMonitor(runtime, parameters.collision_monitor, arbiter)
        DockingServer(runtime, parameters.docking, parameters.controller, arbiter)
        self._waits = WaitServer(runtime)
        ServerFaults(runtime)
        manage_servers(runtime, parameters.controller, parameters.planner)

    # -- the end of everything ---------------------------------------------------------------------------------------

    def _on_owner(self, owner: str, alive: bool) -> None:
        if not alive:
            self._end_all(f'{owner}, which gives the goals, is gone: it has ended or died, or was late for too long')

    def _on_late(self, _is_late: bool) -> None:
        late = [owner for owner in self._owners if owner.late]
        self._arbiter.hold(bool(late))
        if self._arbiter.running is not None:
            told = '; '.join(f'{owner.node_name} is late: {owner.problem}' for owner in late)
            self._runtime.node.get_logger().warning(f'the robot is held: {told}' if told else 'the robot goes on')

    def _on_robot(self, robot: str, alive: bool) -> None:
        if not alive:
            self._robot.forget_pose()
            self._end_all(f'no pose of the robot: {robot} is gone', code='TF_ERROR')

    def _after_hang(self, hang: Hang) -> None:
        """Cancel all after the process was stopped: what was asked meanwhile may be lost. From any thread."""
        if hang.was_out_of_reach:
            self._runtime.post(lambda: self._end_all(str(hang)))

    def _close(self) -> None:
        self._runtime.call(self._end)
        for _ in range(2):  # on one turn of the executor the goals end, on the next their results leave
            self._runtime.call(lambda: None)

    def _end(self) -> None:
        admission = GoalAdmission(names.NAVIGATION, SHUTTING_DOWN)
        for server in goal_servers(self._runtime).values():
            server.admission = admission
        self._end_all(admission.refusal)

    def _end_all(self, reason: str, code: str = 'UNKNOWN') -> None:
        servers = list(goal_servers(self._runtime).values())
        if any(server.busy for server in servers):
            self._runtime.node.get_logger().error(f'every goal is ended: {reason}')
        end = GoalEnd(code=code, message=reason)
        self._arbiter.end(end)
        self._waits.end_all(end)
        self._routes.end_all(end)
        for server in servers:  # what else goes on: a search, or a goal that waits for the pose or a transform
            server.end_all(partial(finish, end=end))


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``navigation``."""
    return run_node(names.NAVIGATION, Navigation, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
