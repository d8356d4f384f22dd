# SPDX-License-Identifier: BSD-3-Clause
"""The state that waits for servers, under FlexBE's interface."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class WaitForServersState(RosAccess, flexbt_states.WaitForServersState):
    __doc__ = flexbt_states.WaitForServersState.__doc__
