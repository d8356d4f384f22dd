# SPDX-License-Identifier: BSD-3-Clause
"""Three levels: a behavior runs a tree, a leaf of which runs a behavior of another executive."""

from __future__ import annotations

from flexbt_core import Autonomy, EventState, OperatableStateMachine, UserData
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorInput, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteState, LogKeyState, OperatorDecisionState, WaitState

TREE = 'flexbt_demo_behaviors/inspection/inspection.xml'


class Inspection(Behavior):
    """The outer behavior: it runs the tree ``inspection.xml`` for a site, and reports the result to the operator."""

    manifest = BehaviorManifest(
        name='Inspection',
        description='Have a site inspected: a behavior runs a tree, which runs a behavior of another executive.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter('site', 'gate', 'what to inspect'),
            BehaviorParameter('duration', 2.0, 'how long the inspection takes', unit='s', minimum=0.0),
        ],
    )

    site: str
    duration: float

    def create(self) -> OperatableStateMachine:
        """Inspect and report."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'], output_keys=['report'], autonomy=Autonomy.Off)
        machine.userdata.site = self.site
        machine.userdata.duration = self.duration
        with machine:
            OperatableStateMachine.add(
                'Inspect',
                BtExecuteState(
                    bt_file=TREE, inputs={'site': 'string', 'duration': 'double'}, outputs={'report': 'string'}
                ),
                transitions={'done': 'Tell', 'canceled': 'failed', 'failed': 'failed'},
                autonomy={'failed': Autonomy.Low},
            )
            OperatableStateMachine.add(
                'Tell',
                LogKeyState('the inspector reports: {}'),
                transitions={'done': 'finished'},
                remapping={'data': 'report'},
            )
        return machine


class InspectSite(Behavior):
    """The inner behavior: it takes some time, and the inspector judges the result, below autonomy Full."""

    manifest = BehaviorManifest(
        name='Inspect Site',
        description='Inspect one site and report.',
        author='The FlexBT developers',
        parameters=[BehaviorParameter('duration', 2.0, 'how long the inspection takes', unit='s', minimum=0.0)],
        inputs=[BehaviorInput('site', 'string', 'what to inspect', needed=True)],
    )

    duration: float

    def create(self) -> OperatableStateMachine:
        """Look, judge and report."""
        machine = OperatableStateMachine(
            outcomes=['finished', 'failed'], input_keys=['site'], output_keys=['report'], autonomy=Autonomy.Off
        )
        with machine:
            OperatableStateMachine.add('Look', WaitState(self.duration), transitions={'done': 'Judge'})
            OperatableStateMachine.add(
                'Judge',
                OperatorDecisionState(outcomes=['good', 'bad'], hint='Is all well there?', suggestion='good'),
                transitions={'good': 'Report', 'bad': 'failed'},
                autonomy={'good': Autonomy.High, 'bad': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'Report',
                ReportState(),
                transitions={'done': 'finished'},
            )
        return machine


class ReportState(EventState):
    """
    Report that all is well.

    ># site         string      Where
    #> report       string      The report

    <= done                     The report was written.
    """

    is_instant = True

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], input_keys=['site'], output_keys=['report'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata.report = f'all is well at the {userdata.site}'
        return 'done'
