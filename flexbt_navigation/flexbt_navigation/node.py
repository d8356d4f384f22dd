# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation``: navigation servers with the interfaces of Nav2, for the simulated robot.

Actions compute_path_to_pose, compute_path_through_poses, smooth_path, follow_path, spin, backup, drive_on_heading,
assisted_teleop, wait, compute_route, compute_and_track_route, dock_robot and undock_robot; services of the costmaps, of
the route server and of the docking server, and is_path_valid. The simulator can make each server refuse goals, fail,
hang, or die. While a node of the parameter ``owner_nodes`` is late, the robot is held. When that node is gone, every
goal is ended, since no node is left to stop it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalFault, goal_servers, set_error
from flexbt_common.interfaces import SETTABLE_SERVERS
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.lifecycle.managed_node import SHUTTING_DOWN
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime import node_runtime
from flexbt_common.runtime.health import Hang
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_core.errors import FlexbtError
from flexbt_core.values.yaml_data import YamlError
from flexbt_navigation.behaviors.server import BehaviorServer, TeleopServer, WaitServer
from flexbt_navigation.common.requests import GoalEnd, finish
from flexbt_navigation.controller.server import ControllerParameters, ControllerServer, MotionArbiter
from flexbt_navigation.docking.server import DockingServer
from flexbt_navigation.planner.server import PlannerParameters, PlannerServer, SmootherServer
from flexbt_navigation.routes.server import RouteServer
from flexbt_sim.intra_process import IntraProcessTopics
from flexbt_sim.messages import action_type, faults_of
from flexbt_sim.world.faults import ServerDies, ServerFails, ServerFault, ServerHangs, ServerRefuses

from .collision_monitor import CollisionMonitor
from .parameters import declare_navigation_parameters
from .preparation import prepare_navigation
from .robot_interface import RobotInterface

CONTROLLER: Final = {
    'desired_linear_vel': 'speed',
    'cost_scaling_dist': 'proximity_distance',
    'allow_reversing': 'reverses',
}
GOAL_CHECKER: Final = {'xy_goal_tolerance': 'xy_tolerance', 'yaw_goal_tolerance': 'yaw_tolerance'}
PROGRESS_CHECKER: Final = {'required_movement_radius': 'progress_distance', 'movement_time_allowance': 'progress_time'}
"""Parameters of controller_server's plug-ins, and the corresponding fields of FollowerLimits."""


def manage_servers(runtime: NodeRuntime, controller: ControllerParameters, planner: PlannerParameters) -> None:
    """Let a lifecycle manager activate and deactivate each server, once all actions are served. An inactive server
    rejects new goals and aborts its current ones. Executor thread only.

    Parameters of a controller take effect with the next path, those of a progress checker with the next goal that
    replaces no other, and those of a planner with the next plan. The parameters of ``runtime`` set the initial state of
    all servers.
    """
    parts = {name: _manage(runtime, name, actions) for name, actions in names.ACTIONS_OF_SERVERS.items()}

    def declare(server: str, plugin: str, name: str, on_set: Callable[[Any], object]) -> None:
        descriptor = runtime.node.describe_parameter(name)
        descriptor.read_only = False
        parts[server].declare(f'{plugin}{name}', runtime.node.get_parameter(name).value, descriptor, on_set)

    def set_follower(field: str, value: Any) -> None:
        controller.follower = replace(controller.follower, **{field: value})

    def set_tolerance(value: float) -> None:
        planner.tolerance = value

    of_plugins: tuple[tuple[tuple[str, ...], Mapping[str, str]], ...] = (
        (controller.controller_ids, CONTROLLER),
        (controller.goal_checker_ids, GOAL_CHECKER),
        (controller.progress_checker_ids, PROGRESS_CHECKER),
    )
    for ids, fields in of_plugins:
        for plugin in ids[:1]:
            for name, field in fields.items():
                declare('controller_server', f'{plugin}.', name, partial(set_follower, field))
    declare('controller_server', '', 'failure_tolerance', partial(set_follower, 'patience'))
    for plugin in planner.planner_ids[:1]:
        declare('planner_server', f'{plugin}.', 'tolerance', set_tolerance)


def _manage(runtime: NodeRuntime, name: str, actions: tuple[str, ...]) -> LifecycleSubnode:
    admission = GoalAdmission(name)
    servers = [goal_servers(runtime)[action] for action in actions]
    for server in servers:
        server.admission = admission

    def on_change(is_active: bool) -> None:
        if is_active:
            admission.open()
            return
        admission.close('is inactive')
        for server in servers:
            server.end_all(partial(finish, end=GoalEnd(code='UNKNOWN', message=f'{name} was deactivated')))

    return LifecycleSubnode(runtime, name, on_change, has_parameters=name in SETTABLE_SERVERS)


