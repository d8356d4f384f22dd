# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's containers: the engine's, with what behaviors written by FlexBE's editor call."""

from __future__ import annotations

from flexbt_core import state_machine

from .ros_access import RosAccess


class OperatableStateMachine(RosAccess, state_machine.OperatableStateMachine):
    """A state machine; see :class:`flexbt_core.state_machine.OperatableStateMachine`."""


class ConcurrencyContainer(RosAccess, state_machine.ConcurrencyContainer):
    """Its children run at the same time; see :class:`flexbt_core.state_machine.ConcurrencyContainer`."""


class PriorityContainer(RosAccess, state_machine.PriorityContainer):
    """Everything else is paused meanwhile; see :class:`flexbt_core.state_machine.PriorityContainer`."""
