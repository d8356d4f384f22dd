# SPDX-License-Identifier: BSD-3-Clause
"""The behavior of the benchmark against FlexBE with states of FlexBT's own: an action, then a decision, in turns."""

from __future__ import annotations

from typing import Final

from _flexbe_stamp import entered
from nav2_msgs.action import Wait

from flexbt_common.calls.action_call import GoalOutcome
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteState, OperatorDecisionState
from flexbt_states.goal_call import GoalState

ACTION: Final = 'flexbe_benchmark/wait'
TREE: Final = 'flexbe_probe_behaviors/config/probe.xml'
TREE_XML: Final = f"""
<root BTCPP_format="4">
  <BehaviorTree ID="FlexbeProbe">
    <Wait wait_duration="1.0" server_name="{ACTION}"/>
  </BehaviorTree>
</root>
"""


class Call(GoalState):
    """Sends a goal, and ends when there is a result."""

    def __init__(self) -> None:
        super().__init__(Wait, ACTION, outcomes=['done', 'failed'])

    def _make_goal(self, userdata: UserData) -> Wait.Goal:
        entered('Call')
        return Wait.Goal()

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        return 'done' if ended.status.name == 'SUCCEEDED' else 'failed'


class CallTree(BtExecuteState):
    """Runs a tree with one leaf, which sends the goal."""

    def on_enter(self, userdata: UserData) -> None:
        entered('Call')
        super().on_enter(userdata)


class Decide(OperatorDecisionState):
    """Waits until the operator decides."""

    def on_enter(self, userdata: UserData) -> None:
        entered('Decide')
        super().on_enter(userdata)


class FlexbeNative(Behavior):
    """Calls the action, waits for the operator, and so on."""

    manifest = BehaviorManifest(
        name='Native probe',
        description='For the benchmark against FlexBE: an action and an operator decision, in turns.',
        author='The FlexBT developers',
        parameters=[BehaviorParameter('through_tree', False, 'whether a leaf of a tree calls the action')],
    )
    through_tree: bool

    def create(self) -> OperatableStateMachine:
        """Two states that follow each other."""
        call: EventState = CallTree(bt_file=TREE) if self.through_tree else Call()
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add(
                'Call',
                call,
                transitions={outcome: 'Decide' if outcome == 'done' else 'failed' for outcome in call.outcomes},
                autonomy=dict.fromkeys(call.outcomes, Autonomy.Off),
            )
            OperatableStateMachine.add(
                'Decide',
                Decide(outcomes=['again', 'finish']),
                transitions={'again': 'Call', 'finish': 'finished'},
                autonomy={'again': Autonomy.Full, 'finish': Autonomy.Full},
            )
        return machine
