# SPDX-License-Identifier: BSD-3-Clause
"""What is recorded: the operator link, the trees, where the robot is, and what its lidar meets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from rclpy.qos import QoSProfile, qos_profile_sensor_data

from flexbt_common import names
from flexbt_console.link import SCAN_BYTES

SCAN_PERIOD: Final = 0.5
"""As the screen shows it."""


class Topic(NamedTuple):
    """A topic by its type and the quality of service on both sides.

    Of what has come, a message each ``period`` seconds of wall time is recorded, and none of more than ``bytes``.
    """

    type: str
    qos: QoSProfile
    period: float = 0.0
    bytes: float = math.inf


TOPICS: Final[Mapping[str, Topic]] = {
    names.EXECUTIVE_STATUS: Topic('flexbt_msgs/msg/ExecutiveStatus', names.latched()),
    names.EXECUTIVE_STRUCTURE: Topic('flexbt_msgs/msg/BehaviorStructure', names.latched()),
    names.EXECUTIVE_BEHAVIORS: Topic('flexbt_msgs/msg/BehaviorList', names.latched()),
    names.EXECUTIVE_SUBJECTS: Topic('flexbt_msgs/msg/DecisionSubjects', names.latched()),
    names.PLACES: Topic('flexbt_msgs/msg/PlaceList', names.latched()),
    names.EXECUTIVE_LOG: Topic('flexbt_msgs/msg/ExecutiveLog', names.latched(names.LOG_DEPTH)),
    names.EXECUTIVE_EVENTS: Topic('flexbt_msgs/msg/ExecutiveEvents', names.latched(names.EVENTS_DEPTH)),
    names.EXECUTIVE_COMMAND: Topic('flexbt_msgs/msg/ExecutiveCommand', names.command()),
    names.EXECUTIVE_STOP: Topic('flexbt_msgs/msg/ExecutiveCommand', names.stop()),
    names.STOP_GUARD_STATUS: Topic('flexbt_msgs/msg/StopGuardStatus', names.latched()),
    names.TREE_STRUCTURE: Topic('flexbt_msgs/msg/TreeStructure', names.latched(16)),
    names.TREE_STATUS: Topic('flexbt_msgs/msg/TreeStatus', names.latched(16)),
    names.MAP: Topic('nav_msgs/msg/OccupancyGrid', names.latched()),
    names.POSE: Topic('geometry_msgs/msg/PoseStamped', qos_profile_sensor_data),
    names.TF: Topic('tf2_msgs/msg/TFMessage', QoSProfile(depth=100)),
    names.TF_STATIC: Topic('tf2_msgs/msg/TFMessage', names.latched(100)),  # one message of each broadcaster
    names.SCAN: Topic('sensor_msgs/msg/LaserScan', names.unacknowledged(1), SCAN_PERIOD, SCAN_BYTES),
    names.EXECUTIVE_PLAN: Topic('flexbt_msgs/msg/RobotPlan', names.latched()),
    names.PLAN: Topic('nav_msgs/msg/Path', QoSProfile(depth=10)),
    names.CMD_VEL: Topic('geometry_msgs/msg/Twist', qos_profile_sensor_data),
}
"""By relative name. A late subscriber gets what is latched, so that a recording that begins in a run is complete."""

NOT_REPLAYED: Final = frozenset({names.EXECUTIVE_COMMAND, names.EXECUTIVE_STOP, names.CMD_VEL})
"""Commands: shown in the file, and never given to anybody again."""
