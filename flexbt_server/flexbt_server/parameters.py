# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the BT server, with their descriptions and checks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node

from flexbt_common import names
from flexbt_common.files import home_path
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.monitoring import declare_monitoring
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.behavior_tree.xml.parser import MAX_BYTES, MAX_DEPTH
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.values.parameter_fields import parameter
from flexbt_server.trees.tree_memory import MOST_LOADED

from .errors import ServerParameterError

NAVIGATORS: Final = (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS)
"""Actions that can be served."""

WAIT: Final = 'wait_at_waypoint'
INPUT: Final = 'input_at_waypoint'
TASKS: Final = (WAIT, INPUT)
"""Tasks that can be done at waypoints."""

DEFAULT_ERROR_CODE_NAMES: Final = (
    'compute_path_error_code',
    'follow_path_error_code',
    'spin_error_code',
    'backup_error_code',
    'backup_code_id',
    'drive_on_heading_error_code',
    'wait_error_code',
    'assisted_teleop_error_code',
    'compute_route_error_code',
    'smoother_error_code',
    'dock_robot_error_code',
    'undock_robot_error_code',
    'follow_object_error_code',
    'nav_to_pose_error_code',
    'nav_thru_poses_error_code',
)


DEFAULT_TREES: Final = {
    names.NAVIGATE_TO_POSE: 'default_nav_to_pose_bt_xml',
    names.NAVIGATE_THROUGH_POSES: 'default_nav_through_poses_bt_xml',
}
"""The parameter for the default tree of each navigator that runs trees."""


def _default_tree(navigator: str) -> Any:
    return parameter(
        DEFAULT_TREES[navigator],
        f'flexbt_server/behavior_trees/{navigator}.xml',
        f'tree of a {navigator} goal that names none: package/path.xml, an absolute path, or the ID of a loaded tree',
        is_fixed=True,
    )


@dataclass(frozen=True, kw_only=True)
class NavigatorParameters:
    """Parameters of the navigators, with Nav2's names where Nav2 has the same parameters."""

    search_directories: tuple[Path, ...]
    navigators: tuple[str, ...] = parameter(
        'navigators',
        (),
        f'actions of bt_navigator and waypoint_follower to serve: {", ".join(NAVIGATORS)}',
        choices=NAVIGATORS,
    )
    tree_to_pose: str = _default_tree(names.NAVIGATE_TO_POSE)
    tree_through_poses: str = _default_tree(names.NAVIGATE_THROUGH_POSES)
    global_frame: str = parameter(
        'global_frame', 'map', 'frame of robot and goals by default, and of the goals of navigators'
    )
    goal_key: str = parameter('goal_blackboard_id', 'goal', 'blackboard key of the goal of navigate_to_pose')
    goals_key: str = parameter('goals_blackboard_id', 'goals', 'blackboard key of the goals of navigate_through_poses')
    path_key: str = parameter('path_blackboard_id', 'path', 'blackboard key of the path that the robot follows')
    statuses_key: str = parameter(
        'waypoint_statuses_blackboard_id',
        'waypoint_statuses',
        'blackboard key of the statuses of the waypoints, for trees of the branch main',
    )
    stop_on_failure: bool = parameter(
        'stop_on_failure', True, 'whether follow_waypoints ends when a waypoint cannot be reached'
    )
    waypoint_task: str = parameter(
        'waypoint_task_executor_plugin',
        WAIT,
        f'what follow_waypoints does at each waypoint: {", ".join(TASKS)}; a behavior or a tree can do something else',
        choices=TASKS,
    )
    is_wait_enabled: bool = parameter(f'{WAIT}.enabled', True, 'whether to pause at each waypoint')
    wait_milliseconds: int = parameter(
        f'{WAIT}.waypoint_pause_duration', 0, 'pause at each waypoint, ms of the node clock', 0, 86_400_000
    )
    is_input_enabled: bool = parameter(f'{INPUT}.enabled', True, 'whether to wait for a message at each waypoint')
    input_topic: str = parameter(f'{INPUT}.input_topic', f'{INPUT}/input', 'topic of the message, std_msgs/Empty')
    input_timeout: float = parameter(
        f'{INPUT}.timeout', 10.0, 'maximum time to wait for the message, s of the node clock', 0.01, 86_400.0
    )

    @property
    def default_trees(self) -> dict[str, str]:
        """Default tree of each enabled navigator that runs trees."""
        trees = dict(zip(DEFAULT_TREES, (self.tree_to_pose, self.tree_through_poses), strict=True))
        return {name: tree for name, tree in trees.items() if name in self.navigators}

    @property
    def trusted(self) -> tuple[Path, ...]:
        """Files and directories that the parameters name by absolute paths: a client that may set parameters may use
        any of them."""
        trees = (Path(tree) for tree in self.default_trees.values() if tree.startswith('/'))
        return (*trees, *self.search_directories)

    @property
    def found_files(self) -> list[Path]:
        """Return the XML files in the search directories."""
        return [file for directory in self.search_directories for file in sorted(directory.glob('*.xml'))]


