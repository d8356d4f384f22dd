# SPDX-License-Identifier: BSD-3-Clause
"""The node types of Nav2 beside those of its branches: IDs, kinds, ports, their directions, types and defaults."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest

from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction, SyncAction
from flexbt_core.behavior_tree.model.errors import Source
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.behavior_tree.xml.node_elements import elements_of
from flexbt_core.behavior_tree.xml.parser import parse
from flexbt_server.leaves import ActionLeaf, ServiceLeaf, ServiceSyncAction
from flexbt_server.node_types import node_registry
from flexbt_testing.nodes.server_world import install_nodes

# Facts of ros-navigation/navigation2 (nav2_tree_nodes.xml and the ports that the classes declare), jazzy at 1.3.13 and
# main at 1.5.0. A node: the branches that have it, its kind, its ID, and its ports; of a port the direction (-> output,
# <-> both), name, type, and =default; "main:" before a port that only that branch has. A list of goals is
# PoseStamped[] in jazzy and nav_msgs/Goals in main. +action, +service, +cancel: the ports of the bases.
NODES: Final = """
main Action AppendGoalPoseToGoals: goal_pose PoseStamped, input_goals Goals, ->output_goals Goals
both Condition AreErrorCodesPresent: error_code uint16, error_codes_to_check int[]
both Condition ArePosesNear: ref_pose PoseStamped, target_pose PoseStamped, global_frame string, tolerance double=0.5
both Action AssistedTeleop: +action, time_allowance double=10.0, is_recovery bool=false
both Action BackUp: +action, backup_dist double=0.15, backup_speed double=0.025, time_allowance double=10.0,
    main:disable_collision_checks bool=false
both Action CancelAssistedTeleop: +cancel
both Action CancelBackUp: +cancel
both Action CancelComputeAndTrackRoute: +cancel
both Action CancelControl: +cancel
both Action CancelDriveOnHeading: +cancel
main Action CancelFollowObject: +cancel
both Action CancelSpin: +cancel
both Action CancelWait: +cancel
main Action CheckPoseOccupancy: +service, pose PoseStamped, cost_threshold double=254.0, use_footprint bool=true,
    consider_unknown_as_obstacle bool=false
main Action CheckStopStatus: velocity_threshold double=0.01, duration_stopped ms=1000
both Action ClearCostmapAroundPose: +service, pose PoseStamped, reset_distance double=1.0, main:plugins string[]
both Action ClearCostmapAroundRobot: +service, reset_distance double=1.0, main:plugins string[]
both Action ClearCostmapExceptRegion: +service, reset_distance double=1.0, main:plugins string[]
both Action ClearEntireCostmap: +service, main:plugins string[]
both Action ComputeAndTrackRoute: +action, start_id unsigned, goal_id unsigned, start PoseStamped, goal PoseStamped,
    use_start bool=false, use_poses bool=false, ->execution_duration Duration, ->last_node_id uint16, ->next_node_id
    uint16, ->current_edge_id uint16, ->route Route, ->path Path, ->rerouted bool
both Action ComputePathThroughPoses: +action, goals Goals, start PoseStamped, planner_id string=, ->path Path,
    main:->last_reached_index int
both Action ComputePathToPose: +action, goal PoseStamped, start PoseStamped, use_start bool, planner_id string=,
    ->path Path, main:viapoints PoseStamped[]
both Action ComputeRoute: +action, start_id unsigned, goal_id unsigned, start PoseStamped, goal PoseStamped, use_start
    bool=false, use_poses bool=false, ->route Route, ->planning_time Duration, ->path Path
both Action ConcatenatePaths: input_path1 Path, input_path2 Path, ->output_path Path
both Action ControllerSelector: default_controller string, topic_name string=controller_selector,
    ->selected_controller string
