# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.ros_state``, whose class states ask for the node."""

from flexbt_flexbe import EventState as RosState

__all__ = ['RosState']
