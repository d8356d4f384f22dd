# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states and behaviors under FlexBT: its Python interface, generic states and manifests.

Code that imports ``flexbe_core`` itself runs as it is; see :mod:`flexbt_flexbe.shim`.
"""

from typing import Any

from flexbt_core.state_machine import Autonomy, UserData

from .api import (
    Behavior,
    ConcurrencyContainer,
    EventState,
    Logger,
    OperatableStateMachine,
    PriorityContainer,
    StateLogger,
)
from .proxy import (
    ProxyActionClient,
    ProxyPublisher,
    ProxyServiceCaller,
    ProxySubscriberCached,
    ProxyTransformListener,
)

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
