# SPDX-License-Identifier: BSD-3-Clause
"""The handover from a program to a person: a question, and the robot for as long as the answer needs it."""

from __future__ import annotations

from typing import Final

from flexbt_core import Autonomy, OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteGoalState, BtLoaderState, OperatorDecisionState, OperatorInputState

TREE: Final = 'flexbt_demo_behaviors/nav2_robot/navigate_to_pose.xml'


class AskOperator(Behavior):
    """Ask how to go on. The operator confirms, sends the robot elsewhere first, or sends it home."""

    manifest = BehaviorManifest(
        name='Ask Operator',
        description='Ask a person how the program shall continue; the person may drive the robot elsewhere first.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter('question', 'How shall the program continue?', 'what the operator is asked'),
            BehaviorParameter('tree', TREE, 'behavior tree that drives to a place of the operator, as package/path'),
        ],
    )

    question: str
    tree: str

    def create(self) -> OperatableStateMachine:
        """Ask. While the operator wants to, drive elsewhere and ask again."""
        machine = OperatableStateMachine(outcomes=['go_on', 'home', 'failed'], autonomy=Autonomy.Off)
        with machine:
            OperatableStateMachine.add(
                'LoadTree',
                BtLoaderState(filepaths=[self.tree]),
                transitions={'done': 'Ask', 'failed': 'failed'},
            )
            # The program continues without a person only at autonomy Full.
            OperatableStateMachine.add(
                'Ask',
                OperatorDecisionState(outcomes=['go_on', 'elsewhere', 'home'], hint=self.question, suggestion='go_on'),
                transitions={'go_on': 'go_on', 'elsewhere': 'AskPlace', 'home': 'home'},
                autonomy={'go_on': Autonomy.High, 'elsewhere': Autonomy.Full, 'home': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'AskPlace',
                OperatorInputState('Where shall the robot go first?', 'geometry_msgs/PoseStamped'),
                transitions={'received': 'Drive', 'declined': 'Ask', 'failed': 'failed'},
                remapping={'data': 'goal'},
            )
            OperatableStateMachine.add(
                'Drive',
                BtExecuteGoalState(bt_file=self.tree),
                transitions={'done': 'Ask', 'canceled': 'Ask', 'failed': 'Ask'},
                autonomy={'failed': Autonomy.Full},
                remapping={'goal': 'goal'},
            )
        return machine
