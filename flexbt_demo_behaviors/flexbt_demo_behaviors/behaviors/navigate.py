# SPDX-License-Identifier: BSD-3-Clause
"""The first demonstration: drive to the goals that the operator gives, one after the other."""

from __future__ import annotations

from flexbt_core.state_machine import Autonomy, OperatableStateMachine
from flexbt_onboard.behaviors import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteGoalState, BtLoaderState, OperatorInputState


class Navigate(Behavior):
    """Ask for a goal, let one behavior tree do all of the navigation, and ask for the next goal."""

    manifest = BehaviorManifest(
        name='Navigate',
        description='Drive to goals that the operator gives; planning, driving and recovery are one behavior tree.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter(
                'tree',
                'flexbt_demo_behaviors/trees/navigate.xml',
                'behavior tree that drives to its goal pose, as package/path',
            ),
        ],
    )

    tree: str

    def create(self) -> OperatableStateMachine:
        """Load the tree, then: ask for a goal, drive there, and again."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add(
                'LoadTree',
                BtLoaderState(filepaths=[self.tree]),
                transitions={'done': 'AskGoal', 'failed': 'failed'},
                autonomy={'done': Autonomy.Off, 'failed': Autonomy.Off},
            )
            OperatableStateMachine.add(
                'AskGoal',
                OperatorInputState('Where shall the robot go?', 'geometry_msgs/PoseStamped'),
                transitions={'received': 'Drive', 'declined': 'finished', 'failed': 'failed'},
                autonomy={'received': Autonomy.Off, 'declined': Autonomy.Off, 'failed': Autonomy.Off},
                remapping={'data': 'goal'},
            )
            # At autonomy Low the operator also confirms each arrival; a failure is always a matter for a
            # person.
            OperatableStateMachine.add(
                'Drive',
                BtExecuteGoalState(bt_file=self.tree),
                transitions={'done': 'AskGoal', 'canceled': 'AskGoal', 'failed': 'AskGoal'},
                autonomy={'done': Autonomy.Low, 'canceled': Autonomy.Off, 'failed': Autonomy.Full},
                remapping={'goal': 'goal'},
            )
        return machine
