# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``demo``: processes, session, scripted operator, report and picture."""

from .demo_processes import DemoSettings, Process, built_in_places, console_command, demo_processes, first_place
from .options import parse_options
from .picture import (
    DRIVEN,
    NOT_REACHED,
    PLANNED,
    REACHED,
    START,
    DemoPicture,
    GoalMark,
    MapImage,
    draw_picture,
    write_picture,
)
from .process_group import EndedProcess, ProcessGroup
from .report import DemoError, DemoReport, GoalResult, Timeline
from .robot_track import POINT_DISTANCE, Pose, RobotTrack
from .ros_domain import DISCOVERY_PORT, DISCOVERY_PORT_STEP, DOMAINS, NoFreeDomainError, own_domain
from .scripted_operator import ScriptedOperator

__all__ = [
    'DISCOVERY_PORT',
    'DISCOVERY_PORT_STEP',
    'DOMAINS',
    'DRIVEN',
    'NOT_REACHED',
    'PLANNED',
    'POINT_DISTANCE',
    'REACHED',
    'START',
    'DemoError',
    'DemoPicture',
    'DemoReport',
    'DemoSettings',
    'EndedProcess',
    'GoalMark',
    'GoalResult',
    'MapImage',
    'NoFreeDomainError',
    'Pose',
    'Process',
    'ProcessGroup',
    'RobotTrack',
    'ScriptedOperator',
    'Timeline',
    'built_in_places',
    'console_command',
    'demo_processes',
    'draw_picture',
    'first_place',
    'own_domain',
    'parse_options',
    'write_picture',
]
