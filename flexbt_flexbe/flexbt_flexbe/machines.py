# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's containers: the engine's, with what behaviors written by FlexBE's editor call."""

from __future__ import annotations

from flexbt_flexbe.ros_access import RosAccess
from flexbt_onboard import state_machine


class OperatableStateMachine(RosAccess, state_machine.OperatableStateMachine):
    """A state machine; see :class:`flexbt_onboard.state_machine.OperatableStateMachine`."""
