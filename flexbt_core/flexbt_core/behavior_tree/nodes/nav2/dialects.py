# SPDX-License-Identifier: BSD-3-Clause
"""The branches of Nav2 whose nodes differ, and how a file shows of which it is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, Literal, get_args

from flexbt_core.behavior_tree.engine import NodeRegistry, TreeNode

Dialect = Literal['jazzy', 'main']
"""Branches of Nav2 whose nodes differ. Nodes and ports that only one has are there in both dialects."""

DIALECTS: Final[tuple[Dialect, ...]] = get_args(Dialect)

_OF_MAIN: Final = frozenset(
    (
        'AppendGoalPoseToGoals',
        'CancelFollowObject',
        'CheckPoseOccupancy',
        'CheckStopStatus',
        'ExtractRouteNodesAsGoals',
        'FollowObject',
        'GetNextFewGoals',
        'IsGoalNearby',
        'IsWithinPathTrackingBounds',
        'NonblockingSequence',
        'PathHandlerSelector',
        'PauseResumeController',
        'PersistentSequence',
        'RemoveInCollisionGoals',
        'ToggleCollisionMonitor',
        'ValidatePath',
        'WouldARouteRecoveryHelp',
    )
)

ONLY_NODES: Final[Mapping[str, Dialect]] = {'IsPathValid': 'jazzy', **dict.fromkeys(_OF_MAIN, 'main')}
"""Node types that one branch has."""

ONLY_PORTS: Final[Mapping[str, Mapping[str, Dialect]]] = {
    'BackUp': {'disable_collision_checks': 'main'},
    'ClearCostmapAroundPose': {'plugins': 'main'},
    'ClearCostmapAroundRobot': {'plugins': 'main'},
    'ClearCostmapExceptRegion': {'plugins': 'main'},
    'ClearEntireCostmap': {'plugins': 'main'},
    'ComputePathThroughPoses': {'last_reached_index': 'main'},
    'ComputePathToPose': {'viapoints': 'main'},
    'DriveOnHeading': {'disable_collision_checks': 'main'},
    'FollowPath': {'path_handler_id': 'main', 'tracking_feedback': 'main'},
    'GoalReached': {'global_frame': 'jazzy'},
    'GoalUpdater': {'input_goals': 'main', 'output_goals': 'main'},
    'RemovePassedGoals': {
        'global_frame': 'jazzy',
        'input_waypoint_statuses': 'main',
        'output_waypoint_statuses': 'main',
    },
    'RoundRobin': {'wrap_around': 'main'},
    'Spin': {'disable_collision_checks': 'main'},
    'TruncatePathLocal': {'robot_frame': 'jazzy', 'robot_base_frame': 'main'},
    'Wait': {'error_code_id': 'main'},
}
"""Ports that one branch has, of nodes that both have. But for ``error_msg``, which is here a port of every action."""

JAZZY_TREE: Final = 'MainTree'
"""What Nav2's own trees in jazzy are called."""

MAIN_TREES: Final = frozenset(
    (
        'FollowPoint',
        'NavToPoseWithConsistentReplanningAndIfPathBecomesInvalid',
        'NavigateOnRouteGraphWRecovery',
        'NavigateThroughPosesWReplanningAndRecovery',
        'NavigateToPoseWBoundsCheck',
        'NavigateToPoseWReplanningAndRecovery',
        'NavigateToPoseWReplanningGoalPatienceAndRecovery',
        'NavigateWRecoveryAndReplanningOnlyIfPathBecomesInvalid',
        'NavigateWReplanningOnlyIfGoalIsUpdated',
        'NavigateWReplanningOnlyIfPathBecomesInvalid',
        'NavigateWRoutingGlobalPlanningAndControlWRecovery',
        'NavigateWithReplanningDistance',
        'NavigateWithReplanningSpeed',
        'NavigateWithReplanningTime',
        'OdometryCalibration',
    )
)
"""What they are called in main."""


def dialect_of(elements: Iterable[tuple[str, Mapping[str, str]]]) -> Dialect | None:
    """The branch of Nav2 for which a file was written, by the names and attributes of its elements; None if unknown.

    Nodes and ports that only one branch has tell it. Where there are none, the names of trees do: all of Nav2's own in
    jazzy are the main tree ``MainTree``, those of main have names of their own.
    """
    told: set[Dialect] = set()
    named: Dialect | None = None
    for id, attributes in elements:
        if id == 'root' and attributes.get('main_tree_to_execute') == JAZZY_TREE:
            named = 'jazzy'
        elif id == 'BehaviorTree' and attributes.get('ID') in MAIN_TREES:
            named = 'main'
        elif id in ONLY_NODES:
            told.add(ONLY_NODES[id])
        else:
            told.update(branch for port, branch in ONLY_PORTS.get(id, {}).items() if port in attributes)
    if not told:
        return named
    return told.pop() if len(told) == 1 else None


def register_dialects(registry: NodeRegistry, node_classes: Iterable[type[TreeNode]], dialect: Dialect) -> None:
    """Makes node classes known as they are in ``dialect``, and for files of another branch as they are there.

    A class that is one in a single branch names it, as ``dialect``.
    """
    registry.variant_of = dialect_of
    for node_class in node_classes:
        branch = vars(node_class).get('dialect', dialect)
        registry.register_class(node_class, variant='' if branch == dialect else branch)
