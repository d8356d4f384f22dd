# SPDX-License-Identifier: BSD-3-Clause
"""What the scripted operator and the household do, and the branches that are taken."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_console.mirror import AutonomyLevel, DecisionKind
from flexbt_demo_behaviors.demonstration import (
    ANSWER_TIMEOUT_S,
    DRIVE_TIMEOUT_S,
    DemoError,
    DemoReport,
    GoalResult,
    ScriptedOperator,
)
from flexbt_demo_goals.leaves import room_at

from .household import Household

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


@dataclass(frozen=True)
class Flat:
    """What the operator has before them: the robot, and the household."""

    operator: ScriptedOperator
    household: Household


def reach_goals(flat: Flat, report: DemoReport) -> None:
    """Have the cup brought twice."""
    operator, household = flat.operator, flat.household

    operator.wait(lambda _view: household.is_seen, 'the household seen', ANSWER_TIMEOUT_S)
    with household.in_real_time():  # it takes others a moment to meddle
        operator.start('Reach Goal', AutonomyLevel.HIGH)
        operator.wait_happened(lambda: household.times_opened >= 1, 'the door of the kitchen opened by the robot')
        report.take(PLANNED)
        operator.wait_begun('FlatPassDoor(kitchen_door, hall, kitchen)')
        household.shut_door()
        operator.wait_happened(lambda: household.times_opened >= 2, 'the door opened again by the robot')
        report.take(SHUT)
        operator.wait_happened(lambda: household.times_held >= 1, 'the cup in the gripper of the robot')
        report.take(PICKED_UP)
        household.move_cup(1.2, 4.8)
        operator.wait_begun('FlatApproach(cup, hall)')
    report.take(MOVED)
    operator.wait_end('reached', DRIVE_TIMEOUT_S)
    report.goals.append(_check_cup(flat))
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
    report.goals.append(_check_cup(flat))
    report.take(AGAIN)


def _check_cup(flat: Flat) -> GoalResult:
    """Where the cup is; raises DemoError when that is not the office, or the robot holds it still."""
    pose = flat.household.cup()
    room = room_at(pose.x, pose.y)
    if room != 'office' or flat.household.held:
        raise DemoError(f'the cup is at {pose}, in the {room}; the robot holds {flat.household.held or "nothing"}')
    return GoalResult('cup', pose, 'put down in the office', 0.0, reached=True)
