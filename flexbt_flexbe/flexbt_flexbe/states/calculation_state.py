# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that computes a value."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class CalculationState(RosAccess, flexbt_states.CalculationState):
    __doc__ = flexbt_states.CalculationState.__doc__
