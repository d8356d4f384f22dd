# SPDX-License-Identifier: BSD-3-Clause
"""A node on rclpy: its executor and thread, its clock, its parameters, and how it ends."""

from .clock_watch import GOES_ON, ClockHealth, clock_health
from .default_context import DefaultContext, offline_default_context, undiscovered
from .health import HANG_SECONDS, Hang, Health, Loop, Watched
from .ignored_participant import ignore_each_other, ignore_participant
from .latest_message import LatestMessage
from .node_executor import make_executor
from .node_log import RepeatedReports
from .node_runtime import CALL_SECONDS, DeepNode, NodeRuntime, qos_misfit, run_node
from .parameters import ALLOWED_DIRECTORIES_TEXT, ParameterDeclarer, refuse_while_configured
from .rclpy_private import (
    ACTION_CLIENT,
    ACTION_SERVER,
    OpenActionClient,
    OpenActionServer,
    is_usable,
    release_lifecycle,
)
from .received_messages import (
    COMPLAINT_SECONDS,
    UNKNOWN_NODE,
    UNKNOWN_WRITER,
    Received,
    ReceivedMessages,
    participant_of,
    reports_writers,
    writer_name,
)
from .resources import resolve_file
from .ros_clock import RosClock
from .sender_rates import Pace, SenderRates
from .simulated_time import ListeningTime
from .weak_lru_cache import WeakLruCache

__all__ = [
    'ACTION_CLIENT',
    'ACTION_SERVER',
    'ALLOWED_DIRECTORIES_TEXT',
    'CALL_SECONDS',
    'COMPLAINT_SECONDS',
    'GOES_ON',
    'HANG_SECONDS',
    'UNKNOWN_NODE',
    'UNKNOWN_WRITER',
    'ClockHealth',
    'DeepNode',
    'DefaultContext',
    'Hang',
    'Health',
    'LatestMessage',
    'ListeningTime',
    'Loop',
    'NodeRuntime',
    'OpenActionClient',
    'OpenActionServer',
    'Pace',
    'ParameterDeclarer',
    'Received',
    'ReceivedMessages',
    'RepeatedReports',
    'RosClock',
    'SenderRates',
    'Watched',
    'WeakLruCache',
    'clock_health',
    'ignore_each_other',
    'ignore_participant',
    'is_usable',
    'make_executor',
    'offline_default_context',
    'participant_of',
    'qos_misfit',
    'refuse_while_configured',
    'release_lifecycle',
    'reports_writers',
    'resolve_file',
    'run_node',
    'undiscovered',
    'writer_name',
]
