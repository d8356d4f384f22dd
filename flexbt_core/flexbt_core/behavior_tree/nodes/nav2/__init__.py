# SPDX-License-Identifier: BSD-3-Clause
"""The node types of Nav2 that need no ROS."""

from .motion import DistanceController, Position, SpeedController
from .pause_resume import PauseResumeController
from .register import DIALECTS, Dialect

__all__ = ['DIALECTS', 'Dialect', 'DistanceController', 'PauseResumeController', 'Position', 'SpeedController']
