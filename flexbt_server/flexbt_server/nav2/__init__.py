# SPDX-License-Identifier: BSD-3-Clause
"""The leaves and decorators of Nav2's trees that reach ROS, of both of its branches."""

from .register import register_leaves
from .waypoint_statuses import concluded, missed, pending

__all__ = ['concluded', 'missed', 'pending', 'register_leaves']
