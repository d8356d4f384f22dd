# SPDX-License-Identifier: BSD-3-Clause
"""The services of doors, faults and time, and the no-go zones for navigation.

The time services are the standard ones of simulators: play, pause, step, restart, and the list of supported features.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from nav2_msgs.msg import CostmapFilterInfo
from nav_msgs.msg import OccupancyGrid
from rclpy.task import Future
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import time_message
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml
from flexbt_msgs.srv import SetFault
from flexbt_sim.errors import SimulationError
from flexbt_sim.messages import check_fault, grid_message
from flexbt_sim.world.faults import ServerFault, fault_parameters
from flexbt_sim.world.plane.geometry import Pose, Shape
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .core import SimulatorCore
from .entity_services import ServiceRefusedError, answered

# Door commands: ``simulator/doors/NAME`` (std_srvs/SetBool) for each door of the world; true opens it.


class DoorServices:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        self._services: dict[str, Any] = {}

    def update(self) -> None:
        """Add services for new doors and remove those of removed doors."""
        node, doors = self._simulator.runtime.node, self._simulator.world.doors
        for name in self._services.keys() - doors.keys():
            node.destroy_service(self._services.pop(name))
        for name in doors.keys() - self._services.keys():
            self._services[name] = node.create_service(SetBool, f'~/doors/{name}', partial(self._command, name))

    def _command(self, name: str, request: Any, response: Any) -> Any:
        with self._simulator.lock:
            door = self._simulator.world.doors[name]
            door.command(bool(request.data))
            response.success = door.jammed is None
        response.message = f'{name} is jammed' if not response.success else ''
        return response


# Faults on command: the service ``set_fault`` for all faults of the table in docs/reference/world_files.md.


class FaultService:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        simulator.runtime.node.create_service(SetFault, '~/set_fault', self._set)

    def _set(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            entity = request.entity or self._only_robot()
            if not request.clear:
                self._check(entity, request)
            with self._simulator.lock:
                if request.clear:
                    response.message = f'{self._simulator.world.clear_fault(entity, request.fault)} faults ended'
                else:
                    self._simulator.world.set_fault(
                        entity, request.fault, _mapping(request.parameters), request.after, request.duration
                    )
            response.success = True
            self._simulator.runtime.post(
                self._simulator.publish_faults
            )  # after the response is sent, since the fault may kill a process
        except (FlexbtError, YamlError) as error:
            response.message = str(error)
        return response

    def _check(self, entity: str, request: Any) -> None:
        """Check that a server fault is possible and that a node carries it out. The world checks the other faults."""
        parameters = fault_parameters(request.fault, _mapping(request.parameters))
        if isinstance(parameters, ServerFault) and entity in self._simulator.world.robots:
            check_fault(parameters)
            if not self._simulator.has_navigation(entity):
                raise SimulationError(
                    f"{request.fault}: nobody carries it out: '{entity}' has no node {names.NAVIGATION} of flexbt_sim "
                    '(other navigation servers know no faults on command)'
                )

    def _only_robot(self) -> str:
        robots = list(self._simulator.world.robots)
        if len(robots) != 1:
            raise SimulationError(f'no entity is named, and there are {len(robots)} robots; name one of the world')
        return robots[0]


def _mapping(text: str) -> Mapping[str, Any]:
    value = load_yaml(text) if text.strip() else {}
    if not isinstance(value, Mapping):
        raise SimulationError(f'parameters are a mapping, such as {{side: left}}, not {short_repr(text)}')
    if any(isinstance(one, float) and not math.isfinite(one) for one in value.values()):
        raise SimulationError('parameters have numbers that are none')
    return value


# The no-go zones, published like the mask of a KeepoutFilter by Nav2's map_server and costmap_filter_info_server.


class KeepoutServer:
    """A publisher of the no-go zones as a mask, in the namespace of each robot, once zones exist. Executor thread
    only."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        self._publishers: dict[str, tuple[Any, Any]] = {}
        self._told: tuple[OccupancyMap | None, tuple[tuple[Shape, Pose], ...]] = None, ()

    def update(self) -> None:
        """Publish the current zones, also for new robots."""
        world, no_go = self._simulator.world.map, self._simulator.world.no_go
        node, there = self._simulator.runtime.node, set(self._simulator.namespaces)
        for namespace in self._publishers.keys() - there:
            for publisher in self._publishers.pop(namespace):
                node.destroy_publisher(publisher)
        is_news = self._told[0] is not world or self._told[1] != no_go
        to_tell = there if is_news else there - self._publishers.keys()
        self._told = world, no_go
        if world is None or not to_tell or not (no_go or self._publishers):
            return
        mask = grid_message(world.mask(no_go), self._simulator.parameters.map_frame, time_message(0.0))
        for namespace in to_tell:
            if namespace not in self._publishers:
                self._publishers[namespace] = (
                    node.create_publisher(
                        OccupancyGrid, f'{namespace}{names.KEEPOUT_FILTER_MASK}', names.transient_local_qos()
                    ),
                    node.create_publisher(
                        CostmapFilterInfo, f'{namespace}{names.KEEPOUT_FILTER_INFO}', names.transient_local_qos()
                    ),
                )
            masks, infos = self._publishers[namespace]
            masks.publish(mask)
            infos.publish(CostmapFilterInfo(header=mask.header, filter_mask_topic=masks.topic_name, multiplier=1.0))


