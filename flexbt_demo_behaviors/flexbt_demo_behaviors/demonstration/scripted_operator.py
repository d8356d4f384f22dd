# SPDX-License-Identifier: BSD-3-Clause
"""An operator that follows a script, and events in the simulated world.

The operator sees the console's mirror and sends commands over the same link as people. The events are caused through
services of the simulator.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from simulation_interfaces.msg import Result
from simulation_interfaces.srv import DeleteEntity, SpawnEntity

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.mirror import Change, Mirror
from flexbt_console.mirror.records import (
    AutonomyLevel,
    CommandKind,
    Decision,
    DecisionKind,
    ExecutiveState,
    OperatorCommand,
)
from flexbt_console.mirror.view import View
from flexbt_msgs.srv import SetFault
from flexbt_sim.world import ObstacleModel, Pose, box

from .report import GOAL_TOLERANCE, DemoError, GoalResult, RobotTrack, Timeline, pose_text

T = TypeVar('T')

# Deadlines in seconds of wall time. They are generous, because they only limit how late a failure is noticed.
ANSWER_TIMEOUT_S = 30.0
DRIVE_TIMEOUT_S = 300.0

# Polling interval. Poses arrive much more often; checks must not delay the thread that receives them, or observations
# would be seconds old on a busy computer.
LOOK_S = 0.02

# A place within this distance of the robot, m, is too near to be a goal.
FAR_ENOUGH = 2.5


class ScriptedOperator:
    """An operator that sends commands and waits for their effects. Every wait has a deadline and raises DemoError after
    it.

    `send` passes a command to the operator link, with the time limit for its answer in seconds. Call `notify` whenever
    an awaited condition may have changed, and `abandon` when nothing more will arrive. If the operator `is_on_call`, it
    does not start the behaviors: they may end at any time.
    """

    def __init__(
        self,
        mirror: Mirror,
        track: RobotTrack,
        send: Callable[[OperatorCommand, float], TrackedCommand],
        make: CommandBuilder,
        timeline: Timeline,
        is_on_call: bool = False,
    ) -> None:
        self.track = track
        self._is_on_call = is_on_call
        self._mirror = mirror
        self._send = send
        self._make = make
        self._timeline = timeline
        self._changed = threading.Condition()
        self._changes = 0
        self._problem = ''
        self._answered: set[str] = set()
        self._goal_label = ''
        self._goal_time = 0.0
        self._goal_length = 0.0
        mirror.add_listener(self._on_change)

    def notify(self) -> None:
        """Check the awaited condition again; callable from any thread."""
        with self._changed:
            self._changes += 1
            self._changed.notify_all()

    def abandon(self, problem: str) -> None:
        """End the current wait and all later ones with this problem; callable from any thread."""
        self._problem = self._problem or problem
        self.notify()

    def places(self, preferred: Sequence[str]) -> Sequence[str]:
        """Return the places to drive to.

        These are the preferred places or, on another map, the same number of places away from the robot.

        Raises DemoError if the places file has too few of them.
        """
        known = self._mirror.view().places
        if all(label in known for label in preferred):
            return preferred
        here = self.track.pose
        away = [label for label in known if here is None or here.distance(self._place(label)) > FAR_ENOUGH]
        if len(away) < len(preferred):
            raise DemoError(
                f'the script needs {len(preferred)} places more than {FAR_ENOUGH:g} m from the robot; '
                f'the places file has {len(away)}'
            )
        return away[: len(preferred)]

    # Observation

    def wait(self, wanted: Callable[[View], T | None], what: str, timeout: float) -> T:
        """Wait until `wanted` returns something other than None or False for the current view, and return it.

        Raises DemoError after `timeout` seconds, or when the demonstration is abandoned.
        """
        deadline = time.monotonic() + timeout
        while True:
            with self._changed:
                changes = self._changes
            if self._problem:
                raise DemoError(self._problem)
            view = self._mirror.view()
            found = wanted(view)
            if found is not None and found is not False:
                return found
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                raise DemoError(f'{what}: not within {timeout:.0f} s; {_described(view)}')
            with self._changed:
                self._changed.wait_for(lambda seen=changes: self._changes != seen, remaining)  # type: ignore[misc]
            time.sleep(LOOK_S)

    def wait_running(self, wanted: Callable[[View], T | None], what: str, timeout: float = DRIVE_TIMEOUT_S) -> T:
        """Wait as :meth:`wait` does, while the behavior runs. Also raises DemoError when it ends."""

        def seen(view: View) -> T | None:
            found = wanted(view)
            if found is None or found is False:
                self._check_running(view)
            return found

        return self.wait(seen, what, timeout)

    def wait_ready(self, peers: int, timeout: float) -> None:
        """Wait until the executive is connected and sees its peers ready, and the robot and its map are known."""

        def ready(view: View) -> bool:
            known = view.snapshot.peers if view.snapshot else ()
            all_ready = len(known) >= peers and all(peer.alive and peer.ready for peer in known)
            listed = view.behaviors is not None and view.has_places
            return view.live and all_ready and listed and self.track.ready

        self.wait(ready, 'executive, its peers, the map and the robot', timeout)

    def wait_decision(self, kind: DecisionKind, path: str, timeout: float) -> Decision:
        """Wait until the state `path` asks the operator for a decision of this kind that is not answered yet."""

        def decision(view: View) -> Decision | None:
            asked = (
                item for item in view.decisions if item.kind is kind and item.path == path and not view.lacks(item)
            )
            return next((item for item in asked if item.id not in self._answered), None)

        return self.wait_running(decision, f'decision of {path}', timeout)

    def wait_state(self, path: str, timeout: float = ANSWER_TIMEOUT_S) -> None:
        """Wait until the leaf `path` is active."""
        self.wait_running(lambda view: path in view.active_paths, f'state {path}', timeout)

    def wait_tree_node(self, node: str, timeout: float = ANSWER_TIMEOUT_S) -> None:
        """Wait until an active state reports that its tree runs a node whose path contains `node`."""

        def running(view: View) -> bool:
            states = view.snapshot.active_states if view.snapshot else ()
            return any(node in line for state in states for line in state.activity)

        self.wait_running(running, f'tree node {node} running', timeout)

    def wait_driven(self, metres: float) -> None:
        """Wait until the robot has driven `metres` since the goal was sent, and is moving."""

        def far(_view: View) -> bool:
            return self.track.length - self._goal_length >= metres and not self.track.at_rest

        self.wait_running(far, f'{metres:g} m driven')
        self._tell('sees', f'the robot on its way at {pose_text(self.track.pose)}')

    def wait_begun(self, node: str) -> None:
        """Wait until a tree node has started to run since the track began, even if it has already ended.

        Raises DemoError if the behavior asks the operator for the next goal without it.
        """

        def begun(view: View) -> bool:
            if self.track.has_begun(node):
                return True
            asked = any(item.kind is DecisionKind.INPUT and item.id not in self._answered for item in view.decisions)
            if asked:
                raise DemoError(f'the goal {self._goal_label} was done with before the tree had begun {node!r}')
            return False

        self.wait_running(begun, f'tree node {node} begun')
        self._tell('sees', f'that the tree has begun {node!r}')

    def wait_rest(self) -> None:
        """Wait until the robot stands still. benchmarks/robot/latency.py measures how soon that is after a stop."""
        self.wait(lambda _view: self.track.at_rest, 'robot at rest', ANSWER_TIMEOUT_S)

    def wait_end(self, outcome: str, timeout: float = ANSWER_TIMEOUT_S) -> None:
        """Wait until the behavior has ended with this outcome."""

        def ended(view: View) -> str | None:
            idle = view.snapshot is not None and view.snapshot.state is ExecutiveState.IDLE
            return view.snapshot.outcome if view.snapshot and idle else None

        actual = self.wait(ended, 'end of the behavior', timeout)
        if actual != outcome:
            raise DemoError(f'the behavior ended by {actual!r}, not by {outcome!r}')
        self._tell('sees', f'the behavior ended: {outcome}')

    def wait_told(self, text: str) -> None:
        """Wait until the log of the behavior has a line that contains this text."""
        told = f'a line of the log with {text!r}'
        self.wait(lambda _view: any(text in line.text for line in self._mirror.log()), told, ANSWER_TIMEOUT_S)

    # Commands

    def start(self, behavior: str, autonomy: AutonomyLevel, **arguments: str) -> None:
        """Start a behavior with arguments for its parameters."""
        self._tell('starts', f'{_called(behavior, arguments)} at autonomy {autonomy.name.title()}')
        self._give(self._make.start(self._mirror.view(), behavior, list(arguments.items()), autonomy))
        self.wait(lambda view: view.running, f'start of {behavior}', ANSWER_TIMEOUT_S)

    def switch(self, behavior: str, **arguments: str) -> None:
        """Switch to another behavior, or to other arguments, and keep the active states."""
        self._tell('switches', f'to {_called(behavior, arguments)}')
        self._answered.update(decision.id for decision in self._mirror.view().decisions)  # they are asked again
        self._give(self._make.switch(self._mirror.view(), behavior, list(arguments.items())))

    def give_goal(self, label: str, state: str = '/AskGoal') -> None:
        """Answer the request for a goal with a named place."""
        decision = self.wait_decision(DecisionKind.INPUT, state, ANSWER_TIMEOUT_S)
        self._tell('answers', f'"{decision.prompt}" with {label} {pose_text(self._place(label))}')
        self.expect_goal(label)
        self._give(self._make.answer(self._mirror.view(), decision.id, label))

    def expect_goal(self, label: str) -> None:
        """Record that a decision sends the robot to a named place."""
        self._goal_label = label
        self._goal_time = self.track.time
        self._goal_length = self.track.length

    def decline(self, state: str = '/AskGoal') -> None:
        """Decline the request for a goal."""
        decision = self.wait_decision(DecisionKind.INPUT, state, ANSWER_TIMEOUT_S)
        self._tell('declines', f'"{decision.prompt}"')
        self._give(self._make.decline(self._mirror.view(), decision.id))

    def choose(self, decision: Decision, outcome: str) -> None:
        """Answer the decision of a waiting state, by the suggested outcome or by another one."""
        verb = 'confirms' if outcome == decision.outcome else 'overrules'
        self._tell(verb, f'{decision.path}: {outcome}')
        self._give(self._make.choose(self._mirror.view(), decision, outcome))

    def force(self, path: str, outcome: str) -> None:
        """Leave an active state that has not asked."""
        self._tell('forces', f'{path}: {outcome}')
        self._give(self._make.force(self._mirror.view(), path, outcome))

    def stop(self) -> None:
        """Stop the behavior."""
        self._tell('stops', 'the behavior')
        command = self._make.command(self._mirror.view(), CommandKind.STOP)
        self._give(replace(command, reason='to show that the robot stops'))

    def close_goal(self, ending: str, must_reach: bool) -> GoalResult:
        """Return the result of the last goal.

        Raises DemoError if the robot had to reach it and did not.
        """
        self.wait(self._is_seen, 'robot where it is now', ANSWER_TIMEOUT_S)
        goal, pose = self._place(self._goal_label), self.track.pose
        error = pose.distance(goal) if pose else float('inf')
        result = GoalResult(
            label=self._goal_label,
            pose=goal,
            ending=ending,
            error=error,
            seconds=self.track.time - self._goal_time,
            metres=self.track.length - self._goal_length,
            reached=must_reach and error <= GOAL_TOLERANCE,
        )
        self._timeline.tell('robot', f'{ending}: at {pose_text(pose)}, {error:.2f} m from {self._goal_label}')
        if must_reach and not result.reached:
            where = f'at {pose_text(pose)} instead of {pose_text(goal)}'
            raise DemoError(f'goal {self._goal_label}: the robot is {error:.2f} m off, {where}')
        return result

    def _is_seen(self, view: View) -> bool:
        """Return whether the pose is as new as the active state: on a busy computer it may arrive later."""
        states = view.snapshot.active_states if view.snapshot else ()
        return self.track.time >= max((state.entered for state in states), default=0.0)

    def _give(self, command: OperatorCommand) -> None:
        """Send a command and wait until it is applied."""
        self._answered.add(command.decision_id)
        self._send(command, ANSWER_TIMEOUT_S)

        def settled(_view: View) -> TrackedCommand | None:
            tracked = self._mirror.command(command.id)
            return tracked if tracked and tracked.state is not CommandState.PENDING else None

        name = command.kind.name.lower()
        tracked = self.wait(settled, f'answer to {name}', 2 * ANSWER_TIMEOUT_S)
        if tracked.state is not CommandState.APPLIED:
            raise DemoError(f'the command {name} was not applied ({tracked.state.value}): {tracked.reason}')

    def _check_running(self, view: View) -> None:
        """Raise DemoError if the behavior has ended, or waits for a decision that the script does not know."""
        snapshot = view.snapshot
        if snapshot is None:
            return
        if snapshot.run_id and snapshot.state is ExecutiveState.IDLE and not self._is_on_call:
            why = f': {snapshot.message}' if snapshot.message else ''
            raise DemoError(f'the behavior {snapshot.behavior} ended by {snapshot.outcome!r} before its time{why}')
        for decision in snapshot.decisions:
            if decision.kind is DecisionKind.TRANSITION:
                raise DemoError(
                    f'{decision.path} waits for a person to confirm {decision.outcome!r}, which is not expected'
                )

    def _place(self, label: str) -> Pose:
        place = self._mirror.view().places[label]
        return Pose(place.x, place.y, place.yaw)

    def _on_change(self, _change: Change) -> None:
        self.notify()

    def _tell(self, verb: str, what: str) -> None:
        self._timeline.tell('operator', f'{verb} {what}')


def _called(behavior: str, arguments: Mapping[str, str]) -> str:
    return ' '.join([repr(behavior), *(f'{name}={value!r}' for name, value in arguments.items())])


def _described(view: View) -> str:
    """Return a description of the actual situation, for the error message of a wait."""
    snapshot = view.snapshot
    if snapshot is None:
        return f'no executive is heard (link {view.link.value})'
    peers = ', '.join(
        f'{peer.name} {"NOT ALIVE" if not peer.alive else "ready" if peer.ready else "NOT READY"}'
        for peer in snapshot.peers
    )
    decisions = ', '.join(f'{item.kind.name} of {item.path}' for item in snapshot.decisions) or 'none'
    return (
        f'executive {snapshot.state.name}, active {", ".join(view.active_paths) or "nothing"}, '
        f'decisions: {decisions}; peers: {peers or "none"}; link {view.link.value}'
    )


REAL_TIME: Final = 1.0


@dataclass(frozen=True)
class SimulatedBox:
    """A box in the way: its centre and side lengths, m, parallel to the axes of the map."""

    x: float
    y: float
    length: float
    width: float

    @property
    def model(self) -> ObstacleModel:
        """Description for a world."""
        return ObstacleModel(Pose(self.x, self.y, 0.0), box(self.length, self.width))

    @property
    def description(self) -> dict[str, Any]:
        """Description for a world file."""
        return {'pose': [self.x, self.y, 0.0], 'shape': [self.length, self.width]}


class DemoSimulation:
    """A client of the simulator. Each call waits until it has taken effect, and raises DemoError if it does not.

    ``speed`` is the number of simulated seconds per second.
    """

    def __init__(self, runtime: NodeRuntime, timeline: Timeline, speed: float = REAL_TIME) -> None:
        self._runtime = runtime
        self._timeline = timeline
        self._speed = speed
        self._boxes: dict[str, SimulatedBox] = {}

    @property
    def boxes(self) -> Mapping[str, SimulatedBox]:
        """All boxes that were ever placed, by name."""
        return self._boxes

    def put(self, name: str, box: SimulatedBox) -> None:
        """Place a box in the way."""
        self._boxes[name] = box
        described = json.dumps({'obstacles': {name: box.description}})
        self._ask(SpawnEntity, 'spawn_entity', SpawnEntity.Request(name=name, resource_string=described))
        self._timeline.tell('world', f'somebody leaves the {name} at ({box.x:.2f}, {box.y:.2f})')

    def take_away(self, name: str) -> None:
        """Remove a box."""
        self._ask(DeleteEntity, 'delete_entity', DeleteEntity.Request(entity=name))
        self._timeline.tell('world', f'somebody takes the {name} away')

    def in_real_time(self) -> contextlib.AbstractContextManager[None]:
        """Limit the simulation to real time in this context, so that a busy computer can intervene in time."""
        return self.no_faster_than(REAL_TIME)

    def set_fault(self, entity: str, fault: str, parameters: str = '', *, clear: bool = False) -> None:
        """Set a fault of an entity, or clear it."""
        request = SetFault.Request(entity=entity, fault=fault, parameters=parameters, clear=clear)
        response = self.call(SetFault, 'set_fault', request)
        if not response.success:
            raise DemoError(f'the fault {fault} of {entity} was not {"ended" if clear else "set"}: {response.message}')

    @contextlib.contextmanager
    def no_faster_than(self, factor: float) -> Iterator[None]:
        """Limit the speed of the simulation in this context, in simulated seconds per second."""
        before = self._speed
        self._set_speed(min(before, factor))
        try:
            yield
        finally:
            self._set_speed(before)

    def call(self, service_type: Any, name: str, request: Any) -> Any:
        """Call a service of the simulator and return the response."""
        return call_service(self._runtime, service_type, f'{names.SIMULATOR}/{name}', request)

    def _ask(self, service_type: Any, name: str, request: Any) -> None:
        result = self.call(service_type, name, request).result
        if result.result != Result.RESULT_OK:
            raise DemoError(f'the service {name} of the simulator refuses: {result.error_message}')

    def _set_speed(self, factor: float) -> None:
        value = Parameter('speed_factor', value=factor).to_parameter_msg()
        response = self.call(SetParameters, 'set_parameters', SetParameters.Request(parameters=[value]))
        if not response.results[0].successful:
            raise DemoError(f'the speed of the simulator was not set: {response.results[0].reason}')
        self._speed = factor


def call_service(runtime: NodeRuntime, service_type: Any, name: str, request: Any) -> Any:
    """Call a service and return the response. Raises DemoError if it does not arrive in time."""
    links = runtime.call(lambda: runtime.once('links to services', ServiceLinks))
    outcome = service_outcome(links.link(service_type, name), request, ANSWER_TIMEOUT_S)
    if outcome.response is None:
        raise DemoError(f'the service {name}: {outcome.reason}')
    return outcome.response
