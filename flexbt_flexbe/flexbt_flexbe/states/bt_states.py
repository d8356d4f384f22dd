# SPDX-License-Identifier: BSD-3-Clause
"""The states for behavior trees, for behaviors that FlexBE's editor writes."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.ros_access import RosAccess


class BtLoaderState(RosAccess, flexbt_states.BtLoaderState):
    __doc__ = flexbt_states.BtLoaderState.__doc__


class BtExecuteState(RosAccess, flexbt_states.BtExecuteState):
    __doc__ = flexbt_states.BtExecuteState.__doc__


class BtExecuteGoalState(RosAccess, flexbt_states.BtExecuteGoalState):
    __doc__ = flexbt_states.BtExecuteGoalState.__doc__


class BtGetDataState(RosAccess, flexbt_states.BtGetDataState):
    __doc__ = flexbt_states.BtGetDataState.__doc__


class BtSetDataState(RosAccess, flexbt_states.BtSetDataState):
    __doc__ = flexbt_states.BtSetDataState.__doc__
