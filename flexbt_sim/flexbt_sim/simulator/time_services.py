# SPDX-License-Identifier: BSD-3-Clause
"""The time of the world by the standard services of simulators: play, pause, step, restart; and what can be done."""

from __future__ import annotations

from typing import Any, Final

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

from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_sim.errors import SimulationError

from .core import SimulatorCore
from .entity_services import ServiceRefusedError, answered

MOST_STEPS: Final = 1_000_000
"""Steps of one request: hours of simulated time."""

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
            with self._simulator.lock:  # not in the middle of a step: afterwards none is made
                self._pacer.pause()
            if wanted == STOPPED:
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
                raise SimulationError(f'{left} of {request.steps} steps were not made: the simulation goes on')
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
