# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxies: what states use instead of rclpy's clients, publishers and subscriptions.

None of them waits, with one exception that has a deadline (:meth:`ProxyServiceCaller.call`). What they hold belongs to
the run in which they were made, and ends with it.
"""

from typing import Any

from .action_client import ProxyActionClient
from .publisher import ProxyPublisher
from .qos import QOS_DEFAULT, QOS_LATCH, QOS_LOSSY
from .service_caller import ProxyServiceCaller
from .subscriber_cached import ProxySubscriberCached, lacks_of
from .transform_listener import ProxyTransformListener

__all__ = [
    'QOS_DEFAULT',
    'QOS_LATCH',
    'QOS_LOSSY',
    'ProxyActionClient',
    'ProxyPublisher',
    'ProxyServiceCaller',
    'ProxySubscriberCached',
    'ProxyTransformListener',
    'initialize_proxies',
    'lacks_of',
    'shutdown_proxies',
]


def initialize_proxies(node: Any) -> None:
    """Does nothing: proxies find the node of their run."""


def shutdown_proxies() -> None:
    """Does nothing: proxies end with their run."""
