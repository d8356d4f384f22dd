# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``demo``: processes, session, scripted operator, report and picture."""

from .demo_processes import (
    ODOM_RATE,
    DemoSettings,
    ParameterValue,
    Process,
    built_in_places,
    console_command,
    demo_processes,
    first_place,
    page_command,
)
from .interactive import page_line, run_console, serve_page, tell_ended
from .options import RunOptions, parse_options, parse_run_options
from .picture import draw_tracks, write_picture
from .process_group import EndedProcess, ProcessGroup
from .report import DemoError, DemoReport, GoalResult, Timeline
from .robot_track import POINT_DISTANCE, Pose, RobotTrack
from .ros_domain import DISCOVERY_PORT, DISCOVERY_PORT_STEP, DOMAINS, NoFreeDomainError, own_domain
from .running import Interrupted, run_demonstration
from .scripted_operator import ANSWER_TIMEOUT_S, DRIVE_TIMEOUT_S, ScriptedOperator
from .session import READY_TIMEOUT_S, Session, join_robot, set_environment
from .simulation import Box, Simulation, call_service

__all__ = [
    'ANSWER_TIMEOUT_S',
    'DISCOVERY_PORT',
    'DISCOVERY_PORT_STEP',
    'DOMAINS',
    'DRIVE_TIMEOUT_S',
    'ODOM_RATE',
    'POINT_DISTANCE',
    'READY_TIMEOUT_S',
    'Box',
    'DemoError',
    'DemoReport',
    'DemoSettings',
    'EndedProcess',
    'GoalResult',
    'Interrupted',
    'NoFreeDomainError',
    'ParameterValue',
    'Pose',
    'Process',
    'ProcessGroup',
    'RobotTrack',
    'RunOptions',
    'ScriptedOperator',
    'Session',
    'Simulation',
    'Timeline',
    'built_in_places',
    'call_service',
    'console_command',
    'demo_processes',
    'draw_tracks',
    'first_place',
    'join_robot',
    'own_domain',
    'page_command',
    'page_line',
    'parse_options',
    'parse_run_options',
    'run_console',
    'run_demonstration',
    'serve_page',
    'set_environment',
    'tell_ended',
    'write_picture',
]
