# SPDX-License-Identifier: BSD-3-Clause
"""The node ``lifecycle_manager``: brings managed nodes up and down in order, as nav2_lifecycle_manager does.

Its services, manage_nodes and is_active in the namespace of its name, are those that BasicNavigator and Nav2's RViz
panel call. It brings nodes up in the order of the parameter ``node_names``, and down in the reverse order.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple, TypeVar

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav2_msgs.srv import ManageLifecycleNodes
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.values.parameter_fields import parameter
from flexbt_sim.errors import SimulationError

T = TypeVar('T')

Command = ManageLifecycleNodes.Request

LOOK_SECONDS: Final = 0.1
"""Time between two checks of a node that is in a transition, s."""

DEFAULT_NODES: Final = (
    'controller_server',
    'smoother_server',
    'planner_server',
    'route_server',
    'behavior_server',
    names.COLLISION_MONITOR,
    names.BT_NAVIGATOR,
    names.WAYPOINT_FOLLOWER,
    'docking_server',
)
"""The nodes of Nav2's lifecycle_manager_navigation that FlexBT provides."""


class _Step(NamedTuple):
    """A transition of all nodes from a state; nodes in certain other states do not need it."""

    transition: int
    start: int
    passed: tuple[int, ...]


class _Command(NamedTuple):
    """A command to all nodes, with its log line, in their order or in reverse."""

    steps: tuple[_Step, ...]
    told: str
    is_upward: bool = False


UNCONFIGURED: Final = State.PRIMARY_STATE_UNCONFIGURED
INACTIVE: Final = State.PRIMARY_STATE_INACTIVE
ACTIVE: Final = State.PRIMARY_STATE_ACTIVE
FINALIZED: Final = State.PRIMARY_STATE_FINALIZED
CONFIGURE: Final = _Step(Transition.TRANSITION_CONFIGURE, UNCONFIGURED, (INACTIVE, ACTIVE))
ACTIVATE: Final = _Step(Transition.TRANSITION_ACTIVATE, INACTIVE, (ACTIVE,))
DEACTIVATE: Final = _Step(Transition.TRANSITION_DEACTIVATE, ACTIVE, (INACTIVE, UNCONFIGURED, FINALIZED))
CLEANUP: Final = _Step(Transition.TRANSITION_CLEANUP, INACTIVE, (UNCONFIGURED, FINALIZED))
SHUTDOWN: Final = _Step(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN, UNCONFIGURED, (FINALIZED,))

COMMANDS: Final[Mapping[int, _Command]] = {
    Command.STARTUP: _Command((CONFIGURE, ACTIVATE), 'active', is_upward=True),
    Command.CONFIGURE: _Command((CONFIGURE,), 'configured', is_upward=True),
    Command.RESUME: _Command((ACTIVATE,), 'active', is_upward=True),
    Command.PAUSE: _Command((DEACTIVATE,), 'inactive'),
    Command.CLEANUP: _Command((CLEANUP,), 'unconfigured'),
    Command.RESET: _Command((DEACTIVATE, CLEANUP), 'unconfigured'),
    Command.SHUTDOWN: _Command((DEACTIVATE, CLEANUP, SHUTDOWN), 'finalized'),
}


@dataclass(frozen=True)
class ManagerParameters:
    """Parameters of the manager."""

    node_names: tuple[str, ...] = parameter(
        'node_names', DEFAULT_NODES, 'the managed nodes, in the order of their start-up'
    )
    autostart: bool = parameter('autostart', False, 'whether they are brought up at the start')
    service_timeout: float = parameter(
        'service_timeout', 5.0, 'wait for a node and its transition, s of wall time', 0.1, 3600.0
    )


def declare_manager_parameters(node: Node) -> ManagerParameters:
    """Declare the parameters on ``node`` and read them. Raises UnfitParameterError."""
    return ParameterDeclarer(node).fields(ManagerParameters())


