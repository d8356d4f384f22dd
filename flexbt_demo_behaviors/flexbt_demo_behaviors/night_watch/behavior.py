# SPDX-License-Identifier: BSD-3-Clause
"""The behavior of a robot on night watch."""

from __future__ import annotations

from flexbt_core import Autonomy, ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import (
    BtExecuteGoalState,
    BtExecuteState,
    BtLoaderState,
    OperatorDecisionState,
    PublishOnceState,
    SubscribeOnceState,
    WaitState,
)

from .states import (
    CompareScanState,
    ForgetRoundState,
    NextRoomState,
    NoteRoomState,
    OpenDoorState,
    PlaceState,
    TakeOverState,
    WatchPartnerState,
)

TREES = 'flexbt_demo_behaviors/night_watch'
DRIVE, CHARGE, BATTERY_LOW = (f'{TREES}/{name}.xml' for name in ('drive', 'charge', 'battery_low'))


class NightWatch(Behavior):
    """Look at rooms, one after the other, and meanwhile see to the battery and to the other robot.

    Three children of a concurrency container: the round; the battery, whose charging has priority over the round; and
    the partner, whose rooms are taken over when it is lost. Other rooms are given at run time by a switch to the same
    behavior with other ``rooms``.
    """

    manifest = BehaviorManifest(
        name='Night Watch',
        description='Look at rooms at night; charge when need be; take over the rooms of a partner that is lost.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter('rooms', 'office store', 'rooms of this robot, in order, apart by spaces'),
            BehaviorParameter('home', 'alpha_dock', 'place of its charging station'),
            BehaviorParameter('partner', '', 'namespace of the other robot, as in beta; empty for none'),
            BehaviorParameter('places', 'flexbt_demo_behaviors/night_watch/places.yaml', 'file of the places'),
        ],
    )

    rooms: str
    home: str
    partner: str
    places: str

    def create(self) -> OperatableStateMachine:
        """Load the trees, get the map, and start the watch."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'], autonomy=Autonomy.Off)
        machine.userdata.inherited = []
        with machine:
            OperatableStateMachine.add(
                'LoadTrees',
                BtLoaderState(filepaths=[DRIVE, CHARGE, BATTERY_LOW]),
                transitions={'done': 'FindHome', 'failed': 'failed'},
            )
            OperatableStateMachine.add(
                'FindHome',
                PlaceState(self.home, self.places),
                transitions={'done': 'GetMap'},
                remapping={'pose': 'home'},
            )
            OperatableStateMachine.add(
                'GetMap',
                SubscribeOnceState('map', 'nav_msgs/OccupancyGrid', timeout=10.0, latched=True),
                transitions={'received': 'Watch', 'timeout': 'failed'},
                remapping={'message': 'map'},
            )
            OperatableStateMachine.add(
                'Watch',
                self._watch(),
                transitions={'finished': 'finished', 'failed': 'failed'},
            )
        return machine

    def _watch(self) -> OperatableStateMachine:
        """Return the parallel parts of the watch. The end of the round ends them."""
        watch = ConcurrencyContainer(
            outcomes=['finished', 'failed'],
            input_keys=['map', 'home'],
            io_keys=['inherited'],
            conditions=[
                ('finished', [('Round', 'finished')]),
                ('failed', [('Round', 'failed')]),
                ('failed', [('Battery', 'failed')]),
            ],
        )
        with watch:
            OperatableStateMachine.add('Round', self._round(), {'finished': 'finished', 'failed': 'failed'})
            OperatableStateMachine.add('Battery', self._battery(), {'failed': 'failed'})
            OperatableStateMachine.add('Partner', self._partner())
        return watch

    def _round(self) -> OperatableStateMachine:
        """Drive from room to room, and home when the operator decides so."""
        tour = OperatableStateMachine(
            outcomes=['finished', 'failed'], input_keys=['map', 'home', 'inherited'], autonomy=Autonomy.Off
        )
        tour.userdata.checked = []
        tour.userdata.postponed = []
        with tour:
            OperatableStateMachine.add(
                'NextRoom',
                NextRoomState(rooms=self.rooms, places=self.places),
                transitions={'room': 'Drive', 'door': 'DriveToDoor', 'done': 'JudgeRound'},
            )
            OperatableStateMachine.add(
                'DriveToDoor',
                BtExecuteGoalState(bt_file=DRIVE, blackboard='round'),
                transitions={'done': 'OpenDoor', 'canceled': 'Postpone', 'failed': 'Postpone'},
                autonomy={'failed': Autonomy.Full},
                remapping={'goal': 'entrance'},
            )
            # Here and below, a failure always goes to a person: an immediate retry would fail again.
            OperatableStateMachine.add(
                'OpenDoor',
                OpenDoorState(),
                transitions={'open': 'Drive', 'jammed': 'JudgeDoor'},
            )
            OperatableStateMachine.add(
                'JudgeDoor',
                OperatorDecisionState(
                    outcomes=['again', 'later'],
                    hint='The door is jammed. again: try it once more, later: the other rooms first',
                ),
                transitions={'again': 'OpenDoor', 'later': 'Postpone'},
                autonomy={'again': Autonomy.Full, 'later': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'Postpone',
                NoteRoomState(),
                transitions={'done': 'NextRoom'},
                remapping={'rooms': 'postponed'},
            )
            OperatableStateMachine.add(
                'Drive',
                BtExecuteGoalState(bt_file=DRIVE, blackboard='round'),
                transitions={'done': 'ComeToRest', 'canceled': 'Postpone', 'failed': 'Postpone'},
                autonomy={'failed': Autonomy.Full},
            )
            # Pose and scan must be of the same moment; at rest they always are. The pose comes last: while the round
            # was paused the robot may have been driven to its dock, and then it is still there.
            OperatableStateMachine.add(
                'ComeToRest',
                WaitState(1.0),
                transitions={'done': 'GetScan'},
            )
            OperatableStateMachine.add(
                'GetScan',
                SubscribeOnceState('scan', 'sensor_msgs/LaserScan', best_effort=True),
                transitions={'received': 'GetPose', 'timeout': 'failed'},
                remapping={'message': 'scan'},
            )
            OperatableStateMachine.add(
                'GetPose',
                SubscribeOnceState('pose', 'geometry_msgs/PoseStamped'),
                transitions={'received': 'CompareScan', 'timeout': 'failed'},
                remapping={'message': 'pose'},
            )
            OperatableStateMachine.add(
                'CompareScan',
                CompareScanState(),
                transitions={
                    'found': 'JudgeFinding',
                    'clear': 'NoteRoom',
                    'elsewhere': 'Drive',
                    'beside': 'JudgePlace',
                },
            )
            OperatableStateMachine.add(
                'JudgePlace',
                OperatorDecisionState(
                    outcomes=['again', 'later', 'alarm'],
                    hint='The robot does not get to where it shall look; something may stand there. '
                    'again: drive there once more, later: the other rooms first, alarm: raise the alarm',
                    suggestion='alarm',
                ),
                transitions={'again': 'Drive', 'later': 'Postpone', 'alarm': 'RaiseAlarm'},
                autonomy={'again': Autonomy.Full, 'later': Autonomy.Full, 'alarm': Autonomy.High},
            )
            # A finding goes to a person, at any autonomy below Full.
            OperatableStateMachine.add(
                'JudgeFinding',
                OperatorDecisionState(
                    outcomes=['harmless', 'alarm'],
                    hint='Something is there that is not on the map. harmless: continue, alarm: raise the alarm',
                    suggestion='alarm',
                ),
                transitions={'harmless': 'NoteRoom', 'alarm': 'RaiseAlarm'},
                autonomy={'harmless': Autonomy.Full, 'alarm': Autonomy.High},
            )
            OperatableStateMachine.add(
                'RaiseAlarm',
                PublishOnceState('alarm', 'geometry_msgs/PoseStamped'),
                transitions={'done': 'NoteRoom'},
                remapping={'message': 'finding'},
            )
            OperatableStateMachine.add(
                'NoteRoom',
                NoteRoomState(),
                transitions={'done': 'NextRoom'},
                remapping={'rooms': 'checked'},
            )
            OperatableStateMachine.add(
                'JudgeRound',
                OperatorDecisionState(
                    outcomes=['another_round', 'home'],
                    hint='All rooms have been looked at. another_round: from the beginning, home: the watch is over',
                    suggestion='another_round',
                ),
                transitions={'another_round': 'ForgetRound', 'home': 'DriveHome'},
                autonomy={'another_round': Autonomy.High, 'home': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'ForgetRound',
                ForgetRoundState(),
                transitions={'done': 'NextRoom'},
            )
            OperatableStateMachine.add(
                'DriveHome',
                BtExecuteGoalState(bt_file=DRIVE, blackboard='round'),
                transitions={'done': 'finished', 'canceled': 'failed', 'failed': 'failed'},
                autonomy={'failed': Autonomy.Full},
                remapping={'goal': 'home'},
            )
        return tour

    def _battery(self) -> OperatableStateMachine:
        """See to the battery; the round is paused while it charges."""
        charge = PriorityContainer(outcomes=['done', 'failed'], input_keys=['home'], autonomy=Autonomy.Off)
        with charge:
            OperatableStateMachine.add(
                'DriveAndCharge',
                BtExecuteGoalState(bt_file=CHARGE, blackboard='battery'),
                transitions={'done': 'done', 'canceled': 'failed', 'failed': 'failed'},
                autonomy={'failed': Autonomy.Full},
                remapping={'goal': 'home'},
            )
        battery = OperatableStateMachine(outcomes=['failed'], input_keys=['home'], autonomy=Autonomy.Off)
        with battery:
            OperatableStateMachine.add(
                'WaitUntilLow',
                BtExecuteState(bt_file=BATTERY_LOW, blackboard='battery'),
                transitions={'done': 'Charge', 'canceled': 'failed', 'failed': 'failed'},
                autonomy={'failed': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'Charge',
                charge,
                transitions={'done': 'WaitUntilLow', 'failed': 'failed'},
            )
        return battery

    def _partner(self) -> OperatableStateMachine:
        """Wait until the other robot is lost; then the operator decides who takes over its rooms."""
        partner = OperatableStateMachine(outcomes=['done'], output_keys=['inherited'], autonomy=Autonomy.Off)
        with partner:
            OperatableStateMachine.add(
                'WatchPartner',
                WatchPartnerState(partner=self.partner, places=self.places),
                transitions={'lost': 'JudgeLoss'},
            )
            OperatableStateMachine.add(
                'JudgeLoss',
                OperatorDecisionState(
                    outcomes=['take_over', 'leave'],
                    hint='The other robot is lost. take_over: look at its rooms too, leave: do not',
                    suggestion='take_over',
                ),
                transitions={'take_over': 'TakeOver', 'leave': 'done'},
                autonomy={'take_over': Autonomy.High, 'leave': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'TakeOver',
                TakeOverState(),
                transitions={'done': 'done'},
            )
        return partner
