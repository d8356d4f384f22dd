# SPDX-License-Identifier: BSD-3-Clause
"""States that use a BT server: load, run, pause and cancel trees, read and write blackboards."""

from .bt_execute_goal_state import BtExecuteGoalState
from .bt_execute_state import BtExecuteState
from .bt_get_data_state import BtGetDataState
from .bt_loader_state import BtLoaderState
from .bt_server_use import BtUse, UsesBtServer
from .bt_set_data_state import BtSetDataState

__all__ = [
    'BtExecuteGoalState',
    'BtExecuteState',
    'BtGetDataState',
    'BtLoaderState',
    'BtSetDataState',
    'BtUse',
    'UsesBtServer',
]