MOST_STEPS: Final = 1_000_000
"""Maximum number of steps per request: hours of simulated time."""

FEATURES: Final = (
    SimulatorFeatures.SPAWNING,
    SimulatorFeatures.DELETING,
    SimulatorFeatures.NAMED_POSES,
    SimulatorFeatures.ENTITY_TAGS,
    SimulatorFeatures.ENTITY_BOUNDS,
    SimulatorFeatures.ENTITY_BOUNDS_BOX,
    SimulatorFeatures.ENTITY_CATEGORIES,
    SimulatorFeatures.SPAWNING_RESOURCE_STRING,
    SimulatorFeatures.ENTITY_STATE_GETTING,
    SimulatorFeatures.ENTITY_STATE_SETTING,
    SimulatorFeatures.ENTITY_INFO_GETTING,
    SimulatorFeatures.SIMULATION_RESET,
    SimulatorFeatures.SIMULATION_RESET_TIME,
    SimulatorFeatures.SIMULATION_RESET_STATE,
    SimulatorFeatures.SIMULATION_RESET_SPAWNED,
    SimulatorFeatures.SIMULATION_STATE_GETTING,
    SimulatorFeatures.SIMULATION_STATE_SETTING,
    SimulatorFeatures.SIMULATION_STATE_PAUSE,
    SimulatorFeatures.STEP_SIMULATION_SINGLE,
    SimulatorFeatures.STEP_SIMULATION_MULTIPLE,
    SimulatorFeatures.STEP_SIMULATION_ACTION,
)

STOPPED, PLAYING, PAUSED = (
    SimulationState.STATE_STOPPED,
    SimulationState.STATE_PLAYING,
    SimulationState.STATE_PAUSED,
)
_NOT_PAUSED: Final = (
    'time does not stand still, or steps are being made; pause the simulation first (set_simulation_state)'
)


