# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that waits."""

from __future__ import annotations

import flexbt_states
from flexbt_flexbe.api import RosAccess


class WaitState(RosAccess, flexbt_states.WaitState):
    __doc__ = flexbt_states.WaitState.__doc__
