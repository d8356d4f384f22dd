# SPDX-License-Identifier: BSD-3-Clause
"""The recorded topics, and definitions of their types as MCAP files carry them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from ament_index_python.packages import get_package_share_directory
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.values.value_types import resolve_type
from flexbt_console.errors import UsageError
from flexbt_console.link.scan_link import MESSAGE_BYTES

SCAN_PERIOD: Final = 0.5
"""Period as on the screen, s."""


class Topic(NamedTuple):
    """A topic by its type and the quality of service on both sides.

    Of what has come, a message each ``period`` seconds of wall time is recorded, and none of more than ``bytes``.
    """

    type: str
    qos: QoSProfile
    period: float = 0.0
    bytes: float = math.inf


TOPICS: Final[Mapping[str, Topic]] = {
    names.EXECUTIVE_STATUS: Topic('flexbt_msgs/msg/ExecutiveStatus', names.transient_local_qos()),
    names.EXECUTIVE_STRUCTURE: Topic('flexbt_msgs/msg/BehaviorStructure', names.transient_local_qos()),
    names.EXECUTIVE_BEHAVIORS: Topic('flexbt_msgs/msg/BehaviorList', names.transient_local_qos()),
    names.EXECUTIVE_SUBJECTS: Topic('flexbt_msgs/msg/DecisionSubjects', names.transient_local_qos()),
    names.EXECUTIVE_QUEUE: Topic('flexbt_msgs/msg/MissionQueue', names.transient_local_qos()),
    names.PLACES: Topic('flexbt_msgs/msg/PlaceList', names.transient_local_qos()),
    names.EXECUTIVE_LOG: Topic('flexbt_msgs/msg/ExecutiveLog', names.transient_local_qos(names.LOG_DEPTH)),
    names.EXECUTIVE_EVENTS: Topic('flexbt_msgs/msg/ExecutiveEvents', names.transient_local_qos(names.EVENTS_DEPTH)),
    names.EXECUTIVE_COMMAND: Topic('flexbt_msgs/msg/ExecutiveCommand', names.command_qos()),
    names.EXECUTIVE_STOP: Topic('flexbt_msgs/msg/ExecutiveCommand', names.stop_qos()),
    names.STOP_GUARD_STATUS: Topic('flexbt_msgs/msg/StopGuardStatus', names.transient_local_qos()),
    names.TREE_STRUCTURE: Topic('flexbt_msgs/msg/TreeStructure', names.transient_local_qos(16)),
    names.TREE_STATUS: Topic('flexbt_msgs/msg/TreeStatus', names.transient_local_qos(16)),
    names.MAP: Topic('nav_msgs/msg/OccupancyGrid', names.transient_local_qos()),
    names.POSE: Topic('geometry_msgs/msg/PoseStamped', names.best_effort_qos(200)),
    names.TF: Topic('tf2_msgs/msg/TFMessage', QoSProfile(depth=500)),
    names.TF_STATIC: Topic('tf2_msgs/msg/TFMessage', names.transient_local_qos(100)),  # one message of each broadcaster
    names.SCAN: Topic('sensor_msgs/msg/LaserScan', names.best_effort_qos(1), SCAN_PERIOD, MESSAGE_BYTES),
    names.EXECUTIVE_PLAN: Topic('flexbt_msgs/msg/RobotPlan', names.transient_local_qos()),
    names.PLAN: Topic('nav_msgs/msg/Path', QoSProfile(depth=10)),
    names.CMD_VEL: Topic('geometry_msgs/msg/Twist', names.best_effort_qos(200)),
}
"""Topics by relative name. A late subscriber gets the latched ones, so a recording that begins during a run is
complete."""

BUNDLED: Final = frozenset({names.POSE, names.TF, names.SCAN, names.PLAN, names.CMD_VEL})
"""Topics that come too often to look at each message when it comes: their queues are long enough for a while."""

NOT_REPLAYED: Final = frozenset({names.EXECUTIVE_COMMAND, names.EXECUTIVE_STOP, names.CMD_VEL})
"""Commands: shown in the file, and never given to anybody again."""


def type_of(topic: str) -> Any:
    """Return the class of the messages of one of :data:`TOPICS`."""
    return resolve_type(TOPICS[topic].type).message


# Definitions of message types as MCAP files carry them, so that a reader needs no ROS.

_SEPARATOR: Final = '=' * 80
_FIELD: Final = re.compile(r'^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[a-z]\w*', re.MULTILINE)
_CONSTANT: Final = re.compile(r'^\S+\s+[A-Z]\w*\s*=')
_PRIMITIVES: Final = frozenset(
    {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'}
    | {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
)


def full_definition(type: str) -> str:
    """Return the text of a message definition and of all that it consists of, in the encoding ``ros2msg`` of MCAP.

    ``type`` is a name such as ``nav_msgs/msg/Path`` of an installed package. Raises OSError or LookupError when its
    definition is not there.
    """
    parts = [_text(type)]
    known = [type]
    for one in known:
        for inner in _types_in(one):
            if inner not in known:
                known.append(inner)
                parts.append(f'{_SEPARATOR}\nMSG: {inner.replace("/msg/", "/")}\n{_text(inner)}')
    return '\n'.join(parts)


def check_definition(topic: str, type: str, definition: str, where: str = '') -> None:
    """Raise UsageError if what was recorded of a topic has another type, or other fields, than it has here."""
    known = TOPICS[topic].type
    if type != known:
        raise UsageError(f'{where}{topic} was recorded with the type {type}, and has {known}')
    if fields_of(full_definition(type)) != fields_of(definition):
        raise UsageError(
            f'{where}{type} has other fields than when this was recorded; use the version of FlexBT that recorded it'
        )


def fields_of(definition: str) -> list[str]:
    """Return the lines of a definition that say how its messages are written: all but comments, constants and
    spaces."""
    lines = (' '.join(line.split('#')[0].split()) for line in definition.splitlines())
    return [line for line in lines if line and not _CONSTANT.match(line)]


def _types_in(type: str) -> list[str]:
    package = type.partition('/')[0]
    plain = re.sub(r'#.*', '', _text(type))
    names = dict.fromkeys(match for match in _FIELD.findall(plain) if match not in _PRIMITIVES)
    return [
        f'{first}/msg/{rest.removeprefix("msg/")}' if rest else f'{package}/msg/{first}'
        for first, _, rest in (name.partition('/') for name in names)
    ]


def _text(type: str) -> str:
    package, _, name = type.partition('/msg/')
    return (Path(get_package_share_directory(package)) / 'msg' / f'{name}.msg').read_text(encoding='utf-8')
