# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states and behaviors under FlexBT: its Python interface, generic states and manifests.

Code that imports ``flexbe_core`` runs unchanged; see :mod:`flexbt_flexbe.shim`.
"""

from typing import Any

from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_flexbe.api.behavior import Behavior
from flexbt_flexbe.api.call_proxies import ProxyActionClient, ProxyServiceCaller
from flexbt_flexbe.api.event_state import ConcurrencyContainer, EventState, OperatableStateMachine, PriorityContainer
from flexbt_flexbe.api.logger import Logger, StateLogger
from flexbt_flexbe.api.topic_proxies import (
    QOS_DEFAULT,
    QOS_LATCH,
    QOS_LOSSY,
    ProxyPublisher,
    ProxySubscriberCached,
    ProxyTransformListener,
)

__all__ = [
    'QOS_DEFAULT',
    'QOS_LATCH',
    'QOS_LOSSY',
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
    'initialize_proxies',
    'set_node',
    'shutdown_proxies',
]


def initialize_flexbe_core(node: Any) -> None:
    """Do nothing: all parts find the node of their run."""


set_node = initialize_flexbe_core


def initialize_proxies(node: Any) -> None:
    """Do nothing: proxies find the node of their run."""


def shutdown_proxies() -> None:
    """Do nothing: a run closes the proxies of its states."""
