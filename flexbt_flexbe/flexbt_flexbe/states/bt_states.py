# SPDX-License-Identifier: BSD-3-Clause
"""The states for behavior trees, with the names of types that the states of flex_bt_flexbe_states take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import flexbt_states
from flexbt_common import names
from flexbt_flexbe.api import RosAccess

_TYPES: Final = {
    'char': 'string',
    'path': 'nav_msgs/msg/Path',
    **{
        name.lower(): f'geometry_msgs/msg/{name}'
        for name in ('Point', 'PointStamped', 'Pose', 'PoseStamped', 'Quaternion', 'TwistStamped')
    },
}


def full_type(name: str) -> str:
    """The name of a type, which may be short as in ``PoseStamped`` or ``pose_stamped[]``."""
    brackets = '[]' if name.endswith('[]') else ''
    short = name.removesuffix('[]').replace('_', '').lower()
    return f'{_TYPES[short]}{brackets}' if '/' not in name and short in _TYPES else name


class BtLoaderState(RosAccess, flexbt_states.BtLoaderState):
    __doc__ = flexbt_states.BtLoaderState.__doc__


class BtExecuteState(RosAccess, flexbt_states.BtExecuteState):
    __doc__ = flexbt_states.BtExecuteState.__doc__


class BtExecuteGoalState(RosAccess, flexbt_states.BtExecuteGoalState):
    __doc__ = flexbt_states.BtExecuteGoalState.__doc__

    def __init__(
        self,
        bt_topic: str = names.BT_EXECUTOR,
        bt_file: str = '',
        goal_id: str = 'goal',
        goal_msg_type: str = 'PoseStamped',
        request_id: str = '',
        request_msg_pkg: str = '',
        request_msg_type: str = '',
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = None,
    ) -> None:
        super().__init__(
            bt_topic,
            bt_file,
            goal_id,
            full_type(goal_msg_type),
            request_id,
            request_msg_pkg,
            request_msg_type if request_msg_pkg else full_type(request_msg_type),
            inputs,
            outputs,
            blackboard,
            timeout,
        )


class BtGetDataState(RosAccess, flexbt_states.BtGetDataState):
    __doc__ = flexbt_states.BtGetDataState.__doc__

    def __init__(
        self,
        bt_topic: str = names.BT_GET_DATA,
        request_id: str = '',
        request_msg_pkg: str = '',
        request_msg_type: str = '',
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = 5.0,
    ) -> None:
        message_type = request_msg_type if request_msg_pkg else full_type(request_msg_type)
        super().__init__(bt_topic, request_id, request_msg_pkg, message_type, outputs, blackboard, timeout)


class BtSetDataState(RosAccess, flexbt_states.BtSetDataState):
    __doc__ = flexbt_states.BtSetDataState.__doc__

    def __init__(
        self,
        bt_topic: str = names.BT_SET_DATA,
        goal_id: str = '',
        goal_msg_type: str = '',
        inputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = 5.0,
    ) -> None:
        super().__init__(bt_topic, goal_id, full_type(goal_msg_type), inputs, blackboard, timeout)