@dataclass(frozen=True, kw_only=True)
class ServerParameters:
    """Parameters of the server."""

    allowed_directories: tuple[Path, ...]
    btlog_directory: Path | None
    monitoring: Monitoring
    default_tree: str = parameter('default_tree', '', 'tree of a goal that names no tree: ID or package/path.xml')
    preload: tuple[str, ...] = parameter('preload', (), 'XML files to load at start-up, as package/path.xml')
    nav2_branch: Nav2Branch = parameter(  # noqa: RUF009 - it returns a field of the dataclass
        'nav2_branch',
        'jazzy',
        f'Nav2 branch of trees that do not show theirs: {", ".join(NAV2_BRANCHES)}',
        choices=NAV2_BRANCHES,
    )
    plugins: tuple[str, ...] = parameter(
        'plugins',
        (),
        'libraries of C++ nodes, or directories of them, each in its own process: an absolute path, package/path, or '
        'a name for the dynamic loader, such as my_nodes for libmy_nodes.so',
        is_fixed=True,
    )
    tick_rate: float = parameter('tick_rate', 10.0, 'minimum tick rate when no event wakes the tree, Hz', 0.1, 1000.0)
    feedback_rate: float = parameter(
        'feedback_rate', 5.0, 'feedback rate of a running tree, Hz of wall time', 0.1, 100.0
    )
    server_timeout: float = parameter(
        'server_timeout', 1.0, 'time to wait for a server and its acceptance, s of wall time', 0.01, 60.0
    )
    cancel_timeout: float = parameter(
        'cancel_timeout', 2.0, 'time that leaves have to halt, s of wall time', 0.01, 60.0
    )
    start_timeout: float = parameter(
        'start_timeout', 10.0, 'seconds after start-up during which leaves wait for their servers', 0.0, 600.0
    )
    peer_timeout: float = parameter('peer_timeout', PEER_TIMEOUT, PEER_TIMEOUT_TEXT, 0.6, 3600.0)
    pose_topic: str = parameter('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped")
    robot_base_frame: str = parameter('robot_base_frame', 'base_link', 'frame of the robot')
    goal_reached_tol: float = parameter(
        'goal_reached_tol', 0.25, 'distance from the goal at which GoalReached succeeds, m', 0.0, 100.0
    )
    error_code_names: tuple[str, ...] = parameter(
        'error_code_names',
        DEFAULT_ERROR_CODE_NAMES,
        'blackboard keys whose error codes go into the result; each run has its own',
    )
    max_file_size: int = parameter(
        'max_file_size', MAX_BYTES, 'largest XML file, bytes', 1000, 100_000_000, is_fixed=True
    )
    max_depth: int = parameter('max_depth', MAX_DEPTH, 'deepest nesting of XML elements', 1, 10_000, is_fixed=True)
    max_loaded_memory: int = parameter(
        'max_loaded_memory',
        MOST_LOADED,
        'memory for loaded trees, bytes; the least recently used are dropped',
        1_000_000,
        100_000_000_000,
        is_fixed=True,
    )
    groot2_port: int = parameter(
        'groot2_port',
        0,
        'port for Groot2 (its default: 1667); also uses the next one; 0: off',
        0,
        65534,
        is_fixed=True,
    )
    groot2_address: str = parameter(
        'groot2_address', '127.0.0.1', 'address to listen on for Groot2; * for all', is_fixed=True
    )
    groot2_tree: str = parameter('groot2_tree', '', 'ID of the tree that Groot2 is shown; if empty, the newest one')
    btlog_keep: int = parameter(
        'btlog_keep',
        100,
        'number of log files to keep; a run of ReachGoal writes several',
        1,
        1_000_000,
        is_fixed=True,
    )
    publish_statuses: bool = parameter(
        'publish_statuses',
        True,
        f'whether {names.TREE_STRUCTURE}, {names.TREE_STATUS} and {names.BEHAVIOR_TREE_XML} are published',
    )
    navigators: NavigatorParameters


def declare_parameters(node: Node) -> ServerParameters:
    """Declare the parameters on ``node`` and read them; :mod:`flexbt_common.runtime.parameters` describes when they can
    be set.

    Raises:
        ServerParameterError, UnfitParameterError: a value cannot work.
    """
    declare = ParameterDeclarer(node)
    written = declare.fixed.text(
        'btlog_directory', '', 'directory for a log file of each run, for Groot2; none if empty'
    )
    btlog_directory = home_path(written) if written else None
    if btlog_directory is not None and not btlog_directory.is_absolute():
        raise ServerParameterError(
            f"parameter 'btlog_directory': {btlog_directory} is not absolute; begin it with / or ~"
        )
    about = 'directories whose XML files are loaded at start-up; goals may name their trees by ID'
    directories = tuple(map(home_path, declare.fixed.texts('bt_search_directories', (), about)))
    for directory in directories:
        if not (directory.is_absolute() and directory.is_dir()):
            raise ServerParameterError(
                f"parameter 'bt_search_directories': {directory} is not the absolute path of a directory"
            )
    return declare.fields(
        ServerParameters(
            allowed_directories=declare.fixed.directories(
                'allowed_directories', (), 'directories that may hold XML files, in addition to the package shares'
            ),
            btlog_directory=btlog_directory,
            monitoring=declare_monitoring(declare),
            navigators=NavigatorParameters(search_directories=directories),
        )
    )
