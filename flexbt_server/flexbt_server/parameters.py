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
from flexbt_core.values.text import short_repr
from flexbt_server.navigators.parameters import NavigatorParameters, declare_navigator_parameters
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
        f'branch of Nav2 of the trees that do not show it themselves: {", ".join(NAV2_BRANCHES)}',
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
        default_tree=declare.text('default_tree', '', 'tree of a goal that names none: ID or package/path.xml'),
        preload=declare.texts('preload', (), 'XML files, as package/path.xml, that are loaded at the start'),
        allowed_directories=declare.fixed.directories(
            'allowed_directories', (), 'directories, beside the package shares, that may hold XML files'
        ),
        nav2_branch=branch,
        tick_rate=declare.real(
            'tick_rate', 10.0, 0.1, 1000.0, 'least rate at which a running tree is ticked without a wake-up, Hz'
        ),
        feedback_rate=declare.real(
            'feedback_rate', 5.0, 0.1, 100.0, 'rate of the feedback of a running tree, Hz of wall time'
        ),
        server_timeout=declare.real(
            'server_timeout', 1.0, 0.01, 60.0, 'wait for a server and for its acceptance, s of wall time'
        ),
        cancel_timeout=declare.real(
            'cancel_timeout', 2.0, 0.01, 60.0, 'how long leaves may take to halt, s of wall time'
        ),
        start_timeout=declare.real(
            'start_timeout', 10.0, 0.0, 600.0, 'age of this process up to which a server of a leaf is waited for, s'
        ),
        peer_timeout=declare.real('peer_timeout', PEER_TIMEOUT, 0.6, 3600.0, PEER_TIMEOUT_TEXT),
        pose_topic=declare.text('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped"),
        robot_base_frame=declare.text('robot_base_frame', 'base_link', 'frame of the robot that the poses are of'),
        goal_reached_tol=declare.real(
            'goal_reached_tol', 0.25, 0.0, 100.0, 'how far from its goal GoalReached takes the robot to be there, m'
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
            'groot2_port', 0, 0, 65534, 'port where Groot2 finds running trees (it asks at 1667), and the next; 0: off'
        ),
        groot2_address=declare.fixed.text(
            'groot2_address', '127.0.0.1', 'address on which Groot2 is waited for; * for all'
        ),
        groot2_tree=declare.text('groot2_tree', '', 'ID of the tree that Groot2 is shown; if empty, the newest one'),
        btlog_directory=btlog_directory,
        btlog_keep=declare.fixed.integer(
            'btlog_keep',
            100,
            1,
            1_000_000,
            'newest log files that are kept in that directory; a run of ReachGoal leaves several',
        ),
        publish_statuses=declare.flag(
            'publish_statuses', True, f'whether {names.TREE_STRUCTURE} and {names.TREE_STATUS} are published'
        ),
        monitoring=declare_monitoring(declare),
        navigators=declare_navigator_parameters(declare),
    )