both Decorator DistanceController: distance double=1.0, global_frame string, robot_base_frame string
both Condition DistanceTraveled: distance double=1.0, global_frame string, robot_base_frame string
both Action DockRobot: +action, use_dock_id bool=true, dock_id string, dock_pose PoseStamped, dock_type string,
    max_staging_time float=1000.0, navigate_to_staging_pose bool=true, ->success bool, ->num_retries uint16
both Action DriveOnHeading: +action, dist_to_travel double=0.15, speed double=0.025, time_allowance double=10.0,
    main:disable_collision_checks bool=false
main Action ExtractRouteNodesAsGoals: route Route, ->goals Goals
main Action FollowObject: +action, pose_topic string=dynamic_pose, tracked_frame string, max_duration float=0.0,
    ->total_elapsed_time Duration
both Action FollowPath: +action, path Path, controller_id string, goal_checker_id string, progress_checker_id string,
    main:path_handler_id string, main:->tracking_feedback TrackingFeedback
both Action GetCurrentPose: global_frame string, robot_base_frame string, ->current_pose PoseStamped
main Action GetNextFewGoals: input_goals Goals, num_goals int, ->output_goals Goals
both Action GetPoseFromPath: path Path, ->pose PoseStamped, index int=0
both Condition GlobalUpdatedGoal: goals Goals, goal PoseStamped
both Action GoalCheckerSelector: default_goal_checker string, topic_name string=goal_checker_selector,
    ->selected_goal_checker string
both Condition GoalReached: goal PoseStamped, jazzy:global_frame string, robot_base_frame string
both Condition GoalUpdated: goals Goals, goal PoseStamped
both Decorator GoalUpdatedController: goals Goals, goal PoseStamped
both Decorator GoalUpdater: input_goal PoseStamped, ->output_goal PoseStamped, main:input_goals Goals,
    main:->output_goals Goals
both Condition InitialPoseReceived: initial_pose_received bool
both Condition IsBatteryCharging: battery_topic string=/battery_status
both Condition IsBatteryLow: min_battery double, battery_topic string=/battery_status, is_voltage bool=false
main Condition IsGoalNearby: path Path, proximity_threshold double=1.0, max_robot_pose_search_dist double=-1.0,
    global_frame string, robot_base_frame string
jazzy Condition IsPathValid: path Path, server_timeout ms
both Condition IsStuck:
main Condition IsWithinPathTrackingBounds: max_error_left double=0.5, max_error_right double=0.5, max_error_heading
    double=3.14, tracking_feedback TrackingFeedback
both Action NavigateThroughPoses: +action, goals Goals, behavior_tree string
both Action NavigateToPose: +action, goal PoseStamped, behavior_tree string
main Control NonblockingSequence:
both Condition PathExpiringTimer: seconds double=1.0, path Path
main Action PathHandlerSelector: default_path_handler string, topic_name string=path_handler_selector,
    ->selected_path_handler string
both Decorator PathLongerOnApproach: path Path, prox_len double=3.0, length_factor double=2.0
main Control PauseResumeController: pause_service_name string, resume_service_name string
main Control PersistentSequence: <->current_child_idx int
both Control PipelineSequence:
both Action PlannerSelector: default_planner string, topic_name string=planner_selector, ->selected_planner string
both Action ProgressCheckerSelector: default_progress_checker string, topic_name string=progress_checker_selector,
    ->selected_progress_checker string
both Decorator RateController: hz double=10.0
both Control RecoveryNode: number_of_retries int=1
both Action ReinitializeGlobalLocalization: +service
main Action RemoveInCollisionGoals: +service, input_goals Goals, cost_threshold double=254.0, use_footprint bool=true,
    consider_unknown_as_obstacle bool=false, ->output_goals Goals, input_waypoint_statuses WaypointStatus[],
    ->output_waypoint_statuses WaypointStatus[]
both Action RemovePassedGoals: input_goals Goals, ->output_goals Goals, radius double=0.5, jazzy:global_frame string,
    robot_base_frame string, main:input_waypoint_statuses WaypointStatus[], main:->output_waypoint_statuses
    WaypointStatus[]
