# SPDX-License-Identifier: BSD-3-Clause
"""Engines alone, for the benchmark against FlexBE: transitions of states that take turns, 4 levels deep.

Usage: _flexbe_engine.py FlexBT|FlexBE. Reads names of subjects, one a line, and answers each with the processor time
of a transition, in microseconds. The subjects are the keys of :data:`SUBJECTS`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, Final

from _hfsm_subjects import DEPTH, PER_SAMPLE

SUBJECTS: Final = {'FlexBT': ('chained', 'woken'), 'FlexBE': ('unsupervised', 'supervised')}
"""FlexBE publishes a transition when the run is supervised, and not otherwise."""

UNSUPERVISED: Final = 255


def flexbt() -> Mapping[str, Callable[[], float]]:
    """Sample of FlexBT's engine."""
    from _hfsm_subjects import Subject

    return {way: Subject('4 levels deep', way).sample for way in SUBJECTS['FlexBT']}


def flexbe() -> Mapping[str, Callable[[], float]]:
    """Sample of FlexBE's engine: ticks that follow each other without a pause, each of which is a transition."""
    import rclpy
    from _flexbe_onboard import do_without_tf2

    do_without_tf2()
    from flexbe_core import Autonomy, EventState, OperatableStateMachine

    class Pass(EventState):
        """Ends at once."""

        visits = 0

        def __init__(self) -> None:
            super().__init__(outcomes=['done', 'failed'], input_keys=['a'], output_keys=['b'])

        def on_enter(self, userdata: Any) -> None:
            Pass.visits += 1

        def execute(self, userdata: Any) -> str:
            return 'done'

        def on_exit(self, userdata: Any) -> None:
            pass

    def ring(depth: int) -> Any:
        machine = OperatableStateMachine(outcomes=['ended'], io_keys=['a', 'b'])
        with machine:
            if depth > 1:
                OperatableStateMachine.add('Inner', ring(depth - 1), {'ended': 'ended'}, {'ended': Autonomy.Off})
            else:
                for label, target in (('One', 'Two'), ('Two', 'One')):
                    OperatableStateMachine.add(
                        label,
                        Pass(),
                        {'done': target, 'failed': 'ended'},
                        autonomy={'done': Autonomy.Low, 'failed': Autonomy.Off},
                    )
        return machine

    rclpy.init()
    node = rclpy.create_node('flexbe_engine')
    OperatableStateMachine.initialize_ros(node)
    Pass.initialize_ros(node)

    def subject(level: int) -> Callable[[], float]:
        machine = ring(DEPTH)
        machine.userdata.a = 1
        machine.userdata.b = 2
        OperatableStateMachine.autonomy_level = level
        machine.confirm('ring', 1)

        def sample() -> float:
            first, began = Pass.visits, time.thread_time()
            for _ in range(PER_SAMPLE):
                machine.execute(None)
            seconds = time.thread_time() - began
            assert Pass.visits - first == PER_SAMPLE
            return seconds / PER_SAMPLE * 1e6

        return sample

    # The level is that of the process; a machine that is not supervised does not look at it.
    return {name: subject(level) for name, level in zip(SUBJECTS['FlexBE'], (UNSUPERVISED, Autonomy.Full), strict=True)}


def main() -> int:
    answers = sys.stdout
    sys.stdout = sys.stderr  # FlexBE prints
    samples = {'FlexBT': flexbt, 'FlexBE': flexbe}[sys.argv[1]]()
    for line in sys.stdin:
        print(samples[line.strip()](), file=answers, flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
