# SPDX-License-Identifier: BSD-3-Clause
"""The behavior that the robots of the fleet benchmark run: one decision of the operator after the other."""

from __future__ import annotations

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import OperatorDecisionState


class FleetProbe(Behavior):
    """Asks here, then there, and so on."""

    manifest = BehaviorManifest(
        name='Fleet probe',
        description='For the fleet benchmark: two operator decisions, in turns.',
        author='The FlexBT developers',
    )

    def create(self) -> OperatableStateMachine:
        """Two states that follow each other."""
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            for here, there in (('Here', 'There'), ('There', 'Here')):
                OperatableStateMachine.add(
                    here,
                    OperatorDecisionState(outcomes=['go', 'finish'], hint='Go on?'),
                    transitions={'go': there, 'finish': 'finished'},
                )
        return machine
