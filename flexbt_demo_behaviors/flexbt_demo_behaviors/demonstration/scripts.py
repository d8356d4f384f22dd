# SPDX-License-Identifier: BSD-3-Clause
"""What the scripted operator does in the two demonstrations, and the branches that each of them has to take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flexbt_console.mirror import AutonomyLevel, Decision, DecisionKind

from .report import DemoError, DemoReport
from .scripted_operator import ANSWER_TIMEOUT_S, DRIVE_TIMEOUT_S, ScriptedOperator

# From a stop to rest, in seconds of wall time. It takes 0.1 to 0.5 s; that of a busy machine, which runs the world at
# several times real time, is no promise of the robot's (benchmarks/latency.py has that), so there is much room.
STOP_S = 5.0


@dataclass(frozen=True)
class Demonstration:
    """A demonstration: its number and title, the places that it drives to, its branches, and its script."""

    number: int
    title: str
    behavior: str
    branches: tuple[str, ...]
    script: Callable[[ScriptedOperator, DemoReport], None]

    def report(self) -> DemoReport:
        """A report of it with nothing done yet."""
        return DemoReport(f'Demonstration {self.number}: {self.title}', dict.fromkeys(self.branches, False))


REACHED = 'goal reached'
REPLACED = 'goal replaced on the way'
REPLACEMENT_REACHED = 'the goal in its place reached'
FINISHED = 'finished by the operator'


def navigate(operator: ScriptedOperator, report: DemoReport) -> None:
    """Drive to one goal; on the way to the second one, replace it by a third."""
    first, second, third = operator.places(('kitchen', 'office', 'lounge'))
    operator.start('Navigate', AutonomyLevel.HIGH)

    operator.give_goal(first)
    operator.wait_state('/Drive')
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(REACHED)

    operator.give_goal(second)
    operator.wait_driven(2.0)
    operator.force('/Drive', 'canceled')
    _check_rest(operator)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('replaced on the way', must_reach=False))
    report.take(REPLACED)

    operator.give_goal(third)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(REPLACEMENT_REACHED)

    operator.decline()
    operator.wait_end('finished')
    report.take(FINISHED)


ACCEPTED = 'plan accepted, goal reached'
ANOTHER_GOAL = 'another goal instead of the plan'
REJECTED = 'plan sent to recovery'
RECOVERY_FORCED = 'driving sent to recovery'
STOPPED = 'behavior stopped while driving'
AUTONOMOUS = 'plan accepted by the robot itself'
RECOVERY_ABORTED = 'recovery aborted, behavior failed'


def navigate_split(operator: ScriptedOperator, report: DemoReport) -> None:
    """Take every branch of the second behavior."""
    first, second, third = operator.places(('store', 'workshop', 'kitchen'))
    operator.start('Navigate Split', AutonomyLevel.HIGH)

    operator.give_goal(first)
    operator.choose(_wait_plan(operator), 'done')
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(ACCEPTED)

    operator.give_goal(second)
    operator.choose(_wait_plan(operator), 'canceled')
    _wait_asked_again(operator)
    report.take(ANOTHER_GOAL)

    operator.give_goal(third)
    operator.choose(_wait_plan(operator), 'failed')
    operator.wait_state('/Recover')
    _wait_asked_again(operator)
    report.take(REJECTED)

    operator.give_goal(third)
    operator.choose(_wait_plan(operator), 'done')
    operator.wait_driven(3.2)
    operator.force('/FollowPath', 'failed')
    operator.wait_state('/Recover')
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('sent to recovery', must_reach=False))
    report.take(RECOVERY_FORCED)

    operator.give_goal(third)
    operator.choose(_wait_plan(operator), 'done')
    operator.wait_driven(1.0)
    operator.stop()
    _check_rest(operator)
    operator.wait_end('preempted')
    report.goals.append(operator.close_goal('stopped by the operator', must_reach=False))
    report.take(STOPPED)

    operator.start('Navigate Split', AutonomyLevel.FULL)
    operator.give_goal(third)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(AUTONOMOUS)

    operator.give_goal(second)
    operator.wait_driven(1.0)
    operator.force('/FollowPath', 'failed')
    operator.wait_state('/Recover')
    operator.force('/Recover', 'failed')
    _check_rest(operator)
    operator.wait_end('failed')
    report.goals.append(operator.close_goal('given up', must_reach=False))
    report.take(RECOVERY_ABORTED)


DEMONSTRATIONS = {
    1: Demonstration(
        1,
        'one tree navigates',
        'Navigate',
        (REACHED, REPLACED, REPLACEMENT_REACHED, FINISHED),
        navigate,
    ),
    2: Demonstration(
        2,
        'planner, controller and recovery are three trees',
        'Navigate Split',
        (ACCEPTED, ANOTHER_GOAL, REJECTED, RECOVERY_FORCED, STOPPED, AUTONOMOUS, RECOVERY_ABORTED),
        navigate_split,
    ),
}


def _wait_asked_again(operator: ScriptedOperator) -> Decision:
    """Wait until the behavior asks for the next goal: the drive is over."""
    return operator.wait_decision(DecisionKind.INPUT, '/AskGoal', DRIVE_TIMEOUT_S)


def _wait_plan(operator: ScriptedOperator) -> Decision:
    """Wait until the operator is asked to judge the plan."""
    return operator.wait_decision(DecisionKind.CHOICE, '/JudgePath', ANSWER_TIMEOUT_S)


def _check_rest(operator: ScriptedOperator) -> None:
    """Check that a robot that was told to stop stands still in time."""
    seconds = operator.wait_rest(ANSWER_TIMEOUT_S)
    if seconds > STOP_S:
        raise DemoError(f'the robot came to rest only {seconds:.2f} s after the command, not within {STOP_S:g} s')
