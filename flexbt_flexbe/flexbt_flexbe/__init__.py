# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's Python interface on FlexBT's engine: the names, arguments and meanings of ``flexbe_core``.

Code that imports ``flexbe_core`` itself runs as it is; see :mod:`flexbt_flexbe.shim`.
"""

from typing import Any

from flexbt_flexbe.behavior import Behavior
from flexbt_flexbe.event_state import EventState
from flexbt_flexbe.logger import Logger
from flexbt_flexbe.machines import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_flexbe.proxy import (
    ProxyActionClient,
    ProxyPublisher,
    ProxyServiceCaller,
    ProxySubscriberCached,
    ProxyTransformListener,
)
from flexbt_flexbe.state_logger import StateLogger
from flexbt_onboard.state_machine import Autonomy, UserData

__all__ = [
    'Autonomy',
    'Behavior',
    'ConcurrencyContainer',
    'EventState',
    'Logger',
    'OperatableStateMachine',
    'PriorityContainer',
    'ProxyActionClient',
    'ProxyPublisher',
    'ProxyServiceCaller',
    'ProxySubscriberCached',
    'ProxyTransformListener',
    'StateLogger',
    'UserData',
    'initialize_flexbe_core',
    'set_node',
]


def initialize_flexbe_core(node: Any) -> None:
    """Does nothing: everything finds the node of its run."""


set_node = initialize_flexbe_core
