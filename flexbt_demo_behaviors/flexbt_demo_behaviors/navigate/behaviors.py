# SPDX-License-Identifier: BSD-3-Clause
"""The behaviors of demonstrations 1 and 2: drive to the operator's goals by one tree, or by three trees."""

from __future__ import annotations

import itertools
import math

from nav_msgs.msg import Path

from flexbt_core import Autonomy, EventState, OperatableStateMachine, UserData
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import (
    BtExecuteGoalState,
    BtExecuteState,
    BtGetDataState,
    BtLoaderState,
    OperatorDecisionState,
    OperatorInputState,
    PublishOnceState,
)


class Navigate(Behavior):
    """Ask for a goal, let one behavior tree do all of the navigation, and ask for the next goal."""

    manifest = BehaviorManifest(
        name='Navigate',
        description='Drive to goals that the operator gives; planning, driving and recovery are one behavior tree.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter(
                'tree',
                'flexbt_demo_behaviors/navigate/navigate.xml',
                'behavior tree that drives to its goal pose, as package/path',
            ),
        ],
    )

    tree: str

    def create(self) -> OperatableStateMachine:
        """Load the tree, then repeat: ask for a goal, drive there."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'], autonomy=Autonomy.Off)
        with machine:
            OperatableStateMachine.add(
                'LoadTree',
                BtLoaderState(filepaths=[self.tree]),
                transitions={'done': 'AskGoal', 'failed': 'failed'},
            )
            OperatableStateMachine.add(
                'AskGoal',
                OperatorInputState('Where shall the robot go?', 'geometry_msgs/PoseStamped'),
                transitions={'received': 'Drive', 'declined': 'finished', 'failed': 'failed'},
                remapping={'data': 'goal'},
            )
            # At autonomy Low the operator also confirms each arrival. A failure always goes to a person.
            OperatableStateMachine.add(
                'Drive',
                BtExecuteGoalState(bt_file=self.tree),
                transitions={'done': 'AskGoal', 'canceled': 'AskGoal', 'failed': 'AskGoal'},
                autonomy={'done': Autonomy.Low, 'failed': Autonomy.Full},
                remapping={'goal': 'goal'},
            )
        return machine


# The second demonstration: planner, controller and recovery are three trees, and a person judges the plan.

TREES = 'flexbt_demo_behaviors/navigate'


class NavigateSplit(Behavior):
    """Ask for a goal, plan, show the plan to the operator, drive along it when it is accepted, recover when
    asked to.

    The trees share a blackboard: the planner's tree writes `path` there and the controller's tree reads it.
    """

    manifest = BehaviorManifest(
        name='Navigate Split',
        description='Navigate with three behavior trees under one state machine; the operator judges each plan.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter('planner', f'{TREES}/global_planner.xml', 'tree that computes the key path'),
            BehaviorParameter('controller', f'{TREES}/controller.xml', 'tree that follows the key path'),
            BehaviorParameter('recovery', f'{TREES}/recovery.xml', 'tree that frees the robot'),
        ],
    )

    planner: str
    controller: str
    recovery: str

    def create(self) -> OperatableStateMachine:
        """Load the trees, then repeat: ask, plan, show, follow, and recover on the way if needed."""
        machine = OperatableStateMachine(outcomes=['finished', 'failed'], autonomy=Autonomy.Off)
        with machine:
            OperatableStateMachine.add(
                'LoadTrees',
                BtLoaderState(filepaths=[self.planner, self.controller, self.recovery]),
                transitions={'done': 'AskGoal', 'failed': 'failed'},
            )
            OperatableStateMachine.add(
                'AskGoal',
                OperatorInputState('Where shall the robot go?', 'geometry_msgs/PoseStamped'),
                transitions={'received': 'PlanPath', 'declined': 'finished', 'failed': 'failed'},
                remapping={'data': 'goal'},
            )
            OperatableStateMachine.add(
                'PlanPath',
                BtExecuteGoalState(bt_file=self.planner),
                transitions={'done': 'GetPath', 'canceled': 'AskGoal', 'failed': 'Recover'},
                autonomy={'failed': Autonomy.Low},
                remapping={'goal': 'goal'},
            )
            OperatableStateMachine.add(
                'GetPath',
                BtGetDataState(request_id='path', request_msg_type='nav_msgs/Path'),
                transitions={'done': 'ShowPath', 'failed': 'Recover'},
                autonomy={'failed': Autonomy.Low},
                remapping={'data': 'path'},
            )
            OperatableStateMachine.add(
                'ShowPath',
                ShowPathState(),
                transitions={'done': 'PublishPath', 'empty': 'Recover'},
                autonomy={'empty': Autonomy.Low},
                remapping={'path': 'path'},
            )
            OperatableStateMachine.add(
                'PublishPath',
                PublishOnceState('proposed_path', 'nav_msgs/Path'),
                transitions={'done': 'JudgePath'},
                remapping={'message': 'path'},
            )
            # The robot accepts its own plan only at autonomy Full; below that, a person decides.
            OperatableStateMachine.add(
                'JudgePath',
                OperatorDecisionState(
                    outcomes=['done', 'canceled', 'failed'],
                    hint='Is the path good? done: drive, canceled: another goal, failed: recover first',
                    suggestion='done',
                    shows=['path', 'goal'],
                ),
                transitions={'done': 'FollowPath', 'canceled': 'AskGoal', 'failed': 'Recover'},
                autonomy={'done': Autonomy.High, 'canceled': Autonomy.Full, 'failed': Autonomy.Full},
            )
            OperatableStateMachine.add(
                'FollowPath',
                BtExecuteState(bt_file=self.controller),
                transitions={'done': 'AskGoal', 'canceled': 'AskGoal', 'failed': 'Recover'},
                autonomy={'done': Autonomy.Low, 'failed': Autonomy.Low},
            )
            OperatableStateMachine.add(
                'Recover',
                BtExecuteState(bt_file=self.recovery),
                transitions={'done': 'AskGoal', 'canceled': 'AskGoal', 'failed': 'failed'},
                autonomy={'done': Autonomy.Low, 'failed': Autonomy.High},
            )
        return machine


# A state of the demonstrations: it reports the properties of a path to the operator.


class ShowPathState(EventState):
    """Log length and end of a path for the operator.

    -- no parameters

    ># path      nav_msgs/Path   the path to describe

    <= done      it was described
    <= empty     it has no poses
    """

    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'empty'], input_keys=['path'])

    def execute(self, userdata: UserData) -> str:
        return self.describe(userdata.path)

    def describe(self, path: Path) -> str:
        """Report the properties of the path to the operator, and return the outcome."""
        if not path.poses:
            self.log_warn('The path has no poses.')
            return 'empty'
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
        length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
        x, y = points[-1]
        self.log_info(f'Path of {length:.1f} m in {len(points)} poses, which ends at ({x:.2f}, {y:.2f}).')
        return 'done'
