# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that lets the operator decide."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class OperatorDecisionState(RosAccess, flexbt_states.OperatorDecisionState):
    __doc__ = flexbt_states.OperatorDecisionState.__doc__
