# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``goals``: a robot that plans, its operator or a scripted one, and what others do."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from sensor_msgs.msg import JointState
from simulation_interfaces.msg import EntityState, Result
from simulation_interfaces.srv import GetEntityState, SetEntityState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.mirror.records import AutonomyLevel, DecisionKind
from flexbt_demo_behaviors.demonstration.demo_processes import (
    Process,
    console_command,
    demo_file,
    mission_processes,
    only_robot,
)
from flexbt_demo_behaviors.demonstration.process_group import ProcessGroup
from flexbt_demo_behaviors.demonstration.report import (
    DemoError,
    DemoReport,
    GoalResult,
    Timeline,
    pose_text,
    world_with_places,
)
from flexbt_demo_behaviors.demonstration.running import (
    DemoSession,
    RunOptions,
    open_session,
    parse_run_options,
    run_console,
    run_demonstration,
)
from flexbt_demo_behaviors.demonstration.scripted_operator import (
    ANSWER_TIMEOUT_S,
    DRIVE_TIMEOUT_S,
    DemoSimulation,
    ScriptedOperator,
)
from flexbt_sim.messages import pose_of
from flexbt_sim.world import Pose

from .rooms import room_at

SPEED: Final = 0.7
"""Speed on a free, straight path, m/s: the maximum speed of the robot in the world file."""

WORLD: Final = demo_file('goals/flat.yaml')
PLACES: Final = demo_file('goals/places.yaml')


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation with its navigation, and the other processes of the robot.

    ``speed`` is in simulated seconds per second.
    """
    return (
        only_robot(speed, WORLD, desired_linear_vel=SPEED),
        *mission_processes(PLACES, {'navigators': (names.NAVIGATE_TO_POSE,)}),
    )


INTRODUCTION = """
The robot brings the cup from the kitchen to the office. Shut the door meanwhile, from another terminal:
  ros2 service call /simulator/doors/kitchen_door std_srvs/srv/SetBool "{data: false}"
