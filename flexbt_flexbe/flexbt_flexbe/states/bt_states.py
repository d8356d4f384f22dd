# SPDX-License-Identifier: BSD-3-Clause
"""States of flexbt_states under FlexBE's interface: for behavior trees, and for waiting."""

from __future__ import annotations

from typing import Final

import flexbt_states
from flexbt_flexbe.api.event_state import RosAccess
from flexbt_states.goal_call import GoalState

_TYPES: Final = {
    'char': 'string',
    'path': 'nav_msgs/msg/Path',
    **{
        name.lower(): f'geometry_msgs/msg/{name}'
        for name in ('Point', 'PointStamped', 'Pose', 'PoseStamped', 'Quaternion', 'TwistStamped')
    },
}


def full_type(name: str) -> str:
    """Return the full name of a type, which may be short, such as ``PoseStamped`` or ``pose_stamped[]``."""
    brackets = '[]' if name.endswith('[]') else ''
    short = name.removesuffix('[]').replace('_', '').lower()
    return f'{_TYPES[short]}{brackets}' if '/' not in name and short in _TYPES else name


class _ShortTypes(GoalState):
    """A base class that accepts short type names in its parameters."""

    def _checked_type(self, parameter: str, name: str, package: str = '') -> str:
        return super()._checked_type(parameter, name if package else full_type(name), package)


class BtLoaderState(RosAccess, flexbt_states.BtLoaderState):
    __doc__ = flexbt_states.BtLoaderState.__doc__


class BtExecuteState(RosAccess, flexbt_states.BtExecuteState):
    __doc__ = flexbt_states.BtExecuteState.__doc__


class BtExecuteGoalState(RosAccess, _ShortTypes, flexbt_states.BtExecuteGoalState):
    __doc__ = flexbt_states.BtExecuteGoalState.__doc__


class BtGetDataState(RosAccess, _ShortTypes, flexbt_states.BtGetDataState):
    __doc__ = flexbt_states.BtGetDataState.__doc__


class BtSetDataState(RosAccess, _ShortTypes, flexbt_states.BtSetDataState):
    __doc__ = flexbt_states.BtSetDataState.__doc__


# States that wait, for a time or for servers, under FlexBE's interface.


class WaitState(RosAccess, flexbt_states.WaitState):
    __doc__ = flexbt_states.WaitState.__doc__


class WaitForServersState(RosAccess, flexbt_states.WaitForServersState):
    __doc__ = flexbt_states.WaitForServersState.__doc__
