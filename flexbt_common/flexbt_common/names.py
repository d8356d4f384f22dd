# SPDX-License-Identifier: BSD-3-Clause
"""Names of nodes, actions, topics and services of FlexBT, and the quality of service of its topics.

The single table of the names that processes must agree on. Every name is relative, so that a whole robot can have a
namespace.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Nodes
BT_SERVER: Final = 'bt_server'
ONBOARD_EXECUTIVE: Final = 'onboard_executive'
CONSOLE: Final = 'console'
OBSERVER: Final = 'observer'
RECORDER: Final = 'recorder'
BLACK_BOX: Final = 'black_box'
SIMULATOR: Final = 'simulator'
NAVIGATION: Final = 'navigation'
STOP_GUARD: Final = 'stop_guard'

# Actions of the BT server
BT_LOADER: Final = 'bt_loader'
BT_EXECUTOR: Final = 'bt_executor'
BT_GET_DATA: Final = 'bt_get_data'
BT_SET_DATA: Final = 'bt_set_data'

# Interfaces of the BT server for Nav2's clients
BT_NAVIGATOR: Final = 'bt_navigator'
WAYPOINT_FOLLOWER: Final = 'waypoint_follower'
NAVIGATE_TO_POSE: Final = 'navigate_to_pose'
NAVIGATE_THROUGH_POSES: Final = 'navigate_through_poses'
FOLLOW_WAYPOINTS: Final = 'follow_waypoints'
INPUT_DEPTH: Final = 10  # of the input at waypoints
GOAL_POSE: Final = 'goal_pose'
BEHAVIOR_TREE_LOG: Final = 'behavior_tree_log'

# Topics of the BT server
TREE_STRUCTURE: Final = 'tree_structure'
TREE_STATUS: Final = 'tree_status'
TREE_DEBUGGING: Final = 'tree_debugging'
BEHAVIOR_TREE_XML: Final = 'behavior_tree_xml'

# Services of the BT server
CONTROL_TREE: Final = 'control_tree'
GET_TREE_BLACKBOARD: Final = 'get_tree_blackboard'

# Actions of the onboard executive
OPERATOR_INPUT: Final = 'operator_input'
EXECUTE_BEHAVIOR: Final = 'execute_behavior'
GET_USERDATA: Final = 'get_userdata'
SYNTHESIZE_BEHAVIOR: Final = 'synthesize_behavior'
FLEXBE_SYNTHESIS: Final = 'behavior_synthesis'  # of flexbe_msgs, where that is installed

# The operator link
EXECUTIVE_STATUS: Final = 'executive/status'
EXECUTIVE_STRUCTURE: Final = 'executive/structure'
EXECUTIVE_BEHAVIORS: Final = 'executive/behaviors'
EXECUTIVE_COMMAND: Final = 'executive/command'
EXECUTIVE_STOP: Final = 'executive/stop'  # a separate topic for stops, in addition to executive/command
EXECUTIVE_LOG: Final = 'executive/log'
EXECUTIVE_EVENTS: Final = 'executive/events'
EXECUTIVE_SUBJECTS: Final = 'executive/subjects'  # subjects of the pending decisions
EXECUTIVE_QUEUE: Final = 'executive/queue'  # the mission queue
EXECUTIVE_PLAN: Final = 'executive/plan'  # latched copy of the newest message on 'plan'
EXECUTIVE_PRESENCE: Final = 'executive/presence'
EXECUTIVE_PING: Final = 'executive/ping'
EXECUTIVE_PONG: Final = 'executive/pong'
STOP_GUARD_STATUS: Final = 'stop_guard/status'
PLACES: Final = 'places'
COMMAND_DEPTH: Final = 50
STOP_DEPTH: Final = 50
LOG_DEPTH: Final = 50
EVENTS_DEPTH: Final = 50

# Robot
MAP: Final = 'map'
KEEPOUT_FILTER_INFO: Final = 'keepout_costmap_filter_info'
KEEPOUT_FILTER_MASK: Final = 'keepout_filter_mask'
SCAN: Final = 'scan'
RANGE: Final = 'range'
IMU: Final = 'imu'
ODOM: Final = 'odom'
CLOCK: Final = '/clock'
POSE: Final = 'pose'
TF: Final = 'tf'
TF_STATIC: Final = 'tf_static'
CMD_VEL: Final = 'cmd_vel'
INITIAL_POSE: Final = 'initialpose'
AMCL_POSE: Final = 'amcl_pose'
BATTERY_STATE: Final = 'battery_state'
BATTERY_STATUS: Final = 'battery_status'  # the same, under the default topic of Nav2's battery conditions
BUMPER: Final = 'bumper'
GRIPPER: Final = 'gripper'
GRIPPER_HOLDS: Final = 'gripper_holds'
ROBOT_DESCRIPTION: Final = 'robot_description'
RESET: Final = 'reset'
WRITE_INCIDENT: Final = 'black_box/write_incident'
INCIDENTS: Final = 'black_box/incidents'  # those of the last day, newest first
SERVER_FAULTS: Final = 'server_faults'

# Navigation
COMPUTE_PATH_TO_POSE: Final = 'compute_path_to_pose'
COMPUTE_PATH_THROUGH_POSES: Final = 'compute_path_through_poses'
SMOOTH_PATH: Final = 'smooth_path'
PLAN_SMOOTHED: Final = 'plan_smoothed'
COMPUTE_ROUTE: Final = 'compute_route'
COMPUTE_AND_TRACK_ROUTE: Final = 'compute_and_track_route'
SET_ROUTE_GRAPH: Final = 'route_server/set_route_graph'
ADJUST_EDGES: Final = 'route_server/DynamicEdgesScorer/adjust_edges'
REROUTE: Final = 'route_server/ReroutingService/reroute'
ROUTE_GRAPH: Final = 'route_graph'
SPEED_LIMIT: Final = 'speed_limit'
FOLLOW_PATH: Final = 'follow_path'
SPIN: Final = 'spin'
BACKUP: Final = 'backup'
WAIT: Final = 'wait'
DRIVE_ON_HEADING: Final = 'drive_on_heading'
ASSISTED_TELEOP: Final = 'assisted_teleop'
CMD_VEL_TELEOP: Final = 'cmd_vel_teleop'
PREEMPT_TELEOP: Final = 'preempt_teleop'
DOCK_ROBOT: Final = 'dock_robot'
UNDOCK_ROBOT: Final = 'undock_robot'
RELOAD_DOCKS: Final = 'docking_server/reload_database'
DETECTED_DOCK_POSE: Final = 'detected_dock_pose'
DOCK_POSE: Final = 'dock_pose'
STAGING_POSE: Final = 'staging_pose'
FOLLOW_OBJECT: Final = 'follow_object'
CLEAR_GLOBAL_COSTMAP: Final = 'global_costmap/clear_entirely_global_costmap'
CLEAR_LOCAL_COSTMAP: Final = 'local_costmap/clear_entirely_local_costmap'
COSTMAPS: Final = ('global_costmap', 'local_costmap')
TOGGLE_COLLISION_MONITOR: Final = 'collision_monitor/toggle'
COLLISION_MONITOR_STATE: Final = 'collision_monitor_state'
IS_PATH_VALID: Final = 'is_path_valid'
PLAN: Final = 'plan'

# Nodes of Nav2, for programs that look for them or manage them
AMCL: Final = 'amcl'
MAP_SERVER: Final = 'map_server'
COLLISION_MONITOR: Final = 'collision_monitor'
ACTIONS_OF_SERVERS: Final[Mapping[str, tuple[str, ...]]] = {
    'controller_server': (FOLLOW_PATH,),
    'planner_server': (COMPUTE_PATH_TO_POSE, COMPUTE_PATH_THROUGH_POSES),
    'smoother_server': (SMOOTH_PATH,),
    'behavior_server': (SPIN, BACKUP, DRIVE_ON_HEADING, ASSISTED_TELEOP, WAIT),
    'route_server': (COMPUTE_ROUTE, COMPUTE_AND_TRACK_ROUTE),
    'docking_server': (DOCK_ROBOT, UNDOCK_ROBOT),
}
"""The actions of each navigation server of Nav2."""


def costmap_topics(costmap: str) -> tuple[str, str, str]:
    """Return the topics of one of :data:`COSTMAPS`: its map for display, its raw costs, and the robot's footprint."""
    return f'{costmap}/costmap', f'{costmap}/costmap_raw', f'{costmap}/published_footprint'