class TimeServices:
    """On the executor thread."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        self._pacer = simulator.pacer
        self._is_stopped = False
        runtime = simulator.runtime
        node = runtime.node
        node.create_service(GetSimulatorFeatures, '~/get_simulator_features', self._tell_features)
        node.create_service(GetSimulationState, '~/get_simulation_state', answered(self._tell_state))
        node.create_service(SetSimulationState, '~/set_simulation_state', answered(self._set_state))
        node.create_service(ResetSimulation, '~/reset_simulation', answered(self._reset))
        node.create_service(StepSimulation, '~/step_simulation', self._step)
        self._goal: ServedGoal | None = None
        GoalServer(runtime, SimulateSteps, f'{node.get_name()}/simulate_steps', self._simulate, self._cancel, _refused)

    @property
    def _state(self) -> int:
        if not self._pacer.is_paused:
            return int(PLAYING)
        return int(STOPPED if self._is_stopped else PAUSED)

    def _tell_features(self, request: Any, response: Any) -> Any:
        response.features = SimulatorFeatures(
            features=[int(feature) for feature in FEATURES],
            spawn_formats=['yaml'],
            custom_info='entities are described as in a world file: docs/reference/world_files.md',
        )
        return response

    def _tell_state(self, request: Any, response: Any) -> None:
        response.state = SimulationState(state=self._state)

    def _set_state(self, request: Any, response: Any) -> None:
        codes = SetSimulationState.Response
        wanted = request.state.state
        if wanted == SimulationState.STATE_QUITTING:
            raise ServiceRefusedError(
                Result.RESULT_FEATURE_UNSUPPORTED, 'the simulator does not end by a service; end its process'
            )
        if wanted not in (STOPPED, PLAYING, PAUSED):
            raise ServiceRefusedError(codes.INCORRECT_TRANSITION, f'state {wanted} cannot be set')
        if wanted == self._state:
            raise ServiceRefusedError(codes.ALREADY_IN_TARGET_STATE, 'it is in this state already')
        if wanted == PLAYING:
            self._pacer.play()
        else:
            with self._simulator.lock:  # not in the middle of a step; no step is made afterwards
                self._pacer.pause()
            if wanted == STOPPED:
                self._pacer.cancel_steps()
                self._simulator.restart()
        self._is_stopped = wanted == STOPPED

    def _reset(self, request: Any, response: Any) -> None:
        scope = request.scope or ResetSimulation.Request.SCOPE_ALL
        simulator = self._simulator
        if scope == ResetSimulation.Request.SCOPE_ALL:
            simulator.restart()
            return
        known = (
            ResetSimulation.Request.SCOPE_TIME
            | ResetSimulation.Request.SCOPE_STATE
            | ResetSimulation.Request.SCOPE_SPAWNED
        )
        if scope & ~known:
            raise ServiceRefusedError(Result.RESULT_FEATURE_UNSUPPORTED, f'there is no scope {scope}')
        if scope & ResetSimulation.Request.SCOPE_SPAWNED:
            simulator.remove_spawned()
        if scope & ResetSimulation.Request.SCOPE_STATE:
            simulator.reset_state()
        if scope & ResetSimulation.Request.SCOPE_TIME:
            simulator.reset_time()

    # -- steps -------------------------------------------------------------------------------------------------------

    async def _step(self, request: Any, response: Any) -> Any:
        runtime = self._simulator.runtime
        done = Future(executor=runtime.node.executor)

        def stepped(left: int, is_over: bool) -> None:
            if is_over:
                runtime.post(lambda: done.set_result(left))

        try:
            self._begin(int(request.steps), stepped)
            left = await done
            if left:
                raise SimulationError(f'{left} of {request.steps} steps were not made: the simulation continues')
            response.result.result = Result.RESULT_OK
        except SimulationError as error:
            response.result = Result(result=Result.RESULT_OPERATION_FAILED, error_message=str(error))
        return response

    def _begin(self, steps: int, stepped: Any, piece: int = MOST_STEPS) -> None:
        if not 1 <= steps <= MOST_STEPS:
            raise SimulationError(f'{steps} steps; give 1 to {MOST_STEPS}')
        if not self._pacer.step(steps, stepped, piece):
            raise SimulationError(_NOT_PAUSED)
        self._is_stopped = False

    def _simulate(self, goal: ServedGoal) -> None:
        runtime, steps = self._simulator.runtime, int(goal.request.steps)

        def stepped(left: int, is_over: bool) -> None:
            runtime.post(lambda: self._tell_steps(goal, steps - left, left, is_over))

        try:
            self._begin(steps, stepped, 1)
            self._goal = goal
        except SimulationError as error:
            goal.abort(_refused(str(error)))

    def _tell_steps(self, goal: ServedGoal, done: int, left: int, is_over: bool) -> None:
        goal.publish_feedback(SimulateSteps.Feedback(completed_steps=done, remaining_steps=left))
        if not is_over:
            return
        self._goal = None
        if left == 0:
            goal.succeed(SimulateSteps.Result(result=Result(result=Result.RESULT_OK)))
        else:
            goal.canceled(_refused(f'{left} steps were not made'))

    def _cancel(self, goal: ServedGoal) -> None:
        if goal is self._goal:
            self._pacer.cancel_steps()


def _refused(why: str) -> Any:
    return SimulateSteps.Result(result=Result(result=Result.RESULT_OPERATION_FAILED, error_message=why))
