# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's navigation servers as others see them: as managed nodes, for programs that look for them, and with faults on
command, which the simulator announces.

Each managed node has some of the actions of one node, and those of its parameters that can be set while it works.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalFault, goal_servers, set_error
from flexbt_common.interfaces import SETTABLE_SERVERS
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.errors import FlexbtError
from flexbt_core.values.yaml_data import YamlError
from flexbt_navigation.common.goals import GoalEnd, finish
from flexbt_navigation.controller.server import ControllerParameters
from flexbt_navigation.planner.server import PlannerParameters
from flexbt_sim.messages import action_type, faults_of
from flexbt_sim.world.descriptions.faults import ServerDies, ServerFails, ServerFault, ServerHangs, ServerRefuses

CONTROLLER: Final = {
    'desired_linear_vel': 'speed',
    'cost_scaling_dist': 'proximity_distance',
    'allow_reversing': 'reverses',
}
GOAL_CHECKER: Final = {'xy_goal_tolerance': 'xy_tolerance', 'yaw_goal_tolerance': 'yaw_tolerance'}
PROGRESS_CHECKER: Final = {'required_movement_radius': 'progress_distance', 'movement_time_allowance': 'progress_time'}
"""Parameters of plug-ins of controller_server, and what they are of FollowerLimits."""


def manage_servers(runtime: NodeRuntime, controller: ControllerParameters, planner: PlannerParameters) -> None:
    """Have a lifecycle manager decide for each of them whether it works, when all actions are served. One that is not
    active rejects goals; those that it works on are aborted. On the executor thread.

    Parameters of a controller take effect with the next path, of a progress checker with a goal that replaces none, and
    of a planner with the next plan. The parameters of ``runtime`` set the state of all of them at the start.
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
"""Messages that wait to be taken: at many times real time a short fault is over soon."""


class ServerFaults:
    """An agent that carries out the faults of a node's servers. On the executor thread."""

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
                os.kill(os.getpid(), signal.SIGKILL)
        for name, server in goal_servers(self._runtime).items():
            fault = _merged([one for one in faults if one.server == name])
            if fault != server.fault:
                self._runtime.node.get_logger().warning(f'{name}: {_told(fault)}')
                server.fault = fault


def _merged(faults: Iterable[ServerFault]) -> GoalFault:
    """Return what several faults of one server come to."""
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
