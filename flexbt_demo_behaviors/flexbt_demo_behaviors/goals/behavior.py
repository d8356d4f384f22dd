# SPDX-License-Identifier: BSD-3-Clause
"""A behavior that runs the tree with the mission, and asks the operator if no plan is left."""

from __future__ import annotations

from typing import Final

from flexbt_core import Autonomy, OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteState, BtLoaderState, OperatorDecisionState

TREE: Final = 'flexbt_demo_behaviors/goals/bring_cup.xml'


class ReachGoal(Behavior):
    """Reach the goal of the tree's mission; where there is no way, a person says whether to try again."""

    manifest = BehaviorManifest(
        name='Reach Goal',
        description='Reach the goal of a mission; where there is no way, ask a person.',
        author='The FlexBT developers',
        parameters=[BehaviorParameter('tree', TREE, 'behavior tree that reaches the goal, as package/path')],
    )

    tree: str

    def create(self) -> OperatableStateMachine:
        """Try; if no way is left, ask the operator."""
        machine = OperatableStateMachine(outcomes=['reached', 'given_up', 'failed'], autonomy=Autonomy.Off)
        with machine:
            OperatableStateMachine.add(
                'LoadTree',
                BtLoaderState(filepaths=[self.tree]),
                transitions={'done': 'Reach', 'failed': 'failed'},
            )
            OperatableStateMachine.add(
                'Reach',
                BtExecuteState(bt_file=self.tree),
                transitions={'done': 'reached', 'canceled': 'given_up', 'failed': 'Ask'},
            )
            OperatableStateMachine.add(
                'Ask',
                OperatorDecisionState(outcomes=['again', 'give_up'], hint='There is no way to the goal. And now?'),
                transitions={'again': 'Reach', 'give_up': 'given_up'},
                autonomy={'again': Autonomy.Full, 'give_up': Autonomy.Full},
            )
        return machine