FAULTS_DEPTH: Final = 10
"""Depth of the message queue: at many times real time, a short fault is soon over."""


class ServerFaults:
    """An agent that carries out the faults of a node's servers. Executor thread only."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        runtime.node.create_subscription(
            String, names.SERVER_FAULTS, self._receive, names.transient_local_qos(FAULTS_DEPTH)
        )

    def _receive(self, message: String) -> None:
        try:
            faults = faults_of(message)
        except (FlexbtError, YamlError) as error:
            self._runtime.node.get_logger().error(
                f'{names.SERVER_FAULTS}: ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS
            )
            return
        for dying in faults:
            if isinstance(dying, ServerDies):
                self._runtime.node.get_logger().fatal(
                    f'{dying.server} dies, by a fault on command (simulator/set_fault ends it)'
                )
                node_runtime.HOST.die()
        for name, server in goal_servers(self._runtime).items():
            fault = _merged([one for one in faults if one.server == name])
            if fault != server.fault:
                self._runtime.node.get_logger().warning(f'{name}: {_told(fault)}')
                server.fault = fault


def _merged(faults: Iterable[ServerFault]) -> GoalFault:
    """Return the combined effect of several faults of one server."""
    refusal, failure, hangs = '', None, False
    for one in faults:
        match one:
            case ServerRefuses():
                refusal = 'a fault on command'
            case ServerFails():
                failure = action_type(one.server).Result()
                set_error(failure, one.error_code, one.error_msg)
            case ServerHangs():
                hangs = True
    return GoalFault(refusal, failure, hangs)


def _told(fault: GoalFault) -> str:
    said = [
        *(['refuses goals'] if fault.refusal else []),
        *(['hangs'] if fault.hangs else []),
        *([f'fails with error code {fault.failure.error_code}'] if fault.failure is not None else []),
    ]
    return f'{" and ".join(said)}, by a fault on command' if said else 'works again: its fault has ended'


class Navigation:
    """The servers on a running node."""

    def __init__(self, runtime: NodeRuntime, in_process: IntraProcessTopics | None = None) -> None:
        """Must be called off the executor thread. ``in_process`` are the topics of a robot that is simulated in this
        process.

        Raises:
            FlexbtError: a parameter is not usable.
        """
        self._runtime = runtime
        self._parameters = runtime.call(lambda: declare_navigation_parameters(runtime.node))
        prepare_navigation(self._parameters.controller.follower.steering, self._parameters.costmaps.inflation)
        runtime.call(lambda: self._serve(in_process))
        timeout = self._parameters.peer_timeout
        self._owners: list[LivelinessWatch] = []
        for owner in self._parameters.owner_nodes:
            self._owners.append(
                LivelinessWatch(runtime, owner, partial(self._on_owner, owner), on_late=self._on_late, timeout=timeout)
            )
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

    # -- shutdown ----------------------------------------------------------------------------------------------------

    def _on_owner(self, owner: str, alive: bool) -> None:
        if not alive:
            self._end_all(f'{owner}, which gives the goals, is gone: it has ended or died, or was late for too long')

    def _on_late(self, _is_late: bool) -> None:
        late = [owner for owner in self._owners if owner.late]
        self._arbiter.hold(bool(late))
        if self._arbiter.running is not None:
            told = '; '.join(f'{owner.node_name} is late: {owner.problem}' for owner in late)
            self._runtime.node.get_logger().warning(f'the robot is held: {told}' if told else 'the robot continues')

    def _on_robot(self, robot: str, alive: bool) -> None:
        if not alive:
            self._robot.forget_pose()
            self._end_all(f'no pose of the robot: {robot} is gone', code='TF_ERROR')

    def _after_hang(self, hang: Hang) -> None:
        """Cancel all goals after the process was suspended: requests sent meanwhile may be lost. From any thread."""
        if hang.was_out_of_reach:
            self._runtime.post(lambda: self._end_all(str(hang)))

    def _close(self) -> None:
        self._runtime.call(self._end)
        for _ in range(2):  # the goals end on one turn of the executor, their results are sent on the next
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
        for server in servers:  # remaining work: a search, or a goal that waits for the pose or a transform
            server.end_all(partial(finish, end=end))


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``navigation``."""
    return run_node(names.NAVIGATION, Navigation, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
