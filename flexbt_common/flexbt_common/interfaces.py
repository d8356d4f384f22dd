# SPDX-License-Identifier: BSD-3-Clause
"""The topics, services and actions of a robot and their nodes: the exact content of a security policy.

The names are in :mod:`flexbt_common.names`. A system test compares this table with the graph of a running robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from . import names
from .names import (
    BLACK_BOX,
    BT_SERVER,
    CONSOLE,
    NAVIGATION,
    OBSERVER,
    ONBOARD_EXECUTIVE,
    RECORDER,
    SIMULATOR,
    STOP_GUARD,
)

ROLES: Final[Mapping[str, tuple[str, ...]]] = {
    'robot': (BT_SERVER, ONBOARD_EXECUTIVE, NAVIGATION, SIMULATOR, STOP_GUARD),
    'operator': (CONSOLE,),
    'observer': (OBSERVER, RECORDER, BLACK_BOX),
}
"""The nodes of each role: nodes that move the robot, that command it, and that only observe it."""

MANAGED: Final = frozenset({BT_SERVER, ONBOARD_EXECUTIVE})
"""Nodes with a lifecycle."""

PARTS: Final[Mapping[str, tuple[str, ...]]] = {
    BT_SERVER: (names.BT_NAVIGATOR, names.WAYPOINT_FOLLOWER),
    NAVIGATION: (*names.ACTIONS_OF_SERVERS, names.COLLISION_MONITOR),
    SIMULATOR: (names.AMCL, names.MAP_SERVER),
}
"""Managed nodes in the process, and so in the enclave, of another node: :mod:`.lifecycle.lifecycle_subnode`."""

SETTABLE_SERVERS: Final = ('controller_server', 'planner_server')
"""Subset of these nodes whose parameters can be set."""


class InterfaceKind(Enum):
    """The kind of an interface; the value is the word of a policy for it."""

    TOPIC = 'topic'
    SERVICE = 'service'
    ACTION = 'action'


@dataclass(frozen=True)
class Interface:
    """A topic, a service or an action.

    ``name`` is relative to the robot's namespace unless it begins with ``/``; a leading ``~`` stands for the node.
    ``offered_by`` are its publishers or servers, ``used_by`` its subscribers or clients.
    """

    kind: InterfaceKind
    name: str
    offered_by: tuple[str, ...]
    used_by: tuple[str, ...] = ()


ROBOT: Final = ROLES['robot']
EVERY_NODE: Final = tuple(node for nodes in ROLES.values() for node in nodes)
CONSOLES: Final = (CONSOLE, OBSERVER)
RECORDERS: Final = (RECORDER, BLACK_BOX)


def _topics(*topics: str, by: tuple[str, ...] = (), to: tuple[str, ...] = ()) -> tuple[Interface, ...]:
    return tuple(Interface(InterfaceKind.TOPIC, name, by, to) for name in topics)


def _services(*services: str, by: tuple[str, ...] = (), to: tuple[str, ...] = ()) -> tuple[Interface, ...]:
    return tuple(Interface(InterfaceKind.SERVICE, name, by, to) for name in services)


def _managed(*nodes: str, by: tuple[str, ...]) -> tuple[Interface, ...]:
    """Return the interfaces that rclpy creates for managed nodes."""
    return (
        *_topics(*(f'{node}/transition_event' for node in nodes), by=by),
        *_services(
            *(
                f'{node}/{service}'
                for node in nodes
                for service in (
                    'change_state',
                    'get_available_states',
                    'get_available_transitions',
                    'get_state',
                    'get_transition_graph',
                )
            ),
            by=by,
        ),
    )


def _actions(*actions: str, to: tuple[str, ...], by: str | None = None) -> tuple[Interface, ...]:
    return tuple(Interface(InterfaceKind.ACTION, name, () if by is None else (by,), to) for name in actions)


def _parameters(*nodes: str, by: tuple[str, ...]) -> tuple[Interface, ...]:
    """Return the parameter services that rclpy creates for nodes."""
    services = (
        'describe_parameters',
        'get_parameter_types',
        'get_parameters',
        'list_parameters',
        'set_parameters',
        'set_parameters_atomically',
    )
    return _services(*(f'{node}/{service}' for node in nodes for service in services), by=by)


OF_NODES: Final[tuple[Interface, ...]] = (
    *_topics('/rosout', by=EVERY_NODE, to=(BLACK_BOX,)),
    *_topics('/parameter_events', by=EVERY_NODE, to=EVERY_NODE),
    *_parameters('~', by=tuple(node for node in EVERY_NODE if node != STOP_GUARD)),  # must not be kept busy
    *_services('~/get_type_description', by=EVERY_NODE),
    *_managed('~', by=tuple(sorted(MANAGED))),
    *(interface for node, parts in PARTS.items() for interface in _managed(*parts, by=(node,))),
    *_parameters(*SETTABLE_SERVERS, by=(NAVIGATION,)),
)
"""Interfaces that rclpy creates for each node. None of these roles may set parameters or change a lifecycle state."""

OF_FLEXBT: Final[tuple[Interface, ...]] = (
    # The operator link
    *_topics(names.EXECUTIVE_STATUS, by=(ONBOARD_EXECUTIVE,), to=(*CONSOLES, *RECORDERS, STOP_GUARD)),
    *_topics(
        names.EXECUTIVE_STRUCTURE,
        names.EXECUTIVE_BEHAVIORS,
        names.EXECUTIVE_LOG,
        names.EXECUTIVE_EVENTS,
        names.EXECUTIVE_SUBJECTS,
        names.EXECUTIVE_QUEUE,
        names.EXECUTIVE_PLAN,
        names.PLACES,
        by=(ONBOARD_EXECUTIVE,),
        to=(*CONSOLES, *RECORDERS),
    ),
    *_topics(names.EXECUTIVE_STOP, by=(CONSOLE, STOP_GUARD), to=(ONBOARD_EXECUTIVE, STOP_GUARD, *RECORDERS)),
    *_topics(names.STOP_GUARD_STATUS, by=(STOP_GUARD,), to=(*CONSOLES, *RECORDERS)),
    *_topics(names.EXECUTIVE_COMMAND, by=(CONSOLE,), to=(ONBOARD_EXECUTIVE, *RECORDERS)),
    *_topics(names.EXECUTIVE_PRESENCE, by=(CONSOLE,), to=(ONBOARD_EXECUTIVE, *RECORDERS)),
    *_topics(names.EXECUTIVE_PING, by=CONSOLES, to=(ONBOARD_EXECUTIVE,)),
    *_topics(names.EXECUTIVE_PONG, by=(ONBOARD_EXECUTIVE,), to=CONSOLES),
    *_actions(names.GET_USERDATA, by=ONBOARD_EXECUTIVE, to=CONSOLES),
    *_actions(names.SYNTHESIZE_BEHAVIOR, by=ONBOARD_EXECUTIVE, to=(CONSOLE,)),
    *_actions(names.FLEXBE_SYNTHESIS, by=ONBOARD_EXECUTIVE, to=()),
    *_actions(names.OPERATOR_INPUT, names.EXECUTE_BEHAVIOR, by=ONBOARD_EXECUTIVE, to=(ONBOARD_EXECUTIVE, BT_SERVER)),
    # The BT server
    *_actions(names.BT_EXECUTOR, by=BT_SERVER, to=(ONBOARD_EXECUTIVE, STOP_GUARD)),
    *_actions(
        names.BT_LOADER,
        names.BT_GET_DATA,
        names.BT_SET_DATA,
        by=BT_SERVER,
        to=(ONBOARD_EXECUTIVE,),
    ),
    *_services(names.CONTROL_TREE, by=(BT_SERVER,), to=(ONBOARD_EXECUTIVE,)),
    *_services(names.GET_TREE_BLACKBOARD, by=(BT_SERVER,), to=CONSOLES),
    *_topics(names.TREE_DEBUGGING, by=(BT_SERVER,), to=(ONBOARD_EXECUTIVE,)),
    *_topics(names.TREE_STRUCTURE, names.TREE_STATUS, by=(BT_SERVER,), to=(*CONSOLES, *RECORDERS)),
    *_topics('/diagnostics', by=(BT_SERVER, ONBOARD_EXECUTIVE)),
    # Interfaces of the BT server for Nav2's clients
    *_actions(
        names.NAVIGATE_TO_POSE,
        names.NAVIGATE_THROUGH_POSES,
        names.FOLLOW_WAYPOINTS,
        by=BT_SERVER,
        to=(BT_SERVER, ONBOARD_EXECUTIVE, STOP_GUARD),
    ),
    *_topics(names.GOAL_POSE, to=(BT_SERVER,)),
    *_topics(names.BEHAVIOR_TREE_LOG, names.BEHAVIOR_TREE_XML, by=(BT_SERVER,)),
    # Navigation
    *_actions(
        names.COMPUTE_PATH_TO_POSE,
        names.COMPUTE_PATH_THROUGH_POSES,
        names.SMOOTH_PATH,
        names.COMPUTE_ROUTE,
        names.COMPUTE_AND_TRACK_ROUTE,
        names.FOLLOW_PATH,
        names.SPIN,
        names.BACKUP,
        names.WAIT,
        names.DRIVE_ON_HEADING,
        names.ASSISTED_TELEOP,
        names.DOCK_ROBOT,
        names.UNDOCK_ROBOT,
        by=NAVIGATION,
        to=(BT_SERVER, ONBOARD_EXECUTIVE, STOP_GUARD),
    ),
    *_services(
        names.CLEAR_GLOBAL_COSTMAP,
        names.CLEAR_LOCAL_COSTMAP,
        names.IS_PATH_VALID,
        names.TOGGLE_COLLISION_MONITOR,
        by=(NAVIGATION,),
        to=(BT_SERVER,),
    ),
    *_services(
        *(service for costmap in names.COSTMAPS for service in names.costmap_services(costmap)),
        by=(NAVIGATION,),
        to=(BT_SERVER,),
    ),
    *_services(*names.COMMANDER_CLEARS, by=(NAVIGATION,)),
    *_topics(*(topic for costmap in names.COSTMAPS for topic in names.costmap_topics(costmap)), by=(NAVIGATION,)),
    *_topics(
        'controller_selector',
        'goal_checker_selector',
        'path_handler_selector',
        'planner_selector',
        'progress_checker_selector',
        'smoother_selector',
        'goal_update',
        'goals_update',
        '/battery_status',
        to=(BT_SERVER,),
    ),
    # Actions that Nav2's trees use and only other robots offer
    *_actions(
        names.FOLLOW_OBJECT,
        to=(BT_SERVER,),
    ),
    *_services(
        'reinitialize_global_localization',
        to=(BT_SERVER,),
    ),
    *_topics(names.CMD_VEL_TELEOP, names.PREEMPT_TELEOP, to=(NAVIGATION,)),
    *_topics(names.PLAN, by=(NAVIGATION,), to=(ONBOARD_EXECUTIVE, *RECORDERS)),
    *_topics(names.PLAN_SMOOTHED, names.ROUTE_GRAPH, by=(NAVIGATION,)),
    *_topics(names.SPEED_LIMIT, by=(NAVIGATION,), to=(NAVIGATION,)),
    *_topics(names.DOCK_POSE, names.STAGING_POSE, names.COLLISION_MONITOR_STATE, by=(NAVIGATION,)),
    *_topics(names.DETECTED_DOCK_POSE, to=(NAVIGATION,)),
    *_services(names.SET_ROUTE_GRAPH, names.ADJUST_EDGES, names.REROUTE, names.RELOAD_DOCKS, by=(NAVIGATION,)),
    # The robot
    # The executive and the stop guard publish zero velocity.
    *_topics(names.CMD_VEL, by=(NAVIGATION, ONBOARD_EXECUTIVE, STOP_GUARD), to=(SIMULATOR, *RECORDERS)),
    *_topics(names.INITIAL_POSE, to=(SIMULATOR,)),
    *_services(names.RESET, names.GRIPPER, by=(SIMULATOR,)),
    *_topics(names.MAP, by=(SIMULATOR,), to=(NAVIGATION, *CONSOLES, *RECORDERS)),
    *_topics(names.KEEPOUT_FILTER_INFO, names.KEEPOUT_FILTER_MASK, by=(SIMULATOR,), to=(NAVIGATION,)),
    *_topics(names.POSE, by=(SIMULATOR,), to=(*ROBOT, *RECORDERS)),
    *_topics(names.SCAN, by=(SIMULATOR,), to=(NAVIGATION, *CONSOLES, *RECORDERS)),
    *_topics(names.ODOM, by=(SIMULATOR,), to=(BT_SERVER,)),
    *_topics(names.TF, by=(SIMULATOR,), to=(BT_SERVER, NAVIGATION, *CONSOLES, *RECORDERS)),
    *_topics(names.TF_STATIC, by=(SIMULATOR,), to=(BT_SERVER, NAVIGATION, *CONSOLES, *RECORDERS)),
    *_topics(names.AMCL_POSE, names.BUMPER, names.ROBOT_DESCRIPTION, '~/doors', '~/things', by=(SIMULATOR,)),
    *_topics(names.GRIPPER_HOLDS, by=(SIMULATOR,)),
    *_topics(names.BATTERY_STATUS, names.RANGE, names.IMU, by=(SIMULATOR,)),
    *_topics(names.BATTERY_STATE, by=(SIMULATOR,), to=(NAVIGATION, BLACK_BOX)),
    *_topics(names.SERVER_FAULTS, by=(SIMULATOR,), to=(NAVIGATION,)),
    *_services(
        'map_server/map',
        'map_server/load_map',
        '~/delete_entity',
        '~/get_entities',
        '~/get_entities_states',
        '~/get_entity_info',
        '~/get_entity_state',
        '~/get_named_poses',
        '~/get_simulation_state',
        '~/get_simulator_features',
        '~/reset_simulation',
        '~/set_entity_state',
        '~/set_fault',
        '~/set_simulation_state',
        '~/spawn_entity',
        '~/step_simulation',
        by=(SIMULATOR,),
    ),
    *_actions(f'{SIMULATOR}/simulate_steps', by=SIMULATOR, to=()),
    *_services(names.WRITE_INCIDENT, by=(BLACK_BOX,), to=(CONSOLE,)),
    *_topics(names.INCIDENTS, by=(BLACK_BOX,), to=CONSOLES),
    *_topics(names.CLOCK, by=(SIMULATOR,), to=EVERY_NODE),
    *(Interface(InterfaceKind.TOPIC, names.alive_topic(node), (node,), ROBOT) for node in (*ROBOT, *RECORDERS)),
)
"""Interfaces between the nodes of a robot and its operators."""

INTERFACES: Final[tuple[Interface, ...]] = (*OF_NODES, *OF_FLEXBT)
