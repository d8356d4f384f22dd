# SPDX-License-Identifier: BSD-3-Clause
"""Docks, and how a robot gets onto them and off again: what Nav2's docking server does. Pure."""

from .control_law import ControlLaw, velocity_to
from .dock_database import Dock, DockType, load_docks
from .motions import FARTHEST_STAGING, DockingLimits, DockMotion, DockState, Senses, StagingMotion, UndockMotion

__all__ = [
    'FARTHEST_STAGING',
    'ControlLaw',
    'Dock',
    'DockMotion',
    'DockState',
    'DockType',
    'DockingLimits',
    'Senses',
    'StagingMotion',
    'UndockMotion',
    'load_docks',
    'velocity_to',
]
