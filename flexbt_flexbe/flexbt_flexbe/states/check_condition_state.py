# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that branches on a condition."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class CheckConditionState(RosAccess, flexbt_states.CheckConditionState):
    __doc__ = flexbt_states.CheckConditionState.__doc__
