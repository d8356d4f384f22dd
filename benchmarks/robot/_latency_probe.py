# SPDX-License-Identifier: BSD-3-Clause
"""The behavior that the latency benchmark runs: a tree with one action leaf, then a decision of the operator, again."""

from __future__ import annotations

from typing import Final

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import BtExecuteState, OperatorDecisionState

TREE: Final = 'LatencyProbe'
TREE_XML: Final = f"""
<root BTCPP_format="4">
  <BehaviorTree ID="{TREE}">
    <Wait wait_duration="1.0" server_name="latency_probe/wait"/>
  </BehaviorTree>
</root>
"""


class LatencyProbe(Behavior):
    """Runs the tree, asks the operator, and so on."""

    manifest = BehaviorManifest(
        name='Latency probe',
        description='For the latency benchmark: a tree with one action leaf and an operator decision, in turns.',
        author='The FlexBT developers',
    )

    def create(self) -> OperatableStateMachine:
        """Two states that follow each other."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        with machine:
            OperatableStateMachine.add(
                'Tree',
                BtExecuteState(bt_file=TREE),
                transitions={'done': 'Decide', 'canceled': 'failed', 'failed': 'failed'},
                autonomy={'done': Autonomy.Off, 'canceled': Autonomy.Off, 'failed': Autonomy.Off},
            )
            OperatableStateMachine.add(
                'Decide',
                OperatorDecisionState(outcomes=['again', 'finish'], hint='Once more?'),
                transitions={'again': 'Tree', 'finish': 'finished'},
                autonomy={'again': Autonomy.Full, 'finish': Autonomy.Full},
            )
        return machine
