# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the BT server: declared, described and checked in one place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rclpy.node import Node

from flexbt_common import names
from flexbt_common.files import home_path
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.monitoring import declare_monitoring
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.behavior_tree.xml.parser import MAX_BYTES, MAX_DEPTH
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_server.trees.tree_memory import MOST_LOADED

from .errors import ServerParameterError

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


@dataclass(frozen=True)
class ServerParameters:
    """Values of the server's parameters; see :func:`declare_parameters` for meaning and unit."""

    default_tree: str
    preload: tuple[str, ...]
    allowed_directories: tuple[Path, ...]
    nav2_branch: Nav2Branch
    tick_rate: float
    feedback_rate: float
    server_timeout: float
    cancel_timeout: float
    start_timeout: float
    peer_timeout: float
    pose_topic: str
    robot_base_frame: str
    goal_reached_tol: float
    error_code_names: tuple[str, ...]
    max_file_size: int
    max_depth: int
    max_loaded_memory: int
    groot2_port: int
    groot2_address: str
    groot2_tree: str
    btlog_directory: Path | None
    btlog_keep: int
    publish_statuses: bool
    monitoring: Monitoring
    navigators: NavigatorParameters


def declare_parameters(node: Node) -> ServerParameters:
    """Declare the parameters on ``node`` and read them;
    see :mod:`flexbt_common.runtime.parameters` for when they can be set.

    Raises:
        ServerParameterError, UnfitParameterError: a value that cannot work.
    """

    declare = ParameterDeclarer(node)
    written = declare.text(
        'nav2_branch',
        'jazzy',
        f'Nav2 branch of trees that do not show theirs: {", ".join(NAV2_BRANCHES)}',
    )
    branch = next((known for known in NAV2_BRANCHES if known == written), None)
    if branch is None:
        branches = ', '.join(NAV2_BRANCHES)
        raise ServerParameterError(
            f"parameter 'nav2_branch': {short_repr(written)} is not a branch; write one of {branches}"
        )
    written = declare.fixed.text(
        'btlog_directory', '', 'directory for a log file of each run, for Groot2; none if empty'
    )
    btlog_directory = home_path(written) if written else None
    if btlog_directory is not None and not btlog_directory.is_absolute():
        raise ServerParameterError(
            f"parameter 'btlog_directory': {btlog_directory} is not absolute; begin it with / or ~"
        )
    return ServerParameters(
        default_tree=declare.text('default_tree', '', 'tree of a goal that names no tree: ID or package/path.xml'),
        preload=declare.texts('preload', (), 'XML files to load at start-up, as package/path.xml'),
        allowed_directories=declare.fixed.directories(
            'allowed_directories', (), 'directories that may hold XML files, in addition to the package shares'
        ),
        nav2_branch=branch,
        tick_rate=declare.real('tick_rate', 10.0, 0.1, 1000.0, 'minimum tick rate when no event wakes the tree, Hz'),
        feedback_rate=declare.real(
            'feedback_rate', 5.0, 0.1, 100.0, 'feedback rate of a running tree, Hz of wall time'
        ),
        server_timeout=declare.real(
            'server_timeout', 1.0, 0.01, 60.0, 'time to wait for a server, and for it to accept a goal, s of wall time'
        ),
        cancel_timeout=declare.real('cancel_timeout', 2.0, 0.01, 60.0, 'time that leaves have to halt, s of wall time'),
        start_timeout=declare.real(
            'start_timeout', 10.0, 0.0, 600.0, 'seconds after start-up during which leaves wait for their servers'
        ),
        peer_timeout=declare.real('peer_timeout', PEER_TIMEOUT, 0.6, 3600.0, PEER_TIMEOUT_TEXT),
        pose_topic=declare.text('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped"),
        robot_base_frame=declare.text('robot_base_frame', 'base_link', 'frame of the robot'),
        goal_reached_tol=declare.real(
            'goal_reached_tol', 0.25, 0.0, 100.0, 'distance from the goal at which GoalReached succeeds, m'
        ),
        error_code_names=declare.texts(
            'error_code_names',
            DEFAULT_ERROR_CODE_NAMES,
            'blackboard keys whose error codes go into the result; each run has its own',
        ),
        max_file_size=declare.fixed.integer('max_file_size', MAX_BYTES, 1000, 100_000_000, 'largest XML file, bytes'),
        max_depth=declare.fixed.integer('max_depth', MAX_DEPTH, 1, 10_000, 'deepest nesting of XML elements'),
        max_loaded_memory=declare.fixed.integer(
            'max_loaded_memory',
            MOST_LOADED,
            1_000_000,
            100_000_000_000,
            'memory that loaded trees may take, bytes; the least recently used are dropped to make room',
        ),
        groot2_port=declare.fixed.integer(
            'groot2_port',
            0,
            0,
            65534,
            'port on which Groot2 finds running trees (its default: 1667), and the next one; 0: off',
        ),
        groot2_address=declare.fixed.text('groot2_address', '127.0.0.1', 'address to listen on for Groot2; * for all'),
        groot2_tree=declare.text('groot2_tree', '', 'ID of the tree that Groot2 is shown; if empty, the newest one'),
        btlog_directory=btlog_directory,
        btlog_keep=declare.fixed.integer(
            'btlog_keep',
            100,
            1,
            1_000_000,
            'number of log files to keep in that directory; a run of ReachGoal leaves several',
        ),
        publish_statuses=declare.flag(
            'publish_statuses', True, f'whether {names.TREE_STRUCTURE} and {names.TREE_STATUS} are published'
        ),
        monitoring=declare_monitoring(declare),
        navigators=declare_navigator_parameters(declare),
    )


# The parameters of the navigators, with the names that they have in Nav2 where Nav2 has them.

NAVIGATORS: Final = (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS)
"""Actions that can be served."""

DEFAULT_TREES: Final = {
    names.NAVIGATE_TO_POSE: 'default_nav_to_pose_bt_xml',
    names.NAVIGATE_THROUGH_POSES: 'default_nav_through_poses_bt_xml',
}
"""The parameter of the default tree of each navigator that runs trees."""

WAIT: Final = 'wait_at_waypoint'
INPUT: Final = 'input_at_waypoint'
TASKS: Final = (WAIT, INPUT)
"""Tasks that can be done at waypoints."""


@dataclass(frozen=True)
class InputParameters:
    """Parameters of the task executor input_at_waypoint: ``timeout`` in s of the clock of the node."""

    topic: str
    timeout: float


@dataclass(frozen=True)
class NavigatorParameters:
    """Values of the parameters; see :func:`declare_navigator_parameters` for meaning and unit."""

    navigators: tuple[str, ...]
    default_trees: dict[str, str]
    search_directories: tuple[Path, ...]
    global_frame: str
    goal_key: str
    goals_key: str
    path_key: str
    statuses_key: str
    stop_on_failure: bool
    waypoint_pause: float
    waypoint_input: InputParameters | None

    @property
    def trusted(self) -> tuple[Path, ...]:
        """Files and directories that the parameters name by absolute paths: a client that sets parameters may use
        any."""
        trees = (Path(tree) for tree in self.default_trees.values() if tree.startswith('/'))
        return (*trees, *self.search_directories)

    @property
    def found_files(self) -> list[Path]:
        """The XML files of the search directories."""
        return [file for directory in self.search_directories for file in sorted(directory.glob('*.xml'))]


def declare_navigator_parameters(declare: ParameterDeclarer) -> NavigatorParameters:
    """Declare the parameters and read them.

    Raises:
        ServerParameterError, UnfitParameterError: a value that cannot work.
    """
    served = declare.texts(
        'navigators', (), f'actions of bt_navigator and waypoint_follower to serve: {", ".join(NAVIGATORS)}'
    )
    for name in served:
        if name not in NAVIGATORS:
            actions = f'{", ".join(NAVIGATORS)}{did_you_mean(name, NAVIGATORS)}'
            raise ServerParameterError(
                f"parameter 'navigators': {short_repr(name)} is not served; write one of {actions}"
            )
    trees = {
        name: declare.fixed.text(
            parameter,
            f'flexbt_server/behavior_trees/{name}.xml',
            f'tree of a goal of {name} that names none: package/path.xml, an absolute path, or the ID of a loaded tree',
        )
        for name, parameter in DEFAULT_TREES.items()
    }
    directories = tuple(
        home_path(text)
        for text in declare.fixed.texts(
            'bt_search_directories',
            (),
            'directories whose XML files are loaded at start-up; goals may name their trees by ID',
        )
    )
    for directory in directories:
        if not (directory.is_absolute() and directory.is_dir()):
            raise ServerParameterError(
                f"parameter 'bt_search_directories': {directory} is not the absolute path of a directory"
            )
    task = declare.text(
        'waypoint_task_executor_plugin', WAIT, f'what follow_waypoints does at each waypoint: {", ".join(TASKS)}'
    )
    if task not in TASKS:
        raise ServerParameterError(
            f"parameter 'waypoint_task_executor_plugin': {task!r} is not one of {', '.join(TASKS)}; a robot that does "
            'something else at waypoints has a behavior or a tree that does it'
        )
    pauses = declare.flag(f'{WAIT}.enabled', True, 'whether to pause at each waypoint')
    pause = declare.integer(
        f'{WAIT}.waypoint_pause_duration', 0, 0, 86_400_000, 'pause at each waypoint, ms of the node clock'
    )
    asks = declare.flag(f'{INPUT}.enabled', True, 'whether to wait for a message at each waypoint')
    asked = InputParameters(
        declare.text(f'{INPUT}.input_topic', f'{INPUT}/input', 'topic of the message, std_msgs/Empty'),
        declare.real(
            f'{INPUT}.timeout', 10.0, 0.01, 86_400.0, 'maximum time to wait for the message, s of the node clock'
        ),
    )
    return NavigatorParameters(
        navigators=served,
        default_trees={name: tree for name, tree in trees.items() if name in served},
        search_directories=directories,
        global_frame=declare.text(
            'global_frame',
            'map',
            'frame of robot and goals by default, and of the goals of navigators',
        ),
        goal_key=declare.text('goal_blackboard_id', 'goal', 'blackboard key of the goal of navigate_to_pose'),
        goals_key=declare.text('goals_blackboard_id', 'goals', 'blackboard key of the goals of navigate_through_poses'),
        path_key=declare.text('path_blackboard_id', 'path', 'blackboard key of the path that the robot follows'),
        statuses_key=declare.text(
            'waypoint_statuses_blackboard_id',
            'waypoint_statuses',
            'blackboard key of the statuses of the waypoints, for trees of the branch main',
        ),
        stop_on_failure=declare.flag(
            'stop_on_failure', True, 'whether follow_waypoints ends when a waypoint cannot be reached'
        ),
        waypoint_pause=pause * 1e-3 if pauses and task == WAIT else 0.0,
        waypoint_input=asked if asks and task == INPUT else None,
    )
