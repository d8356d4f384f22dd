# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy``."""

from flexbt_flexbe.proxy import (
    ProxyActionClient,
    ProxyPublisher,
    ProxyServiceCaller,
    ProxySubscriberCached,
    ProxyTransformListener,
    initialize_proxies,
    shutdown_proxies,
)

__all__ = [
    'ProxyActionClient',
    'ProxyPublisher',
    'ProxyServiceCaller',
    'ProxySubscriberCached',
    'ProxyTransformListener',
    'initialize_proxies',
    'shutdown_proxies',
]