"?" shows the keys, "!" stops what drives, "q" ends all.
"""


def main() -> int:
    """Run the demonstration with the options of the command line. Return the exit code of the process."""
    options = parse_run_options('goals', 'A robot plans its way to a goal, under an operator.')
    return run_demonstration('goals', options, _run)


def _run(options: RunOptions, group: ProcessGroup, timeline: Timeline) -> int:
    with open_session(group, robot_processes(options.speed), 'operator', timeline) as session:
        if not options.interactive:
            return _run_script(options, session, timeline)
        session.operator.start('Reach Goal', AutonomyLevel.HIGH)
    print(INTRODUCTION, flush=True)
    return run_console(group, console_command())


def _run_script(options: RunOptions, session: DemoSession, timeline: Timeline) -> int:
    household = Household(session.runtime, timeline, options.speed, session.operator.notify)
    session.track.restart()
    report = DemoReport(TITLE, BRANCHES)
    report.play(lambda: reach_goals(session.operator, household, report))
    world = world_with_places(WORLD, PLACES)
    for goal in report.goals:
        world.move(CUP, goal.pose)
    return report.conclude(world, {'robot': session.track}, options.output / 'demo5.png')


# The actions of the scripted operator and the household, and the branches that must be taken.

PLANNED: Final = 'planned: the closed door is opened'
SHUT: Final = 'the door is shut on the way: opened again'
PICKED_UP: Final = 'the cup is picked up in the kitchen'
MOVED: Final = 'the cup is taken away: planned anew'
REACHED: Final = 'the goal reached: the cup is in the office'
REFUSED: Final = 'a door that jams: no way, and told why'
AGAIN: Final = 'the door mended: planned anew, and reached'
BRANCHES: Final = (PLANNED, SHUT, PICKED_UP, MOVED, REACHED, REFUSED, AGAIN)

TITLE: Final = 'Demonstration 5: a goal, and a robot that plans'

NO_WAY: Final = 'there is no plan without FlatOpenDoor(kitchen_door, hall, kitchen) (failed: kitchen_door is jammed)'


def reach_goals(operator: ScriptedOperator, household: Household, report: DemoReport) -> None:
    """Have the robot bring the cup twice."""
    operator.wait(lambda _view: household.is_seen, 'the household seen', ANSWER_TIMEOUT_S)
    with household.in_real_time():  # so that others have time to interfere
        operator.start('Reach Goal', AutonomyLevel.HIGH)
        operator.wait_running(lambda _view: household.times_opened >= 1, 'the door of the kitchen opened by the robot')
        report.take(PLANNED)
        operator.wait_begun('FlatPassDoor(kitchen_door, hall, kitchen)')
        household.shut_door()
        operator.wait_running(lambda _view: household.times_opened >= 2, 'the door opened again by the robot')
        report.take(SHUT)
        operator.wait_running(lambda _view: household.times_held >= 1, 'the cup in the gripper of the robot')
        report.take(PICKED_UP)
        household.move_cup(1.2, 4.8)
        operator.wait_begun('FlatApproach(cup, hall)')
    report.take(MOVED)
    operator.wait_end('reached', DRIVE_TIMEOUT_S)
    report.goals.append(_check_cup(household))
    report.take(REACHED)

    household.move_cup(1.2, 1.2)
    household.shut_door()
    operator.wait(lambda _view: household.door_is_shut, 'the door shut', ANSWER_TIMEOUT_S)
    household.jam_door(jammed=True)
    operator.start('Reach Goal', AutonomyLevel.HIGH)
    decision = operator.wait_decision(DecisionKind.CHOICE, '/Ask', DRIVE_TIMEOUT_S)
    operator.wait_told(NO_WAY)
    report.take(REFUSED)
    household.jam_door(jammed=False)
    operator.choose(decision, 'again')
    operator.wait_end('reached', DRIVE_TIMEOUT_S)
    report.goals.append(_check_cup(household))
    report.take(AGAIN)


def _check_cup(household: Household) -> GoalResult:
    """Return the place of the cup. Raises DemoError if it is not in the office, or the robot still holds it."""
    pose = household.cup()
    room = room_at(pose.x, pose.y)
    if room != 'office' or household.held:
        raise DemoError(
            f'the cup is at {pose_text(pose)}, in the {room}; the robot holds {household.held or "nothing"}'
        )
    return GoalResult('cup', pose, 'put down in the office', 0.0, reached=True)


# Other people in the flat while the robot works: they act through services of the simulator, and are observed.

DOOR: Final = 'kitchen_door'
CUP: Final = 'cup'

MESSAGES: Final = 1000
"""Maximum number of waiting messages of a topic, large enough to lose none."""


class Household:
    """A household that shuts doors and moves cups.

    It calls `on_change` on another thread when it observes a change.
    """

    def __init__(self, runtime: NodeRuntime, timeline: Timeline, speed: float, on_change: Callable[[], None]) -> None:
        self.times_opened = 0
        """Number of times that the kitchen door opened completely."""
        self.times_held = 0
        """Number of times that the robot picked up the cup."""
        self.held = ''
        """Name of the object in the gripper; '' for none."""
        self._opening: float | None = None
        self._is_gripper_seen = False
        self._simulation = DemoSimulation(runtime, timeline, speed)
        self._timeline = timeline
        self._on_change = on_change
        runtime.call(lambda: self._subscribe(runtime))

    @property
    def door_is_shut(self) -> bool:
        """True if the kitchen door is completely closed."""
        return self._opening is not None and self._opening <= 0.0

    @property
    def is_seen(self) -> bool:
        """True if the states of door and gripper are known; from then on no change is missed."""
        return self._opening is not None and self._is_gripper_seen

    def in_real_time(self) -> AbstractContextManager[None]:
        """Limit the simulation to real time in the context."""
        return self._simulation.in_real_time()

    def shut_door(self) -> None:
        """Shut the kitchen door."""
        response = self._simulation.call(SetBool, f'doors/{DOOR}', SetBool.Request(data=False))
        if not response.success:
            raise DemoError(f'{DOOR} was not shut: {response.message}')
        self._timeline.tell('household', 'somebody shuts the door of the kitchen')

    def jam_door(self, jammed: bool) -> None:
        """Jam the door, or repair it."""
        self._simulation.set_fault(DOOR, 'door_jammed', clear=not jammed)
        self._timeline.tell('household', 'the door of the kitchen jams' if jammed else 'the door is mended')

    def move_cup(self, x: float, y: float) -> None:
        """Move the cup elsewhere, if necessary out of the robot's gripper."""
        state = EntityState()
        state.pose.position.x, state.pose.position.y = x, y
        response = self._simulation.call(
            SetEntityState, 'set_entity_state', SetEntityState.Request(entity=CUP, state=state)
        )
        if response.result.result != Result.RESULT_OK:
            raise DemoError(f'the cup was not moved: {response.result.error_message}')
        self._timeline.tell('household', f'somebody puts the cup to ({x:g}, {y:g}), in the {room_at(x, y)}')

    def cup(self) -> Pose:
        """Return the place of the cup."""
        response = self._simulation.call(GetEntityState, 'get_entity_state', GetEntityState.Request(entity=CUP))
        return pose_of(response.state.pose)

    def _subscribe(self, runtime: NodeRuntime) -> None:
        runtime.node.create_subscription(
            JointState, 'simulator/doors', self._on_doors, names.transient_local_qos(MESSAGES)
        )
        runtime.node.create_subscription(
            String, names.GRIPPER_HOLDS, self._on_holds, names.transient_local_qos(MESSAGES)
        )

    def _on_doors(self, message: JointState) -> None:
        before, self._opening = self._opening, message.position[message.name.index(DOOR)]
        self.times_opened += before is not None and before < 1.0 <= self._opening
        self._on_change()

    def _on_holds(self, message: String) -> None:
        self.times_held += message.data == CUP != self.held
        self.held = message.data
        self._is_gripper_seen = True
        self._on_change()