both Control RoundRobin: main:wrap_around bool=false
both Decorator SingleTrigger:
both Action SmoothPath: +action, unsmoothed_path Path, max_smoothing_duration double=3.0, check_for_collisions
    bool=false, smoother_id string, ->smoothed_path Path, ->smoothing_duration double, ->was_completed bool
both Action SmootherSelector: default_smoother string, topic_name string=smoother_selector, ->selected_smoother string
both Decorator SpeedController: min_rate double=0.1, max_rate double=1.0, min_speed double=0.0, max_speed double=0.5,
    goals Goals, goal PoseStamped
both Action Spin: +action, spin_dist double=1.57, time_allowance double=10.0, is_recovery bool=true,
    main:disable_collision_checks bool=false
both Condition TimeExpired: seconds double=1.0
main Action ToggleCollisionMonitor: +service, enable bool=true
both Condition TransformAvailable: child string=, parent string=
both Action TruncatePath: input_path Path, ->output_path Path, distance double=1.0
both Action TruncatePathLocal: input_path Path, ->output_path Path, distance_forward double=8.0, distance_backward
    double=4.0, jazzy:robot_frame string=base_link, transform_tolerance double=0.2, pose PoseStamped,
    angular_distance_weight double=0.0, max_robot_pose_search_dist double=inf, main:robot_base_frame string
both Action UndockRobot: +action, dock_type string, max_undocking_time float=30.0, ->success bool
main Action ValidatePath: +service, path Path, max_cost unsigned=254, consider_unknown_as_obstacle bool=false,
    layer_name string=, footprint string=, stop_at_first_collision bool=true, max_lookahead_distance double=-1.0,
    ->collision_poses PoseStamped[]
