# SPDX-License-Identifier: BSD-3-Clause
"""States that wait, for a time or for servers, under FlexBE's interface."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class WaitState(RosAccess, flexbt_states.WaitState):
    __doc__ = flexbt_states.WaitState.__doc__


class WaitForServersState(RosAccess, flexbt_states.WaitForServersState):
    __doc__ = flexbt_states.WaitForServersState.__doc__