def costmap_services(costmap: str) -> tuple[str, str, str, str, str]:
    """Return the services of one of :data:`COSTMAPS`: clear all except around the robot, clear around the robot, clear
    around a pose, get the costmap, get a cost. The services that clear all of it have separate constants, since trees
    name them.
    """
    clear = f'{costmap}/clear'
    return (
        f'{clear}_except_{costmap}',
        f'{clear}_around_{costmap}',
        f'{clear}_around_pose_{costmap}',
        f'{costmap}/get_costmap',
        f'{costmap}/get_cost_{costmap}',
    )


COMMANDER_CLEARS: Final = tuple(
    f'{COSTMAPS[1]}/clear_costmap_{what}' for what in ('except_region', 'around_robot', 'around_pose')
)
"""Names that BasicNavigator of nav2_simple_commander uses for the first three of these services of the local costmap.
Nav2's own costmaps do not have them, so BasicNavigator waits forever there."""


def of_robot(namespace: str, name: str) -> str:
    """Return a name of this table for a robot in a namespace such as '/robot2'; '' means the namespace of the node."""
    return f'{namespace.rstrip("/")}/{name}' if namespace else name


def node_of(endpoint: Any) -> str:
    """Return the full name of the node of an endpoint, as rclpy describes it."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def alive_topic(node_name: str) -> str:
    """Return the topic of a node's liveliness token: relative for a relative name, absolute for an absolute one."""
    return f'{node_name}/alive'


def transient_local_qos(depth: int = 1) -> QoSProfile:
    """Return the QoS for state: a late subscriber gets the last ``depth`` messages."""
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def command_qos() -> QoSProfile:
    """Return the QoS for commands: reliable, and not repeated to late subscribers."""
    return QoSProfile(depth=COMMAND_DEPTH)


def stop_qos() -> QoSProfile:
    """Return the QoS for stops. They have a separate queue, so that a flood of commands drops no stop."""
    return QoSProfile(depth=STOP_DEPTH)


def best_effort_qos(depth: int = 10) -> QoSProfile:
    """Return the QoS for data that is published repeatedly, so that the middleware need not resend it."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def service_qos() -> QoSProfile:
    """Return the QoS for services, including those of actions, for both sides.

    The default keeps ten requests and ten responses. A larger burst silently loses the rest, whose futures never
    complete.
    """
    return QoSProfile(depth=1000)
