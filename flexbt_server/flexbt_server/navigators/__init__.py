# SPDX-License-Identifier: BSD-3-Clause
"""What Nav2's clients talk to, served by runs of trees: bt_navigator's part, and waypoint_follower's."""

from .navigators import Navigators
from .parameters import DEFAULT_TREES, NavigatorParameters, declare_navigator_parameters

__all__ = ['DEFAULT_TREES', 'NavigatorParameters', 'Navigators', 'declare_navigator_parameters']