class LifecycleManager:
    """The manager on a running node. It skips nodes that are already in the target state of a command. FlexBT's nodes
    start active, so a start-up has nothing to do."""

    def __init__(self, runtime: NodeRuntime) -> None:
        """Must be called off the executor thread.

        Raises:
            FlexbtError: a parameter is not usable.
        """
        self._runtime = runtime
        self._links = ServiceLinks(runtime)
        self._commands = threading.Semaphore(1)  # one command at a time, on a separate thread that waits for the nodes
        parameters = runtime.call(lambda: declare_manager_parameters(runtime.node))
        self._names, self._timeout = parameters.node_names, parameters.service_timeout
        runtime.call(self._serve)
        if parameters.autostart:
            threading.Thread(target=self._carry_out, args=(Command.STARTUP,), name='startup', daemon=True).start()

    def _serve(self) -> None:
        node = self._runtime.node
        node.create_service(ManageLifecycleNodes, '~/manage_nodes', self._manage)
        node.create_service(Trigger, '~/is_active', self._tell_active)

    async def _manage(self, request: Any, response: Any) -> Any:
        try:
            response.success = await self._in_thread(lambda: self._carry_out(request.command))
        except RuntimeError as error:
            self._runtime.node.get_logger().error(f'a command was not carried out: {error}')
        return response

    async def _tell_active(self, _request: Any, response: Any) -> Any:
        """Ask the nodes themselves: one that has died since it was brought up is not active."""
        try:
            response.message = await self._in_thread(self._inactive)
        except RuntimeError as error:
            response.message = f'it cannot be found out: {error}'
        response.success = not response.message
        return response

    async def _in_thread(self, work: Callable[[], T]) -> T:
        """Run ``work``, which calls other nodes and waits for them, on a thread, and return its result. Raises
        RuntimeError if no thread can be started."""
        done = Future(executor=self._runtime.node.executor)

        def run() -> None:
            try:
                set_result = partial(done.set_result, work())
            except Exception as error:
                set_result = partial(done.set_exception, error)
            self._runtime.post(set_result)

        threading.Thread(target=run, name='manage_nodes', daemon=True).start()
        result: T = await done
        return result

    # -- on separate threads -----------------------------------------------------------------------------------------

    def _carry_out(self, number: int) -> bool:
        logger = self._runtime.node.get_logger()
        command = COMMANDS.get(number)
        if command is None:
            logger.error(f'there is no command {number}', throttle_duration_sec=COMPLAINT_SECONDS)
            return False
        with self._commands:
            try:
                for step in command.steps:
                    for name in self._names if command.is_upward else reversed(self._names):
                        self._take(name, step)
            except SimulationError as error:
                logger.error(f'not all managed nodes are {command.told}: {error}')
                return False
        logger.info(f'the managed nodes are {command.told}')
        return True

    def _take(self, name: str, step: _Step) -> None:
        """Request a transition of a node, if it is needed. Raises SimulationError."""
        until = time.monotonic() + self._timeout
        state = self._state(name)
        if state.id == step.start:
            request = ChangeState.Request(transition=Transition(id=step.transition))
            if not self._ask(name, ChangeState, 'change_state', request).success:
                raise SimulationError(f'{name} is {state.label}, and has not made transition {step.transition}')
            state = self._state(name)
        while state.id >= State.TRANSITION_STATE_CONFIGURING and time.monotonic() < until:
            time.sleep(LOOK_SECONDS)
            state = self._state(name)
        if state.id not in step.passed:
            raise SimulationError(f'{name} is {state.label}')

    def _inactive(self) -> str:
        """Return why the manager is not active; '' if every node is."""
        try:
            for name in self._names:
                if (state := self._state(name)).id != ACTIVE:
                    return f'{name} is {state.label}'
        except SimulationError as error:
            return str(error)
        return ''

    def _state(self, name: str) -> Any:
        return self._ask(name, GetState, 'get_state', GetState.Request()).current_state

    def _ask(self, name: str, service_type: Any, service: str, request: Any) -> Any:
        outcome = service_outcome(self._links.link(service_type, f'{name}/{service}'), request, self._timeout)
        if outcome.response is None:
            raise SimulationError(outcome.reason)
        return outcome.response


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``lifecycle_manager``."""
    return run_node('lifecycle_manager', LifecycleManager, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