both Action Wait: +wait, wait_duration double=1.0
both Condition WouldAControllerRecoveryHelp: error_code uint16, error_codes_to_check int[]
both Condition WouldAPlannerRecoveryHelp: error_code uint16, error_codes_to_check int[]
main Condition WouldARouteRecoveryHelp: error_code uint16, error_codes_to_check int[]
both Condition WouldASmootherRecoveryHelp: error_code uint16, error_codes_to_check int[]
"""

BASES: Final = {
    '+action': 'server_name string, server_timeout ms, ->error_code_id uint16, main:->error_msg string',
    '+wait': 'server_name string, server_timeout ms, main:->error_code_id uint16, main:->error_msg string',
    '+service': 'service_name string, server_timeout ms',
    '+cancel': 'server_name string, server_timeout ms',
}
TYPES: Final = {
    'string': 'std::string',
    'double': 'double',
    'float': 'float',
    'bool': 'bool',
    'int': 'int',
    'uint16': 'uint16_t',
    'unsigned': 'unsigned int',
    'ms': 'unsigned int',
    'int[]': 'std::vector<int>',
    'string[]': 'std::vector<std::string>',
    'Goals': 'geometry_msgs/msg/PoseStamped[]',
    'PoseStamped[]': 'geometry_msgs/msg/PoseStamped[]',
    'PoseStamped': 'geometry_msgs/msg/PoseStamped',
    'Path': 'nav_msgs/msg/Path',
    'Duration': 'builtin_interfaces/msg/Duration',
    'Route': 'nav2_msgs/msg/Route',
    'TrackingFeedback': 'nav2_msgs/msg/TrackingFeedback',
    'WaypointStatus[]': 'nav2_msgs/msg/WaypointStatus[]',
}
"""Types of ports as they are called here."""

OURS: Final = {('IsPathValid', name) for name in ('service_name', 'max_cost', 'consider_unknown_as_obstacle')}
"""Ports that neither branch has; the last two are those of kilted."""

OUR_DEFAULTS: Final = {
    ('jazzy', 'RoundRobin', 'wrap_around'): 'true',  # where jazzy has no such port, and goes round
    ('jazzy', 'TruncatePathLocal', 'robot_frame'): None,  # where no frame is named, that of the server counts
    ('main', 'TruncatePathLocal', 'robot_frame'): None,
}


class Fact(NamedTuple):
    direction: str
    type: str
    default: str | None
    branches: tuple[str, ...]


class Node(NamedTuple):
    branches: tuple[str, ...]
    kind: str
    base: str
    ports: Mapping[str, Fact]


def facts() -> Iterator[tuple[str, Node]]:
    text = re.sub(r'\n +', ' ', NODES.strip())
    for line in text.splitlines():
        head, _, told = line.partition(':')
        where, kind, id = head.split()
        branches = NAV2_BRANCHES if where == 'both' else (where,)
        base = next((name for name in BASES if name in told), '')
        told = told.replace(base, BASES.get(base, ''))
        yield id, Node(branches, kind, base, dict(port_facts(told, branches)))


def port_facts(told: str, branches: tuple[str, ...]) -> Iterator[tuple[str, Fact]]:
    for word in filter(None, map(str.strip, told.split(','))):
        match = re.fullmatch(r'(?:(jazzy|main):)?(<->|->)?(\w+) ([\w\[\]]+)(?:=(.*))?', word)
        assert match is not None, word
        only, arrow, name, kind, default = match.groups()
        direction = {'->': 'output', '<->': 'inout', None: 'input'}[arrow]
        yield name, Fact(direction, kind, default, (only,) if only else branches)


FACTS: Final = dict(facts())


def fail(point: str, error: Exception) -> None:
    raise error


REGISTRIES: Final = {branch: node_registry(fail, branch) for branch in NAV2_BRANCHES}


def test_the_branches_have_so_many_node_types() -> None:
    assert [sum(branch in node.branches for node in FACTS.values()) for branch in NAV2_BRANCHES] == [65, 81]


def leaf_base(id: str, node: Node) -> type[Any]:
    """Return the base of a leaf that may be RUNNING where Nav2's may: BtActionNode, BtServiceNode after a moment, and
    what looks anew in each tick. BtCancelActionNode waits within its tick, and so does IsPathValid."""
    if node.kind == 'Condition':
        return Condition
    bases = {'+action': ActionLeaf, '+wait': ActionLeaf, '+service': ServiceLeaf, '+cancel': ServiceSyncAction}
    return StatefulAction if id == 'CheckStopStatus' else bases.get(node.base, SyncAction)


@pytest.mark.parametrize('branch', NAV2_BRANCHES)
def test_a_leaf_may_be_running_where_that_of_nav2_may(branch: Nav2Branch) -> None:
    for id, node in FACTS.items():
        if branch in node.branches and node.kind in ('Action', 'Condition'):
            manifest = REGISTRIES[branch].get(id)
            assert manifest is not None
            assert issubclass(manifest.node_class, leaf_base(id, node)), id


def test_what_only_one_branch_has_says_so() -> None:
    for registry in REGISTRIES.values():
        for id, node in FACTS.items():
            manifest = registry.get(id)
            assert manifest is not None
            only = node.branches[0] if len(node.branches) == 1 else ''
            assert manifest.nav2_branch == only, id
            assert (f' (Nav2 {only} only)' in manifest.documentation) == bool(only), id
            # The message of an error is a port of every action here.
            told = {name: port.nav2_branch for name, port in manifest.ports.items() if port.nav2_branch}
            assert told == {
                name: fact.branches[0]
                for name, fact in node.ports.items()
                if len(fact.branches) < len(node.branches) and name != 'error_msg'
            }, id


PLAIN = '<BehaviorTree ID="T"><RoundRobin>{}<AlwaysSuccess/></RoundRobin></BehaviorTree>'


@pytest.mark.parametrize(('attributes', 'trees', 'branch'), [
    ('', PLAIN.format(''), None),
    ('', PLAIN.format('<IsGoalNearby/>'), 'main'),
    ('', PLAIN.format('<Condition ID="IsGoalNearby"/>'), 'main'),
    ('', PLAIN.format('<IsPathValid/>'), 'jazzy'),
    ('', PLAIN.format('<IsPathValid/><ValidatePath/>'), None),
    ('', PLAIN.format('<Spin disable_collision_checks="true"/>'), 'main'),
    ('', PLAIN.format('<Spin error_msg="{why}"/>'), None),
    ('', PLAIN.format('<RemovePassedGoals global_frame="map"/>'), 'jazzy'),
    ('', PLAIN.format('<SubTree ID="IsGoalNearby"/>'), None),
    ('', '<TreeNodesModel><Condition ID="IsGoalNearby"/></TreeNodesModel>' + PLAIN.format(''), None),
    ('main_tree_to_execute="MainTree"', PLAIN.format('').replace('"T"', '"MainTree"'), 'jazzy'),
    ('main_tree_to_execute="MainTree"', PLAIN.format('<IsGoalNearby/>').replace('"T"', '"MainTree"'), 'main'),
    ('main_tree_to_execute="MainTree"', PLAIN.format('<Wait error_code_id="{e}"/>'), 'jazzy'),
    ('', PLAIN.format('').replace('"T"', '"FollowPoint"'), 'main'),
])  # fmt: skip
def test_a_file_shows_the_branch_of_which_it_is(attributes: str, trees: str, branch: str | None) -> None:
    root = parse(Source('f', f'<root BTCPP_format="4" {attributes}>{trees}</root>'))
    assert {registry.nav2_branch_of(elements_of(root)) for registry in REGISTRIES.values()} == {branch}


def test_a_port_that_somebodys_class_inherits_shows_no_branch() -> None:
    registry = node_registry(fail, 'jazzy')
    spin = registry.get('Spin')
    assert spin is not None
    registry.register('MySpin', type('MySpin', (spin.node_class,), {}))
    own = '<MySpin disable_collision_checks="true"/>'
    for nodes, branch in ((own, None), (own + '<IsPathValid/>', 'jazzy'), (own + '<IsGoalNearby/>', 'main')):
        root = parse(Source('f', f'<root BTCPP_format="4">{PLAIN.format(nodes)}</root>'))
        assert registry.nav2_branch_of(elements_of(root)) == branch


@pytest.mark.parametrize('branch', NAV2_BRANCHES)
@pytest.mark.parametrize('id', FACTS)
def test_a_node_type_is_that_of_nav2(id: str, branch: Nav2Branch) -> None:
    """Each branch has the nodes and the ports of both: what the other branch lacks is no error in a file."""
    manifest = REGISTRIES[branch].get(id)
    assert manifest is not None
    assert manifest.kind.value == FACTS[id].kind
    ours = {name: described(port) for name, port in manifest.ports.items() if (id, name) not in OURS}
    theirs = {
        name: (fact.direction, TYPES[fact.type], OUR_DEFAULTS.get((branch, id, name), fact.default))
        for name, fact in FACTS[id].ports.items()
    }
    pure = manifest.node_class.__module__.startswith('flexbt_core.')  # which has no types of ROS
    for name, (direction, kind, default) in theirs.items():
        if pure and '/' in kind:
            theirs[name] = direction, 'any', default
    assert ours == theirs


def described(port: Port) -> tuple[str, str, str | None]:
    kind = 'any' if port.type is None else port.type.name
    return port.direction.value, kind, None if port.default is NO_DEFAULT else port.default


def test_what_is_installed_while_the_process_runs_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    path = list(sys.path)
    assert 'Meanwhile' not in node_registry(fail)
    (tmp_path / 'installed_meanwhile.py').write_text(
        'from flexbt_testing.behavior_trees.faulty_leaves import Fails\n'
        'def register(registry): registry.register("Meanwhile", Fails)\n'
    )
    install_nodes(tmp_path, 'installed_meanwhile')
    monkeypatch.setattr(sys, 'path', path)  # where Python looks is what it was
    assert 'Meanwhile' in node_registry(fail)
